//! The vignette against its closed form, in pictures of constant light.

use gpugi_scene::{Camera, Lens, Projection};

use super::*;
use crate::picture::effects::tone_map::twin::srgb_from_linear;
use crate::picture::{Effects, developed, developed_of};
use crate::testing::test_gpu;

const SIZE: [u32; 2] = [96, 64];

/// The settings of a picture as it is, but for a vignette.
fn effects(strength: f32, barrel: f32) -> Effects {
    let mut effects = Effects::default().exposed(0.0).of_colors();
    effects.vignette = Settings { strength, barrel };
    effects
}

fn camera(projection: Projection) -> Camera {
    Camera {
        projection,
        lens: Lens::new(0.01, 1.0, 0).unwrap(),
        ..Camera::look_at("", glam::Vec3::Z, glam::Vec3::ZERO, 1.0)
    }
}

/// Share of a disc of radius 1 that another one covers, its centre `apart`: both segments beyond the common chord, by
/// quadrature.
fn overlap(apart: f64) -> f64 {
    const STEPS: u32 = 2000;
    let half = (apart / 2.0).min(1.0);
    let width = (1.0 - half) / f64::from(STEPS);
    let places = (0..STEPS).map(|step| half + (f64::from(step) + 0.5) * width);
    let area: f64 = places.map(|x| 4.0 * (1.0 - x * x).sqrt() * width).sum();
    area / std::f64::consts::PI
}

#[test]
fn corners_are_darker_by_the_closed_form() {
    let Some(gpu) = test_gpu() else { return };
    let (degrees, radiance) = (80.0_f32, 0.9_f32);
    let camera = camera(Projection::Perspective {
        vertical_fov: degrees.to_radians(),
    });
    let white = vec![radiance; (SIZE[0] * SIZE[1] * 3) as usize];
    let pixel = 2.0 * f64::from(degrees / 2.0).to_radians().tan() / f64::from(SIZE[1]);
    for (strength, barrel) in [(1.0, 0.0), (0.4, 0.0), (1.0, 1.3), (0.7, 9.0)] {
        let effects = effects(strength, barrel);
        let pixels = developed_of(&gpu, SIZE, &white, &camera, &effects).unwrap();
        let [mut darkest, mut brightest] = [255, 0];
        for (index, found) in pixels.chunks(4).enumerate().step_by(7) {
            let at = [index as u32 % SIZE[0], index as u32 / SIZE[0]];
            let offset = [0, 1].map(|axis| f64::from(at[axis]) + 0.5 - f64::from(SIZE[axis]) / 2.0);
            let angle = (pixel * offset[0].hypot(offset[1])).atan();
            let passes = overlap(f64::from(barrel) * angle.tan());
            let share = 1.0 - f64::from(strength) * (1.0 - angle.cos().powi(4) * passes);
            let linear = f64::from(radiance) * share;
            let encoded = 255.0 * srgb_from_linear(linear);
            let error = (f64::from(found[0]) - encoded).abs();
            assert!(error < 0.55, "{at:?}: {}, not {encoded}", found[0]);
            [darkest, brightest] = [found[0].min(darkest), found[0].max(brightest)];
        }
        assert!(brightest - darkest > 40, "{darkest} to {brightest}");
    }
}

/// A view of parallel rays has no angles, and a pinhole no opening. Colours that mean something stay, too.
#[test]
fn parallel_views_and_pinholes_have_none() {
    let Some(gpu) = test_gpu() else { return };
    let camera = camera(Projection::Orthographic { height: 3.0 });
    let white = vec![0.5; (SIZE[0] * SIZE[1] * 3) as usize];
    let plain = developed(&gpu, SIZE, &white, &effects(0.0, 0.0)).unwrap();
    let all = effects(1.0, 2.0);
    assert!(developed_of(&gpu, SIZE, &white, &camera, &all).unwrap() == plain);
    assert!(developed(&gpu, SIZE, &white, &all).unwrap() == plain);
    let open = self::camera(Projection::Perspective { vertical_fov: 1.0 });
    assert!(developed_of(&gpu, SIZE, &white, &open, &all).unwrap() != plain);
    assert!(developed_of(&gpu, SIZE, &white, &open, &all.of_colors()).unwrap() == plain);
}

/// Exposure measures what arrives.
#[test]
fn exposure_follows_the_vignette() {
    let Some(gpu) = test_gpu() else { return };
    let white = vec![0.5; (SIZE[0] * SIZE[1] * 3) as usize];
    let middle = |strength| {
        let mut effects = effects(strength, 3.0);
        effects.exposure.value = crate::picture::Exposure::Auto;
        let camera = camera(Projection::Perspective { vertical_fov: 0.8 });
        let pixels = developed_of(&gpu, SIZE, &white, &camera, &effects).unwrap();
        pixels[((SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) * 4) as usize]
    };
    assert!(
        middle(1.0) > middle(0.0) + 20,
        "{} {}",
        middle(1.0),
        middle(0.0)
    );
}
