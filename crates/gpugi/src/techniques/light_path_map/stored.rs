//! Panes that leave the program in files, and come back (docs/panes.md).

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Mat3, Vec2};
use gpugi_scene::provoking::{ProvokingMesh, provoking_order};
use gpugi_scene::{Atlas, LightPathPanes, Scene, SurfacePlace};

use super::INFO;
use super::entries::{Entries, Entry, normal_scale, surface_area};
use super::maps::LightPathMaps;
use crate::gpu::{Gpu, GpuError};

/// By how many corners the scene's tables turn triangles, which begin with their provoking vertex.
struct Turns<'a> {
    scene: &'a Scene,
    orders: HashMap<usize, ProvokingMesh>,
}

impl<'a> Turns<'a> {
    fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            orders: HashMap::new(),
        }
    }

    /// The corner of the mesh's triangle with which it begins there.
    fn first_corner(&mut self, instance: u32, triangle: u32) -> usize {
        let mesh = self.scene.instances[instance as usize].mesh;
        let (order, mesh) = (self.orders.entry(mesh), &self.scene.meshes[mesh]);
        let order = order.or_insert_with(|| provoking_order(&mesh.indices, mesh.positions.len()));
        let vertex = order.vertices[triangle as usize];
        let corners = &mesh.indices[3 * triangle as usize..][..3];
        let found = corners.iter().position(|&corner| corner == vertex);
        found.unwrap_or(0)
    }
}

/// The weights of three corners, of which the first is not given.
fn weights([second, third]: [f32; 2]) -> [f32; 3] {
    [1.0 - second - third, second, third]
}

/// The points of `stored` panes, which fit the scene.
pub(super) fn entries(scene: &Scene, stored: &LightPathPanes) -> Entries {
    let mut turns = Turns::new(scene);
    let mut entry = |place: &SurfacePlace| {
        let instance = &scene.instances[place.instance as usize];
        let mesh = &scene.meshes[instance.mesh];
        let corners = &mesh.indices[3 * place.triangle as usize..][..3];
        let world = instance.world_from_mesh;
        let [a, b, c] = [0, 1, 2].map(|corner| {
            let vertex = corners[corner] as usize;
            world.transform_point3(mesh.positions[vertex])
        });
        let [u, v] = place.barycentrics;
        let front = (b - a).cross(c - a).normalize_or_zero();
        let is_mirrored = Mat3::from_mat4(world).determinant() < 0.0;
        let turn = turns.first_corner(place.instance, place.triangle);
        let weight = |corner: usize| weights(place.barycentrics)[(turn + corner) % 3];
        Entry {
            position: a + (b - a) * u + (c - a) * v,
            normal: if is_mirrored { -front } else { front },
            instance: place.instance,
            triangle: place.triangle,
            barycentrics: Vec2::new(weight(1), weight(2)),
        }
    };
    let all = surface_area(scene);
    let count = stored.entries.len() as u32;
    Entries {
        entries: stored.entries.iter().map(&mut entry).collect(),
        firsts: stored.firsts.clone(),
        samples: stored.samples.iter().map(&mut entry).collect(),
        first_samples: (stored.first_samples.iter())
            .map(|first| count + first)
            .collect(),
        area: (all / f64::from(count)) as f32,
        normal_scale: normal_scale(all, stored.clusters() as u32),
    }
}

/// Panes that are complete, for files: texels without a point are filled from those around them, so that any bilinear
/// filter may read them. The hashes of the scene are left to the file's writer. Waits for the GPU.
///
/// # Errors
/// [`GpuError`], also where the scene has no surface.
pub(super) fn finished(
    gpu: &Gpu,
    scene: &Scene,
    atlas: Arc<Atlas>,
    made: &LightPathMaps,
) -> Result<LightPathPanes, GpuError> {
    let Entries {
        entries,
        firsts,
        samples,
        first_samples,
        ..
    } = &made.panes.points.entries;
    if entries.is_empty() {
        return Err(INFO.unfit("the scene has no surface"));
    }
    made.fill(gpu)?;
    let mut turns = Turns::new(scene);
    let mut place = |entry: &Entry| {
        let turn = turns.first_corner(entry.instance, entry.triangle);
        let weight =
            |corner: usize| weights(entry.barycentrics.to_array())[(corner + 3 - turn) % 3];
        SurfacePlace {
            instance: entry.instance,
            triangle: entry.triangle,
            barycentrics: [weight(1), weight(2)],
        }
    };
    let count = entries.len() as u32;
    Ok(LightPathPanes {
        atlas,
        depth: made.panes.depth(),
        entries: entries.iter().map(&mut place).collect(),
        samples: samples.iter().map(&mut place).collect(),
        firsts: firsts.clone(),
        first_samples: first_samples.iter().map(|first| first - count).collect(),
        panes: made.panes.save(gpu)?,
        geometry: [0; 32],
        materials: [0; 32],
    })
}
