//! The lights of a scene as techniques use them: light samples, and a depth map for each view of a sample.
//!
//! Points, spots, directions and pieces of area lights form one list of [`gpu::LightSample`]s (`samples.rs`).
//! [`LightList`] adds the depth views that each needs, as large as one atlas has room for (`sharing.rs`). [`Shadows`]
//! draws them and keeps them for gathers, which import `table.wesl` and `lookup.wesl`.

mod cascades;
pub(crate) mod gpu;
mod list;
pub(crate) mod samples;
mod shadows;
mod sharing;
#[cfg(test)]
mod tests;
mod warp;

pub use list::{LightList, MapSettings};
pub use shadows::Shadows;
