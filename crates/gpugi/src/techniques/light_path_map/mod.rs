//! Light path maps: indirect light of a still scene under lights that move, appear and change colour, from maps that
//! are computed once (tutorial section 7.3).
//!
//! Generate: virtual lights of entry points, found by random walks, light the texels of an atlas, cluster by cluster, a
//! few steps per frame: panes. Earlier techniques light the entry points, and the panes, weighted by that light, add up
//! to the irradiance of the texels. Gather: looks up the irradiance at a point's place in the atlas.
//! docs/techniques/light-path-map.md.

mod clusters;
mod entries;
mod entry_points;
pub(crate) mod gpu;
mod maps;
mod panes;
mod settings;
mod stored;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use gpugi_scene::{Atlas, LightPathPanes, Scene};

use super::precomputed::Fit;
use super::{
    Cost, Earlier, Generated, Info, Inspection, Needs, OwnPoints, Plan, Precomputed, Registration,
    Resume, Role, Technique, Unready, atlas,
};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths, caustic_depth, overlap};
use crate::scene::{Claims, GpuScene, Inputs};
use crate::settings::SettingSet;
use crate::stage::{Same, Stage};
use maps::LightPathMaps;
pub use settings::{Clustering, Settings, Store, Visibility};

/// Light paths of any length.
const ALL: &str = "LDD+E";

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "light-path-map",
    summary: "indirect light of a still scene under lights that move and change, from maps made once",
    source: "tutorial section 7.3; Szécsi et al. 2006; Keller 1997",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LS*DD+E"),
        LightPaths::new(LightClass::Area, "LS*DD+E"),
        LightPaths::new(LightClass::Environment, "LS*DD+E"),
    ],
    role: Role::Indirect,
    needs: Needs::TEXELS,
    cost: Cost::Precomputation,
    lights_points: OwnPoints::Irradiance,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(LightPathMap::default())),
    suits: |_| None,
    settings: |_| Vec::new(),
};

/// Light path maps.
#[derive(Debug)]
pub struct LightPathMap {
    settings: Settings,
    /// In an atlas, by [`Settings::of_panes`] and [`GpuScene::ray_features`].
    maps: Stage<(Settings, Same<Atlas>, [bool; 3]), LightPathMaps>,
    /// Whether the panes of the scene's file fit it.
    fit: Fit,
    /// Most texels per buffer of points.
    most_texels: u32,
}

impl Default for LightPathMap {
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            maps: Stage::default(),
            fit: Fit::default(),
            most_texels: u32::MAX,
        }
    }
}

impl LightPathMap {
    /// The panes that the scene's file holds, if they are wanted and still those of the scene.
    fn stored(&mut self, scene: &GpuScene) -> Option<Arc<LightPathPanes>> {
        let host = scene.host()?;
        let panes = host.panes.as_ref().filter(|_| self.settings.stored);
        let now = scene.versions.of(Inputs::SURFACES | Inputs::INSTANCES);
        self.fit.of(panes, now, |panes| panes.check(host))
    }
}

impl Technique for LightPathMap {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        let stored = self.stored(scene);
        let pattern = match self.settings.with(stored.as_deref()).depth {
            Settings::DEEPEST => ALL.to_owned(),
            // Rays to near surfaces add a reflection.
            depth => format!("LD{{2,{}}}E", depth + 3),
        };
        let mut paths = Vec::new();
        for class in LightClass::ALL {
            let light = LightPaths {
                class,
                pattern: pattern.clone().into(),
            };
            let caustics = caustic_depth(covered, class);
            if caustics > 0 {
                paths.push(light.after(&format!("S{{1,{caustics}}}")));
            }
            if overlap(covered, &[LightPaths::new(class, "LDE")]).is_some() {
                paths.push(light);
            }
        }
        Plan::adding(paths, scene)
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
        let atlas = match &stored {
            Some(stored) => Arc::clone(&stored.atlas),
            None => {
                // Or four floats, of irradiance.
                let bytes = (u64::from(settings.near_rays) * gpu::NEAR_BYTES).max(16);
                let size = (settings.resolution, settings.density);
                atlas(gpu, scene, INFO.name, size, bytes)?
            }
        };
        let key = (
            settings.of_panes(),
            Same(atlas.clone()),
            scene.ray_features(),
        );
        let maps = self.maps.compiled(frame, key, |_| {
            LightPathMaps::new(gpu, scene, settings, &atlas, stored, self.most_texels)
        })?;
        Ok(maps.generate(frame, scene, settings, earlier)?)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        match self.maps.get() {
            Some(maps) => maps.gather(frame, scene, receiver),
            None => Ok(()),
        }
    }

    fn inspect(&self) -> Inspection {
        let unfit = self.fit.reason().map(|reason| {
            format!("new panes are computed, because those of the file do not fit: {reason}")
        });
        self.maps
            .get()
            .map_or_else(Inspection::default, |maps| Inspection {
                maps: maps.maps(),
                work_bytes: maps.work_bytes(),
                warnings: unfit.into_iter().collect(),
            })
    }

    fn resumable(&mut self) -> Option<&mut dyn Resume> {
        Some(self)
    }
}

impl Precomputed for LightPathMap {
    const INFO: &'static Info = &INFO;

    type Stored = LightPathPanes;

    fn refusal(name: &str, _: &str) -> Option<&'static str> {
        match name {
            "panes" | "left-out" => Some("it changes how panes are added, not what a file holds"),
            "store" => Some("files hold panes as rgb9e5"),
            _ => None,
        }
    }

    fn finished(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        atlas: Arc<Atlas>,
    ) -> Result<LightPathPanes, GpuError> {
        let maps = self.maps.get().filter(|maps| maps.panes.is_done());
        let maps = maps.ok_or_else(|| INFO.unfit("the panes are not complete"))?;
        stored::finished(gpu, scene, atlas, maps)
    }
}

impl Resume for LightPathMap {
    fn save(&self, gpu: &Gpu) -> Result<Option<Vec<u8>>, GpuError> {
        let maps = self.maps.get();
        let Some(maps) = maps.filter(|maps| maps.panes.panes_done() > 0) else {
            return Ok(None);
        };
        let panes = maps.panes.save(gpu)?;
        postcard::to_allocvec(&panes)
            .map(Some)
            .map_err(|error| INFO.unfit(error))
    }

    fn resume(&mut self, gpu: &Gpu, saved: &[u8]) -> Result<bool, GpuError> {
        let saved: Vec<u32> = postcard::from_bytes(saved).map_err(|error| INFO.unfit(error))?;
        match self.maps.get_mut() {
            Some(maps) => maps
                .panes
                .resume(gpu, &saved)
                .map_err(|error| INFO.unfit(error)),
            None => Ok(false),
        }
    }
}
