//! Distance impostors: reflections and refractions of surroundings at their true distances (tutorial sections 5.1 to
//! 5.3).
//!
//! Generate: for each object, a cube around a reference point captures its surroundings, lit by the techniques before
//! this one, with their distances; for a refractor also its own shape. Gather: reflected and refracted rays search for
//! their hits in these maps. docs/techniques/distance-impostor.md.

mod default_set;
mod groups;
mod impostor;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::convert::Infallible;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::{
    AUTO, Claimed, Earlier, Generated, Info, Inspection, LightState, Map, OwnPoints, Plan,
    Registration, Role, Technique, Unready, chooses, named,
};
use crate::capture::{Output, Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::impostor::{Renew, Renewal};
use crate::light_paths::{LightClass, LightPaths, SEEN_LIGHTS, shown};
use crate::scene::{Claims, GpuScene, Object};
use crate::settings::{Kind, SettingSet, SettingValue};
use crate::stage::Stage;
use groups::{Group, Kind as GroupKind};
use impostor::{FrameInputs, Impostor, Kernels};

/// Lit surroundings in mirrors, glass and gloss, and lights in mirrors and glass.
const SURROUNDINGS: &str = "L(S|[DG][GS])[GS]*E";

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "distance-impostor",
    summary: "localized reflections, sharp or blurred, and multiple refractions of lit surroundings, on chosen objects",
    source: "tutorial sections 5.1 to 5.3; Szirmay-Kalos et al. 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, SURROUNDINGS),
        LightPaths::new(LightClass::Area, SURROUNDINGS),
        LightPaths::new(LightClass::Environment, SURROUNDINGS),
    ],
    role: Role::Gloss,
    lights_points: OwnPoints::TowardEye,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |gpu, scene| Ok(Box::new(DistanceImpostor::new(gpu, scene)?)),
    suits: default_set::suits,
    settings: default_set::settings,
};

crate::choices! {
    /// How hits are searched for.
    pub enum Search {
        /// A walk through all cells that the ray may meet: finds everything that is as wide as a texel.
        Walk = "walk",
        /// The tutorial's first version: secant, then false position.
        Secant = "secant",
        /// The tutorial's second version: false position.
        FalsePosition = "false-position",
        /// The secant method proper: always through the last two guesses.
        PureSecant = "pure-secant",
        /// No search: surroundings count as infinitely far, as in classical environment mapping.
        None = "none",
    }
}

impl Search {
    /// The `SEARCH_` constant of impostor/maps.wesl; for `None` that of the default, which is not read.
    fn number(self) -> u32 {
        match self {
            Self::Walk | Self::None => 0,
            Self::Secant => 1,
            Self::FalsePosition => 2,
            Self::PureSecant => 3,
        }
    }
}

crate::choices! {
    /// How rough lobes read their cube.
    pub enum Lobes {
        /// The mean over the lobe, at the level whose texels are as wide as the lobe at its hit.
        Filtered = "filtered",
        /// One direction, drawn by its weight in the lobe: the mean over many samples of a picture is exact. What is not
        /// a camera's pixel has the mean over the lobe.
        Drawn = "drawn",
    }
}

crate::choices! {
    /// What the gather adds.
    pub enum Show {
        /// Light.
        Light = "light",
        /// A colour for the certainty of hits: green if the reference point sees the hit; yellow if it sees the hit,
        /// but not all of the ray before it; red if it does not see the hit; blue if the second layer holds the hit;
        /// grey if there is no hit.
        Certainty = "certainty",
    }
}

/// A point, or the centre of each object.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Reference(pub Option<Vec3>);

impl TryFrom<String> for Reference {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        if text == AUTO {
            return Ok(Self(None));
        }
        let numbers: Option<Vec<f32>> = text
            .split(',')
            .map(|word| {
                word.trim()
                    .parse()
                    .ok()
                    .filter(|number: &f32| number.is_finite())
            })
            .collect();
        match numbers.as_deref() {
            Some(&[x, y, z]) => Ok(Self(Some(Vec3::new(x, y, z)))),
            _ => Err("auto, or three numbers with commas between".into()),
        }
    }
}

impl From<Reference> for String {
    fn from(reference: Reference) -> Self {
        match reference.0 {
            None => AUTO.into(),
            Some(point) => format!("{},{},{}", point.x, point.y, point.z),
        }
    }
}

/// `changed`, `every-frame`, or a number of frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Often(pub Renew);

impl TryFrom<String> for Often {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        match text.as_str() {
            "changed" => Ok(Self(Renew::Changed(1))),
            "every-frame" => Ok(Self(Renew::EveryFrame)),
            number => match number.parse() {
                Ok(frames) if frames > 0 => Ok(Self(Renew::Changed(frames))),
                _ => Err("changed, every-frame, or a number of frames from 1 on".into()),
            },
        }
    }
}

impl From<Often> for String {
    fn from(often: Often) -> Self {
        match often.0 {
            Renew::EveryFrame => "every-frame".into(),
            Renew::Changed(1) => "changed".into(),
            Renew::Changed(frames) => frames.to_string(),
        }
    }
}

impl SettingValue for Reference {
    const KIND: Kind = Kind::Text;
}

impl SettingValue for Often {
    const KIND: Kind = Kind::Text;
}

crate::settings! {
    /// Settings of distance impostors.
    pub struct Settings {
        /// Side of the faces of the surroundings' cubes, a power of two.
        pub resolution: u32 = 256 => in_range(16.0, 1024.0).power_of_two().unit("texels"),
        /// Side of the faces of refractors' shapes, a power of two.
        pub shape_resolution: u32 = 256 => in_range(16.0, 1024.0).power_of_two().unit("texels"),
        /// How hits are searched for: walk; secant, then false position; false-position; pure-secant; or none, classical
        /// environment mapping.
        pub search: Search = Search::Walk => any(),
        /// Steps of the searches secant, false-position and pure-secant.
        pub iterations: u32 = 4 => in_range(0.0, 64.0),
        /// Most surfaces that light meets inside a refractor; 0: it refracts once, on its way in.
        pub bounces: u32 = 4 => in_range(0.0, 16.0),
        /// Layers of the cubes; 2: they also hold what lies behind the surfaces that the reference point sees, for
        /// search=walk; 1: they do not.
        pub layers: u32 = 1 => in_range(1.0, 2.0),
        /// What the image shows: light, or certainty, colours for the certainty of hits.
        pub show: Show = Show::Light => any(),
        /// Point that cubes are captured from: x,y,z, or auto, the centre of each object.
        pub reference: Reference = Reference(None) => any().unit("m"),
        /// When surroundings are captured and lit again: every-frame; changed, when something changed; or a number of
        /// frames, when something changed, but at most once in that many frames.
        pub renew: Often = Often(Renew::Changed(1)) => any(),
        /// If an object moves less than this, its surroundings stay as they are.
        pub threshold: f32 = 0.0 => in_range(0.0, 1e9).unit("m"),
        /// Faces of a cube that are renewed per frame; the others follow in the next frames.
        pub faces_per_frame: u32 = 6 => in_range(1.0, 6.0),
        /// How rough lobes read their cube: filtered, the mean over the lobe; or drawn, one direction per sample, whose
        /// mean is exact.
        pub lobes: Lobes = Lobes::Filtered => any(),
        /// Most cubes. If there are more objects, those near each other share one; refractors have their own or none.
        pub cubes: u32 = 16 => in_range(3.0, 32.0),
        /// Objects with impostors: names separated by commas, * for any characters; auto: those with ideal surfaces.
        pub objects: String = AUTO.to_owned() => any(),
    }
}

impl Settings {
    /// Layers that the search reads: the tutorial's searches have only one.
    fn layers_searched(&self) -> u32 {
        if self.search == Search::Walk {
            self.layers
        } else {
            1
        }
    }

    fn renewal(&self) -> Renewal {
        Renewal {
            renew: self.renew.0,
            threshold: self.threshold,
            faces: self.faces_per_frame,
        }
    }
}

/// How often the cubes of several objects are lit when the scene changed: those lit first do not show yet what the
/// others reflect.
const ROUNDS: u32 = 2;
/// Most ideal reflections and refractions of a declared path.
const MOST_BOUNCES: u32 = 32;

/// Distance impostors.
#[derive(Debug)]
pub struct DistanceImpostor {
    settings: Settings,
    kernels: Kernels,
    /// Objects that are to have an impostor.
    wanted: Claimed,
    /// By the most there may be; they stay while objects move.
    groups: Stage<(u32, Claimed), Vec<Group>>,
    set: Stage<(Settings, Claimed, Vec<Group>), ImpostorSet>,
}

/// The impostors, and the order in which they are lit.
#[derive(Debug, Default)]
struct ImpostorSet {
    /// The light of other techniques in the last frame.
    light: Stage<LightState>,
    /// [`crate::techniques::EarlierLight::revision`] of the last frame.
    revision: u64,
    impostors: Vec<Impostor>,
    /// Indices of the impostors to light, in order; what a frame's budget does not allow stays for the next.
    queue: VecDeque<usize>,
    /// Length of the queue at first.
    queued: usize,
    /// The impostor with which a new queue begins: the next in turn if the last queue was given up half-way.
    next: usize,
    /// Counts the queues that were finished in a later frame.
    finished: u64,
    /// Work of the queue.
    waiting: u64,
}

impl DistanceImpostor {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            settings: Settings::default(),
            kernels: Kernels::new(gpu, scene)?,
            wanted: Claimed::default(),
            groups: Stage::default(),
            set: Stage::default(),
        })
    }

    fn impostors(&self) -> impl Iterator<Item = &Impostor> {
        self.set.get().into_iter().flat_map(|set| &set.impostors)
    }
}

impl Technique for DistanceImpostor {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], claimed: &[Claims]) -> Plan {
        let objects = scene.objects.iter().enumerate();
        let list = self.settings.objects.as_str();
        let is_wanted =
            |object: &Object| chooses(list, object, object.is_smooth, !object.is_diffuse);
        let is_traced = |index| {
            let claims: Option<&Claims> = claimed.get(index);
            claims.is_some_and(|claims| claims.contains(Claims::RAYS))
        };
        let wanted = objects.filter(|(index, object)| is_wanted(object) && !is_traced(*index));
        let wanted: Vec<u32> = wanted.map(|(index, _)| index as u32).collect();
        self.wanted = Claimed::new(&wanted, scene);
        let most = self.settings.cubes;
        let Ok(all) = self.groups.keep((most, self.wanted.clone()), |_| {
            Ok::<_, Infallible>(groups::groups(&wanted, scene, most as usize))
        });
        let mut claims = vec![Claims::NONE; scene.objects.len()];
        for (number, group) in (1..).zip(&*all) {
            // The cubes of rough objects hold no emitters, so transmission through rough objects is left to other
            // techniques.
            let claim = match group.kind {
                GroupKind::Rough | GroupKind::Surroundings => Claims::GLOSSY,
                GroupKind::Mirror => Claims::SPECULAR,
                GroupKind::Refractor => {
                    Claims::SPECULAR | Claims::TRANSMISSION | Claims::REFRACTION
                }
            };
            for &member in &*group.members {
                claims[member as usize] = claim.with_impostor(number);
            }
        }
        let has = |kind| all.iter().any(|group| group.kind == kind);
        let refracts = has(GroupKind::Refractor);
        let is_smooth = refracts || has(GroupKind::Mirror);
        let is_rough = has(GroupKind::Rough) || has(GroupKind::Surroundings);
        // A texture may make parts of a rough object ideal.
        let is_partly_smooth = all.iter().any(Group::has_ideal_lobes);
        let lobes = [is_smooth || is_partly_smooth, is_rough];
        // A single refraction represents those on the way in and out.
        let own = if refracts {
            self.settings.bounces.max(1) + 1
        } else {
            1
        };
        // Cubes show other objects, whose cubes in turn show this one.
        let rounds = if all.len() > 1 { ROUNDS + 1 } else { 1 };
        let most = (own * rounds).min(MOST_BOUNCES);
        let mut paths = Vec::new();
        if !all.is_empty() {
            // Light on the surroundings, and lights seen directly; the latter only in smooth objects, and not in smooth
            // objects that rough ones show: those are caustics, which other techniques add.
            paths.extend(shown(covered, lobes, most));
            if is_smooth {
                paths.extend(shown(&SEEN_LIGHTS, [true, false], most));
            }
        }
        Plan {
            paths,
            claims,
            object_names: named(&self.settings.objects),
            lookups: all.len() as u32,
            needs: None,
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
        view: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        let groups = self.groups.get().map_or(&[][..], Vec::as_slice);
        let key = (self.settings.clone(), self.wanted.clone(), groups.to_vec());
        let set = self.set.keep(key, |_| {
            let groups = (1..).zip(groups);
            let impostors = groups
                .map(|(number, group)| Impostor::new(frame.gpu, &self.settings, number, group));
            Ok::<_, GpuError>(ImpostorSet {
                impostors: impostors.collect::<Result<_, _>>()?,
                ..ImpostorSet::default()
            })
        })?;
        let is_every_frame = self.settings.renew.0 == Renew::EveryFrame;
        // A different seed in every frame, so that random decisions vary.
        let seed = if is_every_frame {
            let view = &view.uniform;
            view.seed
                .wrapping_add(view.sample_index.wrapping_mul(0x85eb_ca6b))
        } else {
            0
        };
        let light = earlier.light.state(scene);
        let is_refined = set.revision != light.revision;
        set.revision = light.revision;
        let is_changed = set.light.ask(light.however_refined());
        let making = FrameInputs {
            scene,
            kernels: &self.kernels,
            settings: &self.settings,
            seed,
            eye: Vec3::from_array(view.uniform.origin),
            is_refined,
        };
        let ImpostorSet {
            impostors,
            queue,
            queued,
            next,
            finished,
            waiting,
            ..
        } = set;
        for impostor in &mut *impostors {
            impostor.follow(frame.gpu, making, earlier)?;
        }
        let is_left = !queue.is_empty();
        let is_new = impostors.iter().enumerate().any(|(index, impostor)| {
            // What waits already need not begin again unless something has changed since.
            let is_other = is_changed || is_refined || is_every_frame || !queue.contains(&index);
            impostor.is_due() && is_other
        });
        for &index in &*queue {
            impostors[index].light_whole();
        }
        let are_several = impostors.len() > 1;
        if is_left && !is_new {
            // The queue goes on.
        } else if are_several && impostors.iter().any(Impostor::is_in_turn) {
            for impostor in &mut *impostors {
                impostor.next_turn = 0;
            }
        } else if impostors.iter().all(|impostor| impostor.due.is_none()) {
            for impostor in &mut *impostors {
                impostor.once_more();
            }
        }
        // If light was only refined, or cubes are renewed in every frame, one round suffices: light passes on from
        // frame to frame.
        let rounds = if are_several && (is_changed || !(is_every_frame || is_refined)) {
            ROUNDS
        } else {
            1
        };
        let count = impostors.len();
        if is_new || !is_left {
            queue.clear();
            for round in 0..rounds {
                let in_turn = (0..count).map(|offset| (*next + offset) % count);
                queue.extend(in_turn.filter(|&index| {
                    let one = &impostors[index];
                    match round {
                        0 => one.is_due(),
                        _ => one.due.is_some() && !one.is_in_turn(),
                    }
                }));
            }
            *queued = queue.len();
        }
        // A cube is captured and lit in one frame, so that distances and light are of the same time. Cubes that wait keep
        // the earlier ones of both. One that is in the queue again is lit briefly.
        let (mut taken, mut work) = (Vec::new(), 0_u64);
        while let Some(&index) = queue.front()
            && earlier.budget.may_step_after(work)
        {
            queue.pop_front();
            let is_brief = queue.contains(&index);
            work = work.saturating_add(impostors[index].work(earlier, is_brief));
            *next = (index + 1) % count;
            taken.push((index, is_brief));
        }
        let is_taken =
            |taken: &[(usize, bool)], index| taken.iter().any(|&(other, _)| other == index);
        for (index, impostor) in impostors.iter().enumerate() {
            if impostor.is_captured && !is_taken(&taken, index) {
                if let Some(place) = queue.iter().position(|&waiting| waiting == index) {
                    queue.remove(place);
                }
                taken.push((index, queue.contains(&index)));
            }
        }
        for (index, impostor) in impostors.iter_mut().enumerate() {
            impostor.show(frame, making, earlier, is_taken(&taken, index))?;
        }
        for (index, is_brief) in taken {
            let (before, rest) = impostors.split_at_mut(index);
            let Some((this, after)) = rest.split_first_mut() else {
                break;
            };
            let kernel = self.kernels.gather_into(this.kind, self.settings.show);
            this.light(frame, making, earlier, is_brief, |frame, receiver| {
                let others = before.iter().chain(&*after);
                let others = others.filter(|impostor| impostor.is_lit);
                add(frame, scene, (&self.kernels, kernel), receiver, others)
            })?;
        }
        if queue.is_empty() {
            *next = 0;
            *finished += u64::from(is_left);
        }
        let of_queue = queue.iter().enumerate().map(|(place, index)| {
            let is_brief = queue.range(place + 1..).any(|later| later == index);
            impostors[*index].work(earlier, is_brief)
        });
        *waiting = of_queue.sum();
        let is_lit = impostors.iter().all(|impostor| impostor.is_lit);
        Ok(Generated {
            revision: *finished,
            progress: 1.0 - queue.len() as f32 / (*queued).max(1) as f32,
            pending: (!is_lit).then_some("the light around objects"),
        })
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        // Reflections and refractions exist toward an eye only.
        if receiver.points.output != Output::RadianceToEye {
            return Ok(());
        }
        let kernels = (&self.kernels, self.kernels.gather(self.settings.show));
        add(frame, scene, kernels, receiver, self.impostors())
    }

    fn waiting(&self) -> u64 {
        self.set.get().map_or(0, |set| set.waiting)
    }

    fn inspect(&self) -> Inspection {
        let textures = self.impostors().flat_map(Impostor::textures);
        let maps = textures.map(|(name, texture)| Map::of_texture(name, texture));
        Inspection::of(maps)
    }
}

/// Adds what the objects of `impostors` mirror and refract, with the last of the passes.
fn add<'a>(
    frame: &mut Frame<'_>,
    scene: &GpuScene,
    (kernels, gather): (&Kernels, &Kernel),
    receiver: &Receiver,
    mut impostors: impl Iterator<Item = &'a Impostor>,
) -> Result<(), GpuError> {
    frame.compute("distance-impostor.gather", |pass| {
        impostors.try_for_each(|impostor| impostor.gather(pass, scene, kernels, gather, receiver))
    })
}
