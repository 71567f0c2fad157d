//! Compares the maps, texel by texel, with an analytic room; checks that host and shaders agree on constants.

use glam::{DVec3, Mat4, Vec2, Vec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Material, MaterialModel, Scene, Volume};

use super::{DistanceImpostor, Search, Technique};
use crate::capture::{CaptureKernels, Emission, View};
use crate::gpu::{Frame, Gpu, TextureAspect, read_texture};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::{Earlier, EarlierLight, Shared};
use crate::testing::{constant, on_face, test_gpu};

const SIDE: usize = 32;
/// Half the room's extents, centred at the origin; the ball's centre and radius (m).
const HALF: Vec3 = vec3(2.0, 1.5, 2.5);
const CENTER: Vec3 = vec3(0.7, -0.3, 0.4);
const RADIUS: f32 = 0.4;

/// Radiance that a wall emits: +X, -X, +Y, -Y, +Z, -Z.
fn radiance(axis: usize, is_low: bool) -> Vec3 {
    let mut color = Vec3::splat(if is_low { 0.25 } else { 1.0 });
    color[axis] = 2.0;
    color
}

/// A room with walls of six colours that holds one ball.
fn room(material: Material) -> Scene {
    let mut scene = Scene::new("room");
    for axis in 0..3 {
        for is_low in [false, true] {
            let mut outward = Vec3::ZERO;
            outward[axis] = if is_low { -1.0 } else { 1.0 };
            let right = outward.any_orthonormal_vector();
            let up = (-outward).cross(right);
            let corner = (outward - right - up) * HALF;
            let mesh = scene.add_mesh(quad(corner, 2.0 * right * HALF, 2.0 * up * HALF, 1));
            let material = scene.add_material(Material::emitter("wall", radiance(axis, is_low)));
            scene.add_instance("wall", mesh, material, Mat4::IDENTITY);
        }
    }
    let mesh = scene.add_mesh(sphere(RADIUS, 64));
    let material = scene.add_material(material);
    scene.add_instance("ball", mesh, material, Mat4::from_translation(CENTER));
    scene
}

/// The technique after `generate`.
fn generated(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> DistanceImpostor {
    let mut scene = GpuScene::new(gpu, scene).unwrap();
    let kernels = CaptureKernels::new(gpu, &scene).unwrap();
    let mut technique = DistanceImpostor::new(gpu, &scene).unwrap();
    for name in ["resolution", "shape-resolution"] {
        technique
            .settings_mut()
            .set(name, &SIDE.to_string())
            .unwrap();
    }
    for (name, value) in settings {
        technique.settings_mut().set(name, value).unwrap();
    }
    let claims = technique.plan(&scene, &[], &[]).claims;
    scene.assign(gpu, &claims);
    let camera = Camera::look_at("", Vec3::Z, Vec3::ZERO, 1.0);
    let view = View::new(&camera, [1, 1], Vec2::ZERO, 0, 0, 1.0);
    let mut frame = Frame::new(gpu, false);
    scene.merge(&mut frame);
    let mut emission = Emission::new(gpu, &scene).unwrap();
    let mut shared = Shared::new(gpu, &scene, &kernels).unwrap();
    let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut []), &mut shared);
    technique
        .generate(&mut frame, &scene, &view, &mut lit)
        .unwrap();
    frame.submit().unwrap();
    technique
}

/// The texels of a map with their directions.
fn texels<T: bytemuck::Pod>(gpu: &Gpu, technique: &DistanceImpostor, map: &str) -> Vec<(DVec3, T)> {
    let maps = technique.inspect().maps;
    let name = format!("distance-impostor.6.{map}");
    let map = maps.iter().find(|map| map.name == name).unwrap();
    let texture = map.texture().unwrap();
    let at = |texel: usize| (texel as f64 + 0.5) * 2.0 / SIDE as f64 - 1.0;
    (0..6)
        .flat_map(|face| {
            let layer: Vec<T> = read_texture(gpu, texture, TextureAspect::All, face, 0).unwrap();
            layer.into_iter().enumerate().map(move |(index, texel)| {
                let place = on_face(face as usize, at(index % SIDE), at(index / SIDE));
                (place.normalize(), texel)
            })
        })
        .collect()
}

fn halves(texel: [u16; 4]) -> DVec3 {
    let [x, y, z, _] = texel.map(|half| f64::from(half::f16::from_bits(half)));
    DVec3::new(x, y, z)
}

#[test]
fn texels_hold_what_lies_in_their_direction() {
    let Some(gpu) = test_gpu() else { return };
    let technique = generated(&gpu, &room(Material::metal("mirror", Vec3::ONE, 0.0)), &[]);
    let distances = texels::<f32>(&gpu, &technique, "distances");
    let colors = texels::<[u16; 4]>(&gpu, &technique, "radiance");
    assert_eq!(distances.len(), 6 * SIDE * SIDE);
    for ((direction, distance), (_, color)) in distances.into_iter().zip(colors) {
        let half = HALF.as_dvec3() * direction.signum();
        let walls = ((half - CENTER.as_dvec3()) / direction).to_array();
        let exact = walls.into_iter().fold(f64::INFINITY, f64::min);
        let axis = (0..3).find(|&axis| walls[axis] == exact).unwrap();
        let off = f64::from(distance) / exact - 1.0;
        assert!(off.abs() < 1e-5, "{direction}: {distance} m, not {exact}");
        let expected = radiance(axis, direction[axis] < 0.0).as_dvec3();
        let found = halves(color);
        assert!(
            found.distance(expected) < 0.01,
            "{direction}: {found}, not {expected}"
        );
    }
}

#[test]
fn normals_of_a_refractor_face_outward() {
    let Some(gpu) = test_gpu() else { return };
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    };
    let technique = generated(&gpu, &room(glass), &[]);
    for (direction, texel) in texels::<[u16; 4]>(&gpu, &technique, "normals") {
        let normal = halves(texel);
        // Interpolated normals of a ball of 64 segments.
        assert!(
            normal.distance(direction) < 5e-3,
            "{direction}: normal {normal}"
        );
    }
}

/// Only lobes with a width need mip levels. A Phong lobe always has a width, whatever the material's roughness.
#[test]
fn levels_and_impostors_go_by_lobes() {
    let Some(gpu) = test_gpu() else { return };
    let phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::ZERO,
            ks: Vec3::ONE,
            shininess: 20.0,
        },
        ..Material::metal("Phong", Vec3::ONE, 0.0)
    };
    let cases = [
        (Material::metal("mirror", Vec3::ONE, 0.0), "auto", vec![1]),
        (Material::metal("rough", Vec3::ONE, 0.3), "ball", vec![6]),
        (phong.clone(), "ball", vec![6]),
        (phong, "auto", vec![]),
    ];
    for (material, objects, expected) in cases {
        let name = material.name.clone();
        let technique = generated(&gpu, &room(material), &[("objects", objects)]);
        let maps = technique.inspect().maps;
        let levels: Vec<u32> = maps
            .iter()
            .filter(|map| map.name.ends_with("radiance"))
            .map(|map| map.texture().unwrap().mip_level_count())
            .collect();
        assert_eq!(levels, expected, "{name}, objects {objects}");
    }
}

#[test]
fn shaders_and_host_agree_on_constants() {
    let gather = shader!("techniques.distance_impostor.gather");
    for (name, search) in [
        ("SEARCH_SECANT", Search::Secant),
        ("SEARCH_FALSE_POSITION", Search::FalsePosition),
        ("SEARCH_PURE_SECANT", Search::PureSecant),
    ] {
        assert_eq!(
            constant(&gather, "impostor_maps", name),
            search.number(),
            "{name}"
        );
    }
}
