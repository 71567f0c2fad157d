//! Obscurances: how much of the ambient light arrives at the texels of an atlas past what is near them, and in which colour (tutorial section 8.1).
//! Plain ambient occlusion is the case of a step as falloff.
//!
//! They are no light but a factor: two maps, one of numbers and one of colours ([`Solution`], which needs no renderer). The ambient term, a constant
//! light that they let through, is a choice. docs/techniques/obscurances.md.

mod ambient;
pub(crate) mod gpu;
mod peeling;
mod rays;
mod settings;
mod solution;
#[cfg(test)]
mod tests;

pub use ambient::{INFO, Obscurances};
pub use settings::{Ambient, FIELDS, Falloff, Mode, Settings};
pub use solution::{ObscurancePage, ObscuranceState, Solution};
