//! Which technique may work in a frame, and how much.

use crate::scene::Versions;
use crate::techniques::{Budget, Slice};

/// Frames that keep to their budget after one that does not, while the scene changes.
const FRUGAL_FRAMES: u32 = 2;

/// Shares each frame's budget among the techniques.
#[derive(Debug)]
pub struct Schedule {
    /// Frames for which each technique has waited for a step.
    waited: Vec<u32>,
    /// The scene of the last frame.
    seen: Option<Versions>,
    /// Frames that kept to their budget since the last one that did not.
    frugal_frames: u32,
    /// The technique whose turn it is: it takes a step whatever is left.
    in_turn: Option<usize>,
    /// Whether it differs from that of the frame before.
    is_changing: bool,
    budget: Budget,
    /// Work of each technique for which those before it that light points leave room.
    waiting: Vec<u64>,
    work: u64,
}

impl Schedule {
    /// For so many techniques.
    pub fn new(techniques: usize) -> Self {
        Self {
            waited: vec![0; techniques],
            seen: None,
            frugal_frames: 0,
            in_turn: None,
            is_changing: false,
            budget: Budget::UNLIMITED,
            waiting: Vec::new(),
            work: 0,
        }
    }

    /// Begins a frame. `is_pending`: the last one lacked light; `waiting`: what each technique asks those before it to
    /// leave room for ([`crate::techniques::Technique::waiting`]).
    pub fn begin(
        &mut self,
        budget: Budget,
        versions: Versions,
        is_pending: bool,
        waiting: impl Iterator<Item = u64>,
    ) {
        // While the scene changes, maps are never final: most frames had better be fast.
        self.is_changing = self.seen.replace(versions) != Some(versions);
        let has_turns = !self.is_changing || is_pending || self.frugal_frames >= FRUGAL_FRAMES;
        self.frugal_frames = self.frugal_frames.saturating_add(1);
        let longest = self.waited.iter().copied().max().unwrap_or(0);
        let mut waited = self.waited.iter();
        self.in_turn = waited.position(|&frames| has_turns && frames == longest);
        self.waiting = waiting.collect();
        (self.budget, self.work) = (budget, 0);
    }

    /// The part of the budget of a technique; `leaves_room`: for what shows sooner, of those after it. While the scene
    /// changes, those that waited in the frame before have equal parts: otherwise the first, whose maps are never final,
    /// would leave nothing.
    pub fn slice(&self, technique: usize, leaves_room: bool) -> Slice {
        let mut left = self.budget.after(self.work);
        if leaves_room {
            left = left.after(self.waiting[technique + 1..].iter().sum());
        }
        if self.is_changing {
            let later = self.waited[technique + 1..].iter();
            left = left.shared_by(1 + later.filter(|&&frames| frames > 0).count() as u64);
        }
        Slice::new(left, self.in_turn == Some(technique))
    }

    /// Takes notice of what a technique did with its part.
    pub fn end(&mut self, technique: usize, slice: &Slice) {
        self.work = self.work.saturating_add(slice.work());
        if slice.has_exceeded() {
            self.frugal_frames = 0;
        }
        self.waited[technique] = match slice.is_waiting() {
            true => self.waited[technique] + 1,
            false => 0,
        };
    }

    /// Work of the frame so far.
    pub fn work(&self) -> u64 {
        self.work
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps that each technique takes of those it wants, all of one size.
    fn frame(
        schedule: &mut Schedule,
        budget: u64,
        versions: Versions,
        wanted: [u32; 3],
    ) -> [u32; 3] {
        schedule.begin(Budget::units(budget), versions, false, [0; 3].into_iter());
        let mut taken = [0; 3];
        for (technique, wanted) in wanted.into_iter().enumerate() {
            let mut slice = schedule.slice(technique, false);
            let is_done = |done: &u32| *done == wanted;
            let step = |done: &mut u32| {
                *done += 1;
                Ok::<_, ()>(10)
            };
            let steps = slice.steps(u32::MAX, &mut taken[technique], is_done, step);
            assert_eq!(steps, Ok(()));
            schedule.end(technique, &slice);
        }
        taken
    }

    fn changed(to: u64) -> Versions {
        Versions {
            lights: to,
            ..Versions::default()
        }
    }

    #[test]
    fn the_first_come_first_and_whoever_waited_longest_steps_all_the_same() {
        let mut schedule = Schedule::new(3);
        let still = Versions::default();
        let mut next = || frame(&mut schedule, 20, still, [9, 9, 9]);
        // The scene is new.
        assert_eq!(next(), [2, 0, 0]);
        // The second and the third take turns.
        assert_eq!(next(), [2, 1, 0]);
        assert_eq!(next(), [2, 0, 1]);
        assert_eq!(next(), [2, 1, 0]);
        assert_eq!(next(), [2, 0, 1]);
        assert_eq!(schedule.work(), 30);
    }

    #[test]
    fn who_wants_nothing_does_not_wait() {
        let mut schedule = Schedule::new(3);
        let still = Versions::default();
        for _ in 0..4 {
            frame(&mut schedule, 20, still, [0, 1, 0]);
        }
        assert_eq!(schedule.waited, [0; 3]);
        assert_eq!(frame(&mut schedule, 20, still, [2, 0, 1]), [2, 0, 0]);
        assert_eq!(schedule.waited, [0, 0, 1]);
        assert_eq!(frame(&mut schedule, 20, still, [2, 0, 1]), [2, 0, 1]);
    }

    #[test]
    fn while_the_scene_changes_every_third_frame_exceeds_its_budget() {
        let mut schedule = Schedule::new(3);
        let mut next = |number| frame(&mut schedule, 10, changed(number), [9, 9, 0]);
        let second: Vec<u32> = (1..10).map(|number| next(number)[1]).collect();
        assert_eq!(second, [0, 0, 1, 0, 0, 1, 0, 0, 1]);
        // A scene at rest has turns in every frame: whoever was refused once is next.
        let mut rest = || frame(&mut schedule, 10, changed(9), [9, 9, 0])[1];
        assert_eq!([rest(), rest(), rest(), rest()], [0, 1, 0, 1]);
    }

    #[test]
    fn while_the_scene_changes_those_that_wait_have_equal_parts() {
        let mut schedule = Schedule::new(3);
        let mut next = |number| frame(&mut schedule, 60, changed(number), [9, 9, 9]);
        // Nobody has waited yet.
        assert_eq!(next(1), [6, 0, 0]);
        assert_eq!(next(2), [2, 2, 2]);
        assert_eq!(next(3)[0], 6);
        // A scene at rest is made in the order in which it is seen.
        let mut rest = || frame(&mut schedule, 60, changed(3), [9, 9, 9]);
        rest();
        assert_eq!(rest()[0], 6);
    }

    #[test]
    fn what_lacks_light_has_turns_in_every_frame() {
        let mut schedule = Schedule::new(1);
        for number in 0..3 {
            let no_waiting = [0].into_iter();
            schedule.begin(Budget::units(0), changed(number), true, no_waiting);
            assert!(schedule.slice(0, false).may_step());
        }
    }

    #[test]
    fn techniques_leave_room_for_what_shows_sooner() {
        let mut schedule = Schedule::new(3);
        let waiting = [0, 0, 30].into_iter();
        let still = Versions::default();
        schedule.begin(Budget::units(100), still, false, waiting);
        assert_eq!(schedule.slice(0, false).left(), 100);
        assert_eq!(schedule.slice(0, true).left(), 70);
        assert_eq!(schedule.slice(2, true).left(), 100);
        let unlimited = [0, 0, 30].into_iter();
        schedule.begin(Budget::UNLIMITED, still, false, unlimited);
        assert!(!schedule.slice(0, true).is_limited());
    }
}
