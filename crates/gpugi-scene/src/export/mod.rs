//! Exporters: write what was baked into texture space to a file that other software displays correctly. They return
//! bytes; writing the file is up to the caller.

mod baked;
mod error;
mod gltf;

use crate::atlas::Atlas;
use crate::{LightPathPanes, Scene, TransferVectors};
pub use baked::{
    BakedLight, BakedPage, Changes, Exported, LightmapQuantity, Original, TransferFormat,
};
pub use error::ExportError;

/// Writes `scene` as a .glb: one node per instance, materials as far as glTF and its extensions can express them,
/// punctual lights, cameras and media. Environment and animation are left out, with a warning.
///
/// # Errors
/// If the file would exceed 4 GiB.
pub fn export_scene(scene: &Scene) -> Result<Exported, ExportError> {
    let written = gltf::scene::write(scene)?;
    Ok(Exported {
        glb: written.output.glb()?,
        warnings: written.warnings,
    })
}

/// Writes a glTF file as one .glb, with its buffers and images in it. Everything else stays as it is.
///
/// # Errors
/// If it cannot be read, or the file would exceed 4 GiB.
pub fn export_original(original: &Original) -> Result<Exported, ExportError> {
    gltf::whole(original)
}

/// Writes a .glb that shows `scene` with the baked `pages`, using the texture coordinates of `atlas`.
///
/// If there is an `original`, from which `scene` was imported, everything in that file stays as it is except what the
/// bake must change: the instances that the atlas holds get their own materials, texture coordinates and, where the
/// atlas has cuts, vertices. Their other attributes, including skins and morph targets, are copied bit for bit.
/// External buffers, images and densities of the original are embedded; geometry that is no longer used stays in the file.
/// Whatever the atlas does not hold stays unchanged, including what was removed from `scene` after the import. Without
/// an original, the scene is first written as by [`export_scene`].
///
/// # Errors
/// If the original cannot be read, the parts do not match, or the file would exceed 4 GiB.
pub fn export_bake(
    original: Option<Original>,
    scene: &Scene,
    atlas: &Atlas,
    pages: &[BakedPage],
) -> Result<Exported, ExportError> {
    gltf::bake(original, scene, atlas, pages, None)
}

/// Writes a .glb that holds `scene` and its transfer vectors, for programs that relight it: docs/relight.md. Materials
/// stay as they are, but for a note in `extras.gpugi`; the geometry gets the texture coordinates of the vectors' atlas.
/// `original` is as for [`export_bake`]. [`TransferVectors::geometry`] is not used: it follows from the file.
///
/// # Errors
/// As [`export_bake`].
pub fn export_transfer(
    original: Option<Original>,
    scene: &Scene,
    vectors: &TransferVectors,
    format: TransferFormat,
) -> Result<Exported, ExportError> {
    let atlas = &vectors.atlas;
    let fits = vectors.check_size();
    fits.map_err(|reason| ExportError::new("transfer vectors", reason))?;
    let pages = vec![BakedPage::default(); atlas.pages as usize];
    let transfer = gltf::Stored::Transfer(gltf::Transfer { vectors, format });
    gltf::bake(original, scene, atlas, &pages, Some(transfer))
}

/// Writes a .glb that holds `scene` and its panes, for programs that relight it: docs/panes.md. Materials stay as they
/// are, but for a note in `extras.gpugi`; the geometry gets the texture coordinates of the panes' atlas. `original` is as
/// for [`export_bake`]. The hashes of `panes` are not used: they follow from the file.
///
/// # Errors
/// As [`export_bake`].
pub fn export_panes(
    original: Option<Original>,
    scene: &Scene,
    panes: &LightPathPanes,
) -> Result<Exported, ExportError> {
    let fits = panes.check_size();
    fits.map_err(|reason| ExportError::new("panes", reason))?;
    let pages = vec![BakedPage::default(); panes.atlas.pages as usize];
    let stored = gltf::Stored::Panes(panes);
    gltf::bake(original, scene, &panes.atlas, &pages, Some(stored))
}
