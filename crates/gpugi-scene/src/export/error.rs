//! Why nothing could be exported.

use crate::ImportError;

/// Why a scene or a bake cannot be exported.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum ExportError {
    /// The original file cannot be read.
    #[error(transparent)]
    Original(#[from] ImportError),
    /// The scene, the atlas and the baked pages do not match, or do not fit into a file.
    #[error("{place}: {reason}")]
    Refused {
        /// Where: `instances[3]`, `pages[0]`.
        place: String,
        /// What is wrong there.
        reason: String,
    },
}

impl ExportError {
    pub(super) fn new(place: impl Into<String>, reason: impl std::fmt::Display) -> Self {
        Self::Refused {
            place: place.into(),
            reason: reason.to_string(),
        }
    }
}
