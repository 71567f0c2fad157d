//! glTF 2.0: JSON and binary, its geometry, materials, lights, cameras and animations.
//!
//! One way for every file: [`document`] finds the bytes, [`accessor`] reads numbers from them, [`geometry`] makes a
//! mesh of each primitive, [`material`] and [`texture`] make surfaces, [`nodes`] places everything, in many places what [`instancing`] says, and [`rig`] says
//! what moves. A file that breaks a rule gives an error that names the JSON path; what is only optional and not
//! supported gives a warning.

mod accessor;
pub(crate) mod document;
mod extras;
pub(crate) mod geometry;
pub(crate) mod instancing;
mod material;
#[cfg(feature = "meshopt")]
mod meshopt;
mod nodes;
mod rig;
pub(crate) mod schema;
mod texture;
pub(crate) mod uri;

use crate::{ImportError, Limits, Resolver, Scene};
use document::Document;

/// Reads a glTF scene, JSON or binary.
pub fn import(
    name: &str,
    bytes: &[u8],
    resolver: &dyn Resolver,
    limits: &Limits,
) -> Result<Scene, ImportError> {
    let document = Document::read(name, bytes, resolver, limits)?;
    let mut scene = Scene::new(name);
    let mut materials = material::read_all(&document, resolver, &mut scene)?;
    nodes::read_all(&document, &mut materials, &mut scene)?;
    scene.warnings.extend(document.into_warnings());
    Ok(scene)
}
