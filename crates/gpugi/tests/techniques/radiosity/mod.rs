//! radiosity compared with closed forms and the path tracer; walls that let nothing through; settings that cannot work.

mod gloss;
mod sunlight;

use crate::common::{
    floor, gpu, inside_out, lit_by, measured, place, rel_mse, renderer_of, shining_room,
};
use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::light_paths::{LightClass, LightPaths, overlap};
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Scene};

/// The picture after some frames, from fully refined maps.
fn picture(renderer: &mut Renderer, camera: &Camera, frames: u32) -> Vec<Vec3> {
    for _ in 0..frames {
        renderer.restart();
        let sample = renderer.render_sample(camera, 1, None, false);
        sample.expect("a picture");
    }
    let radiance = renderer.radiance().expect("radiance");
    radiance.chunks_exact(3).map(Vec3::from_slice).collect()
}

fn mean(picture: &[Vec3]) -> Vec3 {
    picture.iter().sum::<Vec3>() / picture.len() as f32
}

/// Radiosity of a closed room that emits and reflects the same everywhere: e / (1 - rho). Every bounce is rho times the
/// one before.
#[test]
fn a_closed_room_that_shines_everywhere_has_the_light_of_a_geometric_series() {
    let Some(gpu) = gpu() else { return };
    let albedo = vec3(0.8, 0.5, 0.2);
    let scene = shining_room(2.0, albedo);
    let camera = Camera::look_at("", vec3(0.8, 0.2, 1.2), vec3(-0.5, 0.7, -1.0), 1.2);
    let expected = 2.0 / (1.0 - albedo);
    let off = |settings: &[&str]| -> Vec<Vec3> {
        let settings = [&["burn-in=40"], settings].concat();
        let mut renderer = renderer_of(&gpu, &scene, &["radiosity"], 32, "radiosity", &settings);
        let picture = picture(&mut renderer, &camera, 4);
        picture
            .iter()
            .map(|pixel| *pixel / expected - 1.0)
            .collect()
    };
    // Rays find the same light in every direction.
    let still = ["resolution=48", "light-sampled-rays=0", "iterations=4"];
    for (pixel, off) in off(&still).iter().enumerate() {
        assert!(off.abs().max_element() < 0.01, "pixel {pixel}: {off} more");
    }
    // Light-sampled rays treat texels as points, which matters less as resolution grows. For red, an error in one
    // bounce becomes fourfold in the sum of all bounces.
    for (resolution, bound) in [
        ("resolution=24", 0.06),
        ("resolution=48", 0.01),
        ("resolution=96", 0.005),
    ] {
        let off = mean(&off(&[
            resolution,
            "light-sampled-rays=4",
            "iterations=256",
            "steps=128",
        ]));
        println!("{resolution}: {off} more");
        assert!(off.abs().max_element() < bound, "{resolution}: {off} more");
    }
}

/// Relative mean squared error against the path tracer, without the path tracer's own error, and the ratio of total
/// light.
fn against_the_path_tracer(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    renderer: &mut Renderer,
) -> (f64, f64) {
    // Refine the maps first, so that no sample shows an early state.
    picture(renderer, camera, 4);
    renderer.restart();
    let found = measured(gpu, scene, camera, renderer, [8, 256]);
    let sum = |of: &[f32]| of.iter().map(|&value| f64::from(value)).sum::<f64>();
    let ratio = sum(&found.radiance) / sum(&found.truth.radiance);
    (rel_mse(&found), ratio)
}

/// Alone, radiosity adds all of a lamp's light between diffuse surfaces; with shadow-map, only the indirect part.
#[test]
fn indirect_light_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    // Everything but the lamp: otherwise, how much of it the pixels at its edge see would be most of the error in the
    // picture's total light.
    let camera = &Camera::look_at("", vec3(0.0, 2.73, 8.0), vec3(0.0, 2.4, 0.0), 0.5);
    let both = ["shadow-map", "radiosity"];
    let rays = ["resolution=64", "rays=16", "iterations=16", "steps=4"];
    // For rays that find the lamp by chance.
    let many = ["resolution=64", "rays=32", "iterations=32", "steps=8"];
    let shooting = [
        "mode=shooting",
        "resolution=128",
        "hemicube-resolution=64",
        "iterations=128",
        "steps=32",
    ];
    for (techniques, settings, bound, missing) in [
        (&both[1..], &many[..], 0.003, 0.015),
        (&both, &rays, 1e-4, 0.004),
        // At 128 texels per side, texels are not small in the corners, and only a few of them shoot.
        (&both, &shooting, 0.002, 0.03),
    ] {
        let mut renderer = renderer_of(&gpu, &scene, techniques, 32, "radiosity", settings);
        let (error, ratio) = against_the_path_tracer(&gpu, &scene, camera, &mut renderer);
        println!("{techniques:?} {settings:?}: rel-mse {error:.1e}, {ratio:.4} of the light");
        assert!(error < bound, "{techniques:?} {settings:?}: {error}");
        assert!(
            (ratio - 1.0).abs() < missing,
            "{techniques:?} {settings:?}: {ratio}"
        );
    }
}

/// Two rooms, one behind the other, with a thin wall between them; a lamp in one.
#[test]
fn a_thin_wall_lets_no_light_through() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("rooms");
    let white = Vec3::splat(0.8);
    for (index, side) in [-1.0, 1.0].into_iter().enumerate() {
        let (near, far) = (side * 0.01, side * 2.0);
        let (low, high) = (f32::min(near, far), f32::max(near, far));
        let room = inside_out(cuboid(vec3(low, 0.0, -1.0), vec3(high, 2.0, 1.0), 1));
        place(
            &mut scene,
            room,
            Material::matt(["lit", "dark"][index], white),
        );
    }
    let light = Light::new("", LightKind::Point, Vec3::ONE);
    let lit = light.aimed(vec3(-1.0, 1.5, 0.0), Vec3::ZERO);
    scene.lights.push(lit);
    let settings = ["resolution=64", "iterations=16", "steps=4"];
    let techniques = ["shadow-map", "radiosity"];
    let mut renderer = renderer_of(&gpu, &scene, &techniques, 24, "radiosity", &settings);
    let looking_at = |side: f32| {
        let eye = vec3(side * 1.8, 1.0, 0.8);
        Camera::look_at("", eye, vec3(side * 0.1, 0.8, -0.5), 1.3)
    };
    let lit = mean(&picture(&mut renderer, &looking_at(-1.0), 4));
    let dark = mean(&picture(&mut renderer, &looking_at(1.0), 1));
    println!("lit {lit}, dark {dark}");
    assert!(lit.min_element() > 0.05);
    assert!(dark.max_element() < 1e-3 * lit.min_element(), "{dark}");
}

/// A sheet that hangs over a floor, seen from behind: its back has light of its own, and reflects it.
#[test]
fn backs_of_sheets_have_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(1.5);
    let sheet = quad(vec3(0.8, 0.05, 0.0), Vec3::NEG_X * 1.6, Vec3::Y, 1);
    let red = Material {
        double_sided: true,
        ..Material::matt("red", vec3(0.8, 0.1, 0.1))
    };
    place(&mut scene, sheet, red);
    let light = Light::new("", LightKind::Point, Vec3::splat(5.0));
    let scene = lit_by(scene, light.aimed(vec3(0.3, 1.4, 1.0), Vec3::ZERO));
    let camera = Camera::look_at("", vec3(0.2, 0.9, 2.4), vec3(0.0, 0.4, 0.0), 0.7);
    let techniques = ["shadow-map", "radiosity"];
    let settings = ["resolution=128", "rays=16", "iterations=16", "steps=4"];
    let mut renderer = renderer_of(&gpu, &scene, &techniques, 32, "radiosity", &settings);
    let (error, ratio) = against_the_path_tracer(&gpu, &scene, &camera, &mut renderer);
    println!("rel-mse {error:.1e}, {ratio:.4} of the light");
    assert!(error < 4e-3, "{error}");
    assert!((ratio - 1.0).abs() < 0.005, "{ratio} of the light");
}

#[test]
fn paths_are_what_others_leave_over() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let direct = LightPaths::new(LightClass::Area, "LDE");
    let alone = renderer_of(&gpu, &scene, &["radiosity"], 8, "radiosity", &[]);
    assert!(overlap(&alone.light_paths(), &[direct]).is_some());
    // Two techniques that add the same light would be rejected.
    let both = renderer_of(
        &gpu,
        &scene,
        &["shadow-map", "radiosity"],
        8,
        "radiosity",
        &[],
    );
    let paths = both.light_paths_of("radiosity");
    let indirect = LightPaths::new(LightClass::Area, "LDDDE");
    let direct = LightPaths::new(LightClass::Area, "LDE");
    assert!(overlap(paths, &[indirect]).is_some() && overlap(paths, &[direct]).is_none());
}

/// Changes of lights and moving objects.
#[test]
fn changes_of_the_scene_are_followed() {
    let Some(gpu) = gpu() else { return };
    let mut scene = builtin("cornell", 1).expect("a scene");
    let light = Light::new("", LightKind::Point, Vec3::splat(30.0));
    scene
        .lights
        .push(light.aimed(vec3(2.0, 3.0, -1.0), Vec3::ZERO));
    let camera = scene.cameras[0].clone();
    let settings = ["resolution=64", "rays=16", "iterations=8", "steps=8"];
    let techniques = ["shadow-map", "radiosity"];
    let mut kept = renderer_of(&gpu, &scene, &techniques, 24, "radiosity", &settings);
    let mut last = picture(&mut kept, &camera, 1);
    type Change = fn(&mut Scene);
    let changes: [(&str, Change); 4] = [
        // Texels stay, and the iteration continues from the previous solution.
        ("a light moved", |scene| {
            scene.lights[0].world_from_light.w_axis.x = -2.0;
        }),
        ("a wall is another", |scene| {
            let red = scene.instances[3].material;
            scene.materials[red] = Material::matt("blue", vec3(0.1, 0.1, 0.9));
        }),
        ("the light is another", |scene| {
            let lamp = scene.instances[5].material;
            scene.materials[lamp].emissive = vec3(2.0, 9.0, 2.0);
        }),
        ("a block moved", |scene| {
            scene.instances[7].world_from_mesh.w_axis.x += 1.0;
        }),
    ];
    for (what, change) in changes {
        change(&mut scene);
        kept.update(&scene).expect("an update");
        let found = picture(&mut kept, &camera, 1);
        let mut fresh = renderer_of(&gpu, &scene, &techniques, 24, "radiosity", &settings);
        let fresh = picture(&mut fresh, &camera, 1);
        let error = |a: &[Vec3], b: &[Vec3]| {
            let squares = a.iter().zip(b).map(|(a, b)| (*a - *b).length_squared());
            squares.sum::<f32>() / b.iter().map(|b| b.length_squared()).sum::<f32>()
        };
        let (off, moved) = (error(&found, &fresh), error(&last, &fresh));
        println!("{what}: off {off:.1e}, from before {moved:.1e}");
        assert!(off < 2e-3 && moved > 5.0 * off, "{what}: {off}, {moved}");
        last = found;
    }
}

/// Rays that are aimed at texels take light from only one of two surfaces in the same place.
#[test]
fn surfaces_in_the_same_place_light_once() {
    let Some(gpu) = gpu() else { return };
    let albedo = vec3(0.8, 0.5, 0.2);
    let mut scene = shining_room(2.0, albedo);
    scene.instances.extend(scene.instances.clone());
    let camera = Camera::look_at("", vec3(0.8, 0.2, 1.2), vec3(-0.5, 0.7, -1.0), 1.2);
    let settings = [
        "burn-in=40",
        "resolution=64",
        "light-sampled-rays=4",
        "iterations=128",
        "steps=128",
    ];
    let mut renderer = renderer_of(&gpu, &scene, &["radiosity"], 16, "radiosity", &settings);
    let off = mean(&picture(&mut renderer, &camera, 2)) * (1.0 - albedo) / 2.0 - 1.0;
    println!("{off} more");
    // Of red, an error in one bounce becomes fourfold: light twice from a fifth of the rays would double it.
    assert!(off.abs().max_element() < 0.03, "{off} more");
}

/// Texels of a scene that shrinks to a thousandth, as objects do that appear or vanish.
#[test]
fn texels_follow_a_scene_that_shrinks() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let settings = ["resolution=96", "iterations=16", "steps=16"];
    let mut renderer = renderer_of(&gpu, &scene, &["radiosity"], 16, "radiosity", &settings);
    let camera = scene.cameras[0].clone();
    let before = mean(&picture(&mut renderer, &camera, 2));
    let mut small = scene.clone();
    let scale = 1e-3;
    for instance in &mut small.instances {
        instance.world_from_mesh = Mat4::from_scale(Vec3::splat(scale)) * instance.world_from_mesh;
    }
    let mut near = camera;
    near.world_from_view.w_axis *= Vec3::splat(scale).extend(1.0);
    renderer.update(&small).expect("an update");
    let after = mean(&picture(&mut renderer, &near, 2));
    println!("{before}, {after}");
    assert!(
        (after / before - 1.0).abs().max_element() < 0.03,
        "{before}, {after}"
    );
}

/// Indirect light in a mirror, with maps of one layer and of two.
#[test]
fn mirrors_show_indirect_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = builtin("cornell", 1).expect("a scene");
    let camera = scene.cameras[0].clone();
    let mesh = scene.add_mesh(sphere(0.9, 32));
    let mirror = scene.add_material(Material::metal("mirror", Vec3::ONE, 0.0));
    let at = Mat4::from_translation(vec3(0.3, 4.0, -2.5));
    scene.add_instance("ball", mesh, mirror, at);
    // The lower half of the ball shows the floor and the blocks, which have the walls behind them.
    let of_ball = |techniques: &[&str], layers: &str| {
        let settings = ["resolution=64", "iterations=4"];
        let settings = if techniques.contains(&"radiosity") {
            &settings[..]
        } else {
            &[]
        };
        let mut renderer = renderer_of(&gpu, &scene, techniques, 32, "radiosity", settings);
        for (name, value) in [("layers", layers), ("resolution", "64")] {
            let set = renderer.set("distance-impostor", name, value);
            set.expect("a setting");
        }
        let picture = picture(&mut renderer, &camera, 2);
        let ball: Vec<Vec3> = (11..14)
            .flat_map(|y| picture[y * 32 + 15..y * 32 + 20].to_vec())
            .collect();
        mean(&ball)
    };
    let all = ["shadow-map", "radiosity", "distance-impostor"];
    let [one, two] = ["1", "2"].map(|layers| of_ball(&all, layers));
    let without = of_ball(&["shadow-map", "distance-impostor"], "1");
    println!("one layer {one}, two {two}, without {without}");
    assert!((one / without).min_element() > 1.5 && (two / one - 1.0).abs().max_element() < 0.03);
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let Some(gpu) = gpu() else { return };
    let scene = shining_room(1.0, Vec3::splat(0.5));
    let mut renderer = renderer_of(&gpu, &scene, &["radiosity"], 8, "radiosity", &[]);
    for (name, value) in [
        ("resolution", "8"),
        ("resolution", "10000"),
        ("mode", "gathering"),
        ("shooters", "0"),
        ("hemicube-resolution", "8"),
        ("density", "-1"),
        ("rays", "0"),
        ("steps", "0"),
        ("iterations", "0"),
        ("burn-in", "300"),
        ("bounces", "1"),
    ] {
        assert!(
            renderer.set("radiosity", name, value).is_err(),
            "{name}={value}"
        );
    }
    // More texels than fit a buffer.
    renderer
        .set("radiosity", "density", "1e5")
        .expect("a setting");
    let camera = Camera::look_at("", vec3(0.8, 0.2, 1.2), Vec3::Y, 1.2);
    let refused = renderer.render_sample(&camera, 1, None, false);
    assert!(matches!(refused, Err(LightingError::Gpu(_))), "{refused:?}");
}
