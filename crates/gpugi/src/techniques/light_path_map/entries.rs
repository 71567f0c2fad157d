//! Entry points, their clusters, and light samples.

use glam::{Mat3, Vec2, Vec3};
use gpugi_scene::Scene;
use gpugi_scene::provoking::provoking_order;

/// A point of a surface at which direct light enters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    /// World space (m).
    pub position: Vec3,
    /// Unit normal of the triangle's front.
    pub normal: Vec3,
    pub instance: u32,
    pub triangle: u32,
    /// Weights of the second and the third corner, in the order of the scene's tables.
    pub barycentrics: Vec2,
}

/// Entry points, cluster by cluster.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Entries {
    pub entries: Vec<Entry>,
    /// First entry point of each cluster, and behind the last one the number of all.
    pub firsts: Vec<u32>,
    /// Further points at which the light is sampled, cluster by cluster.
    pub samples: Vec<Entry>,
    /// First light sample of each cluster, counted from the first entry point, and behind the last one the end of all.
    pub first_samples: Vec<u32>,
    /// Area that each entry point stands for (m^2).
    pub area: f32,
    /// Distance that counts as much as normals which differ by 1 (m).
    pub normal_scale: f32,
}

/// A triangle in world space.
struct Triangle {
    corners: [Vec3; 3],
    front: Vec3,
    instance: u32,
    number: u32,
}

/// Rounds of means.
const ROUNDS: u32 = 16;

impl Entries {
    /// `count` points, spread evenly over the scene's surfaces, in `clusters` clusters, and `samples` light samples;
    /// none of them where the scene has no surfaces.
    pub fn new(scene: &Scene, count: u32, samples: u32, clusters: u32) -> Self {
        let (triangles, sums) = triangles(scene);
        let all = sums.last().copied().unwrap_or(0.0);
        if triangles.is_empty() || !(all as f32).is_finite() {
            return Self::default();
        }
        let normal_scale = normal_scale(all, clusters);
        let site = |entry: &Entry| {
            let ([x, y, z], normal) = (entry.position.to_array(), entry.normal * normal_scale);
            [x, y, z, normal.x, normal.y, normal.z]
        };
        let entries = spread(&triangles, &sums, count);
        let sites: Vec<[f32; 6]> = entries.iter().map(site).collect();
        let mut groups = halves(&sites, (0..entries.len()).collect(), clusters as usize);
        refine(&sites, &mut groups);
        let (sorted, firsts) = by_group(&entries, &groups, 0);
        let samples = spread(&triangles, &sums, samples);
        let sites_of_samples: Vec<[f32; 6]> = samples.iter().map(site).collect();
        let means: Vec<[f32; 6]> = groups.iter().map(|group| mean(&sites, group)).collect();
        let (samples, first_samples) =
            by_group(&samples, &nearest(&sites_of_samples, &means), sorted.len());
        Self {
            entries: sorted,
            firsts,
            samples,
            first_samples,
            area: (all / f64::from(count)) as f32,
            normal_scale,
        }
    }

    /// Number of clusters.
    pub fn clusters(&self) -> u32 {
        self.firsts.len().saturating_sub(1) as u32
    }

    /// Entry points, then light samples.
    pub fn points(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().chain(&self.samples)
    }

    /// The entry points with the numbers of their clusters.
    pub fn with_clusters(&self) -> impl Iterator<Item = (&Entry, u32)> {
        let clusters = self.firsts.windows(2).zip(0..);
        let clusters =
            clusters.flat_map(|(ends, cluster)| (ends[0]..ends[1]).map(move |_| cluster));
        self.entries.iter().zip(clusters)
    }
}

/// The distance that counts as much as normals which differ by 1, about the radius of a cluster: a right angle counts as
/// much as being 1.4 radii apart (m). `all`: area of all surfaces (m^2).
pub(super) fn normal_scale(all: f64, clusters: u32) -> f32 {
    (all as f32 / std::f32::consts::PI / clusters as f32).sqrt()
}

/// Area of all surfaces (m^2).
pub(super) fn surface_area(scene: &Scene) -> f64 {
    triangles(scene).1.last().copied().unwrap_or(0.0)
}

/// All triangles that have an area, with the sums of their areas (m^2).
fn triangles(scene: &Scene) -> (Vec<Triangle>, Vec<f64>) {
    let (mut triangles, mut sums) = (Vec::new(), Vec::new());
    let mut sum = 0.0;
    for (instance, placed) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[placed.mesh];
        let order = provoking_order(&mesh.indices, mesh.positions.len());
        let is_mirrored = Mat3::from_mat4(placed.world_from_mesh).determinant() < 0.0;
        for (number, corners) in order.indices.as_chunks::<3>().0.iter().enumerate() {
            let corners = corners.map(|vertex| {
                let position = mesh.positions[order.vertices[vertex as usize] as usize];
                placed.world_from_mesh.transform_point3(position)
            });
            let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let area = f64::from(across.length()) / 2.0;
            let Some(normal) = across.try_normalize().filter(|_| area.is_finite()) else {
                continue;
            };
            sum += area;
            sums.push(sum);
            triangles.push(Triangle {
                corners,
                front: if is_mirrored { -normal } else { normal },
                instance: instance as u32,
                number: number as u32,
            });
        }
    }
    (triangles, sums)
}

/// The points sorted by their groups, and the first of each group, counted from `start`, with the end of all.
fn by_group(points: &[Entry], groups: &[Vec<usize>], start: usize) -> (Vec<Entry>, Vec<u32>) {
    let mut firsts = vec![start as u32];
    let mut sorted = Vec::with_capacity(points.len());
    for group in groups {
        sorted.extend(group.iter().map(|&index| points[index]));
        firsts.push((start + sorted.len()) as u32);
    }
    (sorted, firsts)
}

/// `count` points by area: those of Hammersley's set choose a triangle by their first coordinate, and a place in it by
/// what is left of that coordinate and by the second one. `sums`: sums of the triangles' areas (m^2).
fn spread(triangles: &[Triangle], sums: &[f64], count: u32) -> Vec<Entry> {
    let all = sums.last().copied().unwrap_or(0.0);
    let entry = |index: u32| {
        let at = (f64::from(index) + 0.5) / f64::from(count) * all;
        let chosen = sums.partition_point(|&sum| sum <= at).min(sums.len() - 1);
        let before = if chosen == 0 { 0.0 } else { sums[chosen - 1] };
        let triangle = &triangles[chosen];
        let rest = ((at - before) / (sums[chosen] - before)) as f32;
        let second = (f64::from(index.reverse_bits()) + 0.5) / (f64::from(u32::MAX) + 1.0);
        let barycentrics = on_triangle(rest, second as f32);
        let [a, b, c] = triangle.corners;
        Entry {
            position: a + (b - a) * barycentrics.x + (c - a) * barycentrics.y,
            normal: triangle.front,
            instance: triangle.instance,
            triangle: triangle.number,
            barycentrics,
        }
    };
    (0..count).map(entry).collect()
}

/// Barycentrics that are evenly distributed if the coordinates are (Heitz 2019).
fn on_triangle(u: f32, v: f32) -> Vec2 {
    if v > u {
        Vec2::new(u / 2.0, v - u / 2.0)
    } else {
        Vec2::new(u - v / 2.0, v / 2.0)
    }
}

/// Splits the sites with the numbers `group` into `parts` groups of about the same size, at medians of the coordinate
/// that varies most.
fn halves(sites: &[[f32; 6]], mut group: Vec<usize>, parts: usize) -> Vec<Vec<usize>> {
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
    let axis = (0..6)
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
fn nearest(sites: &[[f32; 6]], means: &[[f32; 6]]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); means.len()];
    // Means by their place along the longest axis: the search goes outward from the site, and ends where that distance
    // alone is too far.
    let extent = |&axis: &usize| {
        let values = means.iter().map(|mean| mean[axis]);
        values.clone().fold(f32::MIN, f32::max) - values.fold(f32::MAX, f32::min)
    };
    let axis = (0..3)
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
fn refine(sites: &[[f32; 6]], groups: &mut [Vec<usize>]) {
    for _ in 0..ROUNDS {
        let means: Vec<[f32; 6]> = groups.iter().map(|group| mean(sites, group)).collect();
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

fn mean(sites: &[[f32; 6]], group: &[usize]) -> [f32; 6] {
    let mut sum = [0.0_f64; 6];
    for &index in group {
        for (sum, value) in sum.iter_mut().zip(sites[index]) {
            *sum += f64::from(value);
        }
    }
    sum.map(|sum| (sum / group.len().max(1) as f64) as f32)
}
