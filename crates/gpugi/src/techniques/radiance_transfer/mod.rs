//! Precomputed radiance transfer: how much of the light from each direction leaves each texel of a still scene, in
//! spherical harmonics or Haar wavelets, so that its environment and directional lights may change at the cost of a dot
//! product per texel (tutorial sections 7, 7.1 and 7.2).
//!
//! Generate: rays find the transfer vectors of an atlas's texels, a few steps per frame, bounce by bounce; the
//! environment is projected to the same functions, and the dot products of both are the irradiance of the texels.
//! Gather: looks up the irradiance at a point's place in the atlas. docs/techniques/radiance-transfer.md.

mod compression;
mod glossy;
pub(crate) mod gpu;
mod haar;
mod harmonics;
mod light;
mod places;
mod principal;
mod rotation;
mod settings;
mod stored;
#[cfg(test)]
mod tests;
mod texels;
mod transfer;
mod vertices;

use std::sync::Arc;

use gpugi_scene::{Atlas, LightKind, Scene, TransferVectors};

use super::precomputed::Fit;
use super::{
    Cost, Earlier, Generated, Info, Inspection, Needs, Plan, Precomputed, Registration, Resume,
    Role, Technique, Unready, atlas,
};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::scene::{Claims, GpuScene, Inputs};
use crate::settings::SettingSet;
use crate::stage::{Same, Stage};
use glossy::{Glossy, GlossyObject};
use settings::OfTransfer;
pub use settings::{At, Basis, Settings};
use texels::{LitTexels, Saved};
use vertices::VerticesKey;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "radiance-transfer",
    summary: "light of a changing environment on diffuse and glossy surfaces of a still scene, by precomputed transfer",
    source: "tutorial sections 7, 7.1 and 7.2; Sloan, Kautz and Snyder 2002",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LD*[DG]E"),
        LightPaths::new(LightClass::Environment, "LD*[DG]E"),
    ],
    role: Role::Indirect,
    needs: Needs::TEXELS,
    cost: Cost::Precomputation,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(RadianceTransfer::default())),
    suits: |_| None,
    settings: |_| Vec::new(),
};

/// Precomputed radiance transfer.
#[derive(Debug, Default)]
pub struct RadianceTransfer {
    settings: Settings,
    texels: Stage<TexelsKey, LitTexels>,
    /// Objects whose texels have transfer matrices.
    glossy: Vec<GlossyObject>,
    cut: Cut,
    /// Whether the scene's stored vectors fit it.
    fit: Fit,
    /// Whether objects are claimed whose indirect light comes from another technique.
    leaves_objects: bool,
}

/// How work is cut. The result does not depend on it.
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// Most texels per buffer of points; `None`: as many as fit.
    most_texels: Option<u32>,
    /// Rays of one step of vectors: about 40 ms on a small GPU. A step of matrices, whose sums take longer, has a quarter.
    rays_of_step: u32,
}

impl Default for Cut {
    fn default() -> Self {
        Self {
            most_texels: None,
            rays_of_step: 1 << 22,
        }
    }
}

/// What texels and their passes are made for: an atlas, or vertices, [`GpuScene::ray_features`], what of the settings
/// decides the transfer vectors, and objects with matrices.
type TexelsKey = (
    Option<Same<Atlas>>,
    Option<VerticesKey>,
    [bool; 3],
    OfTransfer,
    Vec<GlossyObject>,
);

impl RadianceTransfer {
    /// The transfer vectors that the scene's file holds, if they are wanted and nothing has moved since.
    fn stored(&mut self, scene: &GpuScene) -> Option<Arc<TransferVectors>> {
        let host = scene.host()?;
        let vectors = host.transfer.as_ref();
        let vectors = vectors.filter(|_| self.settings.may_be_stored());
        let now = scene.versions.of(Inputs::GEOMETRY | Inputs::INSTANCES);
        self.fit.of(vectors, now, |vectors| vectors.check(host))
    }
}

/// Whether directional lights are projected: no other punctual light would be left out.
fn has_directional_lights(settings: &Settings, scene: &GpuScene) -> bool {
    let is_directional = |kind: LightKind| kind == LightKind::Directional;
    let mut lights = scene.lights.iter();
    settings.directional_lights && lights.all(|light| is_directional(light.kind))
}

impl Technique for RadianceTransfer {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, _: &[LightPaths], _: &[Claims]) -> Plan {
        let stored = self.stored(scene);
        let bounces = self.settings.with(stored.as_deref()).bounces;
        self.glossy = glossy::objects(&self.settings, scene);
        let pattern = if self.glossy.is_empty() {
            format!("LD{{1,{bounces}}}E")
        } else {
            format!("LD{{0,{}}}[DG]E", bounces - 1)
        };
        let of = |class| LightPaths {
            class,
            pattern: pattern.clone().into(),
        };
        let mut paths = vec![of(LightClass::Environment)];
        if has_directional_lights(&self.settings, scene) {
            paths.push(of(LightClass::Punctual));
        }
        Plan {
            object_names: self.settings.glossy.clone(),
            ..Plan::adding(paths, scene)
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
        let gpu = frame.gpu;
        let stored = self.stored(scene);
        let settings = &self.settings.with(stored.as_deref());
        let texels = match &stored {
            Some(stored) => Some(Arc::clone(&stored.atlas)),
            None if settings.at == At::Vertices => None,
            None => {
                let bytes = u64::from(settings.terms()) * gpu::COEFFICIENT_BYTES;
                let size = (settings.resolution, settings.density);
                Some(atlas(gpu, scene, INFO.name, size, bytes)?)
            }
        };
        let vertices = texels.is_none().then(|| VerticesKey::new(scene, settings));
        let key = (
            texels.clone().map(Same),
            vertices,
            scene.ray_features(),
            settings.of_transfer(),
            self.glossy.clone(),
        );
        let texels = self.texels.compiled(frame, key, |_| {
            let (glossy, cut) = (&self.glossy, self.cut);
            let mut made = LitTexels::new(gpu, scene, settings, glossy, texels, cut)?;
            if let Some(stored) = &stored {
                made.transfer.follow(scene);
                let finished = stored::as_saved(stored);
                let resumed = made.transfer.resume(gpu, &finished, false);
                resumed.map_err(|error| INFO.unfit(error))?;
            }
            Ok(made)
        })?;
        let made_of_light = light::ProjectedLight {
            directional_lights: has_directional_lights(&self.settings, scene),
            window: settings.window,
        };
        let generated = texels.generate(frame, scene, settings.steps, made_of_light, earlier)?;
        let mut claims = (0..scene.objects.len()).map(|object| scene.claims(object));
        self.leaves_objects = settings.bounces > 1
            && claims.any(|claims| {
                claims.contains(Claims::INDIRECT) || claims.contains(Claims::ENVIRONMENT)
            });
        Ok(generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        match self.texels.get() {
            Some(texels) => texels.gather(frame, scene, receiver),
            None => Ok(()),
        }
    }

    fn inspect(&self) -> Inspection {
        let Some(texels) = self.texels.get() else {
            return Inspection::default();
        };
        let mut warnings = Vec::new();
        if let Some(reason) = self.fit.reason() {
            warnings.push(format!(
                "new transfer vectors are computed, because those of the file do not fit: {reason}"
            ));
        }
        warnings.extend(texels.places.described(&self.settings));
        warnings.extend(texels.transfer.glossy.as_ref().map(Glossy::described));
        if self.leaves_objects {
            warnings.push(
                "objects that another technique lights get no light of radiance-transfer: set its bounces to 1"
                    .into(),
            );
        }
        Inspection {
            maps: texels.maps(),
            work_bytes: texels.work_bytes(),
            warnings,
        }
    }

    fn resumable(&mut self) -> Option<&mut dyn Resume> {
        Some(self)
    }
}

impl Precomputed for RadianceTransfer {
    const INFO: &'static Info = &INFO;

    type Stored = TransferVectors;

    fn refusal(name: &str, value: &str) -> Option<&'static str> {
        let is_glossy = name == "glossy" && !value.is_empty();
        let refused = [
            ("basis", "haar"),
            ("compressed", "true"),
            ("at", "vertices"),
        ];
        (is_glossy || refused.contains(&(name, value)))
            .then_some("files hold harmonics of texels that are not compressed, and no matrices")
    }

    fn finished(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        atlas: Arc<Atlas>,
    ) -> Result<TransferVectors, GpuError> {
        let saved = match self.texels.get() {
            Some(texels) => texels.save(gpu)?,
            None => None,
        };
        let saved = saved.ok_or_else(|| INFO.unfit("the transfer vectors are not complete"))?;
        stored::finished(gpu, scene, atlas, &self.settings, &saved.transfer)
    }
}

impl Resume for RadianceTransfer {
    fn save(&self, gpu: &Gpu) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(texels) = self.texels.get() else {
            return Ok(None);
        };
        let Some(saved) = texels.save(gpu)? else {
            return Ok(None);
        };
        postcard::to_allocvec(&saved)
            .map(Some)
            .map_err(|error| INFO.unfit(error))
    }

    fn resume(&mut self, gpu: &Gpu, saved: &[u8]) -> Result<bool, GpuError> {
        let saved: Saved = postcard::from_bytes(saved).map_err(|error| INFO.unfit(error))?;
        let Some(texels) = self.texels.get_mut() else {
            return Ok(false);
        };
        texels
            .resume(gpu, &saved)
            .map_err(|error| INFO.unfit(error))?;
        Ok(true)
    }
}
