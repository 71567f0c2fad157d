//! How long tests may go on: continuous integration ends after a fixed time, on machines of any speed.

use std::cell::Cell;
use std::fs::OpenOptions;
use std::io::Write;
use std::thread;
use std::time::{Duration, SystemTime};

thread_local! {
    /// Whether this thread's test has begun: it goes on to its end.
    static HAS_BEGUN: Cell<bool> = const { Cell::new(false) };
}

/// Whether this test may begin: not after `GPUGI_TESTS_UNTIL`, in seconds since 1970, if that is set. If it may not, its
/// name is added to the file `GPUGI_TESTS_LEFT_OUT`, so that nobody takes it for one that passed.
///
/// # Panics
/// If the name cannot be written.
pub fn there_is_time() -> bool {
    let until = std::env::var("GPUGI_TESTS_UNTIL").ok();
    let Some(seconds) = until.and_then(|text| text.parse().ok()) else {
        return true;
    };
    let is_early = SystemTime::now() < SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
    if is_early || HAS_BEGUN.get() {
        HAS_BEGUN.set(true);
        return true;
    }
    let path = std::env::var_os("GPUGI_TESTS_LEFT_OUT").expect("GPUGI_TESTS_LEFT_OUT");
    let mut file = OpenOptions::new().append(true).create(true).open(path);
    let test = thread::current();
    let line = format!("{}\n", test.name().unwrap_or("a test"));
    let written = file.as_mut().map(|file| file.write_all(line.as_bytes()));
    assert!(matches!(written, Ok(Ok(()))), "{line}: {written:?}");
    false
}
