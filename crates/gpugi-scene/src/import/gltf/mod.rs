//! glTF 2.0: JSON and binary files with geometry, materials, lights, cameras and animations.
//!
//! All files take the same path. [`document`] locates the bytes, [`accessor`] reads numbers from them, and [`geometry`]
//! builds a mesh per primitive. [`material`] and [`texture`] build surfaces. [`media`] reads fog and clouds. [`nodes`] places everything, repeatedly
//! where [`instancing`] requires it, and [`rig`] reads skins and animations. A file that breaks a rule causes an error
//! that names the JSON path; an optional feature that is not supported causes a warning.

mod accessor;
pub(crate) mod document;
mod draco;
mod extras;
pub(crate) mod geometry;
pub(crate) mod instancing;
mod material;
mod media;
#[cfg(feature = "meshopt")]
mod meshopt;
mod nodes;
pub(crate) mod panes;
mod rig;
pub(crate) mod schema;
pub(crate) mod texels;
mod texture;
pub(crate) mod transfer;
pub(crate) mod uri;

use crate::{ImportError, Limits, Resolver, Scene};
use document::Document;

/// Reads a glTF scene from JSON or binary.
pub fn import(
    name: &str,
    bytes: &[u8],
    resolver: &dyn Resolver,
    limits: &Limits,
) -> Result<Scene, ImportError> {
    let document = Document::read(name, bytes, resolver, limits)?;
    let mut scene = Scene::new(name);
    let mut materials = material::read_all(&document, resolver, &mut scene)?;
    nodes::read_all(&document, resolver, &mut materials, &mut scene)?;
    scene.transfer = transfer::read(&document, &scene)?;
    scene.panes = panes::read(&document, &scene)?;
    scene.warnings.extend(document.into_warnings());
    Ok(scene)
}
