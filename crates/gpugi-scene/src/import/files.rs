//! The files that an import reads.

use std::path::{Component, Path, PathBuf};

use super::limits::Limits;

/// Provides the other files that a file refers to.
pub trait Resolver {
    /// The bytes at `uri`, relative to the importing file. The error says why they are unavailable.
    fn read(&self, uri: &str) -> Result<Vec<u8>, String>;
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

/// The bytes of the file at `path`, of which there may be `limit`.
///
/// # Errors
/// Why they are unavailable.
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
