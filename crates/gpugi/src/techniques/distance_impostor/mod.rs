//! Distance impostors: reflections and refractions of surroundings that are as near as they are (tutorial sections 5.1 to 5.3).
//!
//! Generate: for each object a cube around a reference point captures its surroundings, lit by the techniques before this one, with their
//! distances; of a refractor also its own shape. Gather: reflected and refracted rays look for their hits in these maps.
//! docs/techniques/distance-impostor.md.

mod impostor;
#[cfg(test)]
mod tests;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::{Field, Info, Lit, MadeFor, Map, SettingError, Technique, Texels, settings};
use crate::capture::{PerTarget, SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::impostor::{Renew, Renewal};
use crate::light_paths::{LightClass, LightPaths, SEEN_DIRECTLY};
use crate::scene::{Claims, GpuScene, Versions};
use impostor::{Impostor, Kernels, Making};

/// What distance impostors say of themselves.
pub const INFO: Info = Info {
    name: "distance-impostor",
    summary: "localized reflections and multiple refractions of lit surroundings, on chosen objects",
    source: "tutorial sections 5.1 to 5.3; Szirmay-Kalos et al. 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, "L[DG]?S+E"),
        LightPaths::new(LightClass::Area, "L[DG]?S+E"),
        LightPaths::new(LightClass::Environment, "L[DG]?S+E"),
    ],
    suits: |scene| scene.objects.iter().any(|object| object.is_smooth),
    keeps_texels: false,
};

/// How hits are searched for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Search {
    /// A walk through all cells that the ray may meet: finds everything that is as wide as a texel.
    Walk,
    /// The tutorial's first version: secant, then false position.
    Secant,
    /// The tutorial's second version.
    FalsePosition,
    /// None: surroundings count as infinitely far, as in classical environment mapping.
    None,
}

impl Search {
    /// The `SEARCH_` constant of lookup.wesl; of none, that of the default, which is not read.
    fn number(self) -> u32 {
        match self {
            Self::Walk | Self::None => 0,
            Self::Secant => 1,
            Self::FalsePosition => 2,
        }
    }
}

/// What the gather adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Show {
    /// Light.
    Light,
    /// A colour for how sure it is what rays meet: green seen from the reference point, yellow seen at the end of a way that is not, red not
    /// seen, blue found in the second layer, grey nothing.
    Certainty,
}

/// A point, or the middle of each object.
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
            .map(|one| one.trim().parse().ok().filter(|one: &f32| one.is_finite()))
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

/// Settings of distance impostors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Side of the faces of the surroundings' cubes (texels): a power of two.
    pub resolution: u32,
    /// Side of the faces of refractors' shapes (texels): a power of two.
    pub shape_resolution: u32,
    /// How hits are searched for.
    pub search: Search,
    /// Steps of the tutorial's searches.
    pub iterations: u32,
    /// Most surfaces that light meets inside a refractor; 0: it refracts once, on its way in.
    pub bounces: u32,
    /// 1, or 2: cubes also hold what is behind what their reference point sees.
    pub layers: u32,
    /// What the picture shows of it.
    pub show: Show,
    /// Where cubes are captured from (m).
    pub reference: Reference,
    /// When surroundings are captured and lit anew.
    pub renew: Often,
    /// An object's own way that leaves its surroundings as they are, if it is less (m).
    pub threshold: f32,
    /// Faces of a cube that are renewed in a frame.
    pub faces_per_frame: u32,
    /// Objects with impostors: names separated by commas, `*` for any characters. `auto`: those with ideal surfaces.
    pub objects: String,
}

impl Settings {
    /// Layers that the search reads: the tutorial's know one.
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

impl Default for Settings {
    fn default() -> Self {
        Self {
            resolution: 256,
            shape_resolution: 256,
            search: Search::Walk,
            iterations: 4,
            bounces: 4,
            layers: 1,
            show: Show::Light,
            reference: Reference(None),
            renew: Often(Renew::Changed(1)),
            threshold: 0.0,
            faces_per_frame: 6,
            objects: AUTO.to_owned(),
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "resolution",
        summary: "side of the faces of the surroundings' cubes, a power of two [texels]",
        range: Some((16.0, 1024.0)),
    },
    Field {
        name: "shape-resolution",
        summary: "side of the faces of refractors' shapes, a power of two [texels]",
        range: Some((16.0, 1024.0)),
    },
    Field {
        name: "search",
        summary: "walk, secant, false-position or none: how hits are searched for; none is classical environment mapping",
        range: None,
    },
    Field {
        name: "iterations",
        summary: "steps of the searches secant and false-position",
        range: Some((0.0, 64.0)),
    },
    Field {
        name: "bounces",
        summary: "most surfaces that light meets inside a refractor; 0: it refracts once",
        range: Some((0.0, 16.0)),
    },
    Field {
        name: "layers",
        summary: "2: also what is behind what the reference point sees, for search=walk; 1: without",
        range: Some((1.0, 2.0)),
    },
    Field {
        name: "show",
        summary: "light, or certainty: colours for how sure it is what rays meet",
        range: None,
    },
    Field {
        name: "reference",
        summary: "auto, the middle of each object, or x,y,z: where cubes are captured from [m]",
        range: None,
    },
    Field {
        name: "renew",
        summary: "changed, every-frame, or a number: capture surroundings when something changed, at most every so many frames",
        range: None,
    },
    Field {
        name: "threshold",
        summary: "an object's own way that leaves its surroundings as they are, if it is less [m]",
        range: Some((0.0, 1e9)),
    },
    Field {
        name: "faces-per-frame",
        summary: "faces of a cube that are renewed in a frame, the others in the next",
        range: Some((1.0, 6.0)),
    },
    Field {
        name: "objects",
        summary: "objects with impostors, names with commas between and * for any letters; auto: those with ideal surfaces",
        range: None,
    },
];

/// The value of [`Settings::objects`] and [`Settings::reference`] that leaves the choice to gpugi.
const AUTO: &str = "auto";
/// Most objects that get an impostor by themselves, and most that may be named.
const MOST: usize = 16;
const MOST_NAMED: usize = 32;
/// How often several objects are captured when the scene changed: those captured first do not see what the others show yet.
const ROUNDS: u32 = 2;
/// Most ideal reflections and refractions of a declared path.
const MOST_BOUNCES: u32 = 32;

/// Distance impostors.
#[derive(Debug)]
pub struct DistanceImpostor {
    settings: Settings,
    kernels: Kernels,
    paths: Vec<LightPaths>,
    /// Instances with an impostor.
    claimed: Vec<u32>,
    made: Option<Made>,
    bound: PerTarget<[wgpu::BindGroup; 2]>,
}

/// The impostors, and what they were made for.
#[derive(Debug)]
struct Made {
    of: MadeFor<Settings>,
    /// The scene, and the settings of techniques, at the last frame.
    seen: Option<(Versions, u64)>,
    /// [`Lit::refinements`] of the last frame.
    refinements: u64,
    impostors: Vec<Impostor>,
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
            paths: Vec::new(),
            claimed: Vec::new(),
            made: None,
            bound: PerTarget::default(),
        })
    }
}

impl Technique for DistanceImpostor {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn paths(&self) -> &[LightPaths] {
        &self.paths
    }

    fn claim(&mut self, scene: &GpuScene, covered: &[LightPaths]) -> Vec<Claims> {
        let objects = &scene.objects;
        let mut claims = vec![Claims::NONE; objects.len()];
        self.claimed.clear();
        let (mut refracts, mut is_smooth, mut is_rough) = (false, false, false);
        for (index, object) in objects.iter().enumerate() {
            let is_mine = match self.settings.objects.as_str() {
                AUTO => object.is_smooth && self.claimed.len() < MOST,
                list => object.is_named_by(list),
            };
            if is_mine {
                self.claimed.push(index as u32);
                claims[index] = Claims::SPECULAR;
                is_rough |= !object.is_smooth;
                is_smooth |= object.is_smooth;
                // The cubes of rough objects hold no emitters: what passes through them is left to others.
                if object.is_transmissive && object.is_solid && object.is_smooth {
                    claims[index] = Claims::SPECULAR | Claims::TRANSMISSION | Claims::REFRACTION;
                    refracts = true;
                }
            }
        }
        // What refracts once stands for what light does on its ways in and out.
        let own = if refracts {
            self.settings.bounces.max(1) + 1
        } else {
            1
        };
        // Cubes show other objects whose cubes show the first.
        let objects = if self.claimed.len() > 1 {
            ROUNDS + 1
        } else {
            1
        };
        let bounces = match (own * objects).min(MOST_BOUNCES) {
            1 => "S".to_owned(),
            most => format!("S{{1,{most}}}"),
        };
        self.paths.clear();
        if !self.claimed.is_empty() {
            // What lights the surroundings, and what is seen of lights themselves: in smooth objects alone.
            for one in covered {
                if is_smooth {
                    self.paths.push(one.continued(&bounces));
                }
                if is_rough {
                    self.paths.push(one.continued("G"));
                }
            }
            if is_smooth {
                for class in [LightClass::Area, LightClass::Environment] {
                    let one = LightPaths::new(class, SEEN_DIRECTLY);
                    self.paths.push(one.continued(&bounces));
                }
            }
        }
        claims
    }

    fn names(&self) -> &str {
        match self.settings.objects.as_str() {
            AUTO => "",
            list => list,
        }
    }

    fn lights_own_points(&self) -> bool {
        !self.claimed.is_empty()
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        let sides = |all: &Settings| [all.resolution, all.shape_resolution];
        settings::set_with_sides(&mut self.settings, FIELDS, name, value, sides)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        if self.claimed.len() > MOST_NAMED {
            return Err(GpuError::TooLarge {
                what: "objects with distance impostors (name fewer)".into(),
                needed: self.claimed.len() as u64,
                limit: MOST_NAMED as u64,
                adapter: frame.gpu.adapter.name.clone(),
            });
        }
        let is_made = |made: &Made| made.of.is(&self.settings, &self.claimed, scene);
        if !self.made.as_ref().is_some_and(is_made) {
            let of = MadeFor::new(&self.settings, &self.claimed, scene);
            let impostors = of.objects().map(|(one, object)| {
                Impostor::new(frame.gpu, &self.kernels, &self.settings, one, object)
            });
            self.made = Some(Made {
                impostors: impostors.collect::<Result<_, _>>()?,
                of,
                seen: None,
                refinements: 0,
            });
        }
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        let is_every_frame = self.settings.renew.0 == Renew::EveryFrame;
        // Every frame another, so that what is decided by chance changes.
        let seed = if is_every_frame {
            let view = &view.uniform;
            view.seed
                .wrapping_add(view.sample_index.wrapping_mul(0x85eb_ca6b))
        } else {
            0
        };
        let is_refined = made.refinements != lit.refinements();
        made.refinements = lit.refinements();
        let making = Making {
            scene,
            kernels: &self.kernels,
            settings: &self.settings,
            seed,
            is_refined,
        };
        let now = Some((scene.versions, lit.version));
        let is_changed = made.seen != now;
        made.seen = now;
        let impostors = &mut made.impostors;
        for impostor in &mut *impostors {
            impostor.follow(frame, making, lit)?;
        }
        let are_several = impostors.len() > 1;
        if are_several && impostors.iter().any(Impostor::is_in_turn) {
            for impostor in &mut *impostors {
                impostor.next_turn = 0;
            }
        } else if impostors.iter().all(|one| one.due.is_none()) {
            for impostor in &mut *impostors {
                impostor.once_more();
            }
        }
        // What only became finer, or comes every frame, goes round in time.
        let rounds = if are_several && (is_changed || !(is_every_frame || is_refined)) {
            ROUNDS
        } else {
            1
        };
        for round in 0..rounds {
            for index in 0..impostors.len() {
                let (before, rest) = impostors.split_at_mut(index);
                let Some((this, after)) = rest.split_first_mut() else {
                    break;
                };
                if round > 0 && this.is_in_turn() {
                    continue;
                }
                let kernel = self.kernels.gather(self.settings.show);
                let bound = &mut self.bound;
                this.light(frame, making, lit, |frame, points, target| {
                    let others = before.iter().chain(&*after);
                    let others = others.filter(|one| one.is_lit);
                    add(frame, scene, kernel, bound, points, target, others)
                })?;
            }
        }
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        let impostors = self.made.iter().flat_map(|made| &made.impostors);
        add(
            frame,
            scene,
            self.kernels.gather(self.settings.show),
            &mut self.bound,
            points,
            target,
            impostors,
        )
    }

    fn maps(&self) -> Vec<Map> {
        let impostors = self.made.iter().flat_map(|made| &made.impostors);
        impostors
            .flat_map(|impostor| {
                impostor.textures().into_iter().map(|(name, texture)| Map {
                    name,
                    texels: Texels::Texture(texture.clone()),
                })
            })
            .collect()
    }
}

/// Adds what the objects of `impostors` mirror and refract, by the pass `kernel`.
fn add<'a>(
    frame: &mut Frame<'_>,
    scene: &GpuScene,
    kernel: &Kernel,
    bound: &mut PerTarget<[wgpu::BindGroup; 2]>,
    points: &SurfacePoints,
    target: &Target,
    impostors: impl Iterator<Item = &'a Impostor>,
) -> Result<(), GpuError> {
    let gpu = frame.gpu;
    let groups = bound.of(points, target, || {
        Ok([points.bind(gpu, kernel)?, target.bind(gpu, kernel)?])
    })?;
    frame.compute("distance-impostor.gather", |pass| {
        for impostor in impostors {
            impostor.gather(pass, scene, kernel, groups, points);
        }
    });
    Ok(())
}
