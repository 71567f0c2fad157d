//! The page's address says what is seen, so that it can be copied and opened again.

use std::time::Duration;

use eframe::egui;
use web_time::Instant;

use crate::browser::show_address;
use crate::command;
use crate::session::Session;

/// Browsers refuse addresses that change more often.
const PAUSE: Duration = Duration::from_millis(500);

/// What the address said last.
#[derive(Debug, Default)]
pub struct Address {
    shown: String,
    since: Option<Instant>,
}

impl Address {
    /// Brings the address up to date, from time to time. While an animation runs, it stays.
    pub fn follow(&mut self, session: &Session, context: &egui::Context) {
        if session.clock.is_playing {
            return;
        }
        let wanted = command::address(session);
        if wanted == self.shown {
            return;
        }
        let rest = self
            .since
            .map(|since| PAUSE.saturating_sub(since.elapsed()));
        match rest.filter(|rest| !rest.is_zero()) {
            Some(rest) => context.request_repaint_after(rest),
            None => {
                show_address(&wanted);
                self.shown = wanted;
                self.since = Some(Instant::now());
            }
        }
    }
}
