//! What can be set.

use serde::{Deserialize, Serialize};

use crate::techniques::{Field, SettingError, settings};

/// How obscurances are sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Rays from every texel, in a scene in which rays are traced ([`crate::scene::GpuScene::with_rays`]).
    #[default]
    Rays,
    /// Bundles of parallel lines through everything, hit by hit, in a scene for captures ([`crate::scene::GpuScene::new`]).
    Peeling,
}

/// How much ambient light comes from a surface at distance d: rho(d), 1 beyond the reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Falloff {
    /// The square root of d over the reach.
    #[default]
    Sqrt,
    /// d over the reach.
    Linear,
    /// None: plain ambient occlusion.
    Step,
}

/// The ambient light that obscurances let through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Ambient {
    /// None: obscurances are maps and no light.
    #[default]
    Off,
    /// Equation 25 with W.
    Plain,
    /// Equation 25 with W in colours.
    Colored,
}

/// Settings of obscurances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// How they are sampled.
    pub mode: Mode,
    /// Reach (m): what is further away does not obscure.
    pub distance: f32,
    /// What nearer surfaces do.
    pub falloff: Falloff,
    /// Whether colours of what obscures are kept, too.
    pub colored: bool,
    /// Rays from a texel, or bundles of lines.
    pub directions: u32,
    /// Most surfaces that a line meets (peeling).
    pub layers: u32,
    /// Lines of a bundle across a texel of mean size that faces it, along each axis (peeling).
    pub lines: f32,
    /// Most lines of a bundle along each axis (peeling).
    pub most_lines: u32,
    /// Seed of all that is stochastic.
    pub seed: u32,
    /// The indirect light that is added.
    pub ambient: Ambient,
    /// Side of the pages of the atlas that a renderer lays out (texels).
    pub resolution: u32,
    /// Its texels per metre (1/m), in as many pages as it takes; 0: as many as one page holds.
    pub density: f32,
    /// Steps that a renderer takes in a frame.
    pub steps: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            mode: Mode::Rays,
            distance: 1.0,
            falloff: Falloff::Sqrt,
            colored: true,
            directions: 512,
            layers: 32,
            lines: 1.0,
            most_lines: 2048,
            seed: 0,
            ambient: Ambient::Off,
            resolution: 512,
            density: 0.0,
            steps: 1,
        }
    }
}

/// What can be set.
pub const FIELDS: &[Field] = &[
    Field {
        name: "mode",
        summary: "rays (from every texel) or peeling (bundles of lines, hit by hit)",
        range: None,
    },
    Field {
        name: "distance",
        summary: "reach: what is further away does not obscure [m]",
        range: Some((1e-6, 1e9)),
    },
    Field {
        name: "falloff",
        summary: "sqrt, linear or step (plain ambient occlusion)",
        range: None,
    },
    Field {
        name: "colored",
        summary: "true: also with the colours of what obscures",
        range: None,
    },
    Field {
        name: "directions",
        summary: "rays from a texel, or bundles of lines; powers of two are best",
        range: Some((1.0, 65_536.0)),
    },
    Field {
        name: "layers",
        summary: "most surfaces that a line meets (peeling)",
        range: Some((1.0, 1024.0)),
    },
    Field {
        name: "lines",
        summary: "lines of a bundle across a texel, along each axis (peeling)",
        range: Some((0.1, 8.0)),
    },
    Field {
        name: "most-lines",
        summary: "most lines of a bundle along each axis (peeling)",
        range: Some((16.0, 8192.0)),
    },
    Field {
        name: "seed",
        summary: "seed of all that is stochastic",
        range: Some((0.0, 4_294_967_295.0)),
    },
    Field {
        name: "ambient",
        summary: "indirect light in closed scenes: off, plain, or colored",
        range: None,
    },
    Field {
        name: "resolution",
        summary: "side of the atlas's pages [texels]",
        range: Some((16.0, 8192.0)),
    },
    Field {
        name: "density",
        summary: "texels per metre, in as many pages as it takes; 0: as many as one page holds [1/m]",
        range: Some((0.0, 1e6)),
    },
    Field {
        name: "steps",
        summary: "steps taken in a frame: 4 million rays, or a bundle, each",
        range: Some((1.0, 4096.0)),
    },
];

impl Settings {
    /// Sets one from text.
    ///
    /// # Errors
    /// [`SettingError`] when there is no such setting or the value is out of range.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        settings::set(self, FIELDS, name, value)
    }

    /// Whether every number is in range.
    ///
    /// # Errors
    /// [`SettingError::Value`].
    pub fn check(&self) -> Result<(), SettingError> {
        let all = settings::to_json(self);
        for field in FIELDS {
            let Some((low, high)) = field.range else {
                continue;
            };
            // What is not finite is no number in JSON.
            let number = all[field.name].as_f64();
            if !number.is_some_and(|number| (low..=high).contains(&number)) {
                return Err(SettingError::Value {
                    name: field.name.to_owned(),
                    value: all[field.name].to_string(),
                    reason: format!("the range is {low} to {high}"),
                });
            }
        }
        Ok(())
    }
}
