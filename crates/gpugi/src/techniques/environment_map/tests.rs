//! Compares the environment's maps with sums over its texels in double precision.

use std::sync::Arc;

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec2};
use gpugi_scene::{Camera, Environment, Image, Pixels, Scene};

use super::{Earlier, EnvironmentMap, Technique};
use crate::capture::{CaptureKernels, Emission, View};
use crate::gpu::{Frame, Gpu, TextureAspect, read_buffer, read_texture};
use crate::prefiltered::{IRRADIANCE_SIDE, TABLE_SIDE, level_roughness};
use crate::scene::GpuScene;
use crate::shader;
use crate::shared::cpu::Case;
use crate::techniques::{EarlierLight, Shared};
use crate::testing::{Random, on_face, run_kernel, test_gpu};

/// An environment of `width` x `height` texels.
fn environment(width: usize, height: usize, texel: impl Fn(usize, usize) -> f32) -> Environment {
    Environment {
        image: Arc::new(Image {
            name: "environment".into(),
            width: width as u32,
            height: height as u32,
            pixels: Pixels::Rgba32Float(
                (0..width * height)
                    .flat_map(|index| {
                        let value = texel(index % width, index / width);
                        [value, 0.5 * value, 0.25 * value, 1.0]
                    })
                    .collect(),
            ),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// A dim, uneven sky with one bright texel.
pub(super) fn sunny(x: usize, y: usize) -> Environment {
    environment(32, 16, |u, v| {
        if (u, v) == (x, y) {
            400.0
        } else {
            0.5 + 0.03 * (u % 7) as f32 + 0.05 * v as f32
        }
    })
}

fn constant() -> Environment {
    environment(4, 2, |_, _| 1.0)
}

/// The technique after `generate`.
pub(super) fn generated(
    gpu: &Gpu,
    environment: &Environment,
    settings: &[(&str, &str)],
) -> EnvironmentMap {
    let mut scene = Scene::new("environment");
    scene.environment = Some(environment.clone());
    let scene = GpuScene::new(gpu, &scene).unwrap();
    let mut technique = EnvironmentMap::new(gpu, &scene).unwrap();
    for (name, value) in settings {
        technique.settings_mut().set(name, value).unwrap();
    }
    let camera = Camera::look_at("", glam::Vec3::Z, glam::Vec3::ZERO, 1.0);
    let view = View::new(&camera, [1, 1], Vec2::ZERO, 0, 0, 1.0);
    let mut frame = Frame::new(gpu, false);
    let mut emission = Emission::new(gpu, &scene).unwrap();
    let kernels = CaptureKernels::new(gpu, &scene).unwrap();
    let mut shared = Shared::new(gpu, &scene, &kernels).unwrap();
    let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut []), &mut shared);
    technique
        .generate(&mut frame, &scene, &view, &mut lit)
        .unwrap();
    frame.submit().unwrap();
    technique
}

/// One level of a cube map, or of a texture with one layer.
pub(super) struct Level {
    side: usize,
    /// Layer by layer, row by row.
    pub texels: Vec<DVec3>,
}

impl Level {
    pub fn read(gpu: &Gpu, technique: &EnvironmentMap, map: &str, level: u32) -> Self {
        let name = format!("environment-map.{map}");
        let maps = technique.inspect().maps;
        let map = maps.iter().find(|map| map.name == name).unwrap();
        let texture = map.texture().unwrap();
        let layers = 0..texture.depth_or_array_layers();
        let texels = layers
            .flat_map(|layer| {
                read_texture::<[u16; 4]>(gpu, texture, TextureAspect::All, layer, level).unwrap()
            })
            .map(|texel| {
                let [r, g, b, _] = texel.map(|half| f64::from(half::f16::from_bits(half)));
                DVec3::new(r, g, b)
            })
            .collect();
        Self {
            side: (texture.width() >> level) as usize,
            texels,
        }
    }

    /// Direction, solid angle and value of each texel.
    pub fn of_cube(&self) -> impl Iterator<Item = (DVec3, f64, DVec3)> + '_ {
        self.texels.iter().enumerate().map(|(index, &value)| {
            let n = self.side;
            let edge = |texel: usize| 2.0 * texel as f64 / n as f64 - 1.0;
            let (x, y, face) = (index % n, index / n % n, index / (n * n));
            let area = |x: f64, y: f64| (x * y).atan2((x * x + y * y + 1.0).sqrt());
            let (x0, x1, y0, y1) = (edge(x), edge(x + 1), edge(y), edge(y + 1));
            let solid_angle = area(x1, y1) - area(x0, y1) - area(x1, y0) + area(x0, y0);
            (
                on_face(face, (x0 + x1) / 2.0, (y0 + y1) / 2.0).normalize(),
                solid_angle,
                value,
            )
        })
    }

    fn total(&self) -> DVec3 {
        self.of_cube()
            .map(|(_, solid_angle, value)| solid_angle * value)
            .sum()
    }
}

/// An environment as the GPU holds it: its texels, and points with direction, solid angle and value.
pub(super) struct Exact {
    width: usize,
    height: usize,
    texels: Vec<DVec3>,
    points: Vec<(DVec3, f64, DVec3)>,
}

impl Exact {
    pub fn new(environment: &Environment) -> Self {
        let (width, height) = (
            environment.image.width as usize,
            environment.image.height as usize,
        );
        let Pixels::Rgba32Float(values) = &environment.image.pixels else {
            panic!("a radiance map")
        };
        let half = |value: f32| f64::from(half::f16::from_f32(value));
        let mut exact = Self {
            width,
            height,
            texels: values
                .chunks(4)
                .map(|texel| DVec3::new(half(texel[0]), half(texel[1]), half(texel[2])))
                .collect(),
            points: Vec::new(),
        };
        let within = (128 / height).max(1);
        let (columns, rows) = (width * within, height * within);
        for row in 0..rows {
            let theta = |row: f64| PI * row / rows as f64;
            let solid_angle =
                TAU / columns as f64 * (theta(row as f64).cos() - theta(row as f64 + 1.0).cos());
            let theta = theta(row as f64 + 0.5);
            for column in 0..columns {
                let phi = TAU * ((column as f64 + 0.5) / columns as f64 - 0.5);
                let direction = DVec3::new(
                    phi.sin() * theta.sin(),
                    theta.cos(),
                    -phi.cos() * theta.sin(),
                );
                let value = exact.at(direction);
                exact.points.push((direction, solid_angle, value));
            }
        }
        exact
    }

    /// Radiance interpolated between texels; rows wrap around.
    fn at(&self, d: DVec3) -> DVec3 {
        let x = (d.x.atan2(-d.z) / TAU + 0.5) * self.width as f64 - 0.5;
        let y = d.y.clamp(-1.0, 1.0).acos() / PI * self.height as f64 - 0.5;
        let texel = |x: f64, y: f64| {
            let x = (x as i64).rem_euclid(self.width as i64) as usize;
            self.texels[y.clamp(0.0, self.height as f64 - 1.0) as usize * self.width + x]
        };
        let (left, top) = (x.floor(), y.floor());
        let row = |y: f64| texel(left, y).lerp(texel(left + 1.0, y), x - left);
        row(top).lerp(row(top + 1.0), y - top)
    }

    /// The integral over the sphere of radiance times `weight`.
    pub fn integral(&self, weight: impl Fn(DVec3) -> f64) -> DVec3 {
        self.points
            .iter()
            .map(|(direction, solid_angle, value)| weight(*direction) * solid_angle * value)
            .sum()
    }

    fn irradiance(&self, normal: DVec3) -> DVec3 {
        self.integral(|d| normal.dot(d).max(0.0))
    }
}

fn maps_to_try() -> [(&'static str, Environment); 4] {
    [
        ("constant", constant()),
        ("default sky", Environment::default_sky()),
        ("a bright texel", sunny(20, 5)),
        ("a bright texel at the pole", sunny(3, 0)),
    ]
}

fn relative(found: DVec3, exact: DVec3) -> f64 {
    ((found - exact) / exact).abs().max_element()
}

#[test]
fn the_radiance_cube_holds_the_map() {
    let Some(gpu) = test_gpu() else { return };
    for (name, environment) in maps_to_try() {
        let exact = Exact::new(&environment);
        let technique = generated(
            &gpu,
            &environment,
            &[("resolution", "32"), ("samples", "1")],
        );
        let total = exact.integral(|_| 1.0);
        for level in 0..6 {
            let found = Level::read(&gpu, &technique, "radiance", level);
            assert_eq!(found.side, 32 >> level);
            let off = relative(found.total(), total);
            println!("{name}: light in level {level} is off by {off:.1e}");
            assert!(off < 3e-3, "{name}, level {level}: {off}");
        }
        // Compares texel by texel with the mean of many points spread over each; errors are relative to the texel plus
        // the map's mean. Samplers of hardware may round their weights to 8 bits: beside the brightest texel, that is an
        // error of its own.
        let mean = total / (4.0 * PI);
        let found = Level::read(&gpu, &technique, "radiance", 0);
        let brightest = found.of_cube().map(|(_, _, value)| value);
        let brightest = brightest.fold(DVec3::ZERO, DVec3::max) / 512.0;
        let mut worst = 0.0_f64;
        for (index, (_, _, value)) in found.of_cube().enumerate().step_by(7) {
            const POINTS: usize = 32;
            let (x, y, face) = (index % 32, index / 32 % 32, index / 1024);
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for point in 0..POINTS * POINTS {
                let place = |texel: usize, point: usize| {
                    (texel as f64 + (point as f64 + 0.5) / POINTS as f64) / 16.0 - 1.0
                };
                let d = on_face(face, place(x, point % POINTS), place(y, point / POINTS));
                let weight = d.length_squared().powf(-1.5);
                sum += weight * exact.at(d.normalize());
                weights += weight;
            }
            let expected = sum / weights;
            let off = ((value - expected).abs() - brightest).max(DVec3::ZERO);
            worst = worst.max((off / (expected + mean)).max_element());
        }
        println!("{name}: a texel is off by at most {worst:.1e}");
        assert!(worst < 0.03, "{name}: {worst}");
    }
}

#[test]
fn irradiance_is_the_sum_over_the_hemisphere() {
    let Some(gpu) = test_gpu() else { return };
    for (name, environment) in maps_to_try() {
        let exact = Exact::new(&environment);
        let technique = generated(
            &gpu,
            &environment,
            &[("resolution", "64"), ("samples", "1")],
        );
        let cube = Level::read(&gpu, &technique, "irradiance", 0);
        assert_eq!(cube.side, IRRADIANCE_SIDE as usize);
        let coefficients: Vec<[f32; 4]> =
            read_buffer(&gpu, technique.harmonics().unwrap(), 9 * 16).unwrap();
        let coefficients: Vec<DVec3> = coefficients
            .iter()
            .map(|c| DVec3::new(c[0].into(), c[1].into(), c[2].into()))
            .collect();
        for (index, found) in coefficients.iter().enumerate() {
            let expected = exact.integral(|d| harmonic(index, d));
            let off = (*found - expected).abs().max_element() / coefficients[0].x;
            assert!(
                off < 2e-3,
                "{name}, coefficient {index}: {found}, not {expected}"
            );
        }
        let (mut worst, mut worst_harmonics) = (0.0_f64, 0.0_f64);
        let brightest = cube.texels.iter().map(|e| e.x).fold(0.0, f64::max);
        for (normal, _, found) in cube.of_cube().step_by(23) {
            let expected = exact.irradiance(normal);
            worst = worst.max(relative(found, expected));
            let sum: DVec3 = (0..9)
                .map(|i| {
                    [PI, TAU / 3.0, PI / 4.0][[0, 1, 1, 1, 2, 2, 2, 2, 2][i]]
                        * harmonic(i, normal)
                        * coefficients[i]
                })
                .sum();
            worst_harmonics = worst_harmonics.max((sum.x - expected.x).abs() / brightest);
            if name == "constant" {
                assert!((found.x / PI - 1.0).abs() < 2e-3, "{found}");
                assert!((sum.x / PI - 1.0).abs() < 1e-3, "{sum}");
            }
        }
        println!(
            "{name}: the cube is off by at most {worst:.1e}, harmonics by {worst_harmonics:.1e} of the brightest"
        );
        assert!(worst < 0.02, "{name}: {worst}");
        // Ramamoorthi and Hanrahan 2001: at most 9 percent of the mean, for any light.
        assert!(worst_harmonics < 0.09, "{name}: {worst_harmonics}");
    }
}

/// Real spherical harmonic i = l (l + 1) + m from Legendre polynomials and trigonometry, +Z up.
pub(super) fn harmonic(i: usize, d: DVec3) -> f64 {
    let (l, m) = [
        (0, 0),
        (1, -1),
        (1, 0),
        (1, 1),
        (2, -2),
        (2, -1),
        (2, 0),
        (2, 1),
        (2, 2),
    ][i];
    let sine = (1.0 - d.z * d.z).max(0.0).sqrt();
    // Without the phase (-1)^m.
    let (legendre, ratio) = match (l, i32::abs(m)) {
        (0, _) => (1.0, 1.0),
        (1, 0) => (d.z, 1.0),
        (1, _) => (sine, 1.0 / 2.0),
        (_, 0) => ((3.0 * d.z * d.z - 1.0) / 2.0, 1.0),
        (_, 1) => (3.0 * d.z * sine, 1.0 / 6.0),
        _ => (3.0 * sine * sine, 1.0 / 24.0),
    };
    let phi = d.y.atan2(d.x);
    let around = match m {
        0 => 1.0,
        m if m > 0 => 2.0_f64.sqrt() * (f64::from(m) * phi).cos(),
        m => 2.0_f64.sqrt() * (f64::from(-m) * phi).sin(),
    };
    (f64::from(2 * l + 1) / (4.0 * PI) * ratio).sqrt() * legendre * around
}

#[test]
fn glossy_maps_are_means_over_their_lobes() {
    let Some(gpu) = test_gpu() else { return };
    for (name, environment) in maps_to_try() {
        let exact = Exact::new(&environment);
        for cosine in ["true", "false"] {
            let kept = u8::from(cosine == "true");
            let settings = [
                ("resolution", "64"),
                ("samples", "256"),
                ("phong-cosine", cosine),
            ];
            let technique = generated(&gpu, &environment, &settings);
            let (mut random, mean) = (Random(7), exact.integral(|_| 1.0).x / (4.0 * PI));
            // Levels of 64, 32, 16 and 8 texels per side.
            for level in 1..4_u32 {
                let alpha = f64::from(level_roughness(level, 4)).powi(2);
                for map in ["ggx", "phong"] {
                    let found = Level::read(&gpu, &technique, map, level);
                    let texels: Vec<_> = found.of_cube().collect();
                    let mut squares = 0.0;
                    const TRIED: usize = 12;
                    for _ in 0..TRIED {
                        let (axis, _, value) =
                            texels[(random.next() * texels.len() as f64) as usize];
                        let lobe = |d: DVec3| {
                            let c = axis.dot(d).max(0.0);
                            if map == "ggx" {
                                // D(h) n.l, with h halfway between the axis and the light: cos^2 = (1 + c) / 2.
                                let q = (1.0 + c) / 2.0 * (alpha * alpha - 1.0) + 1.0;
                                return c / (q * q);
                            }
                            let exponent = 2.0 / (alpha * alpha) - 2.0;
                            c.powf(exponent + f64::from(kept))
                                * f64::from(u8::from(axis.dot(d) > 0.0))
                        };
                        let weights: f64 = exact.points.iter().map(|(d, w, _)| lobe(*d) * w).sum();
                        let expected = exact.integral(lobe) / weights;
                        squares += ((value.x - expected.x) / (expected.x + 0.1 * mean)).powi(2);
                    }
                    let off = (squares / TRIED as f64).sqrt();
                    println!("{name}, {map} (cosine {cosine}), level {level}: off by {off:.1e}");
                    assert!(off < 0.05, "{name}, {map}, level {level}: {off}");
                }
            }
        }
    }
}

/// The rule that the export describes: each level has its roughness, and between two levels their alphas mix to the
/// lobe's alpha.
#[test]
fn lookups_read_between_the_levels_that_the_maps_have() {
    let Some(gpu) = test_gpu() else { return };
    let lobes: Vec<[f32; 2]> = [1, 3, 5, 8]
        .into_iter()
        .flat_map(|last| (0..=200).map(move |i| [i as f32 / 200.0, last as f32]))
        .collect();
    let buffer = gpu.storage("lobes", &lobes).unwrap();
    let count = lobes.len();
    let found: Vec<f32> = run_kernel(
        &gpu,
        &shader!("testing.glossy_level"),
        "main",
        &[("lobes", &buffer)],
        count,
        count as u32,
    )
    .unwrap();
    for ([roughness, last], found) in lobes.into_iter().zip(found) {
        let alpha = |level: f32| level_roughness(level as u32, last as u32 + 1).powi(2);
        let (low, high) = (alpha(found.floor()), alpha(found.ceil()));
        let mixed = low + (high - low) * found.fract();
        assert!(
            (0.0..=last).contains(&found) && (mixed - roughness * roughness).abs() < 1e-5,
            "roughness {roughness} of {last} levels: {found}, alpha {mixed}"
        );
    }
}

#[test]
fn the_table_of_albedos_agrees_with_quadrature() {
    let Some(gpu) = test_gpu() else { return };
    let technique = generated(&gpu, &constant(), &[("resolution", "8"), ("samples", "1")]);
    let table = Level::read(&gpu, &technique, "albedo", 0);
    let last = TABLE_SIDE as usize - 1;
    let mut worst = [0.0_f64; 3];
    for y in [7, 21, 42, last] {
        for x in [6, 21, 42, last] {
            let roughness = y as f64 / last as f64;
            let degrees = (x as f64 / last as f64).acos().to_degrees();
            let of = |f0: f32, f90: f32| {
                let case = Case {
                    f0: [f0; 3],
                    f90,
                    ..Case::dielectric(roughness as f32).seen_at(degrees)
                };
                case.glossy_albedo(0)
            };
            let shininess = 2.0 / roughness.powi(4) - 2.0;
            let phong = Case::phong(shininess as f32).seen_at(degrees);
            let expected = [of(1.0, 0.0), of(0.0, 1.0), phong.glossy_albedo(1)];
            let found = table.texels[y * table.side + x].to_array();
            for channel in 0..3 {
                worst[channel] = worst[channel].max((found[channel] - expected[channel]).abs());
            }
        }
    }
    println!("albedos are off by at most {worst:?}");
    assert!(worst.iter().all(|&off| off < 4e-3), "{worst:?}");
}

#[test]
fn broken_texels_leave_nothing_infinite() {
    let Some(gpu) = test_gpu() else { return };
    let broken = environment(8, 4, |x, _| {
        [
            1.0,
            f32::NAN,
            -3.0,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e9,
            2.0,
            0.0,
        ][x]
    });
    let black = environment(8, 4, |_, _| 0.0);
    let texel = environment(1, 1, |_, _| 2.0);
    for (environment, low, high) in [(broken, 0.0, 65504.0), (black, 0.0, 0.0), (texel, 2.0, 2.0)] {
        let technique = generated(
            &gpu,
            &environment,
            &[("resolution", "8"), ("samples", "16")],
        );
        for (map, levels, factor) in [("radiance", 4, 1.0), ("ggx", 2, 1.0), ("phong", 2, 1.0)] {
            for level in 0..levels {
                for value in Level::read(&gpu, &technique, map, level).texels {
                    let value = value.x / factor;
                    assert!(
                        value >= 0.999 * low && value <= 1.001 * high,
                        "{map}: {value}"
                    );
                }
            }
        }
        let coefficients: Vec<f32> =
            read_buffer(&gpu, technique.harmonics().unwrap(), 9 * 16).unwrap();
        assert!(coefficients.iter().all(|value| value.is_finite()));
        let irradiance = Level::read(&gpu, &technique, "irradiance", 0).texels;
        assert!(irradiance.iter().all(|value| value.is_finite()));
    }
}

#[test]
fn maps_are_made_anew_only_for_another_image_or_setting() {
    let Some(gpu) = test_gpu() else { return };
    let mut before = Scene::new("environment");
    before.environment = Some(constant());
    let mut scene = GpuScene::new(&gpu, &before).unwrap();
    let mut technique = EnvironmentMap::new(&gpu, &scene).unwrap();
    technique.settings_mut().set("resolution", "8").unwrap();
    let camera = Camera::look_at("", glam::Vec3::Z, glam::Vec3::ZERO, 1.0);
    let view = View::new(&camera, [1, 1], Vec2::ZERO, 0, 0, 1.0);
    let kernels = CaptureKernels::new(&gpu, &scene).unwrap();
    let mut shared = Shared::new(&gpu, &scene, &kernels).unwrap();
    let mut passes = |technique: &mut EnvironmentMap, scene: &GpuScene| {
        let mut frame = Frame::new(&gpu, true);
        let mut emission = Emission::new(&gpu, scene).unwrap();
        let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut []), &mut shared);
        technique
            .generate(&mut frame, scene, &view, &mut lit)
            .unwrap();
        frame.submit().unwrap().wait().unwrap().len()
    };
    if !gpu.has_timestamps {
        return;
    }
    assert_eq!(passes(&mut technique, &scene), 1);
    assert_eq!(passes(&mut technique, &scene), 0);
    let mut turned = before.clone();
    turned.environment.as_mut().unwrap().rotation = glam::Quat::from_rotation_y(1.0);
    turned.environment.as_mut().unwrap().intensity = 2.0;
    scene.update(&gpu, &turned).unwrap();
    assert_eq!(passes(&mut technique, &scene), 0);
    let mut other = turned.clone();
    other.environment = Some(sunny(1, 1));
    scene.update(&gpu, &other).unwrap();
    assert_eq!(passes(&mut technique, &scene), 1);
    technique.settings_mut().set("resolution", "16").unwrap();
    assert_eq!(passes(&mut technique, &scene), 1);
    assert!(technique.settings_mut().set("resolution", "24").is_err());
}
