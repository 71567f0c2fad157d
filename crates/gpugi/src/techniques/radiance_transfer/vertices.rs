//! Vertices as the points of transfer vectors.

use std::ops::Range;

use gpugi_scene::{Instance, Scene, provoking_order};

use crate::capture::SURFACE_POINT_BYTES;
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

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

/// The vertices of all instances: one point per vertex of an instance's mesh, and one more for its back where
/// [`has_back`] says so.
#[derive(Debug)]
pub(super) struct Vertices {
    /// Surface points, in whole rows of [`WIDTH`].
    pub points: wgpu::Buffer,
    pub count: u32,
    /// `atlas` of capture/atlas/lookup.wesl with AT_VERTICES.
    pub lookup: wgpu::Buffer,
    /// First point of each instance, and of none.
    firsts: Vec<u32>,
    resolve: (Kernel, wgpu::BindGroup),
    /// Version of the meshes.
    meshes: u64,
    /// Versions of geometry and materials that the points are of.
    captured: Option<[u64; 2]>,
}

/// The words that shaders find vertices by, and a corner per vertex.
struct Table {
    words: Vec<u32>,
    corners: Vec<[u32; 2]>,
    firsts: Vec<u32>,
}

/// Whether light is kept for the back of an instance, too, as in atlases ([`gpugi_scene::AtlasOptions::backs`]).
fn has_back(scene: &Scene, instance: &Instance) -> bool {
    let material = &scene.materials[instance.material];
    let is_open = || !scene.meshes[instance.mesh].is_closed();
    material.has_two_sides() && (material.is_translucent() || is_open())
}

impl Table {
    fn new(scene: &Scene) -> Self {
        let instances = scene.instances.len();
        let mut words = vec![0, instances as u32];
        words.resize(HEADER_WORDS + INSTANCE_WORDS * instances, NO_TRIANGLES);
        let mut corners: Vec<[u32; 2]> = Vec::new();
        let mut firsts = vec![0];
        let mut first_words = vec![None; scene.meshes.len()];
        for (index, instance) in scene.instances.iter().enumerate() {
            let mesh = &scene.meshes[instance.mesh];
            let order = provoking_order(&mesh.indices, mesh.positions.len());
            let first_word = *first_words[instance.mesh].get_or_insert_with(|| {
                words.extend(&order.vertices);
                (words.len() - order.vertices.len()) as u32
            });
            let first = corners.len();
            corners.resize(first + mesh.positions.len(), [NO_INSTANCE, 0]);
            // The largest triangle at each vertex has the most reliable front.
            let mut largest = vec![f32::NEG_INFINITY; mesh.positions.len()];
            for (primitive, triangle) in order.indices.as_chunks::<3>().0.iter().enumerate() {
                let vertices = triangle.map(|vertex| order.vertices[vertex as usize] as usize);
                let [a, b, c] = vertices.map(|vertex| mesh.positions[vertex]);
                let area = (b - a).cross(c - a).length();
                for (corner, vertex) in vertices.into_iter().enumerate() {
                    if area > largest[vertex] {
                        largest[vertex] = area;
                        corners[first + vertex] = [index as u32, (3 * primitive + corner) as u32];
                    }
                }
            }
            let mut at = HEADER_WORDS + INSTANCE_WORDS * index;
            words[at..at + 2].copy_from_slice(&[first_word, first as u32]);
            if has_back(scene, instance) {
                at += 2;
                words[at..at + 2].copy_from_slice(&[first_word, corners.len() as u32]);
                for point in first..corners.len() {
                    let [of, corner] = corners[point];
                    corners.push([of, corner | BACK]);
                }
            }
            firsts.push(corners.len() as u32);
        }
        let rows = corners.len().max(1).next_multiple_of(WIDTH as usize);
        corners.resize(rows, [NO_INSTANCE, 0]);
        Self {
            words,
            corners,
            firsts,
        }
    }
}

impl Vertices {
    /// The vertices of `scene`, whose meshes are `host`'s.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, host: &Scene) -> Result<Self, GpuError> {
        let table = Table::new(host);
        let count = table.corners.len() as u32;
        let bytes = u64::from(count) * SURFACE_POINT_BYTES;
        let storage = wgpu::BufferUsages::STORAGE;
        let points = gpu.buffer("surface points of vertices [bytes]", bytes, storage)?;
        let corners = gpu.storage("corners of vertices [bytes]", &table.corners)?;
        let resolve = shader!("techniques.radiance_transfer.vertices.points");
        let resolve = Kernel::new(gpu, &resolve, "main", Some(&scene.layout))?;
        let bindings = [
            ("corners", corners.as_entire_binding()),
            ("points", points.as_entire_binding()),
        ];
        Ok(Self {
            lookup: gpu.storage("points of vertices [bytes]", &table.words)?,
            resolve: {
                let group = resolve.bind(gpu, 1, &bindings)?;
                (resolve, group)
            },
            points,
            count,
            firsts: table.firsts,
            meshes: scene.versions.meshes,
            captured: None,
        })
    }

    /// Whether these are the vertices of the scene.
    pub fn serves(&self, scene: &GpuScene) -> bool {
        self.meshes == scene.versions.meshes
    }

    /// The points of an instance.
    pub fn of_instance(&self, instance: usize) -> Range<u32> {
        self.firsts[instance]..self.firsts[instance + 1]
    }

    /// Captures the points again if geometry or materials have changed: pass `radiance-transfer.vertices`.
    pub fn record(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) {
        let now = Some([scene.versions.geometry, scene.versions.materials]);
        if self.captured == now {
            return;
        }
        self.captured = now;
        let (kernel, group) = &self.resolve;
        frame.compute("radiance-transfer.vertices", |pass| {
            let groups = [(0, &scene.bind_group), (1, group)];
            kernel.dispatch(pass, &groups, [self.count, 1, 1]);
        });
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        // A corner has eight bytes.
        self.points.size() + self.lookup.size() + u64::from(self.count) * 8
    }
}
