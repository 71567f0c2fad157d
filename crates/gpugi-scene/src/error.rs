//! The error type that all importers share: which file, where in the file, and why.

/// Why a file could not be imported as a scene or an image.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
#[error("{file}: {place}: {reason}")]
pub struct ImportError {
    /// The file, as the user named it.
    pub file: String,
    /// Where in the file: `line 12`, `accessors[3]`, `header`.
    pub place: String,
    /// What is wrong there and, if known, how to fix it.
    pub reason: String,
}

impl ImportError {
    /// An error in `file` at `place`.
    pub fn new(
        file: impl Into<String>,
        place: impl Into<String>,
        reason: impl std::fmt::Display,
    ) -> Self {
        Self {
            file: file.into(),
            place: place.into(),
            reason: reason.to_string(),
        }
    }
}
