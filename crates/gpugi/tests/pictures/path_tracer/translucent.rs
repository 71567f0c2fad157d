//! Diffuse transmission (KHR_materials_diffuse_transmission): a white furnace, and sheets lit from behind compared with
//! closed forms, by paths and by the techniques that add direct light.

use std::f64::consts::PI;

use glam::{DVec3, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Light, LightKind, Material, MaterialModel, Scene};

use super::{bounces, environment, parallel, trace, white};
use crate::common::{gpu, picture, place, renderer_of};

/// Fractions of the light that the sheets reflect and transmit.
const REFLECTED: Vec3 = vec3(0.3, 0.4, 0.1);
const TRANSMITTED: Vec3 = vec3(0.6, 0.1, 0.45);

fn sheet_material() -> Material {
    Material {
        base_color: (2.0 * REFLECTED).extend(1.0),
        diffuse_transmission: 0.5,
        diffuse_transmission_color: 2.0 * TRANSMITTED,
        ..Material::matt("sheet", Vec3::ONE)
    }
}

/// A sheet of 2 x 2 m that faces +Y.
fn sheet(material: Material) -> Scene {
    let mut scene = Scene::new("sheet");
    let mesh = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    place(&mut scene, mesh, material);
    scene
}

/// What reflects or transmits all light is white in white: sheets, and bodies whose insides light crosses many times.
#[test]
fn what_loses_nothing_is_white_in_white() {
    let Some(gpu) = gpu() else { return };
    let matt = Material::translucent("matt", Vec3::ONE, 0.6);
    let phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::ONE,
            ks: Vec3::ZERO,
            shininess: 10.0,
        },
        ..matt.clone()
    };
    let flat = sheet(matt.clone()).meshes[0].as_ref().clone();
    let block = cuboid(Vec3::splat(-0.9), Vec3::splat(0.9), 1);
    for (what, mesh, material) in [
        ("sheet", flat.clone(), matt.clone()),
        ("sheet by Phong's model", flat, phong),
        ("body", block, matt),
    ] {
        let mut scene = Scene::new("white furnace");
        scene.environment = Some(white());
        place(&mut scene, mesh, material);
        let camera = parallel(Vec3::ZERO, vec3(0.1, 1.0, 0.3), 1.0);
        let batches = trace(&gpu, &scene, &camera, [8, 8], 64, &bounces(512));
        batches.mean().check(what, DVec3::ONE, 0.008);
    }
}

/// Under a coat, light is lost, and none is made.
#[test]
fn a_coated_body_is_never_brighter_than_white() {
    let Some(gpu) = gpu() else { return };
    for roughness in [0.0, 0.4, 1.0] {
        let material = Material {
            roughness,
            specular: 1.0,
            ..Material::translucent("coated", Vec3::ONE, 0.5)
        };
        let mut scene = Scene::new("white furnace");
        scene.environment = Some(white());
        place(&mut scene, sphere(0.9, 24), material);
        let camera = parallel(Vec3::ZERO, vec3(0.1, 1.0, 0.3), 1.0);
        let batches = trace(&gpu, &scene, &camera, [8, 8], 16, &bounces(256));
        let seen = batches.mean();
        println!("roughness {roughness}: {seen:?}");
        let bound = DVec3::ONE + 4.0 * seen.error + 1e-3;
        assert!(seen.value.cmple(bound).all(), "{seen:?}");
        assert!(seen.value.min_element() > 0.9, "{seen:?}");
    }
}

/// The mean radiance that a technique gives the sheet, seen from `side`.
fn by_technique(gpu: &Gpu, scene: &Scene, name: &str, settings: &[&str], side: Vec3) -> Vec3 {
    let camera = parallel(Vec3::ZERO, side, 1.0);
    let mut renderer = renderer_of(gpu, scene, &[name], 16, name, settings);
    let picture = picture(&mut renderer, &camera);
    let lit: Vec<Vec3> = picture.lit().map(|lit| lit.radiance).collect();
    assert_eq!(lit.len(), 16 * 16, "both sides are seen");
    lit.iter().sum::<Vec3>() / lit.len() as f32
}

/// L = rho / pi E on the side of the sun, and tau / pi E on the other.
#[test]
fn a_sun_shines_through_a_sheet() {
    let Some(gpu) = gpu() else { return };
    let mut scene = sheet(sheet_material());
    let from = vec3(0.3, 0.8, -0.2).normalize();
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(5.0));
    scene.lights.push(sun.aimed(from, Vec3::ZERO));
    let irradiance = 5.0 * f64::from(from.y);
    for (side, albedo) in [
        (vec3(0.2, 1.0, 0.1), REFLECTED),
        (vec3(0.2, -1.0, 0.1), TRANSMITTED),
    ] {
        let expected = albedo.as_dvec3() * irradiance / PI;
        let camera = parallel(Vec3::ZERO, side, 1.0);
        let traced = trace(&gpu, &scene, &camera, [8, 8], 2, &bounces(1));
        traced.mean().check("by paths", expected, 1e-3);
        let mapped = by_technique(&gpu, &scene, "shadow-map", &[], side);
        let off = (mapped.as_dvec3() / expected - 1.0).abs().max_element();
        println!("by shadow maps {mapped}, expected {expected}");
        assert!(off < 0.01, "{mapped}, expected {expected}");
    }
}

/// Between two even halves of a sky, L = rho L_above + tau L_below.
#[test]
fn a_sky_shines_through_a_sheet() {
    let Some(gpu) = gpu() else { return };
    let mut scene = sheet(sheet_material());
    let (above, below) = (vec3(1.0, 2.0, 3.0), vec3(2.0, 0.5, 4.0));
    let rows = [[above; 32], [below; 32]].concat();
    scene.environment = Some(environment(1, &rows));
    for (side, own, other) in [(1.0, above, below), (-1.0, below, above)] {
        let side = vec3(0.2, side, 0.1);
        let expected = (REFLECTED * own + TRANSMITTED * other).as_dvec3();
        let camera = parallel(Vec3::ZERO, side, 1.0);
        let traced = trace(&gpu, &scene, &camera, [16, 16], 64, &bounces(1));
        traced.mean().check("by paths", expected, 0.03);
        for (name, settings) in [
            ("image-based-lighting", &[][..]),
            ("environment-map", &["objects=*"]),
            ("radiance-transfer", &["resolution=32", "rays=256"]),
        ] {
            let found = by_technique(&gpu, &scene, name, settings, side);
            let off = (found.as_dvec3() / expected - 1.0).abs().max_element();
            println!("by {name} {found}, expected {expected}");
            assert!(off < 0.03, "{name}: {found}, expected {expected}");
        }
    }
}
