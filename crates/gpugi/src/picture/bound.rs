//! Bind groups by the resource that decides them.

use std::fmt::Debug;
use std::sync::{Arc, Mutex, PoisonError};

use crate::gpu::GpuError;

/// Most entries that are kept: the oldest goes first. A history has two images, which take turns, and large pictures
/// have several strips.
const MOST: usize = 16;

/// What was bound for each of the latest keys.
#[derive(Debug, Clone)]
pub(super) struct Bound<K, V>(Arc<Mutex<Vec<(K, V)>>>);

impl<K, V> Default for Bound<K, V> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<K: Clone + PartialEq, V: Clone> Bound<K, V> {
    /// What was bound for `key`, or what `bind` gives.
    pub fn get(&self, key: &K, bind: impl FnOnce() -> Result<V, GpuError>) -> Result<V, GpuError> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, value)) = kept.iter().find(|(one, _)| one == key) {
            return Ok(value.clone());
        }
        let value = bind()?;
        if kept.len() >= MOST {
            kept.remove(0);
        }
        kept.push((key.clone(), value.clone()));
        Ok(value)
    }
}
