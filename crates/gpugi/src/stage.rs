//! What is made for something, and kept as long as that stays the same: the one place that knows what is stale.

#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::gpu::{Frame, GpuError};

/// Why something cannot go on in this frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Unready {
    /// It waits for what a later frame may have.
    Waits {
        /// Share of what it waits for that is done (0 to 1).
        progress: f32,
        /// What it waits for.
        what: &'static str,
    },
    /// It failed.
    Failed(GpuError),
}

impl Unready {
    /// It waits for something of which nothing is known.
    pub const fn waits_for(what: &'static str) -> Self {
        Self::Waits {
            progress: 0.0,
            what,
        }
    }
}

impl From<GpuError> for Unready {
    fn from(error: GpuError) -> Self {
        Self::Failed(error)
    }
}

/// Waits for shaders in a frame that must not be held up by them.
///
/// # Errors
/// [`Unready::Waits`].
pub fn shaders(frame: &Frame<'_>) -> Result<(), Unready> {
    match frame.awaits_shaders() {
        true => Err(Unready::waits_for("shaders")),
        false => Ok(()),
    }
}

/// A value, and the key that it was made for, or is being made for: all that it depends on, such as settings and some of
/// a scene's versions ([`crate::scene::Versions::of`]).
///
/// A value that is made at once is asked for with [`Stage::keep`] or [`Stage::compiled`]. Work that takes several frames
/// goes by [`Stage::ask`], which every frame calls, [`Stage::begin`], which makes what was asked for the work's own, and
/// [`Stage::improve`]. So it may finish what it has begun while frames ask for something else.
#[derive(Debug)]
pub struct Stage<Key, Value = ()> {
    begun: Option<Key>,
    /// What the latest frame asked for, unless that is the same.
    asked: Option<Key>,
    /// Whether the frame before it asked for something else.
    is_fresh: bool,
    value: Option<Value>,
    revision: u64,
}

impl<Key, Value> Default for Stage<Key, Value> {
    fn default() -> Self {
        Self {
            begun: None,
            asked: None,
            is_fresh: false,
            value: None,
            revision: 0,
        }
    }
}

impl<Key: PartialEq, Value> Stage<Key, Value> {
    /// The value for `key`: the one that is there if it was made for the same, else what `make` makes. It may take over
    /// parts of the one before.
    ///
    /// # Errors
    /// Those of `make`; nothing is kept then.
    pub fn keep<E>(
        &mut self,
        key: Key,
        make: impl FnOnce(Option<Value>) -> Result<Value, E>,
    ) -> Result<&mut Value, E> {
        self.ask(key);
        let before = self.value.take();
        let value = match before {
            Some(value) if self.is_current() => value,
            before => {
                self.restart();
                make(before)?
            }
        };
        self.begin();
        Ok(self.value.insert(value))
    }

    /// As [`Stage::keep`], for what compiles shaders: in a frame that must not wait for them, it is made and not returned.
    ///
    /// # Errors
    /// [`Unready`].
    pub fn compiled(
        &mut self,
        frame: &Frame<'_>,
        key: Key,
        make: impl FnOnce(Option<Value>) -> Result<Value, GpuError>,
    ) -> Result<&mut Value, Unready> {
        let mut is_new = false;
        let value = self.keep(key, |before| {
            is_new = true;
            make(before)
        })?;
        if is_new {
            shaders(frame)?;
        }
        Ok(value)
    }

    /// Whether the work has to be done for `key`, which it then is for.
    pub fn renew(&mut self, key: Key) -> bool {
        self.ask(key);
        let is_due = !self.is_current();
        self.begin();
        is_due
    }

    /// Says what the frame asks for; returns whether the one before asked for something else.
    pub fn ask(&mut self, key: Key) -> bool {
        let before = self.asked.as_ref().or(self.begun.as_ref());
        self.is_fresh = before != Some(&key);
        self.asked = (self.begun.as_ref() != Some(&key)).then_some(key);
        self.is_fresh
    }

    /// Whether the work is for what the frame asks for.
    pub fn is_current(&self) -> bool {
        self.begun.is_some() && self.asked.is_none()
    }

    /// What the work is for.
    pub fn begun(&self) -> Option<&Key> {
        self.begun.as_ref()
    }

    /// The work is from now on for what the frame asks for.
    pub fn begin(&mut self) {
        self.begun = self.asked.take().or(self.begun.take());
    }

    /// What was made has become better. Users need to be told, unless they follow what this frame asks for anyway.
    pub fn improve(&mut self) {
        self.revision += u64::from(!self.is_fresh);
    }

    /// Part of the work that is done (0 to 1), of which `done` of `all` steps are: below 1 while it is for what an earlier
    /// frame asked for.
    pub fn progress(&self, done: u32, all: u32) -> f32 {
        done as f32 / (all + u32::from(!self.is_current())) as f32
    }
}

impl<Key, Value> Stage<Key, Value> {
    /// The value, for whatever it was made.
    pub fn get(&self) -> Option<&Value> {
        self.value.as_ref()
    }

    /// The same, to be changed.
    pub fn get_mut(&mut self) -> Option<&mut Value> {
        self.value.as_mut()
    }

    /// The work has to begin again, whatever frames ask for.
    pub fn restart(&mut self) {
        self.asked = self.asked.take().or(self.begun.take());
        self.begun = None;
    }

    /// Drops the value.
    pub fn clear(&mut self) {
        self.restart();
        self.value = None;
    }

    /// Counts how often what was made became better although nothing had changed.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Continues to count from a revision that was saved. A file may hold any number, and counters are added to it.
    pub fn set_revision(&mut self, saved: u64) {
        self.revision = saved.min(u32::MAX.into());
    }
}

/// A shared value as a key: the same only if it is that very value.
#[derive(Debug)]
pub struct Same<T>(pub Arc<T>);

impl<T> PartialEq for Same<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
