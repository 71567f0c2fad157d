//! A square that flies past another, against the closed form of its coverage.

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::{Camera, Edit, Material, Projection, Scene};

use super::Settings;
use crate::picture::{Effects, ToneMap};
use crate::testing::test_gpu;
use crate::{Renderer, Techniques};

/// One pixel is as wide as 1/16 m.
const SIZE: [u32; 2] = [96, 64];
const PIXEL: f32 = 1.0 / 16.0;
const SECONDS: f32 = 1.0 / 50.0;

/// A bright square with a side of 1 m, in front of a grey strip at the lower half of the picture.
fn scene() -> Scene {
    let mut scene = Scene::new("squares");
    for (corner, across, up, brightness) in [
        (vec3(0.0, -0.5, 1.0), 1.0, 1.0, 0.8),
        (vec3(-3.0, -2.0, 0.0), 6.0, 2.0, 0.2),
    ] {
        let mesh = scene.add_mesh(quad(corner, Vec3::X * across, Vec3::Y * up, 1));
        let material = Material::emitter("shining", Vec3::splat(brightness));
        let material = scene.add_material(material);
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    }
    scene
}

fn value(pixels: &[u8], [x, y]: [u32; 2]) -> f64 {
    let value = f64::from(pixels[((y * SIZE[0] + x) * 4) as usize]) / 255.0;
    match value <= 0.04045 {
        true => value / 12.92,
        false => ((value + 0.055) / 1.055).powf(2.4),
    }
}

/// The picture of a square that has moved `step` metres to the right since the picture before, and ends at 0.
fn flown(renderer: &mut Renderer, step: f32, shutter: f32, settings: Settings) -> Vec<u8> {
    let mut effects = Effects::of_live_view().exposed(0.0).without_dither();
    effects.tone_map.operator = ToneMap::None;
    effects.motion_blur = settings;
    let camera = Camera {
        projection: Projection::Orthographic {
            height: SIZE[1] as f32 * PIXEL,
        },
        shutter,
        ..Camera::look_at("", Vec3::Z * 3.0, Vec3::ZERO, 1.0)
    };
    renderer.forget();
    for frame in (0..8).rev() {
        let world_from_mesh = Mat4::from_translation(Vec3::X * (-step * frame as f32));
        let edit = Edit::Instance {
            index: 0,
            world_from_mesh,
        };
        renderer.edit(&[edit]).unwrap();
        renderer.pass_time(SECONDS);
        let sample = renderer.render_sample(&camera, 1, Some(&effects), false);
        sample.unwrap();
    }
    renderer.pixels().unwrap()
}

/// A square of 16 pixels that flies w pixels to the right while the shutter is open covers the pixel x for a part of the time:
/// that for which x - 16 < w t < x.
#[test]
fn a_square_that_flies_covers_pixels_for_part_of_the_time() {
    let Some(gpu) = test_gpu() else { return };
    let none = Techniques::Named(Vec::new());
    let mut renderer = Renderer::new(&gpu, &scene(), SIZE, none).unwrap();
    let way = 6.0;
    for shutter in [1.0, 0.5] {
        // Each frame moves the square by so much that it flies 6 pixels while the shutter is open.
        let step = way as f32 * PIXEL / shutter;
        let settings = Settings { samples: 32 };
        let pixels = flown(&mut renderer, step, shutter * SECONDS, settings);
        for (row, behind) in [(30, 0.0), (34, 0.2)] {
            for x in -6_i32..26 {
                let (from, to) = (f64::from(x + 1 - 17) / way, f64::from(x) / way);
                // Mean over the pixel, which is one wide.
                let covered = (0..16).map(|part| {
                    let part = f64::from(part) / 16.0 + 1.0 / 32.0;
                    let part = part / way;
                    (to + part).clamp(0.0, 1.0) - (from + part).clamp(0.0, 1.0)
                });
                let covered = covered.sum::<f64>() / 16.0;
                let expected = 0.8 * covered + behind * (1.0 - covered);
                let found = value(&pixels, [(48 + x) as u32, row]);
                assert!(
                    (found - expected).abs() < 0.07,
                    "shutter {shutter}, row {row}, pixel {x}: {found}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn nothing_is_blurred_that_does_not_move_or_without_a_shutter() {
    let Some(gpu) = test_gpu() else { return };
    let none = Techniques::Named(Vec::new());
    let mut renderer = Renderer::new(&gpu, &scene(), SIZE, none).unwrap();
    // Samples lie elsewhere in each run, so edges differ by a little.
    let mut differing = |step, shutter| {
        let settings = [Settings::default(), Settings { samples: 0 }];
        let pictures = settings.map(|settings| flown(&mut renderer, step, shutter, settings));
        let row = |x| {
            let [with, without] = [0, 1].map(|index: usize| value(&pictures[index], [x, 30]));
            (with - without).abs() > 0.1
        };
        (0..SIZE[0]).filter(|&x| row(x)).count()
    };
    assert_eq!(differing(0.0, SECONDS), 0);
    assert_eq!(differing(0.25, 0.0), 0);
    assert!(differing(0.25, SECONDS) >= 4);
}
