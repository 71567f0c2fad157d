//! Irradiance volumes, and the texture that other programs read.

use glam::{UVec3, Vec3, vec3};
use gpugi::bake::IrradianceVolume;
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Material, Scene};

use super::common::{gpu, place};
use super::shining_room;

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
    let settings = [["final-gather", "density", "1"]];
    let bake =
        |density| IrradianceVolume::bake(&gpu, &scene, &names, &settings, "final-gather", density);
    let volume = bake(2.0).expect("a volume");
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

#[test]
fn densities_that_cannot_work_are_refused() {
    let Some(gpu) = gpu() else { return };
    let names = ["final-gather".to_owned()];
    let bake = |scene: &Scene, density: f32| {
        let baked = IrradianceVolume::bake(&gpu, scene, &names, &[], "final-gather", density);
        baked.expect_err("no volume").to_string()
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
