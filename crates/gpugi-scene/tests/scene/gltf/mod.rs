//! glTF import, one test a feature. The files are built here, byte by byte.

mod animation;
mod container;
pub mod draco;
mod far;
mod geometry;
mod hostile;
mod images;
mod materials;
mod media;
#[cfg(feature = "meshopt")]
pub mod meshopt;
mod nodes;
