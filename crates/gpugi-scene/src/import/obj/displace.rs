//! Displacement: moves the vertices of meshes by a height map (MTL's `disp`), once there are enough of them.

use std::collections::HashMap;
use std::rc::Rc;

use glam::{DAffine2, DVec2, DVec3, Vec3};

use super::refine::{LONGEST, Places, Surface, refine};
use super::texture::Map;
use crate::bounds::Bounds;
use crate::image::Heights;
use crate::import::budget::Budget;
use crate::import::quoted;
use crate::normals::Face;
use crate::tangents::unit_or;
use crate::{ImportError, Mesh};

/// Displacements beyond the size of the scene times this are damage.
const FARTHEST: f32 = 100.0;
/// Where the mean normal at a place is shorter than this, surfaces face opposite ways, and nothing moves.
const SHORTEST_MEAN: f32 = 1e-3;

/// How far the surfaces of a material rise along their normals.
#[derive(Debug, Clone)]
pub struct Relief {
    /// The image and what [`Heights::into_levels`] makes of it.
    pub levels: Rc<Vec<Heights>>,
    pub map: Map,
}

impl Relief {
    /// The displacement (m) where the image has `height`.
    fn displacement(&self, height: f32) -> f32 {
        (self.map.base + self.map.gain * height) * self.map.strength
    }

    /// The greatest displacement (m), inward or outward; infinite if any is no number.
    fn farthest(&self) -> f32 {
        let range = self.levels[0].range();
        let distances = range.map(|height| self.displacement(height).abs());
        let number = |distance: f32| {
            if distance.is_nan() {
                f32::INFINITY
            } else {
                distance
            }
        };
        distances.map(number).into_iter().fold(0.0, f32::max)
    }

    /// Why a mesh cannot be displaced by it, if so; `farthest`: the greatest displacement allowed (m).
    fn problem(&self, mesh: &Mesh, farthest: f32) -> Option<String> {
        if mesh.uvs[0].is_empty() {
            return Some("it has no texture coordinates".to_owned());
        }
        let distance = self.farthest();
        (distance > farthest)
            .then(|| format!("by {distance} m, which is more than {FARTHEST} times the scene"))
    }
}

/// Displaces the meshes that have a relief, all together, and notes in `warnings` what is left out. All meshes need
/// normals. Tangents are left to the caller.
pub fn displace(
    file: &str,
    meshes: &mut [Mesh],
    reliefs: &[Option<&Relief>],
    budget: &Budget,
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    if reliefs.iter().all(Option::is_none) {
        return Ok(());
    }
    let all = meshes
        .iter()
        .flat_map(|mesh| mesh.positions.iter().copied());
    let farthest = FARTHEST * Bounds::of(all).diagonal();
    let mut places = Places::default();
    let (mut displaced, mut still, mut chosen) = (Vec::new(), Vec::new(), Vec::new());
    for (mesh, relief) in meshes.iter_mut().zip(reliefs) {
        let Some(relief) = relief else {
            still.push(&*mesh);
            continue;
        };
        if let Some(problem) = relief.problem(mesh, farthest) {
            let name = quoted(&mesh.name);
            warnings.push(format!("mesh \"{name}\" is not displaced: {problem}"));
            still.push(&*mesh);
            continue;
        }
        displaced.push(mesh);
        chosen.push(*relief);
    }
    let error = |reason: String| ImportError::new(file, "displacement", reason);
    let indices: usize = displaced.iter().map(|mesh| mesh.indices.len()).sum();
    let allowed = budget.displaced_triangles(indices as u64 / 3);
    let (most, limit) = allowed.map_err(error)?;
    let before: Vec<[usize; 2]> = displaced.iter().map(|mesh| counts(mesh)).collect();
    let mut surfaces: Vec<Surface> = displaced
        .into_iter()
        .zip(&chosen)
        .map(|(mesh, relief)| {
            let uv_from_mesh = uv_from_mesh(relief);
            let size = DVec2::from(relief.levels[0].size().map(f64::from));
            let texel = move |uv| uv_from_mesh.transform_point2(uv) * size;
            Surface::new(mesh, &mut places, texel)
        })
        .collect();
    still.iter().for_each(|mesh| places.pin(mesh));
    if refine(&mut surfaces, &mut places, most) {
        let longest = surfaces.iter().map(Surface::longest_edge);
        let longest = longest.fold(0.0, f64::max);
        warnings.push(format!(
            "displacement is coarser than its images: edges span up to {longest:.0} texels, because there may be {most} \
             triangles; --limits {limit} raises that"
        ));
    }
    for (surface, before) in surfaces.iter().zip(before) {
        let charged = budget.charge_displaced(before, counts(surface.mesh));
        charged.map_err(error)?;
    }
    move_vertices(&mut surfaces, &chosen, &places);
    Ok(())
}

/// Numbers of vertices and of indices.
fn counts(mesh: &Mesh) -> [usize; 2] {
    [mesh.positions.len(), mesh.indices.len()]
}

fn uv_from_mesh(relief: &Relief) -> DAffine2 {
    relief.map.uv_from_mesh().as_daffine2()
}

/// Moves each place by the mean height along the mean normal of its vertices, and turns the normals with the surface.
fn move_vertices(surfaces: &mut [Surface], reliefs: &[&Relief], places: &Places) {
    let mut sums = vec![(0.0_f32, Vec3::ZERO, 0.0_f32); places.count()];
    for (surface, relief) in surfaces.iter().zip(reliefs) {
        // Where vertices are farther apart than texels, each takes the mean around it.
        let apart = surface.longest_edge() / LONGEST;
        let level = apart.max(1.0).log2() as usize;
        let heights = &relief.levels[level.min(relief.levels.len() - 1)];
        let uv_from_mesh = uv_from_mesh(relief);
        for (vertex, &place) in surface.places.iter().enumerate() {
            let uv = uv_from_mesh.transform_point2(surface.mesh.uvs[0][vertex].as_dvec2());
            let height = relief.displacement(heights.at(uv, relief.map.clamp));
            let (sum, normals, count) = &mut sums[place as usize];
            *sum += height;
            *normals += surface.mesh.normals[vertex];
            *count += 1.0;
        }
    }
    for place in &places.pinned {
        sums[*place as usize] = Default::default();
    }
    let offset = |place: u32| {
        let (sum, normals, count) = sums[place as usize];
        let is_opposed = normals.length() <= SHORTEST_MEAN * count;
        let normal = if is_opposed {
            Vec3::ZERO
        } else {
            unit_or(Vec3::ZERO, normals)
        };
        normal * (sum / f32::max(count, 1.0))
    };

    let mut turns = Turns::default();
    let groups: Vec<Vec<u32>> = surfaces
        .iter()
        .map(|surface| turns.groups(surface))
        .collect();
    for (surface, groups) in surfaces.iter().zip(&groups) {
        turns.add(surface.mesh, groups, |turn| &mut turn.before);
    }
    for surface in &mut *surfaces {
        for (position, &place) in surface.mesh.positions.iter_mut().zip(&surface.places) {
            *position += offset(place);
        }
    }
    for (surface, groups) in surfaces.iter().zip(&groups) {
        turns.add(surface.mesh, groups, |turn| &mut turn.after);
    }
    for (surface, groups) in surfaces.iter_mut().zip(&groups) {
        for (normal, &group) in surface.mesh.normals.iter_mut().zip(groups) {
            *normal = turns.all[group as usize].turned(*normal);
        }
    }
}

/// How the faces around vertices turn: around each place, those of one shading normal, so that smooth edges stay smooth
/// and sharp ones sharp.
#[derive(Default)]
struct Turns {
    number_of: HashMap<(u32, [u32; 3]), u32>,
    all: Vec<Turn>,
}

/// Sums of the normals of faces, weighted by area and angle.
#[derive(Default, Clone, Copy)]
struct Turn {
    before: DVec3,
    after: DVec3,
}

impl Turns {
    /// The number of each vertex's turn.
    fn groups(&mut self, surface: &Surface) -> Vec<u32> {
        let vertices = surface.places.iter().zip(&surface.mesh.normals);
        let groups = vertices.map(|(&place, normal)| {
            let next = self.all.len() as u32;
            let key = (place, normal.to_array().map(f32::to_bits));
            let number = *self.number_of.entry(key).or_insert(next);
            if number == next {
                self.all.push(Turn::default());
            }
            number
        });
        groups.collect()
    }

    fn add(&mut self, mesh: &Mesh, groups: &[u32], sum: impl Fn(&mut Turn) -> &mut DVec3) {
        for triangle in mesh.indices.as_chunks::<3>().0 {
            let position = |vertex: u32| mesh.positions[vertex as usize].as_dvec3();
            let face = Face::new(triangle.map(position));
            for (&vertex, weight) in triangle.iter().zip(face.weights) {
                let turn = &mut self.all[groups[vertex as usize] as usize];
                *sum(turn) += face.normal * weight;
            }
        }
    }
}

impl Turn {
    /// What becomes of a shading normal: it changes by as much as the mean normal of the faces, so that it stays as it
    /// is where they only move.
    fn turned(&self, normal: Vec3) -> Vec3 {
        let [before, after] = [self.before, self.after].map(DVec3::normalize_or_zero);
        let side = before.dot(normal.as_dvec3()).signum();
        let turned = normal.as_dvec3() + (after - before) * side;
        turned.normalize_or(normal.as_dvec3()).as_vec3()
    }
}
