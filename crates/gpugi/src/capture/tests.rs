//! Captures: which view contains a direction, and through which pixel a ray passes.

mod cube;
mod resolve;

use std::f32::consts::FRAC_PI_3;

use glam::{Vec2, Vec3, Vec4};
use gpugi_scene::{Camera, Projection};

use super::View;
use super::depth::{DepthViewSpec, DepthViewUniform};
use crate::lights::gpu::LightSample;
use crate::shader;
use crate::testing::{Random, run_kernel, test_gpu};

/// Runs `light_sample::face` for random points around a light and checks the views against its results. `axes`: the
/// forward axis of each view; `reach`: largest distance from the centre of a tile, in tile coordinates.
fn check_faces(
    light: LightSample,
    specs: &[DepthViewSpec],
    axes: &[Vec3],
    near: f32,
    reach: &[Vec2],
    upper: bool,
) {
    let Some(gpu) = test_gpu() else { return };
    let uniforms: Vec<DepthViewUniform> = specs
        .iter()
        .map(|spec| DepthViewUniform {
            clip_from_world: spec.clip_from_world.to_cols_array(),
            near: spec.near,
            ..bytemuck::Zeroable::zeroed()
        })
        .collect();
    let mut random = Random(9);
    let mut points: Vec<[f32; 4]> = Vec::new();
    while points.len() < 4096 {
        let direction = random.direction();
        // A one-sided light's hemicube ends at its horizon.
        if upper && direction.dot(Vec3::from(light.direction)) < 0.01 {
            continue;
        }
        points.push(
            direction
                .extend(0.05 + 20.0 * random.next() as f32)
                .to_array(),
        );
    }
    let light_buffer = gpu.storage("light", &[light]).unwrap();
    let views = gpu.storage("views", &uniforms).unwrap();
    let directions = gpu.storage("directions", &points).unwrap();
    let inputs = [
        ("light", &light_buffer),
        ("views", &views),
        ("directions", &directions),
    ];
    let count = points.len();
    let found: Vec<[f32; 4]> = run_kernel(
        &gpu,
        &shader!("testing.faces"),
        "main",
        &inputs,
        count,
        count as u32,
    )
    .unwrap();
    let mut used = vec![0; specs.len()];
    for (point, [u, v, depth, face]) in points.iter().zip(found) {
        let (direction, distance) = (Vec4::from(*point).truncate(), point[3]);
        let face = face as usize;
        used[face] += 1;
        // The face whose axis has the largest component of the direction.
        let along = direction.dot(axes[face]);
        for axis in axes {
            assert!(
                direction.dot(*axis) <= along + 1e-5,
                "{direction} belongs to {axis}, not to face {face}"
            );
        }
        let expected = near / (along * distance);
        assert!(
            (depth - expected).abs() <= 1e-4 * expected,
            "face {face}: depth {depth}, not {expected}"
        );
        let off = (Vec2::new(u, v) - 0.5).abs();
        assert!(
            off.cmple(reach[face] + 1e-4).all(),
            "{direction} is at {u}, {v} in the tile of face {face}"
        );
    }
    assert!(
        used.iter().all(|&count| count > 100),
        "faces used: {used:?}"
    );
}

#[test]
fn a_point_lights_cube_holds_every_direction() {
    let position = Vec3::new(1.0, -2.0, 0.5);
    let light = LightSample {
        position: position.to_array(),
        kind: LightSample::POINT,
        ..bytemuck::Zeroable::zeroed()
    };
    let axes = [
        Vec3::X,
        Vec3::NEG_X,
        Vec3::Y,
        Vec3::NEG_Y,
        Vec3::Z,
        Vec3::NEG_Z,
    ];
    // The field of view itself ends where the gutter begins.
    let reach = [Vec2::splat(0.5 - 3.0 / 64.0); 6];
    check_faces(
        light,
        &DepthViewSpec::cube(position, 0.01, 64, 3),
        &axes,
        0.01,
        &reach,
        false,
    );
}

#[test]
fn an_area_lights_hemicubes_hold_every_direction_before_it() {
    let position = Vec3::new(-1.0, 2.0, 0.25);
    let normal = Vec3::new(0.3, -0.9, 0.2).normalize();
    let tangent = normal.any_orthonormal_vector();
    let bitangent = normal.cross(tangent);
    let sides = [normal, tangent, -tangent, bitangent, -bitangent];
    let top = Vec2::splat(0.5 - 3.0 / 64.0);
    let wall = Vec2::new(top.x, 0.5);
    let reach = [top, wall, wall, wall, wall];
    for (kind, two_sided) in [
        (LightSample::AREA, false),
        (LightSample::AREA_TWO_SIDED, true),
    ] {
        let light = LightSample {
            position: position.to_array(),
            kind,
            direction: normal.to_array(),
            tangent: tangent.to_array(),
            ..bytemuck::Zeroable::zeroed()
        };
        let side = 64;
        if two_sided {
            let specs = DepthViewSpec::hemicubes(position, normal, tangent, 0.02, side, 3);
            let axes: Vec<Vec3> = sides
                .iter()
                .chain(&[-normal])
                .chain(&sides[1..])
                .copied()
                .collect();
            check_faces(light, &specs, &axes, 0.02, &[reach, reach].concat(), false);
        } else {
            let specs = DepthViewSpec::hemicube(position, normal, tangent, 0.02, side, 3);
            check_faces(light, &specs, &sides, 0.02, &reach, true);
        }
    }
}

/// The rays of pixels and the matrix that rasterizes for them must describe the same view.
#[test]
fn a_pixels_ray_projects_to_its_centre() {
    let mut camera = Camera::look_at(
        "test",
        Vec3::new(1.0, 2.0, 3.0),
        Vec3::new(-0.5, 0.2, -1.0),
        FRAC_PI_3,
    );
    for projection in [
        Projection::Perspective {
            vertical_fov: FRAC_PI_3,
        },
        Projection::Orthographic { height: 3.0 },
    ] {
        camera.projection = projection;
        for jitter in [Vec2::ZERO, Vec2::new(0.3, -0.45), Vec2::new(-0.5, 0.5)] {
            let size = [96, 64];
            let view = View::new(&camera, size, jitter, 0, 1, 10.0);
            for pixel in [[0, 0], [95, 0], [0, 63], [95, 63], [40, 17]] {
                let [x, y] = pixel.map(|p| p as f32);
                let at = |base: [f32; 3], dx: [f32; 3], dy: [f32; 3]| {
                    Vec3::from(base) + x * Vec3::from(dx) + y * Vec3::from(dy)
                };
                let u = view.uniform;
                let origin = at(u.origin, u.origin_dx, u.origin_dy);
                let direction = at(u.direction, u.direction_dx, u.direction_dy);
                for distance in [0.5, 3.0, 12.0] {
                    let clip = view.clip_from_world * (origin + direction * distance).extend(1.0);
                    let ndc = clip.truncate() / clip.w;
                    let found = (Vec2::new(ndc.x, -ndc.y) * 0.5 + 0.5) * Vec2::new(96.0, 64.0);
                    let centre = Vec2::new(x, y) + 0.5;
                    assert!(
                        found.abs_diff_eq(centre, 5e-3),
                        "{projection:?} {jitter}: {pixel:?} is at {found}"
                    );
                    assert!(ndc.z > 0.0 && ndc.z <= 1.0, "depth {}", ndc.z);
                }
            }
            // The jittered ray passes through the jittered position in the image without jitter.
            let still = View::new(&camera, size, Vec2::ZERO, 0, 1, 10.0);
            let u = view.uniform;
            let clip = still.clip_from_world
                * (Vec3::from(u.origin) + Vec3::from(u.direction) * 2.0).extend(1.0);
            let found = (Vec2::new(clip.x, -clip.y) / clip.w * 0.5 + 0.5) * Vec2::new(96.0, 64.0);
            assert!(
                found.abs_diff_eq(Vec2::splat(0.5) + jitter, 5e-3),
                "{projection:?} {jitter}: {found}"
            );
        }
    }
}

/// Through any point of a lens, rays go where the rasterizer sees pixels, and meet those of the pinhole in the plane of focus.
#[test]
fn rays_and_rasterizer_see_through_the_same_point_of_a_lens() {
    let (size, focus) = ([40, 30], 2.5);
    let perspective = Camera::look_at("", Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO, 0.8);
    let parallel = Camera {
        projection: Projection::Orthographic { height: 3.0 },
        ..perspective.clone()
    };
    for camera in [perspective, parallel] {
        let pinhole = View::new(&camera, size, Vec2::new(0.2, -0.3), 0, 0, 9.0);
        let lens = pinhole.through(Vec2::new(0.15, -0.1), focus);
        let place = |view: &View, pixel: Vec2, distance: f32| {
            let [origin, dx, dy] = [
                view.uniform.origin,
                view.uniform.origin_dx,
                view.uniform.origin_dy,
            ]
            .map(Vec3::from);
            let [toward, across, down] = [
                view.uniform.direction,
                view.uniform.direction_dx,
                view.uniform.direction_dy,
            ]
            .map(Vec3::from);
            let direction = toward + pixel.x * across + pixel.y * down;
            origin + pixel.x * dx + pixel.y * dy + distance * direction
        };
        for pixel in [Vec2::new(3.0, 4.0), Vec2::new(30.0, 21.0)] {
            for distance in [1.0, focus, 6.0] {
                let clip = lens.clip_from_world * place(&lens, pixel, distance).extend(1.0);
                let half = Vec2::new(20.0, 15.0);
                let seen = (Vec2::new(clip.x, -clip.y) / clip.w + 1.0) * half - 0.5;
                assert!(
                    seen.distance(pixel) < 1e-3,
                    "{distance} m: {seen}, not {pixel}"
                );
            }
            let apart = place(&lens, pixel, focus).distance(place(&pinhole, pixel, focus));
            assert!(apart < 1e-5, "{apart} m in the plane of focus");
        }
    }
}
