//! Work of the CPU beside frames: texture atlases are laid out on a thread of their own. A page has no threads. It may
//! have workers, but they share no memory with it. So a job and its result are plain values, and a program may say
//! where jobs are done ([`do_elsewhere`]).

use std::fmt::Debug;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock, Weak};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Work that takes longer than a frame.
pub trait Job: Serialize + DeserializeOwned + Send + 'static {
    /// Its name, by which it is found where it is done.
    const NAME: &'static str;

    /// What comes of it.
    type Result: Serialize + DeserializeOwned + Debug + Send + Sync + 'static;

    /// Does the work. From time to time it calls `goes_on` with the share that is done (0 to 1), and ends early if that
    /// returns false: nobody waits any more.
    fn run(self, goes_on: &(dyn Fn(f32) -> bool + Sync)) -> Self::Result;
}

/// Begins a job of this name, or does it at once.
pub type Elsewhere = fn(name: &'static str, job: Vec<u8>, report: Report);

static ELSEWHERE: OnceLock<Elsewhere> = OnceLock::new();

/// From now on all jobs of the process are begun by `elsewhere`. The first call decides.
pub fn do_elsewhere(elsewhere: Elsewhere) {
    let _ = ELSEWHERE.set(elsewhere);
}

/// Does a job that was begun elsewhere, and returns its result in bytes for [`Report::end`]. `None`: `job` is none of
/// this type.
pub fn run<J: Job>(job: &[u8], goes_on: &(dyn Fn(f32) -> bool + Sync)) -> Option<Vec<u8>> {
    let job: J = postcard::from_bytes(job).ok()?;
    postcard::to_allocvec(&job.run(goes_on)).ok()
}

/// Begins a job: on a thread of its own or, in a browser, at once, unless [`do_elsewhere`] says where.
pub fn start<J: Job>(job: J) -> Running<J::Result> {
    let running = Running::new();
    if let Some(begin) = ELSEWHERE.get() {
        let job = postcard::to_allocvec(&job).expect("sequences of known length");
        begin(J::NAME, job, running.report());
        return running;
    }
    let waiting = Arc::downgrade(&running.0);
    let work = move || {
        let goes_on = |progress| {
            waiting
                .upgrade()
                .is_some_and(|state| state.goes_on(progress))
        };
        // A panic must not leave callers waiting for ever.
        let result = catch_unwind(AssertUnwindSafe(|| job.run(&goes_on)));
        if let Some(state) = waiting.upgrade() {
            let _ = state.result.set(result.ok());
        }
    };
    #[cfg(target_arch = "wasm32")]
    work();
    #[cfg(not(target_arch = "wasm32"))]
    std::thread::spawn(work);
    running
}

/// A job at work. It ends early once all copies of this are dropped.
#[derive(Debug)]
pub struct Running<R>(Arc<State<R>>);

impl<R> Clone for Running<R> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<R: DeserializeOwned + Debug + Send + Sync + 'static> Running<R> {
    fn new() -> Self {
        Self(Arc::new(State {
            progress: AtomicU32::new(0),
            result: OnceLock::new(),
        }))
    }

    fn report(&self) -> Report {
        let told: Weak<State<R>> = Arc::downgrade(&self.0);
        Report(told)
    }
}

impl<R> Running<R> {
    /// Share of the work that is done (0 to 1).
    pub fn progress(&self) -> f32 {
        f32::from_bits(self.0.progress.load(Ordering::Relaxed))
    }

    /// What has come of it, once it has ended: `Some(None)` if it failed.
    pub fn result(&self) -> Option<Option<&R>> {
        self.0.result.get().map(Option::as_ref)
    }

    /// Blocks until it has ended. Not for browsers.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn wait(&self) {
        self.0.result.wait();
    }
}

#[derive(Debug)]
struct State<R> {
    /// The bits of a 32-bit float.
    progress: AtomicU32,
    result: OnceLock<Option<R>>,
}

/// To be told about a job that is done elsewhere.
#[derive(Debug)]
pub struct Report(Weak<dyn Told>);

impl Report {
    /// The share that is done (0 to 1). Returns false if nobody waits any more: the work may end.
    pub fn goes_on(&self, progress: f32) -> bool {
        let told = self.0.upgrade();
        told.is_some_and(|told| told.goes_on(progress))
    }

    /// What [`run`] has returned.
    pub fn end(self, result: Option<Vec<u8>>) {
        if let Some(told) = self.0.upgrade() {
            told.end(result);
        }
    }
}

/// A [`State`], whatever the type of its result.
trait Told: Debug + Send + Sync {
    fn goes_on(&self, progress: f32) -> bool;
    fn end(&self, result: Option<Vec<u8>>);
}

impl<R: DeserializeOwned + Debug + Send + Sync> Told for State<R> {
    fn goes_on(&self, progress: f32) -> bool {
        self.progress.store(progress.to_bits(), Ordering::Relaxed);
        true
    }

    fn end(&self, result: Option<Vec<u8>>) {
        let result = result.and_then(|bytes| postcard::from_bytes(&bytes).ok());
        let _ = self.result.set(result);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    /// Counts to a number.
    #[derive(serde::Serialize, serde::Deserialize)]
    struct Count(u32);

    impl Job for Count {
        const NAME: &'static str = "count";
        type Result = u32;

        fn run(self, goes_on: &(dyn Fn(f32) -> bool + Sync)) -> u32 {
            assert!(self.0 < 1_000_000, "nobody counts that far");
            let share = |count| count as f32 / self.0 as f32;
            let counted = (1..=self.0).take_while(|&count| goes_on(share(count)));
            counted.count() as u32
        }
    }

    #[test]
    fn a_job_says_how_far_it_is_and_what_has_come_of_it() {
        let running = start(Count(3));
        running.wait();
        assert_eq!(
            (running.progress(), running.result()),
            (1.0, Some(Some(&3)))
        );
        let failed = start(Count(1_000_000));
        failed.wait();
        assert_eq!(failed.result(), Some(None));
    }

    #[test]
    fn a_job_ends_when_nobody_waits() {
        let (ended, ends) = channel();
        let running = Running::<u32>::new();
        let report = running.report();
        std::thread::spawn(move || {
            while report.goes_on(0.5) {}
            ended.send(()).unwrap();
        });
        drop(running);
        ends.recv().unwrap();
    }

    #[test]
    fn a_job_is_done_from_its_bytes_alone() {
        let running = Running::<u32>::new();
        let report = running.report();
        let job = postcard::to_allocvec(&Count(5)).unwrap();
        let result = run::<Count>(&job, &|progress| report.goes_on(progress));
        report.end(result);
        assert_eq!(
            (running.progress(), running.result()),
            (1.0, Some(Some(&5)))
        );
        assert_eq!(run::<Count>(&[], &|_| true), None);
    }
}
