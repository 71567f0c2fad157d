//! The gpugi viewer: global illumination live, in a window or on a page. docs/viewer.md says how to use it.
//!
//! [`session::Session`] is the loop that shows frame after frame; it and everything that it is made of know nothing of
//! windows. [`app::App`] draws its picture and its controls with egui.

pub mod app;
pub mod arguments;
#[cfg(target_arch = "wasm32")]
pub mod browser;
pub mod camera_control;
pub mod command;
pub mod game;
pub mod gamepad;
mod gizmo;
#[cfg(not(target_arch = "wasm32"))]
pub mod headless;
pub mod opening;
pub mod pace;
mod panels;
mod reading;
pub mod recording;
mod saving;
pub mod script;
pub mod session;
#[cfg(not(target_arch = "wasm32"))]
mod shader_watch;
pub mod task;
pub mod technique_set;
pub mod timings;
pub mod truth;
pub mod viewer;
#[cfg(target_arch = "wasm32")]
pub mod worker;
