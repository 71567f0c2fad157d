//! The maps of one object: its surroundings as a cube of radiance and distances, and, where light passes through it, its own shape.

use glam::Vec3;
use wgpu::BindingResource::{Sampler, TextureView};

use super::{Search, Settings, gpu};
use crate::capture::distance_pyramid::DistancePyramid;
use crate::capture::{Capture, CaptureKernels, CubeView, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::{DrawClass, GpuScene, Versions};
use crate::shader;
use crate::techniques::Lit;

/// The nearest that a cube sees, as a part of the scene's diagonal.
const NEAR: f32 = 1e-4;

/// The passes that fill the maps and the one that reads them.
#[derive(Debug)]
pub struct Kernels {
    capture: CaptureKernels,
    surroundings: Kernel,
    shape: Kernel,
    coarser: Kernel,
    pub gather: Kernel,
    sampler: wgpu::Sampler,
}

impl Kernels {
    /// Compiles them.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, capture: &CaptureKernels) -> Result<Self, GpuError> {
        let store = shader!("techniques.distance_impostor.store");
        let layout = Some(&scene.layout);
        Ok(Self {
            capture: capture.clone(),
            surroundings: Kernel::new(gpu, &store, "surroundings", layout)?,
            shape: Kernel::new(gpu, &store, "shape", layout)?,
            coarser: Kernel::new(gpu, &shader!("capture.coarser_cube"), "main", None)?,
            gather: Kernel::new(
                gpu,
                &shader!("techniques.distance_impostor.gather"),
                "main",
                layout,
            )?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("distance-impostor maps"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            }),
        })
    }
}

/// What a cube saw, as layers: colour with or without levels, and distances with their pyramid.
#[derive(Debug)]
struct CubeMap {
    side: u32,
    colors: wgpu::Texture,
    distances: wgpu::Texture,
    pyramid: DistancePyramid,
}

impl CubeMap {
    fn new(gpu: &Gpu, what: &str, side: u32, levels: u32) -> Result<Self, GpuError> {
        let texture = |name: &str, format, levels| {
            gpu.texture(&wgpu::TextureDescriptor {
                label: Some(&format!("distance-impostor.{name}")),
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
        };
        let distances = texture("distances", wgpu::TextureFormat::R32Float, 1)?;
        Ok(Self {
            side,
            colors: texture(what, wgpu::TextureFormat::Rgba16Float, levels)?,
            pyramid: DistancePyramid::new(gpu, &distances)?,
            distances,
        })
    }

    fn store(
        &self,
        frame: &mut Frame<'_>,
        kernel: &Kernel,
        scene: &GpuScene,
        capture: &Capture,
        target: &Target,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let [distances, colors] = [layers(&self.distances, 0), layers(&self.colors, 0)];
        let resources = [
            ("radiance", target.radiance.as_entire_binding()),
            ("distances", TextureView(&distances)),
            ("stored", TextureView(&colors)),
        ];
        let points = capture.points.bind(gpu, kernel)?;
        let stored = kernel.bind(gpu, 3, &resources)?;
        frame.compute("distance-impostor.store", |pass| {
            let groups = [(0, &scene.bind_group), (1, &points), (3, &stored)];
            kernel.dispatch(pass, &groups, [self.side, self.side, 6]);
        });
        self.pyramid.record(frame);
        Ok(())
    }
}

/// Six layers of one level.
fn layers(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}

fn cube(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..Default::default()
    })
}

/// What captures are made of.
#[derive(Debug, Clone, Copy)]
pub struct Making<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    pub settings: &'a Settings,
    /// Decides what chance decides in cubes.
    pub seed: u32,
}

/// An object with an impostor.
#[derive(Debug)]
pub struct Impostor {
    /// Number of the instance.
    pub instance: u32,
    /// Whether light passes into it.
    is_refracting: bool,
    /// Whether its surface is ideal: then emitters show in it, else other techniques add their light.
    is_smooth: bool,
    surroundings: CubeMap,
    coarser: Vec<(wgpu::BindGroup, u32)>,
    capture: Capture,
    target: Target,
    shape: CubeMap,
    uniform: wgpu::Buffer,
    /// Bind group 2 of the gather.
    pub group: wgpu::BindGroup,
    /// What the maps were captured of: the scene, and the settings of techniques.
    pub captured: Option<(Versions, u64)>,
    shaped: Option<(u64, u64)>,
}

impl Impostor {
    /// Makes empty maps for the instance.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        kernels: &Kernels,
        settings: &Settings,
        instance: u32,
    ) -> Result<Self, GpuError> {
        let side = settings.resolution;
        let object = &scene.objects[instance as usize];
        let is_refracting = object.is_transmissive && object.is_solid && object.is_smooth;
        // Ideal lobes read the finest level alone.
        let levels = if object.is_smooth {
            1
        } else {
            side.ilog2() + 1
        };
        let surroundings = CubeMap::new(gpu, "radiance", side, levels)?;
        // A shader wants its textures, also those that it does not read.
        let shape_side = if is_refracting {
            settings.shape_resolution
        } else {
            crate::capture::distance_pyramid::LEAST_SIDE
        };
        let shape = CubeMap::new(gpu, "normals", shape_side, 1)?;
        let coarser = (1..levels)
            .map(|level| {
                let [finer, this] = [level - 1, level].map(|one| layers(&surroundings.colors, one));
                let resources = [
                    ("finer", TextureView(&finer)),
                    ("coarser", TextureView(&this)),
                ];
                Ok((kernels.coarser.bind(gpu, 3, &resources)?, side >> level))
            })
            .collect::<Result<_, GpuError>>()?;
        let capture = Capture::of_cube(gpu, &kernels.capture, side)?;
        let target = Target::new(gpu, capture.points.count)?;
        let uniform = gpu.buffer(
            "impostor",
            size_of::<gpu::Impostor>() as u64,
            wgpu::BufferUsages::UNIFORM,
        )?;
        let [radiance, normals] = [cube(&surroundings.colors), cube(&shape.colors)];
        let of_pyramid = |map: &CubeMap| {
            map.pyramid
                .texture
                .create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(wgpu::TextureViewDimension::D2Array),
                    ..Default::default()
                })
        };
        let pyramids = [of_pyramid(&surroundings), of_pyramid(&shape)];
        let distances = [
            layers(&surroundings.distances, 0),
            layers(&shape.distances, 0),
        ];
        let group = kernels.gather.bind(
            gpu,
            2,
            &[
                ("of_object", uniform.as_entire_binding()),
                ("map_sampler", Sampler(&kernels.sampler)),
                ("radiance_cube", TextureView(&radiance)),
                ("distances_unfilterable", TextureView(&distances[0])),
                ("pyramid_unfilterable", TextureView(&pyramids[0])),
                ("shape_unfilterable", TextureView(&distances[1])),
                ("shape_pyramid_unfilterable", TextureView(&pyramids[1])),
                ("shape_normals", TextureView(&normals)),
            ],
        )?;
        Ok(Self {
            instance,
            is_refracting,
            is_smooth: object.is_smooth,
            surroundings,
            coarser,
            capture,
            target,
            shape,
            uniform,
            group,
            captured: None,
            shaped: None,
        })
    }

    /// Captures what has changed. `add_others`: the light of other impostors on their objects.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        lit: &mut Lit<'_>,
        add_others: impl FnOnce(&mut Frame<'_>, &SurfacePoints, &Target) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let Making {
            scene,
            kernels,
            settings,
            seed,
        } = making;
        self.captured = Some((scene.versions, lit.version));
        let Some(draw) = scene
            .draws
            .iter()
            .find(|draw| draw.instance == self.instance)
        else {
            return Ok(());
        };
        let center = draw.bounds.center();
        let reference = settings.reference.0.unwrap_or(center);
        let near = scene.diagonal() * NEAR;
        // Normal maps and alpha shape it, too.
        let of_shape = Some((scene.versions.geometry, scene.versions.materials));
        if self.is_refracting && self.shaped != of_shape {
            self.capture_shape(frame, scene, kernels, center, near)?;
            self.shaped = of_shape;
        }
        let view = CubeView::new(reference, settings.resolution, near, 0, seed);
        let own = self.instance;
        self.capture.record_cube(frame, scene, &view, |draw| {
            // Other glass is seen from outside alone: the reference point may lie in it.
            let is_claimed = draw.seen != draw.class && draw.seen == DrawClass::DoubleSided;
            let class = if is_claimed {
                DrawClass::Open
            } else {
                draw.seen
            };
            (draw.instance != own).then_some(class)
        })?;
        lit.gather(
            frame,
            scene,
            &self.capture.points,
            &self.target,
            self.is_smooth,
        )?;
        add_others(frame, &self.capture.points, &self.target)?;
        self.surroundings.store(
            frame,
            &kernels.surroundings,
            scene,
            &self.capture,
            &self.target,
        )?;
        if !self.coarser.is_empty() {
            frame.compute("distance-impostor.levels", |pass| {
                for (group, side) in &self.coarser {
                    let invocations = [*side, *side, 6];
                    kernels.coarser.dispatch(pass, &[(3, group)], invocations);
                }
            });
        }
        let uniform = gpu::Impostor {
            reference: reference.to_array(),
            instance: self.instance,
            center: center.to_array(),
            search: settings.search.number(),
            iterations: settings.iterations,
            bounces: settings.bounces,
            is_refracting: u32::from(self.is_refracting && settings.bounces > 0),
            is_classical: u32::from(settings.search == Search::None),
        };
        let queue = &frame.gpu.queue;
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        Ok(())
    }

    fn capture_shape(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        center: Vec3,
        near: f32,
    ) -> Result<(), GpuError> {
        let side = self.shape.side;
        let mut capture = Capture::of_cube(frame.gpu, &kernels.capture, side)?;
        let view = CubeView::new(center, side, near, 0, 0);
        let own = self.instance;
        capture.record_cube(frame, scene, &view, |draw| {
            (draw.instance == own).then_some(draw.seen)
        })?;
        self.shape
            .store(frame, &kernels.shape, scene, &capture, &self.target)
    }

    /// Radiance and distances of the surroundings, and, of a refractor, its normals.
    pub fn textures(&self) -> Vec<(&'static str, &wgpu::Texture)> {
        let mut textures = vec![
            ("radiance", &self.surroundings.colors),
            ("distances", &self.surroundings.distances),
        ];
        if self.is_refracting {
            textures.push(("normals", &self.shape.colors));
        }
        textures
    }
}
