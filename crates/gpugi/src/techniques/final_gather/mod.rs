//! Final gathering: indirect light from the area lights that a few reference points see (tutorial section 6.2).
//!
//! Generate: cubes around reference points capture the scene, lit by the techniques before this one; downsampled, every
//! texel of a small cube is an area light with a position, a normal and a size. Light bounces on among them. Gather: a
//! point sums the lights of the reference points near it. docs/techniques/final-gather.md.

pub(crate) mod gpu;
mod made;
mod maps;
mod objects;
mod places;
mod points;
mod settings;
#[cfg(test)]
mod tests;

use super::{Earlier, Generated, Info, Inspection, Plan, Technique};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, GpuError};
use crate::light_paths::{LightClass, LightPaths, caustic_depth, overlap};
use crate::scene::{Claims, GpuScene};
use crate::settings::SettingSet;
use made::{Made, Own};
use places::Places;
pub use settings::{Blend, ReferencePoints, Settings, SolidAngle, Visibility};

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "final-gather",
    summary: "indirect light from area lights that a few reference points see, without an atlas and without rays",
    source: "tutorial section 6.2; Szirmay-Kalos and Lazányi 2006",
    paths: &[
        LightPaths::new(LightClass::Punctual, "L[DGS]*[DG]E"),
        LightPaths::new(LightClass::Area, "L[DGS]*[DG]E"),
        LightPaths::new(LightClass::Environment, "L[DGS]*[DG]E"),
    ],
    // Default sets choose it by themselves, where radiosity does not serve.
    suits: |_| false,
    keeps_texels: false,
    lights_points: true,
};

/// Final gathering.
#[derive(Debug, Default)]
pub struct FinalGather {
    settings: Settings,
    own: Own,
    /// Instances with a reference point.
    claimed: Vec<u32>,
    made: Option<Made>,
}

impl FinalGather {
    /// The light of one class that it adds beside `covered`.
    fn paths(&self, class: LightClass, covered: &[LightPaths]) -> Vec<LightPaths> {
        let is_own = match class {
            LightClass::Punctual => false,
            LightClass::Area => self.own.emission,
            LightClass::Environment => self.own.environment,
        };
        let has_bounces = self.settings.bounces > 0 && self.own.bounces;
        let middle = if has_bounces { "D*" } else { "" };
        let last = if self.settings.glossy { "[DG]" } else { "D" };
        let new = |pattern: String| LightPaths {
            class,
            pattern: pattern.into(),
        };
        let mut paths = Vec::new();
        if is_own {
            // What is emitted is reflected diffusely before it is seen again.
            paths.push(new(format!("L{middle}{last}E")));
        }
        let of_class = covered.iter().filter(|one| one.class == class);
        if self.settings.glossy {
            // Cubes see all that the techniques before this one add.
            let more = format!("{middle}{last}");
            paths.extend(of_class.map(|one| one.continued(&more)));
            return paths;
        }
        // Cubes see the diffuse part of it.
        if !is_own && adds(covered, class, "LDE") {
            paths.push(new(format!("LD{middle}DE")));
        }
        let caustics = caustic_depth(covered, class);
        if caustics > 0 {
            paths.push(new(format!("LS{{1,{caustics}}}D{middle}DE")));
        }
        let is_indirect = |one: &&LightPaths| adds(std::slice::from_ref(*one), class, "LDDE");
        paths.extend(of_class.filter(is_indirect).map(|one| one.continued("D")));
        paths
    }
}

/// Whether a set of light paths has a path of this class.
fn adds(paths: &[LightPaths], class: LightClass, path: &'static str) -> bool {
    overlap(paths, &[LightPaths::new(class, path)]).is_some()
}

impl Technique for FinalGather {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths]) -> Plan {
        let mut classes = LightClass::ALL.into_iter();
        let is_covered = classes.any(|class| adds(covered, class, "LDDE"));
        let places = match self.settings.reference_points {
            ReferencePoints::Auto if is_covered => Places::Objects,
            ReferencePoints::Auto | ReferencePoints::Grid => Places::Grid,
            ReferencePoints::Objects => Places::Objects,
            ReferencePoints::Camera => Places::Camera,
        };
        self.own = Own {
            places,
            emission: !adds(covered, LightClass::Area, "LDE"),
            environment: !adds(covered, LightClass::Environment, "LDE"),
            bounces: !is_covered,
        };
        let mut paths = Vec::new();
        for class in LightClass::ALL {
            paths.extend(self.paths(class, covered));
        }
        self.claimed.clear();
        let lights = 6 * self.settings.size * self.settings.size;
        let points = match (places, self.settings.blend) {
            (Places::Grid, Blend::All) => 8,
            _ => 1,
        };
        let mut plan = Plan {
            lookups: points * lights,
            ..Plan::adding(paths, scene)
        };
        if places == Places::Objects {
            for (index, object) in scene.objects.iter().enumerate() {
                if object.is_named_by(&self.settings.objects) {
                    self.claimed.push(index as u32);
                    plan.claims[index] = Claims::INDIRECT;
                }
            }
            if self.settings.objects != settings::ALL {
                plan.object_names.clone_from(&self.settings.objects);
            }
        }
        plan
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
        view: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        if self.claimed.is_empty() && self.own.places == Places::Objects {
            self.made = None;
            return Ok(Generated::FINAL);
        }
        let (settings, own, claimed) = (&self.settings, self.own, &self.claimed);
        let is_made = |made: &Made| made.serves(settings, own, claimed, scene);
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => Made::new(frame.gpu, scene, earlier, settings, own, claimed)?,
        };
        let eye = view.world_from_view.w_axis.truncate();
        let generated = made.generate(frame, scene, eye, earlier)?;
        self.made = Some(made);
        Ok(generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        match &mut self.made {
            Some(made) => made.gather(frame, scene, receiver),
            None => Ok(()),
        }
    }

    fn inspect(&self) -> Inspection {
        let made = self.made.as_ref();
        made.map_or_else(Inspection::default, Made::inspect)
    }
}
