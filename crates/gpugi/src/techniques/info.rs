//! What techniques say of themselves: what they are for, what they need, what they take and what they
//! provide.

use super::Purpose;
use crate::gpu::GpuError;
use crate::light_paths::LightPaths;

/// Describes a technique.
#[derive(Debug, Clone, Copy)]
pub struct Info {
    /// Name on the command line.
    pub name: &'static str,
    /// One line of help.
    pub summary: &'static str,
    /// Its sources: the tutorial's section and papers.
    pub source: &'static str,
    /// What of that light may be missing, and where: a few words; empty if nothing is.
    pub caveat: &'static str,
    /// The light that it can add.
    pub paths: &'static [LightPaths],
    /// What it is for.
    pub role: Role,
    /// What scenes are uploaded with for it.
    pub needs: Needs,
    /// How long its light takes.
    pub cost: Cost,
    /// Points of its own that it lights, which the camera may not see.
    pub lights_points: OwnPoints,
    /// Where it adds light and dims it, on the way from surfaces to the eye.
    pub layer: Layer,
    /// Whether its light is drawn by chance for each point, so that live pictures filter it ([`Target::noisy`](crate::capture::Target::noisy)).
    pub is_noisy: bool,
    /// What else than light it provides to the techniques after it.
    pub provides: &'static [Provided],
}

impl Info {
    /// Error about what the technique cannot light, or not so.
    pub fn refused(&self, reason: impl std::fmt::Display) -> GpuError {
        GpuError::Pass {
            pass: self.name.into(),
            reason: reason.to_string(),
        }
    }

    /// Error about saved progress of the technique.
    pub fn unfit(&self, reason: impl std::fmt::Display) -> GpuError {
        self.refused(format!("what was saved does not fit: {reason}"))
    }

    /// What most techniques have in common: they follow frames in motion, need nothing, light no points of their own, add
    /// light at surfaces, and provide nothing else.
    pub const BASE: Self = Self {
        name: "",
        summary: "",
        source: "",
        caveat: "",
        paths: &[],
        role: Role::Direct,
        needs: Needs::NOTHING,
        cost: Cost::Frame,
        lights_points: OwnPoints::None,
        layer: Layer::Surfaces,
        is_noisy: false,
        provides: &[],
    };
}

/// What a technique is for. Default sets and bakes choose techniques by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Light straight from lights, with shadows.
    Direct,
    /// Light of lights that mirrors and glass throw on their surroundings.
    Caustics,
    /// Light that media scatter and emit.
    Media,
    /// What mirrors, glass and glossy surfaces show.
    Gloss,
    /// Light reflected between diffuse surfaces.
    Indirect,
    /// Not light, but the share of it that arrives: a factor on the light of others.
    Factor,
    /// All light that the techniques before it leave out.
    Everything,
    /// All light, as the truth that others are measured against.
    Reference,
}

impl Role {
    /// Paths of the light that one technique of a set adds for all others of this role. `None`: techniques of this role
    /// stand side by side.
    pub(crate) fn light_of_one(self) -> Option<&'static str> {
        match self {
            Self::Gloss => Some("LD[GS]E"),
            Self::Indirect => Some("LDDE"),
            _ => None,
        }
    }
}

/// What a scene is uploaded with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// The hierarchies in which shaders trace rays.
    pub rays: bool,
    /// Texture atlases, in whose texels light is kept.
    pub texels: bool,
}

impl Needs {
    /// Nothing beyond what captures draw.
    pub const NOTHING: Self = Self {
        rays: false,
        texels: false,
    };
    /// Rays alone.
    pub const RAYS: Self = Self {
        rays: true,
        texels: false,
    };
    /// Texels, and the rays that light them.
    pub const TEXELS: Self = Self {
        rays: true,
        texels: true,
    };
}

/// How long a technique's light takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cost {
    /// Milliseconds: it follows frames in motion.
    Frame,
    /// Seconds, for its maps or for enough samples: it suits what stands still.
    Picture,
    /// Longer, once for a still scene whose lights change: it is used on request alone.
    Precomputation,
}

impl Cost {
    /// Whether light for `purpose` may take so long.
    pub fn suits(self, purpose: Purpose) -> bool {
        match purpose {
            Purpose::LiveView => self == Self::Frame,
            Purpose::StillPicture | Purpose::Bake => self <= Self::Picture,
        }
    }
}

/// Points that a technique lights by those before it: cubes around objects, texels, probes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OwnPoints {
    /// None.
    None,
    /// Points whose radiance toward an eye it takes.
    TowardEye,
    /// Points whose irradiance or fluence it takes, too: gathers are compiled for these in advance.
    Irradiance,
}

/// Where a technique adds light and dims it, from the farthest to the nearest of the eye: each layer dims all those before
/// it. In one layer, techniques later in the frame lie nearer to the eye.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// At the receiver's points.
    Surfaces,
    /// Between the points and the eye, such as fog: see [`Technique::behind`](super::Technique::behind).
    Media,
    /// Before all media, such as a pane before the eye.
    Eye,
}

/// What a technique provides to those after it, beside light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Provided {
    /// [`Technique::openness`](super::Technique::openness).
    Openness,
    /// [`Technique::media_sources`](super::Technique::media_sources).
    MediaSources,
}
