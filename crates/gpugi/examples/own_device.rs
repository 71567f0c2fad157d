//! gpugi on the device of an engine: it opens no adapter of its own, and its picture stays on the GPU.
//!
//! `cargo run --example own_device` draws a picture into a texture of the engine and reads back one pixel to show that
//! it is there.

use std::error::Error;

use gpugi::gpu::{Frame, Gpu, TextureAspect, read_texture};
use gpugi::picture::{Effects, Present};
use gpugi::{Purpose, Renderer};

fn main() -> Result<(), Box<dyn Error>> {
    // What an engine already has: an adapter, a device and its queue.
    let instance =
        wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_limits: Gpu::required_limits(&adapter),
        ..Default::default()
    }))?;
    let size = wgpu::Extent3d {
        width: 128,
        height: 96,
        depth_or_array_layers: 1,
    };
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("the engine's picture"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });

    let gpu = Gpu::from_device(&adapter, device, queue);
    let scene = gpugi_scene::builtin::builtin("room", 1).ok_or("a built-in scene")?;
    let mut renderer = Renderer::new(&gpu, &scene, [size.width, size.height], Purpose::LiveView)?;
    renderer.render_sample(&scene.cameras[0], 1, Some(&Effects::default()), false)?;

    let present = Present::new(&gpu, texture.format())?;
    let mut frame = Frame::new(&gpu, false);
    renderer.present(
        &mut frame,
        &present,
        &texture.create_view(&Default::default()),
    )?;
    frame.submit()?;

    let texels: Vec<[u8; 4]> = read_texture(&gpu, &texture, TextureAspect::All, 0, 0)?;
    let middle = texels[(size.height / 2 * size.width + size.width / 2) as usize];
    println!("the middle of the engine's picture is {middle:?}");
    Ok(())
}
