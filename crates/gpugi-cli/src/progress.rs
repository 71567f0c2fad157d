//! Progress of long work: a bar with the remaining time on a terminal, otherwise an occasional line; or told to a program.

use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::interrupt;

/// Steps of the bar.
const STEPS: u64 = 1000;
/// Time between lines if there is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// Takes the fraction that is done, 0 to 1, and what is being done; may break the work off.
pub type Call<'a> = &'a mut (dyn FnMut(f64, &str) -> ControlFlow<()> + Send + Sync);

/// Shows progress on standard error, or tells it.
pub struct Progress<'a> {
    bar: Option<ProgressBar>,
    started: Instant,
    last_line: Instant,
    quiet: bool,
    call: Option<Call<'a>>,
    /// Whether the call broke off.
    is_broken_off: bool,
    notes: Vec<String>,
}

impl<'a> Progress<'a> {
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
            call: None,
            is_broken_off: false,
            notes: Vec::new(),
        }
    }

    /// Tells `call`, and keeps notes.
    pub fn told_to(call: Call<'a>) -> Self {
        Self {
            call: Some(call),
            ..Self::new(true)
        }
    }

    /// Whether the user, or the call, asks to stop.
    pub fn is_asked_to_stop(&self) -> bool {
        self.is_broken_off || interrupt::asked()
    }

    /// Prints or keeps a note for the user.
    pub fn note(&mut self, note: String) {
        if self.call.is_some() {
            self.notes.push(note);
        } else if !self.quiet {
            eprintln!("note: {note}");
        }
    }

    /// The notes that it keeps.
    pub fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Shows that `fraction` of the work is done, 0 to 1.
    pub fn show(&mut self, fraction: f64, message: &str) {
        if let Some(call) = &mut self.call {
            self.is_broken_off |= call(fraction, message).is_break();
        } else if let Some(bar) = &self.bar {
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
