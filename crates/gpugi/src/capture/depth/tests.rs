//! Compute draws the same atlas as the hardware.

use glam::Vec3;
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Bounds, Scene};

use super::compute::DepthCompute;
use super::{DepthAtlas, DepthKernels, DepthViewSpec, Rasterizer};
use crate::gpu::{Frame, Gpu, TextureAspect, read_texture};
use crate::scene::GpuScene;
use crate::testing::{Random, test_gpu};

/// Views of a whole scene from all around.
fn around(scene: &GpuScene, count: u32, side: u32) -> Vec<DepthViewSpec> {
    let mut random = Random(3);
    (0..count)
        .map(|index| {
            // Include axis-aligned views, where every second edge runs through texel centres or beside them.
            let forward = match index {
                0 => Vec3::NEG_Y,
                1 => Vec3::X,
                _ => random.direction(),
            };
            DepthViewSpec::fitted(forward, &scene.bounds, side, 2)
        })
        .collect()
}

/// The atlas drawn by hardware and by compute, and its width.
fn both(
    gpu: &Gpu,
    scene: &mut GpuScene,
    specs: Vec<DepthViewSpec>,
    compute: &mut DepthCompute,
) -> ([Vec<f32>; 2], usize) {
    let kernels = DepthKernels::of_environment(gpu, scene).unwrap();
    let mut atlas = DepthAtlas::new(gpu, &kernels, specs).unwrap();
    let drawn = [false, true].map(|by_compute| {
        let mut frame = Frame::new(gpu, false);
        scene.merge(&mut frame);
        if by_compute {
            compute
                .record(&mut frame, "depth", &kernels, scene.casters(), &mut atlas)
                .unwrap();
        } else {
            atlas.record(&mut frame, "depth", &kernels, scene.casters());
        }
        frame.submit().unwrap();
        read_texture(gpu, &atlas.texture, TextureAspect::DepthOnly, 0, 0).unwrap()
    });
    (drawn, atlas.texture.width() as usize)
}

fn assert_alike(gpu: &Gpu, scene: &Scene, compute: &mut DepthCompute, count: u32, side: u32) {
    let mut uploaded = GpuScene::new(gpu, scene).unwrap();
    let specs = around(&uploaded, count, side);
    let ([hardware, compute], width) = both(gpu, &mut uploaded, specs, compute);
    let covered = hardware.iter().filter(|depth| **depth > 0.0).count();
    let range_around = |at: usize| {
        let near = [0, width, 2 * width].map(|row| (at + row).saturating_sub(width + 1));
        let near = near.into_iter().flat_map(|first| first..first + 3);
        let depths = near.filter_map(|neighbor| hardware.get(neighbor));
        depths.fold((1.0_f32, 0.0_f32), |(low, high), depth| {
            (low.min(*depth), high.max(*depth))
        })
    };
    // GPUs round corners to 1/256 of a texel, which changes depths on slopes. Three texels span two steps of a slope.
    let differing: Vec<usize> = (0..hardware.len())
        .filter(|&at| {
            let (low, high) = range_around(at);
            (hardware[at] - compute[at]).abs() > 1e-5 + (high - low) / 256.0
        })
        .collect();
    // It moves edges, too: a texel may have its neighbour's depth.
    let is_moved = |at: usize| {
        let (low, high) = range_around(at);
        (low - 1e-5..=high + 1e-5).contains(&compute[at])
    };
    let moved = differing.iter().filter(|at| is_moved(**at)).count();
    let wrong = differing.len() - moved;
    println!(
        "{}: {covered} texels of {} covered, {moved} moved, {wrong} wrong",
        scene.name,
        hardware.len()
    );
    assert!(covered * 4 > hardware.len() / 2, "the views see the scene");
    assert!(moved * 1000 <= covered, "{moved} of {covered}");
    assert!(wrong * 1000 <= covered, "{wrong} of {covered}");
}

#[test]
fn compute_draws_what_the_hardware_draws() {
    let Some(gpu) = test_gpu() else { return };
    let mut compute = DepthCompute::new(&gpu).unwrap();
    // `shapes` has see-through surfaces and triangles of every size.
    for (name, detail, side) in [
        ("room", 1, 128),
        ("spheres", 2, 128),
        ("teapot", 2, 200),
        ("shapes", 1, 96),
    ] {
        let scene = builtin(name, detail).unwrap();
        assert_alike(&gpu, &scene, &mut compute, 6, side);
    }
}

#[test]
fn bands_and_dispatches_make_one_atlas() {
    let Some(gpu) = test_gpu() else { return };
    let mut compute = DepthCompute::new(&gpu).unwrap();
    // Two rows of tiles per band, a few hundred triangles per dispatch, and more views than an invocation takes.
    compute.band_texels = 2 * 64 * 640;
    compute.dispatch_triangles = 4096;
    let scene = builtin("spheres", 1).unwrap();
    assert_alike(&gpu, &scene, &mut compute, 90, 64);
}

#[test]
fn fitted_views_hold_the_scene_and_little_else() {
    let mut random = Random(5);
    let bounds = Bounds {
        min: Vec3::new(-4.0, 0.0, 1.0),
        max: Vec3::new(4.0, 0.5, 2.0),
    };
    for index in 0..200 {
        let forward = match index {
            0 => Vec3::Y,
            1 => Vec3::NEG_Z,
            _ => random.direction(),
        };
        let spec = DepthViewSpec::fitted(forward, &bounds, 64, 2);
        assert!(DepthCompute::can_draw(&spec, &bounds));
        let corners = bounds.corners().map(|corner| {
            let clip = spec.clip_from_world * corner.extend(1.0);
            assert_eq!(clip.w, 1.0);
            clip.truncate()
        });
        let seen = Bounds::of(corners);
        // Everything but the gutter of two texels and a hundredth of the depth.
        let inner = 60.0 / 64.0;
        for (found, expected) in [
            (seen.min, Vec3::new(-inner, -inner, 0.005)),
            (seen.max, Vec3::new(inner, inner, 0.995)),
        ] {
            assert!(found.abs_diff_eq(expected, 1e-3), "{forward}: {seen:?}");
        }
        // Depth is greater nearer to the light.
        let depth = |point: Vec3| spec.clip_from_world.row(2).dot(point.extend(1.0));
        assert!(depth(bounds.center()) > depth(bounds.center() + forward * 0.1));
    }
    // An empty scene has views, too.
    let empty = DepthViewSpec::fitted(Vec3::X, &Bounds::EMPTY, 16, 2);
    assert!(empty.clip_from_world.is_finite());
    // Compute does not draw back faces.
    let turned = DepthViewSpec {
        second_depth: true,
        ..DepthViewSpec::fitted(Vec3::X, &bounds, 64, 2)
    };
    assert!(!DepthCompute::can_draw(&turned, &bounds));
    // Compute cannot draw what extends beyond a view.
    let smaller = DepthViewSpec::fitted(Vec3::X, &bounds, 64, 2);
    let larger = Bounds {
        max: bounds.max + Vec3::Y,
        ..bounds
    };
    assert!(!DepthCompute::can_draw(&smaller, &larger));
}

#[test]
fn small_triangles_are_told_from_large_ones() {
    let Some(gpu) = test_gpu() else { return };
    let scene = GpuScene::new(&gpu, &builtin("spheres", 1).unwrap()).unwrap();
    let kernels = DepthKernels::of_environment(&gpu, &scene).unwrap();
    for (side, by_compute) in [(64, true), (256, true), (2048, false)] {
        let specs = around(&scene, 2, side);
        let atlas = DepthAtlas::new(&gpu, &kernels, specs).unwrap();
        let found = super::rasterizer::by_compute(scene.casters(), &atlas, Rasterizer::Auto);
        assert_eq!(found, by_compute, "maps of {side} texels");
    }
}

#[cfg(feature = "meshopt")]
mod simplified {
    use super::super::{DepthDrawing, DepthRasterizer};
    use super::*;
    use crate::scene::{CasterGeometry, Draw, SimplifiedCasters};

    /// What a rasterizer draws of a scene from all around.
    fn drawn(
        gpu: &Gpu,
        rasterizer: &mut DepthRasterizer,
        scene: &GpuScene,
        drawing: DepthDrawing,
    ) -> Vec<f32> {
        let specs = around(scene, 4, 128);
        let mut atlas = DepthAtlas::new(gpu, &rasterizer.kernels, specs).unwrap();
        let mut frame = Frame::new(gpu, false);
        while !rasterizer
            .prepare(&mut frame, scene, drawing.caster_detail)
            .unwrap()
        {
            frame.submit().unwrap();
            gpu.wait().unwrap();
            frame = Frame::new(gpu, false);
        }
        rasterizer
            .record(&mut frame, "depth", scene, &mut atlas, drawing)
            .unwrap();
        frame.submit().unwrap();
        read_texture(gpu, &atlas.texture, TextureAspect::DepthOnly, 0, 0).unwrap()
    }

    /// Casters with a quarter of the triangles.
    fn quarter_of(gpu: &Gpu, scene: &GpuScene) -> SimplifiedCasters {
        let mut frame = Frame::new(gpu, false);
        let geometry = CasterGeometry::read_back(&mut frame, scene).unwrap();
        frame.submit().unwrap();
        gpu.wait().unwrap();
        SimplifiedCasters::new(gpu, scene, 0.25, &geometry)
            .unwrap()
            .unwrap()
    }

    #[test]
    fn simplified_casters_are_fewer_and_cast_nearly_the_same() {
        let Some(gpu) = test_gpu() else { return };
        let before = builtin("spheres", 1).unwrap();
        let mut scene = GpuScene::new(&gpu, &before).unwrap();
        let mut rasterizer = DepthRasterizer::new(&gpu, &scene).unwrap();
        let merge = |scene: &mut GpuScene| {
            let mut frame = Frame::new(&gpu, false);
            scene.merge(&mut frame);
            frame.submit().unwrap();
        };
        merge(&mut scene);
        let mut quarter = quarter_of(&gpu, &scene);
        let count = |draws: &[Draw]| draws.iter().map(|draw| draw.indices.len()).sum::<usize>();
        let left = count(quarter.casters(&scene).draws) as f32 / count(&scene.draws) as f32;
        assert!((0.2..0.3).contains(&left), "{left} of the triangles");
        let indices = quarter.casters(&scene).indices.clone();
        let of = |rasterizer, caster_detail| DepthDrawing {
            rasterizer,
            caster_detail,
        };
        let mut far_off = |scene: &GpuScene, other: Rasterizer, detail: f32| {
            let exact = drawn(&gpu, &mut rasterizer, scene, of(Rasterizer::Hardware, 1.0));
            let coarse = drawn(&gpu, &mut rasterizer, scene, of(other, detail));
            let covered = exact.iter().filter(|depth| **depth > 0.0).count();
            let off = exact
                .iter()
                .zip(&coarse)
                .filter(|(a, b)| (**a - **b).abs() > 0.01);
            (off.count() as f64 / covered as f64, exact != coarse)
        };
        for other in [Rasterizer::Hardware, Rasterizer::Compute] {
            let (off, differs) = far_off(&scene, other, 0.25);
            assert!(differs && off < 0.02, "{other:?}: {off}");
        }
        // Simplified casters follow instances that move, without being simplified again.
        let mut after = before.clone();
        for instance in &mut after.instances {
            instance.world_from_mesh =
                glam::Mat4::from_translation(Vec3::new(0.0, 5.0, 0.0)) * instance.world_from_mesh;
        }
        scene.update(&gpu, &after).unwrap();
        merge(&mut scene);
        assert!(quarter.serve(&scene, 0.25) && !quarter.serve(&scene, 0.5));
        quarter.follow(&scene);
        let moved = quarter;
        assert_eq!(*moved.casters(&scene).indices, indices);
        assert!(moved.casters(&scene).draws[0].bounds.min.y > 4.0);
        let (off, differs) = far_off(&scene, Rasterizer::Compute, 0.25);
        assert!(differs && off < 0.02, "{off}");
        // Other meshes are simplified again.
        let other = builtin("spheres", 2).unwrap();
        scene.update(&gpu, &other).unwrap();
        merge(&mut scene);
        assert!(!moved.serve(&scene, 0.25));
        let new = quarter_of(&gpu, &scene);
        assert_ne!(*new.casters(&scene).indices, indices);
        let (off, differs) = far_off(&scene, Rasterizer::Hardware, 0.25);
        assert!(differs && off < 0.02, "{off}");
    }
}
