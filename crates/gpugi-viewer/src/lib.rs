//! The gpugi viewer: global illumination live, in a window. docs/viewer.md says how to use it.
//!
//! [`session::Session`] is the loop that shows frame after frame; it and everything that it is made of know nothing of
//! windows. [`app::App`] draws its picture and its controls with egui.

pub mod app;
pub mod camera_control;
pub mod command;
pub mod headless;
pub mod opening;
pub mod pace;
mod panels;
pub mod script;
pub mod session;
pub mod task;
pub mod technique_set;
pub mod timings;
pub mod truth;
pub mod viewer;
