//! Budgets, and what techniques share.

use std::ops::ControlFlow;
use std::sync::Arc;

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Environment, Light, LightKind, Material, Pixels, Scene};

use super::*;
use crate::Renderer;
use crate::gpu::{TextureAspect, WORKGROUPS, read_buffer, read_texture};
use crate::techniques::Texels;
use crate::testing::test_gpu;

mod layers;
mod live;
mod slices;

/// Two mirror balls on a block, under a lamp and the sky.
fn balls() -> Scene {
    let mut scene = Scene::new("balls");
    let block = scene.add_mesh(cuboid(
        Vec3::new(-2.0, -0.2, -2.0),
        Vec3::new(2.0, 0.0, 2.0),
        1,
    ));
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.6)));
    scene.add_instance("block", block, grey, Mat4::IDENTITY);
    let ball = scene.add_mesh(sphere(0.4, 12));
    let mirror = scene.add_material(Material::metal("mirror", Vec3::splat(0.9), 0.0));
    for x in [-0.5, 0.5] {
        let place = Mat4::from_translation(Vec3::new(x, 0.5, 0.0));
        scene.add_instance("ball", ball, mirror, place);
    }
    let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(8.0));
    scene
        .lights
        .push(lamp.aimed(Vec3::new(0.5, 2.5, 1.0), Vec3::ZERO));
    scene.environment = Some(Environment::default_sky());
    scene
}

fn camera() -> Camera {
    Camera::look_at("", Vec3::new(0.0, 1.5, 3.0), Vec3::ZERO, 0.8)
}

/// What frames did until the maps were final, and the result.
struct Converged {
    /// Workgroups and counted work of each frame.
    frames: Vec<[u64; 2]>,
    picture: Vec<f32>,
    /// Words of each map that is a buffer or holds floats.
    maps: Vec<(String, Vec<u32>)>,
}

fn converged(gpu: &Gpu, settings: &[[&str; 3]], names: &[&str], budget: Budget) -> Converged {
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, &balls(), [16, 16], &names).unwrap();
    for [technique, name, value] in settings {
        renderer.set(technique, name, value).unwrap();
    }
    renderer.set_budget(budget);
    let mut frames = Vec::new();
    loop {
        let before = WORKGROUPS.get();
        let mut readiness = Readiness::Ready;
        renderer
            .converge(&camera(), false, |now, _| {
                readiness = now;
                ControlFlow::Break(())
            })
            .unwrap();
        frames.push([WORKGROUPS.get() - before, renderer.work()]);
        if readiness == Readiness::Ready {
            break;
        }
        assert!(readiness.progress() < 1.0, "{readiness:?}");
        renderer.scene().wait_for_atlas();
    }
    renderer.render_sample(&camera(), 1, None, false).unwrap();
    Converged {
        maps: words_of_maps(gpu, &renderer),
        picture: renderer.radiance().unwrap(),
        frames,
    }
}

/// Names and words of the maps that are buffers or hold floats.
fn words_of_maps(gpu: &Gpu, renderer: &Renderer) -> Vec<(String, Vec<u32>)> {
    let maps = renderer.maps().into_iter().filter_map(|map| {
        let words = match &map.texels {
            Texels::Buffer { buffer, .. } | Texels::Blocks { buffer, .. } => {
                read_buffer(gpu, buffer, buffer.size()).unwrap()
            }
            Texels::Texture(texture) => {
                let layers = 0..texture.depth_or_array_layers();
                let read = |layer| -> Option<Vec<u32>> {
                    let (all, depth) = (TextureAspect::All, TextureAspect::DepthOnly);
                    match texture.format() {
                        wgpu::TextureFormat::Rgba16Float => {
                            let texels: Vec<[u32; 2]> =
                                read_texture(gpu, texture, all, layer, 0).unwrap();
                            Some(texels.into_flattened())
                        }
                        wgpu::TextureFormat::R32Float => {
                            Some(read_texture(gpu, texture, all, layer, 0).unwrap())
                        }
                        wgpu::TextureFormat::Depth32Float => {
                            Some(read_texture(gpu, texture, depth, layer, 0).unwrap())
                        }
                        _ => None,
                    }
                };
                layers.map(read).collect::<Option<Vec<_>>>()?.concat()
            }
        };
        Some((map.name, words))
    });
    maps.collect()
}

impl Converged {
    /// Most workgroups (0) or work (1) of a frame.
    fn most(&self, kind: usize) -> u64 {
        self.frames
            .iter()
            .map(|frame| frame[kind])
            .max()
            .unwrap_or(0)
    }
}

/// With a tiny budget, frames are many and each does little; the maps are the same in the end.
#[test]
fn budgets_bound_frames_and_change_no_map() {
    let Some(gpu) = test_gpu() else { return };
    let names = [
        "shadow-map",
        "environment-map",
        "radiosity",
        "obscurances",
        "caustics",
        "distance-impostor",
    ];
    let settings = [
        ["shadow-map", "resolution", "64"],
        ["environment-map", "resolution", "16"],
        ["environment-map", "samples", "8"],
        ["radiosity", "resolution", "192"],
        ["radiosity", "iterations", "16"],
        ["radiosity", "steps", "16"],
        ["obscurances", "resolution", "32"],
        ["obscurances", "directions", "512"],
        ["obscurances", "steps", "16"],
        ["caustics", "resolution", "32"],
        ["caustics", "cube-resolution", "32"],
        ["caustics", "frames", "2"],
        ["distance-impostor", "resolution", "32"],
    ];
    let whole = converged(&gpu, &settings, &names, Budget::UNLIMITED);
    let sliced = converged(&gpu, &settings, &names, Budget::units(1));
    println!("whole {:?}, sliced {:?}", whole.frames, sliced.frames);
    assert!(sliced.frames.len() > 3 * whole.frames.len());
    let (groups, most) = (sliced.most(0), whole.most(0));
    assert!(groups * 2 < most, "{groups} and {most} workgroups");
    // The irradiance cube is the largest step: each of its texels sums a cube of the same size.
    let texels = 6 * u64::from(crate::prefiltered::IRRADIANCE_SIDE).pow(2);
    let others = sliced
        .frames
        .iter()
        .map(|frame| frame[1])
        .filter(|&work| work < texels * texels);
    let work = others.max().unwrap_or(0);
    // The second frame has two steps of texels.
    assert!(work * 2 <= whole.frames[1][1], "{work} units");
    assert!(whole.maps.len() > 8);
    assert_eq!(whole.maps.len(), sliced.maps.len());
    for ((name, a), (_, b)) in whole.maps.iter().zip(&sliced.maps) {
        if name.starts_with("distance-impostor") && name.ends_with("radiance") {
            // How deep mirrors show each other depends on how often their cubes were lit.
            let differ = a.iter().zip(b).filter(|(a, b)| a != b).count();
            println!("{name}: {differ} of {} differ", a.len());
            assert!(differ * 20 < a.len(), "{name}: {differ} of {}", a.len());
        } else {
            assert!(a == b, "{name}");
        }
    }
    let values = whole.picture.iter().zip(&sliced.picture);
    let differ = values.filter(|(a, b)| a != b).count();
    println!("picture: {differ} of {} differ", whole.picture.len());
    assert!(differ * 20 < whole.picture.len(), "{differ}");
}

/// Bounces start from other light when faces come in other frames, and end at the same light.
#[test]
fn budgets_slice_final_gathering() {
    let Some(gpu) = test_gpu() else { return };
    let names = ["shadow-map", "final-gather"];
    for points in ["grid", "objects"] {
        let settings = [
            ["final-gather", "reference-points", points],
            ["final-gather", "density", "0.5"],
            ["final-gather", "size", "2"],
            ["final-gather", "resolution", "16"],
            ["final-gather", "bounces", "32"],
        ];
        let whole = converged(&gpu, &settings, &names, Budget::UNLIMITED);
        let mut sliced = converged(&gpu, &settings, &names, Budget::units(1));
        println!(
            "{points}: whole {:?}, sliced {:?}",
            whole.frames, sliced.frames
        );
        assert!(sliced.frames.len() > 2 * whole.frames.len());
        // Surroundings of objects are captured in the first frame.
        let (first, most) = (sliced.frames.remove(0)[0], whole.most(0));
        assert!(first < most, "{first} and {most} workgroups");
        let groups = sliced.most(0);
        assert!(groups * 2 < most, "{groups} and {most} workgroups");
        for (a, b) in whole.picture.iter().zip(&sliced.picture) {
            assert!((a - b).abs() <= 1e-4 * a.max(0.05), "{a} and {b}");
        }
    }
}

/// A scene that changes in every frame must not keep any object's caustics from being made, nor light between surfaces.
#[test]
fn small_budgets_finish_rounds_while_everything_changes() {
    let Some(gpu) = test_gpu() else { return };
    let names = ["shadow-map", "caustics", "radiosity"].map(str::to_owned);
    let mut scene = balls();
    scene.environment = None;
    for material in &mut scene.materials {
        if material.name == "mirror" {
            *material = Material {
                transmission: 1.0,
                roughness: 0.0,
                volume: Some(gpugi_scene::Volume {
                    attenuation_distance: f32::INFINITY,
                    attenuation_color: Vec3::ONE,
                }),
                ..Material::default()
            };
        }
    }
    let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).unwrap();
    for [technique, name, value] in [
        ["caustics", "resolution", "32"],
        ["caustics", "cube-resolution", "16"],
        ["radiosity", "resolution", "32"],
        ["radiosity", "burn-in", "2"],
    ] {
        renderer.set(technique, name, value).unwrap();
    }
    renderer.set_budget(Budget::units(1));
    let mut readiness = Vec::new();
    for _ in 0..24 {
        scene.lights[0].intensity *= 1.01;
        renderer.update(&scene).unwrap();
        let one_frame = |_, _| ControlFlow::Break(());
        let found = renderer.converge(&camera(), false, one_frame).unwrap();
        readiness.push(found);
        renderer.scene().wait_for_atlas();
    }
    println!("{readiness:?}");
    let last = readiness[readiness.len() - 1];
    assert!(last.is_usable() && last != Readiness::Ready, "{last:?}");
    let sum = |name: &str| -> f32 {
        let maps = renderer.maps().into_iter();
        let mut found = maps.filter(|map| map.name == name);
        let Some(Texels::Buffer { buffer, .. }) = found.next().map(|map| map.texels) else {
            panic!("{name}");
        };
        let values: Vec<f32> = read_buffer(&gpu, &buffer, buffer.size()).unwrap();
        values.iter().sum()
    };
    assert!(sum("radiosity.irradiance") > 0.0);
}

#[test]
fn caustics_of_nothing_are_final_at_once() {
    let Some(gpu) = test_gpu() else { return };
    let names = ["caustics".to_owned()];
    let mut dark = balls();
    dark.lights.clear();
    let mut matt = balls();
    matt.instances.truncate(1);
    for scene in [dark, matt] {
        let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).unwrap();
        let one_frame = |_, _| ControlFlow::Break(());
        let readiness = renderer.converge(&camera(), false, one_frame).unwrap();
        assert_eq!(readiness, Readiness::Ready);
    }
}

/// A lamp that moves in every frame must not keep any cube from being lit again, nor make more than every third frame
/// exceed its budget.
#[test]
fn small_budgets_reach_every_object_while_everything_changes() {
    let Some(gpu) = test_gpu() else { return };
    let names = ["shadow-map", "distance-impostor"].map(str::to_owned);
    let mut scene = balls();
    let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).unwrap();
    renderer
        .set("distance-impostor", "resolution", "16")
        .unwrap();
    renderer.set_budget(Budget::units(1));
    renderer.render_sample(&camera(), 1, None, false).unwrap();
    let lit = |renderer: &Renderer| -> Vec<Vec<[u32; 2]>> {
        let maps = renderer.maps().into_iter();
        let radiance = maps.filter(|map| map.name.ends_with(".radiance"));
        let read = |map: Map| {
            let texture = map.texture().unwrap();
            read_texture(&gpu, texture, TextureAspect::All, 3, 0).unwrap()
        };
        radiance.map(read).collect()
    };
    let before = lit(&renderer);
    assert_eq!(before.len(), 2);
    let mut work = Vec::new();
    for _ in 0..9 {
        scene.lights[0].intensity *= 1.5;
        renderer.update(&scene).unwrap();
        renderer.render_sample(&camera(), 1, None, false).unwrap();
        work.push(renderer.work());
    }
    for (before, after) in before.iter().zip(lit(&renderer)) {
        assert!(*before != after);
    }
    // Shadow maps keep to the budget, but for one step; cubes take turns.
    println!("{work:?}");
    let least = *work.iter().min().unwrap();
    let cubes: Vec<usize> = (0..9).filter(|&frame| work[frame] > least).collect();
    assert!(cubes.len() >= 2, "{work:?}");
    assert!(cubes.windows(2).all(|two| two[1] - two[0] >= 3), "{work:?}");
}

#[test]
fn techniques_share_the_maps_of_the_environment() {
    let Some(gpu) = test_gpu() else { return };
    let names = ["image-based-lighting", "environment-map"].map(str::to_owned);
    let mut renderer = Renderer::new(&gpu, &balls(), [8, 8], &names).unwrap();
    for [technique, name, value] in [
        ["image-based-lighting", "samples", "8"],
        ["image-based-lighting", "resolution", "32"],
        ["image-based-lighting", "reflectivity", "ratio"],
        ["environment-map", "objects", "ball"],
    ] {
        renderer.set(technique, name, value).unwrap();
    }
    renderer.render_sample(&camera(), 1, None, false).unwrap();
    assert_eq!(renderer.lighting().shared.environments.len(), 1);
    renderer.set("environment-map", "resolution", "64").unwrap();
    renderer.render_sample(&camera(), 1, None, false).unwrap();
    assert_eq!(renderer.lighting().shared.environments.len(), 2);
}
