//! Noise taken out of pictures and baked texels: what pixels see of surfaces, and the filter that it guides.

mod features;
mod filter;
mod of_points;
#[cfg(test)]
mod tests;
mod texels;

pub use features::Features;
pub(crate) use filter::MARGIN;
pub use filter::{Denoiser, NonLocalMeans, Window};
pub use of_points::OfPoints;
pub(crate) use texels::{FILTER_BYTES, SPREAD_BYTES, Spreads, TexelDenoiser};
