//! The light around a group of objects: a radiance cube that goes with the maps of their surroundings and of an object's
//! own shape.

use glam::Vec3;

use super::groups::{Group, Kind};
use super::{Lobes, Search, Settings, Show};
use crate::capture::{Receiver, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named, join};
use crate::impostor::{
    ImpostorRequest, Maps, cube_texture, cubes, gpu, layers_of_cube, layers_of_level,
};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::Earlier;

/// The passes that fill the cubes, and those that read them.
#[derive(Debug)]
pub struct Kernels {
    store: Kernel,
    coarser: Kernel,
    gather: Kernel,
    /// The same, into cubes of mirrors and glass, and into cubes of rough surfaces.
    gather_apart: Kernel,
    gather_without: Kernel,
    certainty: Kernel,
    sampler: wgpu::Sampler,
}

impl Kernels {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let layout = Some(&scene.layout);
        let store = shader!("techniques.distance_impostor.store");
        let gather = shader!("techniques.distance_impostor.gather");
        let certainty = shader!("techniques.distance_impostor.certainty");
        let gather = Kernel::new(gpu, &gather, "main", layout)?;
        Ok(Self {
            store: Kernel::new(gpu, &store, "main", layout)?,
            coarser: Kernel::new(gpu, &shader!("capture.downsample_cube"), "main", None)?,
            gather_apart: gather.variant(gpu, &[("STRAIGHT", 1.0)])?,
            gather_without: gather.variant(gpu, &[("STRAIGHT", 2.0)])?,
            gather,
            certainty: Kernel::new(gpu, &certainty, "main", layout)?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("distance-impostor maps"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            }),
        })
    }

    /// The gather pass for what is to be shown.
    pub fn gather(&self, show: Show) -> &Kernel {
        match show {
            Show::Light => &self.gather,
            Show::Certainty => &self.certainty,
        }
    }

    /// The gather pass into the cube of such objects.
    pub fn gather_into(&self, kind: Kind, show: Show) -> &Kernel {
        match show {
            Show::Light if kind.is_smooth() => &self.gather_apart,
            Show::Light => &self.gather_without,
            Show::Certainty => &self.certainty,
        }
    }
}

/// Inputs shared by the captures of all objects.
#[derive(Debug, Clone, Copy)]
pub struct FrameInputs<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    pub settings: &'a Settings,
    /// Seed of random decisions in the captures of cubes.
    pub seed: u32,
    /// Where the camera is (m).
    pub eye: Vec3,
    /// Whether the light of other techniques was refined since the last frame, though nothing changed.
    pub is_refined: bool,
}

/// How far the eye moves before the cube of surroundings is captured from elsewhere, as a share of the scene's diagonal.
const EYE_STEP: f32 = 0.05;

/// Objects with an impostor.
#[derive(Debug)]
pub struct Impostor {
    /// Number of the cube, to which the objects' claims refer.
    number: u32,
    /// The first of the objects' instances, and whether there are more.
    instance: u32,
    is_shared: bool,
    wanted: ImpostorRequest,
    pub kind: Kind,
    radiance: wgpu::Texture,
    /// The cubes of its layers, the layers of its levels, and all as cube maps.
    stored: Vec<wgpu::TextureView>,
    levels: Vec<wgpu::TextureView>,
    cubes: wgpu::TextureView,
    target: Target,
    uniform: HostBuffer,
    maps: Option<Maps>,
    /// Whether the whole cube holds light.
    pub is_lit: bool,
    /// The faces to light.
    pub due: Option<SurfacePoints>,
    /// Pixels to draw before.
    pub due_pixels: u64,
    /// Whether another technique has captured the surroundings: their light has to follow at once.
    pub is_captured: bool,
    /// [`Maps::renewals`] when the faces were lit.
    renewals: u64,
    /// The reference point that the cube moves to when it is captured next (m).
    next_reference: Option<Vec3>,
    /// The next turn of faces to light a second time, after the other objects that these faces show.
    pub next_turn: usize,
}

impl Impostor {
    /// An empty cube for the group.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        settings: &Settings,
        number: u32,
        group: &Group,
    ) -> Result<Self, GpuError> {
        let side = group.side(settings.resolution);
        // Ideal lobes read only the finest level.
        let levels = match group.kind {
            Kind::Mirror | Kind::Refractor => 1,
            Kind::Rough | Kind::Surroundings => side.ilog2() + 1,
        };
        let format = wgpu::TextureFormat::Rgba16Float;
        let layers = settings.layers_searched();
        let name = "distance-impostor.radiance";
        let radiance = cube_texture(gpu, name, format, side, levels, layers)?;
        let bytes = size_of::<gpu::Impostor>() as u64;
        Ok(Self {
            number,
            instance: group.members[0],
            is_shared: group.members.len() > 1,
            wanted: ImpostorRequest {
                instances: group.left_out.clone(),
                side,
                shape_side: (group.kind == Kind::Refractor).then_some(settings.shape_resolution),
                reference: settings.reference.0,
                layers,
                renewal: settings.renewal(),
            },
            kind: group.kind,
            stored: (0..layers)
                .map(|layer| layers_of_cube(&radiance, layer))
                .collect(),
            levels: (0..levels)
                .map(|level| layers_of_level(&radiance, level))
                .collect(),
            cubes: cubes(&radiance),
            radiance,
            target: Target::new(gpu, 6 * side * side)?,
            uniform: HostBuffer::new(gpu, "impostor", bytes, wgpu::BufferUsages::UNIFORM)?,
            maps: None,
            is_lit: false,
            due: None,
            due_pixels: 0,
            is_captured: false,
            renewals: 0,
            next_reference: None,
            next_turn: usize::MAX,
        })
    }

    /// Finds which faces are due.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        making: FrameInputs<'_>,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let FrameInputs {
            scene, seed, eye, ..
        } = making;
        let settings = earlier.light.settings_version;
        if self.kind == Kind::Surroundings && making.settings.reference.0.is_none() {
            // A cube elsewhere needs new maps, so that it follows the eye in steps.
            let step = EYE_STEP * scene.diagonal();
            let is_far = |before: Vec3| before.distance(eye) > step;
            match self.wanted.reference {
                None => self.wanted.reference = Some(eye),
                Some(before) => self.next_reference = is_far(before).then_some(eye),
            }
        }
        let impostors = &mut earlier.shared.impostors;
        let maps = impostors.follow(gpu, scene, &self.wanted, settings, seed)?;
        // Maps that were not requested for some frames are gone.
        self.is_lit &= maps.renewals > 0;
        self.is_captured = self.is_lit && maps.renewals != self.renewals;
        let is_whole = !self.is_lit
            || making.is_refined
            || self.next_reference.is_some()
            || self.is_captured && maps.renewed.is_none();
        (self.due, self.due_pixels) = if is_whole {
            (Some(maps.points.clone()), maps.due_pixels)
        } else {
            let due = maps.due.as_ref().or(maps.renewed.as_ref());
            (due.cloned(), maps.due_pixels)
        };
        if self.next_reference.is_some() {
            self.due_pixels = u64::from(maps.points.count) * u64::from(self.wanted.layers);
        }
        Ok(())
    }

    /// Work of capturing and lighting the faces that are due, in units of a budget; `is_brief`: they are lit again.
    pub fn work(&self, earlier: &Earlier<'_>, is_brief: bool) -> u64 {
        let points = self.due.as_ref().map_or(0, |points| points.count);
        let points = u64::from(points) * u64::from(self.wanted.layers);
        self.due_pixels + earlier.light.work(points, is_brief)
    }

    /// Sets what gathers read: with `renews`, surroundings as they are now, whose faces then have to be lit; otherwise
    /// those that were captured before.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn show(
        &mut self,
        frame: &mut Frame<'_>,
        making: FrameInputs<'_>,
        earlier: &mut Earlier<'_>,
        renews: bool,
    ) -> Result<(), GpuError> {
        let FrameInputs {
            scene,
            settings,
            seed,
            ..
        } = making;
        let gpu = frame.gpu;
        let maps = if renews {
            let moved = self.next_reference.take();
            if moved.is_some() {
                self.wanted.reference = moved;
                self.is_lit = false;
            }
            self.due_pixels = 0;
            let maps = earlier.renew(frame, scene, &self.wanted, seed)?;
            if moved.is_some() {
                self.due = Some(maps.points.clone());
            }
            self.renewals = maps.renewals;
            maps
        } else {
            let version = earlier.light.settings_version;
            let impostors = &mut earlier.shared.impostors;
            let maps = impostors.follow(gpu, scene, &self.wanted, version, seed)?;
            maps.clone()
        };
        let uniform = gpu::Impostor {
            reference: maps.reference.to_array(),
            instance: self.instance,
            center: maps.center.to_array(),
            search: settings.search.number(),
            iterations: settings.iterations,
            bounces: settings.bounces,
            is_refracting: u32::from(self.wanted.shape_side.is_some() && settings.bounces > 0),
            is_classical: u32::from(settings.search == Search::None),
            world_from_shape: maps.world_from_shape.to_array(),
            number: self.number,
            is_rough: u32::from(!self.kind.is_smooth()),
            draws_lobes: u32::from(settings.lobes == Lobes::Drawn),
            is_shared: u32::from(self.is_shared),
        };
        self.uniform.write(gpu, std::slice::from_ref(&uniform));
        self.maps = Some(maps);
        Ok(())
    }

    /// Whether faces are to be captured or lit.
    pub fn is_due(&self) -> bool {
        self.due.is_some() || self.due_pixels > 0
    }

    /// Whether this frame lights only one of several turns of faces.
    pub fn is_in_turn(&self) -> bool {
        let count = 6 * self.wanted.side * self.wanted.side;
        self.due.as_ref().is_some_and(|due| due.count < count)
    }

    /// Makes all faces due.
    pub fn light_whole(&mut self) {
        self.due = self.maps.as_ref().map(|maps| maps.points.clone());
    }

    /// Makes the faces of the next turn due a second time; none once all turns were.
    pub fn once_more(&mut self) {
        let turns = self.maps.as_ref().map(|maps| &maps.turns);
        self.due = turns.and_then(|turns| turns.get(self.next_turn)).cloned();
        self.next_turn = self.next_turn.saturating_add(1);
    }

    /// Lights the faces that are due; `is_brief`: until they are lit again. `add_others` adds the light of other impostors
    /// on their objects.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn light(
        &mut self,
        frame: &mut Frame<'_>,
        making: FrameInputs<'_>,
        earlier: &mut Earlier<'_>,
        is_brief: bool,
        mut add_others: impl FnMut(&mut Frame<'_>, &Receiver) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let FrameInputs { scene, kernels, .. } = making;
        let (Some(points), Some(maps)) = (&self.due, &self.maps) else {
            return Ok(());
        };
        for (points, stored) in maps.layers(points).iter().zip(&self.stored) {
            let mut receiver = Receiver::new(points, &self.target);
            if is_brief {
                receiver = receiver.briefly();
            }
            // Other techniques add the light of emitters to rough lobes.
            earlier.gather(frame, scene, &receiver, self.kind.is_smooth())?;
            add_others(frame, &receiver)?;
            let resources = join(&receiver.resources(), &[("stored", stored)]);
            let side = self.wanted.side;
            let texels = [side, side, points.count / (side * side)];
            let (name, scene) = ("distance-impostor.store", Some(&scene.bind_group));
            frame.run(name, &kernels.store, scene, &resources, texels)?;
        }
        if self.levels.len() > 1 {
            frame.compute("distance-impostor.levels", |pass| {
                for (level, pair) in (1..).zip(self.levels.windows(2)) {
                    let side = self.wanted.side >> level;
                    let resources: [Named<'_>; 2] = [("finer", &pair[0]), ("coarser", &pair[1])];
                    let texels = [side, side, 6 * self.wanted.layers];
                    kernels.coarser.run(pass, None, &resources, texels)?;
                }
                Ok::<_, GpuError>(())
            })?;
        }
        self.is_lit = true;
        Ok(())
    }

    /// Adds what the objects reflect and refract at the receiver's points.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn gather(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        gather: &Kernel,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let Some(maps) = &self.maps else {
            return Ok(());
        };
        let maps = maps.resources(&self.uniform, &kernels.sampler);
        let own: [Named<'_>; 1] = [("radiance_cubes", &self.cubes)];
        let resources = [&receiver.resources()[..], &maps, &own].concat();
        let count = [receiver.points.lit, 1, 1];
        gather.run(pass, Some(&scene.bind_group), &resources, count)
    }

    /// Names and textures: radiance and distances of the surroundings, and a refractor's normals.
    pub fn textures(&self) -> Vec<(String, &wgpu::Texture)> {
        let mut textures = vec![("radiance", &self.radiance)];
        if let Some(maps) = &self.maps {
            textures.push(("distances", &maps.distances));
            textures.extend(maps.normals.iter().map(|normals| ("normals", normals)));
        }
        let instance = self.instance;
        textures
            .into_iter()
            .map(|(name, texture)| (format!("distance-impostor.{instance}.{name}"), texture))
            .collect()
    }
}
