//! Light of environments on a matt wall, compared with sums over the map.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Quat, Vec3, dvec3, vec3};
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::{Environment, Light, LightKind, Material, Pixels, Scene};

use super::{bounces, environment, parallel, trace};
use crate::common::{gpu, place};

/// A wall of albedo 0.5 whose normal is not an axis.
fn wall() -> (Scene, Vec3) {
    let normal = vec3(0.6, 0.4, 0.7).normalize();
    let right = normal.any_orthonormal_vector();
    let up = normal.cross(right);
    let mut scene = Scene::new("wall");
    let mesh = quad((-right - up) * 2.0, right * 4.0, up * 4.0, 1);
    place(&mut scene, mesh, Material::matt("grey", Vec3::splat(0.5)));
    (scene, normal)
}

/// Radiance of the map in a world-space direction, interpolated between texels: around in u, up to the poles in v.
fn radiance(sky: &Environment, d: DVec3) -> DVec3 {
    let Pixels::Rgba32Float(values) = &sky.image.pixels else {
        panic!("floats")
    };
    let (width, height) = (i64::from(sky.image.width), i64::from(sky.image.height));
    // A turned map shows at d what it holds at d turned back.
    let d = sky.rotation.as_dquat().inverse() * d;
    let u = (d.x.atan2(-d.z) / TAU + 0.5) * width as f64 - 0.5;
    let v = d.y.clamp(-1.0, 1.0).acos() / PI * height as f64 - 0.5;
    let texel = |x: i64, y: i64| {
        let at = (y.clamp(0, height - 1) * width + x.rem_euclid(width)) as usize * 4;
        Vec3::from_slice(&values[at..at + 3]).as_dvec3()
    };
    let (x, y) = (u.floor() as i64, v.floor() as i64);
    let (s, t) = (u - u.floor(), v - v.floor());
    let top = texel(x, y).lerp(texel(x + 1, y), s);
    top.lerp(texel(x, y + 1).lerp(texel(x + 1, y + 1), s), t) * f64::from(sky.intensity)
}

/// No rotation, and one about a crooked axis.
fn rotations() -> [Quat; 2] {
    [Quat::IDENTITY, Environment::rotation_by([2.0, 0.7, -1.1])]
}

/// Irradiance of a plane, by the midpoint rule over the sphere.
fn irradiance(sky: &Environment, normal: DVec3) -> DVec3 {
    const STEPS: u32 = 512;
    let mut sum = DVec3::ZERO;
    for i in 0..STEPS {
        let cosine = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(STEPS);
        let sine = (1.0 - cosine * cosine).sqrt();
        for j in 0..STEPS {
            let phi = TAU * (f64::from(j) + 0.5) / f64::from(STEPS);
            let d = dvec3(sine * phi.cos(), cosine, sine * phi.sin());
            let facing = d.dot(normal);
            if facing > 0.0 {
                sum += radiance(sky, d) * facing;
            }
        }
    }
    sum * (2.0 * TAU / f64::from(STEPS * STEPS))
}

/// Two colours: left and right of the map's middle.
fn two_colors() -> Environment {
    let texels: Vec<Vec3> = (0..32)
        .map(|at| {
            if at % 8 < 4 {
                vec3(2.0, 0.5, 0.0)
            } else {
                vec3(0.0, 0.5, 1.0)
            }
        })
        .collect();
    environment(8, &texels)
}

/// A dim sky with a one-texel sun.
fn sun() -> Environment {
    let mut texels = vec![Vec3::splat(0.1); 64 * 32];
    texels[9 * 64 + 37] = vec3(500.0, 400.0, 200.0);
    environment(64, &texels)
}

#[test]
fn environments_light_a_wall_as_the_sum_of_their_texels() {
    let Some(gpu) = gpu() else { return };
    for (name, sky, samples) in [("two colours", two_colors(), 24), ("a sun", sun(), 24)] {
        for rotation in rotations() {
            let (mut scene, normal) = wall();
            let sky = Environment {
                rotation,
                intensity: 1.5,
                ..sky.clone()
            };
            let expected = irradiance(&sky, normal.as_dvec3()) * (0.5 / PI);
            scene.environment = Some(sky);
            let camera = parallel(Vec3::ZERO, normal, 1.0);
            let batches = trace(&gpu, &scene, &camera, [16, 16], samples, &bounces(1));
            let tolerance = 0.01 * expected.max_element();
            batches
                .mean()
                .check(&format!("{name} turned by {rotation}"), expected, tolerance);
        }
    }
}

/// The sky seen directly in the picture checks how the map is oriented.
#[test]
fn the_map_is_seen_where_it_lies() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("sky");
    for rotation in rotations() {
        let sky = Environment {
            rotation,
            ..two_colors()
        };
        scene.environment = Some(sky.clone());
        for toward in [
            vec3(1.0, 0.3, 0.2),
            vec3(-0.5, -0.4, 1.0),
            vec3(0.1, 0.0, -1.0),
        ] {
            let camera = gpugi_scene::Camera::look_at("", Vec3::ZERO, toward, 0.02);
            let seen = trace(&gpu, &scene, &camera, [8, 8], 4, &bounces(1)).mean();
            let expected = radiance(&sky, toward.as_dvec3().normalize());
            seen.check(&format!("toward {toward} at {rotation}"), expected, 0.02);
        }
    }
}

#[test]
fn a_uniform_sky_and_a_black_one() {
    let Some(gpu) = gpu() else { return };
    let (mut scene, normal) = wall();
    let camera = parallel(Vec3::ZERO, normal, 1.0);
    let mut sky = environment(1, &[vec3(0.2, 0.4, 0.8)]);
    sky.intensity = 2.5;
    scene.environment = Some(sky);
    let seen = trace(&gpu, &scene, &camera, [8, 8], 48, &bounces(1)).mean();
    seen.check("one texel", dvec3(0.25, 0.5, 1.0), 0.01);

    // Black, by its texels or by its intensity, gives nothing and takes nothing from the other light.
    for (texel, intensity) in [(0.0, 1.0), (1.0, 0.0)] {
        let mut black = environment(4, &[Vec3::splat(texel); 8]);
        black.intensity = intensity;
        scene.environment = Some(black);
        scene.lights.clear();
        let seen = trace(&gpu, &scene, &camera, [8, 8], 4, &bounces(4)).mean();
        assert_eq!(seen.value, DVec3::ZERO);
        let light = Light::new("sun", LightKind::Directional, Vec3::splat(PI as f32));
        scene.lights = vec![light.aimed(normal, Vec3::ZERO)];
        // Every ray leaves the wall, even where the point's coordinates are small and the corners' are not.
        let seen = trace(&gpu, &scene, &camera, [16, 16], 64, &bounces(4)).mean();
        seen.check("a sun in a black sky", DVec3::splat(0.5), 1e-5);
    }
}
