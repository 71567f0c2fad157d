//! When an object's surroundings are captured and lit again (tutorial section 5: "re-generated only if the object moves
//! far").

use glam::Vec3;

use crate::scene::{Placement, Versions};

/// How often surroundings are renewed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Renew {
    /// In every frame, whether anything changed or not.
    EveryFrame,
    /// When something changed, at most once per this many frames.
    Changed(u32),
}

/// When and how surroundings are renewed after motion or changes of lighting. If meshes or materials of instances, or
/// settings of techniques, change, everything is renewed at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Renewal {
    /// How often.
    pub renew: Renew,
    /// While the object has moved by less than this since its surroundings were renewed (m), its motion renews neither
    /// them nor the point from which they are seen.
    pub threshold: f32,
    /// Faces of the cube that are renewed per frame, 1 to 6; the others follow in the next frames. From a new reference
    /// point, all faces are renewed at once.
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

/// The state of which surroundings were captured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RenewalKey {
    pub versions: Versions,
    /// Version of the techniques' settings, which decide what cameras see whole.
    pub settings: u64,
    pub seed: u32,
}

impl RenewalKey {
    /// Whether the objects are the same, wherever they are and however they are lit.
    fn has_same_things(&self, other: &Self) -> bool {
        let of = |key: &Self| {
            let versions = key.versions;
            (versions.instances, versions.materials, key.settings)
        };
        of(self) == of(other)
    }

    fn is_lit_as(&self, other: &Self) -> bool {
        let of = |key: &Self| {
            let versions = key.versions;
            (versions.lights, versions.sky, versions.environment)
        };
        of(self) == of(other)
    }

    /// Whether a capture at this state of the surroundings of the instances `own` shows what one at `now` would.
    pub fn shows(&self, now: &Self, own: &[u32], placements: &[Placement]) -> bool {
        let since = self.versions.geometry;
        let is_other = |index: usize| own.binary_search(&(index as u32)).is_err();
        let mut all = placements.iter().enumerate();
        self.has_same_things(now)
            && self.seed == now.seed
            && (since == now.versions.geometry
                || !all.any(|(index, placement)| placement.moved > since && is_other(index)))
    }
}

/// What is to be renewed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Due {
    /// Everything, from where the object is now.
    All,
    /// The faces of one turn, from the same reference point as before.
    FaceGroup(usize),
}

/// The latest renewal, finished or in progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Begun {
    frame: u64,
    /// The state when it began.
    of: RenewalKey,
    /// Where the object's centre was (m).
    center: Vec3,
    next_turn: usize,
}

impl Renewal {
    /// Number of turns that renew all faces.
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

    /// Whether nothing is due until something changes.
    pub(super) fn is_settled(&self, begun: Option<&Begun>, now: &RenewalKey) -> bool {
        let is_done = |begun: &Begun| begun.of == *now && begun.next_turn >= self.turns();
        self.renew != Renew::EveryFrame && begun.is_some_and(is_done)
    }

    /// What to renew in `frame` of the surroundings of the instances `own`, whose centre is at `center` (m), and the
    /// renewal to remember. `has_reference`: the cube is captured from a given point, wherever the object is.
    pub(super) fn due(
        &self,
        begun: Option<&Begun>,
        now: RenewalKey,
        frame: u64,
        (own, center): (&[u32], Vec3),
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
            return Some((Due::FaceGroup(next_turn - 1), begun));
        }
        let is_near = center.distance(begun.center) < self.threshold;
        let mut own_placements = own
            .iter()
            .filter_map(|&instance| placements.get(instance as usize));
        let has_moved =
            own_placements.any(|placement| placement.moved > begun.of.versions.geometry);
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
            Due::FaceGroup(0),
            Begun {
                center,
                next_turn,
                ..all
            },
        ))
    }
}
