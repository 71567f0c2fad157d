//! Glow against the eye's point spread function, and what must not change: the sum of all light.

use std::f64::consts::TAU;

use gpugi_scene::builtin::builtin;

use super::scattering::{kernel, point_spread, share_of_pixel, weights};
use super::*;
use crate::Renderer;
use crate::picture::testing::{FLOATS, HALVES, film, radiance};
use crate::picture::{Effects, developed_of};
use crate::testing::test_gpu;

/// The picture after the effect, of a view of 45 degrees.
fn scattered(
    gpu: &Gpu,
    size: [u32; 2],
    format: wgpu::TextureFormat,
    picture: &[[f32; 3]],
    strength: f32,
) -> Vec<[f32; 3]> {
    let film = film(gpu, size, format, picture);
    let mut frame = Frame::new(gpu, false);
    let settings = Settings { strength };
    let mut pass = Pass::default();
    let result = pass
        .record(&mut frame, &film, size, TANGENT, &settings)
        .unwrap();
    frame.submit().unwrap();
    radiance(gpu, &result)
}

/// Dark, with a lamp of this radiance at each of these pixels.
fn lamps([width, height]: [u32; 2], radiance: f32, places: &[[u32; 2]]) -> Vec<[f32; 3]> {
    let mut picture = vec![[0.01; 3]; (width * height) as usize];
    for [x, y] in places {
        picture[(y * width + x) as usize] = [radiance, 0.5 * radiance, 0.1 * radiance];
    }
    picture
}

fn sums(picture: &[[f32; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|channel| picture.iter().map(|pixel| f64::from(pixel[channel])).sum())
}

fn assert_near(value: f64, expected: f64, tolerance: f64, what: impl std::fmt::Debug) {
    let error = (value - expected).abs();
    let largest = tolerance * expected.abs();
    assert!(error <= largest, "{what:?}: {value}, not {expected}");
}

/// The mean over rings, of points of light in five places, between them the borders of texels of all images.
#[test]
fn light_falls_off_as_in_the_eye() {
    const SIDE: u32 = 256;
    let Some(gpu) = test_gpu() else { return };
    let pixel = f64::from(2.0 * TANGENT) / f64::from(SIDE);
    let rings = |distance: f64| (distance.log2() * 4.0).round() as usize;
    // Sums of what is found and of what is expected.
    let mut profile = vec![[0.0; 2]; rings(80.0) + 1];
    let mut center = 0.0;
    let places = [[128, 128], [127, 121], [133, 124], [119, 130], [125, 139]];
    for place in places {
        let mut picture = vec![[0.0; 3]; (SIDE * SIDE) as usize];
        picture[(place[1] * SIDE + place[0]) as usize] = [1.0; 3];
        let found = scattered(&gpu, [SIDE; 2], FLOATS, &picture, 1.0);
        for (index, [share, ..]) in found.into_iter().enumerate() {
            let at = [index as u32 % SIDE, index as u32 / SIDE];
            let offset = [0, 1].map(|axis| at[axis].abs_diff(place[axis]));
            let distance = f64::from(offset[0]).hypot(f64::from(offset[1]));
            if distance == 0.0 {
                center += f64::from(share) / places.len() as f64;
            } else if distance < 80.0 {
                let [sum, expected] = &mut profile[rings(distance)];
                *sum += f64::from(share);
                *expected += share_of_pixel(pixel, offset, 4);
            }
        }
    }
    let expected = share_of_pixel(pixel, [0, 0], 64);
    println!("the pixel itself: {:.3}", center / expected);
    assert_near(center, expected, 0.1, "the pixel itself");
    for (ring, [found, expected]) in profile.into_iter().enumerate() {
        if expected > 0.0 {
            let distance = (ring as f64 / 4.0).exp2();
            println!("{distance:.1} pixels: {:.3}", found / expected);
            let tolerance = if distance < 1.5 { 0.35 } else { 0.12 };
            assert_near(found, expected, tolerance, distance);
        }
    }
}

/// So its constants are those of the paper: each of its three parts has the integral 1.
#[test]
fn the_function_keeps_all_light() {
    const STEPS: u32 = 100_000;
    // Steps grow with the angle, as t = 90 x^4 degrees.
    let integral: f64 = (0..STEPS)
        .map(|step| {
            let x = (f64::from(step) + 0.5) / f64::from(STEPS);
            let (degrees, width) = (90.0 * x.powi(4), 360.0 * x.powi(3) / f64::from(STEPS));
            point_spread(degrees) * TAU * degrees.to_radians().sin() * width.to_radians()
        })
        .sum();
    assert_near(integral, 1.0, 0.001, "the integral over the half space");
    // 0.478 * 20.91 / 1.02^3 + 0.138 * 72.37 / 1.02^2.
    assert_near(point_spread(1.0), 19.018, 1e-3, "1 degree");
}

/// Of all sizes of pixels that views have, from a telescope to 120 degrees.
#[test]
fn weights_fit_the_function() {
    for (size, degrees) in [
        ([1280, 1024], 45.0_f64),
        ([1280, 1024], 120.0),
        ([1280, 1024], 20.0),
        ([1280, 1024], 2.0),
        ([3840, 2160], 60.0),
        ([64, 48], 45.0),
    ] {
        let pixel = 2.0 * (degrees / 2.0).to_radians().tan() / f64::from(size[1]);
        let count = levels(size);
        let found = weights(pixel, count);
        let all = found.own + found.near + found.levels.iter().sum::<f64>();
        assert_near(all, 1.0, 1e-12, "all light");
        assert!(found.levels.iter().all(|weight| *weight >= 0.0) && found.near >= 0.0);
        let kernels: Vec<_> = (0..=count).map(kernel).collect();
        let weights: Vec<f64> = std::iter::once(found.near).chain(found.levels).collect();
        let mut worst = 0.0_f64;
        for distance in (4..=count * 4).map(|quarter| (f64::from(quarter) / 4.0).exp2() as u32) {
            let sum: f64 = (kernels.iter().zip(&weights))
                .map(|(kernel, weight)| {
                    weight * kernel[0] * kernel.get(distance as usize).unwrap_or(&0.0)
                })
                .sum();
            worst = worst.max((sum / share_of_pixel(pixel, [distance, 0], 4) - 1.0).abs());
        }
        println!("{size:?} {degrees}: {worst:.3}");
        assert!(worst < 0.2, "{size:?}, {degrees} degrees: {worst}");
    }
}

/// Of a picture with lamps in corners, at borders and inside, in sizes that no image halves.
#[test]
fn no_light_is_lost() {
    let Some(gpu) = test_gpu() else { return };
    for size in [[61, 37], [64, 48], [97, 1], [1, 1], [30, 75]] {
        let [right, bottom] = size.map(|side| side - 1);
        let places = [
            [0, 0],
            [right, 0],
            [0, bottom],
            [right, bottom],
            [right / 3, bottom / 2],
            [right, bottom / 3],
        ];
        for (format, tolerance) in [(FLOATS, 1e-5), (HALVES, 5e-4)] {
            let picture = lamps(size, 900.0, &places);
            let found = scattered(&gpu, size, format, &picture, 1.0);
            let [before, after] = [&picture, &found].map(|picture| sums(picture));
            for (before, after) in before.into_iter().zip(after) {
                println!("{size:?} {format:?} {}", after / before - 1.0);
                assert_near(after, before, tolerance, (size, format));
            }
        }
    }
}

#[test]
fn strength_is_the_share_that_is_scattered() {
    let Some(gpu) = test_gpu() else { return };
    let size = [40, 30];
    let picture = lamps(size, 50.0, &[[9, 20]]);
    let [all, part] = [1.0, 0.3].map(|strength| scattered(&gpu, size, FLOATS, &picture, strength));
    for ((all, part), before) in all.iter().zip(&part).zip(&picture) {
        for channel in 0..3 {
            let expected = 0.7 * before[channel] + 0.3 * all[channel];
            assert_near(part[channel].into(), expected.into(), 1e-5, channel);
        }
    }
    let grey = vec![[0.3; 3]; 1200];
    for value in scattered(&gpu, size, FLOATS, &grey, 1.0).as_flattened() {
        assert_near((*value).into(), 0.3, 1e-5, "a constant picture");
    }
}

#[test]
fn nothing_is_made_while_it_is_off() {
    let Some(gpu) = test_gpu() else { return };
    let size = [16, 16];
    let film = texture(&gpu, "film", FLOATS, size).unwrap();
    let mut pass = Pass::default();
    let mut show = |strength| {
        let settings = Settings { strength };
        pass.prepare(&gpu, FLOATS, &settings).unwrap();
        let mut frame = Frame::new(&gpu, false);
        let shown = pass
            .record(&mut frame, &film, size, 0.0, &settings)
            .unwrap();
        frame.submit().unwrap();
        let is_made = [!pass.kernels.is_empty(), pass.pyramid.is_some()];
        (shown == film, is_made)
    };
    assert_eq!(show(0.0), (true, [false, false]));
    assert_eq!(show(0.5), (false, [true, true]));
    assert_eq!(show(0.0), (true, [true, false]), "shaders stay compiled");
}

#[test]
fn wrong_radiance_does_not_spread() {
    let Some(gpu) = test_gpu() else { return };
    let size = [20, 20];
    let mut picture = vec![[0.2; 3]; 400];
    picture[210] = [f32::NAN, 1.0, 1.0];
    picture[33] = [-5.0, 0.2, -f32::INFINITY];
    for format in [FLOATS, HALVES] {
        let found = scattered(&gpu, size, format, &picture, 1.0);
        let mut all = found.as_flattened().iter();
        assert!(all.all(|value| (0.0..=0.201).contains(value)), "{found:?}");
    }
}

/// Still pictures, live ones and those on the host show the same. Off, nothing differs from what was before.
#[test]
fn pictures_of_all_kinds_glow() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let (camera, size) = (&scene.cameras[0], [64, 48]);
    let mut renderer = Renderer::new(&gpu, &scene, size, &["shadow-map"]).unwrap();
    let mut show = |of: Effects, strength| {
        let mut effects = of.exposed(0.0).without_dither();
        effects.glow.strength = strength;
        renderer.forget();
        for _ in 0..4 {
            renderer
                .render_sample(camera, 4, Some(&effects), false)
                .unwrap();
        }
        let radiance = renderer.radiance().unwrap();
        let developed = developed_of(&gpu, size, &radiance, camera, &effects).unwrap();
        (renderer.pixels().unwrap(), developed)
    };
    let (off, _) = show(Effects::default(), 0.0);
    let (still, developed) = show(Effects::default(), 1.0);
    let (live, developed_of_live) = show(Effects::of_live_view(), 1.0);
    assert_eq!(still, developed);
    let far = |a: &[u8], b: &[u8]| {
        let steps = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b));
        steps.max().unwrap()
    };
    assert!(far(&live, &developed_of_live) <= 1, "16-bit floats");
    assert!(far(&off, &still) > 20, "{}", far(&off, &still));
}
