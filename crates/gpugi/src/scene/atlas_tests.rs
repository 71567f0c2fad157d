//! Atlases are laid out only once.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{AlphaMode, Atlas, AtlasOptions, Camera, Light, LightKind, Material, Scene};

use super::{GpuScene, LayOut};
use crate::Renderer;
use crate::gpu::Gpu;
use crate::jobs::{self, Job};
use crate::testing::test_gpu;

const SIZE: u32 = 32;

/// A block on a floor below a lamp.
fn block_on_floor() -> Scene {
    let mut scene = Scene::new("block");
    let floor = scene.add_mesh(shapes::quad(Vec3::ZERO, Vec3::Z, Vec3::X, 1));
    let block = scene.add_mesh(shapes::cuboid(Vec3::ZERO, Vec3::splat(0.3), 1));
    for mesh in [floor, block] {
        let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    }
    let lamp = Light::new("lamp", LightKind::Point, Vec3::ONE);
    scene.lights.push(lamp.aimed(Vec3::Y * 2.0, Vec3::ZERO));
    scene
}

fn renderer(gpu: &Gpu, scene: &Scene) -> Renderer {
    let names = ["shadow-map", "radiosity", "obscurances"].map(str::to_owned);
    let mut renderer = Renderer::new(gpu, scene, [8; 2], &names).unwrap();
    for name in &names[1..] {
        let size = SIZE.to_string();
        renderer.set(name, "resolution", &size).unwrap();
    }
    render(&mut renderer);
    renderer
}

fn render(renderer: &mut Renderer) {
    let camera = Camera::look_at("", Vec3::ONE, Vec3::ZERO, 1.0);
    renderer.render_sample(&camera, 1, None, false).unwrap();
}

fn atlas(gpu: &Gpu, renderer: &Renderer) -> Arc<Atlas> {
    let atlas = renderer.scene().atlas(gpu, "test", SIZE, 0.0, 16);
    atlas.unwrap().unwrap()
}

/// Number of techniques that keep the atlas.
fn techniques(gpu: &Gpu, renderer: &Renderer) -> usize {
    Arc::strong_count(&atlas(gpu, renderer)) - 1
}

#[test]
fn techniques_share_an_atlas_until_meshes_change() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = block_on_floor();
    let mut renderer = renderer(&gpu, &scene);
    let mut follow = |renderer: &mut Renderer, change: fn(&mut Scene)| {
        change(&mut scene);
        renderer.update(&scene).unwrap();
        render(renderer);
    };
    assert_eq!(techniques(&gpu, &renderer), 2);
    let kept = Arc::downgrade(&atlas(&gpu, &renderer));
    let same: [fn(&mut Scene); 6] = [
        |scene| scene.materials[0].base_color.x = 0.9,
        |scene| scene.materials[1].alpha_mode = AlphaMode::Mask { cutoff: 0.5 },
        |scene| scene.materials[1].transmission = 1.0,
        |scene| scene.instances[1].world_from_mesh = Mat4::from_translation(Vec3::X * 0.4),
        |scene| scene.instances[1].world_from_mesh = Mat4::from_scale(Vec3::new(-1.0, 2.0, 1.0)),
        |scene| scene.lights[0].intensity *= 2.0,
    ];
    for (number, change) in same.into_iter().enumerate() {
        follow(&mut renderer, change);
        assert_eq!(techniques(&gpu, &renderer), 2, "change {number}");
        assert!(kept.strong_count() > 0, "change {number}: a new atlas");
    }
    renderer.invalidate();
    render(&mut renderer);
    assert!(kept.strong_count() > 0);
    let others: [fn(&mut Scene); 3] = [
        |scene| Arc::make_mut(&mut scene.meshes[1]).positions[0] *= 1.1,
        |scene| scene.instances[1].mesh = 0,
        |scene| scene.instances.truncate(1),
    ];
    for (number, change) in others.into_iter().enumerate() {
        let kept = Arc::downgrade(&atlas(&gpu, &renderer));
        follow(&mut renderer, change);
        assert_eq!(kept.strong_count(), 0, "change {number}: the old atlas");
        assert_eq!(techniques(&gpu, &renderer), 2, "change {number}");
    }
    renderer.set("radiosity", "resolution", "16").unwrap();
    render(&mut renderer);
    assert_eq!(techniques(&gpu, &renderer), 1);
}

#[test]
fn an_atlas_of_too_many_pages_is_refused_whoever_laid_it_out() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = block_on_floor();
    let floors = vec![scene.instances[0].clone(); 5];
    scene.instances.extend(floors);
    let scene = GpuScene::with_texels(&gpu, &scene).unwrap();
    let of = |bytes| scene.atlas(&gpu, "test", SIZE, 16.0, bytes);
    assert_eq!(of(16).unwrap(), None, "laid out beside the frame");
    scene.wait_for_atlas();
    let many = of(16).unwrap().unwrap();
    assert!(many.pages > 2);
    let limits = gpu.limits();
    let limit = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let refused = of(limit / u64::from(2 * SIZE * SIZE + 2)).unwrap_err();
    assert!(refused.to_string().contains("density"), "{refused}");
}

#[test]
fn an_atlas_of_meshes_that_are_no_more_is_dropped() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = block_on_floor();
    let mut on_gpu = GpuScene::with_texels(&gpu, &scene).unwrap();
    let ask = |on_gpu: &GpuScene| on_gpu.atlas(&gpu, "test", SIZE, 0.0, 16).unwrap();
    // Meshes bend in every frame, faster than atlases are laid out.
    for _ in 0..4 {
        assert_eq!(ask(&on_gpu), None);
        Arc::make_mut(&mut scene.meshes[1]).positions[0] *= 1.1;
        on_gpu.update(&gpu, &scene).unwrap();
    }
    let laid_out = |on_gpu: &GpuScene| {
        loop {
            if let Some(atlas) = ask(on_gpu) {
                return atlas;
            }
            on_gpu.wait_for_atlas();
        }
    };
    let fresh = GpuScene::with_texels(&gpu, &scene).unwrap();
    assert_eq!(laid_out(&on_gpu), laid_out(&fresh));
}

#[test]
fn a_finished_atlas_waits_until_it_is_asked_for_again() {
    let Some(gpu) = test_gpu() else { return };
    let scene = GpuScene::with_texels(&gpu, &block_on_floor()).unwrap();
    let of = |size| scene.atlas(&gpu, "test", size, 0.0, 16).unwrap();
    assert_eq!(of(SIZE), None);
    scene.wait_for_atlas();
    assert_eq!(of(2 * SIZE), None, "another one takes its place");
    assert_eq!(of(SIZE).unwrap().size, SIZE);
    scene.wait_for_atlas();
    assert_eq!(of(2 * SIZE).unwrap().size, 2 * SIZE);
}

#[test]
fn an_atlas_is_the_same_if_it_is_laid_out_elsewhere() {
    let job = || LayOut {
        scene: block_on_floor(),
        options: AtlasOptions::default(),
    };
    let here = job().run(&|_| true).unwrap();
    let bytes = postcard::to_allocvec(&job()).unwrap();
    let result = jobs::run::<LayOut>(&bytes, &|_| true).unwrap();
    let elsewhere: <LayOut as Job>::Result = postcard::from_bytes(&result).unwrap();
    assert_eq!(elsewhere.unwrap(), here);
}
