//! Media as particles: spheres that stand for equal parts of the extinction.

use std::sync::Arc;

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::{Bounds, DensityGrid, Medium, PhaseFunction};

use super::cells::{Cells, nearest};
use super::gpu;
use crate::scene::world_from_box;
use crate::sequences::{R3, additive};

/// Particles among which the field of scattered radiance is interpolated at a node.
pub const NEIGHBOURS: usize = 8;
/// Nodes of the field per particle.
const NODES_PER_PARTICLE: f64 = 8.0;
/// Most nodes along an axis of a box.
const MOST_NODES: f64 = 96.0;
/// Boxes count as filled at least this much: a box with little in it has no more than 8 times as many nodes as a full
/// one.
const LEAST_FILLED: f64 = 0.125;

/// Particles as shaders read them.
#[derive(Debug, Default)]
pub struct Particles {
    /// By medium.
    pub phases: Vec<PhaseFunction>,
    /// Whether any medium takes light or gives any.
    pub are_seen: bool,
    /// By medium, the nodes of its field along the axes, and where they begin.
    pub fields: Vec<[u32; 4]>,
    pub particles: Vec<gpu::Particle>,
    /// Per node of the media's fields its nearest particles, and their weights as bits.
    pub neighbours: Arc<Vec<[[u32; NEIGHBOURS]; 2]>>,
    /// The cells that the particles' spheres reach into.
    pub cells: Cells,
}

/// Placements of media by their numbers, kept for when the particles are made again: media that move or change colour
/// keep theirs.
#[derive(Debug, Default)]
pub struct Placements {
    by_medium: Vec<Option<Placement>>,
    /// [`Particles::neighbours`] of all.
    neighbours: Arc<Vec<[[u32; NEIGHBOURS]; 2]>>,
}

/// Particles and nodes of one medium in its box, wherever that is.
#[derive(Debug)]
struct Placement {
    distribution: Arc<Distribution>,
    count: u32,
    /// Extents of the box (m).
    extents: Vec3,
    /// Places in the box (-0.5 to 0.5) and radii (m).
    spheres: Vec<(Vec3, f32)>,
    /// Nodes of the field along the axes.
    nodes: [u32; 3],
    /// As [`Particles::neighbours`], counting from the medium's first particle.
    neighbours: Vec<[[u32; NEIGHBOURS]; 2]>,
}

/// A medium with the distribution of its extinction.
struct Distributed {
    world_from_box: Mat4,
    distribution: Arc<Distribution>,
    /// Integral of the extinction over its volume (m^2), averaged over the channels.
    extinction: f64,
}

impl Particles {
    /// About `count` particles that represent `media`. A medium that fills everything is taken to fill `bounds`.
    pub fn new(media: &[Medium], count: u32, bounds: &Bounds, known: &mut Placements) -> Self {
        let mut are_same = known.by_medium.len() == media.len();
        known.by_medium.resize_with(media.len(), || None);
        let with_known = media.iter().zip(&known.by_medium);
        let distributed =
            with_known.map(|(medium, known)| distribute(medium, bounds, known.as_ref()));
        let distributed: Vec<Option<Distributed>> = distributed.collect();
        let all = distributed.iter().flatten();
        let total: f64 = all.map(|distributed| distributed.extinction).sum();
        let mut made = Self::default();
        let mut nodes = 0;
        for ((medium, distributed), known) in
            media.iter().zip(&distributed).zip(&mut known.by_medium)
        {
            made.phases.push(medium.phase);
            made.fields.push([1, 1, 1, 0]);
            let kept = known.take();
            let Some(distributed) = distributed else {
                are_same &= kept.is_none();
                continue;
            };
            made.are_seen = true;
            let share = distributed.extinction / total.max(f64::MIN_POSITIVE);
            let own = if distributed.extinction > 0.0 {
                (f64::from(count) * share).round().max(1.0) as u32
            } else {
                0
            };
            let kept = kept.filter(|kept| kept.is_of(distributed, own));
            are_same &= kept.is_some();
            let placement = kept.unwrap_or_else(|| Placement::new(distributed, own));
            made.add(distributed, &placement, nodes);
            nodes += placement.neighbours.len() as u32;
            *known = Some(placement);
        }
        if !are_same {
            known.neighbours = Arc::new(neighbours(&known.by_medium));
        }
        made.neighbours = known.neighbours.clone();
        made.cells = Cells::of_spheres(&made.particles);
        made
    }

    /// Appends the particles of the last medium and its field, which begins at `first_node`.
    fn add(&mut self, one: &Distributed, placed: &Placement, first_node: u32) {
        let medium = self.phases.len() as u32 - 1;
        let particles = placed
            .spheres
            .iter()
            .map(|&(in_box, radius)| gpu::Particle {
                position: one.world_from_box.transform_point3(in_box).to_array(),
                radius,
                medium,
                padding: [0; 3],
            });
        self.particles.extend(particles);
        if !placed.spheres.is_empty() {
            let [x, y, z] = placed.nodes;
            self.fields[medium as usize] = [x, y, z, first_node];
        }
    }
}

/// [`Particles::neighbours`] of all media.
fn neighbours(placements: &[Option<Placement>]) -> Vec<[[u32; NEIGHBOURS]; 2]> {
    let mut first = 0;
    let placements = placements.iter().flatten();
    let of_all = placements.flat_map(|placed| {
        let begin = first;
        first += placed.spheres.len() as u32;
        let own = placed.neighbours.iter();
        own.map(move |[numbers, weights]| [numbers.map(|number| begin + number), *weights])
    });
    of_all.collect()
}

/// Lengths of the edges of a box (m).
fn extents(world_from_box: &Mat4) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|axis| world_from_box.col(axis).truncate().length()))
}

/// Extents that differ less, relatively, are the same: moves and turns round them.
const SAME_EXTENTS: f32 = 1e-4;

impl Placement {
    fn is_of(&self, one: &Distributed, count: u32) -> bool {
        let extents = extents(&one.world_from_box);
        Arc::ptr_eq(&self.distribution, &one.distribution)
            && self.count == count
            && (extents - self.extents)
                .abs()
                .cmple(self.extents * SAME_EXTENTS)
                .all()
    }

    /// Places `count` particles.
    fn new(one: &Distributed, count: u32) -> Self {
        let extents = extents(&one.world_from_box);
        let mut made = Self {
            distribution: one.distribution.clone(),
            count,
            extents,
            spheres: Vec::new(),
            nodes: [1; 3],
            neighbours: Vec::new(),
        };
        if count == 0 {
            return made;
        }
        let volume = f64::from(one.world_from_box.determinant().abs());
        // A sphere larger than this would reach far out of the box.
        let largest = extents.min_element() / 4.0;
        let spheres = (0..count).map(|number| {
            let shifted = additive(R3, number).map(|u| (0.5 + u).fract());
            let drawn = one.distribution.draw(shifted);
            // The mean share of the volume of a particle where the density is as here.
            let share = volume / (f64::from(count) * drawn.relative_density);
            let radius = (share * 0.75 / std::f64::consts::PI).cbrt() as f32;
            (drawn.at.as_vec3() - 0.5, radius.min(largest))
        });
        made.spheres = spheres.collect();
        let filled = one.distribution.filled_share().max(LEAST_FILLED);
        let side = volume * filled / NODES_PER_PARTICLE / f64::from(count);
        let along = |extent: f32| (f64::from(extent) / side.cbrt()).round();
        let nodes = extents.to_array();
        let nodes = nodes.map(|extent| along(extent).clamp(2.0, MOST_NODES) as u32);
        let [x, y, z] = nodes;
        made.nodes = nodes;
        let node_places = (0..x * y * z).map(|node| {
            let at = [node % x, node / x % y, node / (x * y)].map(|at| at as f32);
            let share = (Vec3::from_array(at) + 0.5) / Vec3::from_array(nodes.map(|n| n as f32));
            (share - 0.5) * extents
        });
        let places = made.spheres.iter().map(|(in_box, _)| *in_box * extents);
        let found = nearest::<NEIGHBOURS>(&places.collect::<Vec<_>>(), node_places, extents);
        let weighted = found.into_iter().map(|found| {
            let weights = weights(&found.map(|(_, squared)| squared));
            [found.map(|(number, _)| number), weights.map(f32::to_bits)]
        });
        made.neighbours = weighted.collect();
        made
    }
}

/// g as far from plus and minus 1 as directions resolve.
pub fn bounded(asymmetry: f32) -> f32 {
    asymmetry.clamp(-0.99, 0.99)
}

/// Weights (1 - d^2 / R^2)^2 of particles at squared distances d^2, the nearest first, where R is the distance of the
/// last one: it counts nothing, so that weights are continuous where it is replaced. They sum to 1.
fn weights(squared: &[f32; NEIGHBOURS]) -> [f32; NEIGHBOURS] {
    let last = squared[NEIGHBOURS - 1].max(f32::MIN_POSITIVE);
    let weights = squared.map(|squared| (1.0 - squared / last).max(0.0).powi(2) + 1e-6);
    let sum: f32 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// The medium with its box and its distribution; `None` if it neither takes light nor gives any, or has no volume.
fn distribute(medium: &Medium, bounds: &Bounds, known: Option<&Placement>) -> Option<Distributed> {
    let world_from_box = world_from_box(medium, bounds);
    let volume = f64::from(world_from_box.determinant().abs());
    let density = medium.density.as_ref();
    let known = known.map(|known| &known.distribution);
    let distribution = match known.filter(|known| known.is_of(density)) {
        Some(known) => known.clone(),
        None => Arc::new(Distribution::new(density)?),
    };
    let mean = f64::from(medium.extinction.element_sum()) / 3.0;
    let extinction = volume * mean * distribution.mean();
    let is_there = extinction > 0.0 || medium.emission.max_element() > 0.0;
    (is_there && volume > 0.0 && extinction.is_finite()).then_some(Distributed {
        world_from_box,
        distribution,
        extinction,
    })
}

/// The distribution of densities over a unit cube, constant in each cell of a grid.
#[derive(Debug)]
struct Distribution {
    /// `None`: the same everywhere.
    grid: Option<Arc<DensityGrid>>,
    /// Sums of the values before each row along x, and before the end.
    rows: Vec<f64>,
}

/// A point drawn with a probability density proportional to the density.
struct Drawn {
    /// In the unit cube.
    at: DVec3,
    /// The density there, relative to the mean.
    relative_density: f64,
}

impl Distribution {
    /// That of a grid, or an even one. `None` if there is nothing in it.
    fn new(grid: Option<&Arc<DensityGrid>>) -> Option<Self> {
        let mut made = Self {
            grid: grid.cloned(),
            rows: vec![0.0],
        };
        let (size, values) = made.cells();
        if size.iter().product::<usize>() != values.len() {
            return None;
        }
        let mut rows = vec![0.0];
        let mut sum = 0.0;
        for row in values.chunks_exact(size[0].max(1)) {
            sum += row.iter().map(|&value| f64::from(value)).sum::<f64>();
            rows.push(sum);
        }
        made.rows = rows;
        (sum > 0.0 && sum.is_finite()).then_some(made)
    }

    fn is_of(&self, grid: Option<&Arc<DensityGrid>>) -> bool {
        match (&self.grid, grid) {
            (Some(own), Some(grid)) => Arc::ptr_eq(own, grid),
            (None, None) => true,
            _ => false,
        }
    }

    /// Cells along the axes, and their values.
    fn cells(&self) -> ([usize; 3], &[f32]) {
        self.grid.as_ref().map_or(([1; 3], &[1.0]), |grid| {
            (grid.size.map(|cells| cells as usize), &grid.values[..])
        })
    }

    fn total(&self) -> f64 {
        self.rows[self.rows.len() - 1]
    }

    /// Mean density.
    fn mean(&self) -> f64 {
        self.total() / self.cells().1.len() as f64
    }

    /// The share of the cube that the particles fill: (sum of values)^2 / (count x sum of squares).
    fn filled_share(&self) -> f64 {
        let (_, values) = self.cells();
        let squares = values.iter().map(|&value| f64::from(value).powi(2));
        self.total().powi(2) / (squares.sum::<f64>() * values.len() as f64)
    }

    /// Inverts the cumulative distributions of the layers along z, of the rows of a layer, and of the cells of a row.
    fn draw(&self, [u, v, w]: [f64; 3]) -> Drawn {
        let (size, values) = self.cells();
        let [x_cells, y_cells, z_cells] = size;
        let layers = (0..=z_cells).map(|layer| self.rows[layer * y_cells]);
        let (layer, z) = invert(&layers.collect::<Vec<_>>(), w);
        let in_layer = &self.rows[layer * y_cells..=(layer + 1) * y_cells];
        let (row, y) = invert(in_layer, v);
        let first = (layer * y_cells + row) * x_cells;
        let mut sums = vec![0.0];
        let mut sum = 0.0;
        for value in &values[first..first + x_cells] {
            sum += f64::from(*value);
            sums.push(sum);
        }
        let (cell, x) = invert(&sums, u);
        let place = DVec3::new(cell as f64 + x, row as f64 + y, layer as f64 + z);
        let size = size.map(|cells| cells as f64);
        Drawn {
            at: place / DVec3::from_array(size),
            relative_density: f64::from(values[first + cell]) / self.mean(),
        }
    }
}

/// The cell and the place in it (0 to 1) at share `u` of the total of increasing `sums`, never in an empty cell.
fn invert(sums: &[f64], u: f64) -> (usize, f64) {
    let (first, last) = (sums[0], sums[sums.len() - 1]);
    let at = first + u * (last - first);
    let end = sums.partition_point(|&sum| sum <= at);
    let mut cell = end.clamp(1, sums.len() - 1) - 1;
    while cell > 0 && sums[cell + 1] <= sums[cell] {
        cell -= 1;
    }
    let width = (sums[cell + 1] - sums[cell]).max(f64::MIN_POSITIVE);
    (cell, ((at - sums[cell]) / width).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use gpugi_scene::MAX_MEDIA;

    use super::*;

    /// A cube with sides of 2 m around the origin.
    fn medium(density: Option<DensityGrid>) -> Medium {
        Medium {
            name: "medium".into(),
            world_from_box: Some(Mat4::from_scale(Vec3::splat(2.0))),
            extinction: Vec3::splat(1.5),
            albedo: Vec3::splat(0.9),
            phase: PhaseFunction::HenyeyGreenstein(0.0),
            emission: Vec3::ZERO,
            density: density.map(Arc::new),
            node: None,
        }
    }

    fn particles(media: &[Medium], count: u32) -> Particles {
        Particles::new(media, count, &Bounds::EMPTY, &mut Placements::default())
    }

    /// Three times as dense for x > 0, and empty for y < 0.
    fn uneven() -> DensityGrid {
        let value = |cell: u32| {
            let (x, y) = (cell % 4, cell / 4 % 4);
            (if x < 2 { 1.0 } else { 3.0 }) * if y < 2 { 0.0 } else { 1.0 }
        };
        DensityGrid {
            size: [4; 3],
            values: (0..64).map(value).collect(),
        }
    }

    #[test]
    fn particles_follow_the_density() {
        let made = particles(&[medium(Some(uneven()))], 1024);
        assert_eq!(made.particles.len(), 1024);
        let count = |is_there: fn(&[f32; 3]) -> bool| {
            let found = made
                .particles
                .iter()
                .filter(|particle| is_there(&particle.position));
            found.count() as i32
        };
        assert_eq!(count(|at| at[1] < 0.0), 0);
        assert!((count(|at| at[0] > 0.0) - 768).abs() < 8);
        assert!((count(|at| at[2] > 0.0) - 512).abs() < 8);
        // The spheres' shares: 4 m^3 hold as much extinction as their densities 1 and 3 of 2 m^3 each.
        let optical: f32 = made
            .particles
            .iter()
            .map(|particle| {
                let density = if particle.position[0] > 0.0 { 3.0 } else { 1.0 };
                4.0 / 3.0 * std::f32::consts::PI * particle.radius.powi(3) * density
            })
            .sum();
        assert!((optical - 8.0).abs() < 1e-3, "{optical}");
    }

    #[test]
    fn what_has_no_extinction_has_no_particles() {
        let clear = Medium {
            extinction: Vec3::ZERO,
            ..medium(None)
        };
        let none = particles(std::slice::from_ref(&clear), 64);
        assert!(none.particles.is_empty());
        let glowing = Medium {
            emission: Vec3::ONE,
            ..clear
        };
        let made = particles(&[glowing, medium(None)], 64);
        assert!(made.particles.iter().all(|particle| particle.medium == 1));
        assert_eq!(made.particles.len(), 64);
        let torn = DensityGrid {
            size: [3; 3],
            values: vec![1.0; 5],
        };
        let made = particles(&[medium(Some(torn))], 64);
        assert!(made.particles.is_empty());
    }

    /// A file may hold as many media as a scene takes, each with one filled cell in a large volume.
    #[test]
    fn nodes_are_bounded_by_particles() {
        let mut values = vec![0.0; 64 * 64 * 64];
        values[5] = 1.0;
        let sparse = DensityGrid {
            size: [64; 3],
            values,
        };
        let media = vec![medium(Some(sparse)); MAX_MEDIA];
        let made = particles(&media, 1024);
        assert_eq!(made.particles.len(), 1024);
        assert!(
            made.neighbours.len() < 100 * 1024,
            "{}",
            made.neighbours.len()
        );
    }

    #[test]
    fn media_that_move_keep_their_placements() {
        let mut moved = medium(Some(uneven()));
        let still = medium(None);
        let mut known = Placements::default();
        let mut make = |moved: &Medium| {
            let media = [moved.clone(), still.clone()];
            let made = Particles::new(&media, 512, &Bounds::EMPTY, &mut known);
            let placed = known.by_medium.iter().flatten();
            let placed: Vec<_> = placed.map(|placement| placement.spheres.as_ptr()).collect();
            (made, placed)
        };
        let (before, first) = make(&moved);
        let turned = Mat4::from_rotation_y(0.7) * Mat4::from_translation(Vec3::X);
        moved.world_from_box = moved.world_from_box.map(|before| turned * before);
        let (made, kept) = make(&moved);
        assert_eq!(first, kept);
        assert!(Arc::ptr_eq(&before.neighbours, &made.neighbours));
        let anew = particles(&[moved.clone(), medium(None)], 512);
        assert_eq!(made.neighbours, anew.neighbours);
        for (particle, other) in made.particles.iter().zip(&anew.particles) {
            let [at, expected] =
                [particle, other].map(|particle| Vec3::from_array(particle.position));
            assert!(at.distance(expected) < 1e-5 && (particle.radius - other.radius).abs() < 1e-5);
        }
        moved.world_from_box = moved
            .world_from_box
            .map(|before| before * Mat4::from_scale(Vec3::splat(2.0)));
        assert_ne!(make(&moved).0.particles[0].radius, made.particles[0].radius);
        moved.density = None;
        let (replaced, _) = make(&moved);
        let is_below =
            |particle: &gpu::Particle| particle.medium == 0 && particle.position[1] < 0.0;
        assert!(replaced.particles.iter().any(is_below));
    }

    #[test]
    fn weights_of_neighbours_sum_to_one() {
        let made = particles(&[medium(Some(uneven()))], 300);
        assert!(made.neighbours.len() > 300);
        for [indices, weights] in made.neighbours.iter() {
            let sum: f32 = weights.iter().map(|&bits| f32::from_bits(bits)).sum();
            assert!((sum - 1.0).abs() < 1e-5);
            assert!(indices.iter().all(|&index| index < 300));
        }
    }
}
