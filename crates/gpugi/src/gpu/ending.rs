//! The end of the process. A driver cleans up when `main` has returned, whatever its functions do on other threads at
//! that moment: Mesa's software driver then crashes in its compiler. So the end of the process waits for them.

use std::sync::{Condvar, Mutex, MutexGuard, Once, PoisonError};
use std::time::Duration;

/// Longest wait at the end: a crash is better than a process that stays.
const LONGEST: Duration = Duration::from_secs(20);

/// Threads at work.
static AT_WORK: Mutex<usize> = Mutex::new(0);
static CHANGED: Condvar = Condvar::new();

/// Work with the GPU on a thread that nobody joins: the process does not end before it is dropped.
#[derive(Debug)]
pub struct AtWork(());

impl AtWork {
    /// From now on the end of the process waits.
    pub fn begin() -> Self {
        *at_work() += 1;
        Self(())
    }
}

impl Drop for AtWork {
    fn drop(&mut self) {
        *at_work() -= 1;
        CHANGED.notify_all();
    }
}

/// Makes the process wait at its end. Handlers run in the reverse order of their registration, so this comes after the
/// driver was loaded.
pub(super) fn wait_at_the_end() {
    extern "C" fn wait() {
        drop(CHANGED.wait_timeout_while(at_work(), LONGEST, |count| *count > 0));
    }
    static REGISTERED: Once = Once::new();
    REGISTERED.call_once(|| {
        // SAFETY: the handler takes nothing, never unwinds, and touches statics without destructors alone.
        #[allow(unsafe_code)]
        let refused = unsafe { libc::atexit(wait) } != 0;
        if refused {
            tracing::debug!("the end of the process will not wait for its threads");
        }
    });
}

fn at_work() -> MutexGuard<'static, usize> {
    AT_WORK.lock().unwrap_or_else(PoisonError::into_inner)
}
