//! Progress of long work: a bar with the remaining time on a terminal, otherwise an occasional line.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the bar.
const STEPS: u64 = 1000;
/// Time between lines if there is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// Shows progress on standard error.
#[derive(Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    started: Instant,
    last_line: Instant,
    quiet: bool,
}

impl Progress {
    /// Creates a progress display, which shows nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            ProgressBar::new(STEPS).with_style(
                ProgressStyle::with_template("{bar:40} {msg}, {eta} left")
                    .unwrap_or_else(|_| ProgressStyle::default_bar()),
            )
        });
        Self {
            bar,
            started: Instant::now(),
            last_line: Instant::now(),
            quiet,
        }
    }

    /// Shows that `fraction` of the work is done, 0 to 1.
    pub fn show(&mut self, fraction: f64, message: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(message.to_owned());
            bar.set_position((fraction * STEPS as f64) as u64);
        } else if !self.quiet && self.last_line.elapsed() >= LINE_INTERVAL {
            self.last_line = Instant::now();
            let passed = self.started.elapsed().as_secs_f64();
            let left = passed / fraction.max(1e-6) * (1.0 - fraction);
            eprintln!("{message}, {left:.0} s left");
        }
    }

    /// Clears the bar.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
