//! What rough surfaces reflect of lit surroundings, and objects that share a cube.

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::light_paths::{LightClass, LightPaths, overlap};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{
    Camera, Image, Material, MaterialModel, Mesh, Origin, Pixels, Scene, Texture, TextureRef, Wrap,
};

use super::scenes::{
    add, errors, glass, mirror, rel_mse, renderer, renderer_of, room, set, shining_room, toward,
    with_ball,
};
use crate::common::{gpu, measured, picture};

/// As default sets of still pictures choose.
const STILL: [(&str, &str); 2] = [("objects", "*"), ("lobes", "drawn")];

fn metal(roughness: f32) -> Material {
    Material::metal("metal", Vec3::splat(0.95), roughness)
}

#[test]
fn rough_metal_balls_reflect_the_room() {
    let Some(gpu) = gpu() else { return };
    for roughness in [0.1, 0.3, 0.6] {
        let mut scene = builtin("room", 1).expect("a room");
        let ball = scene
            .instances
            .iter()
            .position(|instance| instance.name == "sphere");
        let ball = ball.expect("a ball");
        let material = scene.instances[ball].material;
        scene.materials[material] = metal(roughness);
        let at = scene.instances[ball].world_from_mesh.w_axis.truncate();
        let camera = Camera::look_at("", at + vec3(0.9, 0.5, 1.5), at, 0.75);
        let mut renderer = renderer(&gpu, &scene, &STILL);
        let found = measured(&gpu, &scene, &camera, &mut renderer, [16, 512]);
        let truth = &found.truth.radiance;
        let drawn = rel_mse(&found.radiance, truth);
        let [filtered, without] = [("lobes", "filtered"), ("objects", "auto")].map(|setting| {
            set(&mut renderer, setting);
            rel_mse(&picture(&mut renderer, &camera).radiance, truth)
        });
        println!(
            "roughness {roughness}: rel-mse {drawn:.1e}, filtered {filtered:.1e}, without {without:.1e}"
        );
        assert!(drawn < 0.01, "roughness {roughness}: {drawn}");
        assert!(filtered < 0.05, "roughness {roughness}: {filtered}");
        assert!(without > 20.0 * drawn, "roughness {roughness}: {without}");
    }
}

/// A block stands on the floor's centre.
#[test]
fn a_glossy_floor_reflects_what_stands_on_it() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room();
    let varnish = Material {
        roughness: 0.15,
        base_color: vec3(0.05, 0.04, 0.03).extend(1.0),
        ..Material::default()
    };
    let floor = quad(vec3(-1.9, 0.0, 1.9), 3.8 * Vec3::X, 3.8 * Vec3::NEG_Z, 1);
    add(&mut scene, "floor", floor, varnish, vec3(0.0, -1.35, 0.0));
    let block = cuboid(vec3(-0.4, 0.0, -0.4), vec3(0.4, 1.2, 0.4), 1);
    let white = Material::matt("white", Vec3::splat(0.8));
    add(&mut scene, "block", block, white, vec3(0.0, -1.35, 0.0));
    let camera = Camera::look_at("", vec3(0.5, -0.8, 1.9), vec3(0.0, -1.1, 0.2), 0.8);
    let [with, without] = errors(&gpu, &scene, &camera, &STILL);
    println!("floor: rel-mse {with:.1e}, without {without:.1e}");
    assert!(with < 1e-3, "{with}");
    assert!(without > 4.0 * with, "{without}");
    // The cube follows the eye.
    let other = Camera::look_at("", vec3(-1.5, -0.9, -0.9), vec3(0.0, -1.1, 0.2), 0.8);
    let all = [("objects", "*")];
    let mut kept = renderer(&gpu, &scene, &all);
    let [before, after] = [&camera, &other].map(|camera| picture(&mut kept, camera).radiance);
    let fresh = picture(&mut renderer(&gpu, &scene, &all), &other).radiance;
    let [far, near] = [before, fresh].map(|radiance| rel_mse(&after, &radiance));
    assert!(near < 1e-9 && far > 0.01, "{near}, {far}");
}

/// The two halves of a mesh as two instances of one node.
fn in_parts(scene: &mut Scene, whole: &Mesh, materials: [Material; 2], at: Vec3) {
    let middle = whole.indices.len() / 6 * 3;
    let halves = [&whole.indices[..middle], &whole.indices[middle..]];
    for (primitive, (indices, material)) in halves.iter().zip(materials).enumerate() {
        let part = Mesh {
            indices: indices.to_vec(),
            ..whole.clone()
        };
        let index = add(scene, "part", part, material, at);
        scene.instances[index].origin = Some(Origin {
            node: 0,
            place: None,
            primitive,
        });
    }
}

/// A file has one instance per material of a node.
#[test]
fn objects_of_several_parts_are_one_object() {
    let Some(gpu) = gpu() else { return };
    let at = vec3(0.2, 0.1, -0.3);
    let camera = toward(at);
    let pale = Material {
        base_color: vec3(0.99, 1.0, 1.0).extend(1.0),
        ..glass(1.5)
    };
    for (name, scene, materials) in [
        ("glass", shining_room(), [glass(1.5), pale]),
        ("mirror", room(), [mirror(), mirror()]),
        ("metal", room(), [metal(0.2), metal(0.25)]),
    ] {
        let show = |scene: &Scene| {
            let mut renderer = renderer(&gpu, scene, &[("objects", "*")]);
            let found = picture(&mut renderer, &camera).radiance;
            (found, cubes(&renderer))
        };
        let (whole, _) = show(&with_ball(scene.clone(), materials[0].clone(), at));
        let mut parts = scene;
        in_parts(&mut parts, &sphere(0.5, 64), materials, at);
        let (found, count) = show(&parts);
        let error = rel_mse(&found, &whole);
        println!("{name} in parts: rel-mse {error:.1e} from one in one part, {count} cubes");
        assert!(error < 2e-3, "{name}: {error}");
        assert_eq!(count, 1, "{name}");
    }
}

/// A mirror's other parts, inside it, are not in its reflection.
#[test]
fn what_a_node_hides_inside_is_not_reflected() {
    let Some(gpu) = gpu() else { return };
    let at = vec3(0.2, 0.1, -0.3);
    let camera = toward(at);
    let node = |scene: &mut Scene, first: usize| {
        for (primitive, instance) in scene.instances[first..].iter_mut().enumerate() {
            instance.origin = Some(Origin {
                node: 0,
                place: None,
                primitive,
            });
        }
    };
    let show = |has_core: bool| {
        let mut scene = room();
        let first = scene.instances.len();
        add(&mut scene, "shell", sphere(0.5, 32), mirror(), at);
        if has_core {
            add(&mut scene, "core", sphere(0.3, 16), metal(0.9), at);
        }
        node(&mut scene, first);
        picture(&mut renderer(&gpu, &scene, &[]), &camera).radiance
    };
    let error = rel_mse(&show(true), &show(false));
    println!("with a core: rel-mse {error:.1e}");
    assert!(error < 1e-9, "{error}");
}

fn cubes(renderer: &Renderer) -> usize {
    let maps = renderer.maps();
    maps.iter()
        .filter(|map| map.name.ends_with(".radiance"))
        .count()
}

#[test]
fn many_objects_share_cubes() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room();
    let first = scene.instances.len();
    let ball = scene.add_mesh(sphere(0.1, 12));
    let materials = [mirror(), metal(0.4), glass(1.5)].map(|material| scene.add_material(material));
    for number in 0..60 {
        let [x, y] = [number % 10, number / 10].map(|step| step as f32 * 0.3);
        let at = Mat4::from_translation(vec3(x - 1.35, y - 0.75, -0.5));
        scene.add_instance("ball", ball, materials[number % 3], at);
    }
    let camera = Camera::look_at("", vec3(0.0, 0.0, 1.9), vec3(0.0, 0.0, -0.5), 1.0);
    for most in [3, 5, 16] {
        let settings = [
            ("objects", "*"),
            ("resolution", "16"),
            ("cubes", &most.to_string()),
        ];
        let mut renderer = renderer(&gpu, &scene, &settings);
        let found = picture(&mut renderer, &camera);
        assert!(cubes(&renderer) <= most, "{} cubes", cubes(&renderer));
        let shining = found.lit().filter(|point| {
            let number = (point.instance as usize).checked_sub(first);
            number.is_some_and(|number| number % 3 < 2) && point.radiance.max_element() > 0.0
        });
        let shining: std::collections::BTreeSet<u32> =
            shining.map(|point| point.instance).collect();
        println!("{most} cubes: {} of 40 balls shine", shining.len());
        assert_eq!(shining.len(), 40, "{most} cubes");
    }
}

/// What a lamp sends over a mirror or through glass to a glossy floor are caustics, which other techniques add. Where
/// nothing else is lit, the floor is black, though the mirror and the glass show the lamp.
#[test]
fn gloss_shows_no_lamps_in_mirrors_and_glass() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("lamp");
    let black = Material {
        roughness: 0.2,
        base_color: Vec3::ZERO.extend(1.0),
        ..Material::default()
    };
    let floor = quad(vec3(-2.0, 0.0, 2.0), 4.0 * Vec3::X, 4.0 * Vec3::NEG_Z, 1);
    let floor = add(&mut scene, "floor", floor, black, Vec3::ZERO);
    let lamp = quad(vec3(-1.5, 0.0, 0.0), 3.0 * Vec3::X, 3.0 * Vec3::Y, 1);
    let shine = Material::emitter("lamp", Vec3::new(3.0, 2.0, 1.0));
    add(&mut scene, "lamp", lamp, shine, vec3(0.0, 0.2, -1.8));
    let ball = || sphere(0.4, 32);
    let balls = [(mirror(), -0.6), (glass(1.5), 0.6)]
        .map(|(material, x)| add(&mut scene, "ball", ball(), material, vec3(x, 0.5, 0.0)));
    let camera = Camera::look_at("", vec3(0.0, 1.5, 3.0), vec3(0.0, 0.3, 0.0), 0.8);
    let names = ["distance-impostor"];
    let mut renderer = renderer_of(&gpu, &scene, &names, &[("objects", "*")]);
    let found = picture(&mut renderer, &camera);
    let brightest = |instance: usize| {
        let points = found
            .lit()
            .filter(|point| point.instance as usize == instance);
        points.fold(0.0, |most: f32, point| {
            most.max(point.radiance.max_element())
        })
    };
    let shown = balls.map(brightest);
    let doubled = brightest(floor);
    println!("the lamp in balls: {shown:?}, in the floor: {doubled}");
    assert!(shown[0] > 1.0 && shown[1] > 1.0, "{shown:?}");
    assert!(doubled < 1e-2, "{doubled}");
    let paths = renderer.light_paths();
    let caustics = LightPaths::new(LightClass::Area, "LS+[DG]E");
    assert_eq!(overlap(&paths, &[caustics]), None);
}

/// A Phong lobe reflects less toward the edge of a ball, where part of it lies below the horizon.
#[test]
fn filtered_phong_lobes_have_their_albedo() {
    let Some(gpu) = gpu() else { return };
    let phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::ZERO,
            ks: Vec3::splat(0.8),
            shininess: 20.0,
        },
        ..Material::default()
    };
    let scene = with_ball(room(), phong, Vec3::ZERO);
    let camera = toward(Vec3::ZERO);
    let [filtered, _] = errors(&gpu, &scene, &camera, &[("objects", "*")]);
    println!("Phong, filtered: rel-mse {filtered:.1e}");
    assert!(filtered < 0.01, "{filtered}");
}

/// A texture makes a rough ball ideal: it shows the room as a mirror does.
#[test]
fn ideal_patches_of_rough_objects_mirror_the_room() {
    let Some(gpu) = gpu() else { return };
    let at = Vec3::ZERO;
    let camera = toward(at);
    let mut scene = with_ball(room(), metal(0.5), at);
    let image = Image {
        name: "roughness".into(),
        width: 1,
        height: 1,
        pixels: Pixels::Rgba8(vec![255, 0, 255, 255]),
    };
    let texture = TextureRef::new(scene.textures.len());
    scene.textures.push(Texture {
        image: scene.images.len(),
        wrap: [Wrap::Repeat; 2],
        nearest: false,
        has_levels: false,
    });
    scene.images.push(image.into());
    let material = scene.instances.last().expect("a ball").material;
    scene.materials[material].metallic_roughness_texture = Some(texture);
    let all = [("objects", "*")];
    let ideal = picture(&mut renderer(&gpu, &scene, &all), &camera).radiance;
    let expected = with_ball(room(), metal(0.0), at);
    let expected = picture(&mut renderer(&gpu, &expected, &all), &camera).radiance;
    let error = rel_mse(&ideal, &expected);
    println!("ideal by texture: rel-mse {error:.1e}");
    assert!(error < 1e-2, "{error}");
}
