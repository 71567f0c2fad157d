//! Closed rooms and white surroundings: nothing may gain light, and what absorbs nothing must not lose any.

use glam::{DVec3, Mat4, Vec3, Vec4, vec3};
use gpugi_scene::builtin::shapes::{cuboid, sphere};
use gpugi_scene::{AlphaMode, Camera, Material, MaterialModel, Mesh, Scene, Volume};

use gpugi::reference::Settings;

use super::{bounces, faceted, inward, trace, white};
use crate::common::{gpu, place};

#[test]
fn a_closed_emitter_shines_as_the_geometric_series() {
    let Some(gpu) = gpu() else { return };
    // L = e + rho L.
    for (mesh, samples) in [
        (faceted(&sphere(1.0, 8)), 24),
        (cuboid(Vec3::splat(-1.0), Vec3::ONE, 1), 24),
    ] {
        let (emission, albedo) = (vec3(0.5, 1.0, 0.1), vec3(0.6, 0.3, 0.0));
        let mut scene = Scene::new("furnace");
        let material = Material {
            emissive: emission,
            ..Material::matt("furnace", albedo)
        };
        let name = mesh.name.clone();
        place(&mut scene, inward(mesh), material);
        let camera = Camera::look_at("", vec3(0.2, 0.1, 0.3), vec3(-0.5, 0.2, -1.0), 1.2);
        let expected = emission.as_dvec3() / (DVec3::ONE - albedo.as_dvec3());
        let batches = trace(
            &gpu,
            &scene,
            &camera,
            [16, 16],
            samples,
            &Settings::default(),
        );
        batches.mean().check(&name, expected, 0.01);
    }
}

/// One object alone in a white furnace.
fn in_white(mesh: Mesh, material: Material) -> Scene {
    let mut scene = Scene::new("white furnace");
    scene.environment = Some(white());
    place(&mut scene, mesh, material);
    scene
}

fn seen() -> Camera {
    Camera::look_at("", vec3(1.5, 2.0, 3.0), Vec3::ZERO, 0.45)
}

fn block() -> Mesh {
    cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1)
}

fn glass(roughness: f32) -> Material {
    Material {
        transmission: 1.0,
        roughness,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

/// Objects side by side, so far apart that they hardly see each other.
fn row(materials: Vec<Material>, mesh: &Mesh) -> (Scene, Camera, u32) {
    let mut scene = Scene::new("white furnace");
    scene.environment = Some(white());
    let mesh = scene.add_mesh(mesh.clone());
    let count = materials.len() as u32;
    for (at, material) in materials.into_iter().enumerate() {
        let material = scene.add_material(material);
        let place = Mat4::from_translation(Vec3::X * (at as f32 + 0.5 - count as f32 / 2.0) * 2.0);
        scene.add_instance("", mesh, material, place);
    }
    let camera = super::parallel(Vec3::ZERO, vec3(0.0, 0.6, 1.0), 2.0);
    (scene, camera, count)
}

/// What loses no light is invisible in a white furnace.
#[test]
fn what_loses_nothing_is_white_in_white() {
    let Some(gpu) = gpu() else { return };
    let thin = Material {
        volume: None,
        ..glass(0.0)
    };
    let clear_film = Material {
        base_color: Vec4::new(1.0, 1.0, 1.0, 0.3),
        alpha_mode: AlphaMode::Blend,
        ..Material::matt("film", Vec3::ONE)
    };
    let white_phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::ONE,
            ks: Vec3::ZERO,
            shininess: 10.0,
        },
        ..Material::default()
    };
    let dense = Material {
        ior: 2.4,
        ..glass(0.0)
    };
    let materials = vec![
        Material::matt("matt", Vec3::ONE),
        Material::metal("mirror", Vec3::ONE, 0.0),
        thin,
        clear_film,
        white_phong,
        glass(0.0),
        dense,
    ];
    let (scene, camera, count) = row(materials, &block());
    let batches = trace(&gpu, &scene, &camera, [count * 8, 8], 16, &bounces(512));
    for at in 0..count {
        let name = &scene.materials[at as usize].name;
        batches
            .over(|x, _| x / 8 == at)
            .check(&format!("{at} {name}"), DVec3::ONE, 0.008);
    }
}

/// Everything that loses light, on flat surfaces and on curved ones with interpolated normals, is never brighter than
/// white.
#[test]
fn nothing_is_brighter_than_white_in_white() {
    let Some(gpu) = gpu() else { return };
    let mut materials = Vec::new();
    for roughness in [0.0, 0.1, 0.4, 1.0] {
        materials.extend([
            Material::metal("metal", Vec3::ONE, roughness),
            Material {
                roughness,
                ..Material::default()
            },
            glass(roughness),
            Material {
                volume: None,
                ..glass(roughness)
            },
        ]);
    }
    materials.push(Material {
        model: MaterialModel::Phong {
            kd: Vec3::splat(0.4),
            ks: Vec3::splat(0.6),
            shininess: 40.0,
        },
        ..Material::default()
    });
    materials.push(Material {
        model: MaterialModel::Conductor {
            n: vec3(0.143, 0.375, 1.442),
            k: vec3(3.983, 2.386, 1.603),
        },
        roughness: 0.3,
        ..Material::default()
    });
    for mesh in [block(), sphere(0.7, 24)] {
        let (scene, camera, count) = row(materials.clone(), &mesh);
        let batches = trace(&gpu, &scene, &camera, [count * 8, 8], 8, &bounces(256));
        for at in 0..count {
            let material = &scene.materials[at as usize];
            let estimate = batches.over(|x, _| x / 8 == at);
            println!(
                "{} {at}, roughness {}, transmission {}: {estimate:?}",
                mesh.name, material.roughness, material.transmission
            );
            let bound = DVec3::ONE + 4.0 * estimate.error + 1e-3;
            assert!(
                estimate.value.cmple(bound).all() && estimate.error.max_element() < 0.02,
                "{} {at}: {estimate:?} of {material:?}",
                mesh.name
            );
            // Facets of rough surfaces reflect light to other facets, where this model loses it: most at roughness 1.
            let least = if material.roughness == 1.0 { 0.6 } else { 0.85 };
            assert!(
                estimate.value.max_element() > least,
                "{} {at} swallows light: {estimate:?} of {material:?}",
                mesh.name
            );
        }
    }
}

/// Absorbing glass removes light, more along longer paths.
#[test]
fn absorbing_glass_is_darker_than_clear() {
    let Some(gpu) = gpu() else { return };
    let tinted = |color: Vec3| Material {
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: color,
        }),
        ..glass(0.0)
    };
    let scene = in_white(block(), tinted(vec3(0.5, 0.1, 1.0)));
    let batches = trace(&gpu, &scene, &seen(), [12, 12], 16, &bounces(64));
    let estimate = batches.over(|x, y| (5..7).contains(&x) && (5..7).contains(&y));
    let [red, green, blue] = estimate.value.to_array();
    assert!(
        green < 0.5 * red && red < 0.9 && red > 0.3 && (blue - 1.0).abs() < 0.02,
        "{estimate:?}"
    );
}
