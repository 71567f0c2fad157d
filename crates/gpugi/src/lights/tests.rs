//! The light table, and the views that lights get.

use glam::{Vec2, Vec3, Vec4};
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Camera, Light, LightKind, Material, Scene};

use super::gpu::{LightSample, table};
use super::{LightList, MapSettings};
use crate::capture::View;
use crate::capture::depth::DepthViewUniform;
use crate::gpu::{Frame, Gpu, Kernel, read_buffer};
use crate::scene::GpuScene;
use crate::shader;
use crate::testing::test_gpu;

/// Rows of words that all differ from each other and from those of rows with another `first`: small normal floats.
fn distinct<T: bytemuck::Pod>(first: u32) -> T {
    let words: Vec<u32> = (0..size_of::<T>() as u32 / 4)
        .map(|word| 0x3f80_0000 + first + word)
        .collect();
    bytemuck::pod_read_unaligned(bytemuck::cast_slice(&words))
}

#[test]
fn the_table_is_read_as_it_is_written() {
    let Some(gpu) = test_gpu() else { return };
    let samples: [LightSample; 2] = [distinct(0), distinct(100)];
    let views: [DepthViewUniform; 3] = [distinct(200), distinct(300), distinct(400)];
    let rows = gpu.storage("table", &table(&samples, &views)).unwrap();
    let sample: &[u32] = bytemuck::cast_slice(&samples[1..]);
    let view: &[u32] = bytemuck::cast_slice(&views[1..2]);
    let expected = [sample, view].concat();
    let kernel = Kernel::new(&gpu, &shader!("testing.light_table"), "main", None).unwrap();
    let size = 4 * expected.len() as u64;
    let output = gpu
        .buffer("output", size, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let bind = |group, name, buffer: &wgpu::Buffer| {
        let resource = (name, buffer.as_entire_binding());
        kernel.bind(&gpu, group, &[resource]).unwrap()
    };
    let groups = [bind(0, "output", &output), bind(2, "light_table", &rows)];
    let mut frame = Frame::new(&gpu, false);
    frame.compute("lights", |pass| {
        kernel.dispatch(pass, &[(0, &groups[0]), (2, &groups[1])], [1, 1, 1]);
    });
    frame.submit().unwrap();
    assert_eq!(read_buffer::<u32>(&gpu, &output, size).unwrap(), expected);
}

/// A box of 8 m by 2 m by 6 m with some lights.
fn scene(lights: Vec<Light>) -> Scene {
    let mut scene = Scene::new("box");
    let mesh = scene.add_mesh(cuboid(
        Vec3::new(-3.0, 0.0, -2.0),
        Vec3::new(5.0, 2.0, 4.0),
        1,
    ));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("", mesh, material, glam::Mat4::IDENTITY);
    scene.lights = lights;
    scene
}

const SETTINGS: MapSettings = MapSettings {
    turn: None,
    resolution: 512,
    gutters: [4, 4],
    second_depth: false,
    warp: true,
    cascades: 4,
    area_samples: 64,
    area_resolution: 256,
    beyond_camera: false,
    unshadowed: false,
};

/// The light list for a camera that looks out of the scene.
fn list(gpu: &Gpu, scene: &Scene, settings: &MapSettings) -> LightList {
    let on_gpu = GpuScene::new(gpu, scene).unwrap();
    let away = Camera::look_at(
        "",
        Vec3::new(-3.5, 1.0, 0.0),
        Vec3::new(-9.0, 1.0, 0.0),
        0.8,
    );
    let view = View::new(&away, [64, 64], Vec2::ZERO, 0, 0, on_gpu.diagonal());
    LightList::new(&on_gpu, &view, settings)
}

#[test]
fn what_the_camera_does_not_see_is_in_the_last_view_of_each_light() {
    let Some(gpu) = test_gpu() else { return };
    let sun = Light::new("sun", LightKind::Directional, Vec3::ONE);
    let cone = LightKind::Spot {
        inner_cone_angle: 0.5,
        outer_cone_angle: 1.2,
    };
    let spot = Light::new("spot", cone, Vec3::ONE);
    let scene = scene(vec![
        sun.aimed(Vec3::new(1.0, 2.0, 0.7), Vec3::ZERO),
        spot.aimed(Vec3::new(1.0, 6.0, 1.0), Vec3::new(1.0, 0.0, 1.0)),
    ]);
    let of_camera = list(&gpu, &scene, &SETTINGS);
    let counts = |list: &LightList| -> Vec<u32> {
        list.samples.iter().map(|light| light.view_count).collect()
    };
    assert_eq!(counts(&of_camera), [4, 1]);
    let all = list(
        &gpu,
        &scene,
        &MapSettings {
            beyond_camera: true,
            ..SETTINGS
        },
    );
    assert_eq!(counts(&all), [5, 2]);
    for light in &all.samples {
        let last = &all.views[(light.first_view + light.view_count - 1) as usize];
        let mut reach = Vec2::ZERO;
        for corner in scene.bounds().corners() {
            let clip: Vec4 = last.clip_from_world * corner.extend(1.0);
            let at = clip.truncate() / clip.w;
            assert!(at.z > 0.0 && at.z < 1.0, "{corner} at {at}");
            assert!(at.truncate().abs().max_element() < 1.0, "{corner} at {at}");
            reach = reach.max(at.truncate().abs());
        }
        // The sun's view fits tightly, except for the gutter.
        if light.kind == LightSample::DIRECTIONAL {
            assert!(reach.min_element() > 0.98, "{reach}");
        }
    }
}

#[test]
fn maps_shrink_where_the_atlas_is_too_small() {
    let Some(gpu) = test_gpu() else { return };
    let lights = |count: usize| -> Vec<Light> {
        (0..count)
            .map(|index| {
                let at = Vec3::new(index as f32 * 0.02, 1.0, 0.0);
                let intensity = Vec3::splat(if index == 0 { 100.0 } else { 1.0 });
                Light::new("", LightKind::Point, intensity).aimed(at, Vec3::ZERO)
            })
            .collect()
    };
    let few = list(&gpu, &scene(lights(8)), &SETTINGS);
    assert!(few.notes.is_empty());
    assert!(few.views.iter().all(|view| view.size == [512, 512]));
    let many = list(&gpu, &scene(lights(256)), &SETTINGS);
    let side = |light: usize| many.views[6 * light].size[0];
    assert_eq!(side(0), 512, "the brightest");
    assert!((1..256).all(|light| side(light) == side(1)));
    assert!(side(1) > 150 && side(1) < 209, "{}", side(1));
    let note = format!(
        "256 lights share the shadow atlas: {} to 512 texels per face instead of 512",
        side(1)
    );
    assert_eq!(many.notes, [note]);
}

#[test]
fn area_samples_of_both_sides_share_the_atlas() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = scene(Vec::new());
    let lamp = Material {
        double_sided: true,
        ..Material::emitter("lamp", Vec3::ONE)
    };
    let lamp = scene.add_material(lamp);
    scene.instances[0].material = lamp;
    let settings = MapSettings {
        area_samples: 256,
        ..SETTINGS
    };
    let found = list(&gpu, &scene, &settings);
    assert_eq!((found.samples.len(), found.views.len()), (256, 2560));
    let side = found.views[0].size[0];
    assert!((128..256).contains(&side), "{side}");
    let note = format!(
        "256 samples of area lights share the shadow atlas: {side} texels per face instead of 256"
    );
    assert_eq!(found.notes, [note]);
}
