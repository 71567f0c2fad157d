//! The maps around objects that distance impostors and caustics follow rays in: how far an object's surroundings are in every direction
//! from a reference point, and, where light passes through the object, its own shape seen from its middle (tutorial sections 5.1 and 5.3).
//!
//! Techniques that ask for the same maps get the same; each adds what it needs for itself, such as their radiance.

pub(crate) mod gpu;

use glam::Vec3;
use wgpu::BindingResource::{Sampler, TextureView};

use crate::capture::distance_pyramid::DistancePyramid;
use crate::capture::{Capture, CaptureKernels, CubeView, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::shader;

/// The nearest that a cube sees, as a part of the scene's diagonal.
const NEAR: f32 = 1e-4;

/// Which maps are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Number of the instance.
    pub instance: u32,
    /// Side of the faces of the surroundings' cube (texels), a power of two.
    pub side: u32,
    /// The same of its own shape's, if light passes through it.
    pub shape_side: Option<u32>,
    /// Where the cube is captured from (m): the object's middle if not said.
    pub reference: Option<Vec3>,
}

/// The maps of one object.
#[derive(Debug, Clone)]
pub struct Maps {
    /// Where the surroundings were captured from (m).
    pub reference: Vec3,
    /// The object's middle (m).
    pub center: Vec3,
    /// What the reference point sees: six faces below each other.
    pub points: SurfacePoints,
    /// How far that is (m).
    pub distances: wgpu::Texture,
    /// Of a refractor: its outward normals.
    pub normals: Option<wgpu::Texture>,
    surroundings: DistanceCube,
    shape: DistanceCube,
    shape_normals: wgpu::Texture,
}

/// Distances, and the pyramid by which they are searched.
#[derive(Debug, Clone)]
struct DistanceCube {
    distances: wgpu::Texture,
    pyramid: wgpu::Texture,
}

impl Maps {
    /// Bindings of maps.wesl and refractor.wesl, and `more`, as bind group 2 of a pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn bind(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        of_object: &wgpu::Buffer,
        sampler: &wgpu::Sampler,
        more: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<wgpu::BindGroup, GpuError> {
        let [distances, shape] =
            [&self.surroundings, &self.shape].map(|one| layers(&one.distances));
        let [pyramid, shape_pyramid] =
            [&self.surroundings, &self.shape].map(|one| layers(&one.pyramid));
        let normals = cube(&self.shape_normals);
        let mut resources = vec![
            ("of_object", of_object.as_entire_binding()),
            ("map_sampler", Sampler(sampler)),
            ("distances_unfilterable", TextureView(&distances)),
            ("pyramid_unfilterable", TextureView(&pyramid)),
            ("shape_unfilterable", TextureView(&shape)),
            ("shape_pyramid_unfilterable", TextureView(&shape_pyramid)),
            ("shape_normals", TextureView(&normals)),
        ];
        resources.extend_from_slice(more);
        kernel.bind(gpu, 2, &resources)
    }

    /// Whether `other` are the same textures.
    pub fn is_same(&self, other: &Self) -> bool {
        self.distances == other.distances
    }
}

/// A texture of six layers for a cube map.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub fn cube_texture(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    side: u32,
    levels: u32,
) -> Result<wgpu::Texture, GpuError> {
    gpu.texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: 6,
        },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// All levels of a texture's layers.
fn layers(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// The layers of one level.
pub fn layers_of_level(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}

/// The layers as a cube map.
pub fn cube(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..Default::default()
    })
}

/// The maps of all objects that somebody asks for.
#[derive(Debug)]
pub struct Impostors {
    capture: CaptureKernels,
    store_surroundings: Kernel,
    store_shape: Kernel,
    kept: Vec<Kept>,
    frame: u64,
}

#[derive(Debug)]
struct Kept {
    wanted: Wanted,
    maps: Maps,
    capture: Capture,
    pyramid: DistancePyramid,
    shape_pyramid: DistancePyramid,
    stored: wgpu::BindGroup,
    captured: Option<Captured>,
    shaped: Option<(u64, u64)>,
    asked: u64,
}

/// What the surroundings were captured of.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Captured {
    /// Places, materials, and the settings of techniques, which decide what cameras see whole.
    versions: [u64; 3],
    seed: u32,
}

impl Impostors {
    /// Maps that nobody asks for in as many frames are forgotten.
    const PATIENCE: u64 = 64;

    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, capture: &CaptureKernels) -> Result<Self, GpuError> {
        let store = shader!("impostor.store");
        let layout = Some(&scene.layout);
        Ok(Self {
            capture: capture.clone(),
            store_surroundings: Kernel::new(gpu, &store, "surroundings", layout)?,
            store_shape: Kernel::new(gpu, &store, "shape", layout)?,
            kept: Vec::new(),
            frame: 0,
        })
    }

    /// The pipelines of captures.
    pub fn capture_kernels(&self) -> &CaptureKernels {
        &self.capture
    }

    /// Counts frames.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        let now = self.frame;
        self.kept.retain(|one| now - one.asked <= Self::PATIENCE);
    }

    /// The maps wanted, brought up to date: `settings_version` as in [`crate::techniques::Lit`]; `seed` decides what chance decides in cubes, another
    /// one captures them anew.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn of(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        wanted: Wanted,
        settings_version: u64,
        seed: u32,
    ) -> Result<&Maps, GpuError> {
        let index = match self.kept.iter().position(|one| one.wanted == wanted) {
            Some(index) => index,
            None => {
                self.kept.push(self.make(frame.gpu, wanted)?);
                self.kept.len() - 1
            }
        };
        let kept = &mut self.kept[index];
        kept.asked = self.frame;
        let versions = scene.versions;
        let captured = Captured {
            versions: [versions.geometry, versions.materials, settings_version],
            seed,
        };
        let draws = &scene.draws;
        if kept.captured != Some(captured)
            && let Some(draw) = draws.iter().find(|draw| draw.instance == wanted.instance)
        {
            let center = draw.bounds.center();
            kept.maps.center = center;
            kept.maps.reference = wanted.reference.unwrap_or(center);
            let near = scene.diagonal() * NEAR;
            // Normal maps and alpha shape it, too.
            let shaped = Some((versions.geometry, versions.materials));
            if wanted.shape_side.is_some() && kept.shaped != shaped {
                let own = wanted.instance;
                kept.capture_shape(frame, scene, &self.capture, &self.store_shape, near, own)?;
                kept.shaped = shaped;
            }
            kept.capture_surroundings(frame, scene, &self.store_surroundings, near, seed)?;
            kept.captured = Some(captured);
        }
        Ok(&kept.maps)
    }

    fn make(&self, gpu: &Gpu, wanted: Wanted) -> Result<Kept, GpuError> {
        let distances = |side| {
            let format = wgpu::TextureFormat::R32Float;
            cube_texture(gpu, "impostor.distances", format, side, 1)
        };
        let normals = |side| {
            let format = wgpu::TextureFormat::Rgba16Float;
            cube_texture(gpu, "impostor.normals", format, side, 1)
        };
        // A shader wants its textures, also those that it does not read.
        let least = crate::capture::distance_pyramid::LEAST_SIDE;
        let shape_side = wanted.shape_side.unwrap_or(least);
        let [surroundings, shape] = [distances(wanted.side)?, distances(shape_side)?];
        let pyramid = DistancePyramid::new(gpu, &surroundings)?;
        let shape_pyramid = DistancePyramid::new(gpu, &shape)?;
        let shape_normals = normals(shape_side)?;
        let capture = Capture::of_cube(gpu, &self.capture, wanted.side)?;
        let view = layers(&surroundings);
        let unread = layers(&normals(least)?);
        let resources = [
            ("distances", TextureView(&view)),
            ("normals", TextureView(&unread)),
        ];
        Ok(Kept {
            stored: self.store_surroundings.bind(gpu, 3, &resources)?,
            maps: Maps {
                reference: Vec3::ZERO,
                center: Vec3::ZERO,
                points: capture.points.clone(),
                distances: surroundings.clone(),
                normals: wanted.shape_side.is_some().then(|| shape_normals.clone()),
                surroundings: DistanceCube {
                    distances: surroundings,
                    pyramid: pyramid.texture.clone(),
                },
                shape: DistanceCube {
                    distances: shape,
                    pyramid: shape_pyramid.texture.clone(),
                },
                shape_normals,
            },
            wanted,
            capture,
            pyramid,
            shape_pyramid,
            captured: None,
            shaped: None,
            asked: self.frame,
        })
    }
}

impl Kept {
    fn capture_surroundings(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        store: &Kernel,
        near: f32,
        seed: u32,
    ) -> Result<(), GpuError> {
        let (own, side) = (self.wanted.instance, self.wanted.side);
        let view = CubeView::new(self.maps.reference, side, near, 0, seed);
        self.capture.record_cube(frame, scene, &view, |draw| {
            (draw.instance != own).then_some(seen_from_outside(draw))
        })?;
        let points = self.capture.points.bind(frame.gpu, store)?;
        frame.compute("impostor.store", |pass| {
            let groups = [(0, &scene.bind_group), (1, &points), (3, &self.stored)];
            store.dispatch(pass, &groups, [side, side, 6]);
        });
        self.pyramid.record(frame);
        Ok(())
    }

    fn capture_shape(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &CaptureKernels,
        store: &Kernel,
        near: f32,
        own: u32,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let side = self.maps.shape_normals.width();
        let mut capture = Capture::of_cube(gpu, kernels, side)?;
        let view = CubeView::new(self.maps.center, side, near, 0, 0);
        capture.record_cube(frame, scene, &view, |draw| {
            (draw.instance == own).then(|| scene.whole_class(draw).from_both_sides())
        })?;
        let [distances, normals] = [&self.maps.shape.distances, &self.maps.shape_normals];
        let [distances, normals] = [distances, normals].map(layers);
        let resources = [
            ("distances", TextureView(&distances)),
            ("normals", TextureView(&normals)),
        ];
        let stored = store.bind(gpu, 3, &resources)?;
        let points = capture.points.bind(gpu, store)?;
        frame.compute("impostor.store", |pass| {
            let groups = [(0, &scene.bind_group), (1, &points), (3, &stored)];
            store.dispatch(pass, &groups, [side, side, 6]);
        });
        self.shape_pyramid.record(frame);
        Ok(())
    }
}

/// How a cube sees a thing: other glass from outside alone, because the reference point may lie in it.
fn seen_from_outside(draw: &Draw) -> DrawClass {
    if draw.seen != draw.class && draw.seen == DrawClass::DoubleSided {
        DrawClass::Open
    } else {
        draw.seen
    }
}
