//! What path-tracing is for in default sets.

use crate::techniques::{Occasion, Values};

/// Why it suits an occasion.
pub fn suits(_: &Occasion<'_>) -> Option<String> {
    None
}

/// Settings for an occasion.
pub fn settings(_: &Occasion<'_>) -> Values {
    Vec::new()
}
