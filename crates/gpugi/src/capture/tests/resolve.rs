//! What resolve makes of hit records, compared with analytic surfaces.

use glam::{Mat4, Vec2, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{
    AlphaMode, Camera, Image, Material, Pixels, Projection, Scene, Texture, TextureRef, Wrap,
};

use crate::capture::{Capture, CaptureKernels, View};
use crate::gpu::{Frame, Gpu, read_texture};
use crate::scene::GpuScene;
use crate::testing::{Point, read_points, test_gpu};

const SIDE: u32 = 64;
const NONE: u32 = u32::MAX;

/// Captures `scene`; also returns the rays (origin, unit direction).
fn capture(gpu: &Gpu, scene: &Scene, camera: &Camera) -> Vec<(Point, Vec3, Vec3)> {
    let mut on_gpu = GpuScene::new(gpu, scene).unwrap();
    let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_camera(gpu, &kernels, [SIDE; 2]).unwrap();
    let view = View::new(
        camera,
        [SIDE; 2],
        Vec2::new(0.2, -0.1),
        0,
        1,
        on_gpu.diagonal(),
    );
    let mut frame = Frame::new(gpu, false);
    on_gpu.merge(&mut frame);
    capture
        .record(&mut frame, &on_gpu, &view, |draw| draw.seen)
        .unwrap();
    frame.submit().unwrap();
    let hits: Vec<u32> = read_texture(gpu, &capture.hits, wgpu::TextureAspect::All, 0, 0).unwrap();
    let points = read_points(gpu, &on_gpu, &capture.points);
    let u = view.uniform;
    points
        .into_iter()
        .zip(hits)
        .enumerate()
        .map(|(index, (point, hit))| {
            assert_eq!(point.instance == NONE, hit == NONE, "hit record {hit:x}");
            let (x, y) = ((index as u32 % SIDE) as f32, (index as u32 / SIDE) as f32);
            let origin =
                Vec3::from(u.origin) + x * Vec3::from(u.origin_dx) + y * Vec3::from(u.origin_dy);
            let direction = Vec3::from(u.direction)
                + x * Vec3::from(u.direction_dx)
                + y * Vec3::from(u.direction_dy);
            (point, origin, direction.normalize())
        })
        .collect()
}

/// Where a ray enters the box [-1/2, 1/2]^3: distance along it and outward normal.
fn enter_box(origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
    let (a, b) = ((-0.5 - origin) / direction, (0.5 - origin) / direction);
    let (near, far) = (a.min(b), a.max(b));
    let (enter, leave) = (near.max_element(), far.min_element());
    let axis = (0..3).find(|&axis| near[axis] == enter)?;
    let mut normal = Vec3::ZERO;
    normal[axis] = -direction[axis].signum();
    (enter < leave && enter > 0.0).then_some((enter, normal))
}

fn box_scene(world_from_mesh: Mat4) -> Scene {
    let mut scene = Scene::new("box");
    let mesh = scene.add_mesh(shapes::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 2));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    // An instance before it, out of sight, so that its own rows and vertices are not the first.
    scene.add_instance(
        "elsewhere",
        mesh,
        material,
        Mat4::from_translation(Vec3::Z * 50.0),
    );
    scene.add_instance("box", mesh, material, world_from_mesh);
    scene
}

#[test]
fn points_lie_on_the_surface_and_face_the_viewer() {
    let Some(gpu) = test_gpu() else { return };
    let turned = Mat4::from_rotation_y(0.6) * Mat4::from_rotation_x(0.4);
    let place = Mat4::from_translation(Vec3::new(0.2, -0.1, -0.3));
    for (scale, orthographic) in [
        (Vec3::new(1.0, 0.7, 1.4), false),
        (Vec3::new(-1.0, 0.7, 1.4), false),
        (Vec3::new(-1.0, -0.7, -1.4), true),
        (Vec3::new(1.0, 1.3, 0.6), true),
    ] {
        let world_from_mesh = place * turned * Mat4::from_scale(scale);
        let mut camera = Camera::look_at("test", Vec3::new(0.5, 1.0, 3.0), Vec3::ZERO, 0.8);
        if orthographic {
            camera.projection = Projection::Orthographic { height: 2.5 };
        }
        let mesh_from_world = world_from_mesh.inverse();
        let (mut hits, mut disagree) = (0, 0);
        for (point, origin, direction) in capture(&gpu, &box_scene(world_from_mesh), &camera) {
            // Distances along the ray are the same in both spaces as long as the transformed direction is not
            // renormalized.
            let local = enter_box(
                mesh_from_world.transform_point3(origin),
                mesh_from_world.transform_vector3(direction),
            );
            let (Some((distance, normal)), 1) = (local, point.instance) else {
                disagree += u32::from(local.is_some() != (point.instance == 1));
                assert!(point.instance == NONE || point.instance == 1);
                continue;
            };
            hits += 1;
            let expected = origin + direction * distance;
            let error = point.position.distance(expected);
            assert!(
                error < 1e-4,
                "scale {scale}: {} is {error} m from {expected}",
                point.position
            );
            // Normals transform by the inverse transpose.
            let outward = mesh_from_world
                .transpose()
                .transform_vector3(normal)
                .normalize();
            for (what, found) in [
                ("geometric", point.geometric_normal),
                ("shading", point.normal),
            ] {
                assert!(
                    found.dot(outward) > 0.9999,
                    "scale {scale}: {what} normal {found}, not {outward}"
                );
            }
            assert!(
                point.diffuse.abs_diff_eq(Vec3::splat(0.5), 2e-3),
                "{}",
                point.diffuse
            );
            // The area of the plane that a pixel covers, where no border cuts it.
            let (pixel, cosine) = if orthographic {
                (2.5 / SIDE as f32, 1.0)
            } else {
                let axis = -camera.world_from_view.z_axis.truncate();
                (
                    2.0 * (0.4_f32).tan() / SIDE as f32 * distance * direction.dot(axis),
                    direction.dot(axis),
                )
            };
            let share = pixel * pixel * cosine / direction.dot(outward).abs();
            let ratio = point.area / share;
            assert!(
                (0.85..1.18).contains(&ratio) || direction.dot(outward).abs() < 0.2,
                "area {} of {share}",
                point.area
            );
        }
        assert!(hits > 300, "scale {scale}: {hits} hits");
        assert!(
            disagree < 12,
            "scale {scale}: {disagree} pixels differ from the analytic silhouette"
        );
    }
}

/// A unit square around the origin that faces +Z, with the given material and an image with or without mip levels, and
/// the camera at `distance` before or behind it.
fn square(
    gpu: &Gpu,
    material: Material,
    image: Option<(Image, bool)>,
    distance: f32,
) -> Vec<(Point, Vec3, Vec3)> {
    let mut scene = Scene::new("square");
    if let Some((image, has_levels)) = image {
        scene.images.push(image.into());
        scene.textures.push(Texture {
            image: 0,
            wrap: [Wrap::Repeat; 2],
            nearest: true,
            has_levels,
        });
    }
    let mesh = scene.add_mesh(shapes::quad(
        Vec3::new(-0.5, -0.5, 0.0),
        Vec3::X,
        Vec3::Y,
        1,
    ));
    let material = scene.add_material(material);
    scene.add_instance("square", mesh, material, Mat4::IDENTITY);
    let mut camera = Camera::look_at("test", Vec3::Z * distance, Vec3::ZERO, 1.0);
    camera.projection = Projection::Orthographic { height: 1.5 };
    capture(gpu, &scene, &camera)
}

#[test]
fn back_faces_exist_where_double_sided_and_are_turned() {
    let Some(gpu) = test_gpu() else { return };
    for (double_sided, distance, visible) in [
        (false, 2.0, true),
        (false, -2.0, false),
        (true, 2.0, true),
        (true, -2.0, true),
    ] {
        let material = Material {
            double_sided,
            ..Material::matt("sheet", Vec3::splat(0.5))
        };
        let points = square(&gpu, material, None, distance);
        let mut hits = 0;
        for (point, origin, _) in points {
            let inside = origin.truncate().abs().max_element() < 0.5;
            assert_eq!(
                point.instance,
                if visible && inside { 0 } else { NONE },
                "at {origin}"
            );
            if point.instance == 0 {
                hits += 1;
                let toward = Vec3::Z * distance.signum();
                assert!(
                    point.normal.dot(toward) > 0.9999
                        && point.geometric_normal.dot(toward) > 0.9999
                );
            }
        }
        assert_eq!(hits > 1000, visible);
    }
}

/// Two texels side by side.
fn two_texels(left: [u8; 4], right: [u8; 4]) -> Image {
    Image {
        name: "two".into(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8([left, right].concat()),
    }
}

#[test]
fn an_alpha_mask_cuts_what_its_texture_says() {
    let Some(gpu) = test_gpu() else { return };
    let material = Material {
        base_color_texture: Some(TextureRef::new(0)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        ..Material::matt("mask", Vec3::ONE)
    };
    let image = two_texels([255, 255, 255, 0], [255; 4]);
    for (point, origin, _) in square(&gpu, material, Some((image, true)), 2.0) {
        let inside = origin.truncate().abs().max_element() < 0.5 && origin.x > 0.0;
        // Along the border between the texels, the result depends on the filter.
        if origin.x.abs() > 0.05 && (origin.x.abs() - 0.5).abs() > 0.03 {
            assert_eq!(point.instance, if inside { 0 } else { NONE }, "at {origin}");
        }
    }
}

#[test]
fn a_cutoff_of_one_keeps_what_is_opaque() {
    let Some(gpu) = test_gpu() else { return };
    let material = Material {
        alpha_mode: AlphaMode::Mask { cutoff: 1.0 },
        ..Material::matt("leaf", Vec3::ONE)
    };
    for (point, origin, _) in square(&gpu, material, None, 2.0) {
        let from_centre = origin.truncate().abs().max_element();
        assert!(from_centre > 0.49 || point.instance == 0, "at {origin}");
    }
}

/// Texture gradients: sharp texels where a texel covers many pixels; their mean where a pixel covers many texels,
/// unless the texture has no mip levels.
#[test]
fn texture_gradients_choose_the_level() {
    let Some(gpu) = test_gpu() else { return };
    for (repeats, has_levels, sharp) in [
        (2.0, true, true),
        (200.0, true, false),
        (200.0, false, true),
    ] {
        let material = Material {
            base_color_texture: Some(TextureRef {
                uv_from_mesh: glam::Affine2::from_scale(Vec2::splat(repeats)),
                ..TextureRef::new(0)
            }),
            ..Material::matt("checker", Vec3::ONE)
        };
        let image = two_texels([0, 0, 0, 255], [255; 4]);
        let (mut dark, mut bright, mut hits) = (0, 0, 0);
        for (point, origin, _) in square(&gpu, material, Some((image, has_levels)), 2.0) {
            if point.instance == NONE {
                continue;
            }
            hits += 1;
            let albedo = point.diffuse.x;
            if sharp {
                let texel = (origin.x + 0.5) * repeats * 2.0;
                let from_border = (texel - texel.round()).abs();
                let expected = (texel.floor() as i32).rem_euclid(2) as f32;
                if from_border > 0.1 {
                    assert!((albedo - expected).abs() < 0.01, "{albedo} at {origin}");
                    dark += i32::from(expected == 0.0);
                    bright += i32::from(expected == 1.0);
                }
            } else {
                assert!((albedo - 0.5).abs() < 0.02, "{albedo} at {origin}");
            }
        }
        assert!(hits > 1000);
        assert!(
            !sharp || (dark > 100 && bright > 100),
            "{dark} dark, {bright} bright"
        );
    }
}

#[test]
fn nothing_but_background_has_no_instance() {
    let Some(gpu) = test_gpu() else { return };
    let camera = Camera::look_at("away", Vec3::Z * 3.0, Vec3::Z * 6.0, 0.8);
    let mut scene = box_scene(Mat4::from_scale(Vec3::splat(0.1)));
    scene.instances.remove(0);
    for (point, ..) in capture(&gpu, &scene, &camera) {
        assert_eq!(point.instance, NONE);
    }
}
