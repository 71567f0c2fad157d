//! environment-map on a sphere, which hides none of the environment from itself, compared with the path tracer.

mod glass;
mod occlusion;

use std::sync::Arc;

use std::f32::consts::FRAC_PI_2;

use crate::common::{floor, from_above, gpu, measured, picture, place, render};
use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::light_paths::LightClass;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::shapes::sphere;
use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{Camera, Environment, Image, Material, MaterialModel, Pixels, Scene};

const SIZE: u32 = 32;

/// A sky with a wide sun, brighter above, red toward +X.
fn sky() -> Environment {
    const WIDTH: usize = 64;
    const HEIGHT: usize = 32;
    let texel = |index: usize| {
        let (x, y) = (index % WIDTH, index / WIDTH);
        let sun = if x.abs_diff(28) < 3 && y.abs_diff(9) < 3 {
            12.0
        } else {
            0.0
        };
        let red = if (40..56).contains(&x) { 1.0 } else { 0.2 };
        let height = 1.0 - y as f32 / HEIGHT as f32;
        [sun + red, sun + 0.3 + height, sun + 0.6 * height, 1.0]
    };
    Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width: WIDTH as u32,
            height: HEIGHT as u32,
            pixels: Pixels::Rgba32Float((0..WIDTH * HEIGHT).flat_map(texel).collect()),
        }),
        rotation: glam::Quat::from_rotation_y(0.7),
        intensity: 1.5,
    }
}

fn ball(material: Material, environment: Environment) -> Scene {
    let mut scene = Scene::new("ball");
    place(&mut scene, sphere(1.0, 64), material);
    scene.environment = Some(environment);
    scene
}

fn camera() -> Camera {
    Camera::look_at("", vec3(0.6, 1.0, 2.6), Vec3::ZERO, 0.8)
}

fn metal(roughness: f32) -> Material {
    Material::metal("metal", vec3(0.95, 0.8, 0.5), roughness)
}

fn plastic(roughness: f32) -> Material {
    Material {
        name: "plastic".into(),
        base_color: vec3(0.6, 0.3, 0.2).extend(1.0),
        roughness,
        ..Material::default()
    }
}

fn phong(shininess: f32) -> Material {
    Material {
        model: MaterialModel::Phong {
            kd: Vec3::splat(0.3),
            ks: Vec3::splat(0.6),
            shininess,
        },
        ..plastic(1.0)
    }
}

fn alone(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> Renderer {
    let names = ["environment-map".to_owned()];
    let mut renderer = Renderer::new(gpu, scene, [SIZE, SIZE], &names).expect("a renderer");
    for (name, value) in [("resolution", "64"), ("samples", "64")]
        .iter()
        .chain(settings)
    {
        renderer
            .set("environment-map", name, value)
            .expect("a setting");
    }
    renderer
}

/// rel-mse against the path tracer.
fn error(gpu: &Gpu, material: Material, settings: &[(&str, &str)]) -> f64 {
    error_in(gpu, &ball(material, sky()), &camera(), settings)
}

fn error_in(gpu: &Gpu, scene: &Scene, camera: &Camera, settings: &[(&str, &str)]) -> f64 {
    let mut renderer = alone(gpu, scene, settings);
    let found = measured(gpu, scene, camera, &mut renderer, [4, 128]);
    found.value(Metric::RelMse).expect("rel-mse")
}

#[test]
fn spheres_are_near_the_truth_over_roughness() {
    let Some(gpu) = gpu() else { return };
    let matt = || Material::matt("matt", Vec3::splat(0.7));
    let cases: [(&str, Material, &[_], f64); 8] = [
        ("mirror", metal(0.0), &[], 0.012),
        // Between the levels for 0 and 0.19.
        ("metal of roughness 0.12", metal(0.12), &[], 0.02),
        ("metal of roughness 0.5", metal(0.5), &[], 0.03),
        ("metal of roughness 1", metal(1.0), &[], 0.01),
        ("plastic of roughness 0.3", plastic(0.3), &[], 0.016),
        ("matt", matt(), &[], 0.003),
        (
            "matt, harmonics",
            matt(),
            &[("irradiance", "harmonics")],
            0.006,
        ),
        ("Phong of shininess 40", phong(40.0), &[], 0.02),
    ];
    for (name, material, settings, bound) in cases {
        let error = error(&gpu, material, settings);
        println!("{name}: rel-mse {error:.1e}, at most {bound:.1e}");
        assert!(error < bound, "{name}: {error}");
    }
    let gold = |roughness| Material {
        model: MaterialModel::Conductor {
            n: vec3(0.18, 0.42, 1.37),
            k: vec3(3.42, 2.35, 1.77),
        },
        ..metal(roughness)
    };
    for (metals, bound) in [("exact", 0.012), ("approximate", 0.02)] {
        let error = error(&gpu, gold(0.0), &[("metals", metals)]);
        println!("gold, {metals}: rel-mse {error:.1e}, at most {bound:.1e}");
        assert!(error < bound, "gold, {metals}: {error}");
    }
    // What the tutorial's maps omit.
    let without = error(&gpu, phong(40.0), &[("phong-cosine", "false")]);
    println!("Phong of shininess 40 without cosine: rel-mse {without:.1e}");
    assert!(without > 0.1, "{without}");
}

#[test]
fn a_white_environment_shows_albedos() {
    let Some(gpu) = gpu() else { return };
    let mut white = sky();
    white.image = Arc::new(Image {
        name: "white".into(),
        width: 1,
        height: 1,
        pixels: Pixels::Rgba32Float(vec![1.0; 4]),
    });
    let cases = [
        (Material::matt("matt", Vec3::splat(0.5)), 0.75),
        (Material::metal("mirror", Vec3::splat(0.8), 0.0), 1.2),
        (Material::metal("smooth", Vec3::ONE, 0.1), 1.5),
    ];
    for (material, expected) in cases {
        let scene = ball(material, white.clone());
        let found = picture(&mut alone(&gpu, &scene, &[]), &camera());
        // Seen head-on, where Schlick's term vanishes.
        let middle = (SIZE * SIZE / 2 + SIZE / 2) as usize;
        let radiance = found.points[middle].expect("the sphere").radiance.x;
        assert!(
            (radiance / expected - 1.0).abs() < 0.01,
            "{radiance}, not {expected}"
        );
    }
}

#[test]
fn turning_the_environment_is_turning_its_image() {
    let Some(gpu) = gpu() else { return };
    for material in [metal(0.0), metal(0.4), plastic(0.6)] {
        let mut turned = sky();
        turned.rotation = glam::Quat::from_rotation_y(FRAC_PI_2);
        // About +Y from +X to -Z: what was at u moves back by a quarter of the width.
        let mut rolled = sky();
        rolled.rotation = glam::Quat::IDENTITY;
        let Pixels::Rgba32Float(texels) = &mut Arc::make_mut(&mut rolled.image).pixels else {
            panic!("radiance")
        };
        for row in texels.chunks_mut(64 * 4) {
            row.rotate_left(16 * 4);
        }
        let [a, b] = [turned, rolled].map(|environment| {
            let scene = ball(material.clone(), environment);
            picture(&mut alone(&gpu, &scene, &[]), &camera())
        });
        let pairs = a.lit().zip(b.lit());
        let worst = pairs
            .map(|(a, b)| {
                ((a.radiance - b.radiance) / (b.radiance + 0.5))
                    .abs()
                    .max_element()
            })
            .fold(0.0, f32::max);
        println!("{}: at most {worst} apart", material.name);
        assert!(worst < 0.05, "{}: {worst}", material.name);
    }
}

#[test]
fn beside_image_based_lighting_only_mirrors_are_added() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(1.0);
    scene.environment = Some(sky());
    let patterns = |renderer: &Renderer| -> Vec<String> {
        renderer
            .light_paths()
            .iter()
            .filter(|paths| paths.class == LightClass::Environment)
            .map(|paths| paths.pattern.to_string())
            .collect()
    };
    let names = crate::common::direct(&gpu, &scene);
    let both = Renderer::new(&gpu, &scene, [16, 16], &names).expect("no overlap");
    assert_eq!(patterns(&both), ["L[DG]E", "LSE"]);
    assert_eq!(patterns(&alone(&gpu, &scene, &[])), ["L[DGS]E"]);
    let only = ["image-based-lighting".to_owned()];
    let mut shadows = Renderer::new(&gpu, &scene, [16, 16], &only).expect("a renderer");
    assert_eq!(
        render(&gpu, &scene, &from_above(1.0, 1.0), 16, &[]).radiance,
        picture(&mut shadows, &from_above(1.0, 1.0)).radiance
    );
}

/// One technique leaves alone what the other claims; nothing changes elsewhere.
#[test]
fn objects_get_their_light_from_one_technique() {
    let Some(gpu) = gpu() else { return };
    let mut scene = ball(plastic(0.4), sky());
    scene.instances[0].name = "ball".into();
    let mut ground = floor(3.0);
    let mesh = scene.add_mesh(ground.meshes.remove(0));
    let material = scene.add_material(Material::matt("ground", Vec3::splat(0.5)));
    scene.add_instance(
        "ground",
        mesh,
        material,
        Mat4::from_translation(Vec3::NEG_Y),
    );
    let show = |names: &[&str], objects: Option<&str>, reflectivity: &str| {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        let mut renderer = Renderer::new(&gpu, &scene, [SIZE, SIZE], &names).expect("a renderer");
        if let Some(objects) = objects {
            renderer
                .set("environment-map", "objects", objects)
                .expect("names");
        }
        if names.iter().any(|name| name == "image-based-lighting") {
            for (name, value) in [("reflectivity", reflectivity), ("samples", "32")] {
                renderer
                    .set("image-based-lighting", name, value)
                    .expect("a setting");
            }
        }
        picture(&mut renderer, &camera())
    };
    for reflectivity in ["lobe", "ratio"] {
        let both = ["image-based-lighting", "environment-map"];
        let shared = show(&both, Some("ball"), reflectivity);
        let shadows = show(&["image-based-lighting"], None, reflectivity);
        let maps = show(&["environment-map"], None, reflectivity);
        let mut counts = [0; 2];
        for ((point, shadowed), unshadowed) in shared.lit().zip(shadows.lit()).zip(maps.lit()) {
            let expected = [unshadowed, shadowed][point.instance as usize];
            counts[point.instance as usize] += 1;
            let away = (point.radiance - expected.radiance).abs().max_element();
            assert!(away < 1e-5, "{reflectivity}, {}: {away}", point.instance);
        }
        assert!(counts.iter().all(|&count| count > 100), "{counts:?}");
    }
}

#[test]
fn a_resolution_that_is_no_power_of_two_is_refused() {
    let Some(gpu) = gpu() else { return };
    let scene = ball(metal(0.5), sky());
    let refused = alone(&gpu, &scene, &[]).set("environment-map", "resolution", "100");
    assert!(matches!(refused, Err(LightingError::Setting { .. })));
}
