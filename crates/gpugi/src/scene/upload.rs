//! Uploads a scene to the GPU: geometry in provoking-vertex order, merged indices sorted by class, tables, images,
//! hierarchies.

use std::sync::Arc;

use glam::Quat;
use gpugi_scene::bvh::NODE_ROWS;
use gpugi_scene::{AlphaMode, Environment, Instance, Material, Scene, core_of};

use super::atlases::Atlases;
use super::bounds_tree::BoundsTree;
use super::emitters::emitters;
use super::environment::{check_environment, environment_texels};
use super::extent::MOST_BOXES;
use super::geometry::{Geometry, PlacedMesh};
use super::images::{ImageArrays, images_used};
use super::media::check_media;
use super::rays::{Rays, hierarchy_buffer};
use super::rows::{checked_spheres, instance_row, mesh_bounds};
use super::tables::Tables;
use super::{Draw, DrawClass, GpuScene, Object, Use, Versions, gpu, motion};
use crate::gpu::{Gpu, GpuError, Kernel};
use crate::shader;

/// Surface points store a material in 16 bits (capture/surface_point.wesl).
const MAX_MATERIALS: usize = 1 << 16;

impl GpuScene {
    /// Uploads a scene, but what it shares with `before`: meshes, images and the environment.
    pub(super) fn upload(
        gpu: &Gpu,
        scene: &Scene,
        use_of: Use,
        before: Option<&Self>,
    ) -> Result<Self, GpuError> {
        check_environment(scene.environment.as_ref())?;
        check_media(&scene.media)?;
        let spheres = checked_spheres(scene)?;
        if scene.materials.len() > MAX_MATERIALS {
            return Err(GpuError::TooLarge {
                what: "materials of a scene".into(),
                needed: scene.materials.len() as u64,
                limit: MAX_MATERIALS as u64,
                adapter: gpu.adapter.name.clone(),
            });
        }
        let same_meshes = before.filter(|before| are_same(&before.host.meshes, &scene.meshes));
        let geometry = match same_meshes {
            Some(before) => before.geometry.clone(),
            None => Arc::new(Geometry::new(gpu, &scene.meshes)?),
        };
        let meshes = &geometry.meshes[..];
        let mut order: Vec<usize> = (0..scene.instances.len()).collect();
        order.sort_by_key(|&index| draw_class(scene, meshes, &scene.instances[index]));

        let mut instances = vec![bytemuck::Zeroable::zeroed(); scene.instances.len()];
        let mut merged_indices: Vec<u32> = Vec::new();
        let mut draws = Vec::new();
        let mut draw_of = vec![0; scene.instances.len()];
        // Instances keep their indices. Vertices are merged in that order, so that a vertex finds its instance by
        // binary search.
        let mut vertex_count: u64 = 0;
        let mut index_count: u64 = 0;
        for (index, instance) in scene.instances.iter().enumerate() {
            let mesh = &meshes[instance.mesh];
            instances[index] = instance_row(instance, mesh, spheres[index], vertex_count as u32);
            if use_of != Use::Rays {
                vertex_count += u64::from(mesh.vertex_count());
                index_count += mesh.order.indices.len() as u64;
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
            for triangle in mesh.order.indices.chunks_exact(3) {
                // A mirroring transform flips the winding; the provoking vertex stays first.
                let [a, b, c] = if row.mirrored == 1 {
                    [triangle[0], triangle[2], triangle[1]]
                } else {
                    [triangle[0], triangle[1], triangle[2]]
                };
                merged_indices.extend([a, b, c].map(|vertex| vertex + row.first_merged_vertex));
            }
            let class = draw_class(scene, meshes, instance);
            draw_of[index] = draws.len() as u32;
            draws.push(Draw {
                class,
                seen: class,
                instance: index as u32,
                is_closed: mesh.closed,
                indices: first..merged_indices.len() as u32,
                bounds: mesh_bounds(row, mesh).transformed(&instance.world_from_mesh),
                mesh_bounds: mesh_bounds(row, mesh),
            });
        }

        let images = match before.filter(|before| has_same_images(&before.host, scene)) {
            Some(before) => before.images.clone(),
            None => ImageArrays::new(gpu, scene)?,
        };
        let world_bounds = scene
            .instances
            .iter()
            .zip(&instances)
            .map(|(instance, row)| {
                let bounds = mesh_bounds(row, &meshes[instance.mesh]);
                bounds.transformed(&instance.world_from_mesh)
            });
        let bounds_tree = BoundsTree::new(world_bounds);
        let bounds = bounds_tree.all();
        let core = core_of(&bounds_tree.at_most(MOST_BOXES), bounds);
        let tables = Tables::new(gpu, scene, instances, &images, (&scene.media, &bounds))?;
        let rays = match same_meshes.and_then(|before| before.rays.as_ref()) {
            Some(rays) => Some(rays.with_instances(gpu, scene)?),
            None if use_of != Use::Captures => {
                let before = before.and_then(|before| before.rays.as_ref());
                Some(Rays::new(gpu, scene, &geometry, before)?)
            }
            None => None,
        };
        let environment = scene.environment.as_ref();
        let had = before.and_then(|before| before.environment.as_ref());
        let texels = match before {
            Some(before) if is_same_image(had, environment) => before.environment_texels.clone(),
            _ => environment_texels(gpu, environment)?,
        };
        let header_values = gpu::SceneHeader::new(scene, &tables, &bounds_tree, rays.as_ref())
            .with_environment(environment, texels.scale);
        let header = gpu.uniform("scene header", &header_values)?;
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
        let bindings = match before {
            Some(before) => before.bindings.clone(),
            None => Bindings::new(gpu)?,
        };
        let hierarchy = match &rays {
            Some(rays) => rays.buffer.clone(),
            None => hierarchy_buffer(gpu, NODE_ROWS as usize)?,
        };
        let buffers = [&header, &geometry.buffer, &tables.buffer, &hierarchy];
        let [bind_group, ray_bind_group] = bindings.bind(gpu, buffers, &texels.view, &images);
        let merge_group =
            bindings
                .merge
                .bind(gpu, 1, &[("merged", vertices.as_entire_binding())])?;
        let buffers = [
            &geometry.buffer,
            &tables.buffer,
            &vertices,
            &indices,
            &hierarchy,
        ];
        let bytes = buffers.map(wgpu::Buffer::size).iter().sum::<u64>() + images.bytes;
        Ok(Self {
            layout: bindings.layout.clone(),
            bind_group,
            ray_layout: bindings.ray_layout.clone(),
            ray_bind_group,
            vertices,
            indices,
            draws,
            bounds,
            core,
            lights: scene.lights.clone(),
            emitters: emitters(scene),
            objects: scene
                .instances
                .iter()
                .map(|instance| Object::new(instance, &scene.materials[instance.material]))
                .collect(),
            placements: motion::placements(scene),
            alpha_modes: scene
                .instances
                .iter()
                .map(|instance| scene.materials[instance.material].alpha_mode)
                .collect(),
            header,
            header_values,
            tables,
            geometry,
            images,
            environment_texels: texels,
            hierarchy,
            bindings,
            draw_of,
            bounds_tree,
            environment: scene.environment.clone(),
            media: scene.media.clone(),
            has_spheres: scene.instances.iter().any(|instance| instance.is_sphere),
            has_alpha: scene
                .instances
                .iter()
                .any(|instance| scene.materials[instance.material].alpha_mode != AlphaMode::Opaque),
            versions: Versions {
                geometry: 1,
                materials: 1,
                lights: 1,
                sky: 1,
                environment: 1,
                media: 1,
                objects: 1,
                topology: 1,
                meshes: 1,
                instances: 1,
            },
            bytes,
            vertex_count: vertex_count as u32,
            merge_group,
            merged_version: 0,
            before: None,
            rays,
            use_of,
            has_irradiance: before.is_some_and(|before| before.has_irradiance),
            atlases: Atlases::default(),
            host: Scene {
                meshes: scene.meshes.clone(),
                instances: scene.instances.clone(),
                materials: scene.materials.clone(),
                textures: scene.textures.clone(),
                images: scene.images.clone(),
                transfer: scene.transfer.clone(),
                panes: scene.panes.clone(),
                ..Scene::new(&scene.name)
            },
        })
    }
}

/// What bind group 0 of any scene is made with.
#[derive(Debug, Clone)]
pub(super) struct Bindings {
    pub layout: wgpu::BindGroupLayout,
    pub ray_layout: wgpu::BindGroupLayout,
    image_sampler: wgpu::Sampler,
    environment_sampler: wgpu::Sampler,
    pub merge: Kernel,
}

impl Bindings {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shaders = [shader!("scene.bindings"), shader!("scene.ray_bindings")];
        let layout = crate::gpu::scene_layout(gpu, &shaders[..1])?;
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
        Ok(Self {
            image_sampler,
            environment_sampler,
            merge: Kernel::new(gpu, &shader!("capture.merge"), "main", Some(&layout))?,
            layout,
            ray_layout: crate::gpu::scene_layout(gpu, &shaders)?,
        })
    }

    /// Bind group 0, without rays and with them. `buffers`: header, geometry, tables and ray hierarchy.
    pub fn bind(
        &self,
        gpu: &Gpu,
        buffers: [&wgpu::Buffer; 4],
        environment: &wgpu::TextureView,
        images: &ImageArrays,
    ) -> [wgpu::BindGroup; 2] {
        let [header, geometry, tables, hierarchy] = buffers;
        let mut resources = vec![
            header.as_entire_binding(),
            geometry.as_entire_binding(),
            tables.as_entire_binding(),
            wgpu::BindingResource::Sampler(&self.image_sampler),
            wgpu::BindingResource::Sampler(&self.environment_sampler),
            wgpu::BindingResource::TextureView(environment),
        ];
        resources.extend(images.views.iter().map(wgpu::BindingResource::TextureView));
        resources.push(hierarchy.as_entire_binding());
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let (_, without_rays) = entries.split_last().expect("not empty");
        [
            (&self.layout, without_rays),
            (&self.ray_layout, &entries[..]),
        ]
        .map(|(layout, entries)| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scene"),
                layout,
                entries,
            })
        })
    }
}

impl gpu::SceneHeader {
    fn new(scene: &Scene, tables: &Tables, bounds: &BoundsTree, rays: Option<&Rays>) -> Self {
        let [instance_row, material_row, texture_row, medium_row] = tables.rows();
        Self {
            instance_row,
            material_row,
            texture_row,
            instance_count: scene.instances.len() as u32,
            diagonal: bounds.all().diagonal(),
            longest: bounds.longest(),
            bvh_start: rays.map_or([0; 2], Rays::start),
            medium_row,
            medium_count: scene.media.len() as u32,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// The same with another environment, whose texels are in units of `scale`.
    pub(super) fn with_environment(self, environment: Option<&Environment>, scale: f32) -> Self {
        let rotation = environment.map_or(Quat::IDENTITY, |environment| environment.rotation);
        Self {
            environment_rotation: rotation.to_array(),
            environment_intensity: environment
                .map_or(0.0, |environment| environment.intensity * scale),
            ..self
        }
    }
}

/// Whether both lists share all that is in them.
pub(super) fn are_same<T>(before: &[Arc<T>], after: &[Arc<T>]) -> bool {
    before.len() == after.len() && before.iter().zip(after).all(|(a, b)| Arc::ptr_eq(a, b))
}

/// Whether materials read the same images, as the same kind of data.
fn has_same_images(before: &Scene, after: &Scene) -> bool {
    [0, 1].into_iter().all(|space| {
        let used = images_used(after, space);
        let mut images = used.iter();
        images_used(before, space) == used
            && images.all(|&image| Arc::ptr_eq(&before.images[image], &after.images[image]))
    })
}

/// Whether both environments share their image, or there is none.
pub(super) fn is_same_image(before: Option<&Environment>, after: Option<&Environment>) -> bool {
    match (before, after) {
        (Some(before), Some(after)) => Arc::ptr_eq(&before.image, &after.image),
        (before, after) => before.is_none() && after.is_none(),
    }
}

/// Whether light passes straight through the surface.
pub(super) fn is_see_through(material: &Material) -> bool {
    material.alpha_mode != AlphaMode::Opaque || material.transmission > 0.0
}

fn draw_class(scene: &Scene, meshes: &[PlacedMesh], instance: &Instance) -> DrawClass {
    let material = &scene.materials[instance.material];
    match (is_see_through(material), material.has_two_sides()) {
        (true, true) => DrawClass::AlphaDoubleSided,
        (true, false) => DrawClass::Alpha,
        (false, true) => DrawClass::DoubleSided,
        (false, false) if meshes[instance.mesh].closed => DrawClass::Closed,
        (false, false) => DrawClass::Open,
    }
}
