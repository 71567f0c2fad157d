//! A hundred pictures of one scene by one renderer, and their time, beside that of `examples/python/many_pictures.py`:
//! what Python costs. `cargo run --release -p gpugi --example many_pictures -- SCENE TECHNIQUE[,...] SAMPLES SIDE`

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Instant;

use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::{Renderer, Techniques};
use gpugi_scene::builtin::builtin;

const PICTURES: u32 = 100;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let name = words.next().unwrap_or_else(|| "cornell".to_owned());
    let techniques = words.next().unwrap_or_else(|| "shadow-map".to_owned());
    let samples = words.next().map_or(Ok(1), |word| word.parse())?;
    let side = words.next().map_or(Ok(256), |word| word.parse())?;

    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let scene = builtin(&name, 1).ok_or("a built-in scene")?;
    let camera = &scene.cameras[0];
    let techniques = techniques.split(',').map(str::to_owned).collect();
    let mut renderer = Renderer::new(&gpu, &scene, [side; 2], Techniques::Named(techniques))?;
    let mut render = || -> Result<Vec<f32>, Box<dyn Error>> {
        renderer.forget();
        renderer.set_seed(0);
        renderer.converge(camera, false, |_, _| ControlFlow::Continue(()))?;
        for _ in 0..samples {
            renderer.render_sample(camera, samples, None, false)?;
        }
        Ok(renderer.radiance()?)
    };
    // Shaders are compiled in the first.
    render()?;
    let began = Instant::now();
    for _ in 0..PICTURES {
        render()?;
    }
    let milliseconds = began.elapsed().as_secs_f64() * 1000.0 / f64::from(PICTURES);
    println!("{milliseconds:.3} ms per picture on {}", gpu.adapter.name);
    Ok(())
}
