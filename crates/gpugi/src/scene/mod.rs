//! A scene on the GPU: bind group 0, and merged world-space triangles for captures.

#[cfg(test)]
mod atlas_tests;
mod atlases;
mod bounds_tree;
mod casters;
mod edit;
#[cfg(test)]
mod edit_tests;
mod emitters;
mod environment;
mod extent;
mod geometry;
pub(crate) mod gpu;
mod images;
mod media;
mod motion;
mod objects;
#[cfg(test)]
mod ray_tests;
mod rays;
mod refit;
#[cfg(test)]
mod refit_tests;
mod rows;
mod tables;
#[cfg(test)]
mod tests;
mod upload;
mod versions;

use std::sync::Arc;

use gpugi_scene::{AlphaMode, Bounds, Environment, Light, LightKind, Medium, Scene};

use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Shader};
use crate::light_paths::LightClass;
use atlases::Atlases;
pub use atlases::LayOut;
use bounds_tree::BoundsTree;
pub use casters::{CasterGeometry, Casters, SimplifiedCasters};
pub(crate) use edit::Undo;
pub use emitters::Emitter;
pub(crate) use emitters::has_emitters;
use environment::EnvironmentTexels;
pub(crate) use environment::{check_environment, shown, texel_scale};
pub(crate) use extent::{box_faces, clip};
use geometry::Geometry;
pub use gpugi_scene::Edit;
use images::ImageArrays;
pub(crate) use media::{check_media, emit_light, stand_apart, world_from_box};
pub use motion::Placement;
use objects::seen_class;
pub use objects::{Claims, Object};
pub(crate) use objects::{DELTA_ROUGHNESS, has_glossy_objects, has_smooth_objects};
use rays::Rays;
use tables::Tables;
use upload::Bindings;
pub use versions::{Inputs, Versions};

/// How captures draw an instance. Merged triangles are sorted in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DrawClass {
    /// Opaque, single-sided, closed mesh: shadow maps may hold its back faces.
    Closed,
    /// Opaque, single-sided, open mesh.
    Open,
    /// Opaque, double-sided.
    DoubleSided,
    /// With alpha or transmission, single-sided.
    Alpha,
    /// With alpha or transmission, double-sided.
    AlphaDoubleSided,
}

impl DrawClass {
    /// The corresponding class that is drawn from both sides.
    pub fn from_both_sides(self) -> Self {
        match self {
            Self::Closed | Self::Open | Self::DoubleSided => Self::DoubleSided,
            Self::Alpha | Self::AlphaDoubleSided => Self::AlphaDoubleSided,
        }
    }
}

/// One instance's part of the merged triangles.
#[derive(Debug, Clone)]
pub struct Draw {
    /// How depth maps draw the instance.
    pub class: DrawClass,
    /// How cameras draw the instance.
    pub seen: DrawClass,
    /// Index of the instance.
    pub instance: u32,
    /// Whether the mesh is closed: the back of its surface bounds its inside.
    pub is_closed: bool,
    /// The instance's indices in the merged index buffer.
    pub indices: std::ops::Range<u32>,
    /// World-space bounding box.
    pub bounds: Bounds,
    /// Bounding box of the mesh in mesh space.
    pub mesh_bounds: Bounds,
}

/// Names and values of [`GpuScene::ray_constants`].
pub type RayConstants = [(&'static str, f64); 2];

/// In place of the version of the merged vertices: they are to be merged again.
const NOT_MERGED: u64 = u64::MAX;

/// A scene on the GPU.
#[derive(Debug)]
pub struct GpuScene {
    /// Layout of bind group 0.
    pub layout: wgpu::BindGroupLayout,
    /// Bind group 0.
    pub bind_group: wgpu::BindGroup,
    /// Layout of bind group 0 for shaders that trace rays.
    pub ray_layout: wgpu::BindGroupLayout,
    /// Bind group 0 for shaders that trace rays.
    pub ray_bind_group: wgpu::BindGroup,
    /// Merged vertices: world position and instance.
    pub vertices: wgpu::Buffer,
    /// Merged indices.
    pub indices: wgpu::Buffer,
    /// What captures draw, sorted by class.
    pub draws: Vec<Draw>,
    /// World-space bounding box of the scene.
    pub bounds: Bounds,
    /// World-space bounding box of all but what is far larger than the rest or far away.
    pub core: Bounds,
    /// Punctual lights.
    pub lights: Vec<Light>,
    /// Emissive triangles.
    pub emitters: Vec<Emitter>,
    /// The environment.
    pub environment: Option<Environment>,
    /// Fog, smoke and clouds, checked.
    pub media: Vec<Medium>,
    /// Whether any instance has a material with alpha.
    pub has_alpha: bool,
    /// Whether any instance is a sphere.
    pub has_spheres: bool,
    /// Counts of changes.
    pub versions: Versions,
    /// Every instance as an object, for techniques that light only some of them.
    pub objects: Vec<Object>,
    /// Where every instance is.
    pub placements: Vec<Placement>,
    /// Bytes of buffers and textures.
    pub bytes: u64,
    header: wgpu::Buffer,
    header_values: gpu::SceneHeader,
    tables: Tables,
    geometry: Arc<Geometry>,
    images: ImageArrays,
    environment_texels: EnvironmentTexels,
    hierarchy: wgpu::Buffer,
    bindings: Bindings,
    /// By instance, its entry of `draws`.
    draw_of: Vec<u32>,
    /// World-space boxes by instance.
    bounds_tree: BoundsTree,
    alpha_modes: Vec<AlphaMode>,
    vertex_count: u32,
    merge_group: wgpu::BindGroup,
    merged_version: u64,
    /// The merged vertices before the last change, and [`Versions::geometry`] of them; if they are kept.
    before: Option<(wgpu::Buffer, u64)>,
    rays: Option<Rays>,
    use_of: Use,
    /// Whether techniques take irradiance at points of their own: gathers compile for these in advance.
    pub(crate) has_irradiance: bool,
    /// The scene without lights, cameras, environment and what moves it.
    host: Scene,
    atlases: Atlases,
}

/// What a scene on the GPU is used for: nothing else is uploaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Use {
    /// Captures draw merged triangles.
    Captures,
    /// Shaders trace rays.
    Rays,
    /// Both. The host also keeps meshes and instances, to lay out atlases of them.
    Texels,
}

impl GpuScene {
    /// Uploads a scene for rasterization.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] with the numbers when the adapter cannot hold it; [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::upload(gpu, scene, Use::Captures, None)
    }

    /// Uploads a scene for ray tracing: shaders may use scene/bvh.wesl. Captures cannot draw it, because merged
    /// triangles would take memory per instance; hierarchies take memory only per mesh.
    ///
    /// # Errors
    /// As [`GpuScene::new`].
    pub fn with_rays(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::upload(gpu, scene, Use::Rays, None)
    }

    /// Uploads a scene whose light is kept in texels: captures draw it, shaders trace rays in it, and
    /// [`GpuScene::host`] holds what atlases are laid out from.
    ///
    /// # Errors
    /// As [`GpuScene::new`].
    pub fn with_texels(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::upload(gpu, scene, Use::Texels, None)
    }

    /// The current meshes, instances and materials, if light is kept in texels.
    pub fn host(&self) -> Option<&Scene> {
        (self.use_of == Use::Texels).then_some(&self.host)
    }

    /// The current meshes, instances, materials and images, whatever the scene is used for.
    pub(crate) fn kept(&self) -> &Scene {
        &self.host
    }

    /// Classes of light that the scene has.
    pub fn light_classes(&self) -> Vec<LightClass> {
        let is_present = |class: &LightClass| match class {
            LightClass::Punctual => !self.lights.is_empty(),
            LightClass::Area => !self.emitters.is_empty() || emit_light(&self.media),
            LightClass::Environment => self.environment.is_some(),
        };
        LightClass::ALL.into_iter().filter(is_present).collect()
    }

    /// Whether shaders may trace rays in the scene.
    pub fn has_rays(&self) -> bool {
        self.rays.is_some()
    }

    /// # Errors
    /// [`GpuError::Pass`] if shaders may not trace rays, which `setting` of a technique asks for.
    pub(crate) fn check_rays(&self, technique: &str, setting: &str) -> Result<(), GpuError> {
        if self.has_rays() {
            return Ok(());
        }
        Err(GpuError::Pass {
            pass: technique.into(),
            reason: format!(
                "{setting} needs a technique beside it for which scenes are uploaded with rays, such as radiosity or \
                 ray-tracing; in the library, GpuScene::with_texels"
            ),
        })
    }

    /// # Errors
    /// [`GpuError::Pass`] if shaders may not trace rays, which a technique always does.
    pub(crate) fn expect_rays(&self, technique: &str) -> Result<(), GpuError> {
        if self.has_rays() {
            return Ok(());
        }
        Err(GpuError::Pass {
            pass: technique.into(),
            reason: "the scene was uploaded without rays: use GpuScene::with_texels".into(),
        })
    }

    /// Where the ray hierarchy holds the triangles and spheres of all instances ([`gpugi_scene::bvh::BottomLevel::runs`]); `None`
    /// without rays. Changes with [`Versions::geometry`] and [`Versions::instances`].
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub(crate) fn triangle_runs(&self, gpu: &Gpu) -> Result<Option<Vec<[u32; 4]>>, GpuError> {
        let rays = self.rays.as_ref();
        rays.map(|rays| rays.runs(gpu, &self.host)).transpose()
    }

    /// Whether a mesh is closed, and its bounding box in its own space.
    pub(crate) fn shape_of_mesh(&self, index: usize) -> (bool, Bounds) {
        let mesh = &self.geometry.meshes[index];
        (mesh.closed, mesh.bounds)
    }

    /// Whether captures can draw the scene.
    pub fn has_captures(&self) -> bool {
        self.use_of != Use::Rays
    }

    /// Pipeline constants of shaders that trace rays in this scene, for [`crate::gpu::KernelOptions`].
    pub fn ray_constants(&self) -> RayConstants {
        [
            ("SCENE_HAS_ALPHA", f64::from(u8::from(self.has_alpha))),
            ("SCENE_HAS_SPHERES", f64::from(u8::from(self.has_spheres))),
        ]
    }

    /// A kernel of a shader that traces rays in this scene, with `more` pipeline constants.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub(crate) fn ray_kernel(
        &self,
        gpu: &Gpu,
        shader: &Shader,
        more: &[(&str, f64)],
    ) -> Result<Kernel, GpuError> {
        let options = KernelOptions {
            constants: &[&self.ray_constants(), more].concat(),
            ..Default::default()
        };
        Kernel::with_options(gpu, shader, "main", Some(&self.ray_layout), &options)
    }

    /// Pipeline constant of shaders that look up the transmittance of media (scene/media.wesl).
    pub(crate) fn media_constant(&self) -> (&'static str, f64) {
        ("HAS_MEDIA", f64::from(u8::from(!self.media.is_empty())))
    }

    /// Pipeline constants of shaders that draw random paths through media (scene/media_tracking.wesl).
    pub(crate) fn tracking_constants(&self) -> [(&'static str, f64); 2] {
        let has_uneven = !self.media.iter().all(media::is_even);
        [
            self.media_constant(),
            ("HAS_UNEVEN_MEDIA", f64::from(u8::from(has_uneven))),
        ]
    }

    /// Whether paths look in media for lights near them (paths/in_scattering.wesl): there are points or spots, and what counts
    /// as near is not so little of the media that looking there would cost more than its noise.
    pub(crate) fn has_lit_media(&self) -> bool {
        /// Of the extent of all media. In `fog-room`, 0.8 of it is near, and looking there takes away most of the noise. In
        /// `station`, whose smoke is dense, it is 0.003: the same noise in 1.3 times the time.
        const LEAST_NEAR: f32 = 0.01;
        let is_near = |light: &Light| light.kind != LightKind::Directional;
        let extent = self.extent_of_media();
        let reaches_far = !extent.is_finite() || self.near_in_media() >= LEAST_NEAR * extent;
        !self.media.is_empty() && reaches_far && self.lights.iter().any(is_near)
    }

    /// Distance of lights and of the eye up to which paths look for them in media, because points where media scatter by
    /// chance would find them with much noise (m): the mean free path of light where all media are as dense as anywhere,
    /// but no more than the extent of the scene and its media.
    pub(crate) fn near_in_media(&self) -> f32 {
        let media = self.media.iter().zip(&self.tables.densest);
        let extinctions = media.map(|(medium, densest)| medium.extinction.max_element() * densest);
        let free_path = (1.0 / extinctions.sum::<f32>()).min(1e15);
        let boxes = self.media.iter().filter_map(Medium::bounds);
        let extent = boxes.fold(self.bounds, Bounds::union).diagonal();
        match extent > 0.0 && extent.is_finite() {
            true => free_path.min(extent),
            false => free_path,
        }
    }

    /// Diagonal of the bounds of all media (m). One without a box fills the scene's bounds.
    fn extent_of_media(&self) -> f32 {
        let boxes = self.media.iter();
        let boxes = boxes.map(|medium| medium.bounds().unwrap_or(self.bounds));
        boxes
            .reduce(Bounds::union)
            .map_or(0.0, |all| all.diagonal())
    }

    /// For what shaders that trace rays are compiled: whether light passes through any surface, where alpha cuts it out
    /// and by transmission, and whether any instance is a sphere.
    pub fn ray_features(&self) -> [bool; 3] {
        let mut objects = self.objects.iter();
        let transmits = objects.any(|object| object.is_transmissive);
        [self.has_alpha, transmits, self.has_spheres]
    }

    /// Whether light passes any surface without being scattered.
    pub(crate) fn has_clear_objects(&self) -> bool {
        let mut objects = self.objects.iter();
        objects.any(|object| object.is_smooth && object.is_transmissive)
    }

    /// Lobes of the surfaces, as far as the factors of materials tell, and V if there are media: some of `DGSV`.
    pub fn lobes(&self) -> String {
        let materials = self.host.instances.iter().map(|instance| instance.material);
        let mut has = [false; 3];
        for material in materials {
            let lobes = objects::lobes(&self.host.materials[material]);
            has = [0, 1, 2].map(|lobe| has[lobe] || lobes[lobe]);
        }
        let lobes = "DGS".chars().zip(has);
        let media = (!self.media.is_empty()).then_some('V');
        lobes
            .filter_map(|(lobe, has)| has.then_some(lobe))
            .chain(media)
            .collect()
    }

    /// Whether any surface reflects or transmits light other than diffusely.
    pub fn has_gloss(&self) -> bool {
        self.objects.iter().any(|object| !object.is_diffuse)
    }

    /// Updates the merged world-space vertices.
    pub fn merge(&mut self, frame: &mut Frame<'_>) {
        if self.merged_version == self.versions.geometry || self.vertex_count == 0 {
            return;
        }
        if let Some((before, version)) = &mut self.before {
            frame.copy(&self.vertices, before, [0, before.size()]);
            *version = self.merged_version;
        }
        self.merged_version = self.versions.geometry;
        frame.compute("capture.merge", |pass| {
            self.bindings.merge.dispatch(
                pass,
                &[(0, &self.bind_group), (1, &self.merge_group)],
                [self.vertex_count, 1, 1],
            );
        });
    }

    /// Keeps the merged vertices that the next change replaces, for [`GpuScene::vertices_at`].
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(crate) fn keep_vertices(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.before.is_none() && self.vertex_count > 0 {
            let label = "merged vertices before [bytes]";
            let before = gpu.buffer(label, self.vertices.size(), wgpu::BufferUsages::STORAGE)?;
            self.before = Some((before, 0));
        }
        Ok(())
    }

    /// The merged vertices as they were at the `version` of [`Versions::geometry`]; `None` if they are the same now, or
    /// not known.
    pub(crate) fn vertices_at(&self, version: u64) -> Option<&wgpu::Buffer> {
        let before = self.before.as_ref();
        let before = before.filter(|(_, of)| *of == version && version != self.merged_version);
        before.map(|(vertices, _)| vertices)
    }

    /// How a technique that follows the light passing through a draw's surface draws it: whole, from both sides.
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

    /// What techniques claim of an instance.
    pub(crate) fn claims(&self, instance: usize) -> Claims {
        Claims(self.tables.instances[instance].claims)
    }

    /// Assigns each instance to the techniques that claim it: `claims` has one entry per object.
    pub fn assign(&mut self, gpu: &Gpu, claims: &[Claims]) {
        let mut changed = Vec::new();
        for (index, (row, of_object)) in self.tables.instances.iter_mut().zip(claims).enumerate() {
            if row.claims != of_object.0 {
                row.claims = of_object.0;
                changed.push(index);
                // Shadow maps and cubes hold what was seen through other surfaces: they become stale.
                self.versions.materials += 1;
            }
        }
        self.tables.write_instances(gpu, changed);
        for draw in &mut self.draws {
            let index = draw.instance as usize;
            draw.seen = seen_class(
                draw.class,
                self.alpha_modes[index],
                self.objects[index].is_transmissive,
                claims[index],
            );
        }
    }

    /// Makes every map stale, as if everything but the triangles of meshes had changed: atlases stay.
    pub fn invalidate(&mut self) {
        self.invalidate_geometry();
        self.versions.materials += 1;
        self.versions.lights += 1;
        self.versions.sky += 1;
        self.versions.environment += 1;
        self.versions.media += 1;
        self.versions.topology += 1;
        self.versions.instances += 1;
    }

    /// Makes maps stale as if every instance had moved.
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

    /// Radiance per unit of the environment's texels, its intensity included; 0 without an environment.
    pub fn environment_factor(&self) -> f32 {
        self.header_values.environment_intensity
    }

    /// Distance of the near planes of lights, cubes and texels (m). These may lie on a surface. Nearer than this, rounding
    /// would show that surface in front of them.
    pub fn near(&self) -> f32 {
        self.core.diagonal().max(1e-6) * 1e-4
    }
}
