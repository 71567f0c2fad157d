//! Tests the domains of environments whose light is known.

mod live;
mod mesh;
mod stability;
mod survey;

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{Mat3, Mat4, Vec2, Vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Environment, Image, Material, Pixels, Scene};

use super::batches::Plan;
use super::draws::{CellsOfSky, Draws};
use super::{Decomposition, Domain, ImageBasedLighting, Reflectivity, Settings, Spread};
use crate::capture::{Capture, CaptureKernels, Emission, Receiver, Target, View};
use crate::gpu::{Frame, Gpu, TextureAspect, read_buffer, read_texture};
use crate::scene::GpuScene;
use crate::techniques::{Earlier, EarlierLight, Shared, Technique as _};
use crate::testing::{Random, test_gpu};

/// A scene with nothing but an environment.
fn sky([width, height]: [u32; 2], texel: impl Fn(u32, u32) -> Vec3) -> Scene {
    let texels = (0..width * height).flat_map(|index| {
        let Vec3 { x, y, z } = texel(index % width, index / width);
        // Rounded to half floats like the GPU's texels, so that sums can be compared.
        [x, y, z, 1.0].map(|value| half::f16::from_f32(value).to_f32())
    });
    let mut scene = Scene::new("sky");
    scene.environment = Some(Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width,
            height,
            pixels: Pixels::Rgba32Float(texels.collect()),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    scene
}

/// Unit direction of a texel's centre.
fn direction([width, height]: [u32; 2], x: u32, y: u32) -> Vec3 {
    let phi = 2.0 * PI * ((f64::from(x) + 0.5) / f64::from(width) - 0.5);
    let theta = PI * (f64::from(y) + 0.5) / f64::from(height);
    glam::dvec3(
        phi.sin() * theta.sin(),
        theta.cos(),
        -phi.cos() * theta.sin(),
    )
    .as_vec3()
}

/// A smooth sky with a wide range of brightness, and a sun of a few texels.
fn sunny(size: [u32; 2]) -> Scene {
    sky(size, |x, y| {
        let d = direction(size, x, y);
        let sun = d.dot(Vec3::new(0.3, 0.8, -0.5).normalize());
        let sun = if sun > 0.997 { 400.0 } else { 0.0 };
        Vec3::new(0.6, 0.8, 1.0) * (0.3 + (2.0 * d.x).exp() + sun)
    })
}

fn settings(samples: u32) -> Settings {
    Settings {
        samples,
        ..Default::default()
    }
}

/// The directions of a scene's environment, once they have arrived.
fn directions(
    gpu: &Gpu,
    technique: &mut ImageBasedLighting,
    scene: &GpuScene,
) -> Vec<super::gpu::Direction> {
    loop {
        let mut frame = Frame::new(gpu, false);
        let is_found = technique.find_sources(&mut frame, scene).unwrap();
        frame.submit().unwrap();
        if is_found {
            let domains = technique.sources.get().map(|sources| &sources.domains);
            return technique.settings.directions(scene, domains.unwrap()).0;
        }
        gpu.wait().unwrap();
    }
}

fn decompose(
    gpu: &Gpu,
    made: &mut Decomposition,
    scene: &GpuScene,
    settings: &Settings,
) -> Vec<Domain> {
    let mut frame = Frame::new(gpu, false);
    let domains = made.decompose(&mut frame, scene, settings).unwrap();
    frame.submit().unwrap();
    domains.unwrap().wait().unwrap()
}

/// The domains of a scene's environment from a fresh start, the owner of each cell, and the number of cells along each
/// axis.
fn domains(gpu: &Gpu, scene: &Scene, settings: &Settings) -> (Vec<Domain>, Vec<u32>, [u32; 2]) {
    let scene = GpuScene::new(gpu, scene).unwrap();
    let mut made = Decomposition::new(gpu, &scene).unwrap();
    let domains = decompose(gpu, &mut made, &scene, settings);
    let texture = made.owners().unwrap();
    let owners = read_texture(gpu, texture, TextureAspect::All, 0, 0).unwrap();
    (domains, owners, [texture.width(), texture.height()])
}

/// Integral of the radiance over the sphere, in double precision.
fn integral(scene: &Scene) -> [f64; 3] {
    let image = &scene.environment.as_ref().unwrap().image;
    let Pixels::Rgba32Float(texels) = &image.pixels else {
        panic!("floats");
    };
    let (width, height) = (image.width as usize, image.height as usize);
    let edge = |row: usize| (PI * row as f64 / height as f64).cos();
    std::array::from_fn(|channel| {
        (0..width * height)
            .map(|index| {
                let row = index / width;
                let solid_angle = 2.0 * PI / width as f64 * (edge(row) - edge(row + 1));
                solid_angle * f64::from(texels[index * 4 + channel])
            })
            .sum()
    })
}

fn assert_conserved(scene: &Scene, domains: &[Domain], what: &str) {
    for (channel, exact) in integral(scene).into_iter().enumerate() {
        let sum = |value: &dyn Fn(&Domain) -> f32| -> f64 {
            domains.iter().map(|domain| f64::from(value(domain))).sum()
        };
        let found = sum(&|domain| domain.flux_density[channel]);
        let error = found / exact - 1.0;
        assert!(error.abs() < 1e-5, "{what}: {found}, not {exact}: {error}");
        let sphere = sum(&|domain| domain.solid_angle) / (4.0 * PI) - 1.0;
        assert!(
            sphere.abs() < 1e-5,
            "{what}: solid angles are off by {sphere}"
        );
    }
}

#[test]
fn domains_hold_all_the_light() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(7);
    let noise: Vec<f32> = (0..1024 * 512)
        .map(|_| (8.0 * random.next() - 4.0).exp() as f32)
        .collect();
    // Maps as large as the cells, smaller, reduced by integer and other factors, and of odd shapes.
    for (size, count) in [
        ([64, 32], 1),
        ([64, 32], 300),
        ([1, 1], 300),
        ([3, 5], 60),
        ([600, 300], 40),
        ([1024, 512], 7),
        ([700, 4], 60),
    ] {
        let scene = sky(size, |x, y| {
            let at = |shift: u32| noise[((x + y * size[0] + shift) % (1024 * 512)) as usize];
            Vec3::new(at(0), at(17), at(99))
        });
        let short = Settings {
            iterations: 1,
            ..settings(count)
        };
        let (domains, _, cells) = domains(&gpu, &scene, &short);
        assert!(cells[0] <= 512 && cells[1] <= 256, "{cells:?}");
        assert_eq!(domains.len(), count as usize);
        assert_conserved(&scene, &domains, &format!("{size:?}, {count} samples"));
        // Few samples coincide or are crowded out.
        let used = domains
            .iter()
            .filter(|domain| domain.solid_angle > 0.0)
            .count();
        assert!(used * 10 >= count as usize * 9, "{used} of {count} in use");
    }
}

#[test]
fn cells_belong_to_the_nearest_sample() {
    let Some(gpu) = test_gpu() else { return };
    let even = sky([64, 32], |_, _| Vec3::ONE);
    // Under a uniform sky, relaxed samples lie at their domains' centres of power.
    let relaxed = Settings {
        iterations: 256,
        ..settings(40)
    };
    let (domains, owners, cells) = domains(&gpu, &even, &relaxed);
    let mut wrong = 0;
    for (index, &owner) in owners.iter().enumerate() {
        let here = direction(cells, index as u32 % cells[0], index as u32 / cells[0]);
        let nearest = domains.iter().map(|domain| domain.toward.dot(here));
        let nearest = nearest.fold(-1.0, f32::max);
        // Relaxation leaves samples slightly off the centres.
        wrong += usize::from(domains[owner as usize].toward.dot(here) < nearest - 2e-3);
    }
    assert!(wrong == 0, "{wrong} cells belong to a sample farther away");
    // Domains are also about equally large.
    let mean = 4.0 * PI as f32 / 40.0;
    for domain in &domains {
        let size = domain.solid_angle / mean;
        assert!((0.7..1.4).contains(&size), "{size} of the mean size");
    }
}

/// Index of the sample nearest to the centre of each cell.
fn nearest(samples: &[Vec3], cells: [u32; 2]) -> Vec<u32> {
    let cell = |index: u32| direction(cells, index % cells[0], index / cells[0]);
    let nearest = |here: Vec3| {
        let order = |&a: &usize, &b: &usize| samples[a].dot(here).total_cmp(&samples[b].dot(here));
        (0..samples.len()).max_by(order).unwrap() as u32
    };
    (0..cells[0] * cells[1])
        .map(|index| nearest(cell(index)))
        .collect()
}

#[test]
fn relaxation_tends_to_the_density_asked_for() {
    let Some(gpu) = test_gpu() else { return };
    // Two hemispheres, one 16 times as bright: a density proportional to power gives 16 : 1, to its root 4 : 1, which
    // even many steps only approach. Of 85 samples, 4 to 6 below are 20.25 to 13.2 : 1.
    let scene = sky([128, 64], |_, y| {
        Vec3::splat(if y < 32 { 16.0 } else { 1.0 })
    });
    for (spread, low, high) in [(Spread::Power, 13.0, 20.5), (Spread::Root, 3.5, 11.5)] {
        let settings = Settings {
            iterations: 256,
            spread,
            ..settings(85)
        };
        let (domains, ..) = domains(&gpu, &scene, &settings);
        let above = domains
            .iter()
            .filter(|domain| domain.toward.y > 0.0)
            .count() as f32;
        let ratio = above / (85.0 - above);
        println!("{spread:?}: {ratio}");
        assert!((low..high).contains(&ratio), "{spread:?}: {ratio}");
    }
}

#[test]
fn a_sun_of_a_texel_takes_one_sample() {
    let Some(gpu) = test_gpu() else { return };
    let size = [64, 32];
    let sun = |dim: f32| {
        sky(size, move |x, y| {
            Vec3::splat(if (x, y) == (40, 9) { 5000.0 } else { dim })
        })
    };
    let toward = direction(size, 40, 9);
    // A sun alone in the dark gets one sample, whatever the number of samples.
    for count in [1, 16, 500] {
        let (domains, ..) = domains(&gpu, &sun(0.0), &settings(count));
        assert_conserved(&sun(0.0), &domains, "sun alone");
        let lit: Vec<_> = domains
            .iter()
            .filter(|domain| domain.flux_density.x > 0.0)
            .collect();
        assert_eq!(lit.len(), 1);
        assert!((lit[0].toward - toward).length() < 1e-5, "{lit:?}");
    }
    // Above a dim sky, the samples that the sun does not take light the rest.
    let (domains, ..) = domains(&gpu, &sun(0.5), &settings(64));
    let bright = domains
        .iter()
        .filter(|domain| domain.flux_density.x > 2.0)
        .count();
    assert_eq!(bright, 1);
    let lit = domains
        .iter()
        .filter(|domain| domain.flux_density.x > 0.0)
        .count();
    assert!(lit >= 62, "{lit} of 64");
    assert_conserved(&sun(0.5), &domains, "sun and sky");
}

#[test]
fn dark_skies_have_dark_domains() {
    let Some(gpu) = test_gpu() else { return };
    for size in [[1, 1], [64, 32]] {
        let (domains, ..) = domains(&gpu, &sky(size, |_, _| Vec3::ZERO), &settings(16));
        assert!(
            domains
                .iter()
                .all(|domain| domain.flux_density == Vec3::ZERO)
        );
    }
    // More samples than cells with light.
    let few = sky([64, 32], |x, y| {
        Vec3::splat(if y == 10 && x < 5 {
            1.0 + x as f32
        } else {
            0.0
        })
    });
    let (domains, ..) = domains(&gpu, &few, &settings(200));
    let lit = domains
        .iter()
        .filter(|domain| domain.flux_density.x > 0.0)
        .count();
    assert!((1..=5).contains(&lit), "{lit}");
    assert_conserved(&few, &domains, "few cells");
}

#[test]
fn the_same_sky_has_the_same_domains() {
    let Some(gpu) = test_gpu() else { return };
    let scene = sunny([128, 64]);
    let first = domains(&gpu, &scene, &settings(64));
    assert_eq!(first, domains(&gpu, &scene, &settings(64)));
}

#[test]
fn samples_follow_a_changing_sky() {
    let Some(gpu) = test_gpu() else { return };
    let size = [128, 64];
    let before = sunny(size);
    let mut after = before.clone();
    if let Some(environment) = &mut after.environment
        && let Pixels::Rgba32Float(texels) = &mut Arc::make_mut(&mut environment.image).pixels
    {
        // A cloud: a part of the sky loses a twentieth of its light.
        for (index, texel) in texels.chunks_exact_mut(4).enumerate() {
            if index % 128 < 30 {
                texel[..3].iter_mut().for_each(|value| *value *= 0.95);
            }
        }
    }
    let settings = Settings {
        iterations: 64,
        ..settings(60)
    };
    let mut scene = GpuScene::new(&gpu, &before).unwrap();
    let mut made = Decomposition::new(&gpu, &scene).unwrap();
    let first = decompose(&gpu, &mut made, &scene, &settings);
    scene.update(&gpu, &after).unwrap();
    let second = decompose(&gpu, &mut made, &scene, &settings);
    let (fresh, ..) = domains(&gpu, &after, &settings);
    let jump = |other: &[Domain]| {
        let lengths = first.iter().zip(other);
        let lengths = lengths.map(|(a, b)| a.toward.distance(b.toward));
        lengths.fold(0.0, f32::max)
    };
    let spacing = (4.0 * PI as f32 / 60.0).sqrt();
    assert!(
        jump(&second) < 0.2 * spacing,
        "{} of {spacing}",
        jump(&second)
    );
    // A fresh start shows that it is the previous samples that keep them in place.
    assert!(jump(&fresh) > 0.5 * spacing, "{}", jump(&fresh));
}

#[test]
fn a_turned_sky_keeps_its_domains() {
    let Some(gpu) = test_gpu() else { return };
    let before = sunny([64, 32]);
    let mut after = before.clone();
    if let Some(environment) = &mut after.environment {
        environment.rotation = glam::Quat::from_rotation_y(0.02);
        environment.intensity = 3.0;
    }
    let mut scene = GpuScene::new(&gpu, &before).unwrap();
    let mut technique = ImageBasedLighting::new(&gpu, &scene).unwrap();
    let first = directions(&gpu, &mut technique, &scene);
    scene.update(&gpu, &after).unwrap();
    let second = directions(&gpu, &mut technique, &scene);
    assert_eq!(first.len(), second.len());
    let turn = Mat3::from_rotation_y(0.02);
    for (before, after) in first.iter().zip(&second) {
        let turned = turn * Vec3::from(before.toward);
        assert!((turned - Vec3::from(after.toward)).length() < 1e-6);
        let brighter = Vec3::from(before.flux_density) * 3.0;
        assert_eq!(brighter, Vec3::from(after.flux_density));
    }
}

#[test]
fn batches_fit_an_atlas_and_the_memory() {
    let mebi = 1 << 20;
    let plan = |count, side, memory| {
        let plan = Plan::new(count, [side, 4], 8192, memory * mebi);
        (plan.per_batch, plan.is_kept)
    };
    assert_eq!(plan(128, 512, 1024), (128, true));
    // Four atlases of equal size.
    assert_eq!(plan(1000, 512, 1024), (250, true));
    assert_eq!(plan(2048, 512, 1024), (256, false));
    assert_eq!(plan(2048, 256, 1024), (1024, true));
    assert_eq!(plan(1000, 512, 100), (100, false));
    assert_eq!(plan(2, 4096, 16), (1, false));
    assert_eq!(plan(1, 16, 16), (1, true));
    for (count, side, memory) in [(7, 300, 16), (2048, 4096, 2000), (513, 1000, 700)] {
        let (per_batch, is_kept) = plan(count, side, memory);
        let columns = (per_batch - 1).isqrt() + 1;
        let atlases = if is_kept {
            count.div_ceil(per_batch)
        } else {
            1
        };
        assert!(columns * side <= 8192);
        let bytes = u64::from(atlases) * 4 * u64::from(columns * side).pow(2);
        assert!(bytes <= memory * mebi, "{count}, {side}: {bytes}");
    }
}

#[test]
fn a_domain_knows_how_widely_its_light_is_spread() {
    let Some(gpu) = test_gpu() else { return };
    // Under a uniform sky, a domain is about a cap.
    let relaxed = Settings {
        iterations: 64,
        ..settings(40)
    };
    let (even, ..) = domains(&gpu, &sky([64, 32], |_, _| Vec3::ONE), &relaxed);
    for domain in &even {
        let spread = domain.lit_solid_angle / domain.solid_angle;
        assert!((0.98..1.2).contains(&spread), "{spread} of its solid angle");
    }
    // A sun is as large as its texel, however much of a dim sky its domain contains.
    let size = [64, 32];
    let sun = sky(size, |x, y| {
        Vec3::splat(if (x, y) == (40, 9) { 1e4 } else { 0.01 })
    });
    let (domains, ..) = domains(&gpu, &sun, &settings(16));
    let brightest = domains
        .iter()
        .max_by(|a, b| a.flux_density.x.total_cmp(&b.flux_density.x))
        .unwrap();
    let texel = 2.0 * PI * PI / (64.0 * 32.0) * (PI * 9.5 / 32.0).sin();
    let spread = f64::from(brightest.lit_solid_angle) / texel;
    println!("a sun of {spread} texels");
    assert!((0.9..1.5).contains(&spread), "{spread} texels");
}

#[test]
fn draws_of_all_samples_add_up_to_the_sky() {
    let Some(gpu) = test_gpu() else { return };
    // So many that each cell of the sun counts for more than one.
    let count = 200;
    let scene = sunny([128, 64]);
    let uploaded = GpuScene::new(&gpu, &scene).unwrap();
    let mut made = Decomposition::new(&gpu, &uploaded).unwrap();
    let mut frame = Frame::new(&gpu, false);
    made.decompose(&mut frame, &uploaded, &settings(count))
        .unwrap();
    let cells = made.cells(&mut frame).unwrap().unwrap();
    frame.submit().unwrap();
    let cells = CellsOfSky {
        grid: cells.grid,
        rows: cells.rows.wait().unwrap(),
    };
    let draws = Draws::new(&cells, count, |_| 1.0);
    let sun = Vec3::new(0.3, 0.8, -0.5).normalize();
    let is_sun = |domain: &&Domain| domain.toward.dot(sun) > 0.99;
    let flux = |domains: &mut dyn Iterator<Item = &Domain>| -> f32 {
        domains.map(|domain| domain.flux_density.x).sum()
    };
    let exact = integral(&scene)[0] as f32;
    let (mut all, mut upper) = (0.0, 0.0);
    let sample = draws.of_sample(0);
    for turn in 0..64 {
        let drawn = draws.of_sample(turn);
        assert_eq!(drawn.len(), count as usize);
        assert!(turn == 0 || drawn[0].toward != sample[0].toward);
        for domain in &drawn {
            assert!((domain.toward.length() - 1.0).abs() < 1e-5);
        }
        // Cells as bright as the sun's are drawn in every sample.
        let of_sun =
            flux(&mut drawn.iter().filter(is_sun)) / flux(&mut sample.iter().filter(is_sun));
        assert!((of_sun - 1.0).abs() < 0.1, "{of_sun}");
        all += flux(&mut drawn.iter()) / exact / 64.0;
        upper += flux(&mut drawn.iter().filter(|domain| domain.toward.x > 0.5)) / 64.0;
    }
    assert!((all - 1.0).abs() < 0.01, "{all}");
    let expected: f32 = {
        let half = sky([128, 64], |x, y| {
            let d = direction([128, 64], x, y);
            let lit = if d.x > 0.5 { 1.0 } else { 0.0 };
            let sun = if d.dot(sun) > 0.997 { 400.0 } else { 0.0 };
            Vec3::splat(0.6 * lit * (0.3 + (2.0 * d.x).exp() + sun))
        });
        integral(&half)[0] as f32
    };
    assert!((upper / expected - 1.0).abs() < 0.02, "{upper}, {expected}");
    let dark = CellsOfSky {
        rows: vec![[0.0; 4]; cells.rows.len()],
        ..cells
    };
    assert!(Draws::new(&dark, 8, |_| 1.0).of_sample(3).is_empty());
}

/// A ball and a block on a floor under a sunny sky.
fn still(size: [u32; 2]) -> Scene {
    let mut scene = sunny(size);
    let block = cuboid(Vec3::new(0.2, 0.0, -0.3), Vec3::new(0.6, 1.0, 0.3), 1);
    let floor = quad(Vec3::new(-1.0, 0.0, 1.0), 2.0 * Vec3::X, -2.0 * Vec3::Z, 1);
    for (mesh, material) in [
        (floor, Material::matt("grey", Vec3::splat(0.5))),
        (block, Material::matt("white", Vec3::splat(0.8))),
        (sphere(0.4, 24), Material::metal("metal", Vec3::ONE, 0.3)),
    ] {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(material);
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    }
    scene
}

/// Renders images of `still`.
struct Sight {
    view: View,
    capture: Capture,
    emission: Emission,
}

impl Sight {
    fn new(gpu: &Gpu, scene: &GpuScene) -> Self {
        let camera = Camera::look_at("", Vec3::new(0.3, 1.5, 3.0), Vec3::Y * 0.3, 0.7);
        let kernels = CaptureKernels::new(gpu, scene).unwrap();
        Self {
            view: View::new(&camera, [32, 32], Vec2::ZERO, 0, 0, scene.diagonal()),
            capture: Capture::of_camera(gpu, &kernels, [32, 32]).unwrap(),
            emission: Emission::new(gpu, scene).unwrap(),
        }
    }

    /// Radiance of one frame.
    fn frame(
        &mut self,
        gpu: &Gpu,
        scene: &mut GpuScene,
        technique: &mut ImageBasedLighting,
    ) -> Vec<f32> {
        let target = Target::new(gpu, 32 * 32).unwrap();
        let mut frame = Frame::new(gpu, false);
        scene.merge(&mut frame);
        self.capture
            .record(&mut frame, scene, &self.view, |draw| draw.seen)
            .unwrap();
        let kernels = CaptureKernels::new(gpu, scene).unwrap();
        let mut shared = Shared::new(gpu, scene, &kernels).unwrap();
        let mut earlier =
            Earlier::unlimited(EarlierLight::new(&mut self.emission, &mut []), &mut shared);
        while technique
            .generate(&mut frame, scene, &self.view, &mut earlier)
            .unwrap()
            .pending
            .is_some()
        {
            frame.submit().unwrap();
            gpu.wait().unwrap();
            frame = Frame::new(gpu, false);
        }
        let receiver = Receiver::new(&self.capture.points, &target);
        let gathered = technique.gather(&mut frame, scene, &receiver, &mut earlier);
        gathered.unwrap();
        frame.submit().unwrap();
        read_buffer(gpu, &target.radiance, target.radiance.size()).unwrap()
    }
}

#[test]
fn batches_make_the_same_picture() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = GpuScene::new(&gpu, &still([64, 32])).unwrap();
    let mut sight = Sight::new(&gpu, &scene);
    for reflectivity in [Reflectivity::Lobe, Reflectivity::Ratio] {
        // One atlas; five atlases of eight maps; one atlas for 16 maps at a time, the last time for eight; one atlas
        // for one map at a time.
        let pictures =
            [(8192, 1024), (384, 1024), (8192, 1), (8192, 0)].map(|(atlas_side, memory)| {
                let mut technique = ImageBasedLighting::new(&gpu, &scene).unwrap();
                technique.settings = Settings {
                    resolution: 128,
                    reflectivity,
                    memory,
                    ..settings(40)
                };
                technique.atlas_side = atlas_side;
                // In the second frame, maps are either kept or redrawn.
                sight.frame(&gpu, &mut scene, &mut technique);
                sight.frame(&gpu, &mut scene, &mut technique)
            });
        assert!(pictures[0].iter().all(|value| value.is_finite()));
        assert!(pictures[0].iter().sum::<f32>() > 100.0);
        for other in &pictures[1..] {
            // Lookups round differently in a different atlas.
            let pairs = pictures[0].iter().zip(other);
            let far = pairs
                .filter(|&(a, b)| (a - b).abs() > 0.01 * (b + 0.1))
                .count();
            assert!(far * 100 < other.len(), "{reflectivity:?}: {far} differ");
        }
    }
}
