//! Texels of an atlas against double precision on the host.

mod alpha;
mod leaks;
mod seams;

use crate::capture::{Output, Receiver};
use glam::{DVec2, DVec3, Mat4, Quat, Vec2, Vec3};
use gpugi_scene::atlas::{AtlasOptions, NO_CHART, TexelDensity};
use gpugi_scene::builtin::{builtin, shapes};
use gpugi_scene::{
    Atlas, Camera, Environment, InstanceUvs, Light, LightKind, Material, Mesh, Scene,
};

use super::{AtlasCapture, AtlasCaptureOptions};
use crate::capture::{CaptureKernels, Emission, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::scene::GpuScene;
use crate::techniques::shadow_map::ShadowMap;
use crate::techniques::{Earlier, EarlierLight, Shared, Technique};
use crate::testing::{Point, Random, read_points, test_gpu};

const NONE: u32 = u32::MAX;

/// The atlas's points, of all pieces in order.
fn captured(gpu: &Gpu, scene: &Scene, atlas: &Atlas, options: &AtlasCaptureOptions) -> Vec<Point> {
    let on_gpu = GpuScene::new(gpu, scene).unwrap();
    let mut capture = AtlasCapture::new(gpu, scene, &on_gpu, atlas, options).unwrap();
    let mut frame = Frame::new(gpu, false);
    capture.record(&mut frame, &on_gpu).unwrap();
    frame.submit().unwrap();
    unpacked(gpu, &on_gpu, &capture)
}

fn unpacked(gpu: &Gpu, on_gpu: &GpuScene, capture: &AtlasCapture) -> Vec<Point> {
    let pieces = capture.points();
    pieces
        .flat_map(|points| read_points(gpu, on_gpu, points))
        .collect()
}

fn atlas(scene: &Scene, size: u32) -> Atlas {
    let options = AtlasOptions {
        size,
        ..Default::default()
    };
    Atlas::new(scene, &options).unwrap()
}

/// World-space corners of an instance's triangles.
fn triangles(scene: &Scene, instance: usize) -> Vec<[DVec3; 3]> {
    let placed = &scene.instances[instance];
    let mesh = &scene.meshes[placed.mesh];
    let corner = |index: u32| {
        let at = mesh.positions[index as usize].as_dvec3();
        placed.world_from_mesh.as_dmat4().transform_point3(at)
    };
    let triangles = mesh.indices.as_chunks::<3>().0.iter();
    triangles.map(|triangle| triangle.map(corner)).collect()
}

fn world_area([a, b, c]: [DVec3; 3]) -> f64 {
    (b - a).cross(c - a).length() / 2.0
}

fn doubled_area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// The part of a polygon on the side of a line where `value` is positive.
fn clipped(polygon: &[DVec2], value: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::new();
    for (index, &p) in polygon.iter().enumerate() {
        let q = polygon[(index + 1) % polygon.len()];
        let (at_p, at_q) = (value(p), value(q));
        if at_p >= 0.0 {
            kept.push(p);
        }
        if (at_p < 0.0) != (at_q < 0.0) {
            kept.push(p + (q - p) * (at_p / (at_p - at_q)));
        }
    }
    kept
}

fn area_in_texel(corners: [DVec2; 3], x: u32, y: u32) -> f64 {
    let (x, y) = (f64::from(x), f64::from(y));
    let polygon = clipped(&corners, |p| p.x - x);
    let polygon = clipped(&polygon, |p| x + 1.0 - p.x);
    let polygon = clipped(&polygon, |p| p.y - y);
    let polygon = clipped(&polygon, |p| y + 1.0 - p.y);
    let fans = (2..polygon.len()).map(|i| doubled_area(polygon[0], polygon[i - 1], polygon[i]));
    fans.sum::<f64>().abs() / 2.0
}

/// The point of a triangle nearest to `p`, as weights of its corners, and its distance.
fn nearest(corners: [DVec2; 3], p: DVec2) -> ([f64; 3], f64) {
    let [a, b, c] = corners;
    let whole = doubled_area(a, b, c);
    let weights = [
        doubled_area(p, b, c) / whole,
        doubled_area(p, c, a) / whole,
        doubled_area(p, a, b) / whole,
    ];
    if weights.iter().all(|&weight| weight >= 0.0) {
        return (weights, 0.0);
    }
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(from, to)| {
        let (q, r) = (corners[from], corners[to]);
        let share = ((p - q).dot(r - q) / (r - q).length_squared()).clamp(0.0, 1.0);
        let mut weights = [0.0; 3];
        weights[from] = 1.0 - share;
        weights[to] = share;
        (weights, p.distance(q + (r - q) * share))
    });
    let [first, second, third] = edges;
    [second, third].into_iter().fold(
        first,
        |best, edge| if edge.1 < best.1 { edge } else { best },
    )
}

/// Boxes of several sizes, rotated, stretched and mirrored, and a sphere.
fn boxes() -> Scene {
    let mut scene = Scene::new("boxes");
    let mesh = scene.add_mesh(shapes::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 3));
    let material = scene.add_material(Material::matt("grey", Vec3::new(0.5, 0.25, 0.75)));
    let turned = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, -0.4);
    for (number, scale) in [
        Vec3::ONE,
        Vec3::splat(-0.6),
        Vec3::new(1.5, 0.2, 0.8),
        Vec3::splat(0.1),
    ]
    .into_iter()
    .enumerate()
    {
        let at = Vec3::X * 2.0 * number as f32;
        let matrix = Mat4::from_scale_rotation_translation(scale, turned, at);
        scene.add_instance("box", mesh, material, matrix);
    }
    scene
}

#[test]
fn texels_show_the_nearest_point_and_hold_what_covers_them() {
    let Some(gpu) = test_gpu() else { return };
    const SIZE: u32 = 128;
    let scene = boxes();
    let atlas = atlas(&scene, SIZE);
    let points = captured(&gpu, &scene, &atlas, &AtlasCaptureOptions::default());
    assert_eq!(points.len(), (SIZE * SIZE) as usize);
    // Per texel: its area, and its candidates as (distance, position, normal, instance).
    let mut areas = vec![0.0; points.len()];
    let mut candidates: Vec<Vec<(f64, DVec3, DVec3, u32)>> = vec![Vec::new(); points.len()];
    for (index, uvs) in atlas.instances.iter().enumerate() {
        let uvs = uvs.as_ref().unwrap();
        let mirrored = scene.instances[index].world_from_mesh.determinant() < 0.0;
        for (corners, world) in
            (uvs.corners.as_chunks::<3>().0.iter()).zip(triangles(&scene, index))
        {
            let on_page = corners.map(|uv| (uv * SIZE as f32).as_dvec2());
            let per_texel =
                world_area(world) / (doubled_area(on_page[0], on_page[1], on_page[2]) / 2.0);
            let low = on_page[0].min(on_page[1]).min(on_page[2]);
            let high = on_page[0].max(on_page[1]).max(on_page[2]);
            for y in low.y as u32..=high.y as u32 {
                for x in low.x as u32..=high.x as u32 {
                    let covered = area_in_texel(on_page, x, y);
                    let texel = (y * SIZE + x) as usize;
                    areas[texel] += covered * per_texel;
                    if covered > 1e-4 {
                        let middle = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                        let (weights, distance) = nearest(on_page, middle);
                        let at = (0..3).map(|corner| world[corner] * weights[corner]).sum();
                        let normal = (world[1] - world[0]).cross(world[2] - world[0]).normalize();
                        let normal = if mirrored { -normal } else { normal };
                        candidates[texel].push((distance, at, normal, index as u32));
                    }
                }
            }
        }
    }
    let mut outside = 0;
    for (texel, point) in points.iter().enumerate() {
        if point.instance == NONE {
            assert!(candidates[texel].is_empty(), "texel {texel} is left out");
            continue;
        }
        let scale = 4.0 / f64::from(SIZE);
        let error = (f64::from(point.area) - areas[texel]).abs();
        assert!(
            error < 2e-3 * scale * scale,
            "texel {texel}: {point:?}, not {}",
            areas[texel]
        );
        // Corners are snapped to 2^-10 texels: a texel that is barely touched may or may not count.
        let Some(least) = candidates[texel]
            .iter()
            .map(|candidate| candidate.0)
            .reduce(f64::min)
        else {
            assert!(areas[texel] < 1e-3 * scale * scale);
            continue;
        };
        outside += usize::from(least > 0.0);
        let position = point.position.as_dvec3();
        let found = candidates[texel]
            .iter()
            .any(|&(distance, at, normal, instance)| {
                distance < least + 5e-3
                    && at.distance(position) < 5e-3 * scale
                    && normal.distance(point.normal.as_dvec3()) < 1e-3
                    && instance == point.instance
            });
        assert!(found, "texel {texel}: {point:?} of {:?}", candidates[texel]);
    }
    assert!(
        outside > 50,
        "{outside} texels are touched outside their middles"
    );
}

#[test]
fn areas_add_up_to_the_scene() {
    let Some(gpu) = test_gpu() else { return };
    for (name, size) in [
        ("cornell", 128),
        ("teapot", 64),
        ("chamber", 256),
        ("boxes", 16),
    ] {
        let scene = builtin(name, 1).unwrap_or_else(boxes);
        let layout = match name {
            // So coarse that most triangles are smaller than texels.
            "boxes" => Atlas::new(
                &scene,
                &AtlasOptions {
                    size,
                    density: TexelDensity::PerMetre(2.0),
                    gutter: 1,
                    ..Default::default()
                },
            )
            .unwrap(),
            _ => atlas(&scene, size),
        };
        let points = captured(&gpu, &scene, &layout, &AtlasCaptureOptions::default());
        for index in 0..scene.instances.len() {
            let is_of = |point: &&Point| point.instance == index as u32;
            let found: f64 = points
                .iter()
                .filter(is_of)
                .map(|point| f64::from(point.area))
                .sum();
            let wanted: f64 = triangles(&scene, index).into_iter().map(world_area).sum();
            assert!(
                (found / wanted - 1.0).abs() < 1e-4,
                "{name} {index}: {found}, not {wanted}"
            );
        }
    }
}

#[test]
fn pieces_are_the_whole_cut_and_the_same_every_time() {
    let Some(gpu) = test_gpu() else { return };
    let scene = boxes();
    let options = AtlasOptions {
        size: 64,
        density: TexelDensity::PerMetre(16.0),
        ..Default::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    assert!(atlas.pages > 1);
    let whole = captured(&gpu, &scene, &atlas, &AtlasCaptureOptions::default());
    assert_eq!(whole.len() as u32, atlas.pages * 64 * 64);
    for most_texels in [64 * 64, 64 * 13, 64] {
        let options = AtlasCaptureOptions {
            most_texels,
            ..Default::default()
        };
        assert!(
            captured(&gpu, &scene, &atlas, &options) == whole,
            "{most_texels}"
        );
    }
    let on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let tiny = AtlasCaptureOptions {
        most_texels: 63,
        ..Default::default()
    };
    let refused = AtlasCapture::new(&gpu, &scene, &on_gpu, &atlas, &tiny);
    assert!(matches!(
        refused,
        Err(GpuError::TooLarge {
            needed: 64,
            limit: 63,
            ..
        })
    ));
}

/// A mesh of triangles without shared vertices.
fn soup(corners: Vec<Vec3>) -> Scene {
    let mut scene = Scene::new("soup");
    let mesh = scene.add_mesh(Mesh {
        normals: vec![Vec3::Z; corners.len()],
        indices: (0..corners.len() as u32).collect(),
        positions: corners,
        ..Default::default()
    });
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("soup", mesh, material, Mat4::IDENTITY);
    scene
}

fn handmade(corners: Vec<Vec2>, size: u32) -> Atlas {
    Atlas {
        size,
        pages: 1,
        instances: vec![Some(InstanceUvs {
            page: 0,
            charts: vec![0; corners.len() / 3],
            corners,
        })],
        backs: Vec::new(),
    }
}

#[test]
fn the_lowest_of_equally_near_triangles_owns_a_texel() {
    let Some(gpu) = test_gpu() else { return };
    // Twenty triangles at different heights over the same texels, in shuffled order.
    let corners: Vec<Vec3> = (0..20)
        .flat_map(|height| {
            let up = Vec3::Z * height as f32;
            [up, up + Vec3::X, up + Vec3::Y]
        })
        .collect();
    let place = [Vec2::splat(0.1), Vec2::new(0.9, 0.1), Vec2::new(0.1, 0.9)];
    let points = captured(
        &gpu,
        &soup(corners),
        &handmade(place.repeat(20), 32),
        &AtlasCaptureOptions::default(),
    );
    assert!(points.iter().all(|point| point.position.z == 0.0));
    let area: f32 = points.iter().map(|point| point.area).sum();
    assert!((area - 10.0).abs() < 1e-3, "{area}");
}

#[test]
fn triangles_without_texels_of_their_own_keep_their_area() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(3);
    let mut corners = Vec::new();
    let mut places = Vec::new();
    for index in 0..200 {
        corners.extend([Vec3::ZERO, Vec3::X * 0.1, Vec3::Y * 0.1]);
        let at = Vec2::new(random.next() as f32, random.next() as f32);
        // A point, a line, and a triangle far smaller than a texel.
        let far = [Vec2::ZERO, Vec2::X * 0.2, Vec2::splat(3e-3)][index % 3];
        let side = if index % 3 == 2 { Vec2::X * 3e-3 } else { far };
        let clamp = |uv: Vec2| uv.clamp(Vec2::ZERO, Vec2::ONE);
        places.extend([at, clamp(at + far), clamp(at + side)]);
    }
    // Exactly on the corner of the page.
    places[599] = Vec2::ONE;
    let mut atlas = handmade(places, 16);
    atlas.instances[0].as_mut().unwrap().charts[0] = NO_CHART;
    let points = captured(
        &gpu,
        &soup(corners),
        &atlas,
        &AtlasCaptureOptions::default(),
    );
    let area: f32 = points.iter().map(|point| point.area).sum();
    assert!((area - 1.0).abs() < 1e-3, "{area}");
    assert!(
        points
            .iter()
            .all(|point| point.position.is_finite() && point.normal.is_finite())
    );
}

/// The light that a technique and the frame's own pass add to the texels of all pieces.
fn lit(
    gpu: &Gpu,
    scene: &Scene,
    atlas: &Atlas,
    options: &AtlasCaptureOptions,
) -> (Vec<Point>, Vec<[f32; 4]>) {
    let mut on_gpu = GpuScene::new(gpu, scene).unwrap();
    let mut capture = AtlasCapture::new(gpu, scene, &on_gpu, atlas, options).unwrap();
    let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
    let mut shared = Shared::new(gpu, &on_gpu, &kernels).unwrap();
    let mut emission = Emission::new(gpu, &on_gpu).unwrap();
    let mut technique = ShadowMap::new(gpu, &on_gpu).unwrap();
    let view = View::new(
        &Camera::look_at("", Vec3::ONE, Vec3::ZERO, 1.0),
        [8; 2],
        Vec2::ZERO,
        0,
        0,
        1.0,
    );
    let mut frame = Frame::new(gpu, false);
    on_gpu.merge(&mut frame);
    capture.record(&mut frame, &on_gpu).unwrap();
    let mut unused = Emission::new(gpu, &on_gpu).unwrap();
    let mut nothing = Earlier::unlimited(EarlierLight::new(&mut unused, &mut []), &mut shared);
    technique
        .generate(&mut frame, &on_gpu, &view, &mut nothing)
        .unwrap();
    let mut targets = Vec::new();
    for points in capture.points() {
        let target = Target::new(gpu, points.count).unwrap();
        let receiver = Receiver::new(points, &target);
        emission.record(&mut frame, &on_gpu, &receiver).unwrap();
        technique
            .gather(&mut frame, &on_gpu, &receiver, &mut nothing)
            .unwrap();
        targets.push((target, points.count));
    }
    frame.submit().unwrap();
    let read = |(target, count): &(Target, u32)| -> Vec<[f32; 4]> {
        read_buffer(gpu, &target.radiance, u64::from(*count) * 16).unwrap()
    };
    let radiance = targets.iter().flat_map(read).collect();
    (unpacked(gpu, &on_gpu, &capture), radiance)
}

#[test]
fn gathers_light_texels_as_they_light_pixels() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = boxes();
    scene.instances.truncate(1);
    scene.environment = Some(Environment::default_sky());
    let intensity = Vec3::new(3.0, 2.0, 1.0);
    let lamp = Vec3::new(2.0, 3.0, 2.5);
    let light = Light::new("lamp", LightKind::Point, intensity);
    scene.lights.push(light.aimed(lamp, Vec3::ZERO));
    let atlas = atlas(&scene, 64);
    for (output, most_texels) in [(Output::RadianceToEye, u32::MAX), (Output::Irradiance, 640)] {
        let (points, radiance) = lit(
            &gpu,
            &scene,
            &atlas,
            &AtlasCaptureOptions {
                output,
                most_texels,
                ..Default::default()
            },
        );
        let albedo = Vec3::new(0.5, 0.25, 0.75);
        let response = match output {
            Output::Irradiance => Vec3::ONE,
            _ => albedo / std::f32::consts::PI,
        };
        let mut bright = 0;
        for (point, found) in points.iter().zip(&radiance) {
            if point.instance == NONE {
                assert_eq!(found, &[0.0; 4]);
                continue;
            }
            assert_eq!(found[3], 1.0);
            assert!(point.diffuse.abs_diff_eq(albedo, 0.01), "{point:?}");
            // The box is convex, so nothing else casts shadows.
            let away = lamp - point.position;
            let cosine = point.normal.dot(away.normalize()).max(0.0);
            let wanted = response * intensity * (cosine / away.length_squared());
            let found = Vec3::new(found[0], found[1], found[2]);
            let error = (found - wanted).length() / wanted.length().max(0.01);
            assert!(error < 0.02, "{point:?}: {found}, not {wanted}");
            bright += u32::from(wanted.x > 0.01);
        }
        assert!(bright > 300, "{bright}");
    }
}

#[test]
fn points_follow_what_moves_and_refuse_other_triangles() {
    let Some(gpu) = test_gpu() else { return };
    let before = boxes();
    let atlas = atlas(&before, 64);
    let mut on_gpu = GpuScene::new(&gpu, &before).unwrap();
    let options = AtlasCaptureOptions::default();
    let mut capture = AtlasCapture::new(&gpu, &before, &on_gpu, &atlas, &options).unwrap();
    let mut after = before.clone();
    let twice = Mat4::from_translation(Vec3::Y) * Mat4::from_scale(Vec3::splat(2.0));
    after.instances[0].world_from_mesh = twice * after.instances[0].world_from_mesh;
    for scene in [&before, &after] {
        let mut frame = Frame::new(&gpu, false);
        on_gpu.update(&gpu, scene).unwrap();
        capture.record(&mut frame, &on_gpu).unwrap();
        frame.submit().unwrap();
        let points = unpacked(&gpu, &on_gpu, &capture);
        let of_first = points.iter().filter(|point| point.instance == 0);
        let area: f32 = of_first.map(|point| point.area).sum();
        let wanted: f64 = triangles(scene, 0).into_iter().map(world_area).sum();
        assert!((f64::from(area) / wanted - 1.0).abs() < 1e-3);
    }
    let mut other = after.clone();
    other.instances.pop();
    on_gpu.update(&gpu, &other).unwrap();
    let mut frame = Frame::new(&gpu, false);
    assert!(capture.record(&mut frame, &on_gpu).is_err());
    let refused = AtlasCapture::new(&gpu, &other, &on_gpu, &atlas, &options);
    assert!(refused.unwrap_err().to_string().contains("4 instances"));
}
