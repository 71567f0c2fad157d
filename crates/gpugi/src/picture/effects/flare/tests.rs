//! Flare against rays through the lens, against the Fourier transform of its stop, and what must not change.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, Mat4, dvec2, vec3};
use gpugi_scene::builtin::builtin;

use super::*;
use crate::Renderer;
use crate::picture::testing::{FLOATS, HALVES, film, radiance};
use crate::picture::{Effects, Shown};
use crate::testing::test_gpu;

const NARROW: f32 = 0.24;

fn camera(tangent: f32) -> Optics {
    Optics {
        tangent,
        lens: Lens::PINHOLE,
        seconds: 0.0,
    }
}

fn on() -> Settings {
    Settings {
        strength: 1.0,
        ..Settings::default()
    }
}

/// The picture with its flare.
fn flaring(
    gpu: &Gpu,
    size: [u32; 2],
    format: wgpu::TextureFormat,
    picture: &[[f32; 3]],
    camera: Optics,
    settings: &Settings,
) -> Vec<[f32; 3]> {
    flaring_by(
        &mut Pass::default(),
        gpu,
        size,
        format,
        picture,
        camera,
        settings,
    )
}

fn flaring_by(
    pass: &mut Pass,
    gpu: &Gpu,
    size: [u32; 2],
    format: wgpu::TextureFormat,
    picture: &[[f32; 3]],
    camera: Optics,
    settings: &Settings,
) -> Vec<[f32; 3]> {
    let film = film(gpu, size, format, picture);
    let mut frame = Frame::new(gpu, false);
    let result = pass
        .record(&mut frame, &film, camera, None, settings)
        .unwrap();
    frame.submit().unwrap();
    radiance(gpu, &result)
}

/// Black, with one bright pixel.
fn lamp(size: [u32; 2], [x, y]: [u32; 2], radiance: f32) -> Vec<[f32; 3]> {
    let mut picture = vec![[0.0; 3]; (size[0] * size[1]) as usize];
    picture[(y * size[0] + x) as usize] = [radiance; 3];
    picture
}

/// Middle of a pixel at the distance 1 from the eye, to the right and up.
fn place(size: [u32; 2], tangent: f32, x: f64, y: f64) -> DVec2 {
    let [width, height] = size.map(f64::from);
    let pixel = 2.0 * f64::from(tangent) / height;
    pixel * dvec2(x + 0.5 - width / 2.0, height / 2.0 - y - 0.5)
}

/// Whether a place on the stop, to the right and up, is open.
fn is_open(place: DVec2, opening: f64, blades: u32) -> bool {
    let part = TAU / f64::from(blades);
    let within = opening * (part / 2.0).cos();
    (0..blades).all(|blade| {
        let normal = DVec2::from_angle(FRAC_PI_2 + part * (f64::from(blade) + 0.5));
        place.dot(normal) <= within
    })
}

/// Radiance of all ghosts of a source of the irradiance 1 by rays, in green. They come in evenly over the front.
fn ghosts_by_rays(
    size: [u32; 2],
    tangent: f32,
    source: DVec2,
    f_number: f32,
    blades: u32,
) -> Vec<f64> {
    const RAYS: u32 = 110;
    let lens = Prescription::double_gauss();
    let opening = opening(&lens, f_number);
    let along = source.normalize();
    let cosine = (1.0 + source.length_squared()).sqrt().recip();
    let half = 1.1 * lens.surfaces[0].rim;
    let pixel = 2.0 * f64::from(tangent) / f64::from(size[1]);
    let shape = Lens::new(1.0, 1.0, blades).unwrap().area();
    let pupil = (opening * lens.pupil).powi(2) * f64::from(shape);
    let light = (2.0 * half / f64::from(RAYS)).powi(2) * cosine / (pixel * pixel * pupil);
    let mut picture = vec![0.0; (size[0] * size[1]) as usize];
    // From along and across the source's direction.
    let upright = |place: DVec2| place.x * along + place.y * along.perp();
    for pair in lens.pairs() {
        for index in 0..RAYS * RAYS {
            let at = |index: u32| half * (2.0 * (f64::from(index) + 0.5) / f64::from(RAYS) - 1.0);
            let entrance = dvec2(at(index % RAYS), at(index / RAYS));
            let Some(passage) = lens.trace(pair, Prescription::incoming(source.length(), entrance))
            else {
                continue;
            };
            let passes = passage.is_within_rims
                && (passage.stops.iter()).all(|&stop| is_open(upright(stop), opening, blades));
            let at = -upright(passage.film) / pixel;
            let [x, y] = [
                f64::from(size[0]) / 2.0 + at.x,
                f64::from(size[1]) / 2.0 - at.y,
            ];
            let is_inside =
                (0.0..f64::from(size[0])).contains(&x) && (0.0..f64::from(size[1])).contains(&y);
            if passes && is_inside {
                let index = y as usize * size[0] as usize + x as usize;
                picture[index] += light * arriving(&lens, &passage);
            }
        }
    }
    picture
}

/// Share of green light that arrives: all but what each surface reflects or lets through.
fn arriving(lens: &Prescription, passage: &prescription::Passage) -> f64 {
    let (mut arriving, mut is_back) = (1.0, false);
    for &(index, cosine, is_reflected) in &passage.met {
        let surface = &lens.surfaces[index];
        let ways = match is_back {
            true => [surface.behind, surface.before],
            false => [surface.before, surface.behind],
        };
        let share = coating::reflectance(Coating::Single, index, ways, cosine)[1];
        arriving *= if is_reflected { share } else { 1.0 - share };
        is_back ^= is_reflected;
    }
    arriving
}

/// Means of blocks of 8 x 8 pixels.
fn blocks(size: [u32; 2], picture: impl Fn(usize) -> f64) -> Vec<f64> {
    let [columns, rows] = size.map(|side| side / 8);
    let mut means = vec![0.0; (columns * rows) as usize];
    for index in 0..size[0] * size[1] {
        let [x, y] = [index % size[0], index / size[0]];
        means[(y / 8 * columns + x / 8) as usize] += picture(index as usize) / 64.0;
    }
    means
}

/// One bright pixel, aside of both axes, through a stop of five blades. It takes 2 s, for half a million rays.
#[test]
fn ghosts_are_those_of_rays_through_the_lens() {
    let Some(gpu) = test_gpu() else { return };
    let (size, at) = ([128, 96], [98, 26]);
    let settings = Settings {
        blades: 5,
        rays: false,
        f_number: 5.6,
        ..on()
    };
    let source = place(size, NARROW, at[0].into(), at[1].into());
    let picture = lamp(size, at, 1000.0);
    let found = flaring(&gpu, size, FLOATS, &picture, camera(NARROW), &settings);
    let cosine = (1.0 + source.length_squared()).sqrt().recip();
    let pixel = 2.0 * f64::from(NARROW) / f64::from(size[1]);
    let irradiance = 1000.0 * pixel * pixel * cosine.powi(3);
    let expected = ghosts_by_rays(size, NARROW, source, 5.6, 5);
    let expected = blocks(size, |index| irradiance * expected[index]);
    let found = blocks(size, |index| f64::from(found[index][1] - picture[index][1]));
    let difference: f64 = found
        .iter()
        .zip(&expected)
        .map(|(a, b)| (a - b).abs())
        .sum();
    let [found, expected]: [f64; 2] = [found.iter().sum(), expected.iter().sum()];
    println!(
        "light {}, difference {}",
        found / expected,
        difference / expected
    );
    assert!(
        (found / expected - 1.0).abs() < 0.05,
        "{found}, not {expected}"
    );
    assert!(
        difference < 0.12 * expected,
        "{} of the light is elsewhere",
        difference / expected
    );
}

/// The square of the Fourier transform of a stop of the radius 1, over its area, at `q` [1 / radius]: the sum over edges e
/// from v, i q x e / (2 pi |q|^2) sinc(q . e) exp(-2 pi i q . (v + e / 2)).
fn transform_squared(q: DVec2, blades: u32) -> f64 {
    let corner =
        |index: u32| DVec2::from_angle(FRAC_PI_2 + TAU * f64::from(index) / f64::from(blades));
    let mut sum = DVec2::ZERO;
    for blade in 0..blades {
        let [start, end] = [corner(blade), corner(blade + 1)];
        let (edge, middle) = (end - start, (start + end) / 2.0);
        let u = PI * q.dot(edge);
        let sinc = if u.abs() < 1e-9 { 1.0 } else { u.sin() / u };
        let size = q.perp_dot(edge) / (TAU * q.length_squared()) * sinc;
        sum += size * DVec2::from_angle(-TAU * q.dot(middle));
    }
    let area = f64::from(Lens::new(1.0, 1.0, blades).unwrap().area());
    sum.length_squared() / area
}

/// Sums over blocks of pixels, on rays and beside them, near the light and far from it.
#[test]
fn rays_are_the_fourier_transform_of_the_stop() {
    const SAMPLES: u32 = 40;
    let Some(gpu) = test_gpu() else { return };
    let (size, at, tangent, f_number) = ([96, 96], [48, 48], 0.05_f32, 16.0_f32);
    let pixel = 2.0 * f64::from(tangent) / f64::from(size[1]);
    let source = place(size, tangent, 48.0, 48.0);
    let radius = f64::from(FILM_HEIGHT) / (4.0 * f64::from(tangent) * f64::from(f_number));
    let picture = lamp(size, at, 1000.0);
    let irradiance = 1000.0 * pixel * pixel;
    // Along a ray to the right and one upward, and what lies on no ray of either.
    for (blades, on_ray) in [(6, [[60, 46], [80, 46]]), (5, [[46, 24], [46, 8]])] {
        let settings = Settings {
            blades,
            ghosts: false,
            f_number,
            ..on()
        };
        let found = flaring(&gpu, size, FLOATS, &picture, camera(tangent), &settings);
        for [left, top] in on_ray
            .into_iter()
            .chain([[60, 62], [52, 56], [30, 18], [8, 80]])
        {
            let (mut sum, mut expected) = (0.0, 0.0);
            for index in 0..36 {
                let [x, y] = [left + index % 6, top + index / 6];
                sum += f64::from(found[(y * size[0] + x) as usize][1]);
                for sample in 0..SAMPLES * SAMPLES {
                    let within = |index: u32| (f64::from(index) + 0.5) / f64::from(SAMPLES) - 0.5;
                    let offset = [within(sample % SAMPLES), within(sample / SAMPLES)];
                    let [x, y] = [f64::from(x) + offset[0], f64::from(y) + offset[1]];
                    let angle = place(size, tangent, x, y) - source;
                    // P(a) = |F(a / l)|^2 / (l^2 A), with lengths in radii of the stop.
                    let wavelength = coating::WAVELENGTHS[1] / radius;
                    let share =
                        transform_squared(angle / wavelength, blades) / (wavelength * wavelength);
                    expected += irradiance * share / f64::from(SAMPLES * SAMPLES);
                }
            }
            println!("{blades} blades, {left} {top}: {}", sum / expected);
            // Beside rays there is next to no light, of edges whose phases have not quite parted.
            let tolerance = if on_ray.contains(&[left, top]) {
                0.02
            } else {
                0.25
            };
            assert!(
                (sum / expected - 1.0).abs() < tolerance,
                "{blades}, {left} {top}: {sum}, not {expected}"
            );
        }
    }
}

#[test]
fn nothing_is_made_while_it_is_off() {
    let Some(gpu) = test_gpu() else { return };
    let size = [16, 16];
    let film = film(&gpu, size, FLOATS, &[[1.0; 3]; 256]);
    let mut pass = Pass::default();
    let mut show = |camera, settings: Settings| {
        pass.prepare(&gpu, FLOATS, &settings).unwrap();
        let mut frame = Frame::new(&gpu, false);
        let shown = pass
            .record(&mut frame, &film, camera, None, &settings)
            .unwrap();
        frame.submit().unwrap();
        (
            shown == film,
            [pass.kernels.is_some(), pass.images.is_some()],
        )
    };
    let neither = Settings {
        ghosts: false,
        rays: false,
        ..on()
    };
    assert_eq!(
        show(camera(0.4), Settings::default()),
        (true, [false, false])
    );
    assert_eq!(show(camera(0.4), neither), (true, [false, false]));
    assert_eq!(show(camera(0.4), on()), (false, [true, true]));
    assert_eq!(
        show(camera(0.0), on()),
        (true, [true, false]),
        "parallel rays have no angles"
    );
}

/// Also a picture whose light comes from everywhere alike, of which no place is a source.
#[test]
fn wrong_radiance_does_not_spread() {
    let Some(gpu) = test_gpu() else { return };
    let size = [70, 40];
    let mut pass = Pass::default();
    for wrong in [
        [0.2; 3],
        [f32::NAN, 1.0, 1.0],
        [-5.0, 0.2, f32::NEG_INFINITY],
        [f32::INFINITY; 3],
    ] {
        let mut picture = vec![[0.2; 3]; 2800];
        picture[210] = wrong;
        for format in [FLOATS, HALVES] {
            let found = flaring_by(&mut pass, &gpu, size, format, &picture, camera(0.4), &on());
            let far = found[2700][1];
            assert!(far.is_finite() && far >= 0.1999, "{wrong:?}: {far}");
            if wrong[0] == 0.2 {
                assert!(far < 0.21, "{far}");
            }
        }
    }
}

/// A point light in a dark room: it flares until a ball hides it. Still and live pictures, whole and in strips. It takes some 4 s, for
/// six renderers.
#[test]
fn lights_flare_where_nothing_hides_them() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("room", 1).unwrap();
    scene.lights.retain(|light| light.name.as_str() == "fill");
    let light = scene.lights[0].position();
    let eye = vec3(0.2, 0.5, -0.8);
    let camera = gpugi_scene::Camera::look_at("", eye, light + vec3(0.3, -0.2, 0.0), 1.0);
    let size = [64, 48];
    let ball = scene
        .instances
        .iter()
        .position(|instance| instance.name.as_str() == "sphere")
        .unwrap();
    let light_of = |is_hidden: bool, of: Effects, most_points: u32| {
        let mut scene = scene.clone();
        let at = if is_hidden {
            0.7 * light + 0.3 * eye
        } else {
            vec3(0.0, -9.0, 0.0)
        };
        let radius = 0.15;
        scene.instances[ball].world_from_mesh =
            Mat4::from_translation(at) * Mat4::from_scale(glam::Vec3::splat(radius));
        let mut renderer = Renderer::new(&gpu, &scene, size, &["shadow-map"]).unwrap();
        renderer.cut(size, most_points).unwrap();
        let mut effects = of.exposed(0.0).without_dither();
        renderer
            .render_sample(&camera, 1, Some(&effects), false)
            .unwrap();
        let mut shown = |strength| {
            effects.flare.strength = strength;
            renderer.display(Shown::Picture, &effects).unwrap();
            renderer.pixels().unwrap()
        };
        let [without, with] = [shown(0.0), shown(1.0)];
        let steps = with
            .iter()
            .zip(&without)
            .map(|(with, without)| with.saturating_sub(*without));
        steps.collect::<Vec<_>>()
    };
    let brightest = |steps: &[u8]| *steps.iter().max().unwrap();
    for of in [Effects::default(), Effects::of_live_view()] {
        let seen = light_of(false, of.clone(), u32::MAX);
        let in_strips = light_of(false, of.clone(), 64 * 8);
        let hidden = light_of(true, of, u32::MAX);
        assert!(brightest(&seen) > 40, "{}", brightest(&seen));
        assert!(
            brightest(&hidden) < brightest(&seen) / 5,
            "{}",
            brightest(&hidden)
        );
        let apart = seen.iter().zip(&in_strips).map(|(a, b)| a.abs_diff(*b));
        assert!(apart.max() <= Some(1), "strips differ");
    }
}
