//! A scene on the GPU: bind group 0, and merged world-space triangles for captures.

mod casters;
mod emitters;
mod environment;
pub(crate) mod gpu;
mod images;
mod motion;
mod objects;
#[cfg(test)]
mod ray_tests;
mod rays;
mod rows;
#[cfg(test)]
mod tests;

use glam::Vec3;
use gpugi_scene::{
    AlphaMode, Bounds, Environment, Instance, Light, Scene, bvh::NODE_ROWS,
    provoking::provoking_order,
};

use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::shader;
pub use casters::{Casters, SimplifiedCasters};
pub use emitters::Emitter;
use emitters::emitters;
pub(crate) use environment::check_environment;
use environment::environment_texture;
use images::ImageArrays;
pub use motion::Placement;
use motion::{moved, same_meshes};
use objects::seen_class;
pub use objects::{Claims, Object};
use rays::{Rays, hierarchy_buffer};
use rows::{instance_row, material_row};

/// Surface points keep a material in 16 bits (capture/surface_point.wesl).
const MAX_MATERIALS: usize = 1 << 16;

/// How captures draw an instance; the order in which merged triangles lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DrawClass {
    /// Opaque, single-sided, a closed mesh: shadow maps may hold its back faces.
    Closed,
    /// Opaque, single-sided, open.
    Open,
    /// Opaque, double-sided.
    DoubleSided,
    /// With alpha or transmission, single-sided.
    Alpha,
    /// With alpha or transmission, double-sided.
    AlphaDoubleSided,
}

impl DrawClass {
    /// The class that draws the same from both sides.
    pub fn from_both_sides(self) -> Self {
        match self {
            Self::Closed | Self::Open | Self::DoubleSided => Self::DoubleSided,
            Self::Alpha | Self::AlphaDoubleSided => Self::AlphaDoubleSided,
        }
    }
}

/// One instance's share of the merged triangles.
#[derive(Debug, Clone)]
pub struct Draw {
    /// How depth maps draw it.
    pub class: DrawClass,
    /// How cameras draw it.
    pub seen: DrawClass,
    /// Number of the instance.
    pub instance: u32,
    /// Whether its mesh is closed: the back of its surface bounds its inside.
    pub is_closed: bool,
    /// Its indices in the merged index buffer.
    pub indices: std::ops::Range<u32>,
    /// World-space box.
    pub bounds: Bounds,
    /// Box of the mesh in its own space.
    pub mesh_bounds: Bounds,
}

/// Counters that grow when something changes: a map made at other counts is out of date.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Versions {
    /// Meshes and their places.
    pub geometry: u64,
    /// Materials.
    pub materials: u64,
    /// Lights, emitters and the environment.
    pub lights: u64,
    /// The environment's texels alone.
    pub environment: u64,
    /// Which triangles there are, wherever they move.
    pub topology: u64,
    /// Which instances there are, of which mesh and material, wherever they move and however they bend.
    pub instances: u64,
}

/// A scene on the GPU.
#[derive(Debug)]
pub struct GpuScene {
    /// Layout of bind group 0.
    pub layout: wgpu::BindGroupLayout,
    /// Bind group 0.
    pub bind_group: wgpu::BindGroup,
    /// Merged vertices: world position and instance.
    pub vertices: wgpu::Buffer,
    /// Merged indices.
    pub indices: wgpu::Buffer,
    /// What captures draw, in order of class.
    pub draws: Vec<Draw>,
    /// World-space box around everything.
    pub bounds: Bounds,
    /// Punctual lights.
    pub lights: Vec<Light>,
    /// Emissive triangles.
    pub emitters: Vec<Emitter>,
    /// The environment.
    pub environment: Option<Environment>,
    /// Whether any instance has a material with alpha.
    pub has_alpha: bool,
    /// What has changed how often.
    pub versions: Versions,
    /// Every instance, as techniques see it that light some and not others.
    pub objects: Vec<Object>,
    /// Where every instance is.
    pub placements: Vec<Placement>,
    /// Bytes of buffers and textures.
    pub bytes: u64,
    pub(crate) claims: Vec<Claims>,
    header: wgpu::Buffer,
    tables: wgpu::Buffer,
    alpha_modes: Vec<AlphaMode>,
    vertex_count: u32,
    merge: Kernel,
    merge_group: wgpu::BindGroup,
    merged_version: u64,
    rays: Option<Rays>,
    use_of: Use,
    host: Option<Scene>,
}

/// What a scene on the GPU is for: nothing else is uploaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Use {
    /// Captures draw merged triangles.
    Captures,
    /// Shaders trace rays.
    Rays,
    /// Both, and the host keeps meshes and instances, to lay out atlases of them.
    Texels,
}

/// Where a mesh lies in the geometry buffer, and what captures need of it.
struct PlacedMesh {
    first_vertex_word: u32,
    first_index_word: u32,
    vertex_count: u32,
    indices: Vec<u32>,
    closed: bool,
    bounds: Bounds,
}

impl PlacedMesh {
    /// The corners of its triangles, from the geometry buffer's words.
    fn triangles(&self, words: &[u32]) -> Vec<[Vec3; 3]> {
        let position = |&index: &u32| {
            let at = (self.first_vertex_word + index * VERTEX_WORDS) as usize;
            Vec3::from_array([0, 1, 2].map(|axis| f32::from_bits(words[at + axis])))
        };
        let corners = |triangle: &[u32; 3]| triangle.each_ref().map(position);
        self.indices.as_chunks().0.iter().map(corners).collect()
    }
}

/// Words of a vertex in the geometry buffer.
const VERTEX_WORDS: u32 = (std::mem::size_of::<gpu::Vertex>() / 4) as u32;

impl GpuScene {
    /// Uploads a scene to be rasterized.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] with the numbers when the adapter cannot hold it; [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::upload(gpu, scene, Use::Captures, None)
    }

    /// Uploads a scene in which rays are traced: shaders may use scene/bvh.wesl. Captures see nothing of it: merged triangles would take memory for
    /// every instance, hierarchies only for every mesh.
    ///
    /// # Errors
    /// As [`GpuScene::new`].
    pub fn with_rays(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::upload(gpu, scene, Use::Rays, None)
    }

    /// Uploads a scene whose light is kept in texels: captures draw it, rays are traced in it, and [`GpuScene::host`] has what atlases are laid out of.
    ///
    /// # Errors
    /// As [`GpuScene::new`].
    pub fn with_texels(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::upload(gpu, scene, Use::Texels, None)
    }

    /// Meshes and instances as they are now, without anything else, where light is kept in texels.
    pub fn host(&self) -> Option<&Scene> {
        self.host.as_ref()
    }

    /// Whether shaders may trace rays in it.
    pub fn has_rays(&self) -> bool {
        self.rays.is_some()
    }

    /// Whether captures see it.
    pub fn has_captures(&self) -> bool {
        self.use_of != Use::Rays
    }

    /// Pipeline constants of shaders that trace rays in this scene, for [`crate::gpu::KernelOptions`].
    pub fn ray_constants(&self) -> [(&'static str, f64); 1] {
        [("SCENE_HAS_ALPHA", f64::from(u8::from(self.has_alpha)))]
    }

    /// `kept`: hierarchies of the same meshes, maybe differently placed.
    fn upload(gpu: &Gpu, scene: &Scene, use_of: Use, kept: Option<Rays>) -> Result<Self, GpuError> {
        if scene.materials.len() > MAX_MATERIALS {
            return Err(GpuError::TooLarge {
                what: "materials of a scene".into(),
                needed: scene.materials.len() as u64,
                limit: MAX_MATERIALS as u64,
                adapter: gpu.adapter.name.clone(),
            });
        }
        let mut words: Vec<u32> = Vec::new();
        let meshes: Vec<PlacedMesh> = scene
            .meshes
            .iter()
            .map(|mesh| place_mesh(mesh, &mut words))
            .collect();
        let mut order: Vec<usize> = (0..scene.instances.len()).collect();
        order.sort_by_key(|&index| draw_class(scene, &meshes, &scene.instances[index]));

        let mut instances = vec![bytemuck::Zeroable::zeroed(); scene.instances.len()];
        let mut merged_indices: Vec<u32> = Vec::new();
        let mut draws = Vec::new();
        // Instances keep their numbers; vertices are merged in that order so that a vertex finds its instance by search.
        let mut vertex_count: u64 = 0;
        let mut index_count: u64 = 0;
        for (index, instance) in scene.instances.iter().enumerate() {
            let mesh = &meshes[instance.mesh];
            instances[index] = instance_row(instance, mesh, vertex_count as u32);
            if use_of != Use::Rays {
                vertex_count += u64::from(mesh.vertex_count);
                index_count += mesh.indices.len() as u64;
            }
        }
        if vertex_count > u64::from(u32::MAX / 2) {
            return Err(GpuError::TooLarge {
                what: "vertices of all instances".into(),
                needed: vertex_count,
                limit: u64::from(u32::MAX / 2),
                adapter: gpu.adapter.name.clone(),
            });
        }
        // Shaders read them, too.
        let limits = gpu.device.limits();
        let limit = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        if index_count * 4 > limit {
            return Err(GpuError::TooLarge {
                what: "merged indices [bytes]".into(),
                needed: index_count * 4,
                limit,
                adapter: gpu.adapter.name.clone(),
            });
        }
        if use_of == Use::Rays {
            order.clear();
        }
        for &index in &order {
            let instance = &scene.instances[index];
            let mesh = &meshes[instance.mesh];
            let row: &gpu::Instance = &instances[index];
            let first = merged_indices.len() as u32;
            for triangle in mesh.indices.chunks_exact(3) {
                // A mirroring transform turns the winding; the provoking vertex stays first.
                let [a, b, c] = if row.mirrored == 1 {
                    [triangle[0], triangle[2], triangle[1]]
                } else {
                    [triangle[0], triangle[1], triangle[2]]
                };
                merged_indices.extend([a, b, c].map(|vertex| vertex + row.first_merged_vertex));
            }
            let class = draw_class(scene, &meshes, instance);
            draws.push(Draw {
                class,
                seen: class,
                instance: index as u32,
                is_closed: mesh.closed,
                indices: first..merged_indices.len() as u32,
                bounds: mesh.bounds.transformed(&instance.world_from_mesh),
                mesh_bounds: mesh.bounds,
            });
        }

        let images = ImageArrays::new(gpu, scene)?;
        let mut textures = Vec::new();
        let materials: Vec<gpu::Material> = scene
            .materials
            .iter()
            .map(|material| material_row(scene, material, &images, &mut textures))
            .collect();
        let bounds = scene.bounds();
        let instance_rows = std::mem::size_of_val(&instances[..]) as u32 / 16;
        let material_rows = std::mem::size_of_val(&materials[..]) as u32 / 16;
        let environment = scene.environment.as_ref();
        let rotation = environment.map_or(0.0, |environment| environment.rotation);
        let rays = match kept {
            Some(rays) => Some(rays.moved(gpu, scene)?),
            None if use_of != Use::Captures => Some(Rays::new(gpu, scene, &meshes, &words)?),
            None => None,
        };
        let header = gpu::SceneHeader {
            instance_row: 0,
            material_row: instance_rows,
            texture_row: instance_rows + material_rows,
            instance_count: instances.len() as u32,
            environment_rotation: [rotation.cos(), rotation.sin()],
            environment_intensity: environment.map_or(0.0, |environment| environment.intensity),
            diagonal: bounds.diagonal(),
            bvh_start: rays.as_ref().map_or([0; 2], |rays| rays.start),
            padding_0: 0,
            padding_1: 0,
        };
        let mut tables: Vec<u8> = Vec::new();
        tables.extend(bytemuck::cast_slice::<gpu::Instance, u8>(&instances));
        tables.extend(bytemuck::cast_slice::<gpu::Material, u8>(&materials));
        tables.extend(bytemuck::cast_slice::<gpu::TextureReference, u8>(&textures));

        let header = gpu.uniform("scene header", &header)?;
        let geometry = gpu.storage("scene geometry [bytes]", &words)?;
        let tables = gpu.storage("scene tables [bytes]", &tables)?;
        let vertices = gpu.buffer(
            "merged vertices [bytes]",
            vertex_count * crate::gpu::RasterKernel::VERTEX_STRIDE,
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::VERTEX,
        )?;
        let indices = gpu.buffer_with(
            "merged indices [bytes]",
            &merged_indices,
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDEX,
        )?;
        let layout = crate::gpu::scene_layout(gpu, &shader!("scene.bindings"))?;
        let environment_view = environment_texture(gpu, environment)?;
        // Mesa's software rasterizer ignores explicit gradients where a sampler is anisotropic (seen in 22.3).
        let anisotropy_clamp = match gpu.adapter.device_type {
            wgpu::DeviceType::Cpu => 1,
            _ => 8,
        };
        let image_sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("material images"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp,
            ..Default::default()
        });
        let environment_sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("environment"),
            address_mode_u: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let mut entries = vec![
            header.as_entire_binding(),
            geometry.as_entire_binding(),
            tables.as_entire_binding(),
            wgpu::BindingResource::Sampler(&image_sampler),
            wgpu::BindingResource::Sampler(&environment_sampler),
            wgpu::BindingResource::TextureView(&environment_view),
        ];
        entries.extend(images.views.iter().map(wgpu::BindingResource::TextureView));
        let hierarchy = match &rays {
            Some(rays) => rays.buffer.clone(),
            None => hierarchy_buffer(gpu, NODE_ROWS as usize)?,
        };
        entries.push(hierarchy.as_entire_binding());
        let entries: Vec<_> = entries
            .into_iter()
            .enumerate()
            .map(|(binding, resource)| wgpu::BindGroupEntry {
                binding: binding as u32,
                resource,
            })
            .collect();
        let bind_group = gpu.scoped("scene", || {
            Ok(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scene"),
                layout: &layout,
                entries: &entries,
            }))
        })?;
        let merge = Kernel::new(gpu, &shader!("capture.merge"), "main", Some(&layout))?;
        let merge_group = merge.bind(gpu, 1, &[("merged", vertices.as_entire_binding())])?;
        let buffers = [&geometry, &tables, &vertices, &indices, &hierarchy];
        let bytes = buffers.map(wgpu::Buffer::size).iter().sum::<u64>() + images.bytes;
        Ok(Self {
            layout,
            bind_group,
            vertices,
            indices,
            draws,
            bounds,
            lights: scene.lights.clone(),
            emitters: emitters(scene),
            claims: vec![Claims::NONE; scene.instances.len()],
            objects: scene
                .instances
                .iter()
                .map(|instance| Object::new(scene, instance))
                .collect(),
            placements: motion::placements(scene),
            alpha_modes: scene
                .instances
                .iter()
                .map(|instance| scene.materials[instance.material].alpha_mode)
                .collect(),
            header,
            tables,
            environment: scene.environment.clone(),
            has_alpha: scene
                .instances
                .iter()
                .any(|instance| scene.materials[instance.material].alpha_mode != AlphaMode::Opaque),
            versions: Versions {
                geometry: 1,
                materials: 1,
                lights: 1,
                environment: 1,
                topology: 1,
                instances: 1,
            },
            bytes,
            vertex_count: vertex_count as u32,
            merge,
            merge_group,
            merged_version: 0,
            rays,
            use_of,
            host: (use_of == Use::Texels).then(|| Scene {
                meshes: scene.meshes.clone(),
                instances: scene.instances.clone(),
                ..Scene::new(&scene.name)
            }),
        })
    }

    /// Brings the merged world-space vertices up to date.
    pub fn merge(&mut self, frame: &mut Frame<'_>) {
        if self.merged_version == self.versions.geometry || self.vertex_count == 0 {
            return;
        }
        self.merged_version = self.versions.geometry;
        frame.compute("capture.merge", |pass| {
            self.merge.dispatch(
                pass,
                &[(0, &self.bind_group), (1, &self.merge_group)],
                [self.vertex_count, 1, 1],
            );
        });
    }

    /// Follows changes of the scene's instances, lights, materials, meshes and environment; counts what changed.
    ///
    /// # Errors
    /// As [`GpuScene::new`].
    pub fn update(&mut self, gpu: &Gpu, before: &Scene, after: &Scene) -> Result<(), GpuError> {
        let same_meshes = same_meshes(before, after);
        let meshes = before.meshes.len() != after.meshes.len() || same_meshes.contains(&false);
        let geometry = meshes || before.instances != after.instances;
        let materials = before.materials != after.materials
            || before.textures != after.textures
            || before.images != after.images;
        let lights = before.lights != after.lights || before.environment != after.environment;
        // A material decides how its instances are drawn, and so in which order.
        let mesh_and_material = |one: &Instance| (one.mesh, one.material);
        let [old, new] = [before, after].map(|one| one.instances.iter().map(mesh_and_material));
        let instances = materials || !old.eq(new);
        let topology = meshes || instances;
        let texels = before.environment.as_ref().map(|one| &one.image)
            != after.environment.as_ref().map(|one| &one.image);
        if !(geometry || materials || lights) {
            return Ok(());
        }
        let versions = self.versions;
        let environment = before.environment != after.environment;
        if geometry && !topology && !environment && self.move_instances(gpu, before, after) {
            self.lights = after.lights.clone();
        } else if geometry || materials || environment {
            let kept = self.rays.take().filter(|_| !meshes);
            let uploaded = Self::upload(gpu, after, self.use_of, kept)?;
            *self = Self {
                placements: std::mem::take(&mut self.placements),
                claims: std::mem::take(&mut self.claims),
                ..uploaded
            };
        } else {
            self.lights = after.lights.clone();
        }
        let grown = |count: u64, changed: bool| count + u64::from(changed);
        let version = grown(versions.geometry, geometry);
        if instances {
            self.placements.clear();
            self.claims = vec![Claims::NONE; after.instances.len()];
        }
        let placements = std::mem::take(&mut self.placements);
        self.placements = moved(placements, after, &same_meshes, version);
        // Emitters move with their instances.
        let is_emitting = |one: &Instance| after.materials[one.material].emissive != Vec3::ZERO;
        let mut placed = self.placements.iter().zip(&after.instances);
        let emitters = geometry && placed.any(|(at, one)| at.moved == version && is_emitting(one));
        self.versions = Versions {
            geometry: version,
            materials: grown(versions.materials, materials),
            lights: grown(versions.lights, lights || instances || emitters),
            environment: grown(versions.environment, texels),
            topology: grown(versions.topology, topology),
            instances: grown(versions.instances, instances),
        };
        Ok(())
    }

    /// How a draw's surface is drawn by whoever follows the light that passes through it: whole, from both sides.
    pub fn whole_class(&self, draw: &Draw) -> DrawClass {
        let index = draw.instance as usize;
        let is_transmissive = self.objects[index].is_transmissive;
        seen_class(
            draw.class,
            self.alpha_modes[index],
            is_transmissive,
            Claims::TRANSMISSION,
        )
    }

    /// Hands each instance to the techniques that claim it: `claims` has one entry an object.
    pub fn assign(&mut self, gpu: &Gpu, claims: &[Claims]) {
        for draw in &mut self.draws {
            let index = draw.instance as usize;
            let object = &self.objects[index];
            let of_object = claims[index];
            if self.claims[index] != of_object {
                // Shadow maps and cubes hold what was seen through other surfaces.
                self.claims[index] = of_object;
                self.versions.materials += 1;
            }
            draw.seen = seen_class(
                draw.class,
                self.alpha_modes[index],
                object.is_transmissive,
                of_object,
            );
            let row = index * size_of::<gpu::Instance>();
            let at = (row + std::mem::offset_of!(gpu::Instance, claims)) as u64;
            let word = of_object.0.to_le_bytes();
            gpu.queue.write_buffer(&self.tables, at, &word);
        }
    }

    /// Makes every map out of date, as if everything had changed.
    pub fn invalidate(&mut self) {
        self.invalidate_geometry();
        self.versions.materials += 1;
        self.versions.lights += 1;
        self.versions.environment += 1;
        self.versions.topology += 1;
        self.versions.instances += 1;
    }

    /// As if every instance had moved.
    pub fn invalidate_geometry(&mut self) {
        self.versions.geometry += 1;
        for placement in &mut self.placements {
            placement.moved = self.versions.geometry;
        }
    }

    /// Length of the scene's diagonal (m), positive even for an empty scene.
    pub fn diagonal(&self) -> f32 {
        self.bounds.diagonal().max(1e-6)
    }
}

fn place_mesh(mesh: &gpugi_scene::Mesh, words: &mut Vec<u32>) -> PlacedMesh {
    let ordered = provoking_order(&mesh.indices, mesh.positions.len());
    let first_vertex_word = words.len() as u32;
    let unorm = |value: f32| (value.clamp(0.0, 1.0) * 65535.0).round() as u32;
    for &source in &ordered.vertices {
        let source = source as usize;
        let uv = |set: usize| {
            mesh.uvs[set]
                .get(source)
                .map_or([0.0; 2], |uv| uv.to_array())
        };
        let color = mesh.colors.get(source).copied().unwrap_or(glam::Vec4::ONE);
        // The lowest bit holds the sign of the bitangent.
        let tangent = mesh.tangents.get(source).map_or(0, |tangent| {
            gpu::octahedral(tangent.truncate()) & !1 | u32::from(tangent.w < 0.0)
        });
        let vertex = gpu::Vertex {
            position: mesh.positions[source].to_array(),
            normal: gpu::octahedral(mesh.normals[source]),
            tangent,
            uv_0: uv(0),
            uv_1: uv(1),
            color: [
                unorm(color.x) | unorm(color.y) << 16,
                unorm(color.z) | unorm(color.w) << 16,
            ],
            padding: 0,
        };
        words.extend_from_slice(bytemuck::cast_slice(std::slice::from_ref(&vertex)));
    }
    let first_index_word = words.len() as u32;
    words.extend_from_slice(&ordered.indices);
    PlacedMesh {
        first_vertex_word,
        first_index_word,
        vertex_count: ordered.vertices.len() as u32,
        indices: ordered.indices,
        closed: mesh.is_closed(),
        bounds: mesh.bounds(),
    }
}

fn draw_class(scene: &Scene, meshes: &[PlacedMesh], instance: &Instance) -> DrawClass {
    let material = &scene.materials[instance.material];
    let see_through = material.alpha_mode != AlphaMode::Opaque || material.transmission > 0.0;
    match (see_through, material.double_sided) {
        (true, true) => DrawClass::AlphaDoubleSided,
        (true, false) => DrawClass::Alpha,
        (false, true) => DrawClass::DoubleSided,
        (false, false) if meshes[instance.mesh].closed => DrawClass::Closed,
        (false, false) => DrawClass::Open,
    }
}
