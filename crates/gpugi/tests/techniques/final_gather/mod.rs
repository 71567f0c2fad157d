//! final-gather compared with closed forms and the path tracer; walls that let little through; input that cannot work.

mod hostile;
mod leaks;
mod occlusion;
mod places;
mod scenes;
mod thin_walls;
mod volume;

use std::f32::consts::PI;
use std::sync::Arc;

use crate::common::{gpu, place, shining_room};
use glam::{Vec2, Vec3, vec3};
use gpugi::capture::{Output, Probe, Receiver, Slots, Target, View};
use gpugi::gpu::{Frame, Gpu, read_buffer};
use gpugi::lighting::{Budget, Lighting, Readiness};
use gpugi::techniques::Registry;
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Camera, Environment, Image, Material, Pixels, Scene};

/// A sky of the same radiance in all directions.
fn even_sky(radiance: f32) -> Environment {
    let pixels = [radiance, radiance, radiance, 1.0].repeat(8);
    Environment {
        image: Arc::new(Image {
            name: "even".into(),
            width: 4,
            height: 2,
            pixels: Pixels::Rgba32Float(pixels),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// What the techniques give at probes once their maps are final. `settings` are those of final-gather.
fn at_probes(
    gpu: &Gpu,
    scene: &Scene,
    names: &[&str],
    settings: &[&str],
    probes: &[Probe],
    output: Output,
) -> Vec<Vec3> {
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    let registry = Registry::default();
    let mut on_gpu = Lighting::upload(gpu, scene, &names, &registry).expect("an upload");
    let mut lighting = Lighting::new(gpu, &mut on_gpu, &names, &registry).expect("lighting");
    for setting in settings {
        let (name, value) = setting.split_once('=').expect("name=value");
        let set = lighting.set(&mut on_gpu, "final-gather", name, value);
        set.expect("a setting");
    }
    lighting.light_elsewhere();
    let count = probes.len() as u32;
    let target = Target::new(gpu, count).expect("a target");
    let receiver = Receiver::of_probes(gpu, probes, output, &target, Slots::default());
    let receiver = receiver.expect("a receiver");
    let camera = Camera::look_at("", vec3(0.0, 0.75, 0.0), vec3(0.0, 0.75, -1.0), 1.0);
    let view = View::new(&camera, [8, 8], Vec2::ZERO, 0, 0, on_gpu.diagonal());
    loop {
        let mut frame = Frame::new(gpu, false);
        let readiness = lighting.prepare(&mut frame, &mut on_gpu, &view, Budget::UNLIMITED);
        let is_ready = readiness.expect("maps") == Readiness::Ready;
        if is_ready {
            frame.clear(&target.radiance);
            let lit = lighting.gather(&mut frame, &on_gpu, &receiver);
            lit.expect("light");
        }
        frame.submit().expect("a frame");
        if is_ready {
            break;
        }
        gpu.wait().expect("the GPU");
    }
    let sums = read_buffer::<[f32; 4]>(gpu, &target.radiance, u64::from(count) * 16);
    let sums = sums.expect("sums").into_iter();
    let found: Vec<Vec3> = sums.map(|[r, g, b, _]| vec3(r, g, b)).collect();
    assert!(found.iter().all(|value| value.is_finite()), "{found:?}");
    found
}

/// A probe at a place, facing a direction.
fn facing(position: Vec3, direction: Vec3) -> Probe {
    Probe {
        position,
        direction: direction.normalize(),
    }
}

/// Irradiance pi, fluence 4 pi and inscatter 1 under a sky of radiance 1, anywhere.
#[test]
fn an_even_sky_gives_the_irradiance_pi() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("sky");
    scene.environment = Some(even_sky(1.0));
    let directions = [Vec3::Y, vec3(1.0, 2.0, -3.0), vec3(-0.3, -0.8, 0.1)];
    let probes = directions.map(|way| facing(way * 0.7, way));
    let anisotropic = Output::Inscatter { asymmetry: 0.5 };
    for size in ["size=2", "size=4", "size=8", "size=16"] {
        for (output, expected) in [
            (Output::Irradiance, PI),
            (Output::Fluence, 4.0 * PI),
            (anisotropic, 1.0),
        ] {
            let found = at_probes(&gpu, &scene, &["final-gather"], &[size], &probes, output);
            for found in found {
                let off = (found / expected - 1.0).abs().max_element();
                assert!(off < 0.005, "{size} {output:?}: {found}");
            }
        }
        let settings = [size, "normalize=false"];
        let output = Output::Irradiance;
        let found = at_probes(&gpu, &scene, &["final-gather"], &settings, &probes, output);
        let off = found.map_off(PI);
        println!("{size}, not normalized: {off:.3?}");
    }
}

/// Relative deviations from an expected value, of the red channel.
trait Off {
    fn map_off(&self, expected: f32) -> Vec<f32>;
}

impl Off for Vec<Vec3> {
    fn map_off(&self, expected: f32) -> Vec<f32> {
        self.iter().map(|value| value.x / expected - 1.0).collect()
    }
}

/// In a room of constant radiance, every point receives pi. Without normalization that holds at the reference point;
/// the estimates differ toward the walls.
#[test]
fn a_room_of_constant_radiance_is_even() {
    let Some(gpu) = gpu() else { return };
    let scene = shining_room(1.0, Vec3::ZERO);
    // The camera, where the reference point is; then toward the wall at x = 1, whose normal is -X.
    let probes: Vec<Probe> = [0.0, 0.3, 0.6, 0.9, 0.99]
        .map(|x| facing(vec3(x, 0.75, 0.0), Vec3::NEG_X))
        .to_vec();
    for estimate in ["disc", "oriented", "quad"] {
        for size in [2, 4, 8, 16] {
            let found = |normalize: bool| {
                let settings = [
                    "reference-points=camera".to_owned(),
                    "resolution=64".to_owned(),
                    "visibility=none".to_owned(),
                    format!("solid-angle={estimate}"),
                    format!("size={size}"),
                    format!("normalize={normalize}"),
                ];
                let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
                let names = ["final-gather"];
                at_probes(&gpu, &scene, &names, &settings, &probes, Output::Irradiance).map_off(PI)
            };
            for off in found(true) {
                assert!(off.abs() < 0.01, "{estimate} {size}: {off}");
            }
            let off = found(false);
            println!("{estimate}, M = {size}: {off:.3?}");
            assert!(
                size < 4 || off[0].abs() < 0.01,
                "{estimate} {size}: {off:?}"
            );
        }
    }
}

/// Irradiance of a point that faces a rectangle of radiance 1 parallel to it, over pi: the sum of four corners
/// 1 / (2 pi) (a / sqrt(1 + a^2) atan(b / sqrt(1 + a^2)) + b / sqrt(1 + b^2) atan(a / sqrt(1 + b^2))).
fn form_factor(height: f32, [left, right]: [f32; 2], [low, high]: [f32; 2]) -> f32 {
    let corner = |x: f32, y: f32| {
        let (a, b) = (x / height, y / height);
        let (p, q) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / p * (b / p).atan() + b / q * (a / q).atan()) / (2.0 * PI)
    };
    corner(left, low) + corner(left, high) + corner(right, low) + corner(right, high)
}

/// One wall shines; the others are black. Points face it, at the reference point and beside it.
#[test]
fn a_bright_wall_has_the_form_factor_of_a_rectangle() {
    let Some(gpu) = gpu() else { return };
    let mut scene = shining_room(0.0, Vec3::ZERO);
    let wall = quad(vec3(0.999, 0.0, -1.5), Vec3::Z * 3.0, Vec3::Y * 1.5, 1);
    let shining = Material::emitter("wall", Vec3::ONE);
    place(&mut scene, wall, shining);
    let places = [
        vec3(0.0, 0.75, 0.0),
        vec3(-0.5, 0.75, 0.0),
        vec3(0.2, 0.5, 0.6),
        vec3(-0.6, 1.0, -0.8),
    ];
    let probes = places.map(|place| facing(place, Vec3::X));
    let expected = places.map(|p| {
        let sides = [[p.z + 1.5, 1.5 - p.z], [p.y, 1.5 - p.y]];
        form_factor(0.999 - p.x, sides[0], sides[1])
    });
    for (estimate, bound) in [("disc", 0.25), ("oriented", 0.03), ("quad", 0.03)] {
        for size in [2, 4, 8, 16] {
            let settings = [
                "reference-points=camera".to_owned(),
                "resolution=64".to_owned(),
                format!("solid-angle={estimate}"),
                format!("size={size}"),
            ];
            let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
            let names = ["final-gather"];
            let output = Output::Irradiance;
            let found = at_probes(&gpu, &scene, &names, &settings, &probes, output);
            let off: Vec<f32> = found
                .iter()
                .zip(expected)
                .map(|(found, expected)| found.x / (PI * expected) - 1.0)
                .collect();
            println!("{estimate}, M = {size}: {off:.3?}");
            // Classical environment mapping shows every place what the reference point sees. Far from that point it is
            // at least five times worse.
            let classical = expected.map(|factor| (expected[0] / factor - 1.0).abs());
            if estimate == "oriented" && size >= 8 {
                println!("classical: {classical:.3?}");
                for place in [1, 3] {
                    assert!(off[place].abs() * 5.0 < classical[place], "{size}: {off:?}");
                }
            }
            if size == 16 {
                assert!(off[0].abs() < 0.03, "{estimate}: {off:?}");
                let worst = off.iter().fold(0.0_f32, |worst, off| worst.max(off.abs()));
                assert!(worst < bound, "{estimate}: {off:?}");
            }
        }
    }
}

/// Albedo 0.99: every bounce has nearly all the light of the one before. The radiosity of the room is e / (1 - rho).
/// Surface points keep albedos in nine bits, 507 / 512, so that the room is 2.4 % brighter after all bounces.
#[test]
fn light_in_a_furnace_neither_grows_nor_is_lost() {
    let Some(gpu) = gpu() else { return };
    let albedo = 0.99;
    let scene = shining_room(1.0, Vec3::splat(albedo));
    let probes = [
        facing(vec3(0.2, 0.5, 0.3), Vec3::Y),
        facing(vec3(0.99, 0.9, 1.2), Vec3::NEG_X),
        facing(vec3(-0.9, 0.01, -1.4), Vec3::Y),
    ];
    for (bounces, part) in [(0, 1.0 - albedo), (1, 1.0 - albedo.powi(2)), (512, 1.0)] {
        let bounces = format!("bounces={bounces}");
        for mode in ["grid", "camera"] {
            let places = format!("reference-points={mode}");
            let settings = [&places, &bounces, "density=1", "resolution=32"];
            let names = ["final-gather"];
            let found = at_probes(&gpu, &scene, &names, &settings, &probes, Output::Irradiance);
            let off = found.map_off(PI * part / (1.0 - albedo));
            println!("{mode}, {bounces}: {off:.4?}");
            let worst = off.iter().fold(0.0_f32, |worst, off| worst.max(off.abs()));
            assert!(worst < 0.02, "{mode}, {bounces}: {off:?}");
        }
    }
}

/// A walk through the cells of a grid, past borders of cells: light changes little from step to step.
#[test]
fn cells_have_no_seams() {
    let Some(gpu) = gpu() else { return };
    let mut scene = shining_room(0.0, Vec3::splat(0.5));
    let lamp = quad(vec3(0.3, 1.49, 0.3), Vec3::X * 0.6, Vec3::Z * 0.6, 1);
    place(
        &mut scene,
        lamp,
        Material::emitter("lamp", Vec3::splat(5.0)),
    );
    let block = cuboid(vec3(-0.3, 0.0, -0.9), vec3(0.2, 0.7, -0.4), 1);
    place(
        &mut scene,
        block,
        Material::matt("block", vec3(0.8, 0.3, 0.2)),
    );
    let count = 600;
    let walk: Vec<Probe> = (0..count)
        .map(|step| {
            let t = step as f32 / count as f32;
            facing(
                vec3(-0.9, 0.02, -1.4).lerp(vec3(0.7, 0.02, 1.4), t),
                Vec3::Y,
            )
        })
        .collect();
    for visibility in ["none", "distance"] {
        let visibility = format!("visibility={visibility}");
        let settings = [&visibility, "density=2", "resolution=32"];
        let names = ["shadow-map", "final-gather"];
        let indirect = at_probes(
            &gpu,
            &scene,
            &names[1..],
            &settings,
            &walk,
            Output::Irradiance,
        );
        let mean = indirect.iter().map(|irradiance| irradiance.x).sum::<f32>() / count as f32;
        let steps = indirect
            .windows(2)
            .map(|two| (two[1].x - two[0].x).abs() / mean);
        let worst = steps.fold(0.0, f32::max);
        println!("{visibility}: largest step {worst:.4} of the mean {mean}");
        assert!(worst < 0.05, "{visibility}: {worst}");
    }
}
