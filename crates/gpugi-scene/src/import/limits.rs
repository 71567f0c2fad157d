//! What a file may ask for.

use super::text::quoted;

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
    /// Maximum number of triangles of all displaced meshes of a scene together: displacement is coarser beyond. 0 turns
    /// displacement off.
    pub displaced_triangles: u64,
}

impl Limits {
    /// None, for files that were written here from what has been read within limits.
    pub(crate) const NONE: Self = Self {
        file_bytes: u64::MAX,
        image_side: u32::MAX,
        image_bytes: u64::MAX,
        scene_bytes: u64::MAX,
        expansion: u64::MAX,
        displaced_triangles: u64::MAX,
    };

    /// Changes limits as `text` says: `file=BYTES,side=TEXELS,images=BYTES,scene=BYTES,expansion=N,displacement=N`, any of
    /// them. Bytes may end in KiB, MiB or GiB.
    ///
    /// # Errors
    /// Which part of the text is wrong, and what it may be.
    pub fn set(&mut self, text: &str) -> Result<(), String> {
        for part in text.split(',').filter(|part| !part.trim().is_empty()) {
            let wrong = || {
                format!(
                    "\"{}\" is no limit; limits are file, side, images, scene, expansion and displacement, as in scene=8GiB",
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
                "displacement" => self.displaced_triangles = value,
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
            displaced_triangles: 1 << 20,
        }
    }
}
