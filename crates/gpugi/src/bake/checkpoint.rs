//! Checkpoints: interrupted bakes as bytes. A checkpoint is read only if its checksum is right.

use gpugi_scene::{Atlas, Scene};
use serde::{Deserialize, Serialize};

use super::{LightState, ObscuranceState, PrecomputedState};

/// The magic number at the start of a checkpoint.
const MAGIC: &[u8; 16] = b"gpugi checkpoint";
/// Size of the checksum (bytes): BLAKE3 of everything after it.
const CHECKSUM: usize = 32;

/// The saved state of a bake.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Where the atlas puts texels.
    pub atlas: Atlas,
    /// Obscurances, once begun.
    pub obscurances: Option<ObscuranceState>,
    /// Light, once begun.
    pub light: Option<LightState>,
    /// Maps of a [`PrecomputedBake`](super::PrecomputedBake), once begun.
    pub precomputed: Option<PrecomputedState>,
}

/// A hash of everything that decides the result of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CheckpointKey([u8; CHECKSUM]);

impl CheckpointKey {
    /// `build` is the hash of the program with all its shaders. `text` describes what is baked and how.
    pub fn new(build: &[u8; 32], text: &str) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(build);
        hasher.update(text.as_bytes());
        Self(*hasher.finalize().as_bytes())
    }
}

/// Why a bake cannot resume from some bytes.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The bytes are no checkpoint, or are damaged.
    #[error("{0}")]
    Damaged(String),
    /// The checkpoint belongs to another scene, other options or another version of the program.
    #[error("is of another bake: the scene, the options or the program have changed")]
    OtherBake,
}

impl Checkpoint {
    /// The checkpoint as bytes, for [`Checkpoint::from_bytes`].
    pub fn to_bytes(&self, key: &CheckpointKey) -> Vec<u8> {
        let start = [&MAGIC[..], &[0; CHECKSUM], &key.0].concat();
        let mut bytes = postcard::to_extend(self, start).expect("sequences of known length");
        let (start, content) = bytes.split_at_mut(MAGIC.len() + CHECKSUM);
        start[MAGIC.len()..].copy_from_slice(blake3::hash(content).as_bytes());
        bytes
    }

    /// Reads the bytes that [`Checkpoint::to_bytes`] returned for the same key and scene.
    ///
    /// # Errors
    /// [`CheckpointError`].
    pub fn from_bytes(
        bytes: &[u8],
        key: &CheckpointKey,
        scene: &Scene,
    ) -> Result<Self, CheckpointError> {
        let damaged = |how: &str| CheckpointError::Damaged(how.to_owned());
        let (checksum, content) = bytes
            .strip_prefix(MAGIC)
            .and_then(|rest| rest.split_first_chunk::<CHECKSUM>())
            .ok_or_else(|| damaged("is no checkpoint"))?;
        if blake3::hash(content).as_bytes() != checksum {
            return Err(damaged("is damaged: its checksum is wrong"));
        }
        let state = content
            .strip_prefix(&key.0)
            .ok_or(CheckpointError::OtherBake)?;
        let (checkpoint, rest) = postcard::take_from_bytes::<Self>(state)
            .map_err(|error| damaged(&format!("cannot be understood ({error})")))?;
        if !rest.is_empty() {
            return Err(damaged("goes on after its end"));
        }
        let fits = checkpoint.atlas.check(scene);
        fits.map_err(|reason| damaged(&reason))?;
        Ok(checkpoint)
    }
}
