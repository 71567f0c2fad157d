//! GPU times of passes: smoothed so that they can be read, and those of the last frames.

use std::collections::{BTreeMap, VecDeque};
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use gpugi::gpu::{GpuError, Timing, Timings};

/// Part of a new time in the mean.
const NEW: f64 = 0.1;
/// Frames that may be on their way.
const MOST_PENDING: usize = 4;
/// Frames of the history.
const HISTORY: usize = 120;

type Arrival = Pin<Box<dyn Future<Output = Result<Vec<Timing>, GpuError>>>>;

/// GPU times by pass (ms).
#[derive(Default)]
pub struct PassTimes {
    pending: Vec<Arrival>,
    means: BTreeMap<String, f64>,
    history: VecDeque<BTreeMap<String, f64>>,
}

impl PassTimes {
    /// Whether another frame should be timed.
    pub fn wants_more(&self) -> bool {
        self.pending.len() < MOST_PENDING
    }

    /// Takes a frame's times, which arrive later.
    pub fn follow(&mut self, timings: Timings) {
        self.pending.push(Box::pin(timings.arrival()));
    }

    /// Takes what has arrived. Never waits.
    pub fn update(&mut self) {
        let mut context = Context::from_waker(Waker::noop());
        let mut arrived = Vec::new();
        self.pending
            .retain_mut(|arrival| match arrival.as_mut().poll(&mut context) {
                Poll::Pending => true,
                Poll::Ready(times) => {
                    arrived.push(times.unwrap_or_default());
                    false
                }
            });
        for times in arrived {
            self.add(times);
        }
    }

    /// Adds the times of a frame: passes of the same name together. Passes that a frame lacks fade out of the means.
    fn add(&mut self, times: Vec<Timing>) {
        if times.is_empty() {
            return;
        }
        let mut sums: BTreeMap<String, f64> = BTreeMap::new();
        for time in times {
            *sums.entry(time.pass).or_default() += time.milliseconds;
        }
        if self.history.len() == HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(sums.clone());
        for (pass, mean) in &mut self.means {
            *mean += NEW * (sums.remove(pass).unwrap_or_default() - *mean);
        }
        self.means.extend(sums);
        self.means.retain(|_, mean| *mean > 1e-4);
    }

    /// The times of the last frames that were timed, the latest last.
    pub fn history(&self) -> &VecDeque<BTreeMap<String, f64>> {
        &self.history
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Milliseconds per frame by pass, the longest first.
    pub fn longest_first(&self) -> Vec<(&str, f64)> {
        let mut all: Vec<(&str, f64)> = self
            .means
            .iter()
            .map(|(pass, mean)| (pass.as_str(), *mean))
            .collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(passes: &[(&str, f64)]) -> Vec<Timing> {
        let timing = |&(pass, milliseconds): &(&str, f64)| Timing {
            pass: pass.to_owned(),
            milliseconds,
        };
        passes.iter().map(timing).collect()
    }

    #[test]
    fn times_of_a_name_are_summed_and_fade_out() {
        let mut times = PassTimes::default();
        let twice = frame(&[("gather", 1.0), ("depth", 4.0), ("gather", 2.0)]);
        times.add(twice);
        assert_eq!(times.longest_first(), [("depth", 4.0), ("gather", 3.0)]);
        for _ in 0..300 {
            times.add(frame(&[("gather", 1.0)]));
        }
        let left = times.longest_first();
        assert_eq!(left.len(), 1);
        assert!((left[0].1 - 1.0).abs() < 1e-6);
        // Adapters without timestamps.
        times.add(Vec::new());
        assert_eq!(times.longest_first().len(), 1);
        assert_eq!(times.history().len(), HISTORY);
        assert_eq!(times.history()[0]["gather"], 1.0);
    }
}
