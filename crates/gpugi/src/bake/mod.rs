//! Light in texture space: what techniques add at the texels of an atlas, for files that other software shows (tutorial section 6, 7.3).
//!
//! [`LightBake`] and [`ObscuranceBake`] work in steps of bounded length. Between two of them a bake can be saved in a [`Checkpoint`], from which
//! another goes on.

mod checkpoint;
mod light;
mod obscurances;
#[cfg(test)]
mod tests;

pub use crate::capture::atlas::TexelLobes as Quantity;
pub use checkpoint::{Checkpoint, CheckpointError};
pub(crate) use light::Tile;
pub use light::{LightBake, LightOptions, LightState, LitAtlas, Progress, Stage};
pub use obscurances::ObscuranceBake;
