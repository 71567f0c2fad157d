//! ray-tracing compared with the path tracer on the same light paths, and with distance-impostor.

use std::sync::Arc;

use crate::common::{gpu, measured, rel_mse, renderer_of};
use crate::distance_impostor::scenes::{
    SIZE, add, glass, mirror, room, shining_room, toward, with_ball,
};
use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi::light_paths::LightClass;
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{sphere, torus};
use gpugi_scene::{Camera, Environment, Image, Material, Pixels, Scene, Volume};

/// Away from the room's centre.
const ASIDE: Vec3 = vec3(0.9, -0.4, -0.6);

/// A picture of `samples` samples per pixel.
fn picture(renderer: &mut Renderer, camera: &Camera, samples: u32) -> Vec<f32> {
    renderer.restart();
    for _ in 0..samples {
        let sample = renderer.render_sample(camera, samples, None, false);
        sample.expect("a picture");
    }
    renderer.radiance().expect("radiance")
}

/// The error of `techniques` with settings of ray-tracing.
fn error(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    techniques: &[&str],
    settings: &[&str],
    [samples, reference]: [u32; 2],
) -> f64 {
    let mut renderer = renderer_of(gpu, scene, techniques, SIZE, "ray-tracing", settings);
    rel_mse(&measured(
        gpu,
        scene,
        camera,
        &mut renderer,
        [samples, reference],
    ))
}

/// Coloured glass with a ball of denser glass inside, and a mirror around both.
#[test]
fn nested_glass_and_a_mirror_are_exact() {
    let Some(gpu) = gpu() else { return };
    let mut green = glass(1.33);
    green.volume = Some(Volume {
        attenuation_distance: 0.4,
        attenuation_color: vec3(0.2, 0.8, 0.3),
    });
    let mut scene = with_ball(shining_room(), green, ASIDE);
    add(&mut scene, "core", sphere(0.25, 48), glass(1.6), ASIDE);
    add(&mut scene, "ring", torus(0.7, 0.1, 32), mirror(), ASIDE);
    let camera = toward(ASIDE);
    for (settings, samples) in [
        (["bounces=8", "split=0"], 256),
        (["bounces=8", "split=3"], 64),
    ] {
        let found = error(
            &gpu,
            &scene,
            &camera,
            &["ray-tracing"],
            &settings,
            [samples, 1024],
        );
        println!("nested glass, {settings:?}: rel-mse {found:.1e}");
        assert!(found < 0.002, "{settings:?}: {found}");
    }
    // As many bounces as are declared.
    let found = error(
        &gpu,
        &scene,
        &camera,
        &["ray-tracing"],
        &["bounces=2"],
        [128, 1024],
    );
    println!("nested glass, two bounces: rel-mse {found:.1e}");
    assert!(found < 0.002, "two bounces: {found}");
}

/// What rays hit is lit, with shadows, by the techniques before.
#[test]
fn mirrors_and_rough_metal_show_lit_surroundings() {
    let Some(gpu) = gpu() else { return };
    let rough = Material {
        roughness: 0.3,
        ..mirror()
    };
    for (name, material, samples) in [("mirror", mirror(), 64), ("rough metal", rough, 256)] {
        let mut scene = with_ball(room(), material, ASIDE);
        let post = sphere(0.2, 24);
        let grey = Material::matt("grey", Vec3::splat(0.5));
        add(&mut scene, "post", post, grey, vec3(0.1, -0.4, 0.2));
        let (camera, techniques) = (toward(ASIDE), ["shadow-map", "ray-tracing"]);
        let settings = ["objects=ball"];
        let found = error(
            &gpu,
            &scene,
            &camera,
            &techniques,
            &settings,
            [samples, 1024],
        );
        println!("{name}: rel-mse {found:.1e}");
        assert!(found < 0.002, "{name}: {found}");
    }
}

/// The gold and the glass of `ornaments`, which show each other.
#[test]
fn ornaments_are_exact() {
    let Some(gpu) = gpu() else { return };
    let mut scene = builtin("ornaments", 1).expect("a built-in scene");
    scene.instances.truncate(4);
    let camera = Camera::look_at("", vec3(-1.6, 0.4, 4.5), vec3(-1.65, 0.0, 0.0), 0.7);
    // The sun is small: few samples find it in the curved glass.
    let settings = ["bounces=8", "split=2"];
    let found = error(
        &gpu,
        &scene,
        &camera,
        &["ray-tracing"],
        &settings,
        [512, 4096],
    );
    println!("gold and glass: rel-mse {found:.1e}");
    assert!(found < 0.002, "{found}");
}

/// Mirrors and glass that absorb nothing are invisible where the same light comes from everywhere.
#[test]
fn a_white_furnace_stays_white() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("furnace");
    let white = Material::metal("mirror", Vec3::ONE, 0.0);
    for (at, material) in [(-0.4, white), (0.4, glass(1.5))] {
        add(&mut scene, "ball", sphere(0.35, 64), material, Vec3::X * at);
    }
    scene.environment = Some(Environment {
        image: Arc::new(Image {
            name: "white".into(),
            width: 2,
            height: 1,
            pixels: Pixels::Rgba32Float(vec![1.0; 8]),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    let camera = Camera::look_at("", Vec3::Z * 2.0, Vec3::ZERO, 0.8);
    for settings in [["bounces=16", "split=0"], ["bounces=16", "split=2"]] {
        let mut renderer = renderer_of(
            &gpu,
            &scene,
            &["ray-tracing"],
            SIZE,
            "ray-tracing",
            &settings,
        );
        let found = picture(&mut renderer, &camera, 16);
        let mean = found.iter().sum::<f32>() / found.len() as f32;
        let most = found.iter().copied().fold(0.0, f32::max);
        // A ray that the interpolated normal sends below the surface ends there.
        println!("{settings:?}: mean {mean}, most {most}");
        assert!(mean > 0.998 && most < 1.001, "{settings:?}: {mean}, {most}");
    }
}

/// A lamp and a lit floor in front of the sky are black.
#[test]
fn rays_can_see_the_environment_alone() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("sky");
    add(&mut scene, "ball", sphere(0.5, 48), glass(1.5), Vec3::ZERO);
    add(
        &mut scene,
        "ring",
        torus(0.8, 0.1, 32),
        mirror(),
        Vec3::ZERO,
    );
    let lamp = Material::emitter("lamp", Vec3::splat(100.0));
    add(
        &mut scene,
        "lamp",
        sphere(0.2, 24),
        lamp,
        vec3(-0.9, 0.7, -0.8),
    );
    let grey = Material::matt("grey", Vec3::splat(0.5));
    add(
        &mut scene,
        "grey",
        sphere(0.3, 24),
        grey,
        vec3(0.9, 0.5, -0.9),
    );
    // Without a sun, which few samples of the reference find.
    let texels =
        (0..32_u8).flat_map(|texel| [f32::from(texel % 5), f32::from(texel % 3), 1.0, 1.0]);
    scene.environment = Some(Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width: 8,
            height: 4,
            pixels: Pixels::Rgba32Float(texels.collect()),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    let camera = Camera::look_at("", vec3(0.0, 0.4, 2.2), Vec3::ZERO, 0.9);
    let techniques = ["ray-tracing"];
    let settings = ["environment=only", "split=2"];
    let found = error(&gpu, &scene, &camera, &techniques, &settings, [64, 512]);
    println!("the sky alone: rel-mse {found:.1e}");
    assert!(found < 0.002, "{found}");
    // The reference has no lamp either.
    let mut renderer = renderer_of(&gpu, &scene, &techniques, SIZE, "ray-tracing", &settings);
    let paths = renderer.light_paths();
    assert!(
        paths
            .iter()
            .all(|path| path.class == LightClass::Environment)
    );
    let alone = picture(&mut renderer, &camera, 8);
    renderer
        .set("ray-tracing", "environment", "behind")
        .expect("a setting");
    assert!(
        renderer
            .light_paths()
            .iter()
            .any(|path| path.class == LightClass::Area)
    );
    let with_lamp = picture(&mut renderer, &camera, 8);
    let [alone, with_lamp] = [alone, with_lamp].map(|radiance| radiance.iter().sum::<f32>());
    assert!(with_lamp > 1.01 * alone, "{alone}, {with_lamp}");
}

/// distance-impostor leaves alone what ray-tracing claims, and serves the rest.
#[test]
fn objects_are_handed_over() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room();
    for (name, at) in [("left", -0.6), ("right", 0.6)] {
        add(&mut scene, name, sphere(0.4, 32), mirror(), Vec3::X * at);
    }
    let camera = Camera::look_at("", Vec3::Z * 1.8, Vec3::ZERO, 1.2);
    let [rays, both] = [
        &["shadow-map", "ray-tracing"][..],
        &["shadow-map", "ray-tracing", "distance-impostor"],
    ]
    .map(|techniques| {
        let mut renderer = renderer_of(&gpu, &scene, techniques, SIZE, "ray-tracing", &[]);
        picture(&mut renderer, &camera, 1)
    });
    assert_eq!(rays, both);
    let techniques = ["shadow-map", "ray-tracing", "distance-impostor"];
    let settings = ["objects=left"];
    let mut shared = renderer_of(&gpu, &scene, &techniques, SIZE, "ray-tracing", &settings);
    let found = picture(&mut shared, &camera, 1);
    let cubes = shared.maps().into_iter().map(|map| map.name);
    let cubes: Vec<String> = cubes.filter(|name| name.ends_with("radiance")).collect();
    assert_eq!(cubes, ["distance-impostor.13.radiance"]);
    // Both mirrors are lit.
    let points = shared.surface_points().expect("points");
    for instance in [12, 13] {
        let of_ball = points.iter().zip(found.chunks_exact(3));
        let of_ball = of_ball.filter(|(point, _)| {
            point
                .as_ref()
                .is_some_and(|point| point.instance == instance)
        });
        let lit: Vec<bool> = of_ball.map(|(_, color)| color[0] > 0.0).collect();
        let share = lit.iter().filter(|is_lit| **is_lit).count() as f32 / lit.len() as f32;
        assert!(share > 0.6, "instance {instance}: {share} of {}", lit.len());
    }
}

#[test]
fn odd_scenes_and_settings_are_handled() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::look_at("", Vec3::Z, Vec3::ZERO, 1.0);
    let mut nothing = Scene::new("nothing");
    let mut flat = with_ball(room(), mirror(), Vec3::ZERO);
    flat.instances[12].world_from_mesh = Mat4::from_scale(vec3(1.0, 0.0, 1.0));
    let names = ["ray-tracing".to_owned()];
    for scene in [&mut nothing, &mut flat] {
        let mut renderer = Renderer::new(&gpu, scene, [8, 8], &names).expect("a renderer");
        let found = picture(&mut renderer, &camera, 2);
        assert!(found.iter().all(|value| value.is_finite()));
    }
    let mut renderer = Renderer::new(&gpu, &flat, [8, 8], &names).expect("a renderer");
    for (name, value) in [("bounces", "0"), ("bounces", "17"), ("objects", "nobody")] {
        let refused = renderer.set("ray-tracing", name, value).unwrap_err();
        assert!(refused.to_string().contains(value), "{refused}");
    }
}

/// The scene with a ball, which is a sphere or the triangles of one.
fn with_round_ball(mut scene: Scene, material: &Material, segments: u32, is_sphere: bool) -> Scene {
    let mesh = sphere(0.5, segments);
    let ball = add(&mut scene, "ball", mesh, material.clone(), ASIDE);
    scene.instances[ball].is_sphere = is_sphere;
    scene
}

/// A ball of few triangles that is a sphere looks like one of very many, reflected, refracted and by itself, in the path
/// tracer and in ray-tracing.
#[test]
fn spheres_are_balls_of_endless_triangles() {
    let Some(gpu) = gpu() else { return };
    let ball = |material: &Material, segments: u32, is_sphere: bool| {
        let mut scene = with_round_ball(shining_room(), material, segments, is_sphere);
        // A mirror beside it shows its outline.
        let beside = ASIDE + vec3(-0.8, 0.0, 0.3);
        add(&mut scene, "beside", sphere(0.25, 48), mirror(), beside);
        scene
    };
    let camera = toward(ASIDE);
    let settings = ["bounces=4", "split=2"];
    for material in [mirror(), glass(1.5)] {
        let techniques = ["ray-tracing"];
        let sphere = ball(&material, 16, true);
        let mut renderer = renderer_of(&gpu, &sphere, &techniques, SIZE, "ray-tracing", &settings);
        let found = measured(&gpu, &sphere, &camera, &mut renderer, [64, 512]);
        // What cameras see directly has the outline of the mesh.
        let error = rel_mse(&found);
        let truth = &found.truth.radiance;
        let apart = |segments, is_sphere| {
            let scene = ball(&material, segments, is_sphere);
            let mut renderer =
                renderer_of(&gpu, &scene, &techniques, SIZE, "ray-tracing", &settings);
            let other = measured(&gpu, &scene, &camera, &mut renderer, [1, 128]);
            crate::distance_impostor::scenes::rel_mse(&other.truth.radiance, truth)
        };
        let [many, few] = [apart(128, false), apart(16, false)];
        println!(
            "{}: ray-tracing {error:.1e}; 128 segments {many:.1e}, 16 segments {few:.1e}",
            material.name
        );
        assert!(error < 0.004, "{}: {error}", material.name);
        assert!(many < 0.25 * few, "{}: {many} {few}", material.name);
    }
}

/// Rasterized maps, texels and rays from them light a sphere as they light a ball of many triangles.
#[test]
fn other_techniques_light_spheres() {
    let Some(gpu) = gpu() else { return };
    let scene = |material: &Material, segments: u32, is_sphere: bool| {
        with_round_ball(room(), material, segments, is_sphere)
    };
    let grey = Material::matt("grey", Vec3::splat(0.7));
    let camera = toward(ASIDE);
    for (material, technique, settings) in [
        (&grey, "radiosity", &["resolution=64", "iterations=32"][..]),
        (&mirror(), "distance-impostor", &["resolution=64"]),
        (
            &glass(1.5),
            "caustics",
            &[
                "frames=4",
                "resolution=64",
                "cube-resolution=64",
                "shape-resolution=64",
            ],
        ),
    ] {
        let techniques = ["shadow-map", technique];
        let shown = |segments, is_sphere| {
            let scene = scene(material, segments, is_sphere);
            let mut renderer = renderer_of(&gpu, &scene, &techniques, SIZE, technique, settings);
            let go_on = |_, _| std::ops::ControlFlow::Continue(());
            renderer.converge(&camera, false, go_on).expect("maps");
            picture(&mut renderer, &camera, 4)
        };
        let apart = crate::distance_impostor::scenes::rel_mse(&shown(32, true), &shown(64, false));
        println!("{techniques:?}: rel-mse {apart:.1e}");
        assert!(apart < 0.01, "{techniques:?}: {apart}");
    }
}
