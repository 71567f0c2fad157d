//! Grids of cells over particles: which spheres reach into a cell, and which particles are nearest to a point.

use glam::{UVec3, Vec3};

use super::gpu::Particle;

/// Cubic cells over the spheres of all particles, each with a list of those that reach into it.
#[derive(Debug, Default)]
pub struct Cells {
    pub origin: Vec3,
    /// Side of a cell (m).
    pub side: f32,
    pub counts: UVec3,
    /// By cell, x fastest, where its list begins; the end of the last list; then the lists.
    pub lists: Vec<u32>,
}

/// Most cells along an axis.
const MOST_CELLS: f32 = 256.0;

impl Cells {
    /// Cells that each hold about one particle's centre.
    pub fn of_spheres(particles: &[Particle]) -> Self {
        let centre = |particle: &Particle| Vec3::from_array(particle.position);
        let all = particles.iter();
        let low = all
            .clone()
            .map(|particle| centre(particle) - particle.radius);
        let high = all
            .clone()
            .map(|particle| centre(particle) + particle.radius);
        let (Some(low), Some(high)) = (low.reduce(Vec3::min), high.reduce(Vec3::max)) else {
            return Self::default();
        };
        let (side, counts) = partition(high - low, particles.len());
        let range = |particle: &Particle| {
            let cell = |at: Vec3| ((at - low) / side).as_uvec3().min(counts - 1);
            (
                cell(centre(particle) - particle.radius),
                cell(centre(particle) + particle.radius),
            )
        };
        let (starts, entries) = lists(counts, all.map(range));
        let first = starts.len() as u32;
        let starts = starts.into_iter().map(|start| start + first);
        Self {
            origin: low,
            side,
            counts,
            lists: starts.chain(entries).collect(),
        }
    }
}

/// The side and the numbers of about `count` cubic cells that cover a box of size `extent`.
fn partition(extent: Vec3, count: usize) -> (f32, UVec3) {
    let extent = extent.max(Vec3::splat(extent.max_element().max(1e-20) * 1e-2));
    let side = (f64::from(extent.x) * f64::from(extent.y) * f64::from(extent.z)
        / count.max(1) as f64)
        .cbrt() as f32;
    let side = side.max(extent.max_element() / MOST_CELLS);
    (side, (extent / side).ceil().as_uvec3().max(UVec3::ONE))
}

fn index(counts: UVec3, at: UVec3) -> usize {
    (at.x + counts.x * (at.y + counts.y * at.z)) as usize
}

/// By cell, where its list begins, and the end of the last list; then the entries of all lists. `ranges`: the first and
/// the last cell on each axis of the range that each entry lies in.
fn lists(
    counts: UVec3,
    ranges: impl Iterator<Item = (UVec3, UVec3)> + Clone,
) -> (Vec<u32>, Vec<u32>) {
    let cells_of = |(low, high): (UVec3, UVec3)| {
        let at = move |z, y| (low.x..=high.x).map(move |x| index(counts, UVec3::new(x, y, z)));
        (low.z..=high.z).flat_map(move |z| (low.y..=high.y).flat_map(move |y| at(z, y)))
    };
    let mut starts = vec![0_u32; index(counts, counts - 1) + 2];
    for cell in ranges.clone().flat_map(cells_of) {
        starts[cell + 1] += 1;
    }
    for cell in 1..starts.len() {
        starts[cell] += starts[cell - 1];
    }
    let mut ends = starts.clone();
    let mut entries = vec![0; starts[starts.len() - 1] as usize];
    for (number, range) in (0..).zip(ranges) {
        for cell in cells_of(range) {
            entries[ends[cell] as usize] = number;
            ends[cell] += 1;
        }
    }
    (starts, entries)
}

/// The `K` nearest of `places` to each point, nearest first, with their squared distances; the last one repeats where
/// there are fewer. All lie in a box of size `extents` around the origin. Without places there are no results.
pub fn nearest<const K: usize>(
    places: &[Vec3],
    points: impl Iterator<Item = Vec3>,
    extents: Vec3,
) -> Vec<[(u32, f32); K]> {
    if places.is_empty() {
        return Vec::new();
    }
    let (side, counts) = partition(extents, places.len().div_ceil(2));
    let cell = |at: Vec3| {
        let place = (at + extents / 2.0) / side;
        place.max(Vec3::ZERO).as_uvec3().min(counts - 1)
    };
    let (starts, entries) = lists(counts, places.iter().map(|&at| (cell(at), cell(at))));
    let widest = counts.max_element();
    let search = |point: Vec3| {
        let centre = cell(point);
        let mut found = Nearest::<K>::default();
        // Rings of cells around that of the point, until nothing nearer can follow.
        for ring in 0..=widest {
            for list in cells_of_ring(centre, ring, counts).map(|at| index(counts, at)) {
                for &number in &entries[starts[list] as usize..starts[list + 1] as usize] {
                    found.add(number, places[number as usize].distance_squared(point));
                }
            }
            let reach = ring as f32 * side;
            if found.count == K && found.nearest[K - 1].1 <= reach * reach {
                break;
            }
        }
        let last = found.count - 1;
        std::array::from_fn(|number| found.nearest[number.min(last)])
    };
    points.map(search).collect()
}

/// The cells of a grid whose largest distance from `centre` along an axis is `ring`.
fn cells_of_ring(centre: UVec3, ring: u32, counts: UVec3) -> impl Iterator<Item = UVec3> {
    let low = centre.saturating_sub(UVec3::splat(ring));
    let high = (centre + ring).min(counts - 1);
    let is_edge = move |at: u32, centre: u32| at.abs_diff(centre) == ring;
    let row = move |z: u32, y: u32| {
        let is_whole = is_edge(z, centre.z) || is_edge(y, centre.y);
        // Of rows inside of the ring, at most the two ends are on it.
        let step = if is_whole { 1 } else { 2 * ring };
        let first = if is_whole || is_edge(low.x, centre.x) {
            low.x
        } else {
            centre.x + ring
        };
        (first..=high.x)
            .step_by(step.max(1) as usize)
            .map(move |x| UVec3::new(x, y, z))
    };
    (low.z..=high.z).flat_map(move |z| (low.y..=high.y).flat_map(move |y| row(z, y)))
}

/// The `K` nearest so far, nearest first, those of the lowest number first where they are as near, and their squared
/// distances.
struct Nearest<const K: usize> {
    nearest: [(u32, f32); K],
    count: usize,
}

impl<const K: usize> Default for Nearest<K> {
    fn default() -> Self {
        Self {
            nearest: [(u32::MAX, f32::INFINITY); K],
            count: 0,
        }
    }
}

impl<const K: usize> Nearest<K> {
    fn add(&mut self, number: u32, squared: f32) {
        let is_before = |&(other, at): &(u32, f32)| (at, other) < (squared, number);
        let place = self.nearest[..self.count].iter().rposition(is_before);
        let place = place.map_or(0, |last| last + 1);
        if place < K {
            self.count = (self.count + 1).min(K);
            self.nearest[place..self.count].rotate_right(1);
            self.nearest[place] = (number, squared);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    #[test]
    fn the_nearest_are_those_that_a_search_of_all_finds() {
        let mut random = Random(7);
        let extents = Vec3::new(4.0, 1.0, 2.5);
        let mut anywhere = || {
            let at = [(); 3].map(|()| random.next() as f32 - 0.5);
            // Denser on one side.
            let at = Vec3::from_array(at);
            (Vec3::new(at.x * at.x * 2.0 - 0.5, at.y, at.z)) * extents
        };
        for count in [1, 5, 8, 300] {
            let places: Vec<Vec3> = (0..count).map(|_| anywhere()).collect();
            let points: Vec<Vec3> = (0..200).map(|_| anywhere()).collect();
            let found = nearest::<8>(&places, points.iter().copied(), extents);
            for (point, found) in points.iter().zip(found) {
                let mut all: Vec<f32> = places
                    .iter()
                    .map(|place| place.distance_squared(*point))
                    .collect();
                all.sort_by(f32::total_cmp);
                for (number, (_, squared)) in found.into_iter().enumerate() {
                    assert_eq!(squared, all[number.min(all.len() - 1)]);
                }
            }
        }
    }

    #[test]
    fn cells_list_every_sphere_that_reaches_into_them() {
        let mut random = Random(3);
        let mut number = || random.next() as f32;
        let particles: Vec<Particle> = (0..50)
            .map(|_| Particle {
                position: [number(), number() * 3.0, number()],
                radius: 0.02 + 0.2 * number(),
                medium: 0,
                padding: [0; 3],
            })
            .collect();
        let cells = Cells::of_spheres(&particles);
        for (index_of, particle) in (0..).zip(&particles) {
            let point = Vec3::from_array(particle.position) + Vec3::X * particle.radius * 0.99;
            let cell = ((point - cells.origin) / cells.side).as_uvec3();
            let cell = index(cells.counts, cell.min(cells.counts - 1));
            let list = cells.lists[cell] as usize..cells.lists[cell + 1] as usize;
            assert!(cells.lists[list].contains(&index_of));
        }
    }
}
