//! When an object's surroundings are captured and lit anew (tutorial section 5: "re-generated only if the object moves far").

use glam::Vec3;

use crate::scene::{Placement, Versions};

/// How often surroundings are renewed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Renew {
    /// In every frame, whether anything changed or not.
    EveryFrame,
    /// When something changed, and at most every so many frames.
    Changed(u32),
}

/// When and how surroundings are renewed for what moves or is lit otherwise. Where meshes or materials of instances are others, or settings of
/// techniques, all is renewed at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Renewal {
    /// How often.
    pub renew: Renew,
    /// The object's own way since its surroundings were renewed that leaves them as they are, and the point that they are seen from, when it is
    /// less (m).
    pub threshold: f32,
    /// Faces of the cube that are renewed in a frame, the others in the next ones; from another reference point always all: 1 to 6.
    pub faces: u32,
}

impl Default for Renewal {
    fn default() -> Self {
        Self {
            renew: Renew::Changed(1),
            threshold: 0.0,
            faces: 6,
        }
    }
}

/// What surroundings are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Made {
    pub versions: Versions,
    /// Of the settings of techniques, which decide what cameras see whole.
    pub settings: u64,
    pub seed: u32,
}

impl Made {
    /// Whether what is there is the same, wherever it is and however it is lit.
    fn has_same_things(&self, other: &Self) -> bool {
        let of = |one: &Self| {
            let versions = one.versions;
            (versions.instances, versions.materials, one.settings)
        };
        of(self) == of(other)
    }

    fn is_lit_as(&self, other: &Self) -> bool {
        let of = |one: &Self| {
            let versions = one.versions;
            (versions.lights, versions.sky, versions.environment)
        };
        of(self) == of(other)
    }

    /// Whether a capture of the surroundings of the instance `own` shows what one of `now` would.
    pub fn shows(&self, now: &Self, own: usize, placements: &[Placement]) -> bool {
        let since = self.versions.geometry;
        let mut others = placements.iter().enumerate();
        self.has_same_things(now)
            && self.seed == now.seed
            && (since == now.versions.geometry
                || !others.any(|(index, one)| index != own && one.moved > since))
    }
}

/// What is to be renewed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Due {
    /// Everything, from where the object is now.
    All,
    /// The faces of one turn, from where they were captured before.
    Turn(usize),
}

/// The latest renewal: done, or under way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Begun {
    frame: u64,
    /// As it was when it began.
    of: Made,
    /// Where the object's middle was (m).
    center: Vec3,
    next_turn: usize,
}

impl Renewal {
    /// Number of turns in which all faces are renewed.
    pub(super) fn turns(&self) -> usize {
        6_u32.div_ceil(self.at_once()) as usize
    }

    /// The faces of a turn.
    pub(super) fn faces_of(&self, turn: usize) -> std::ops::Range<u32> {
        let first = turn as u32 * self.at_once();
        first..(first + self.at_once()).min(6)
    }

    fn at_once(&self) -> u32 {
        self.faces.clamp(1, 6)
    }

    /// Whether nothing is due as long as nothing changes.
    pub(super) fn is_settled(&self, begun: Option<&Begun>, now: &Made) -> bool {
        let is_done = |begun: &Begun| begun.of == *now && begun.next_turn >= self.turns();
        self.renew != Renew::EveryFrame && begun.is_some_and(is_done)
    }

    /// What is to be renewed in `frame` of the surroundings of the instance `own`, whose middle is at `center` (m), and what to remember of that.
    /// `has_reference`: the cube is captured from a given point, wherever the object is.
    pub(super) fn due(
        &self,
        begun: Option<&Begun>,
        now: Made,
        frame: u64,
        (own, center): (usize, Vec3),
        placements: &[Placement],
        has_reference: bool,
    ) -> Option<(Due, Begun)> {
        let turns = self.turns();
        let all = Begun {
            frame,
            of: now,
            center,
            next_turn: turns,
        };
        let Some(begun) = begun.filter(|begun| begun.of.has_same_things(&now)) else {
            return Some((Due::All, all));
        };
        if begun.next_turn < turns {
            let next_turn = begun.next_turn + 1;
            let begun = Begun {
                next_turn,
                ..*begun
            };
            return Some((Due::Turn(next_turn - 1), begun));
        }
        let is_near = center.distance(begun.center) < self.threshold;
        let has_moved = placements
            .get(own)
            .is_some_and(|one| one.moved > begun.of.versions.geometry);
        let is_due = match self.renew {
            Renew::EveryFrame => true,
            Renew::Changed(frames) => {
                let same = begun.of.is_lit_as(&now) && begun.of.shows(&now, own, placements);
                let is_changed = !same || has_moved && !is_near;
                is_changed && frame - begun.frame >= u64::from(frames)
            }
        };
        if !is_due {
            return None;
        }
        if !is_near && !has_reference && center != begun.center {
            return Some((Due::All, all));
        }
        let center = if is_near { begun.center } else { center };
        let next_turn = 1;
        Some((
            Due::Turn(0),
            Begun {
                center,
                next_turn,
                ..all
            },
        ))
    }
}
