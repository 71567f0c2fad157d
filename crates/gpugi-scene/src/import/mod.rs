//! Importers: turn bytes, with the help of a [`Resolver`], into a [`Scene`].

pub(crate) mod gltf;
mod obj;
mod ply;

use std::path::{Path, PathBuf};

use crate::{Environment, ImportError, Scene};

/// Provides the other files that a file refers to.
pub trait Resolver {
    /// The bytes at `uri`, relative to the importing file. The error says why they are unavailable.
    fn read(&self, uri: &str) -> Result<Vec<u8>, String>;
}

/// Limits on the resources that a file may request; a file that exceeds them is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Maximum size of a file (bytes).
    pub file_bytes: u64,
    /// Maximum side of an image (texels).
    pub image_side: u32,
    /// Maximum size of all decoded images of a scene together (bytes).
    pub image_bytes: u64,
    /// Maximum number of vertices, and of indices, in a scene.
    pub elements: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            file_bytes: 4 << 30,
            image_side: 16_384,
            image_bytes: 8 << 30,
            elements: 200_000_000,
        }
    }
}

/// Reads files relative to the importing file's folder.
#[derive(Debug, Clone)]
pub struct FileResolver {
    folder: PathBuf,
    limits: Limits,
}

impl FileResolver {
    /// Resolves relative to `folder`.
    pub fn new(folder: &Path, limits: Limits) -> Self {
        Self {
            folder: folder.to_owned(),
            limits,
        }
    }
}

impl Resolver for FileResolver {
    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        read_limited(&self.folder.join(uri), self.limits.file_bytes)
    }
}

pub(crate) fn read_limited(path: &Path, limit: u64) -> Result<Vec<u8>, String> {
    let metadata = std::fs::metadata(path).map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("this is not a file".into());
    }
    if metadata.len() > limit {
        return Err(format!(
            "{} bytes are more than the limit of {limit}",
            metadata.len()
        ));
    }
    std::fs::read(path).map_err(|error| error.to_string())
}

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
    let scene = match extension.as_str() {
        "gltf" | "glb" => gltf::import(name, bytes, resolver, limits),
        "obj" => obj::import(name, bytes, resolver, limits),
        "ply" => ply::import(name, bytes, limits),
        _ => Err(ImportError::new(
            name,
            "file name",
            "gpugi reads scenes from .gltf, .glb, .obj and .ply files",
        )),
    }?;
    for (index, mesh) in scene.meshes.iter().enumerate() {
        mesh.check().map_err(|reason| {
            ImportError::new(name, format!("mesh {index} ({})", mesh.name), reason)
        })?;
    }
    Ok(scene)
}

/// Reads the scene file at `path`.
pub fn import_file(path: &Path, limits: &Limits) -> Result<Scene, ImportError> {
    let name = path.display().to_string();
    let bytes = read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(&name, "open", reason))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    import(&name, &bytes, &FileResolver::new(folder, *limits), limits)
}

/// Reads an equirectangular environment map (.hdr, .exr, .ktx2, .png, .jpg) at `path`.
pub fn import_environment(path: &Path, limits: &Limits) -> Result<Environment, ImportError> {
    let name = path.display().to_string();
    let bytes = read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(&name, "open", reason))?;
    Ok(Environment {
        image: crate::image::decode_radiance(&name, &bytes, limits)?.into(),
        rotation: 0.0,
        intensity: 1.0,
    })
}
