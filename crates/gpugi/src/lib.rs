//! Global illumination on any GPU: generate illumination into maps, then gather it at surface points.
//!
//! ```no_run
//! use std::ops::ControlFlow;
//! use gpugi::{Purpose, Renderer, picture::Effects, gpu::{AdapterChoice, Gpu}};
//!
//! let scene = gpugi_scene::builtin::builtin("cornell", 1).expect("a built-in scene");
//! let gpu = Gpu::open(&AdapterChoice::Best)?;
//! let camera = &scene.cameras[0];
//! let mut renderer = Renderer::new(&gpu, &scene, [640, 640], Purpose::StillPicture)?;
//! renderer.converge(camera, false, |_readiness, _times| ControlFlow::Continue(()))?;
//! renderer.render_sample(camera, 1, Some(&Effects::default()), false)?;
//! let rgba = renderer.pixels()?;
//! # Ok::<(), gpugi::LightingError>(())
//! ```

// What macros expand to names the crate, here, too.
extern crate self as gpugi;

pub mod bake;
pub mod capture;
pub mod default_set;
pub mod denoise;
pub mod gpu;
pub mod impostor;
pub mod jobs;
pub mod light_paths;
pub mod lighting;
mod lights;
#[cfg(not(target_arch = "wasm32"))]
pub mod measure;
mod paths;
pub mod picture;
pub mod prefiltered;
mod probes;
pub mod ray_bench;
pub mod reference;
pub mod renderer;
pub mod scene;
mod sequences;
pub mod settings;
#[cfg(test)]
mod shared;
mod shutter;
pub mod stage;
pub mod techniques;
#[cfg(test)]
mod testing;

pub use default_set::{Techniques, default_set};
pub use lighting::{Lighting, LightingError, Readiness};
pub use renderer::Renderer;
pub use shutter::Motion;
pub use techniques::Purpose;
