//! Input that cannot work: clear messages or black, and no value that is not finite.

use glam::{Mat4, Vec3, vec3};
use gpugi::capture::Output;
use gpugi::scene::{Claims, GpuScene};
use gpugi::techniques::Technique;
use gpugi::techniques::final_gather::FinalGather;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Camera, Light, LightKind, Material, Mesh, Scene};

use super::{at_probes, facing};
use crate::common::{gpu, inside_out, place, shining_room};

const NAMES: [&str; 2] = ["shadow-map", "final-gather"];

#[test]
fn settings_that_cannot_work_are_refused() {
    let Some(gpu) = gpu() else { return };
    let scene = shining_room(1.0, Vec3::splat(0.5));
    let names = ["final-gather".to_owned()];
    let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).expect("a renderer");
    for (name, value) in [
        ("size", "1"),
        ("size", "3"),
        ("size", "32"),
        ("resolution", "8"),
        ("resolution", "100"),
        ("density", "-1"),
        ("solid-angle", "cone"),
        ("visibility", "rays"),
        ("reference-points", "everywhere"),
        ("bounces", "-1"),
        ("faces-per-frame", "0"),
    ] {
        let set = renderer.set("final-gather", name, value);
        assert!(set.is_err(), "{name}={value}");
    }
    // An object that the scene does not have.
    let set = renderer.set("final-gather", "reference-points", "objects");
    set.expect("a setting");
    assert!(renderer.set("final-gather", "objects", "bunny").is_err());
    // More points than anybody can light.
    let set = renderer.set("final-gather", "reference-points", "grid");
    set.expect("a setting");
    let set = renderer.set("final-gather", "density", "1e5");
    set.expect("a setting");
    let camera = Camera::look_at("", vec3(0.8, 0.2, 1.2), Vec3::Y, 1.2);
    let refused = renderer.render_sample(&camera, 1, None, false);
    assert!(matches!(refused, Err(LightingError::Gpu(_))), "{refused:?}");
}

/// Scenes that have nothing to light, or nothing that lights.
#[test]
fn odd_scenes_are_black() {
    let Some(gpu) = gpu() else { return };
    let empty = Scene::new("empty");
    let mut flat = Scene::new("flat");
    place(
        &mut flat,
        quad(Vec3::ZERO, Vec3::Z, Vec3::X, 1),
        Material::matt("flat", Vec3::ONE),
    );
    let mut speck = Scene::new("speck");
    let mesh = speck.add_mesh(Mesh::default());
    let grey = speck.add_material(Material::matt("grey", Vec3::splat(0.5)));
    speck.add_instance("speck", mesh, grey, Mat4::IDENTITY);
    let probes = [
        facing(vec3(0.2, 0.5, 0.3), Vec3::Y),
        facing(Vec3::ZERO, Vec3::X),
    ];
    for scene in [empty, flat, speck] {
        for places in ["grid", "camera", "objects"] {
            let places = format!("reference-points={places}");
            let found = at_probes(&gpu, &scene, &NAMES, &[&places], &probes, Output::Fluence);
            assert!(
                found.iter().all(|fluence| *fluence == Vec3::ZERO),
                "{}: {found:?}",
                scene.name
            );
        }
    }
}

/// Reference points inside a solid see its inside only: where none can be moved out, others take their place.
#[test]
fn points_inside_solids_are_switched_off() {
    let Some(gpu) = gpu() else { return };
    let room = |with_block: bool| {
        let mut scene = shining_room(0.0, Vec3::splat(0.7));
        let light = Light::new("", LightKind::Point, Vec3::ONE);
        let lamp = light.aimed(vec3(0.7, 1.3, 0.0), Vec3::ZERO);
        scene.lights.push(lamp);
        if with_block {
            // Around the points of the lowest layer on one side.
            let block = cuboid(vec3(-0.95, 0.01, -1.45), vec3(-0.05, 0.7, 1.45), 1);
            place(&mut scene, block, Material::matt("block", Vec3::splat(0.7)));
        }
        scene
    };
    let probes = [
        facing(vec3(0.1, 0.05, 0.0), Vec3::Y),
        facing(vec3(0.3, 0.2, 0.8), Vec3::Y),
    ];
    let settings = [
        "density=2",
        "resolution=32",
        "visibility=none",
        "solid-angle=disc",
    ];
    let of = |scene: &Scene| {
        let all = at_probes(&gpu, scene, &NAMES, &settings, &probes, Output::Irradiance);
        let direct = at_probes(&gpu, scene, &NAMES[..1], &[], &probes, Output::Irradiance);
        [all[0].x - direct[0].x, all[1].x - direct[1].x]
    };
    let (with, without) = (of(&room(true)), of(&room(false)));
    println!("{with:.3?}, without the block {without:.3?}");
    for (with, without) in with.into_iter().zip(without) {
        assert!(
            (0.8..1.25).contains(&(with / without)),
            "{with} beside {without}"
        );
    }
}

/// A column fills a room but for a corridor, narrower than the grid: all points lie in the column. Those next to the
/// corridor are moved into it.
#[test]
fn points_inside_solids_are_moved_out() {
    let Some(gpu) = gpu() else { return };
    let grey = || Material::matt("grey", Vec3::splat(0.6));
    let lit = |mut scene: Scene| {
        let light = Light::new("", LightKind::Point, Vec3::ONE);
        let lamp = light.aimed(vec3(1.8, 1.7, 0.3), Vec3::ZERO);
        scene.lights.push(lamp);
        scene
    };
    let corridor = |low: f32| {
        let mut scene = Scene::new("corridor");
        let room = inside_out(cuboid(vec3(low, 0.0, -1.0), vec3(2.0, 2.0, 1.0), 1));
        place(&mut scene, room, grey());
        scene
    };
    let mut filled = corridor(-1.0);
    let column = cuboid(vec3(-0.99, 0.01, -0.99), vec3(1.6, 1.99, 0.99), 1);
    place(&mut filled, column, grey());
    let probes = [
        facing(vec3(1.7, 0.02, -0.7), Vec3::Y),
        facing(vec3(1.9, 0.02, 0.1), Vec3::Y),
        facing(vec3(1.98, 1.2, 0.6), Vec3::NEG_X),
        facing(vec3(1.62, 0.4, -0.2), Vec3::X),
    ];
    let of = |scene: Scene, density: &str, more: &[&str]| {
        let settings = [&[density, "resolution=32"], more].concat();
        let scene = lit(scene);
        let all = at_probes(&gpu, &scene, &NAMES, &settings, &probes, Output::Irradiance);
        let direct = at_probes(&gpu, &scene, &NAMES[..1], &[], &probes, Output::Irradiance);
        let indirect = all.iter().zip(direct).map(|(all, direct)| all.x - direct.x);
        indirect.collect::<Vec<f32>>()
    };
    let expected = of(corridor(1.6), "density=1", &[]);
    // Where some faces of a point are captured per frame, too.
    for more in [&[][..], &["faces-per-frame=4"]] {
        let found = of(filled.clone(), "density=1", more);
        println!("{found:.4?}, expected {expected:.4?}");
        for (found, expected) in found.iter().zip(&expected) {
            let ratio = found / expected;
            assert!(
                (0.8..1.25).contains(&ratio),
                "{found} instead of {expected}"
            );
        }
    }
}

/// A reference point in a wall, and an object without surroundings.
#[test]
fn a_camera_in_a_wall_and_an_object_alone_are_no_trouble() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("block");
    let block = cuboid(vec3(-1.0, -1.0, -1.0), vec3(1.0, 2.0, 1.0), 1);
    place(&mut scene, block, Material::matt("block", Vec3::splat(0.7)));
    let probes = [facing(vec3(1.5, 0.0, 0.0), Vec3::NEG_X)];
    // The camera of at_probes stands inside the block.
    for places in ["camera", "objects"] {
        let places = format!("reference-points={places}");
        let found = at_probes(
            &gpu,
            &scene,
            &NAMES,
            &[&places],
            &probes,
            Output::Irradiance,
        );
        assert_eq!(found[0], Vec3::ZERO, "{places}");
    }
}

/// More objects than can have reference points: the largest have them, and a warning says so. Names are a promise.
#[test]
fn many_objects_are_no_trouble() {
    let Some(gpu) = gpu() else { return };
    let mut scene = shining_room(1.0, Vec3::splat(0.5));
    let mesh = scene.add_mesh(cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1));
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    for index in 0..39 {
        // Of different sizes, and turned.
        let size = Mat4::from_scale(Vec3::splat(0.01 + 0.002 * (index * 7 % 39) as f32));
        let turned = Mat4::from_rotation_y(index as f32);
        let at = vec3(
            0.2 * (index % 8) as f32 - 0.7,
            0.75,
            0.2 * (index / 8) as f32,
        );
        let world_from_mesh = Mat4::from_translation(at) * turned * size;
        scene.add_instance(&format!("block {index}"), mesh, grey, world_from_mesh);
    }
    let on_gpu = GpuScene::new(&gpu, &scene).expect("an upload");
    let mut technique = FinalGather::default();
    let set = technique.settings_mut().set("reference-points", "objects");
    set.expect("a setting");
    let plan = technique.plan(&on_gpu, &[], &[]);
    let claimed: Vec<usize> = (0..40)
        .filter(|&index| plan.claims[index] == Claims::INDIRECT)
        .collect();
    let largest: Vec<usize> = (0..40)
        .filter(|&index| index == 0 || (index - 1) * 7 % 39 >= 8)
        .collect();
    assert_eq!(claimed, largest);

    let names = NAMES.map(str::to_owned);
    let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).expect("a renderer");
    for (name, value) in [("reference-points", "objects"), ("resolution", "16")] {
        let set = renderer.set("final-gather", name, value);
        set.expect("a setting");
    }
    let camera = Camera::look_at("", vec3(0.0, 0.75, -1.4), vec3(0.0, 0.75, 0.0), 1.2);
    let rendered = renderer.render_sample(&camera, 1, None, false);
    rendered.expect("a picture");
    let warnings = renderer.warnings();
    assert!(
        warnings
            .iter()
            .any(|warning| warning.contains("32 largest of 40")),
        "{warnings:?}"
    );

    let set = renderer.set("final-gather", "objects", "block*");
    set.expect("a setting");
    let refused = renderer.render_sample(&camera, 1, None, false);
    let message = refused.expect_err("too many objects").to_string();
    assert!(message.contains("name fewer"), "{message}");
}
