//! Noise taken out of pictures: what pixels see of surfaces, and the filter that it guides.

mod features;
mod filter;
mod of_points;
#[cfg(test)]
mod tests;

pub use features::Features;
pub use filter::{Denoiser, Window};
pub use of_points::OfPoints;
