//! Uploads a scene to the GPU: geometry in provoking-vertex order, merged indices sorted by class, tables, images,
//! hierarchies.

use glam::Vec3;
use gpugi_scene::{AlphaMode, Bounds, Instance, Scene, bvh::NODE_ROWS, provoking::provoking_order};

use super::atlases::Atlases;
use super::emitters::emitters;
use super::environment::{check_environment, environment_texture};
use super::images::ImageArrays;
use super::rays::{Rays, hierarchy_buffer};
use super::rows::{instance_row, material_row};
use super::{Claims, Draw, DrawClass, GpuScene, Object, Use, Versions, gpu, motion};
use crate::gpu::{Gpu, GpuError, Kernel};
use crate::shader;

/// Surface points store a material in 16 bits (capture/surface_point.wesl).
const MAX_MATERIALS: usize = 1 << 16;

/// Where a mesh lies in the geometry buffer, and what captures need to know about it.
pub(super) struct PlacedMesh {
    pub first_vertex_word: u32,
    pub first_index_word: u32,
    pub vertex_count: u32,
    pub indices: Vec<u32>,
    pub closed: bool,
    pub bounds: Bounds,
}

impl PlacedMesh {
    /// The corners of the mesh's triangles, from the geometry buffer's words.
    pub fn triangles(&self, words: &[u32]) -> Vec<[Vec3; 3]> {
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
    /// `kept`: hierarchies of the same meshes, whose instances may have moved.
    pub(super) fn upload(
        gpu: &Gpu,
        scene: &Scene,
        use_of: Use,
        kept: Option<Rays>,
    ) -> Result<Self, GpuError> {
        check_environment(scene.environment.as_ref())?;
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
        // Instances keep their indices. Vertices are merged in that order, so that a vertex finds its instance by
        // binary search.
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
        // Shaders also read the indices, so the limit of storage bindings applies.
        let limits = gpu.limits();
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
                // A mirroring transform flips the winding; the provoking vertex stays first.
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
        // Mesa's software rasterizer ignores explicit gradients if the sampler is anisotropic (seen in 22.3).
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
        let bind_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &layout,
            entries: &entries,
        });
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
                meshes: 1,
                instances: 1,
            },
            bytes,
            vertex_count: vertex_count as u32,
            merge,
            merge_group,
            merged_version: 0,
            rays,
            use_of,
            atlases: Atlases::default(),
            host: (use_of == Use::Texels).then(|| Scene {
                meshes: scene.meshes.clone(),
                instances: scene.instances.clone(),
                ..Scene::new(&scene.name)
            }),
        })
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
        // The lowest bit holds the bitangent's sign.
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
