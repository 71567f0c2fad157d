//! The default techniques, chosen by the purpose of the light, by the scene and by the kind of adapter. What techniques
//! are for, need and cost decides ([`Info`]), and whether they say that they suit the occasion ([`Registration`]). The clock
//! plays no part, so a scene gets the same set on all adapters of a kind.

#[cfg(test)]
mod tests;

use std::cmp::Reverse;

use gpugi_scene::Scene;

use crate::gpu::{AdapterSummary, GpuError};
use crate::light_paths::{LightPaths, overlap};
use crate::lighting::LightingError;
use crate::scene::stand_apart;
use crate::techniques::{Info, Occasion, Purpose, Registration, Registry, Role, Speed, Values};

/// A technique of a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Name of the technique.
    pub technique: &'static str,
    /// Why it is in the set, in a few words.
    pub reason: String,
    /// Settings that differ from their defaults: names, and values as text.
    pub settings: Values,
}

/// A set of techniques.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DefaultSet {
    /// The techniques.
    pub choices: Vec<Choice>,
    /// Why the set is not the first choice: one sentence each.
    pub notes: Vec<String>,
}

impl DefaultSet {
    /// Names of the techniques.
    pub fn names(&self) -> Vec<String> {
        let choices = self.choices.iter();
        choices.map(|choice| choice.technique.to_owned()).collect()
    }

    /// The set for `purpose` in a scene that cannot be unwrapped, which only the attempt tells: `error` names a
    /// technique of this set that has no atlas. `None` if it is another error, or if no technique stands in for that one.
    pub fn without_atlas(
        &self,
        error: &LightingError,
        scene: &Scene,
        adapter: &AdapterSummary,
        purpose: Purpose,
        registry: &Registry,
    ) -> Option<Self> {
        let LightingError::Gpu(GpuError::Pass { pass, .. }) = error else {
            return None;
        };
        let mut choices = self.choices.iter();
        choices.find(|choice| choice.technique == pass)?;
        registry
            .find(pass)
            .filter(|registration| registration.info.needs.texels)?;
        let occasion = Occasion {
            has_atlas: false,
            ..Occasion::new(scene, adapter, purpose)
        };
        let mut set = chosen(occasion, registry);
        let names = self.names();
        let mut others = set.names().into_iter();
        let other = others.find(|name| !names.contains(name))?;
        set.notes.push(format!("{other} stands in for {error}"));
        Some(set)
    }
}

/// What makes a still picture, unless somebody chooses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StillPicture {
    /// The default set of techniques.
    Techniques,
    /// The path tracer: so many samples, or fewer once its estimated relative mean squared error falls to `noise`. Its
    /// picture is then denoised.
    PathTracer {
        /// Most samples per pixel.
        samples: u32,
        /// Enough, for its setting `noise`.
        noise: f64,
    },
}

impl StillPicture {
    /// What has the least error for its time in a scene, on this kind of adapter (docs/equal-time.md). On large GPUs the path
    /// tracer has traced hundreds of samples before the maps of techniques are final. In software, maps are cheaper than
    /// rays, but for fog around things, whose light techniques leave out in part. Others were not measured: there it is the
    /// techniques.
    pub fn of(scene: &Scene, adapter: &AdapterSummary) -> Self {
        let is_foggy = !scene.media.is_empty() && !stand_apart(scene);
        let samples = match Speed::of(adapter) {
            Speed::Fast => 512,
            Speed::Software if is_foggy => 64,
            Speed::Software | Speed::Modest => return Self::Techniques,
        };
        Self::PathTracer {
            samples,
            noise: 2e-4,
        }
    }
}

/// The techniques that light a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum Techniques {
    /// The scene's default set for a purpose.
    Default(Purpose),
    /// Those of a set, with its settings.
    Set(DefaultSet),
    /// Those of these names.
    Named(Vec<String>),
}

impl Techniques {
    /// No technique at all: emitters and the sky are seen.
    pub const NONE: Self = Self::Named(Vec::new());
}

impl From<Purpose> for Techniques {
    fn from(purpose: Purpose) -> Self {
        Self::Default(purpose)
    }
}

impl From<&DefaultSet> for Techniques {
    fn from(set: &DefaultSet) -> Self {
        Self::Set(set.clone())
    }
}

impl<S: AsRef<str>> From<&[S]> for Techniques {
    fn from(names: &[S]) -> Self {
        let names = names.iter().map(AsRef::as_ref);
        Self::Named(names.map(str::to_owned).collect())
    }
}

impl<S: AsRef<str>, const COUNT: usize> From<&[S; COUNT]> for Techniques {
    fn from(names: &[S; COUNT]) -> Self {
        Self::from(names.as_slice())
    }
}

impl<S: AsRef<str>> From<&Vec<S>> for Techniques {
    fn from(names: &Vec<S>) -> Self {
        Self::from(names.as_slice())
    }
}

/// The set for `purpose` on `adapter`, of the techniques in `registry` that are fast enough for the purpose and suit the
/// scene: those that stand side by side, such as direct light, and one each for gloss and for indirect light; or one that
/// adds everything, and what it leaves out.
pub fn default_set(
    scene: &Scene,
    adapter: &AdapterSummary,
    purpose: Purpose,
    registry: &Registry,
) -> DefaultSet {
    chosen(Occasion::new(scene, adapter, purpose), registry)
}

/// The set for an occasion.
fn chosen(mut occasion: Occasion<'_>, registry: &Registry) -> DefaultSet {
    let candidates = registry.all().iter();
    let mut candidates: Vec<_> = candidates
        .filter_map(|registration| Candidate::new(registration, &occasion))
        .collect();
    let is_everything = |candidate: &Candidate<'_>| candidate.info().role == Role::Everything;
    if candidates.iter().any(is_everything) {
        // What it leaves out stands beside it.
        let beside = [Role::Everything, Role::Caustics, Role::Media];
        candidates.retain(|candidate| beside.contains(&candidate.info().role));
    }
    let candidates = candidates.into_iter();
    let (mut chosen, rivals): (Vec<_>, Vec<_>) =
        candidates.partition(|candidate| candidate.rivalry == 0);
    for role in [Role::Gloss, Role::Indirect] {
        let of_role = rivals.iter().filter(|rival| rival.info().role == role);
        if let Some(best) = best(of_role.cloned().collect(), &chosen, &occasion) {
            occasion.has_rays |= best.info().needs.rays;
            chosen.push(best);
        }
    }
    let choices = chosen.into_iter().map(|candidate| Choice {
        technique: candidate.info().name,
        settings: (candidate.registration.settings)(&occasion),
        reason: candidate.reason,
    });
    DefaultSet {
        choices: choices.collect(),
        notes: Vec::new(),
    }
}

/// A technique that suits an occasion.
#[derive(Debug, Clone)]
struct Candidate<'a> {
    registration: &'a Registration,
    reason: String,
    /// For how many of the scene's classes of light it adds what one technique of its role adds for all others.
    rivalry: usize,
}

impl<'a> Candidate<'a> {
    fn new(registration: &'a Registration, occasion: &Occasion<'_>) -> Option<Self> {
        let info = registration.info;
        let mut paths = info.paths.iter();
        let has_light = paths.any(|paths| occasion.classes.contains(&paths.class));
        let has_time = info.cost.suits(occasion.purpose);
        let has_texels = occasion.has_atlas || !info.needs.texels;
        if !(has_light && has_time && has_texels) {
            return None;
        }
        let light = light_of_one(info.role, occasion);
        let added = light.iter().filter(|light| adds(info, light));
        Some(Self {
            registration,
            rivalry: added.count(),
            reason: (registration.suits)(occasion)?,
        })
    }

    fn info(&self) -> &'static Info {
        self.registration.info
    }
}

/// The best of the techniques of a role of which a set has one, beside those `chosen`: among those that add its light for
/// most classes, the first in the registry whose needs are met.
fn best<'a>(
    mut rivals: Vec<Candidate<'a>>,
    chosen: &[Candidate<'_>],
    occasion: &Occasion<'_>,
) -> Option<Candidate<'a>> {
    let light = light_of_one(rivals.first()?.info().role, occasion);
    let is_added =
        |light: &LightPaths| chosen.iter().any(|candidate| adds(candidate.info(), light));
    if light.iter().any(is_added) {
        return None;
    }
    rivals.sort_by_key(|rival| Reverse(rival.rivalry));
    let mut better = None;
    for mut rival in rivals {
        let Some(refusal) = occasion.refusal(rival.info().needs) else {
            if let Some(refusal) = better {
                rival.reason = format!("{}, and {refusal}", rival.reason);
            }
            return Some(rival);
        };
        better.get_or_insert(refusal);
    }
    None
}

/// The light that one technique of a role adds for all others, by classes that the scene has.
fn light_of_one(role: Role, occasion: &Occasion<'_>) -> Vec<LightPaths> {
    let classes = occasion.classes.iter();
    let of_class = |&class| Some(LightPaths::new(class, role.light_of_one()?));
    classes.filter_map(of_class).collect()
}

fn adds(info: &Info, light: &LightPaths) -> bool {
    overlap(info.paths, std::slice::from_ref(light)).is_some()
}
