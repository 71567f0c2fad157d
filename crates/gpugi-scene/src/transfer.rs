//! Precomputed transfer vectors of a still scene (radiance transfer), as files store them for programs that relight it.

use std::sync::Arc;

use blake3::{Hash, Hasher};
use half::f16;
use serde::{Deserialize, Serialize};

use crate::{Atlas, Mesh, Scene};

/// Bands of spherical harmonics that transfer vectors may have.
pub const ORDERS: std::ops::RangeInclusive<u32> = 2..=8;

/// Most bounces of light in transfer vectors.
pub const MOST_BOUNCES: u32 = 32;

/// The transfer vectors of an atlas's texels: E = pi sum of T_m L_m is the irradiance [W/m^2] of a texel under the light
/// whose radiance is the sum of L_m y_m. The y_m are real, orthonormal spherical harmonics with the polar axis +Y, in
/// the order l (l + 1) + m: those of direction (x, y, z) are the usual ones of (z, x, y).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransferVectors {
    /// Bands of spherical harmonics, in [`ORDERS`]: order * order functions.
    pub order: u32,
    /// Surfaces that light meets between the environment and the eye: 1 is direct light only.
    pub bounces: u32,
    /// Where the texels are. Its charts are not stored in files: every triangle with an area belongs to chart 0.
    pub atlas: Arc<Atlas>,
    /// T_m as red, green and blue, and 1 if the texel has a point, or 0 if its neighbours fill it: page by page,
    /// function by function, row by row from the top.
    #[serde(with = "crate::plain")]
    pub coefficients: Vec<[f16; 4]>,
    /// [`geometry`] of the scene that they were made for.
    pub geometry: [u8; 32],
}

impl TransferVectors {
    /// Coefficients per texel.
    pub fn functions(&self) -> usize {
        (self.order * self.order) as usize
    }

    /// Texels of a page.
    pub fn texels_per_page(&self) -> usize {
        (self.atlas.size as usize).pow(2)
    }

    /// Checks that there are texels, and a coefficient per function and texel.
    pub(crate) fn check_size(&self) -> Result<(), String> {
        let Atlas { size, pages, .. } = *self.atlas;
        if !ORDERS.contains(&self.order) {
            return Err(format!("order {} is not in 2 to 8", self.order));
        }
        let texels = u64::from(size).pow(2).saturating_mul(pages.into());
        let found = self.coefficients.len() as u64;
        if found == 0 || found != texels.saturating_mul(self.functions() as u64) {
            return Err(format!(
                "{found} coefficients for {texels} texels of order {}",
                self.order
            ));
        }
        Ok(())
    }

    /// Checks that there is a coefficient per function and texel, and that the vectors were made for this scene, with
    /// everything where it is now.
    ///
    /// # Errors
    /// Why they do not fit.
    pub fn check(&self, scene: &Scene) -> Result<(), String> {
        if !(1..=MOST_BOUNCES).contains(&self.bounces) {
            return Err(format!(
                "{} bounces are not in 1 to {MOST_BOUNCES}",
                self.bounces
            ));
        }
        self.check_size()?;
        self.atlas.check(scene)?;
        if self.geometry != geometry(scene, &self.atlas) {
            return Err(
                "they were made for another mesh, or something has moved since: bake them again"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

/// BLAKE3 of all triangles: where they lie in the world and in the atlas, which must belong to the scene. How vertices
/// are shared does not matter.
pub fn geometry(scene: &Scene, atlas: &Atlas) -> [u8; 32] {
    let mut hasher = Hasher::new();
    // Once per mesh: a short file may place a large mesh any number of times.
    let mut meshes: Vec<Option<Hash>> = vec![None; scene.meshes.len()];
    for (instance, place) in scene.instances.iter().zip(&atlas.instances) {
        let of_mesh =
            meshes[instance.mesh].get_or_insert_with(|| triangles(&scene.meshes[instance.mesh]));
        hasher.update(bytemuck::cast_slice(
            &instance.world_from_mesh.to_cols_array(),
        ));
        hasher.update(of_mesh.as_bytes());
        let page = place.as_ref().map_or(u32::MAX, |place| place.page);
        hasher.update(&page.to_le_bytes());
        if let Some(place) = place {
            hasher.update(bytemuck::cast_slice(&place.corners));
        }
    }
    *hasher.finalize().as_bytes()
}

/// BLAKE3 of a mesh's triangles: the positions of their corners.
fn triangles(mesh: &Mesh) -> Hash {
    let mut hasher = Hasher::new();
    for &index in &mesh.indices {
        hasher.update(bytemuck::bytes_of(&mesh.positions[index as usize]));
    }
    hasher.finalize()
}
