//! Groups of points that are near each other, in any number of dimensions.

/// Rounds of means.
const ROUNDS: u32 = 16;

/// Splits the sites with the numbers `group` into `parts` groups of about the same size, at medians of the coordinate
/// that varies most.
pub(super) fn halves<const N: usize>(
    sites: &[[f32; N]],
    mut group: Vec<usize>,
    parts: usize,
) -> Vec<Vec<usize>> {
    let parts = parts.min(group.len());
    if parts < 2 {
        return if group.is_empty() {
            Vec::new()
        } else {
            vec![group]
        };
    }
    let extent = |&axis: &usize| {
        let values = group.iter().map(|&index| sites[index][axis]);
        values.clone().fold(f32::MIN, f32::max) - values.fold(f32::MAX, f32::min)
    };
    let axis = (0..N)
        .max_by(|a, b| extent(a).total_cmp(&extent(b)))
        .unwrap_or(0);
    group.sort_unstable_by(|&a, &b| sites[a][axis].total_cmp(&sites[b][axis]).then(a.cmp(&b)));
    let of_first = parts / 2;
    let rest = group.split_off(group.len() * of_first / parts);
    let mut groups = halves(sites, group, of_first);
    groups.extend(halves(sites, rest, parts - of_first));
    groups
}

/// The sites by the nearest of the means.
pub(super) fn nearest<const N: usize>(sites: &[[f32; N]], means: &[[f32; N]]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); means.len()];
    // Means by their place along the longest axis: the search goes outward from the site, and ends where that distance
    // alone is too far.
    let extent = |&axis: &usize| {
        let values = means.iter().map(|mean| mean[axis]);
        values.clone().fold(f32::MIN, f32::max) - values.fold(f32::MAX, f32::min)
    };
    let axis = (0..N)
        .max_by(|a, b| extent(a).total_cmp(&extent(b)))
        .unwrap_or(0);
    let mut order: Vec<usize> = (0..means.len()).collect();
    order.sort_by(|&a, &b| means[a][axis].total_cmp(&means[b][axis]));
    for (index, site) in sites.iter().enumerate() {
        let (mut found, mut least) = (0, f32::INFINITY);
        let middle = order.partition_point(|&number| means[number][axis] < site[axis]);
        let mut look = |numbers: &mut dyn Iterator<Item = &usize>| {
            for &number in numbers {
                let mean = &means[number];
                if (site[axis] - mean[axis]).powi(2) > least {
                    break;
                }
                let apart = site.iter().zip(mean).map(|(a, b)| (a - b) * (a - b));
                let squared: f32 = apart.sum();
                if squared < least || (squared == least && number < found) {
                    (found, least) = (number, squared);
                }
            }
        };
        look(&mut order[middle..].iter());
        look(&mut order[..middle].iter().rev());
        groups[found].push(index);
    }
    groups
}

/// Lloyd's iteration of k-means. A group that runs empty takes half of the largest one.
pub(super) fn refine<const N: usize>(sites: &[[f32; N]], groups: &mut [Vec<usize>]) {
    for _ in 0..ROUNDS {
        let means: Vec<[f32; N]> = groups.iter().map(|group| mean(sites, group)).collect();
        let mut moved = nearest(sites, &means);
        while let Some(empty) = moved.iter().position(Vec::is_empty) {
            let largest = moved.iter_mut().max_by_key(|group| group.len());
            let Some(largest) = largest.filter(|group| group.len() > 1) else {
                break;
            };
            let half = largest.split_off(largest.len() / 2);
            moved[empty] = half;
        }
        if moved == groups {
            break;
        }
        groups.clone_from_slice(&moved);
    }
}

pub(super) fn mean<const N: usize>(sites: &[[f32; N]], group: &[usize]) -> [f32; N] {
    let mut sum = [0.0_f64; N];
    for &index in group {
        for (sum, value) in sum.iter_mut().zip(sites[index]) {
            *sum += f64::from(value);
        }
    }
    sum.map(|sum| (sum / group.len().max(1) as f64) as f32)
}
