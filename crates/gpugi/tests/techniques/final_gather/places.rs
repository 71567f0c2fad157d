//! The tutorial's figures 51 to 53: an object at three places of a room, and classical environment mapping beside it.

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, join, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, MaterialModel, Scene};

use crate::common::{gpu, measured, picture, renderer_of, shining_room};

const TECHNIQUES: [&str; 2] = ["shadow-map", "final-gather"];

/// The room, empty but for a ball of radius 0.45 m.
fn with_ball(material: Material, at: Vec3) -> Scene {
    let mut scene = builtin("room", 1).expect("a scene");
    scene.remove("box,sphere").expect("objects");
    for light in &mut scene.lights {
        light.radius = 0.0;
    }
    let mesh = scene.add_mesh(sphere(0.45, 48));
    let material = scene.add_material(material);
    scene.add_instance("ball", mesh, material, Mat4::from_translation(at));
    scene
}

/// The error on the last instance alone.
fn of_ball(scene: &Scene, radiance: &[f32], truth: &[f32], renderer: &Renderer, size: u32) -> f64 {
    let width = size as usize;
    let ball = scene.instances.len() as u32 - 1;
    let points = renderer.surface_points().expect("points");
    let is_ball = |index: usize| {
        points[index]
            .as_ref()
            .is_some_and(|point| point.instance == ball)
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for index in width + 1..width * (width - 1) - 1 {
        // Pixels at the silhouette see what is behind it, too.
        let around = [index - width - 1, index - 1, index + width - 1];
        if !around.into_iter().all(|left| (left..left + 3).all(is_ball)) {
            continue;
        }
        for channel in 3 * index..3 * index + 3 {
            let truth = f64::from(truth[channel]);
            let off = f64::from(radiance[channel]) - truth;
            sum += off * off / (truth * truth + 0.01);
            count += 1.0;
        }
    }
    assert!(count > 100.0, "the ball is not in the picture");
    sum / count
}

/// Matt, then two that are glossy, and the bounds of their errors.
fn materials() -> [(Material, &'static str, f64); 3] {
    let phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::ZERO,
            ks: Vec3::splat(0.7),
            shininess: 5.0,
        },
        ..Material::default()
    };
    let matt = Material::matt("matt", Vec3::splat(0.7));
    let rough = Material::metal("rough", Vec3::splat(0.8), 0.4);
    [
        (matt, "glossy=false", 0.01),
        (phong, "glossy=true", 0.03),
        (rough, "glossy=true", 0.03),
    ]
}

/// Lit by a reference point of its own.
fn own(glossy: &str) -> [&str; 5] {
    [
        "reference-points=objects",
        "objects=ball",
        "size=8",
        "resolution=64",
        glossy,
    ]
}

/// A ball in the box, lit by a reference point in its centre.
#[test]
fn an_object_is_lit_by_its_own_point() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::look_at("", vec3(0.0, 2.73, 4.0), vec3(0.9, 2.4, -1.6), 0.3);
    for (material, glossy, bound) in materials() {
        let mut scene = builtin("cornell", 1).expect("a scene");
        let mesh = scene.add_mesh(sphere(0.6, 48));
        let material = scene.add_material(material);
        let at = Mat4::from_translation(vec3(0.9, 2.4, -1.6));
        scene.add_instance("ball", mesh, material, at);
        let of = "final-gather";
        let mut renderer = renderer_of(&gpu, &scene, &TECHNIQUES, 40, of, &own(glossy));
        let found = measured(&gpu, &scene, &camera, &mut renderer, [8, 512]);
        let truth = &found.truth.radiance;
        let error = of_ball(&scene, &found.radiance, truth, &renderer, 40);
        println!("{glossy}: rel-mse {error:.1e} on the ball");
        assert!(error < bound, "{glossy}: {error}");
    }
}

/// With its own reference point, an object is lit as the path tracer lights it, wherever it is. One map in the middle
/// of the room, as if its surroundings were far away, is many times worse elsewhere.
#[test]
fn objects_are_lit_where_they_are() {
    let Some(gpu) = gpu() else { return };
    let places = [
        (vec3(0.0, 1.5, 0.0), false),
        (vec3(-1.3, 0.7, -1.3), true),
        (vec3(1.35, 1.0, -0.5), true),
    ];
    let size = 20;
    for (index, (material, glossy, bound)) in materials().into_iter().enumerate() {
        for (at, is_off_centre) in places {
            let scene = with_ball(material.clone(), at);
            let of = "final-gather";
            let mut renderer = renderer_of(&gpu, &scene, &TECHNIQUES, size, of, &own(glossy));
            let back = (vec3(0.3, 1.7, 1.7) - at).normalize();
            let camera = Camera::look_at("", at + 1.5 * back, at, 0.6);
            let found = measured(&gpu, &scene, &camera, &mut renderer, [8, 1024]);
            let truth = &found.truth.radiance;
            let localized = of_ball(&scene, &found.radiance, truth, &renderer, size);
            println!("{index} at {at}: {localized:.1e}");
            assert!(localized < bound, "{index} at {at}: {localized}");
            if !is_off_centre {
                continue;
            }
            for (name, value) in [
                ("reference-points", "grid"),
                ("density", "0.1"),
                ("localize", "false"),
                ("visibility", "none"),
            ] {
                renderer.set(of, name, value).expect("a setting");
            }
            renderer.restart();
            for _ in 0..8 {
                let sample = renderer.render_sample(&camera, 8, None, false);
                sample.expect("a picture");
            }
            let radiance = renderer.radiance().expect("radiance");
            let classical = of_ball(&scene, &radiance, truth, &renderer, size);
            println!("{index} at {at}: classical {classical:.1e}");
            assert!(
                classical > 5.0 * localized,
                "{index} at {at}: {classical}, {localized}"
            );
        }
    }
}

/// Directional albedo of the Phong lobe with ks = 1, by quadrature over cos^(n + 1) around the mirror direction.
fn phong_albedo(n: f32, n_dot_v: f32) -> f32 {
    const STEPS: usize = 200;
    let across = (1.0 - n_dot_v * n_dot_v).sqrt();
    let mut sum = 0.0;
    for i in 0..STEPS {
        let c = ((i as f32 + 0.5) / STEPS as f32).powf(1.0 / (n + 1.0));
        let s = (1.0 - c * c).sqrt();
        for j in 0..STEPS {
            let phi = (j as f32 + 0.5) / STEPS as f32 * std::f32::consts::TAU;
            sum += (c * n_dot_v + s * phi.cos() * across).max(0.0);
        }
    }
    (n + 2.0) / (n + 1.0) * sum / (STEPS * STEPS) as f32
}

/// In even surroundings, a surface scatters the albedo of its lobe, which falls toward grazing angles.
#[test]
fn a_phong_ball_in_a_furnace_has_its_albedo() {
    let Some(gpu) = gpu() else { return };
    for shininess in [2.0, 5.0, 60.0] {
        let mut scene = shining_room(1.0, Vec3::ZERO);
        let mesh = scene.add_mesh(sphere(0.4, 48));
        let material = scene.add_material(Material {
            model: MaterialModel::Phong {
                kd: Vec3::ZERO,
                ks: Vec3::splat(0.7),
                shininess,
            },
            ..Material::default()
        });
        let at = Mat4::from_translation(vec3(0.0, 0.75, 0.0));
        let ball = scene.add_instance("ball", mesh, material, at) as u32;
        let of = "final-gather";
        let mut renderer = renderer_of(&gpu, &scene, &[of], 16, of, &own("glossy=true"));
        let eye = vec3(0.2, 0.9, 1.4);
        let camera = Camera::look_at("", eye, vec3(0.0, 0.75, 0.0), 0.7);
        let found = picture(&mut renderer, &camera);
        let mut count = 0;
        for lit in found.lit().filter(|lit| lit.instance == ball) {
            let n_dot_v = lit.normal.dot((eye - lit.position).normalize());
            if n_dot_v < 0.05 {
                continue;
            }
            count += 1;
            let expected = 0.7 * phong_albedo(shininess, n_dot_v);
            let off = lit.radiance.x / expected - 1.0;
            assert!(
                off.abs() < 0.04,
                "{shininess}, {n_dot_v}: {off} more than {expected}"
            );
        }
        assert!(count > 50, "{count}");
    }
}

/// An object in the open: a floor that a lamp lights, and a wall whose front the lamp cannot reach. Light from the floor
/// alone reaches the wall.
fn corner() -> Scene {
    let floor = cuboid(vec3(0.0, -0.1, -0.8), vec3(1.2, 0.0, 0.8), 1);
    let wall = cuboid(vec3(-0.1, -0.1, -0.8), vec3(0.0, 1.0, 0.8), 1);
    let mut scene = Scene::default();
    let mesh = scene.add_mesh(join("corner", [floor, wall]));
    let material = scene.add_material(Material::matt("matt", vec3(0.8, 0.7, 0.6)));
    scene.add_instance("ball", mesh, material, Mat4::IDENTITY);
    let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(10.0));
    scene
        .lights
        .push(lamp.aimed(vec3(-0.5, 3.0, 0.0), Vec3::ZERO));
    scene
}

#[test]
fn lit_parts_of_an_object_light_its_other_parts() {
    let Some(gpu) = gpu() else { return };
    let scene = corner();
    let camera = Camera::look_at("", vec3(2.0, 0.9, 0.6), vec3(0.3, 0.3, 0.0), 0.7);
    let [with, without] = ["own-surface=true", "own-surface=false"].map(|setting| {
        let settings = [&own("glossy=false")[..], &[setting]].concat();
        let mut renderer = renderer_of(&gpu, &scene, &TECHNIQUES, 32, "final-gather", &settings);
        let found = measured(&gpu, &scene, &camera, &mut renderer, [8, 1024]);
        let truth = &found.truth.radiance;
        of_ball(&scene, &found.radiance, truth, &renderer, 32)
    });
    println!("rel-mse {with:.1e}, {without:.1e} without the object's own surface");
    assert!(with < 0.01 && without > 10.0 * with, "{with}, {without}");
}
