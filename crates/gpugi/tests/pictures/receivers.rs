//! Receivers that are not pixels: probes in free space and texels, against closed forms.

use std::f32::consts::PI;

use crate::common::gpu;
use glam::{Mat4, Vec2, Vec3, vec3};
use gpugi::capture::{Output, Probe, Receiver, Slots, Target, View};
use gpugi::gpu::{Frame, Gpu, read_buffer};
use gpugi::lighting::{Budget, Lighting};
use gpugi::techniques::Registry;
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Camera, Environment, Image, Light, LightKind, Material, Pixels, Scene};

/// What gathers give at probes, once maps are ready; the target has `entries` entries.
fn lit(
    gpu: &Gpu,
    scene: &Scene,
    names: &[&str],
    probes: &[Probe],
    output: Output,
    slots: Slots,
    entries: u32,
) -> Vec<Vec3> {
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    let registry = Registry::default();
    let mut on_gpu = Lighting::upload(gpu, scene, &names, &registry).expect("an upload");
    let mut lighting = Lighting::new(gpu, &mut on_gpu, &names, &registry).expect("lighting");
    lighting.light_elsewhere();
    let target = Target::new(gpu, entries).expect("a target");
    let receiver = Receiver::of_probes(gpu, probes, output, &target, slots).expect("a receiver");
    // A camera that sees none of the probes.
    let away = Camera::look_at("", vec3(0.0, 50.0, 0.0), vec3(0.0, 60.0, 0.1), 0.5);
    let view = View::new(&away, [8, 8], Vec2::ZERO, 0, 0, on_gpu.diagonal());
    loop {
        let mut frame = Frame::new(gpu, false);
        let readiness = lighting
            .prepare(&mut frame, &mut on_gpu, &view, Budget::UNLIMITED)
            .expect("maps");
        if readiness.is_usable() {
            frame.clear(&target.radiance);
            lighting
                .gather(&mut frame, &on_gpu, &receiver)
                .expect("light");
            frame.submit().expect("a frame");
            break;
        }
        frame.submit().expect("a frame");
        gpu.wait().expect("the GPU");
    }
    let sums: Vec<[f32; 4]> =
        read_buffer(gpu, &target.radiance, u64::from(entries) * 16).expect("sums");
    sums.into_iter().map(|[r, g, b, _]| vec3(r, g, b)).collect()
}

fn one(gpu: &Gpu, scene: &Scene, names: &[&str], probe: Probe, output: Output) -> Vec3 {
    lit(gpu, scene, names, &[probe], output, Slots::default(), 1)[0]
}

fn near(found: Vec3, expected: Vec3, tolerance: f32) {
    let error = ((found - expected) / expected.max(Vec3::splat(1e-6)))
        .abs()
        .max_element();
    assert!(error < tolerance, "{found} instead of {expected}");
}

/// A point light of intensity I above a floor with a block.
fn lamp_over_block() -> (Scene, Vec3, Vec3) {
    let mut scene = Scene::new("block");
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    for mesh in [
        shapes::quad(
            vec3(-4.0, 0.0, 4.0),
            vec3(8.0, 0.0, 0.0),
            vec3(0.0, 0.0, -8.0),
            1,
        ),
        shapes::cuboid(vec3(-0.5, 0.8, -0.5), vec3(0.5, 1.0, 0.5), 1),
    ] {
        let mesh = scene.add_mesh(mesh);
        scene.add_instance("", mesh, grey, Mat4::IDENTITY);
    }
    let (intensity, at) = (vec3(4.0, 2.0, 1.0), vec3(0.0, 3.0, 0.0));
    scene
        .lights
        .push(Light::new("lamp", LightKind::Point, intensity).aimed(at, Vec3::ZERO));
    (scene, intensity, at)
}

/// Fluence I / d^2, whatever the direction; irradiance I cos / d^2; inscatter p(cos) I / d^2; nothing behind the block.
#[test]
fn probes_in_the_light_of_a_lamp() {
    let Some(gpu) = gpu() else { return };
    let (scene, intensity, lamp) = lamp_over_block();
    let position = vec3(1.5, 1.0, 0.5);
    let to_lamp = lamp - position;
    let fluence = intensity / to_lamp.length_squared();
    let names = ["shadow-map"];
    for direction in [Vec3::Y, Vec3::NEG_Y, vec3(0.6, 0.0, -0.8)] {
        let probe = Probe {
            position,
            direction,
        };
        near(
            one(&gpu, &scene, &names, probe, Output::Fluence),
            fluence,
            1e-3,
        );
        let cosine = direction.dot(to_lamp.normalize());
        let irradiance = one(&gpu, &scene, &names, probe, Output::Irradiance);
        near(
            irradiance + Vec3::ONE,
            fluence * cosine.max(0.0) + Vec3::ONE,
            1e-3,
        );
        for g in [0.0_f32, 0.6, -0.3] {
            // Light travels away from the lamp and is scattered toward `direction`.
            let forward = -cosine;
            let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * forward).powf(1.5));
            let scattered = one(
                &gpu,
                &scene,
                &names,
                probe,
                Output::Inscatter { asymmetry: g },
            );
            near(scattered, fluence * phase, 2e-3);
        }
    }
    let hidden = Probe {
        position: vec3(0.0, 0.5, 0.0),
        direction: Vec3::Y,
    };
    for output in [
        Output::Fluence,
        Output::Irradiance,
        Output::Inscatter { asymmetry: 0.2 },
    ] {
        assert_eq!(one(&gpu, &scene, &names, hidden, output), Vec3::ZERO);
    }
}

/// Under an even sky of radiance L: fluence 4 pi L, irradiance pi L, isotropic inscatter L.
#[test]
fn probes_under_an_even_sky() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("sky");
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    let mesh = scene.add_mesh(shapes::sphere(0.1, 8));
    // Far and small, on either side: the probe lies within the scene's bounds.
    for at in [vec3(30.0, 20.0, 25.0), vec3(-30.0, -20.0, -25.0)] {
        scene.add_instance("far", mesh, grey, Mat4::from_translation(at));
    }
    let radiance = vec3(0.5, 1.0, 2.0);
    let texel = [radiance.x, radiance.y, radiance.z, 1.0];
    scene.environment = Some(Environment {
        image: Image {
            name: String::new(),
            width: 32,
            height: 16,
            pixels: Pixels::Rgba32Float(texel.repeat(32 * 16)),
        }
        .into(),
        rotation: glam::Quat::from_rotation_y(0.4),
        intensity: 1.0,
    });
    let probe = Probe {
        position: Vec3::ZERO,
        direction: vec3(0.48, 0.6, 0.64),
    };
    for (name, tolerance) in [("environment-map", 5e-3), ("image-based-lighting", 2e-2)] {
        let found = |output| one(&gpu, &scene, &[name], probe, output);
        near(found(Output::Fluence), 4.0 * PI * radiance, 5e-3);
        near(found(Output::Irradiance), PI * radiance, tolerance);
        near(found(Output::Inscatter { asymmetry: 0.0 }), radiance, 5e-3);
        near(
            found(Output::Inscatter { asymmetry: 0.5 }),
            radiance,
            5.0 * tolerance,
        );
    }
}

/// Results lie where slots say, and nowhere else.
#[test]
fn results_lie_in_their_slots() {
    let Some(gpu) = gpu() else { return };
    let (scene, intensity, lamp) = lamp_over_block();
    let positions = [
        vec3(1.5, 1.0, 0.5),
        vec3(-1.5, 0.7, 0.2),
        vec3(0.1, 2.0, 1.0),
    ];
    let probes = positions.map(|position| Probe {
        position,
        direction: Vec3::Y,
    });
    let slots = Slots {
        first: 2,
        stride: 4,
    };
    let found = lit(
        &gpu,
        &scene,
        &["shadow-map"],
        &probes,
        Output::Fluence,
        slots,
        13,
    );
    for (index, found) in found.iter().enumerate() {
        match index
            .checked_sub(2)
            .filter(|from_first| from_first % 4 == 0)
        {
            Some(from_first) if from_first / 4 < 3 => {
                let to_lamp = lamp - positions[from_first / 4];
                near(*found, intensity / to_lamp.length_squared(), 1e-3);
            }
            _ => assert_eq!(*found, Vec3::ZERO, "entry {index}"),
        }
    }
    let target = Target::new(&gpu, 10).expect("a target");
    assert!(Receiver::of_probes(&gpu, &probes, Output::Fluence, &target, slots).is_err());
}

/// Beer-Lambert: light that comes through a medium of extinction sigma from distance d is e^(-sigma d) of what it was,
/// and is added to what the target holds.
#[test]
fn what_is_seen_through_a_medium_is_dimmed() {
    let Some(gpu) = gpu() else { return };
    let (scene, intensity, lamp) = lamp_over_block();
    let extinction = vec3(0.1, 0.4, 1.5);
    let eye = vec3(3.0, 1.0, 0.0);
    let positions = [
        vec3(1.5, 1.0, 0.5),
        vec3(-1.5, 0.7, 0.2),
        vec3(0.1, 2.0, 1.0),
    ];
    let transmittance = positions.map(|at| (-extinction * at.distance(eye)).exp());
    let probes = positions.map(|position| Probe {
        position,
        direction: Vec3::Y,
    });
    let names = ["shadow-map".to_owned()];
    let registry = Registry::default();
    let mut on_gpu = Lighting::upload(&gpu, &scene, &names, &registry).expect("an upload");
    let mut lighting = Lighting::new(&gpu, &mut on_gpu, &names, &registry).expect("lighting");
    lighting.light_elsewhere();
    let target = Target::new(&gpu, 7).expect("a target");
    let slots = Slots {
        first: 1,
        stride: 2,
    };
    let receiver = Receiver::of_probes(&gpu, &probes, Output::Fluence, &target, slots);
    let factors = transmittance.map(|factor| factor.extend(0.0).to_array());
    let factors = gpu.storage("transmittance", &factors).expect("a buffer");
    let plain = receiver.expect("a receiver");
    let dimmed = plain.clone().seen_through(&factors).expect("a receiver");
    let camera = Camera::look_at("", vec3(0.0, 50.0, 0.0), vec3(0.0, 60.0, 0.1), 0.5);
    let view = View::new(&camera, [8, 8], Vec2::ZERO, 0, 0, on_gpu.diagonal());
    let emission = vec3(0.25, 0.5, 0.75);
    gpu.write(&target.radiance, 0, &[emission.extend(0.0).to_array(); 7]);
    let mut frame = Frame::new(&gpu, false);
    let readiness = lighting.prepare(&mut frame, &mut on_gpu, &view, Budget::UNLIMITED);
    assert!(readiness.expect("maps").is_usable());
    // Two layers.
    for _ in 0..2 {
        let lit = lighting.gather(&mut frame, &on_gpu, &dimmed);
        lit.expect("light");
    }
    frame.submit().expect("a frame");
    let sums: Vec<[f32; 4]> = read_buffer(&gpu, &target.radiance, 7 * 16).expect("sums");
    for (entry, [r, g, b, _]) in sums.into_iter().enumerate() {
        let mut expected = emission;
        if entry % 2 == 1 {
            let point = entry / 2;
            let fluence = intensity / (lamp - positions[point]).length_squared();
            expected += 2.0 * fluence * transmittance[point];
        }
        near(vec3(r, g, b), expected, 1e-3);
    }
    let few = gpu.storage("transmittance", &[[1.0_f32; 4]; 2]);
    assert!(plain.seen_through(&few.expect("a buffer")).is_err());
}
