//! The techniques: each generates illumination into maps and gathers it at surface points.

pub mod caustics;
pub mod distance_impostor;
pub mod environment_map;
pub mod image_based_lighting;
pub mod obscurances;
pub mod radiosity;
pub mod settings;
pub mod shadow_map;

pub use settings::{Field, SettingError};

use crate::capture::{Emission, SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::impostor::Impostors;
use crate::light_paths::LightPaths;
use crate::scene::{Claims, GpuScene, Object};

/// What a technique says of itself.
#[derive(Debug, Clone, Copy)]
pub struct Info {
    /// Name on the command line.
    pub name: &'static str,
    /// One line.
    pub summary: &'static str,
    /// Where it comes from: the tutorial's section and papers.
    pub source: &'static str,
    /// The light that it adds.
    pub paths: &'static [LightPaths],
    /// Whether a scene with such light has anything else that it needs: then it is in the best set for the scene.
    pub suits: fn(&GpuScene) -> bool,
    /// Whether it keeps light in the texels of an atlas: it needs a [`GpuScene::with_texels`].
    pub keeps_texels: bool,
}

/// What a technique keeps for its gather, for dumps and tests.
#[derive(Debug, Clone)]
pub struct Map {
    /// Such as `shadow-map.atlas`.
    pub name: String,
    /// Where its texels are.
    pub texels: Texels,
}

/// Where the texels of a map are.
#[derive(Debug, Clone)]
pub enum Texels {
    /// In a texture.
    Texture(wgpu::Texture),
    /// In a buffer, row by row.
    Buffer {
        /// The buffer.
        buffer: wgpu::Buffer,
        /// Width and height (texels).
        size: [u32; 2],
        /// From texel to texel (bytes).
        stride: u64,
        /// Whether a texel begins with one whole number of 32 bits, instead of three floats.
        is_number: bool,
    },
}

impl Map {
    /// The texture, if it is one.
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        match &self.texels {
            Texels::Texture(texture) => Some(texture),
            Texels::Buffer { .. } => None,
        }
    }

    /// Bytes on the GPU.
    pub fn bytes(&self) -> u64 {
        match &self.texels {
            Texels::Texture(texture) => texture
                .format()
                .theoretical_memory_footprint(texture.size()),
            Texels::Buffer { buffer, .. } => buffer.size(),
        }
    }
}

/// What every technique can do. The renderer calls `generate` and `gather` once a frame, in the registry's order.
pub trait Technique: std::fmt::Debug {
    /// Name, source and light paths.
    fn info(&self) -> &'static Info;

    /// The light that it adds: [`Info::paths`], or what is left of them beside other techniques and for the objects that it claims.
    fn paths(&self) -> &[LightPaths] {
        self.info().paths
    }

    /// Which of the scene's objects it claims, one answer each: asked whenever settings or the scene change. `covered`: the light that earlier
    /// techniques in use add.
    fn claim(&mut self, scene: &GpuScene, _covered: &[LightPaths]) -> Vec<Claims> {
        vec![Claims::NONE; scene.objects.len()]
    }

    /// The names of objects, separated by commas, that its settings hold.
    fn names(&self) -> &str {
        ""
    }

    /// How often its maps became finer though nothing had changed: who captured its light does so again.
    fn refinements(&self) -> u64 {
        0
    }

    /// How far its maps of a still scene are, 0 to 1: at 1 they stay as they are.
    fn progress(&self) -> f32 {
        1.0
    }

    /// What its maps have come to, where that takes long, to go on from another time. May wait for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    fn save(&self, _gpu: &Gpu) -> Result<Option<Vec<u8>>, GpuError> {
        Ok(None)
    }

    /// Whether it has earlier techniques light points of its own, [`Lit::gather`].
    fn lights_own_points(&self) -> bool {
        false
    }

    /// Goes on from what was saved for the same scene and settings; asked after each `generate` until it has. False: not yet, the light that its maps are
    /// made of is not what it was then.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when that was saved for others.
    fn resume(&mut self, _gpu: &Gpu, _saved: &[u8]) -> Result<bool, GpuError> {
        Ok(true)
    }

    /// Settings and their present values, as JSON.
    fn settings(&self) -> serde_json::Value;

    /// What can be set.
    fn fields(&self) -> &'static [Field];

    /// Sets one setting from text.
    ///
    /// # Errors
    /// [`SettingError`] when there is no such setting or the value is out of range.
    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError>;

    /// Brings the technique's maps up to date for what `view` sees; does nothing when they are. `lit`: the light that it may capture.
    ///
    /// # Errors
    /// [`GpuError`].
    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError>;

    /// Adds the technique's light at `points` to `target`.
    ///
    /// # Errors
    /// [`GpuError`].
    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError>;

    /// The maps that exist now.
    fn maps(&self) -> Vec<Map>;

    /// Bytes on the GPU that it holds besides its maps, to make them.
    fn work_bytes(&self) -> u64 {
        0
    }

    /// What to know of the picture beyond its light paths, in words: what the scene, once generated, does to it. May wait for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    fn warnings(&self, _gpu: &Gpu) -> Result<Vec<String>, GpuError> {
        Ok(Vec::new())
    }
}

/// The light of the frame and of the techniques earlier in the registry, whose maps are up to date: for techniques that capture their lit
/// surroundings.
#[derive(Debug)]
pub struct Lit<'a> {
    emission: &'a mut Emission,
    earlier: &'a mut [Box<dyn Technique>],
    /// The maps around objects.
    pub impostors: &'a mut Impostors,
    /// Grows when a setting of any technique changes: what was captured before is out of date.
    pub version: u64,
    /// Whether points are lit that the camera does not see: by techniques at points of their own, or in a bake. True
    /// unless it is set.
    pub beyond_camera: bool,
}

impl<'a> Lit<'a> {
    /// Light of emitters and of `earlier` techniques, at a `version` of settings.
    pub fn new(
        emission: &'a mut Emission,
        earlier: &'a mut [Box<dyn Technique>],
        impostors: &'a mut Impostors,
        version: u64,
    ) -> Self {
        Self {
            emission,
            earlier,
            impostors,
            version,
            beyond_camera: true,
        }
    }

    /// Grows when the light that is gathered became finer though nothing had changed.
    pub fn refinements(&self) -> u64 {
        let earlier = self.earlier.iter();
        earlier.map(|technique| technique.refinements()).sum()
    }

    /// Writes the light at `points` to `target`; `with_emission`: also what comes straight from emitters and the environment.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
        with_emission: bool,
    ) -> Result<(), GpuError> {
        if with_emission {
            self.emission.record(frame, scene, points, target)?;
        } else {
            frame.clear(&target.radiance);
        }
        for technique in &mut *self.earlier {
            technique.gather(frame, scene, points, target)?;
        }
        Ok(())
    }
}

/// What a technique's maps of the objects that it claims were made for: other settings, and objects of another kind, want other maps.
#[derive(Debug)]
pub(crate) struct MadeFor<S> {
    settings: S,
    claimed: Vec<u32>,
    objects: Vec<Object>,
}

impl<S: PartialEq + Clone> MadeFor<S> {
    /// For the objects with the numbers `claimed`.
    pub fn new(settings: &S, claimed: &[u32], scene: &GpuScene) -> Self {
        let objects = claimed.iter().map(|&one| &scene.objects[one as usize]);
        Self {
            settings: settings.clone(),
            claimed: claimed.to_vec(),
            objects: objects.cloned().collect(),
        }
    }

    /// Whether that is what is wanted now.
    pub fn is(&self, settings: &S, claimed: &[u32], scene: &GpuScene) -> bool {
        let objects = claimed.iter().map(|&one| &scene.objects[one as usize]);
        self.settings == *settings && self.claimed == claimed && self.objects.iter().eq(objects)
    }

    /// The objects, and their numbers.
    pub fn objects(&self) -> impl Iterator<Item = (u32, &Object)> {
        self.claimed.iter().copied().zip(&self.objects)
    }
}

/// How the registry makes a technique.
type Make = fn(&Gpu, &GpuScene) -> Result<Box<dyn Technique>, GpuError>;

/// Every technique in the order of the frame.
pub const REGISTRY: &[(&Info, Make)] = &[
    (&shadow_map::INFO, |gpu, scene| {
        Ok(Box::new(shadow_map::ShadowMap::new(gpu, scene)?))
    }),
    (&image_based_lighting::INFO, |gpu, scene| {
        Ok(Box::new(image_based_lighting::ImageBasedLighting::new(
            gpu, scene,
        )?))
    }),
    (&environment_map::INFO, |gpu, scene| {
        Ok(Box::new(environment_map::EnvironmentMap::new(gpu, scene)?))
    }),
    (&radiosity::INFO, |_, _| {
        Ok(Box::new(radiosity::Radiosity::default()))
    }),
    (&obscurances::INFO, |_, _| {
        Ok(Box::new(obscurances::Obscurances::default()))
    }),
    (&caustics::INFO, |gpu, scene| {
        Ok(Box::new(caustics::Caustics::new(gpu, scene)?))
    }),
    (&distance_impostor::INFO, |gpu, scene| {
        Ok(Box::new(distance_impostor::DistanceImpostor::new(
            gpu, scene,
        )?))
    }),
];
