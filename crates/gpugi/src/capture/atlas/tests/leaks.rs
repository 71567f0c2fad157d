//! Points inside other objects, and filled gutters.

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Material, Scene};

use super::{NONE, atlas, boxes, unpacked};
use crate::capture::Target;
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, Dilation, LeakReport, LeakTest};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::scene::GpuScene;
use crate::testing::test_gpu;

const SIZE: u32 = 128;

/// The report and the points of an atlas after the test.
fn tested(gpu: &Gpu, scene: &Scene) -> (LeakReport, Vec<super::Point>, Vec<u8>) {
    let on_gpu = GpuScene::new(gpu, scene).unwrap();
    let rays = GpuScene::with_rays(gpu, scene).unwrap();
    let atlas = atlas(scene, SIZE);
    let options = AtlasCaptureOptions {
        // Forces more than one piece.
        most_texels: SIZE * SIZE / 2,
        ..Default::default()
    };
    let mut capture = AtlasCapture::new(gpu, scene, &on_gpu, &atlas, &options).unwrap();
    let mut test = LeakTest::new(gpu, &rays, &capture).unwrap();
    // Running it a second time changes nothing.
    for _ in 0..2 {
        let mut frame = Frame::new(gpu, false);
        capture.record(&mut frame, &on_gpu).unwrap();
        test.record(&mut frame, &rays, &capture);
        frame.submit().unwrap();
    }
    let report = test.report(gpu).unwrap();
    let map = test.map(gpu).unwrap().into_flattened();
    (report, unpacked(gpu, &on_gpu, &capture), map)
}

/// A box standing on a floor.
fn box_on_floor(material: Material) -> Scene {
    let mut scene = Scene::new("box on floor");
    let floor = shapes::cuboid(Vec3::new(-1.0, -0.1, -1.0), Vec3::new(1.0, 0.0, 1.0), 1);
    let block = shapes::cuboid(Vec3::new(-0.4, 0.0, -0.4), Vec3::new(0.4, 0.5, 0.4), 1);
    for (name, mesh, material) in [
        ("floor", floor, Material::matt("grey", Vec3::splat(0.5))),
        ("box", block, material),
    ] {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(material);
        scene.add_instance(name, mesh, material, Mat4::IDENTITY);
    }
    scene
}

/// Area of the points on the floor's upper side (m^2).
fn area_of_top(points: &[super::Point]) -> f32 {
    let top = |point: &&super::Point| point.instance == 0 && point.normal.y > 0.5;
    points.iter().filter(top).map(|point| point.area).sum()
}

#[test]
fn points_inside_things_are_moved_out_or_taken_away() {
    let Some(gpu) = test_gpu() else { return };
    let grey = || Material::matt("grey", Vec3::splat(0.5));
    let (report, points, map) = tested(&gpu, &box_on_floor(grey()));
    let all = report.empty + report.good + report.moved + report.invalid;
    assert_eq!(all, u64::from(SIZE * SIZE));
    assert!(report.moved > 0 && report.invalid > 50, "{report:?}");
    let under = |at: Vec3| at.y.abs() < 1e-4 && at.x.abs().max(at.z.abs()) < 0.4 - 1e-5;
    for point in &points {
        // The box's own underside lies in the floor's plane.
        if point.instance == 0 && point.normal.y > 0.5 {
            assert!(!under(point.position), "{point:?}");
        }
    }
    // The box covers 0.64 of 4 m^2; texels at its border keep their area.
    let left = area_of_top(&points);
    assert!((3.34..3.6).contains(&left), "{left} m^2");
    let count = |color: [u8; 4]| map.chunks(4).filter(|&pixel| pixel == color).count() as u64;
    assert_eq!(count([230, 0, 0, 255]), report.invalid);
    assert_eq!(count([0, 200, 0, 255]), report.moved);
    assert_eq!(count([0; 4]), report.empty);
    let instances = points.iter().filter(|point| point.instance != NONE).count() as u64;
    assert_eq!(instances, report.good + report.moved);
}

#[test]
fn light_under_glass_and_between_boxes_is_no_leak() {
    let Some(gpu) = test_gpu() else { return };
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        ..Material::default()
    };
    // The floor is visible through the box, whose own underside lies in the floor.
    let (_, points, _) = tested(&gpu, &box_on_floor(glass));
    assert!((area_of_top(&points) - 4.0).abs() < 1e-3);
    let (report, _, _) = tested(&gpu, &boxes());
    assert_eq!((report.moved, report.invalid), (0, 0));
    assert!(report.good > 1000);
}

#[test]
fn dilation_fills_what_is_empty_and_nothing_else() {
    let Some(gpu) = test_gpu() else { return };
    for [width, height] in [[64, 64], [37, 90], [1, 5], [1, 1], [610, 300]] {
        let dilation = Dilation::new(&gpu, [width, height]).unwrap();
        // Two colours, left and right, as sums of three samples; holes between them and in the middle of each.
        let colors = [[3.0, 0.0, 6.0_f32], [0.0, 9.0, 0.0]];
        let texel = |index: u32| {
            let (x, y) = (index % width, index / width);
            let half = usize::from(2 * x >= width);
            let is_hole = x.abs_diff(width / 2) < 4 || y % 9 > 5;
            let [r, g, b] = colors[half];
            if is_hole { [0.0; 4] } else { [r, g, b, 3.0] }
        };
        let before: Vec<[f32; 4]> = (0..width * height).map(texel).collect();
        let target = Target::new(&gpu, width * height).unwrap();
        gpu.write(&target.radiance, 0, &before);
        let mut frame = Frame::new(&gpu, false);
        dilation.record(&mut frame, &target).unwrap();
        frame.submit().unwrap();
        let size = u64::from(width * height) * 16;
        let after: Vec<[f32; 4]> = read_buffer(&gpu, &target.radiance, size).unwrap();
        let any = before.iter().any(|texel| texel[3] > 0.0);
        for (index, (before, after)) in before.iter().zip(&after).enumerate() {
            if before[3] > 0.0 || !any {
                assert_eq!(before, after);
                continue;
            }
            assert_eq!(after[3], 1.0);
            // Between the two colours; far from the middle, close to the colour of its own side.
            let share = after[1] / 3.0;
            let sum = [1.0 - share, 3.0 * share, 2.0 * (1.0 - share)];
            for (found, wanted) in after.iter().zip(sum) {
                assert!((found - wanted).abs() < 1e-4, "{after:?}");
            }
            let (x, y) = (index as u32 % width, index as u32 / width);
            // A texel that touches only one colour has that colour alone.
            let beside = (x.saturating_sub(1)..=(x + 1).min(width - 1))
                .flat_map(|x| (y.saturating_sub(1)..=(y + 1).min(height - 1)).map(move |y| (x, y)))
                .map(|(x, y)| texel(y * width + x))
                .filter(|texel| texel[3] > 0.0);
            let greens: Vec<f32> = beside.map(|[_, green, ..]| green / 9.0).collect();
            if let Some(&green) = greens.first()
                && greens.iter().all(|other| *other == green)
            {
                assert!((share - green).abs() < 1e-5, "{x}, {y}: {after:?}");
            }
            if width > 30 && x.abs_diff(width / 2) > 16 {
                let wanted = f32::from(u8::from(2 * x >= width));
                assert!((share - wanted).abs() < 0.02, "{index}: {after:?}");
            }
        }
    }
}
