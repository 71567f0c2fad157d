//! What exists in a gpugi scene, and how it gets there. No GPU code.
//!
//! A [`Scene`] holds meshes, instances, materials, images, lights, cameras and an environment in world space:
//! right-handed, +Y up, metres, linear Rec. 709. It comes from a file ([`import()`]) or from a procedure
//! ([`builtin`]). Importers take bytes and a [`Resolver`], so that they work where there is no file system.

pub mod animation;
pub mod atlas;
pub mod builtin;
pub mod bvh;
pub mod camera;
mod digest;
pub mod error;
pub mod export;
pub mod image;
pub mod import;
pub mod light;
pub mod material;
pub mod mesh;
pub mod names;
pub mod normals;
pub mod polygon;
pub mod provoking;
pub mod scene;
pub mod simplify;
pub mod tangents;

pub use atlas::{Atlas, AtlasError, AtlasOptions, InstanceUvs, TexelDensity};
pub use camera::{Camera, Projection};
pub use error::ImportError;
pub use image::{Image, Pixels};
pub use import::{FileResolver, Limits, Resolver, import, import_environment, import_file};
pub use light::{Light, LightKind};
pub use material::{AlphaMode, Material, MaterialModel, Texture, TextureRef, Volume, Wrap};
pub use mesh::Mesh;
pub use provoking::{ProvokingMesh, provoking_order};
pub use scene::{Bounds, Environment, Instance, Origin, Scene, Statistics};
