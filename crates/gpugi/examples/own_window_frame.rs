//! The frames of a window, headless. Each call does part of the work and returns at once, so that a window stays
//! responsive while shaders compile and maps are generated. After that, the picture improves from frame to frame.
//!
//! `cargo run --example own_window_frame` prints what each frame did.

use std::error::Error;

use gpugi::gpu::{AdapterChoice, Frame, Gpu};
use gpugi::picture::{Effects, Present};
use gpugi::{Readiness, Renderer};

const FRAMES: u32 = 16;

fn main() -> Result<(), Box<dyn Error>> {
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let scene = gpugi_scene::builtin::builtin("cornell", 1).ok_or("a built-in scene")?;
    let names = ["shadow-map", "radiosity"].map(str::to_owned);
    let mut renderer = Renderer::new(&gpu, &scene, [96, 96], &names)?;
    for (name, value) in [("resolution", "64"), ("iterations", "8"), ("burn-in", "2")] {
        renderer.set("radiosity", name, value)?;
    }
    // With a window, this is the texture of its surface.
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("window"),
        size: wgpu::Extent3d {
            width: 96,
            height: 96,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Bgra8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let view = texture.create_view(&Default::default());
    let present = Present::new(&gpu, texture.format())?;
    let effects = Effects::of_live_view();
    let mut presented = 0;
    while presented < FRAMES {
        let (readiness, _) =
            renderer.try_render_sample(&scene.cameras[0], u32::MAX, Some(&effects), false)?;
        match readiness {
            Readiness::Pending { what, .. } => {
                println!("waiting for {what}");
                // A window would draw its controls in the meantime.
                std::thread::sleep(std::time::Duration::from_millis(20));
                continue;
            }
            Readiness::Refining { progress } => println!("maps are {:.0} % done", 100.0 * progress),
            Readiness::Ready => println!("{} samples", renderer.samples()),
        }
        let mut frame = Frame::new(&gpu, false);
        renderer.present(&mut frame, &present, &view)?;
        frame.submit()?;
        presented += 1;
    }
    // A click, answered some frames later without blocking the window.
    let picked = renderer.pick([48, 48])?;
    gpu.wait()?;
    let point = picked.get().ok_or("it has arrived")??;
    println!(
        "the pixel in the middle shows {:?}",
        point.map(|point| point.position)
    );
    Ok(())
}
