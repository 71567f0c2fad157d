//! Obscurances: the fraction of the ambient light that reaches the texels of an atlas past near surfaces, and its
//! colour (tutorial section 8.1). Plain ambient occlusion is the special case of a step falloff.
//!
//! Obscurances are not light but a factor: two maps, one of numbers and one of colours ([`Solution`], which needs no
//! renderer). The ambient term, a constant light that they attenuate, is optional. docs/techniques/obscurances.md.

mod ambient;
mod attenuation;
pub(crate) mod gpu;
mod peeling;
mod rays;
mod settings;
mod solution;
#[cfg(test)]
mod tests;

pub use ambient::{INFO, Obscurances, REGISTRATION};
pub use settings::{Ambient, Falloff, Mode, Settings};
pub use solution::{ObscurancePage, Solution};
