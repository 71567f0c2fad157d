//! Values that one thread at a time works with.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard};
use std::thread::{self, ThreadId};

/// As a `Mutex`. A callback that asks for what its own thread works with is refused, where it would wait for itself.
pub struct Busy<T> {
    owner: Mutex<Option<ThreadId>>,
    value: Mutex<T>,
}

/// The value, for as long as it lives.
pub struct Guard<'a, T> {
    owner: &'a Mutex<Option<ThreadId>>,
    value: MutexGuard<'a, T>,
}

impl<T> Busy<T> {
    pub fn new(value: T) -> Self {
        Self {
            owner: Mutex::default(),
            value: Mutex::new(value),
        }
    }

    /// Waits until no other thread works with it. To be called without Python's lock: threads that work call back.
    pub fn lock(&self) -> anyhow::Result<Guard<'_, T>> {
        crate::gpu::check_process()?;
        let this = thread::current().id();
        let is_own = *self
            .owner
            .lock()
            .unwrap_or_else(|broken| broken.into_inner())
            == Some(this);
        anyhow::ensure!(!is_own, "a callback cannot use what has called it");
        let value = self
            .value
            .lock()
            .unwrap_or_else(|broken| broken.into_inner());
        *self
            .owner
            .lock()
            .unwrap_or_else(|broken| broken.into_inner()) = Some(this);
        Ok(Guard {
            owner: &self.owner,
            value,
        })
    }
}

impl<T> Drop for Guard<'_, T> {
    fn drop(&mut self) {
        *self
            .owner
            .lock()
            .unwrap_or_else(|broken| broken.into_inner()) = None;
    }
}

impl<T> Deref for Guard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> DerefMut for Guard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.value
    }
}
