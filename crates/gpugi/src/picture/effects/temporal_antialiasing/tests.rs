//! Frames in motion against pictures of many samples.

use glam::{Mat4, Quat, Vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture as Compared, compare};
use gpugi_scene::{Camera, Scene};

use crate::Renderer;
use crate::gpu::Gpu;
use crate::picture::{Effects, developed};
use crate::scene::Edit;
use crate::testing::test_gpu;

const SIZE: [u32; 2] = [160, 128];

/// The scene's camera, turned about the scene's centre.
fn orbit(scene: &Scene, degrees: f32) -> Camera {
    let mut camera = scene.cameras[0].clone();
    let center = Mat4::from_translation(scene.bounds().center());
    let turn = Mat4::from_quat(Quat::from_rotation_y(degrees.to_radians()));
    camera.world_from_view = center * turn * center.inverse() * camera.world_from_view;
    camera
}

fn live() -> Effects {
    Effects::of_live_view().exposed(1.0).without_dither()
}

fn still() -> Effects {
    Effects::default().exposed(1.0).without_dither()
}

fn renderer(gpu: &Gpu, scene: &Scene) -> Renderer {
    let mut renderer = Renderer::new(gpu, scene, SIZE, &["shadow-map"]).unwrap();
    renderer.set("shadow-map", "area-samples", "8").unwrap();
    renderer.set("shadow-map", "interleaved", "true").unwrap();
    renderer
}

/// One frame of a picture of its own.
fn frame(renderer: &mut Renderer, camera: &Camera, effects: &Effects) -> Vec<u8> {
    renderer.restart();
    renderer
        .render_sample(camera, 1, Some(effects), false)
        .unwrap();
    renderer.pixels().unwrap()
}

/// The last frame of an orbit that ends where the camera stands.
fn moved(renderer: &mut Renderer, scene: &Scene, effects: &Effects) -> Vec<u8> {
    renderer.forget();
    let frames = (0..16).rev();
    let frames = frames.map(|step| frame(renderer, &orbit(scene, 0.3 * step as f32), effects));
    frames.last().unwrap()
}

/// A picture of `samples` samples, each of which is shown.
fn rested(renderer: &mut Renderer, camera: &Camera, samples: u32, effects: &Effects) -> Vec<u8> {
    renderer.restart();
    for _ in 0..samples {
        renderer
            .render_sample(camera, samples, Some(effects), false)
            .unwrap();
    }
    renderer.pixels().unwrap()
}

fn flip(test: &[u8], reference: &[u8]) -> f64 {
    let [test, reference] =
        [test, reference].map(|pixels| Compared::of_pixels(SIZE[0], SIZE[1], pixels));
    compare(Metric::Flip, &test, &reference).unwrap().value
}

/// A frame in orbit has 0.58 of the error that its sample alone has, in light without noise.
#[test]
fn frames_in_orbit_have_less_error() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let mut renderer = renderer(&gpu, &scene);
    let truth = rested(&mut renderer, &scene.cameras[0], 64, &still());
    let one = flip(&moved(&mut renderer, &scene, &still()), &truth);
    let averaged = flip(&moved(&mut renderer, &scene, &live()), &truth);
    println!("one sample {one:.4}, averaged {averaged:.4}");
    assert!(averaged < 0.7 * one, "{averaged} of {one}");
}

/// The error is 1.5 times that of one sample, whose edges are sharp and have stairs; with the mirror's own velocity it was 3
/// times. It takes as long as the maps of an impostor do.
#[test]
fn images_in_mirrors_stay_near_one_sample() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("room", 1).unwrap();
    let ball = scene
        .instances
        .iter()
        .position(|instance| instance.name.as_str() == "sphere");
    let center = scene.instances[ball.unwrap()]
        .world_from_mesh
        .w_axis
        .truncate();
    let eye = scene.cameras[0].world_from_view.w_axis.truncate();
    // Little else is seen.
    scene.cameras[0] = Camera::look_at("", center.lerp(eye, 0.7), center, 0.5);
    let names = ["shadow-map", "distance-impostor"];
    let mut renderer = Renderer::new(&gpu, &scene, SIZE, &names).unwrap();
    renderer
        .set("distance-impostor", "resolution", "64")
        .unwrap();
    let truth = rested(&mut renderer, &scene.cameras[0], 24, &still());
    let one = flip(&moved(&mut renderer, &scene, &still()), &truth);
    let averaged = flip(&moved(&mut renderer, &scene, &live()), &truth);
    println!("one sample {one:.4}, averaged {averaged:.4}");
    assert!(averaged < 1.8 * one, "{averaged} of {one}");
}

/// At rest, a live picture becomes what a still one is, whatever was seen before.
#[test]
fn at_rest_a_picture_stands_alone() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let camera = &scene.cameras[0];
    let mut renderer = renderer(&gpu, &scene);
    let alone = rested(&mut renderer, camera, 8, &still());
    moved(&mut renderer, &scene, &live());
    let live = rested(&mut renderer, camera, 8, &live());
    let radiance = renderer.radiance().unwrap();
    let exact = developed(&gpu, SIZE, &radiance, &still()).unwrap();
    let mut far = live.iter().zip(&exact).map(|(a, b)| a.abs_diff(*b));
    assert!(
        far.all(|steps| steps <= 1),
        "16-bit floats differ by a step"
    );
    let again = rested(&mut renderer, camera, 8, &still());
    assert_eq!(again, alone, "still pictures remember nothing");
}

/// After a light is switched off, its light is gone within a quarter of a second.
#[test]
fn light_that_is_switched_off_does_not_linger() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("room", 1).unwrap();
    let camera = &scene.cameras[0];
    let mut renderer = renderer(&gpu, &scene);
    let mean = |pixels: &[u8]| pixels.iter().map(|&byte| f64::from(byte)).sum::<f64>();
    for _ in 0..16 {
        frame(&mut renderer, camera, &live());
    }
    let mut light = scene.lights[0].clone();
    light.intensity *= 0.05;
    renderer.edit(&[Edit::Light { index: 0, light }]).unwrap();
    let frames = (0..15).map(|_| frame(&mut renderer, camera, &live()));
    let lingering = mean(&frames.last().unwrap());
    renderer.forget();
    let gone = mean(&frame(&mut renderer, camera, &live()));
    assert!(lingering < 1.05 * gone, "{lingering} of {gone}");
}

/// What moves takes its history along, and its shadow trails by little: with 1.3 times the error of one sample.
#[test]
fn what_moves_leaves_little_trail() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("room", 1).unwrap();
    let mut instances = scene.instances.iter();
    let index = instances
        .position(|instance| instance.name.as_str() == "box")
        .unwrap();
    let camera = &scene.cameras[0];
    let mut renderer = renderer(&gpu, &scene);
    let at = |step: usize| {
        let place = Mat4::from_translation(Vec3::new(0.02 * step as f32, 0.01 * step as f32, 0.0));
        Edit::Instance {
            index,
            world_from_mesh: place * scene.instances[index].world_from_mesh,
        }
    };
    for step in 0..16 {
        renderer.edit(&[at(step)]).unwrap();
        frame(&mut renderer, camera, &live());
    }
    let trail = renderer.pixels().unwrap();
    let truth = rested(&mut renderer, camera, 32, &still());
    let one = flip(&frame(&mut renderer, camera, &still()), &truth);
    let averaged = flip(&trail, &truth);
    println!("one sample {one:.4}, averaged {averaged:.4}");
    assert!(averaged < 1.6 * one, "{averaged} of {one}");
}

/// What is brighter than 16-bit floats can say stays white, and what is dark beside it stays finite.
#[test]
fn blinding_lamps_stay_white() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("cornell", 1).unwrap();
    for material in &mut scene.materials {
        material.emissive *= 1e5;
    }
    let mut renderer = renderer(&gpu, &scene);
    let effects = Effects::of_live_view().exposed(-16.0).without_dither();
    let pixels = moved(&mut renderer, &scene, &effects);
    let truth = rested(&mut renderer, &scene.cameras[0], 8, &still().exposed(-16.0));
    let lamp = |pixels: &[u8]| pixels.chunks(4).filter(|pixel| pixel[0] > 200).count();
    let [found, expected] = [&pixels, &truth].map(|pixels| lamp(pixels));
    assert!(
        expected > 50 && found.abs_diff(expected) < expected / 5,
        "{found} of {expected}"
    );
    let lit = |pixels: &[u8]| pixels.chunks(4).filter(|pixel| pixel[0] > 0).count();
    let [found, expected] = [&pixels, &truth].map(|pixels| lit(pixels));
    assert!(
        found.abs_diff(expected) < expected / 20,
        "{found} of {expected}"
    );
}

/// A quarter of the lookups: in orbit the error is 1.3 times that of frames that light all pixels, and less than that of
/// one sample. One frame alone has the textures and the edges of all pixels.
#[test]
fn frames_that_light_a_quarter_of_their_pixels_err_little_more() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let mut renderer = renderer(&gpu, &scene);
    let mut sparse = live();
    sparse.temporal_antialiasing.interval = 2;
    let truth = rested(&mut renderer, &scene.cameras[0], 32, &still());
    let one = flip(&moved(&mut renderer, &scene, &still()), &truth);
    let all = flip(&moved(&mut renderer, &scene, &live()), &truth);
    let quarter = flip(&moved(&mut renderer, &scene, &sparse), &truth);
    renderer.forget();
    let first = flip(&frame(&mut renderer, &scene.cameras[0], &sparse), &truth);
    println!(
        "one sample {one:.4}, all pixels {all:.4}, a quarter {quarter:.4}, its first frame {first:.4}"
    );
    assert!(
        quarter < 1.5 * all && quarter < one,
        "{quarter}, {all}, {one}"
    );
    assert!(first < 1.4 * one, "{first}");
}
