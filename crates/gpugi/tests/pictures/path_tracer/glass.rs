//! Dielectrics against Fresnel, Snell and Beer-Lambert.

use glam::{DVec3, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Camera, Light, LightKind, Material, Projection, Scene, Volume};

use super::{Estimate, bounces, fresnel, parallel, trace, white};
use crate::common::{gpu, place};

/// Smooth glass of a given index that transmits `color` per metre.
fn solid(ior: f32, color: Vec3) -> Material {
    Material {
        transmission: 1.0,
        roughness: 0.0,
        ior,
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: color,
        }),
        ..Material::default()
    }
}

/// A slab between two heights, so wide that no path meets its sides.
fn slab(scene: &mut Scene, low: f32, high: f32, material: Material) {
    let mesh = cuboid(vec3(-50.0, low, -50.0), vec3(50.0, high, 50.0), 1);
    place(scene, mesh, material);
}

/// Looks at the origin from `degrees` off the vertical, toward -X.
fn at_angle(degrees: f64, height: f32) -> Camera {
    let angle = degrees.to_radians() as f32;
    parallel(Vec3::ZERO, vec3(angle.sin(), angle.cos(), 0.0), height)
}

/// Black glass in a white furnace shows only its reflectance.
#[test]
fn the_surface_of_glass_reflects_as_fresnel_says() {
    let Some(gpu) = gpu() else { return };
    let brewster = 1.5_f64.atan().to_degrees();
    for (ior, degrees) in [(1.5, 0.0), (1.5, brewster), (1.5, 85.0), (2.4, 45.0)] {
        let mut scene = Scene::new("black glass");
        scene.environment = Some(white());
        slab(&mut scene, -20.0, 0.0, solid(ior, Vec3::splat(1e-6)));
        let camera = at_angle(degrees, 0.5);
        let batches = trace(&gpu, &scene, &camera, [16, 16], 64, &bounces(8));
        let expected = fresnel(ior.into(), degrees.to_radians());
        let what = format!("index {ior} at {degrees} degrees");
        batches
            .mean()
            .check(&what, DVec3::splat(expected), 0.0015 + 0.002 * expected);
    }
}

/// An eye in glass sees a lamp in the glass mirrored by the surface above: partly up to the critical angle, totally
/// beyond it.
#[test]
fn light_is_reflected_whole_beyond_the_critical_angle() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("in glass");
    slab(&mut scene, -0.5, 0.5, solid(1.5, Vec3::ONE));
    let lamp = quad(vec3(-5.0, -0.4, 5.0), Vec3::X * 10.0, Vec3::Z * -10.0, 1);
    place(&mut scene, lamp, Material::emitter("", Vec3::splat(2.0)));
    let critical = (1.0_f64 / 1.5).asin().to_degrees();
    for degrees in [10.0, 35.0, critical - 0.3, critical + 0.3, 70.0] {
        let angle = degrees.to_radians() as f32;
        // From the middle of the slab up to its surface.
        let eye = Camera {
            projection: Projection::Orthographic { height: 0.02 },
            ..Camera::look_at("", Vec3::ZERO, vec3(angle.sin(), angle.cos(), 0.0), 1.0)
        };
        let batches = trace(&gpu, &scene, &eye, [16, 16], 16, &bounces(1));
        let expected = 2.0 * fresnel(1.0 / 1.5, degrees.to_radians());
        let what = format!("from within at {degrees} degrees");
        batches.mean().check(&what, DVec3::splat(expected), 0.012);
        if degrees > critical {
            assert_eq!(batches.mean().value, DVec3::splat(2.0), "{what}");
        }
    }
}

/// The edge of a lamp at some depth in glass is seen where Snell's law says, and its light is weaker by 1 / n^2 once
/// outside.
#[test]
fn light_bends_as_snell_says() {
    let Some(gpu) = gpu() else { return };
    const DEPTH: f64 = 0.5;
    for (ior, degrees) in [(1.0_f32, 45.0), (1.33, 60.0), (1.5, 45.0), (2.4, 75.0)] {
        let mut scene = Scene::new("a lamp in glass");
        slab(&mut scene, -2.0, 0.0, solid(ior, Vec3::ONE));
        // A half-plane, x < 0; the lines of sight go toward -x.
        let lamp = quad(
            vec3(-9.0, -DEPTH as f32, 9.0),
            Vec3::X * 9.0,
            Vec3::Z * -18.0,
            1,
        );
        place(&mut scene, lamp, Material::emitter("", Vec3::ONE));
        let camera = at_angle(degrees, 1.0);
        let batches = trace(&gpu, &scene, &camera, [32, 32], 16, &bounces(1));
        let incidence = degrees.to_radians();
        let refracted = (incidence.sin() / f64::from(ior)).asin();
        // The picture covers 1 m across the line of sight, and 1 / cos of the surface; where x < d tan(refracted), the
        // lamp is hit.
        let covered = 1.0 / incidence.cos();
        let share = 0.5 + DEPTH * refracted.tan() / covered;
        assert!(share < 1.0);
        let passed = (1.0 - fresnel(ior.into(), incidence)) / f64::from(ior * ior);
        let what = format!("index {ior} at {degrees} degrees");
        let expected = DVec3::splat(share * passed);
        batches.mean().check(&what, expected, 0.005 * expected.x);
    }
}

fn attenuated(color: Vec3, distance: f64) -> DVec3 {
    color.as_dvec3().powf(distance)
}

fn check(what: &str, estimate: Estimate, expected: DVec3) {
    estimate.check(what, expected, 1e-4);
}

/// Solids of index 1 only absorb: T = exp(-sigma d), nested solids each along their own part of the path.
#[test]
fn glass_absorbs_as_beer_and_lambert_say() {
    let Some(gpu) = gpu() else { return };
    let (outer, inner) = (vec3(0.5, 0.9, 1.0), vec3(0.2, 0.6, 0.8));
    for degrees in [0.0_f64, 50.0] {
        let mut scene = Scene::new("slab");
        scene.environment = Some(white());
        slab(&mut scene, -0.5, 0.5, solid(1.0, outer));
        let slope = 1.0 / degrees.to_radians().cos();
        let camera = at_angle(degrees, 0.1);
        let mean = trace(&gpu, &scene, &camera, [8, 8], 4, &bounces(8)).mean();
        check("a slab", mean, attenuated(outer, slope));

        // The eye inside: its ray leaves through the surface below.
        let mut within = camera.clone();
        within.world_from_view.w_axis = Vec3::ZERO.extend(1.0);
        within.projection = Projection::Perspective { vertical_fov: 1e-3 };
        let mean = trace(&gpu, &scene, &within, [8, 8], 4, &bounces(8)).mean();
        check("from within a slab", mean, attenuated(outer, 0.5 * slope));

        slab(&mut scene, -0.1, 0.2, solid(1.0, inner));
        within.world_from_view.w_axis = (Vec3::Y * 0.35).extend(1.0);
        let mean = trace(&gpu, &scene, &within, [8, 8], 4, &bounces(8)).mean();
        let expected = attenuated(outer, 0.55 * slope) * attenuated(inner, 0.3 * slope);
        check("from within the outer of nested slabs", mean, expected);
        within.world_from_view.w_axis = (Vec3::Y * 0.1).extend(1.0);
        let mean = trace(&gpu, &scene, &within, [8, 8], 4, &bounces(8)).mean();
        let expected = attenuated(outer, 0.4 * slope) * attenuated(inner, 0.2 * slope);
        check("from within the inner of nested slabs", mean, expected);
        let mean = trace(&gpu, &scene, &camera, [8, 8], 4, &bounces(8)).mean();
        let expected = attenuated(outer, 0.7 * slope) * attenuated(inner, 0.3 * slope);
        check("nested slabs", mean, expected);
    }
}

/// The eye under water, as it were: what lies in the same solid is seen through it, and the light on it also comes
/// through the solid.
#[test]
fn what_lies_in_the_same_solid_is_seen_through_it() {
    let Some(gpu) = gpu() else { return };
    let color = vec3(0.3, 0.6, 0.9);
    let mut scene = Scene::new("under water");
    slab(&mut scene, -3.0, 1.0, solid(1.33, color));
    let floor = quad(vec3(-9.0, -2.0, 9.0), Vec3::X * 18.0, Vec3::Z * -18.0, 1);
    place(&mut scene, floor, Material::emitter("", Vec3::splat(2.0)));
    // Between them hangs the back of a single-sided wall, which the eye does not see.
    let culled = quad(vec3(-9.0, -1.0, -9.0), Vec3::X * 18.0, Vec3::Z * 18.0, 1);
    assert!(culled.normals[0].y < 0.0);
    place(&mut scene, culled, Material::matt("", Vec3::splat(0.5)));
    let eye = Camera {
        projection: Projection::Perspective { vertical_fov: 1e-3 },
        ..Camera::look_at("", Vec3::ZERO, Vec3::NEG_Y, 1.0)
    };
    let mean = trace(&gpu, &scene, &eye, [8, 8], 4, &bounces(0)).mean();
    check("a lamp in water", mean, 2.0 * attenuated(color, 2.0));
}

/// The reflectance between two indices depends on their ratio: glass within the same glass is invisible, and an index
/// that matches its surroundings reflects nothing.
#[test]
fn nested_glass_reflects_by_the_ratio_of_the_indices() {
    let Some(gpu) = gpu() else { return };
    for (outer, inner) in [(1.5, 1.5), (1.33, 1.5), (1.5, 1.0), (1.0, 1.5)] {
        // The eye looks into the outer slab from outside, straight down; the inner slab is black inside.
        let mut scene = Scene::new("nested");
        scene.environment = Some(white());
        slab(&mut scene, -30.0, 0.0, solid(outer, Vec3::ONE));
        slab(&mut scene, -25.0, -1.0, solid(inner, Vec3::splat(1e-6)));
        let camera = at_angle(0.0, 0.5);
        let batches = trace(&gpu, &scene, &camera, [16, 16], 32, &bounces(16));
        let (first, second) = (
            fresnel(outer.into(), 0.0),
            fresnel(f64::from(inner) / f64::from(outer), 0.0),
        );
        // Light bounces between the two surfaces: R = F1 + (1 - F1)^2 F2 / (1 - F1 F2).
        let expected = first + (1.0 - first).powi(2) * second / (1.0 - first * second);
        batches.mean().check(
            &format!("{inner} in {outer}"),
            DVec3::splat(expected),
            0.003,
        );
    }
}

/// Light reaches the far side of rough clear glass through the absorbing solid around it: it is absorbed along its
/// whole path except within the clear glass.
#[test]
fn light_on_its_way_to_rough_glass_is_absorbed_too() {
    let Some(gpu) = gpu() else { return };
    let color = Vec3::new(0.5, 0.8, 0.2);
    let brightness = |around: Vec3| {
        let mut scene = Scene::new("frost in glass");
        slab(&mut scene, -3.0, 3.0, solid(1.0, around));
        let frost = Material {
            roughness: 0.4,
            ..solid(1.5, Vec3::ONE)
        };
        let small = vec3(0.03, 0.005, 0.03);
        place(&mut scene, cuboid(-small, small, 1), frost);
        let light = Light::new("", LightKind::Point, Vec3::ONE);
        let below = vec3(0.0, -1.0, 0.001);
        scene.lights.push(light.aimed(below, Vec3::ZERO));
        let eye = Camera {
            projection: Projection::Orthographic { height: 0.04 },
            ..Camera::look_at("", vec3(0.0, 0.5, 0.0), Vec3::ZERO, 1.0)
        };
        trace(&gpu, &scene, &eye, [16, 16], 64, &bounces(4))
            .mean()
            .value
    };
    let (clear, absorbed) = (brightness(Vec3::ONE), brightness(color));
    assert!(clear.min_element() > 0.0, "{clear}");
    // The same sample points take the same paths in both.
    let (found, expected) = (absorbed / clear, attenuated(color, 1.5));
    assert!(
        (found / expected - 1.0).abs().max_element() < 0.02,
        "{found}, not {expected}"
    );
}
