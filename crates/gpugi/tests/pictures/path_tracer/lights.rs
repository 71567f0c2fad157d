//! Direct light on a matt floor compared with closed forms: squares, points, spots, directions, soft lights and
//! textured lamps.

use std::sync::Arc;

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3, dvec3, vec3};
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::{
    AlphaMode, Camera, Image, Light, LightKind, Material, Mesh, Pixels, Scene, Texture, TextureRef,
    Wrap,
};

use super::{bounces, parallel, picture, trace, tracer};
use crate::common::{floor, from_above, gpu, lit_by, place};

/// Form factor between parallel unit squares at distance `h`, one above the other (Howell, configuration C-11).
fn form_factor(h: f64) -> f64 {
    let x = 1.0 / h;
    let d = (1.0 + x * x).sqrt();
    let logarithm = ((1.0 + x * x).powi(2) / (1.0 + 2.0 * x * x)).sqrt().ln();
    2.0 / (PI * x * x) * (logarithm + 2.0 * x * d * (x / d).atan() - 2.0 * x * x.atan())
}

/// A unit square at height `y` that faces down.
fn lamp(y: f32) -> Mesh {
    quad(vec3(-0.5, y, -0.5), Vec3::X, Vec3::Z, 1)
}

#[test]
fn parallel_squares_exchange_their_form_factor() {
    let Some(gpu) = gpu() else { return };
    assert!((form_factor(1.0) - 0.1998).abs() < 1e-4);
    for (distance, samples) in [(0.25_f32, 64), (1.0, 64), (3.0, 16)] {
        let mut scene = floor(0.5);
        place(&mut scene, lamp(distance), Material::emitter("", Vec3::ONE));
        // From above the lamp, whose back is invisible.
        let camera = from_above(1.0, 5.0);
        let batches = trace(&gpu, &scene, &camera, [16, 16], samples, &bounces(1));
        // Radiance of the floor: rho / pi times the irradiance pi F.
        let expected = 0.5 * form_factor(distance.into());
        let what = format!("squares {distance} m apart");
        batches
            .mean()
            .check(&what, DVec3::splat(expected), 0.005 * expected);
    }
}

#[test]
fn of_a_lamp_with_alpha_shines_what_exists() {
    let Some(gpu) = gpu() else { return };
    let distance = 0.5;
    let expected = 0.5 * form_factor(distance);
    for (alpha_mode, alpha, share) in [
        (AlphaMode::Mask { cutoff: 0.5 }, 0.2, 0.0),
        (AlphaMode::Mask { cutoff: 0.5 }, 0.8, 1.0),
        (AlphaMode::Blend, 0.25, 0.25),
    ] {
        let mut scene = floor(0.5);
        let material = Material {
            alpha_mode,
            base_color: Vec3::ZERO.extend(alpha),
            ..Material::emitter("", Vec3::ONE)
        };
        place(&mut scene, lamp(distance as f32), material);
        let camera = from_above(1.0, 5.0);
        let batches = trace(&gpu, &scene, &camera, [16, 16], 256, &bounces(1));
        let what = format!("{alpha_mode:?} of {alpha}");
        batches
            .mean()
            .check(&what, DVec3::splat(share * expected), 0.03 * expected);
    }
}

/// Irradiance of a horizontal floor [W/m^2], KHR_lights_punctual, averaged over a pixel with sides of `pixel` (m).
fn punctual_irradiance(light: &Light, at: Vec3, pixel: f64) -> f64 {
    const STEPS: i32 = 4;
    let mut sum = 0.0;
    for i in 0..STEPS {
        for j in 0..STEPS {
            let part = |k: i32| pixel * ((f64::from(k) + 0.5) / f64::from(STEPS) - 0.5);
            sum += at_point(light, at.as_dvec3() + dvec3(part(i), 0.0, part(j)));
        }
    }
    sum / f64::from(STEPS * STEPS)
}

fn at_point(light: &Light, at: DVec3) -> f64 {
    let intensity = f64::from(light.intensity.x);
    let shines = light.direction().as_dvec3();
    if light.kind == LightKind::Directional {
        return intensity * (-shines.y).max(0.0);
    }
    let toward = light.position().as_dvec3() - at;
    let distance = toward.length();
    let direction = toward / distance;
    let mut value = intensity * direction.y.max(0.0) / (distance * distance);
    if let Some(range) = light.range {
        value *= (1.0 - (distance / f64::from(range)).powi(4)).clamp(0.0, 1.0);
    }
    if let LightKind::Spot {
        inner_cone_angle,
        outer_cone_angle,
    } = light.kind
    {
        let (inner, outer) = (
            f64::from(inner_cone_angle).cos(),
            f64::from(outer_cone_angle).cos(),
        );
        let inside = ((-direction.dot(shines) - outer) / (inner - outer)).clamp(0.0, 1.0);
        value *= inside * inside;
    }
    value
}

fn punctual() -> Vec<Light> {
    let light = |kind, intensity| Light::new("", kind, Vec3::splat(intensity));
    let spot = LightKind::Spot {
        inner_cone_angle: 0.15,
        outer_cone_angle: 0.4,
    };
    let point = light(LightKind::Point, 10.0).aimed(vec3(0.5, 1.0, -0.3), Vec3::ZERO);
    let ranged = Light {
        range: Some(1.6),
        ..point.clone()
    };
    vec![
        point,
        ranged,
        light(spot, 20.0).aimed(vec3(1.0, 3.0, 0.0), vec3(0.2, 0.0, 0.1)),
        light(LightKind::Directional, 3.0).aimed(vec3(1.0, 2.0, 0.5), Vec3::ZERO),
    ]
}

/// The centre of a pixel of a picture from above.
fn on_floor(index: usize, size: u32, side: f32, camera: &Camera) -> Vec3 {
    let along = |k: u32| (k as f32 + 0.5) / size as f32 - 0.5;
    let (x, y) = (along(index as u32 % size), along(index as u32 / size));
    let axis = |column: glam::Vec4| column.truncate() * side;
    let across = axis(camera.world_from_view.x_axis) * x;
    across - axis(camera.world_from_view.y_axis) * y
}

#[test]
fn punctual_light_falls_by_the_inverse_square_and_the_cosine() {
    let Some(gpu) = gpu() else { return };
    const SIZE: u32 = 24;
    let camera = from_above(2.4, 5.0);
    let mut sum = vec![0.0; (SIZE * SIZE) as usize];
    for light in punctual() {
        let scene = lit_by(floor(2.0), light.clone());
        let mut tracer = tracer(&gpu, &scene, [SIZE; 2], &bounces(1));
        let radiance = picture(&mut tracer, &camera, 64, 1);
        let expected: Vec<f64> = (0..sum.len())
            .map(|at| {
                let at = on_floor(at, SIZE, 2.4, &camera);
                0.5 / PI * punctual_irradiance(&light, at, 0.1)
            })
            .collect();
        let brightest = expected.iter().copied().fold(0.0, f64::max);
        for (at, (&expected, color)) in expected.iter().zip(radiance.chunks(3)).enumerate() {
            // The remaining noise is from where in the pixel the samples lie: 64 well-distributed ones.
            let error = (f64::from(color[0]) - expected).abs();
            assert!(
                error <= 0.004 * expected + 0.001 * brightest,
                "pixel {at} of {light:?}: {}, not {expected}",
                color[0]
            );
            sum[at] += expected;
        }
    }
    // All at once: each light is chosen with its probability, and the result is their sum.
    let mut scene = floor(2.0);
    scene.lights = punctual();
    let batches = trace(&gpu, &scene, &camera, [SIZE; 2], 32, &bounces(1));
    let expected = sum.iter().sum::<f64>() / sum.len() as f64;
    batches
        .mean()
        .check("all", DVec3::splat(expected), 0.015 * expected);
}

#[test]
fn narrow_cones_keep_their_intensity() {
    let Some(gpu) = gpu() else { return };
    for (inner, outer) in [(0.5_f32, 1.0_f32), (0.0, 1.0), (1.0, 1.0), (0.05, 0.05)] {
        let kind = LightKind::Spot {
            inner_cone_angle: inner.to_radians(),
            outer_cone_angle: outer.to_radians(),
        };
        let light = Light::new("", kind, Vec3::splat(50.0)).aimed(vec3(0.0, 5.0, 0.0), Vec3::ZERO);
        let scene = lit_by(floor(2.0), light);
        let mut tracer = tracer(&gpu, &scene, [8; 2], &bounces(1));
        for color in picture(&mut tracer, &from_above(0.001, 2.0), 4, 1).chunks(3) {
            let irradiance = f64::from(color[0]) * PI / 0.5;
            assert!(
                (irradiance - 2.0).abs() < 0.02,
                "{irradiance} between {inner} and {outer} degrees"
            );
        }
    }
}

/// Irradiance is harmonic in the light's position: its mean over a sphere of positions is its value at the centre. Over
/// a cap of directions, the mean cosine is (1 + cos r) / 2 of that at the centre.
#[test]
fn soft_lights_keep_the_mean_irradiance() {
    let Some(gpu) = gpu() else { return };
    let camera = from_above(0.4, 5.0);
    for (light, factor) in [
        (punctual().remove(0), 1.0),
        (punctual().remove(3), (1.0 + 0.3_f64.cos()) / 2.0),
    ] {
        let radius = if factor < 1.0 { 0.3 } else { 0.6 };
        let soft = Light {
            radius,
            ..light.clone()
        };
        let scene = lit_by(floor(2.0), soft);
        let batches = trace(&gpu, &scene, &camera, [8, 8], 64, &bounces(1));
        // Averaged over the whole picture, in 16 x 16 parts.
        let parts = 0..256;
        let sum: f64 = parts
            .map(|at| at_point(&light, on_floor(at, 16, 0.4, &camera).as_dvec3()))
            .sum();
        let expected = 0.5 / PI * factor * sum / 256.0;
        batches.mean().check(
            &format!("{:?}", light.kind),
            DVec3::splat(expected),
            0.005 * expected,
        );
    }
}

/// A scene with one lamp whose left half (by u) is white and whose right half is black.
fn half_a_lamp() -> Scene {
    let mut scene = floor(2.0);
    scene.images.push(Arc::new(Image {
        name: "halves".to_owned(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8(vec![255, 255, 255, 255, 0, 0, 0, 255]),
    }));
    scene.textures.push(Texture {
        image: 0,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: true,
    });
    let mut mesh = lamp(1.0);
    // u follows x, whatever the mesh's own coordinates.
    mesh.uvs[0] = mesh
        .positions
        .iter()
        .map(|at| Vec2::new(at.x + 0.5, at.z + 0.5))
        .collect();
    let material = Material {
        emissive_texture: Some(TextureRef::new(0)),
        ..Material::emitter("", Vec3::splat(4.0))
    };
    place(&mut scene, mesh, material);
    scene
}

#[test]
fn a_textured_lamp_shines_where_it_is_bright() {
    let Some(gpu) = gpu() else { return };
    let scene = half_a_lamp();
    // Seen directly from below.
    let up = parallel(Vec3::Y, vec3(0.0, -0.2, 0.001), 1.0);
    let up = Camera {
        world_from_view: {
            let mut place = up.world_from_view;
            place.w_axis = vec3(0.0, 0.5, 0.0).extend(1.0);
            place
        },
        ..Camera {
            projection: gpugi_scene::Projection::Orthographic { height: 0.9 },
            ..up
        }
    };
    let right = up.world_from_view.x_axis.x.signum();
    let batches = trace(&gpu, &scene, &up, [8, 8], 1, &bounces(0));
    for (at, pixel) in batches.pixels().into_iter().enumerate() {
        let is_bright = (at % 8 < 4) == (right > 0.0);
        assert_eq!(pixel.x, if is_bright { 4.0 } else { 0.0 }, "pixel {at}");
    }
    // By the light on the floor: that of the square's left half only.
    let camera = from_above(2.4, 5.0);
    let batches = trace(&gpu, &scene, &camera, [16, 16], 96, &bounces(1));
    let irradiance = |at: Vec3| {
        const STEPS: u32 = 24;
        let mut sum = 0.0;
        for i in 0..STEPS {
            for j in 0..STEPS {
                let along = |k: u32| (f64::from(k) + 0.5) / f64::from(STEPS);
                let point = dvec3(0.5 * along(i) - 0.5, 1.0, along(j) - 0.5);
                let toward = point - at.as_dvec3();
                let d2 = toward.length_squared();
                sum += toward.y * toward.y / (d2 * d2);
            }
        }
        4.0 * 0.5 * sum / f64::from(STEPS * STEPS)
    };
    for left in [true, false] {
        let is_wanted = |at: Vec3| (at.x < 0.0) == left;
        let pixels = (0..256).map(|at| on_floor(at, 16, 2.4, &camera));
        let wanted: Vec<f64> = pixels.filter(|&at| is_wanted(at)).map(irradiance).collect();
        let expected = 0.5 / PI * wanted.iter().sum::<f64>() / wanted.len() as f64;
        batches
            .over(|x, y| is_wanted(on_floor((y * 16 + x) as usize, 16, 2.4, &camera)))
            .check(
                &format!("the floor's left: {left}"),
                DVec3::splat(expected),
                0.002,
            );
    }
}
