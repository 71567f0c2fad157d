//! Bakes that were stopped, in files: a file appears complete or not at all, and is believed only when its checksum is right.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use gpugi_scene::{Atlas, Scene};
use serde::{Deserialize, Serialize};

use super::LightState;
use crate::techniques::obscurances::ObscuranceState;

/// First bytes of a file; the last is the format's version.
const MAGIC: &[u8; 16] = b"gpugi checkpoint";
/// Bytes of the checksum: BLAKE3 of all that follows it.
const CHECKSUM: usize = 32;

/// What a bake has come to.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Where texels lie.
    pub atlas: Atlas,
    /// Obscurances, once begun.
    pub obscurances: Option<ObscuranceState>,
    /// Light, once begun.
    pub light: Option<LightState>,
}

/// All that decides what a bake gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CheckpointKey([u8; CHECKSUM]);

impl CheckpointKey {
    /// Of `text`, which says what is baked and how, and of the running program with all its shaders as it is now: before a bake begins, for programs may be
    /// replaced while they run.
    ///
    /// # Errors
    /// When the program's file cannot be read.
    pub fn new(text: &str) -> io::Result<Self> {
        let program = std::fs::read(std::env::current_exe()?)?;
        let mut hasher = blake3::Hasher::new();
        hasher.update(blake3::hash(&program).as_bytes());
        hasher.update(text.as_bytes());
        Ok(Self(*hasher.finalize().as_bytes()))
    }
}

/// Why a file cannot be gone on from.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// It cannot be read.
    #[error("cannot be read")]
    Io(#[from] io::Error),
    /// It is another kind of file, or is not as it was written.
    #[error("{0}")]
    Damaged(String),
    /// It is of another scene, of other options or of another version of the program.
    #[error("is of another bake: the scene, the options or the program have changed")]
    OtherBake,
}

impl Checkpoint {
    /// Writes a file.
    ///
    /// # Errors
    /// What the file system says.
    pub fn write(&self, path: &Path, key: &CheckpointKey) -> io::Result<()> {
        let mut content = key.0.to_vec();
        content = postcard::to_extend(self, content).map_err(io::Error::other)?;
        gpugi_scene::image::replace_file(path, |file| {
            file.write_all(MAGIC)?;
            file.write_all(blake3::hash(&content).as_bytes())?;
            file.write_all(&content)
        })
    }

    /// Reads what [`Checkpoint::write`] wrote for the same key and scene.
    ///
    /// # Errors
    /// [`CheckpointError`].
    pub fn read(path: &Path, key: &CheckpointKey, scene: &Scene) -> Result<Self, CheckpointError> {
        let damaged = |how: &str| CheckpointError::Damaged(how.to_owned());
        let mut file = File::open(path)?;
        let mut start = [0; MAGIC.len() + CHECKSUM + CHECKSUM];
        file.read_exact(&mut start)
            .map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof => damaged("is no checkpoint"),
                _ => error.into(),
            })?;
        let (magic, hashes) = start.split_at(MAGIC.len());
        let (checksum, of_key) = hashes.split_at(CHECKSUM);
        if magic != MAGIC {
            return Err(damaged("is no checkpoint"));
        }
        let mut content = of_key.to_vec();
        file.read_to_end(&mut content)?;
        if blake3::hash(&content).as_bytes() != checksum {
            return Err(damaged("is damaged: its checksum is wrong"));
        }
        if key.0 != of_key {
            return Err(CheckpointError::OtherBake);
        }
        let (checkpoint, rest) = postcard::take_from_bytes::<Self>(&content[CHECKSUM..])
            .map_err(|error| damaged(&format!("cannot be understood ({error})")))?;
        if !rest.is_empty() {
            return Err(damaged("goes on after its end"));
        }
        let fits = checkpoint.atlas.check(scene);
        fits.map_err(|reason| damaged(&reason))?;
        Ok(checkpoint)
    }
}
