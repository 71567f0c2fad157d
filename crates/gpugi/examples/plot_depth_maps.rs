//! Draws the depth maps of a teapot from sixteen directional domains of the default sky (figure 16 of the tutorial), as
//! they lie in their atlas. `cargo run -p gpugi --example plot_depth_maps` writes
//! `docs/images/environment-depth-maps.png`, or the file given as argument.

use std::error::Error;
use std::path::PathBuf;

use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu, TextureAspect, read_texture};
use gpugi_scene::Environment;
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::save_png;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).map_or_else(
        || {
            let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
            root.join("../../docs/images/environment-depth-maps.png")
        },
        PathBuf::from,
    );
    let mut scene = builtin("teapot", 1).ok_or("no such scene")?;
    // The teapot alone, so that it fills the maps.
    scene.instances.retain(|instance| instance.name == "teapot");
    scene.environment = Some(Environment::default_sky());
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let technique = "image-based-lighting";
    let mut renderer = Renderer::new(&gpu, &scene, [16, 16], &[technique.to_owned()])?;
    renderer.set(technique, "samples", "16")?;
    renderer.set(technique, "resolution", "128")?;
    let camera = scene.cameras.first().ok_or("no camera")?;
    renderer.render_sample(camera, 1, None, false)?;
    let maps = renderer.maps();
    let is_atlas = |map: &&gpugi::techniques::Map| map.name == "image-based-lighting.atlas";
    let atlas = maps.iter().find(is_atlas);
    let atlas = atlas.and_then(|map| map.texture()).ok_or("no map")?;
    // Nearer is greater; 0 means that nothing is there.
    let depths: Vec<f32> = read_texture(&gpu, atlas, TextureAspect::DepthOnly, 0, 0)?;
    let pixels: Vec<u8> = depths
        .iter()
        .flat_map(|depth| {
            let grey = (depth * 255.0) as u8;
            [grey, grey, grey, 255]
        })
        .collect();
    save_png(&file, atlas.width(), atlas.height(), &pixels)?;
    println!("{}", file.display());
    Ok(())
}
