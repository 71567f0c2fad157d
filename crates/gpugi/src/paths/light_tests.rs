//! Lights are sampled according to their densities.

use std::sync::Arc;

use std::f64::consts::PI;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Environment, Image, Light, LightKind, Material, Pixels, Scene};

use super::lights::LightTable;
use super::sky::Sky;
use crate::gpu::{Frame, Gpu, Kernel, read_buffer};
use crate::light_paths::LightClass;
use crate::scene::GpuScene;
use crate::shader;
use crate::testing::chi_square::{Bins, assert_follows};
use crate::testing::{Random, test_gpu};

/// Few enough samples that the edges of lights, which cut through bins, have no visible effect.
const SAMPLES: usize = 1 << 15;
const TESTS: usize = 6;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Question {
    position: [f32; 3],
    rows: u32,
    sky_probability: f32,
    count: u32,
    padding: [u32; 2],
}

/// Runs `entry` of testing/lights.wesl. Returns a direction and a density per invocation.
fn ask(
    gpu: &Gpu,
    scene: &Scene,
    position: Vec3,
    entry: &str,
    directions: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let on_gpu = GpuScene::with_rays(gpu, scene).unwrap();
    let sky = match &scene.environment {
        Some(environment) => Sky::new(&environment.image),
        None => Sky::none(),
    };
    let table = LightTable::new(&on_gpu, &LightClass::ALL, sky.luminance);
    let kernel = Kernel::new(
        gpu,
        &shader!("testing.lights"),
        entry,
        Some(&on_gpu.ray_layout),
    )
    .unwrap();
    let question = Question {
        position: position.to_array(),
        rows: table.rows.len() as u32,
        sky_probability: table.sky_probability,
        count: directions.len() as u32,
        padding: [0; 2],
    };
    let question = gpu.uniform("question", &question).unwrap();
    let input = gpu.storage("directions", directions).unwrap();
    let output = gpu.storage("output", directions).unwrap();
    let rows = gpu.storage("lights", &table.rows).unwrap();
    let emitter_rows = gpu.storage("emitters", &table.emitter_rows).unwrap();
    let sky = gpu.storage("sky", &sky.words).unwrap();
    let own = [
        ("question", question.as_entire_binding()),
        ("directions", input.as_entire_binding()),
        ("output", output.as_entire_binding()),
    ];
    let lights = [
        ("lights", rows.as_entire_binding()),
        ("emitter_rows", emitter_rows.as_entire_binding()),
        ("sky_grid", sky.as_entire_binding()),
    ];
    let groups = [
        kernel.bind(gpu, 1, &own).unwrap(),
        kernel.bind(gpu, 2, &lights).unwrap(),
    ];
    let mut frame = Frame::new(gpu, false);
    frame.compute(entry, |pass| {
        let groups = [
            (0, &on_gpu.ray_bind_group),
            (1, &groups[0]),
            (2, &groups[1]),
        ];
        kernel.dispatch(pass, &groups, [directions.len() as u32, 1, 1]);
    });
    frame.submit().unwrap();
    read_buffer(gpu, &output, output.size()).unwrap()
}

/// Draws samples and compares them with the density: their distribution, and each sample against the density returned
/// with it.
fn assert_drawn_as_said(gpu: &Gpu, what: &str, scene: &Scene, position: Vec3) {
    let drawn = ask(gpu, scene, position, "draw", &[[0.0; 4]; SAMPLES]);
    let direction = |row: &[f32; 4]| DVec3::new(row[0].into(), row[1].into(), row[2].into());
    let samples: Vec<DVec3> = drawn.iter().map(direction).collect();
    assert_follows(
        what,
        TESTS,
        &Bins::sphere().with_steps(96),
        &samples,
        |directions| {
            let directions: Vec<[f32; 4]> = directions
                .iter()
                .map(|d| [d.x as f32, d.y as f32, d.z as f32, 0.0])
                .collect();
            let densities = ask(gpu, scene, position, "density", &directions);
            densities.iter().map(|row| row[3].into()).collect()
        },
    );
    // A sample's density covers its own light only. It is less than the full density if a lamp hangs in front of the
    // sky.
    if scene.environment.is_some() && !scene.instances.is_empty() {
        return;
    }
    let again = ask(gpu, scene, position, "density", &drawn);
    let agreeing = drawn
        .iter()
        .zip(&again)
        .filter(|(drawn, again)| drawn[3] > 0.0 && (again[3] / drawn[3] - 1.0).abs() < 1e-3)
        .count();
    let real = drawn.iter().filter(|row| row[3] > 0.0).count();
    // At the edges of triangles and texels, rounding may select the neighbour.
    assert!(
        agreeing * 1000 > real * 995 && real > SAMPLES / 4,
        "{what}: {agreeing} of {real} samples come with the density of their direction"
    );
}

/// A rotated map of random texels: one of them is a sun, and some are black.
fn sky() -> Environment {
    let mut random = Random(3);
    let mut texels = Vec::new();
    for texel in 0..24 * 12 {
        let value = match texel {
            100 => 30.0,
            _ if texel % 5 == 0 => 0.0,
            _ => random.next() as f32,
        };
        texels.extend([value, value * 0.5, 0.1 * value, 1.0]);
    }
    Environment {
        image: Arc::new(Image {
            name: String::new(),
            width: 24,
            height: 12,
            pixels: Pixels::Rgba32Float(texels),
        }),
        rotation: glam::Quat::from_rotation_y(0.7),
        intensity: 2.0,
    }
}

/// A scene with one light and nothing else.
fn lit_by(light: Light) -> Scene {
    Scene {
        lights: vec![light],
        ..Scene::default()
    }
}

/// Draws samples from a light that rays cannot hit, and compares them with a density.
fn assert_spread(gpu: &Gpu, what: &str, scene: &Scene, density: impl Fn(DVec3) -> f64) {
    let drawn = ask(gpu, scene, Vec3::ZERO, "draw", &[[0.0; 4]; SAMPLES]);
    let samples: Vec<DVec3> = drawn
        .iter()
        .map(|row| DVec3::new(row[0].into(), row[1].into(), row[2].into()))
        .collect();
    let bins = Bins::sphere().with_steps(96);
    assert_follows(what, TESTS, &bins, &samples, |directions| {
        directions
            .iter()
            .map(|&direction| density(direction))
            .collect()
    });
}

#[test]
fn soft_points_and_directions_are_spread_evenly() {
    let Some(gpu) = test_gpu() else { return };
    // From its own centre, a soft point light is equally likely in every direction.
    let point = Light {
        radius: 2.0,
        ..Light::new("", LightKind::Point, Vec3::ONE)
    };
    assert_spread(&gpu, "soft point", &lit_by(point), |_| 0.25 / PI);
    // The light shines along -Z, so its cap lies around +Z.
    let radius = 1.1_f64;
    let direction = Light {
        radius: radius as f32,
        ..Light::new("", LightKind::Directional, Vec3::ONE)
    };
    let inside = 1.0 / (2.0 * PI * (1.0 - radius.cos()));
    assert_spread(&gpu, "soft direction", &lit_by(direction), |d| {
        if d.z > radius.cos() { inside } else { 0.0 }
    });
}

#[test]
fn the_sky_is_drawn_as_its_density_says() {
    let Some(gpu) = test_gpu() else { return };
    let scene = Scene {
        environment: Some(sky()),
        ..Scene::default()
    };
    assert_drawn_as_said(&gpu, "sky", &scene, Vec3::ZERO);
}

#[test]
fn triangles_and_sky_together_are_drawn_as_their_densities_say() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::default();
    let bright = scene.add_material(Material::emitter("", Vec3::splat(5.0)));
    let both = scene.add_material(Material {
        double_sided: true,
        ..Material::emitter("", vec3(1.0, 2.0, 0.5))
    });
    // A lamp above shines down. A two-sided lamp to the side is seen from its back. A third lamp faces away and
    // contributes nothing.
    for (material, origin, u, v) in [
        (
            bright,
            vec3(-1.0, 2.0, -1.0),
            vec3(2.0, 0.0, 0.0),
            vec3(0.0, 0.0, 2.0),
        ),
        (
            both,
            vec3(3.0, -1.0, -1.0),
            vec3(0.0, 2.0, 0.0),
            vec3(0.0, 0.0, 2.5),
        ),
        (
            bright,
            vec3(-1.0, -2.0, -1.0),
            vec3(2.0, 0.0, 0.0),
            vec3(0.0, 0.0, 2.0),
        ),
    ] {
        let mesh = scene.add_mesh(quad(origin, u, v, 3));
        let mirrored = if material == both {
            Mat4::from_scale(vec3(1.0, 1.0, -1.0))
        } else {
            Mat4::IDENTITY
        };
        scene.add_instance("", mesh, material, mirrored);
    }
    assert_drawn_as_said(&gpu, "triangles", &scene, vec3(0.2, 0.1, -0.3));
    scene.environment = Some(sky());
    assert_drawn_as_said(&gpu, "triangles and sky", &scene, vec3(0.2, 0.1, -0.3));
}

/// Points and spots around the origin, near and far.
fn many_lights() -> Scene {
    let mut random = Random(5);
    let mut lights = Vec::new();
    for number in 0..60 {
        let mut place = || [0; 3].map(|_| 8.0 * random.next() as f32 - 4.0);
        let (at, target) = (Vec3::from(place()), Vec3::from(place()));
        let cone = LightKind::Spot {
            inner_cone_angle: 0.3,
            outer_cone_angle: 0.6,
        };
        let kind = if number % 2 == 0 {
            LightKind::Point
        } else {
            cone
        };
        let intensity = Vec3::splat(0.2 + (number % 5) as f32);
        lights.push(Light::new("", kind, intensity).aimed(at, target));
    }
    Scene {
        lights,
        ..Scene::default()
    }
}

#[test]
fn near_lights_are_chosen_as_said_and_in_proportion_to_what_they_send() {
    let Some(gpu) = test_gpu() else { return };
    let scene = many_lights();
    let at = vec3(0.3, -0.2, 0.5);
    let rows = ask(&gpu, &scene, at, "chances", &[[0.0; 4]; 60]);
    let total: f64 = rows.iter().map(|row| f64::from(row[3])).sum();
    let drawn = ask(&gpu, &scene, at, "draw", &[[0.0; 4]; SAMPLES]);
    let power = |light: &Light| match light.kind {
        LightKind::Spot {
            outer_cone_angle, ..
        } => f64::from(light.intensity.x) * (1.0 - f64::from(outer_cone_angle.cos())),
        _ => 2.0 * f64::from(light.intensity.x),
    };
    let all: f64 = scene.lights.iter().map(power).sum();
    let (mut seen, mut sent) = (0, 0.0);
    let mut second_moments = [0.0; 2];
    for (light, row) in scene.lights.iter().zip(&rows) {
        let toward = Vec3::new(row[0], row[1], row[2]);
        let direction = toward.normalize();
        let count = drawn
            .iter()
            .filter(|drawn| Vec3::new(drawn[0], drawn[1], drawn[2]).distance(direction) < 1e-4);
        let share = count.count() as f64 / SAMPLES as f64;
        let irradiance = match light.kind {
            LightKind::Spot {
                outer_cone_angle, ..
            } if (-direction).dot(light.direction()) < outer_cone_angle.cos() => 0.0,
            _ => f64::from(light.intensity.x / toward.length_squared()),
        };
        let chance = f64::from(row[3]);
        if irradiance > 0.0 {
            assert!(chance > 0.0, "a light that sends something is never chosen");
            let error = (chance / SAMPLES as f64).sqrt();
            assert!((share - chance).abs() < 5.0 * error, "{share} for {chance}");
            seen += 1;
            second_moments[0] += irradiance.powi(2) / chance;
            second_moments[1] += irradiance.powi(2) / (power(light) / all);
            sent += irradiance;
        }
    }
    assert!(
        total > 0.6 && total < 1.0 + 1e-4,
        "chances add up to {total}"
    );
    let [variance, by_power] = second_moments.map(|moment| moment / sent.powi(2) - 1.0);
    assert!(
        seen > 20 && variance < 0.3 * by_power,
        "{seen} lights, variances {variance}, {by_power}"
    );
}

#[test]
fn a_lamp_is_looked_for_on_the_side_that_is_seen() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::default();
    let lamp = scene.add_mesh(sphere(0.2, 4));
    let glow = scene.add_material(Material::emitter("lamp", Vec3::splat(20.0)));
    scene.add_instance("lamp", lamp, glow, Mat4::IDENTITY);
    let triangles = scene.meshes[lamp].indices.len() / 3;
    let positions = &scene.meshes[lamp].positions;
    let at = vec3(3.0, 0.5, 1.0);
    let rows = ask(&gpu, &scene, at, "chances", &vec![[0.0; 4]; triangles]);
    let (mut seen, mut all) = (0.0, 0.0);
    let corners = scene.meshes[lamp].indices.chunks(3);
    for (corners, row) in corners.zip(&rows) {
        let [a, b, c] = [0, 1, 2].map(|i| positions[corners[i] as usize]);
        all += row[3];
        if (b - a).cross(c - a).dot(at - a) > 0.0 {
            seen += row[3];
        }
    }
    // A node may end at two children that send nothing.
    assert!(all < 1.0 + 1e-4, "chances add up to {all}");
    // 0.66; 0.53 if nodes are split along one axis alone.
    assert!(
        seen > 0.6,
        "triangles that face the place have a chance of {seen}"
    );
}
