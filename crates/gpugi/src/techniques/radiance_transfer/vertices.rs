//! Vertices as the points of transfer vectors, and midpoints of edges that are too long.

mod subdivision;

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ops::Range;

use glam::Mat3;
use gpugi_scene::{Instance, Scene};

use self::subdivision::Subdivision;
use super::Settings;
use super::gpu::COEFFICIENT_BYTES;
use crate::capture::SURFACE_POINT_BYTES;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;
use crate::stage::Stage;

/// `HEADER_WORDS` and `INSTANCE_WORDS` of capture/atlas/lookup.wesl.
const HEADER_WORDS: usize = 2;
const INSTANCE_WORDS: usize = 4;
/// `NO_TRIANGLES` of the same shader.
const NO_TRIANGLES: u32 = u32::MAX;
/// `BACK` of vertices/points.wesl.
const BACK: u32 = 1 << 31;
/// `NO_INSTANCE` of capture/surface_point.wesl.
const NO_INSTANCE: u32 = u32::MAX;

/// Points per row of a map.
pub(super) const WIDTH: u32 = 512;

/// The vertices of all instances: one point per vertex of an instance's mesh and per midpoint of its [`Subdivision`], and
/// one more for its back where [`has_back`] says so.
#[derive(Debug)]
pub(super) struct Vertices {
    /// Surface points, in whole rows of [`WIDTH`].
    pub points: wgpu::Buffer,
    pub count: u32,
    /// `atlas` of capture/atlas/lookup.wesl with AT_VERTICES.
    pub lookup: wgpu::Buffer,
    /// First point of each instance, and of none.
    firsts: Vec<u32>,
    /// `corners` of vertices/points.wesl.
    corners: wgpu::Buffer,
    resolve: Kernel,
    longest: f32,
    /// The surfaces that the points are of.
    captured: Stage<Versions>,
}

/// What decides which points there are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VerticesKey {
    /// Version of the meshes.
    meshes: u64,
    /// Longest distance of points along edges (m), and the version of what is measured; `None`: vertices alone.
    longest: Option<(f32, u64)>,
}

impl VerticesKey {
    pub fn new(scene: &GpuScene, settings: &Settings) -> Self {
        let longest = settings.subdivide;
        Self {
            meshes: scene.versions.meshes,
            longest: (longest > 0.0).then_some((longest, scene.versions.geometry)),
        }
    }
}

/// The words that shaders find points by, and where each point lies.
struct Table {
    words: Vec<u32>,
    /// `corners` of vertices/points.wesl.
    corners: Vec<[u32; 4]>,
    firsts: Vec<u32>,
}

/// Whether light is kept for the back of an instance, too, as in atlases ([`gpugi_scene::AtlasOptions::backs`]).
fn has_back(scene: &Scene, instance: &Instance) -> bool {
    let material = &scene.materials[instance.material];
    let is_open = || !scene.meshes[instance.mesh].is_closed();
    material.has_two_sides() && (material.is_translucent() || is_open())
}

impl Table {
    /// `None` if there would be more than `most` points.
    fn new(scene: &Scene, longest: f32, most: usize) -> Option<Self> {
        let instances = scene.instances.len();
        let mut words = vec![0, instances as u32];
        words.resize(HEADER_WORDS + INSTANCE_WORDS * instances, NO_TRIANGLES);
        let mut corners: Vec<[u32; 4]> = Vec::new();
        let mut firsts = vec![0];
        // Instances share points as long as their edges have the same lengths.
        let mut known = HashMap::new();
        for (index, instance) in scene.instances.iter().enumerate() {
            let mut world_from_mesh = Mat3::ZERO;
            if longest > 0.0 {
                world_from_mesh = Mat3::from_mat4(instance.world_from_mesh);
            }
            let shape = world_from_mesh.to_cols_array().map(f32::to_bits);
            let (first_word, subdivision) = match known.entry((instance.mesh, shape)) {
                Entry::Occupied(entry) => entry.into_mut(),
                Entry::Vacant(none) => {
                    let mesh = &scene.meshes[instance.mesh];
                    let made = Subdivision::new(mesh, world_from_mesh, longest, most)?;
                    let first_word = words.len() as u32;
                    words.extend(made.nodes.as_flattened());
                    none.insert((first_word, made))
                }
            };
            let has_back = has_back(scene, instance);
            let points = corners.len() + subdivision.points.len() * (1 + usize::from(has_back));
            if points > most {
                return None;
            }
            for (side, back) in [0, BACK]
                .into_iter()
                .take(1 + usize::from(has_back))
                .enumerate()
            {
                let at = HEADER_WORDS + INSTANCE_WORDS * index + 2 * side;
                words[at..at + 2].copy_from_slice(&[*first_word, corners.len() as u32]);
                corners.extend(subdivision.points.iter().map(|point| match point {
                    Some(on) => {
                        let [u, v] = on.barycentrics.to_array().map(f32::to_bits);
                        [index as u32, on.primitive | back, u, v]
                    }
                    None => [NO_INSTANCE, 0, 0, 0],
                }));
            }
            firsts.push(corners.len() as u32);
        }
        let rows = corners.len().max(1).next_multiple_of(WIDTH as usize);
        corners.resize(rows, [NO_INSTANCE, 0, 0, 0]);
        Some(Self {
            words,
            corners,
            firsts,
        })
    }
}

impl Vertices {
    /// The points of `scene`, whose meshes are `host`'s.
    ///
    /// # Errors
    /// [`GpuError::Input`] if there would be more points than fit buffers; [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        host: &Scene,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let longest = settings.subdivide;
        let most = most_points(gpu, settings);
        let table = Table::new(host, longest, most).ok_or_else(|| GpuError::Input {
            what: format!(
                "radiance-transfer: at=vertices and subdivide={longest} give more than the {most} points whose vectors fit \
                 a buffer of {}; raise subdivide, lower order or coefficients, or use at=texels",
                gpu.adapter.name
            ),
        })?;
        let count = table.corners.len() as u32;
        let bytes = u64::from(count) * SURFACE_POINT_BYTES;
        let points = gpu.room("surface points of vertices [bytes]", bytes)?;
        let corners = gpu.storage("corners of vertices [bytes]", &table.corners)?;
        let resolve = shader!("techniques.radiance_transfer.vertices.points");
        let resolve = Kernel::new(gpu, &resolve, "main", Some(&scene.layout))?;
        Ok(Self {
            lookup: gpu.storage("points of vertices [bytes]", &table.words)?,
            corners,
            resolve,
            points,
            count,
            firsts: table.firsts,
            longest,
            captured: Stage::default(),
        })
    }

    /// What a subdivision costs, in words.
    pub fn described(&self, settings: &Settings) -> Option<String> {
        let longest = self.longest;
        (longest > 0.0).then(|| {
            let bytes = u64::from(self.count) * bytes_of_point(settings);
            format!(
                "subdivide={longest}: the transfer vectors of {} points take {} MiB",
                self.count,
                bytes.div_ceil(1 << 20)
            )
        })
    }

    /// The points of an instance.
    pub fn of_instance(&self, instance: usize) -> Range<u32> {
        self.firsts[instance]..self.firsts[instance + 1]
    }

    /// Captures the points again if geometry or materials have changed: pass `radiance-transfer.vertices`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<(), GpuError> {
        if !self.captured.renew(scene.versions.of(Inputs::SURFACES)) {
            return Ok(());
        }
        let resources: [Named<'_>; 2] = [("corners", &self.corners), ("points", &self.points)];
        let (name, scene) = ("radiance-transfer.vertices", Some(&scene.bind_group));
        frame.run(name, &self.resolve, scene, &resources, [self.count, 1, 1])
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        // A corner has 16 bytes.
        self.points.size() + self.lookup.size() + u64::from(self.count) * 16
    }
}

/// Bytes of a point's transfer vector.
fn bytes_of_point(settings: &Settings) -> u64 {
    u64::from(settings.terms()) * COEFFICIENT_BYTES
}

/// Most points whose vectors, surface points and nodes fit a buffer each.
fn most_points(gpu: &Gpu, settings: &Settings) -> usize {
    // A mesh has about twice as many triangles as points, and a tree twice as many nodes as leaves.
    let bytes_of_nodes = 48;
    let bytes = bytes_of_point(settings)
        .max(SURFACE_POINT_BYTES)
        .max(bytes_of_nodes);
    let limits = gpu.limits();
    let limit = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    // Whole rows, and numbers of 31 bits.
    let most = (limit / bytes).min(1 << 31);
    (most - most % u64::from(WIDTH)) as usize
}
