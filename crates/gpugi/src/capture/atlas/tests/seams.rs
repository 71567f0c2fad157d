//! Seams of images on the GPU.

use glam::{Mat4, Vec3};
use gpugi_scene::atlas::Seams;
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Material, Scene};

use super::atlas;
use crate::capture::Target;
use crate::capture::atlas::SeamFilter;
use crate::gpu::{Frame, read_buffer};
use crate::testing::{Random, test_gpu};

#[test]
fn both_sides_of_seams_agree_and_nothing_else_changes() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("ball");
    let mesh = scene.add_mesh(shapes::sphere(1.0, 16));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("ball", mesh, material, Mat4::IDENTITY);
    let atlas = atlas(&scene, 64);
    let seams = Seams::new(&scene, &atlas);
    assert!(!seams.is_empty());
    // Stripes far apart, and noise.
    let mut random = Random(1);
    let mut number = || random.next() as f32;
    let texels: Vec<[f32; 4]> = (0..64 * 64)
        .map(|index| {
            let chart = [index / 20 % 3, index / 700 % 2].map(|step| step as f32);
            [chart[0] + 0.1 * number(), chart[1], number() + 1.0, 1.0]
        })
        .collect();
    let storage = wgpu::BufferUsages::STORAGE;
    let image = gpu.buffer_with("image", &texels, storage).unwrap();
    let image = Target::of(&gpu, image).unwrap();
    let filter = SeamFilter::new(&gpu, &seams, &image).unwrap();
    let mut frame = Frame::new(&gpu, false);
    filter.record(&mut frame);
    frame.submit().unwrap();
    let after: Vec<[f32; 4]> = read_buffer(&gpu, &image.radiance, 64 * 64 * 16).unwrap();
    let colors = |texels: &[[f32; 4]]| -> Vec<Vec3> {
        let texels = texels.iter();
        texels.map(|[r, g, b, _]| Vec3::new(*r, *g, *b)).collect()
    };
    let [before, after] = [&texels, &after].map(|texels| colors(texels));
    let differences = [&before, &after].map(|image| seams.difference(image));
    let mut solved = before.clone();
    seams.smooth(&mut solved);
    let change = |image: &[Vec3]| {
        let pairs = image.iter().zip(&before);
        let sum: f32 = pairs.map(|(a, b)| a.distance_squared(*b)).sum();
        sum.sqrt()
    };
    let changes = [&after, &solved].map(|image| change(image));
    println!(
        "{differences:?}, solved {}; changed by {changes:?}",
        seams.difference(&solved)
    );
    assert!(differences[1] < 0.15 * differences[0], "{differences:?}");
    assert!(changes[0] < 1.3 * changes[1], "{changes:?}");
    for (index, (before, after)) in before.iter().zip(&after).enumerate() {
        let is_beside = seams.texels().contains(&(index as u32));
        assert!(is_beside || before == after, "texel {index}");
        assert!(after.min_element() >= 0.0, "texel {index}: {after}");
    }
}
