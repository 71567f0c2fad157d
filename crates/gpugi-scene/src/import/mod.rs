//! Importers: turn bytes, with the help of a [`Resolver`], into a [`Scene`].

pub(crate) mod budget;
pub(crate) mod gltf;
mod obj;
mod ply;
pub(crate) mod replaced;
pub(crate) mod text;

use std::path::{Component, Path, PathBuf};

use glam::Vec3;

use crate::{Environment, ImportError, Material, Scene};

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
    /// Maximum memory of everything else in a scene together (bytes): geometry, instances, animation, names.
    pub scene_bytes: u64,
    /// Maximum memory per byte of input, beyond 256 MiB (1 GiB for images). It stops short files that claim to hold
    /// much.
    pub expansion: u64,
}

impl Limits {
    /// Changes limits as `text` says: `file=BYTES,side=TEXELS,images=BYTES,scene=BYTES,expansion=N`, any of them. Bytes
    /// may end in KiB, MiB or GiB.
    ///
    /// # Errors
    /// Which part of the text is wrong, and what it may be.
    pub fn set(&mut self, text: &str) -> Result<(), String> {
        for part in text.split(',').filter(|part| !part.trim().is_empty()) {
            let wrong = || {
                format!(
                    "\"{}\" is no limit; limits are file, side, images, scene and expansion, as in scene=8GiB",
                    quoted(part)
                )
            };
            let (name, value) = part.split_once('=').ok_or_else(wrong)?;
            let value = number_of_bytes(value.trim()).ok_or_else(wrong)?;
            match name.trim() {
                "file" => self.file_bytes = value,
                "side" => self.image_side = u32::try_from(value).map_err(|_| wrong())?,
                "images" => self.image_bytes = value,
                "scene" => self.scene_bytes = value,
                "expansion" => self.expansion = value,
                _ => return Err(wrong()),
            }
        }
        Ok(())
    }
}

/// Parses `12`, `12KiB`, `12MiB` or `12GiB`.
fn number_of_bytes(text: &str) -> Option<u64> {
    for (unit, bytes) in [("KiB", 1 << 10), ("MiB", 1 << 20), ("GiB", 1 << 30)] {
        if let Some(number) = text.strip_suffix(unit) {
            return number.trim().parse::<u64>().ok()?.checked_mul(bytes);
        }
    }
    text.parse().ok()
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            file_bytes: 4 << 30,
            image_side: 16_384,
            image_bytes: 8 << 30,
            scene_bytes: 8 << 30,
            expansion: 1024,
        }
    }
}

/// Reads files in the importing file's folder, and below it. Paths that lead elsewhere are refused, also by symbolic
/// links.
#[derive(Debug, Clone)]
pub struct FileResolver {
    folder: PathBuf,
    /// Another folder whose files may be read.
    root: Option<PathBuf>,
    limits: Limits,
}

impl FileResolver {
    /// Resolves relative to `folder`.
    pub fn new(folder: &Path, limits: Limits) -> Self {
        Self {
            folder: folder.to_owned(),
            root: None,
            limits,
        }
    }

    /// Resolves relative to `folder`, and also reads files in `root` and below it.
    pub fn within(folder: &Path, root: &Path, limits: Limits) -> Self {
        Self {
            root: Some(root.to_owned()),
            ..Self::new(folder, limits)
        }
    }
}

impl Resolver for FileResolver {
    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        read_limited(&self.inside(uri)?, self.limits.file_bytes)
    }
}

impl FileResolver {
    /// The file at `uri`, which lies in an allowed folder or below it once `..` and symbolic links are followed.
    fn inside(&self, uri: &str) -> Result<PathBuf, String> {
        let path = Path::new(uri);
        let is_relative = path
            .components()
            .all(|part| !matches!(part, Component::RootDir | Component::Prefix(_)));
        // Drive letters are refused everywhere, so that a file that imports here also does on Windows.
        let scheme = uri.split_once(':').map_or("", |(scheme, _)| scheme);
        let has_scheme = scheme.len() == 1 || scheme.eq_ignore_ascii_case("file");
        if !is_relative || has_scheme {
            return Err(
                "absolute paths are not read; make it relative to the file that names it".into(),
            );
        }
        let folder = real(&self.folder)?;
        let root = self.root.as_deref().map(real).transpose()?;
        let is_allowed = |file: &Path| {
            file.starts_with(&folder) || root.as_ref().is_some_and(|root| file.starts_with(root))
        };
        // Before the file is looked for, so that a message never tells whether a file elsewhere exists.
        let mut named = folder.clone();
        for part in path.components() {
            match part {
                Component::ParentDir => drop(named.pop()),
                Component::Normal(name) => named.push(name),
                _ => {}
            }
        }
        if !is_allowed(&named) {
            return Err(
                "it lies outside the folder of the scene; --files-from FOLDER allows it".into(),
            );
        }
        let file = real(&folder.join(path))?;
        if !is_allowed(&file) {
            return Err(
                "a symbolic link leads outside the folder of the scene; --files-from FOLDER allows it".into(),
            );
        }
        Ok(file)
    }
}

/// The absolute path without symbolic links.
fn real(path: &Path) -> Result<PathBuf, String> {
    let is_here = path.as_os_str().is_empty();
    let path = if is_here { Path::new(".") } else { path };
    let real = path.canonicalize();
    real.map_err(|error| error.to_string())
}

/// The material of surfaces that have none: grey, or a matt one that shows the colours of their vertices as they are.
pub(crate) fn default_material(is_colored: bool) -> Material {
    if is_colored {
        return Material::matt("default", Vec3::ONE);
    }
    Material {
        name: "default".to_owned(),
        base_color: Vec3::splat(0.6).extend(1.0),
        roughness: 0.5,
        ..Material::default()
    }
}

/// The beginning of a text from a file, for messages.
pub(crate) fn quoted(text: &str) -> String {
    const MOST: usize = 60;
    let mut shown: String = text.chars().take(MOST).collect();
    if text.chars().nth(MOST).is_some() {
        shown.push_str("...");
    }
    shown
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
    let name = path.display().to_string();
    let bytes = read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(&name, "open", reason))?;
    import(&name, &bytes, resolver, limits)
}

/// Reads an equirectangular environment map (.hdr, .exr, .ktx2, .png, .jpg) at `path`.
pub fn import_environment(path: &Path, limits: &Limits) -> Result<Environment, ImportError> {
    let name = path.display().to_string();
    let bytes = read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(&name, "open", reason))?;
    Environment::from_file(&name, &bytes, limits)
}
