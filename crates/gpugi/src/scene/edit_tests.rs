//! Edits upload what they change, keep the maps that do not depend on a change, and give the same picture as a new
//! renderer.

use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3, vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::bvh::traverse::Ray;
use gpugi_scene::bvh::{INSTANCE_ROWS, NODE_ROWS, Row, TRIANGLE_ROWS};
use gpugi_scene::{
    AlphaMode, Camera, Environment, Image, Light, LightKind, Material, Mesh, Pixels, Scene,
    Texture, TextureRef, Wrap,
};

use super::ray_tests::trace;
use super::{Edit, GpuScene, gpu as rows};
use crate::gpu::{Gpu, GpuError};
use crate::renderer::Renderer;
use crate::testing::{Random, own_test_gpu, test_gpu};

const INSTANCE: u64 = size_of::<rows::Instance>() as u64;
const HEADER: u64 = size_of::<rows::SceneHeader>() as u64;
const MATERIAL: u64 = size_of::<rows::Material>() as u64;
const TEXTURES: u64 =
    super::rows::TEXTURE_SLOTS as u64 * size_of::<rows::TextureReference>() as u64;
/// An instance's rows in the ray hierarchy, and its box.
const ITEM: u64 = INSTANCE_ROWS as u64 * 16 + 32;

fn sky(width: u32, radiance: f32) -> Environment {
    let texel = |index: u32| [radiance, index as f32 * 0.1, 0.3, 1.0];
    Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width,
            height: 1,
            pixels: Pixels::Rgba32Float((0..width).flat_map(texel).collect()),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

fn place(x: f32, y: f32, z: f32) -> Mat4 {
    Mat4::from_translation(vec3(x, y, z))
}

/// `side` x `side` cubes on a floor, every other one with a textured material; a lamp, a light and a sky.
fn field(side: usize) -> Scene {
    let mut scene = Scene::new("field");
    let cube = scene.add_mesh(shapes::cuboid(Vec3::splat(-0.2), Vec3::splat(0.4), 1));
    let floor = scene.add_mesh(shapes::quad(
        vec3(-1.0, -0.2, 1.0),
        Vec3::X * 2.0,
        Vec3::Z * -2.0,
        1,
    ));
    let image = Image {
        name: "dots".into(),
        width: 2,
        height: 2,
        pixels: Pixels::Rgba8((0..16).map(|byte| byte * 15).collect()),
    };
    scene.images = vec![image.into()];
    scene.textures.push(Texture {
        image: 0,
        wrap: [Wrap::Repeat; 2],
        nearest: true,
        has_levels: false,
    });
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    let dotted = scene.add_material(Material {
        base_color_texture: Some(TextureRef::new(0)),
        ..Material::matt("dotted", Vec3::ONE)
    });
    let lamp = scene.add_material(Material::emitter("lamp", Vec3::splat(3.0)));
    let at = |index: usize| (index as f32 + 0.5) / side as f32 * 2.0 - 1.0;
    let size = Mat4::from_scale(Vec3::splat(2.0 / side as f32));
    for index in 0..side * side {
        let material = if index % 2 == 0 { grey } else { dotted };
        let at = place(at(index % side), 0.0, at(index / side));
        scene.add_instance(&format!("cube {index}"), cube, material, at * size);
    }
    scene.add_instance("floor", floor, grey, Mat4::IDENTITY);
    let over = place(0.3, 1.0, 0.2) * Mat4::from_scale(Vec3::splat(0.5));
    scene.add_instance("lamp", cube, lamp, over);
    let light = Light::new("light", LightKind::Point, Vec3::ONE);
    scene
        .lights
        .push(light.aimed(vec3(-0.5, 1.5, 0.5), Vec3::ZERO));
    scene.environment = Some(sky(4, 0.5));
    scene
}

fn moved(scene: &Scene, index: usize, by: Vec3) -> Edit {
    Edit::Instance {
        index,
        world_from_mesh: Mat4::from_translation(by) * scene.instances[index].world_from_mesh,
    }
}

fn material(scene: &Scene, index: usize, change: impl FnOnce(&mut Material)) -> Edit {
    let mut material = scene.materials[index].clone();
    change(&mut material);
    Edit::Material {
        index,
        material: Box::new(material),
    }
}

fn mesh(scene: &Scene, index: usize, change: impl FnOnce(&mut Mesh)) -> Edit {
    let mut mesh = Mesh::clone(&scene.meshes[index]);
    change(&mut mesh);
    Edit::Mesh {
        index,
        mesh: Arc::new(mesh),
    }
}

fn environment(scene: &Scene, change: impl FnOnce(&mut Environment)) -> Edit {
    let mut environment = scene.environment.clone().unwrap();
    change(&mut environment);
    Edit::Environment(environment)
}

fn light(scene: &Scene, change: impl FnOnce(&mut Light)) -> Edit {
    let mut light = scene.lights[0].clone();
    change(&mut light);
    Edit::Light { index: 0, light }
}

/// Bytes uploaded by `work`.
fn uploaded(gpu: &Gpu, work: impl FnOnce()) -> u64 {
    let before = gpu.uploaded_bytes();
    work();
    gpu.uploaded_bytes() - before
}

#[test]
fn an_edit_uploads_what_it_changes() {
    let Some(gpu) = own_test_gpu() else { return };
    let side = 100;
    let scene = field(side);
    let middle = side * side / 2 + side / 2;
    let cube_vertices = |on_gpu: &GpuScene| u64::from(on_gpu.geometry.meshes[0].vertex_count());
    for with_rays in [false, true] {
        let make = if with_rays {
            GpuScene::with_rays
        } else {
            GpuScene::new
        };
        let mut on_gpu = make(&gpu, &scene).unwrap();
        let mut bytes = |edits: &[Edit]| uploaded(&gpu, || on_gpu.edit(&gpu, edits).unwrap());

        let one = bytes(&[moved(&scene, middle, vec3(0.0, 0.01, 0.0))]);
        if with_rays {
            // The instance's rows and its box: the GPU refits the nodes above it.
            assert_eq!(one, INSTANCE + ITEM);
        } else {
            assert_eq!(one, INSTANCE);
        }
        let out = bytes(&[moved(&scene, middle, vec3(0.0, -9.0, 0.0))]);
        assert!((INSTANCE + HEADER..1000).contains(&out), "{out} bytes");
        let rough = material(&scene, 0, |material| material.roughness = 0.4);
        assert_eq!(bytes(std::slice::from_ref(&rough)), MATERIAL);
        assert_eq!(bytes(&[rough]), 0, "nothing changed");
        let shifted = material(&scene, 1, |material| {
            let texture = material.base_color_texture.as_mut().unwrap();
            texture.uv_from_mesh.translation = Vec2::splat(0.5);
        });
        assert_eq!(bytes(&[shifted]), MATERIAL + TEXTURES);
        let turned = environment(&scene, |sky| {
            sky.rotation = glam::Quat::from_rotation_y(1.0)
        });
        assert_eq!(bytes(&[turned]), HEADER);
        let image = Edit::Environment(Environment {
            rotation: glam::Quat::from_rotation_y(1.0),
            ..sky(8, 1.0)
        });
        assert_eq!(bytes(&[image]), 8 * 8, "half floats of its eight texels");
        let lit = light(&scene, |light| light.world_from_light.w_axis.x = 0.7);
        assert_eq!(bytes(&[lit]), 0);
        let all: Vec<Edit> = (0..scene.instances.len())
            .map(|index| moved(&scene, index, vec3(0.0, 0.02, 0.0)))
            .collect();
        let count = all.len() as u64;
        let all = bytes(&all);
        let per_instance = match with_rays {
            true => INSTANCE + ITEM,
            false => INSTANCE,
        };
        assert_eq!(all, count * per_instance + HEADER);
        let bent = mesh(&scene, 0, |mesh| {
            mesh.positions
                .iter_mut()
                .for_each(|position| position.y *= 1.1);
        });
        let vertices = cube_vertices(&on_gpu) * size_of::<rows::Vertex>() as u64;
        // The hierarchy of a cube: a node and twelve triangles.
        let hierarchy = u64::from(NODE_ROWS + 12 * TRIANGLE_ROWS) * size_of::<Row>() as u64;
        let bytes = uploaded(&gpu, || on_gpu.edit(&gpu, &[bent]).unwrap());
        let least = vertices + (count - 1) * per_instance + u64::from(with_rays) * hierarchy;
        assert!(
            bytes == least || bytes == least + HEADER,
            "{bytes}, {least}"
        );
    }
}

#[test]
fn a_whole_scene_uploads_what_is_not_shared() {
    let Some(gpu) = own_test_gpu() else { return };
    let mut scene = field(20);
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let mut follow = |scene: &Scene| uploaded(&gpu, || on_gpu.update(&gpu, scene).unwrap());
    assert_eq!(follow(&scene), 0);
    scene.instances[210].world_from_mesh.w_axis.y += 0.01;
    scene.materials[1].roughness = 0.3;
    scene.lights[0].intensity *= 2.0;
    assert_eq!(follow(&scene.clone()), INSTANCE + MATERIAL);
    scene.lights.clear();
    assert_eq!(follow(&scene), 0);
    // Another order of triangles uploads rows and indices, but neither vertices nor texels.
    scene.materials[0].double_sided = true;
    let indices: usize = scene
        .instances
        .iter()
        .map(|instance| scene.meshes[instance.mesh].indices.len())
        .sum();
    let tables = scene.instances.len() as u64 * INSTANCE + 3 * (MATERIAL + TEXTURES);
    assert_eq!(follow(&scene), HEADER + tables + 4 * indices as u64);
}

/// Every kind of edit, including those that upload more than a few rows.
fn every_edit(scene: &Scene) -> Vec<(&'static str, Vec<Edit>)> {
    let mirror = Mat4::from_scale(vec3(-1.0, 1.0, 1.0));
    let last = scene.instances.len() - 1;
    let one = |edit| vec![edit];
    vec![
        ("moved", one(moved(scene, 4, vec3(0.2, 0.3, 0.1)))),
        ("moved far", one(moved(scene, 4, vec3(0.0, 5.0, 0.0)))),
        ("moved back", one(moved(scene, 4, Vec3::ZERO))),
        ("lamp", one(moved(scene, last, vec3(-0.5, 0.2, 0.0)))),
        (
            "several, one twice",
            vec![
                moved(scene, 8, vec3(0.0, 0.1, 0.0)),
                moved(scene, 1, vec3(0.1, 0.1, 0.0)),
                moved(scene, 8, vec3(0.0, 0.2, 0.1)),
            ],
        ),
        (
            "mirrored",
            one(Edit::Instance {
                index: 3,
                world_from_mesh: scene.instances[3].world_from_mesh * mirror,
            }),
        ),
        (
            "without an inverse",
            one(Edit::Instance {
                index: 5,
                world_from_mesh: Mat4::from_scale(vec3(0.3, 0.0, 0.3)),
            }),
        ),
        (
            "colour",
            one(material(scene, 0, |material| material.base_color.x = 0.9)),
        ),
        (
            "mirror",
            one(material(scene, 0, |material| {
                (material.roughness, material.metallic) = (0.0, 1.0);
            })),
        ),
        (
            "emission",
            one(material(scene, 2, |material| material.emissive.x = 9.0)),
        ),
        (
            "emission of more",
            one(material(scene, 0, |material| {
                material.emissive = Vec3::splat(0.2)
            })),
        ),
        (
            "texture",
            one(material(scene, 1, |material| {
                material.base_color_texture = None
            })),
        ),
        (
            "alpha",
            one(material(scene, 1, |material| {
                material.alpha_mode = AlphaMode::Mask { cutoff: 0.5 };
                material.base_color.w = 0.2;
            })),
        ),
        (
            "bent",
            one(mesh(scene, 0, |mesh| {
                for position in &mut mesh.positions {
                    position.y *= 1.5;
                }
            })),
        ),
        (
            "other triangles",
            one(mesh(scene, 0, |mesh| mesh.indices.truncate(18))),
        ),
        (
            "sky turned",
            one(environment(scene, |sky| {
                sky.rotation = glam::Quat::from_rotation_y(2.0)
            })),
        ),
        (
            "sky dimmed",
            one(environment(scene, |sky| sky.intensity = 0.3)),
        ),
        ("another sky", one(Edit::Environment(sky(8, 2.0)))),
        (
            "light",
            one(light(scene, |light| light.world_from_light.w_axis.x = 0.7)),
        ),
        (
            "light's colour",
            one(light(scene, |light| light.intensity.y = 4.0)),
        ),
    ]
}

fn edited(scene: &Scene, edits: &[Edit]) -> Scene {
    let mut after = scene.clone();
    for edit in edits {
        edit.apply_to(&mut after);
    }
    after
}

fn rendered(renderer: &mut Renderer) -> Vec<f32> {
    let camera = Camera::look_at("", vec3(0.4, 2.2, 2.0), Vec3::ZERO, 0.9);
    renderer.restart();
    renderer.render_sample(&camera, 1, None, false).unwrap();
    renderer.radiance().unwrap()
}

/// The largest difference between two pictures.
fn worst(a: &[f32], b: &[f32]) -> f32 {
    assert!(b.iter().any(|value| *value > 0.1));
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn the_picture_after_an_edit_is_that_of_a_new_renderer() {
    let Some(gpu) = test_gpu() else { return };
    let start = field(3);
    let names = ["shadow-map", "environment-map"].map(str::to_owned);
    let new = |scene: &Scene| {
        let mut renderer = Renderer::new(&gpu, scene, [32; 2], &names).unwrap();
        renderer.set("shadow-map", "resolution", "256").unwrap();
        // Maps that are quick to make: there are dozens of renderers.
        for (name, value) in [("resolution", "32"), ("samples", "16")] {
            renderer.set("environment-map", name, value).unwrap();
        }
        renderer
    };
    let mut kept = new(&start);
    let before = rendered(&mut kept);
    for (what, edits) in every_edit(&start) {
        kept.edit(&edits).unwrap();
        let found = rendered(&mut kept);
        let fresh = rendered(&mut new(&edited(&start, &edits)));
        assert_eq!(worst(&found, &fresh), 0.0, "{what}");
        let is_seen = worst(&before, &fresh) > 1e-3;
        assert_eq!(is_seen, what != "moved back", "{what}");
        kept.update(&start).unwrap();
        assert_eq!(
            worst(&rendered(&mut kept), &before),
            0.0,
            "{what}, and back"
        );
    }
}

#[test]
fn rays_after_an_edit_find_what_they_find_in_a_new_scene() {
    let Some(gpu) = test_gpu() else { return };
    let start = field(6);
    let mut random = Random(3);
    let mut vector = || Vec3::from_array([0; 3].map(|_| random.next() as f32 * 2.0 - 1.0));
    let rays: Vec<Ray> = (0..3000)
        .map(|_| {
            let origin = vector() * 3.0;
            Ray {
                origin,
                t_min: 0.0,
                direction: vector() - origin,
                t_max: f32::MAX,
            }
        })
        .collect();
    let hits = |scene: &GpuScene| -> Vec<(u32, u32, f32)> {
        let found = trace(&gpu, scene, &rays).into_iter();
        let hits = found.map(|found| (found.instance, found.primitive, found.t));
        hits.collect()
    };
    let mut kept = GpuScene::with_texels(&gpu, &start).unwrap();
    let first = hits(&kept);
    assert!(first.iter().filter(|hit| hit.0 != u32::MAX).count() > 1000);
    for (what, edits) in every_edit(&start) {
        let after = edited(&start, &edits);
        let new = GpuScene::with_texels(&gpu, &after).unwrap();
        let fresh = hits(&new);
        let mut edited = GpuScene::with_rays(&gpu, &start).unwrap();
        edited.edit(&gpu, &edits).unwrap();
        assert_eq!(hits(&edited), fresh, "{what}");
        // Update from the previous edit to this one.
        kept.update(&gpu, &after).unwrap();
        assert_eq!(hits(&kept), fresh, "{what}, followed");
        assert_eq!([edited.bounds, kept.bounds], [new.bounds; 2], "{what}");
        if what == "moved" {
            assert_ne!(first, fresh);
        }
    }
}

#[test]
fn maps_stay_that_depend_on_nothing_that_changed() {
    let Some(gpu) = test_gpu() else { return };
    let scene = field(3);
    let names = ["shadow-map", "image-based-lighting", "obscurances"].map(str::to_owned);
    let mut renderer = Renderer::new(&gpu, &scene, [16; 2], &names).unwrap();
    renderer.set("obscurances", "resolution", "64").unwrap();
    let atlas = |renderer: &Renderer| {
        let atlas = renderer.scene().atlas(&gpu, "test", 64, 0.0, 16);
        atlas.unwrap().unwrap()
    };
    let passes = |renderer: &mut Renderer, edits: &[Edit]| -> [bool; 2] {
        renderer.edit(edits).unwrap();
        let camera = Camera::look_at("", vec3(0.4, 2.2, 2.0), Vec3::ZERO, 0.9);
        let timings = renderer.render_sample(&camera, 1, None, true).unwrap();
        let timings = timings.wait().unwrap();
        ["shadow-map.generate", "image-based-lighting.generate"]
            .map(|name| timings.iter().any(|timing| timing.pass == name))
    };
    let all = passes(&mut renderer, &[]);
    let kept = atlas(&renderer);
    let turned = environment(&scene, |sky| {
        sky.rotation = glam::Quat::from_rotation_y(1.0)
    });
    let turned = passes(&mut renderer, &[turned]);
    let lit = light(&scene, |light| light.world_from_light.w_axis.x = 0.7);
    let lit = passes(&mut renderer, &[lit]);
    let moved = passes(&mut renderer, &[moved(&scene, 0, Vec3::Y)]);
    assert!(Arc::ptr_eq(&kept, &atlas(&renderer)));
    if gpu.has_timestamps {
        assert_eq!(
            [all, turned, lit, moved],
            [[true; 2], [false, true], [true, false], [true; 2]]
        );
    }
}

#[test]
fn what_there_is_not_is_refused_and_changes_nothing() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = field(2);
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let versions = on_gpu.versions;
    let mut bad_texture = material(&scene, 0, |material| {
        material.normal_texture = Some(TextureRef::new(1));
    });
    let bad_mesh = mesh(&scene, 0, |mesh| mesh.indices[0] = 9999);
    let bad_sky = environment(&scene, |sky| sky.intensity = f32::NAN);
    let mut elsewhere = moved(&scene, 0, Vec3::X);
    let good = elsewhere.clone();
    if let Edit::Instance { index, .. } = &mut elsewhere {
        *index = scene.instances.len();
    }
    for edit in [&elsewhere, &bad_texture, &bad_mesh, &bad_sky] {
        let refused = on_gpu.edit(&gpu, &[good.clone(), edit.clone()]);
        assert!(matches!(refused, Err(GpuError::Input { .. })), "{edit:?}");
        assert_eq!(on_gpu.versions, versions);
    }
    if let Edit::Material { index, .. } = &mut bad_texture {
        *index = 99;
    }
    scene.environment = None;
    scene.lights.clear();
    let mut dark = GpuScene::new(&gpu, &scene).unwrap();
    let any_light = Edit::Light {
        index: 0,
        light: Light::new("", LightKind::Point, Vec3::ONE),
    };
    for edit in [bad_texture, Edit::Environment(sky(1, 1.0)), any_light] {
        assert!(dark.edit(&gpu, &[edit]).is_err());
    }
}

/// A ball in the field, that is a sphere.
fn with_sphere() -> (Scene, usize, usize) {
    let mut scene = field(3);
    let ball = scene.add_mesh(shapes::sphere(0.3, 16));
    let grey = scene.add_material(Material::matt("ball", Vec3::splat(0.6)));
    let index = scene.add_instance("ball", ball, grey, place(0.2, 0.6, 0.3));
    scene.instances[index].is_sphere = true;
    (scene, index, grey)
}

#[test]
fn spheres_are_moved_and_painted() {
    let Some(gpu) = test_gpu() else { return };
    let (start, ball, grey) = with_sphere();
    let names = ["shadow-map", "ray-tracing"].map(str::to_owned);
    let new = |scene: &Scene| Renderer::new(&gpu, scene, [32; 2], &names).unwrap();
    let mut kept = new(&start);
    let before = rendered(&mut kept);
    let squashed = Edit::Instance {
        index: ball,
        world_from_mesh: place(-0.4, 0.5, 0.3) * Mat4::from_scale(vec3(1.5, 0.5, -1.0)),
    };
    let mirror = material(&start, grey, |material| {
        (material.roughness, material.metallic) = (0.0, 1.0);
    });
    let mesh = mesh(&start, start.instances[ball].mesh, |mesh| {
        for position in &mut mesh.positions {
            *position *= 1.2;
        }
    });
    for edit in [
        moved(&start, ball, vec3(0.3, 0.1, 0.0)),
        squashed,
        mirror,
        mesh,
    ] {
        let edits = [edit];
        kept.edit(&edits).unwrap();
        let found = rendered(&mut kept);
        let fresh = rendered(&mut new(&edited(&start, &edits)));
        assert_eq!(worst(&found, &fresh), 0.0, "{edits:?}");
        assert!(worst(&before, &fresh) > 1e-3, "{edits:?}");
        kept.update(&start).unwrap();
        assert_eq!(worst(&rendered(&mut kept), &before), 0.0, "{edits:?}");
    }
    // From a sphere to triangles.
    let mut plain = start.clone();
    plain.instances[ball].is_sphere = false;
    kept.update(&plain).unwrap();
    assert!(!kept.scene().has_spheres);
    assert_eq!(
        worst(&rendered(&mut kept), &rendered(&mut new(&plain))),
        0.0
    );
}

#[test]
fn edits_that_no_sphere_bears_are_refused_and_change_nothing() {
    let Some(gpu) = test_gpu() else { return };
    let (start, ball, grey) = with_sphere();
    let shape = start.instances[ball].mesh;
    let mut on_gpu = GpuScene::with_rays(&gpu, &start).unwrap();
    let versions = on_gpu.versions;
    let emits = material(&start, grey, |material| material.emissive = Vec3::ONE);
    let blends = material(&start, grey, |material| {
        material.alpha_mode = AlphaMode::Blend
    });
    let flattened = mesh(&start, shape, |mesh| {
        mesh.positions
            .iter_mut()
            .for_each(|position| position.y *= 0.5);
    });
    for (edit, reason) in [(emits, "emit"), (blends, "opaque"), (flattened, "ball")] {
        let refused = on_gpu.edit(&gpu, &[edit]);
        let Err(GpuError::Input { what }) = refused else {
            panic!("{refused:?}");
        };
        assert!(what.contains("\"ball\"") && what.contains(reason), "{what}");
        assert_eq!(on_gpu.versions, versions);
    }
}
