//! Environment mapping: the environment reflected by diffuse, glossy and ideal lobes, without occlusion (tutorial
//! sections 3.2.1 and 3.2.2).
//!
//! Generate: converts the environment's image to a cube map with levels, and from it computes an irradiance cube, nine
//! spherical harmonics, and cubes whose levels hold the environment's means over ever wider lobes. Gather: each lobe is
//! its albedo times one lookup; ideal mirrors and glass read the image itself. If another technique adds the
//! environment's diffuse and glossy light, this one adds that light only on the objects that are assigned to it; on all
//! others it adds what ideal mirrors show. docs/techniques/environment-map.md.

pub mod export;
#[cfg(test)]
mod export_tests;
#[cfg(test)]
mod tests;

use super::openness::follow;
use super::{
    AUTO, Earlier, Generated, Info, Inspection, Map, OpennessLookup, Plan, Provided, Registration,
    Role, Technique, Unready, chooses, named,
};
use crate::capture::{Gather, Output, Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError, join};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::prefiltered::{Lookup, Prefiltered, PrefilteredRequest};
use crate::scene::{Claims, GpuScene};
use crate::settings::SettingSet;
use crate::shader;
use crate::stage::Stage;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "environment-map",
    summary: "the environment without occlusion; beside image-based-lighting in mirrors, glass and chosen objects",
    source: "tutorial sections 3.2.1 and 3.2.2; Blinn and Newell 1976; Ramamoorthi and Hanrahan 2001; Karis 2013",
    paths: &[LightPaths::new(LightClass::Environment, "L[DGS]E")],
    role: Role::Gloss,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |gpu, scene| Ok(Box::new(EnvironmentMap::new(gpu, scene)?)),
    suits: |occasion| Some(occasion.has_lights(INFO.paths)),
    settings: |_| Vec::new(),
};

/// Light paths that remain if another technique adds the rest.
const MIRRORS: &[LightPaths] = &[LightPaths::new(LightClass::Environment, "LSE")];

crate::choices! {
    /// How irradiance is stored.
    pub enum Irradiance {
        /// A cube map, summed directly.
        Cube = "cube",
        /// Nine spherical harmonics.
        Harmonics = "harmonics",
    }
}

crate::choices! {
    /// How metals with a complex refractive index reflect.
    pub enum Metals {
        /// Exact reflectance of unpolarised light.
        Exact = "exact",
        /// The tutorial's equation 4.
        Approximate = "approximate",
    }
}

crate::choices! {
    /// Which transmissive objects refract the environment.
    pub enum Refraction {
        /// None: cameras see straight through them.
        None = "none",
        /// Those whose surface bounds a solid.
        Solids = "solids",
        /// Also thin walls, which then show only the environment behind them.
        All = "all",
    }
}

crate::settings! {
    /// Settings of environment mapping.
    pub struct Settings {
        /// Side of the radiance cube and of the finest level of the glossy maps, a power of two.
        pub resolution: u32 = 256 => in_range(8.0, 2048.0).power_of_two().unit("texels"),
        /// How irradiance is stored: cube, a cube map, or harmonics, nine spherical harmonics.
        pub irradiance: Irradiance = Irradiance::Cube => any(),
        /// Sample directions per texel of the glossy maps' first blurred level; twice as many in each coarser level.
        pub samples: u32 = 128 => in_range(1.0, 1024.0),
        /// Whether Phong lobes keep the surface's cosine, which the tutorial drops.
        pub phong_cosine: bool = true => any(),
        /// Reflectance of metals with a complex refractive index: exact, or approximate, by the tutorial's equation 4.
        pub metals: Metals = Metals::Exact => any(),
        /// Transmissive objects that refract the environment, once: none, solids or all; others are seen through.
        pub refraction: Refraction = Refraction::Solids => any(),
        /// Whether near surfaces hide the environment from the diffuse lobe, as far as obscurances tell.
        pub occlusion: bool = false => any(),
        /// Objects that get all lobes of the environment's light from this technique: names separated by commas, * for
        /// any characters; auto: all, or none beside image-based-lighting.
        pub objects: String = AUTO.to_owned() => any(),
    }
}

/// Environment mapping.
#[derive(Debug)]
pub struct EnvironmentMap {
    settings: Settings,
    /// The pass that adds the light, by whether something hides it.
    gather: Stage<bool, Gather>,
    /// Whether all of the environment's light is left to this technique.
    is_whole: bool,
    /// Whether any object needs more than the environment's image.
    needs_maps: bool,
    /// The environment's maps, once generated.
    maps: Option<(Prefiltered, Lookup)>,
    /// With [`Settings::occlusion`], what hides them.
    occlusion: Stage<wgpu::Buffer, Box<dyn OpennessLookup>>,
    /// Stands in for what `occlusion` finds.
    unhidden: wgpu::Buffer,
}

impl Settings {
    fn wanted(&self) -> PrefilteredRequest {
        PrefilteredRequest {
            resolution: self.resolution,
            samples: self.samples,
            phong_cosine: self.phong_cosine,
        }
    }

    fn lookup(&self) -> Lookup {
        Lookup {
            from_harmonics: self.irradiance == Irradiance::Harmonics,
            approximate_metals: self.metals == Metals::Approximate,
        }
    }
}

impl EnvironmentMap {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let mut made = Self {
            settings: Settings::default(),
            gather: Stage::default(),
            is_whole: true,
            needs_maps: true,
            maps: None,
            occlusion: Stage::default(),
            unhidden: gpu.room("openness of no point", 16)?,
        };
        made.gather.keep(false, |_| gather(gpu, scene, false))?;
        Ok(made)
    }

    /// Radiance of the environment in spherical harmonics, 9 x 4 floats in the order of
    /// shared/spherical_harmonics.wesl, once generated; without rotation and intensity.
    pub fn harmonics(&self) -> Option<&wgpu::Buffer> {
        self.maps.as_ref().map(|(maps, _)| &maps.harmonics)
    }
}

/// The pass that adds the light; `is_hidden`: as far as openness lets it.
fn gather(gpu: &Gpu, scene: &GpuScene, is_hidden: bool) -> Result<Gather, GpuError> {
    let shader = shader!("techniques.environment_map.gather");
    let constants = [("OCCLUSION", f64::from(u8::from(is_hidden)))];
    Gather::new(gpu, scene, &shader, &constants)
}

impl Technique for EnvironmentMap {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        self.is_whole = overlap(INFO.paths, covered).is_none();
        let objects = &scene.objects;
        if scene.environment.is_none() {
            return Plan::adding([], scene);
        }
        let settings = &self.settings;
        let claims = objects.iter().map(|object| {
            let refracts = match settings.refraction {
                Refraction::None => false,
                Refraction::Solids => object.is_solid,
                Refraction::All => true,
            };
            let mine = if chooses(&settings.objects, object, self.is_whole, true) {
                Claims::ENVIRONMENT
            } else {
                Claims::NONE
            };
            let transmission = if object.is_transmissive && refracts {
                Claims::TRANSMISSION
            } else {
                Claims::NONE
            };
            mine | transmission
        });
        let claims: Vec<Claims> = claims.collect();
        self.needs_maps = self.is_whole
            || objects.iter().zip(&claims).any(|(object, claims)| {
                claims.contains(Claims::ENVIRONMENT)
                    || claims.contains(Claims::TRANSMISSION) && !object.is_smooth
            });
        Plan {
            paths: if self.is_whole { INFO.paths } else { MIRRORS }.to_vec(),
            claims,
            object_names: named(&self.settings.objects),
            lookups: 1,
            needs: self
                .settings
                .occlusion
                .then_some((Provided::Openness, "occlusion")),
        }
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        if scene.environment.is_none() {
            return Ok(Generated::FINAL);
        }
        let (wanted, lookup) = (self.settings.wanted(), self.settings.lookup());
        let (maps, generated) = earlier.prefiltered(frame, scene, wanted, self.needs_maps)?;
        self.maps = Some((maps.clone(), lookup));
        let openness = earlier.openness().filter(|_| self.settings.occlusion);
        let is_hidden = openness.is_some();
        follow(&mut self.occlusion, openness, frame.gpu, scene)?;
        self.gather
            .keep(is_hidden, |_| gather(frame.gpu, scene, is_hidden))?;
        Ok(generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        // Mirrors alone show no irradiance.
        let is_lit = self.is_whole || receiver.points.output == Output::RadianceToEye;
        if scene.environment.is_none() || !is_lit {
            return Ok(());
        }
        let (Some((maps, lookup)), Some(gather)) = (&self.maps, self.gather.get()) else {
            return Ok(());
        };
        let openness = match self.occlusion.get_mut() {
            Some(occlusion) => occlusion.record(frame, scene, receiver)?,
            None => &self.unhidden,
        };
        let settings = maps.settings(frame.gpu, *lookup)?;
        let more = join(&maps.resources(&settings), &[("openness", openness)]);
        gather.record(frame, "environment-map.gather", scene, receiver, &more)
    }

    fn inspect(&self) -> Inspection {
        let textures = self.maps.iter().flat_map(|(maps, _)| maps.textures());
        let names = ["radiance", "irradiance", "ggx", "phong", "albedo"];
        let maps = names.iter().zip(textures);
        let maps = maps.map(|(name, map)| Map::of_texture(format!("environment-map.{name}"), map));
        Inspection::of(maps)
    }
}
