//! Whole pictures: default sets, references, measurements, and scenes that go wrong elsewhere.

#[path = "../common/mod.rs"]
mod common;
mod default_light;
mod golden;
mod lens;
mod measure;
mod metamorphic;
mod path_tracer;
mod receivers;
mod robustness;
mod strangers;
