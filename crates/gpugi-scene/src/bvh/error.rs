//! Why a hierarchy cannot be built.

/// Why a scene has no hierarchy.
#[derive(Debug, Clone, Copy, thiserror::Error, PartialEq, Eq)]
pub enum BvhError {
    /// It would exceed a limit.
    #[error("{what} of the ray hierarchy: {needed} needed, {limit} is the most")]
    TooLarge {
        /// What exceeds the limit: rows (of 16 bytes) or levels.
        what: &'static str,
        /// The number that the hierarchy would need.
        needed: u64,
        /// The maximum.
        limit: u64,
    },
    /// A corner is infinite or NaN.
    #[error("triangle {triangle} of mesh {mesh} has a corner that is not finite")]
    NotFinite {
        /// Mesh number.
        mesh: usize,
        /// Triangle number.
        triangle: usize,
    },
}

/// The number, if it is `limit` or less.
pub(super) fn at_most(what: &'static str, needed: usize, limit: u32) -> Result<u32, BvhError> {
    match u32::try_from(needed) {
        Ok(number) if number <= limit => Ok(number),
        _ => Err(BvhError::TooLarge {
            what,
            needed: needed as u64,
            limit: limit.into(),
        }),
    }
}

/// The number of a row that follows so many.
pub(super) fn row_number(rows: usize) -> Result<u32, BvhError> {
    at_most("rows", rows, u32::MAX)
}
