//! Transfer vectors as files store them.

use std::sync::Arc;

use half::f16;
use serde::{Deserialize, Serialize};

use crate::Atlas;

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
    /// [`geometry`](crate::transfer::geometry) of the scene that they were made for.
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
}
