//! OBJ + MTL.

use crate::{ImportError, Limits, Resolver, Scene};

/// Reads an OBJ scene.
pub fn import(
    name: &str,
    _bytes: &[u8],
    _resolver: &dyn Resolver,
    _limits: &Limits,
) -> Result<Scene, ImportError> {
    Err(ImportError::new(name, "header", "not yet"))
}
