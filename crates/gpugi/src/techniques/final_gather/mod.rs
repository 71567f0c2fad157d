//! Final gathering: indirect light from the area lights that a few reference points see (tutorial section 6.2).
//!
//! Generate: cubes around reference points capture the scene, lit by the techniques before this one; downsampled, every
//! texel of a small cube is an area light with a position, a normal and a size. Light bounces on among them. Gather: a
//! point sums the lights of the reference points near it. docs/techniques/final-gather.md.

pub(crate) mod gpu;
mod lit_probes;
mod maps;
mod objects;
mod own;
mod places;
mod settings;

use super::{
    Claimed, Earlier, Generated, Info, Inspection, OwnPoints, Plan, Provided, Purpose,
    Registration, Role, Technique, Unready,
};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, GpuError};
use crate::light_paths::{LightClass, LightPaths, caustic_depth, overlap};
use crate::scene::{Claims, GpuScene};
use crate::settings::SettingSet;
use crate::stage::Stage;
use lit_probes::{LitProbes, ProbePlan};
use places::Places;
pub use settings::{Blend, ReferencePoints, Settings, SolidAngle, Visibility};

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "final-gather",
    summary: "indirect light from area lights that a few reference points see, without an atlas and without rays",
    source: "tutorial section 6.2; Szirmay-Kalos and Lazányi 2006",
    caveat: "its light is interpolated between reference points: among many small objects, some may be missing",
    paths: &[
        LightPaths::new(LightClass::Punctual, "L[DGS]*[DG]E"),
        LightPaths::new(LightClass::Area, "L[DGS]*[DG]E"),
        LightPaths::new(LightClass::Environment, "L[DGS]*[DG]E"),
    ],
    role: Role::Indirect,
    lights_points: OwnPoints::Irradiance,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(FinalGather::default())),
    suits: |occasion| {
        let reason = match occasion.purpose {
            // Light in an atlas is noisy while things move, and whenever meshes change the frame waits for another atlas.
            Purpose::LiveView => "it follows what moves, without an atlas",
            Purpose::StillPicture | Purpose::Bake => "it needs no atlas",
        };
        Some(reason.to_owned())
    },
    settings: |occasion| match occasion.purpose {
        // One of eight reference points, drawn per pixel, takes a third of the time of all.
        Purpose::LiveView => vec![("blend", "drawn".to_owned())],
        Purpose::StillPicture | Purpose::Bake => Vec::new(),
    },
};

/// Final gathering.
#[derive(Debug, Default)]
pub struct FinalGather {
    settings: Settings,
    own: ProbePlan,
    /// Objects with a reference point, and the number of those that got none.
    claimed: Claimed,
    left_over: usize,
    lights: Stage<lit_probes::Key, LitProbes>,
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
        let of_class = covered.iter().filter(|paths| paths.class == class);
        if self.settings.glossy {
            // Cubes see all that the techniques before this one add.
            let more = format!("{middle}{last}");
            paths.extend(of_class.map(|paths| paths.continued(&more)));
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
        let is_indirect = |paths: &&LightPaths| adds(std::slice::from_ref(*paths), class, "LDDE");
        paths.extend(
            of_class
                .filter(is_indirect)
                .map(|paths| paths.continued("D")),
        );
        paths
    }

    /// Chooses the objects that get a reference point: the named ones, or the largest where the settings name none.
    fn claim(&mut self, scene: &GpuScene) {
        let list = &self.settings.objects;
        let named = scene.objects.iter().enumerate();
        let named = named.filter(|(_, object)| object.is_named_by(list));
        let mut claimed: Vec<u32> = named.map(|(index, _)| index as u32).collect();
        let most = lit_probes::MOST_OBJECTS as usize;
        if list == settings::ALL && claimed.len() > most {
            // Rotations do not change the diagonal of a mesh's box, so what turns does not change the choice.
            let mut size = vec![0.0; scene.objects.len()];
            for draw in &scene.draws {
                let extent = draw.mesh_bounds.max - draw.mesh_bounds.min;
                let index = draw.instance as usize;
                let world_from_mesh = scene.placements[index].world_from_mesh;
                size[index] = world_from_mesh.transform_vector3(extent).length();
            }
            let size_of = |index: &u32| size[*index as usize];
            claimed.sort_by(|a, b| f32::total_cmp(&size_of(b), &size_of(a)));
            self.left_over = claimed.len() - most;
            claimed.truncate(most);
            claimed.sort_unstable();
        }
        self.claimed = Claimed::new(&claimed, scene);
    }

    /// Says how many objects have no reference point.
    fn left_over_warning(&self) -> Option<String> {
        (self.left_over > 0).then(|| {
            format!(
                "only the {} largest of {} objects have reference points: final-gather.objects names others",
                self.claimed.objects().len(),
                self.claimed.objects().len() + self.left_over
            )
        })
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

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        let mut classes = LightClass::ALL.into_iter();
        let is_covered = classes.any(|class| adds(covered, class, "LDDE"));
        let places = match self.settings.reference_points {
            ReferencePoints::Auto if is_covered => Places::Objects,
            ReferencePoints::Auto | ReferencePoints::Grid => Places::Grid,
            ReferencePoints::Objects => Places::Objects,
            ReferencePoints::Camera => Places::Camera,
        };
        self.own = ProbePlan {
            places,
            emission: !adds(covered, LightClass::Area, "LDE"),
            environment: !adds(covered, LightClass::Environment, "LDE"),
            bounces: !is_covered,
        };
        let mut paths = Vec::new();
        for class in LightClass::ALL {
            paths.extend(self.paths(class, covered));
        }
        self.claimed = Claimed::default();
        let lights = 6 * self.settings.size * self.settings.size;
        let points = match (places, self.settings.blend) {
            (Places::Grid, Blend::All) => 8,
            _ => 1,
        };
        let mut plan = Plan {
            lookups: points * lights,
            ..Plan::adding(paths, scene)
        };
        if self.settings.occlusion {
            plan.needs = Some((Provided::Openness, "occlusion"));
        }
        self.left_over = 0;
        if places == Places::Objects {
            self.claim(scene);
            for index in self.claimed.numbers() {
                plan.claims[index as usize] = Claims::INDIRECT;
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
    ) -> Result<Generated, Unready> {
        if self.claimed.objects().is_empty() && self.own.places == Places::Objects {
            self.lights.clear();
            return Ok(Generated::FINAL);
        }
        let (gpu, before) = (frame.gpu, self.lights.begun());
        let key = lit_probes::key(&self.settings, self.own, &self.claimed, scene, before);
        let capture = earlier.shared.impostors.capture_kernels();
        let lights = self.lights.compiled(frame, key.clone(), |_| {
            LitProbes::new(gpu, scene, capture, key)
        })?;
        let eye = view.world_from_view.w_axis.truncate();
        Ok(lights.generate(frame, scene, eye, earlier)?)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        match self.lights.get_mut() {
            Some(lights) => lights.gather(frame, scene, receiver),
            None => Ok(()),
        }
    }

    fn inspect(&self) -> Inspection {
        let inspection = self
            .lights
            .get()
            .map_or_else(Inspection::default, LitProbes::inspect);
        Inspection {
            warnings: self.left_over_warning().into_iter().collect(),
            ..inspection
        }
    }
}
