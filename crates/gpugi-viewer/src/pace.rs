//! The pace of frames: how many pixels a moving picture has, in what parts one at rest gets all of its own, and how much
//! work on maps a frame does, so that frames keep the rate that was asked for.

use gpugi::lighting::Budget;

use crate::viewer::Look;

/// Each step of the resolution has this part of the pixels per side of the one before. In motion, the first step keeps the
/// pixels, and each frame lights one of four.
const STEP: f32 = 0.84;
/// Distance between the pixels that a frame lights, from the first step on.
const INTERVAL: u32 = 2;
/// Steps down to about an eighth of the side.
const MOST_STEPS: u32 = 12;
/// Fast frames after which the resolution rises by a step.
const PATIENCE: u32 = 12;
/// Longest time of a frame when nothing moves (s): input waits for it.
const STILL_SECONDS: f32 = 0.2;
/// Fewest pixels that a frame at rest lights: a strip has passes of its own.
const LEAST_POINTS: u32 = 4096;
/// Time that a picture of the path tracer may take in motion (s).
const TRACED_SECONDS: f32 = 0.1;
/// Frames per second, at least, while maps are made without a picture.
const MAPS_RATE: u32 = 60;
/// Limits of the budget, in units of [`Budget`].
const UNITS: [u64; 2] = [20_000, 1 << 40];

/// What a frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// A picture in motion.
    Moving,
    /// A picture at rest.
    Still,
    /// Maps alone, while the last picture stays.
    Maps,
}

/// How many of its pixels a picture has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// As many as leave frames their rate.
    Moving,
    /// As many as input may wait for at rest.
    Coarse,
    /// All, in as many frames as that takes.
    Full,
}

/// Chooses resolution and budget by the times of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Pace {
    /// Frames per second that are wanted in motion.
    pub target_rate: u32,
    /// Most pixels of the picture per pixel of the window, along a side.
    pub scale: f32,
    /// Whether pictures may have fewer pixels, so that frames are fast enough.
    pub is_adaptive: bool,
    in_motion: Resolution,
    at_rest: PixelTime,
    /// Work on maps beside a picture in motion.
    units_in_motion: u64,
    /// Work on maps without a picture.
    units_alone: u64,
}

/// A resolution that follows the times of frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Resolution {
    /// Below the most pixels.
    steps: u32,
    fast_frames: u32,
    /// By how much the last frame was too slow; 0 if it was not.
    slow: f32,
    /// Whether the first step lights fewer pixels instead.
    is_shared: bool,
}

impl Resolution {
    /// Takes notice of a frame by its time as a part of the time that is due.
    fn measure(&mut self, ratio: f32) {
        // The step back to all pixels takes more than others.
        let is_fast = ratio
            < if self.is_shared && self.steps == 1 {
                0.3
            } else {
                0.7
            };
        self.fast_frames = if is_fast { self.fast_frames + 1 } else { 0 };
        let slow = if ratio > 1.25 { ratio } else { 0.0 };
        // A single slow frame may be a pipeline that is compiled.
        let both = slow.min(self.slow);
        self.slow = slow;
        if both > 0.0 && self.steps < MOST_STEPS {
            // The time follows the number of pixels: as many steps at once as that takes.
            let steps = match self.is_shared && self.steps == 0 {
                true => 1,
                false => (0.5 * both.ln() / -STEP.ln()).ceil() as u32,
            };
            self.steps = (self.steps + steps.max(1)).min(MOST_STEPS);
            self.slow = 0.0;
        } else if self.fast_frames >= PATIENCE && self.steps > 0 {
            self.steps -= 1;
            self.fast_frames = 0;
        }
    }
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            target_rate: Look::default().frame_rate,
            scale: 1.0,
            is_adaptive: true,
            in_motion: Resolution {
                is_shared: true,
                ..Resolution::default()
            },
            at_rest: PixelTime::default(),
            units_in_motion: Budget::LIVE_VIEW_UNITS,
            units_alone: Budget::LIVE_VIEW_UNITS,
        }
    }
}

impl Pace {
    /// Takes notice of a frame that took `seconds`, did `work` on maps and lit `points` pixels.
    pub fn measure(&mut self, seconds: f32, work: u64, points: u32, purpose: Purpose) {
        let rate = self.target_rate.max(1);
        let due = 1.0 / rate as f32;
        match purpose {
            // Work on maps gives way first: pixels are seen at once.
            Purpose::Moving => {
                if !follow(&mut self.units_in_motion, seconds / due, work) {
                    self.in_motion.measure(seconds / due);
                    self.at_rest.measure(seconds, points);
                }
            }
            Purpose::Still => self.at_rest.measure(seconds, points),
            Purpose::Maps => {
                let due = 1.0 / rate.min(MAPS_RATE) as f32;
                follow(&mut self.units_alone, seconds / due, work);
            }
        }
    }

    /// Takes notice of a picture in motion that the path tracer took `seconds` for, over some frames.
    pub fn measure_traced(&mut self, seconds: f32) {
        self.in_motion.measure(seconds / TRACED_SECONDS);
    }

    /// Work on maps that the next frame may do.
    pub fn budget(&self, purpose: Purpose) -> Budget {
        Budget::units(match purpose {
            Purpose::Moving => self.units_in_motion,
            Purpose::Still => UNITS[0],
            Purpose::Maps => self.units_alone,
        })
    }

    /// Distance between the pixels that a frame in motion lights, where `chosen` is that of its settings.
    pub fn interval(&self, chosen: u32) -> u32 {
        match self.is_adaptive && self.in_motion.steps > 0 {
            true => chosen.max(INTERVAL),
            false => chosen,
        }
    }

    /// Pixels of the picture in a window of `size` pixels.
    pub fn size(&self, size: [u32; 2], detail: Detail) -> [u32; 2] {
        let scaled = |scale: f32| {
            size.map(|side| ((side as f32 * self.scale * scale).round() as u32).max(1))
        };
        let all = scaled(1.0);
        match detail {
            _ if !self.is_adaptive => all,
            Detail::Full => all,
            Detail::Moving => scaled(STEP.powi(self.in_motion.steps.saturating_sub(1) as i32)),
            Detail::Coarse => {
                let share = f64::from(self.points_at_rest()) / points(all);
                scaled(share.sqrt().min(1.0) as f32)
            }
        }
    }

    /// Pixels that a frame at rest lights at most.
    pub fn points_at_rest(&self) -> u32 {
        let due = 1.0 / self.target_rate.max(1) as f32;
        match self.at_rest.seconds() {
            Some(seconds) if self.is_adaptive => {
                ((STILL_SECONDS.max(due) / seconds) as u32).max(LEAST_POINTS)
            }
            _ => u32::MAX,
        }
    }
}

/// Time that a pixel takes: the shorter one of the last two frames', since one of them may have waited for a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct PixelTime {
    last_two: [Option<f32>; 2],
}

impl PixelTime {
    fn measure(&mut self, seconds: f32, points: u32) {
        if points > 0 && seconds > 0.0 {
            self.last_two = [self.last_two[1], Some(seconds / points as f32)];
        }
    }

    /// Seconds, once it is known.
    fn seconds(&self) -> Option<f32> {
        self.last_two.into_iter().flatten().reduce(f32::min)
    }
}

/// Pixels of a picture.
fn points([width, height]: [u32; 2]) -> f64 {
    f64::from(width) * f64::from(height)
}

/// Adapts a budget to a frame that did `work` within it, by its time as a part of the time that is due. Returns whether
/// the work is what made the frame slow.
fn follow(units: &mut u64, ratio: f32, work: u64) -> bool {
    let [least, most] = UNITS;
    if work > 0 && ratio > 1.2 && *units > least {
        let part = (1.0 / ratio).max(0.25);
        *units = ((work.min(*units) as f32 * part) as u64).clamp(least, most);
        return true;
    }
    if work >= *units && ratio < 1.0 {
        let more = if ratio < 0.5 { *units } else { *units / 4 };
        *units = (*units + more).clamp(least, most);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames whose time follows the number of pixels: `seconds` at full size.
    fn frames(pace: &mut Pace, seconds: f32, count: u32) -> f32 {
        let mut last = 0.0;
        for _ in 0..count {
            let [width, height] = pace.size([1000, 1000], Detail::Moving);
            let lit = (width * height) as f32 / pace.interval(1).pow(2) as f32;
            last = seconds * lit / 1e6;
            pace.measure(last, 0, lit as u32, Purpose::Moving);
        }
        last
    }

    #[test]
    fn moving_pictures_keep_the_rate_and_still_ones_their_pixels() {
        let mut pace = Pace::default();
        let last = frames(&mut pace, 0.3, 10);
        assert!(last < 1.25 / pace.target_rate as f32, "{last}");
        assert_eq!(pace.size([1000, 500], Detail::Full), [1000, 500]);
        // The way back, on a faster machine.
        frames(&mut pace, 0.005, 400);
        assert_eq!(pace.size([1000, 500], Detail::Moving), [1000, 500]);
        frames(&mut pace, 0.3, 10);
        pace.is_adaptive = false;
        assert_eq!(pace.size([1000, 500], Detail::Moving), [1000, 500]);
    }

    /// A pixel takes 2 microseconds: 100,000 of them, a tenth, may light at once.
    #[test]
    fn still_pictures_light_all_their_pixels_in_parts() {
        let mut pace = Pace::default();
        assert_eq!(pace.size([1000, 1000], Detail::Coarse), [1000, 1000]);
        for seconds in [2e-3, 5.0, 2e-3] {
            pace.measure(seconds, 0, 1000, Purpose::Moving);
        }
        assert_eq!(pace.points_at_rest(), 100_000);
        assert_eq!(pace.size([1000, 1000], Detail::Coarse), [316, 316]);
        assert_eq!(pace.size([1000, 1000], Detail::Full), [1000, 1000]);
        assert_eq!(pace.size([300, 300], Detail::Coarse), [300, 300]);
        // A slow machine lights some.
        for _ in 0..2 {
            pace.measure(5.0, 0, 1000, Purpose::Still);
        }
        assert_eq!(pace.points_at_rest(), LEAST_POINTS);
        pace.is_adaptive = false;
        assert_eq!(pace.size([1000, 1000], Detail::Coarse), [1000, 1000]);
        assert_eq!(pace.points_at_rest(), u32::MAX);
    }

    #[test]
    fn traced_pictures_have_the_pixels_that_they_are_quick_with() {
        let mut pace = Pace::default();
        let mut last = 0.0;
        for _ in 0..10 {
            let [width, height] = pace.size([1000, 1000], Detail::Moving);
            last = 2.0 * (width * height) as f32 / 1e6;
            pace.measure_traced(last);
        }
        assert!(last < 1.25 * TRACED_SECONDS, "{last}");
        assert_eq!(pace.size([1000, 1000], Detail::Full), [1000, 1000]);
    }

    #[test]
    fn slow_frames_light_fewer_pixels_before_pictures_have_fewer() {
        let mut pace = Pace::default();
        let due = 1.0 / pace.target_rate as f32;
        frames(&mut pace, 2.0 * due, 50);
        assert_eq!(
            (pace.interval(1), pace.size([1000, 1000], Detail::Moving)),
            (2, [1000, 1000])
        );
        // Half of the time is left, and a frame with all pixels takes twice what there is.
        frames(&mut pace, 2.0 * due, 100);
        assert_eq!(pace.interval(1), 2);
        frames(&mut pace, 0.5 * due, 100);
        assert_eq!((pace.interval(1), pace.interval(3)), (1, 3));
        pace.is_adaptive = false;
        frames(&mut pace, 8.0 * due, 100);
        assert_eq!(pace.interval(1), 1);
    }

    #[test]
    fn the_resolution_does_not_swing() {
        let mut pace = Pace::default();
        frames(&mut pace, 0.1, 100);
        let settled = pace.size([1000, 1000], Detail::Moving);
        frames(&mut pace, 0.1, 100);
        assert_eq!(pace.size([1000, 1000], Detail::Moving), settled);
    }

    #[test]
    fn maps_give_way_before_pixels() {
        let mut pace = Pace::default();
        let units = pace.units_in_motion;
        pace.measure(0.2, units, 4096, Purpose::Moving);
        assert!(pace.units_in_motion < units / 2);
        assert_eq!(pace.size([64, 64], Detail::Moving), [64, 64]);
        for _ in 0..40 {
            pace.measure(0.01, pace.units_in_motion, 4096, Purpose::Moving);
        }
        assert!(pace.units_in_motion > units);
        assert_eq!(pace.units_alone, units);
    }

    /// A machine that does 10^8 units per second, beside 0.1 s for a picture, which slow machines take.
    #[test]
    fn maps_alone_are_made_as_fast_as_frames_allow() {
        let mut pace = Pace::default();
        for _ in 0..100 {
            let work = pace.units_alone;
            pace.measure(work as f32 * 1e-8, work, 0, Purpose::Maps);
            pace.measure(0.1, UNITS[0], 4096, Purpose::Still);
        }
        let seconds = pace.units_alone as f32 * 1e-8;
        assert!((0.01..0.02).contains(&seconds), "{seconds}");
        assert_eq!(pace.size([64, 64], Detail::Full), [64, 64]);
    }

    #[test]
    fn a_picture_has_pixels() {
        let mut pace = Pace::default();
        frames(&mut pace, 1e6, 50);
        assert_eq!(pace.size([1, 3], Detail::Moving)[0], 1);
        pace.measure(f32::NAN, 0, 1, Purpose::Moving);
        assert!(
            pace.size([0, 0], Detail::Moving)
                .iter()
                .all(|&side| side > 0)
        );
    }
}
