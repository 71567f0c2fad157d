//! How much work on maps a frame may do.

use std::cell::Cell;

/// A limit on the work that a frame may do on maps, so that a live view stays fluent while they are made. Its unit
/// does not depend on the machine: one ray traced; one light, map or depth comparison looked up at one point; or one
/// pixel drawn of a cube or a depth map. A caller that wants to keep a frame time measures milliseconds per unit
/// ([`crate::lighting::Lighting::work`]) and sets its budget by that; gpugi itself never reads a clock. The final maps
/// are the same, whatever the budget, but for cubes of mirrors that show each other, which depend on the order in which
/// they were lit.
///
/// Techniques work in steps and begin no further step once the frame's steps have used up the budget. The technique that
/// has waited longest for a step takes one all the same, so a frame exceeds its budget by at most two steps; while the
/// scene changes, by one at most in every third frame. A step is all depth maps of one light sample, the capture of one object's cube with its light, one frame of photons of one
/// object, or less. So is one depth map of image-based lighting, where the hardware rasterizer draws it; those of another
/// sky, and its domains, are not cut into steps.
///
/// What shows soonest for its work comes first: depth maps, so that the shadow of a moving light does not wait for
/// cubes; then caustics, which cubes show; then the cubes that mirrors show ([`crate::techniques::Technique::waiting`]); then what refines slowly, such
/// as radiosity. Whatever waits keeps its earlier maps, whole: the light of a sample with its own shadows, distances of
/// a cube with their light. While everything changes, maps take turns by age, and techniques that wait have equal parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Budget(u64);

impl Budget {
    /// No limit but those of the techniques' settings, such as `radiosity.steps`: for still pictures and bakes.
    pub const UNLIMITED: Self = Self(u64::MAX);

    /// Units of a live view's frame, before anybody has measured how long they take.
    pub const LIVE_VIEW_UNITS: u64 = 250_000;

    /// A limit of `units` per frame.
    pub const fn units(units: u64) -> Self {
        Self(units)
    }

    /// What is left after `work`.
    pub(crate) fn after(self, work: u64) -> Self {
        if self.is_limited() {
            Self(self.0.saturating_sub(work))
        } else {
            self
        }
    }

    /// An equal part of it for each of `number`.
    pub(crate) fn shared_by(self, number: u64) -> Self {
        if self.is_limited() {
            Self(self.0.div_ceil(number))
        } else {
            self
        }
    }

    /// Whether nothing is left.
    pub(crate) fn is_spent(self) -> bool {
        self.0 == 0
    }

    /// Whether there is a limit.
    pub(crate) fn is_limited(self) -> bool {
        self != Self::UNLIMITED
    }
}

/// A technique's part of a frame's budget.
#[derive(Debug, Clone)]
pub struct Slice {
    budget: Budget,
    /// Whether it is the technique's turn: its first step does not depend on the budget.
    is_in_turn: bool,
    /// Work that it has done so far in this frame, in units of [`Budget`].
    work: u64,
    was_refused: Cell<bool>,
}

impl Slice {
    pub(crate) fn unlimited() -> Self {
        Self::new(Budget::UNLIMITED, true)
    }

    pub(crate) fn new(budget: Budget, is_in_turn: bool) -> Self {
        Self {
            budget,
            is_in_turn,
            work: 0,
            was_refused: Cell::new(false),
        }
    }

    /// Whether the technique may begin another step in this frame. To be asked only if it would; one that is refused its
    /// first gets its turn in a later frame.
    pub fn may_step(&self) -> bool {
        self.may_step_after(0)
    }

    /// As [`Slice::may_step`], after further work that the technique is going to do in this frame.
    pub(crate) fn may_step_after(&self, work: u64) -> bool {
        let work = self.work.saturating_add(work);
        let may_step = (self.is_in_turn && work == 0) || work < self.budget.0;
        self.was_refused.set(!may_step);
        may_step
    }

    /// Counts work of the technique's own: rays traced, lookups at points, or pixels drawn. [`super::Earlier::gather`]
    /// counts by itself.
    pub fn count(&mut self, work: u64) {
        self.work = self.work.saturating_add(work.max(1));
    }

    /// Counts the work of a step, if it may be taken; whether it may.
    pub(crate) fn takes(&mut self, work: u64) -> bool {
        let may_step = self.may_step();
        if may_step {
            self.count(work);
        }
        may_step
    }

    /// Takes up to `most` steps of `work`, as long as it is not done and the slice allows them. `step` returns the work
    /// of one.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn steps<W, E>(
        &mut self,
        most: u32,
        work: &mut W,
        is_done: impl Fn(&W) -> bool,
        mut step: impl FnMut(&mut W) -> Result<u64, E>,
    ) -> Result<(), E> {
        for _ in 0..most {
            if is_done(work) || !self.may_step() {
                break;
            }
            let done = step(work)?;
            self.count(done);
        }
        Ok(())
    }

    /// Work that it has done so far in this frame.
    pub(crate) fn work(&self) -> u64 {
        self.work
    }

    /// What is left of it.
    pub(crate) fn left(&self) -> u64 {
        self.budget.after(self.work).0
    }

    /// Whether the frame has a budget: work that would otherwise be done at once is cut into steps.
    pub fn is_limited(&self) -> bool {
        self.budget.is_limited()
    }

    /// Whether it wanted a step and took none.
    pub(crate) fn is_waiting(&self) -> bool {
        self.work == 0 && self.was_refused.get()
    }

    /// Whether it stepped although nothing was left of the budget when its turn came.
    pub(crate) fn has_exceeded(&self) -> bool {
        self.budget.is_spent() && self.work > 0
    }
}
