//! The light around one object: a cube of radiance beside the maps of its surroundings and of its own shape.

use wgpu::BindingResource::TextureView;

use super::{Search, Settings};
use crate::capture::{SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::impostor::{Maps, Wanted, cube, cube_texture, gpu, layers_of_level};
use crate::scene::{GpuScene, Object, Versions};
use crate::shader;
use crate::techniques::Lit;

/// The passes that fill the cubes and the one that reads them.
#[derive(Debug)]
pub struct Kernels {
    store: Kernel,
    coarser: Kernel,
    pub gather: Kernel,
    sampler: wgpu::Sampler,
}

impl Kernels {
    /// Compiles them.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let layout = Some(&scene.layout);
        let store = shader!("techniques.distance_impostor.store");
        let gather = shader!("techniques.distance_impostor.gather");
        Ok(Self {
            store: Kernel::new(gpu, &store, "main", layout)?,
            coarser: Kernel::new(gpu, &shader!("capture.coarser_cube"), "main", None)?,
            gather: Kernel::new(gpu, &gather, "main", layout)?,
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
    wanted: Wanted,
    /// Whether its surface is ideal: then emitters show in it, else other techniques add their light.
    is_smooth: bool,
    radiance: wgpu::Texture,
    coarser: Vec<(wgpu::BindGroup, u32)>,
    target: Target,
    uniform: wgpu::Buffer,
    maps: Option<Bound>,
    /// What the light was captured of: the scene, and the settings of techniques.
    pub captured: Option<(Versions, u64)>,
}

/// The maps around the object, and what reads them.
#[derive(Debug)]
struct Bound {
    maps: Maps,
    stored: [wgpu::BindGroup; 2],
    /// Bind group 2 of the gather.
    group: wgpu::BindGroup,
}

impl Impostor {
    /// An empty cube for the instance.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        settings: &Settings,
        instance: u32,
        object: &Object,
    ) -> Result<Self, GpuError> {
        let side = settings.resolution;
        let is_refracting = object.is_transmissive && object.is_solid && object.is_smooth;
        // Ideal lobes read the finest level alone.
        let levels = if object.is_smooth {
            1
        } else {
            side.ilog2() + 1
        };
        let format = wgpu::TextureFormat::Rgba16Float;
        let radiance = cube_texture(gpu, "distance-impostor.radiance", format, side, levels)?;
        let coarser = (1..levels)
            .map(|level| {
                let [finer, this] = [level - 1, level].map(|one| layers_of_level(&radiance, one));
                let resources = [
                    ("finer", TextureView(&finer)),
                    ("coarser", TextureView(&this)),
                ];
                Ok((kernels.coarser.bind(gpu, 3, &resources)?, side >> level))
            })
            .collect::<Result<_, GpuError>>()?;
        let uniform = gpu.buffer(
            "impostor",
            size_of::<gpu::Impostor>() as u64,
            wgpu::BufferUsages::UNIFORM,
        )?;
        Ok(Self {
            wanted: Wanted {
                instance,
                side,
                shape_side: is_refracting.then_some(settings.shape_resolution),
                reference: settings.reference.0,
            },
            is_smooth: object.is_smooth,
            radiance,
            coarser,
            target: Target::new(gpu, 6 * side * side)?,
            uniform,
            maps: None,
            captured: None,
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
        let gpu = frame.gpu;
        let maps = lit
            .impostors
            .of(frame, scene, self.wanted, lit.version, seed)?
            .clone();
        let bound = match self.maps.take() {
            Some(bound) if bound.maps.is_same(&maps) => Bound { maps, ..bound },
            _ => self.bind(gpu, kernels, maps)?,
        };
        let points = &bound.maps.points;
        lit.gather(frame, scene, points, &self.target, self.is_smooth)?;
        add_others(frame, points, &self.target)?;
        frame.compute("distance-impostor.store", |pass| {
            let [seen, stored] = &bound.stored;
            let groups = [(0, &scene.bind_group), (1, seen), (3, stored)];
            let side = self.wanted.side;
            kernels.store.dispatch(pass, &groups, [side, side, 6]);
        });
        if !self.coarser.is_empty() {
            frame.compute("distance-impostor.levels", |pass| {
                for (group, side) in &self.coarser {
                    let invocations = [*side, *side, 6];
                    kernels.coarser.dispatch(pass, &[(3, group)], invocations);
                }
            });
        }
        let uniform = gpu::Impostor {
            reference: bound.maps.reference.to_array(),
            instance: self.wanted.instance,
            center: bound.maps.center.to_array(),
            search: settings.search.number(),
            iterations: settings.iterations,
            bounces: settings.bounces,
            is_refracting: u32::from(self.wanted.shape_side.is_some() && settings.bounces > 0),
            is_classical: u32::from(settings.search == Search::None),
        };
        gpu.queue
            .write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.maps = Some(bound);
        Ok(())
    }

    fn bind(&self, gpu: &Gpu, kernels: &Kernels, maps: Maps) -> Result<Bound, GpuError> {
        let [levels, finest] = [cube(&self.radiance), layers_of_level(&self.radiance, 0)];
        let stored = [
            ("radiance", self.target.radiance.as_entire_binding()),
            ("stored", TextureView(&finest)),
        ];
        let seen = [("seen", maps.points.view.as_entire_binding())];
        Ok(Bound {
            stored: [
                kernels.store.bind(gpu, 1, &seen)?,
                kernels.store.bind(gpu, 3, &stored)?,
            ],
            group: maps.bind(
                gpu,
                &kernels.gather,
                &self.uniform,
                &kernels.sampler,
                &[("radiance_cube", TextureView(&levels))],
            )?,
            maps,
        })
    }

    /// Adds what the object mirrors and refracts at `points`; `groups`: points and target.
    pub fn gather(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: &GpuScene,
        gather: &Kernel,
        groups: &[wgpu::BindGroup; 2],
        points: &SurfacePoints,
    ) {
        let [seen, added] = groups;
        if let Some(bound) = &self.maps {
            let groups = [
                (0, &scene.bind_group),
                (1, seen),
                (2, &bound.group),
                (3, added),
            ];
            gather.dispatch(pass, &groups, [points.count, 1, 1]);
        }
    }

    /// Names and textures: radiance and distances of the surroundings, and, of a refractor, its normals.
    pub fn textures(&self) -> Vec<(String, &wgpu::Texture)> {
        let mut textures = vec![("radiance", &self.radiance)];
        if let Some(Bound { maps, .. }) = &self.maps {
            textures.push(("distances", &maps.distances));
            textures.extend(maps.normals.iter().map(|normals| ("normals", normals)));
        }
        let instance = self.wanted.instance;
        textures
            .into_iter()
            .map(|(name, texture)| (format!("distance-impostor.{instance}.{name}"), texture))
            .collect()
    }
}
