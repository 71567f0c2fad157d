//! Global illumination on any GPU: generate illumination into maps, then gather it at surface points.

pub mod gpu;
