//! Which techniques light what is baked: by what they are for, need and cost.

use gpugi::gpu::Gpu;
use gpugi::techniques::{Cost, Info, Registry, Role, Speed};
use gpugi::{Purpose, default_set};
use gpugi_scene::Scene;

use crate::Usage;

/// Parts of light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Light straight from lights, and caustics of mirrors and glass
    Direct,
    /// Light reflected between surfaces (path-tracing; on integrated GPUs radiosity)
    Indirect,
}

/// The techniques that light texels.
pub struct Lights {
    pub names: Vec<String>,
    /// Whether direct light is only an input to indirect light and is not baked itself.
    pub only_indirect: bool,
    /// Whether paths find the light unasked: then their noise is filtered, and there are as many samples as that takes.
    pub is_traced: bool,
}

impl Lights {
    /// The techniques in `named`, plus those that `parts` need. All parts if both are empty. In software and on discrete GPUs,
    /// paths find indirect light, and all light but caustics if direct light is baked as well, unless `settings` ask for others:
    /// they err less, or take less time (docs/bake.md).
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        named: &[String],
        parts: &[Part],
        settings: &[String],
    ) -> Self {
        let is_light = |name: &&String| role_of(name) != Some(Role::Factor);
        let mut names: Vec<String> = named.iter().filter(is_light).cloned().collect();
        let all = [Part::Direct, Part::Indirect];
        let parts = if named.is_empty() && parts.is_empty() {
            &all
        } else {
            parts
        };
        let has_indirect = parts.contains(&Part::Indirect);
        let only_indirect = names.is_empty() && parts == [Part::Indirect];
        let asks = |setting: &String| {
            let technique = setting.split('.').next().unwrap_or_default();
            let by_paths = [Role::Everything, Role::Caustics, Role::Factor];
            role_of(technique).is_some_and(|role| !by_paths.contains(&role))
        };
        let is_traced = names.is_empty()
            && has_indirect
            && scene.media.is_empty()
            // Integrated GPUs were not measured.
            && Speed::of(&gpu.adapter) != Speed::Modest
            && !settings.iter().any(asks);
        let with_direct = match is_traced && parts.contains(&Part::Direct) {
            true => |role| role == Role::Caustics,
            false => is_direct,
        };
        if !parts.is_empty() {
            let best = default_set(scene, &gpu.adapter, Purpose::Bake, &Registry::default());
            let best = best.names().into_iter();
            names.extend(best.filter(|name| role_of(name).is_some_and(with_direct)));
        }
        let is_indirect = |name: &String| {
            role_of(name).is_some_and(|role| [Role::Indirect, Role::Everything].contains(&role))
        };
        if has_indirect && !names.iter().any(is_indirect) {
            let adds = |info: &&Info| match is_traced {
                true => info.role == Role::Everything,
                // Texels are laid out in any case.
                false => info.role == Role::Indirect && info.needs.texels,
            };
            names.extend(
                baked()
                    .into_iter()
                    .find(adds)
                    .map(|info| info.name.to_owned()),
            );
        }
        Self {
            names,
            only_indirect,
            is_traced,
        }
    }
}

impl Lights {
    /// Whether what is baked holds light straight from lights.
    pub fn hold_direct(&self) -> bool {
        let has_direct = |name: &String| {
            role_of(name).is_some_and(|role| [Role::Direct, Role::Everything].contains(&role))
        };
        !self.only_indirect && self.names.iter().any(has_direct)
    }
}

/// Names of the techniques that add direct light on diffuse surfaces.
pub fn direct() -> Vec<&'static str> {
    let baked = baked().into_iter();
    names(baked.filter(|info| is_direct(info.role)))
}

/// Names of the techniques whose light volumes hold: indirect light at any point.
pub fn in_volumes() -> Vec<&'static str> {
    let is_anywhere = |info: &&Info| info.role == Role::Indirect && !info.needs.texels;
    names(baked().into_iter().filter(is_anywhere))
}

/// What the technique is for, if it is baked into texels.
pub fn role_of(name: &str) -> Option<Role> {
    let found = baked().into_iter().find(|info| info.name == name);
    found.map(|info| info.role)
}

/// Names of the techniques whose light differs from texel to texel by chance, so that filters find their noise.
pub fn noisy() -> Vec<&'static str> {
    names(baked().into_iter().filter(|info| info.is_noisy))
}

/// Refuses techniques that are not baked into texels.
pub fn check(techniques: &[String]) -> Result<(), Usage> {
    let Some(name) = techniques.iter().find(|name| role_of(name).is_none()) else {
        return Ok(());
    };
    let infos = all();
    let alone = infos
        .iter()
        .filter(|info| info.cost == Cost::Precomputation);
    Err(Usage(format!(
        "--technique {name}: baked into texels are {}; {} alone",
        names(baked()).join(", "),
        names(alone.copied()).join(" and ")
    )))
}

/// The techniques that are baked into texels, by role.
fn baked() -> Vec<&'static Info> {
    let is_diffuse =
        |role| is_direct(role) || [Role::Indirect, Role::Factor, Role::Everything].contains(&role);
    let mut baked = all();
    baked.retain(|info| is_diffuse(info.role) && info.cost.suits(Purpose::Bake));
    baked.sort_by_key(|info| info.role);
    baked
}

/// Whether techniques of this role add light straight from lights, or what mirrors and glass make of it.
fn is_direct(role: Role) -> bool {
    [Role::Direct, Role::Caustics].contains(&role)
}

fn all() -> Vec<&'static Info> {
    let registry = Registry::default();
    registry
        .all()
        .iter()
        .map(|registration| registration.info)
        .collect()
}

fn names(infos: impl IntoIterator<Item = &'static Info>) -> Vec<&'static str> {
    infos.into_iter().map(|info| info.name).collect()
}
