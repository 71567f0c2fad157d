//! Importers: turn bytes, with the help of a [`Resolver`], into a [`Scene`].

pub(crate) mod budget;
mod default_material;
mod files;
pub(crate) mod gltf;
mod limits;
mod obj;
mod ply;
pub(crate) mod replaced;
pub(crate) mod text;

use std::path::Path;

use crate::image::decode_radiance;
use crate::{Environment, ImportError, Scene};
use default_material::default_material;
pub(crate) use files::read_limited;
pub use files::{FileResolver, Resolver};
pub use limits::Limits;
pub(crate) use text::quoted;

/// A file may give cause for a warning in every line; nobody reads more than these.
const MOST_WARNINGS: usize = 100;

/// Reads a scene from `bytes`. The extension of `name` (.gltf, .glb, .obj, .ply) determines the format; error messages
/// include `name`.
pub fn import(
    name: &str,
    bytes: &[u8],
    resolver: &dyn Resolver,
    limits: &Limits,
) -> Result<Scene, ImportError> {
    let extension = Path::new(name)
        .extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    let mut scene = match extension.as_str() {
        "gltf" | "glb" => gltf::import(name, bytes, resolver, limits),
        "obj" => obj::import(name, bytes, resolver, limits),
        "ply" => ply::import(name, bytes, limits),
        _ => Err(ImportError::new(
            name,
            "file name",
            "gpugi reads scenes from .gltf, .glb, .obj and .ply files",
        )),
    }?;
    scene.warn_of_far_objects();
    let more = scene.warnings.len().saturating_sub(MOST_WARNINGS);
    if more > 0 {
        scene.warnings.truncate(MOST_WARNINGS);
        scene.warnings.push(format!("and {more} more warnings"));
    }
    for (index, mesh) in scene.meshes.iter().enumerate() {
        mesh.check().map_err(|reason| {
            ImportError::new(name, format!("mesh {index} ({})", mesh.name), reason)
        })?;
    }
    Ok(scene)
}

/// Reads the scene file at `path`, and what it refers to in its folder and below.
pub fn import_file(path: &Path, limits: &Limits) -> Result<Scene, ImportError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    import_resolved(path, &FileResolver::new(folder, *limits), limits)
}

/// Like [`import_file`]; the scene may also refer to files in `root` and below it.
pub fn import_file_within(path: &Path, root: &Path, limits: &Limits) -> Result<Scene, ImportError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    import_resolved(path, &FileResolver::within(folder, root, *limits), limits)
}

fn import_resolved(
    path: &Path,
    resolver: &FileResolver,
    limits: &Limits,
) -> Result<Scene, ImportError> {
    let bytes = read_file(path, limits)?;
    import(&path.display().to_string(), &bytes, resolver, limits)
}

/// The bytes of the file at `path`, if they are within the limits.
pub fn read_file(path: &Path, limits: &Limits) -> Result<Vec<u8>, ImportError> {
    read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(path.display().to_string(), "open", reason))
}

/// Reads an equirectangular environment map (.hdr, .exr, .ktx2, .png, .jpg) at `path`.
pub fn import_environment(path: &Path, limits: &Limits) -> Result<Environment, ImportError> {
    let bytes = read_file(path, limits)?;
    Environment::from_file(&path.display().to_string(), &bytes, limits)
}

impl Environment {
    /// Reads an equirectangular map (.hdr, .exr, .ktx2, .png, .jpg) from the bytes of a file; error messages include
    /// `name`.
    pub fn from_file(name: &str, bytes: &[u8], limits: &Limits) -> Result<Self, ImportError> {
        Ok(Self {
            image: decode_radiance(name, bytes, limits)?.into(),
            rotation: glam::Quat::IDENTITY,
            intensity: 1.0,
        })
    }
}
