//! Irradiance volumes, and the texture that other programs read.

use std::f32::consts::PI;

use glam::{UVec3, Vec3, vec3};
use gpugi::bake::{HarmonicVolume, IrradianceVolume, Volume, VolumeLight};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Material, Scene};

use crate::common::{gpu, place, shining_room};

/// A room whose wall at +X shines: sides that face it are bright. The texture has every side of every voxel in its
/// place.
#[test]
fn a_volume_has_six_sides_per_voxel() {
    let Some(gpu) = gpu() else { return };
    let mut scene = shining_room(0.0, Vec3::ZERO);
    let wall = quad(vec3(0.999, 0.0, -1.5), Vec3::Z * 3.0, Vec3::Y * 1.5, 1);
    place(
        &mut scene,
        wall,
        Material::emitter("wall", vec3(1.0, 2.0, 3.0)),
    );
    let names = ["final-gather".to_owned()];
    let light = VolumeLight {
        names: &names,
        settings: &[["final-gather", "density", "1"]],
        adds: "final-gather",
    };
    let volume = IrradianceVolume::bake(&gpu, &scene, &light, 2.0).expect("a volume");
    assert_eq!(volume.counts, UVec3::new(4, 3, 6));
    assert_eq!(volume.cubes.len(), 72);
    let texture = volume.texture();
    assert_eq!((texture.size, texture.depth), ([4, 6], 18));
    for (index, cube) in volume.cubes.iter().enumerate() {
        let [toward, away, up, down, ..] = *cube;
        assert!(toward.x > 0.1 && away.x < 0.02, "{index}: {cube:?}");
        assert!((up.x - down.x).abs() < 0.25, "{index}: {cube:?}");
        let (x, y, z) = (index % 4, index / 4 % 3, index / 12);
        for (side, light) in cube.iter().enumerate() {
            let (axis, is_negative) = (side / 2, side % 2);
            let at = x + 4 * (y + 3 * is_negative + 6 * (z + 6 * axis));
            let found = texture.levels[0][at].map(f32::from);
            let off = Vec3::from_slice(&found[..3]).distance(*light);
            assert!(
                off <= 1e-3 * light.length() + 1e-6,
                "{index}, side {side}: {found:?}"
            );
        }
    }
    // Nearer to the wall it is brighter.
    assert!(volume.cubes[3][0].x > 1.5 * volume.cubes[0][0].x);
}

/// Harmonics of the same light: exact for what is even, close to the cubes where a wall shines. JSON and the texture
/// hold the same numbers.
#[test]
fn harmonics_hold_the_irradiance() {
    let Some(gpu) = gpu() else { return };
    let names = ["final-gather".to_owned()];
    let light = VolumeLight {
        names: &names,
        settings: &[["final-gather", "density", "1"]],
        adds: "final-gather",
    };
    let even = shining_room(1.0, Vec3::ZERO);
    let volume = HarmonicVolume::bake(&gpu, &even, &light, 1.0).expect("a volume");
    for (voxel, coefficients) in volume.radiance_coefficients.iter().enumerate() {
        // L Y_0 over the sphere: sqrt(4 pi).
        assert!(
            (coefficients[0].x - (4.0 * PI).sqrt()).abs() < 0.01,
            "{coefficients:?}"
        );
        let rest = &coefficients[1..];
        assert!(
            rest.iter().all(|coefficient| coefficient.length() < 0.02),
            "{coefficients:?}"
        );
        let found = volume.irradiance_at(voxel, vec3(1.0, -2.0, 0.5).normalize());
        assert!((found.x / PI - 1.0).abs() < 0.01, "{found}");
    }
    let mut scene = shining_room(0.0, Vec3::splat(0.5));
    let wall = quad(vec3(0.999, 0.0, -1.5), Vec3::Z * 3.0, Vec3::Y * 1.5, 1);
    place(
        &mut scene,
        wall,
        Material::emitter("wall", vec3(1.0, 2.0, 3.0)),
    );
    let cubes = IrradianceVolume::bake(&gpu, &scene, &light, 1.0).expect("a volume");
    let volume = HarmonicVolume::bake(&gpu, &scene, &light, 1.0).expect("a volume");
    assert_eq!(
        (volume.counts, cubes.counts),
        (UVec3::new(2, 2, 3), UVec3::new(2, 2, 3))
    );
    let sides = [
        Vec3::X,
        Vec3::NEG_X,
        Vec3::Y,
        Vec3::NEG_Y,
        Vec3::Z,
        Vec3::NEG_Z,
    ];
    for (voxel, cube) in cubes.cubes.iter().enumerate() {
        for (side, expected) in sides.into_iter().zip(cube) {
            let found = volume.irradiance_at(voxel, side) / PI;
            let off = (found - *expected).abs().max_element();
            assert!(
                off < 0.1 * cube[0].max_element(),
                "{voxel} {side}: {found} {expected}"
            );
        }
    }
    let text = serde_json::to_string(&volume).expect("JSON");
    let again: HarmonicVolume = serde_json::from_str(&text).expect("a volume");
    assert_eq!(again, volume);
    let texture = volume.texture();
    assert_eq!((texture.size, texture.depth), ([2, 6], 9));
    for (voxel, coefficients) in volume.radiance_coefficients.iter().enumerate() {
        let (x, y, z) = (voxel % 2, voxel / 2 % 2, voxel / 4);
        for (i, expected) in coefficients.iter().enumerate() {
            let at = x + 2 * (y + 2 * (i % 3) + 6 * (z + 3 * (i / 3)));
            let found = texture.levels[0][at].map(f32::from);
            let off = Vec3::from_slice(&found[..3]).distance(*expected);
            assert!(
                off <= 1e-3 * expected.length() + 1e-6,
                "{voxel}, {i}: {found:?}"
            );
        }
    }
}

#[test]
fn densities_that_cannot_work_are_refused() {
    let Some(gpu) = gpu() else { return };
    let names = ["final-gather".to_owned()];
    let light = VolumeLight {
        names: &names,
        settings: &[],
        adds: "final-gather",
    };
    let bake = |scene: &Scene, density: f32| {
        let baked = IrradianceVolume::bake(&gpu, scene, &light, density);
        let message = baked.expect_err("no volume").to_string();
        let baked = HarmonicVolume::bake(&gpu, scene, &light, density);
        assert_eq!(baked.expect_err("no volume").to_string(), message);
        message
    };
    let room = shining_room(1.0, Vec3::ZERO);
    for density in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let message = bake(&room, density);
        assert!(message.contains("positive density"), "{density}: {message}");
    }
    // Too many in all, and too many along one axis.
    for density in [1e2, 1e4, f32::MAX] {
        let message = bake(&room, density);
        assert!(message.contains("fewer per metre"), "{density}: {message}");
    }
    let mut thread = Scene::new("thread");
    let mesh = cuboid(Vec3::ZERO, vec3(1.0, 0.001, 0.001), 1);
    place(&mut thread, mesh, Material::matt("thread", Vec3::ONE));
    let message = bake(&thread, 3000.0);
    assert!(message.contains("fewer per metre"), "{message}");
    assert!(bake(&Scene::new("empty"), 1.0).contains("empty scene"));
}
