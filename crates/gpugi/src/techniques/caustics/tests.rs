//! Tests that no light is lost or gained on its way into the cubes.

use std::f64::consts::PI;

use glam::{DVec3, Mat4, Vec2, Vec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Scene, Volume};

use super::{Caustics, Technique};
use crate::capture::{CaptureKernels, Emission, View};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::scene::GpuScene;
use crate::techniques::{Earlier, EarlierLight, Shared, Texels};
use crate::testing::test_gpu;

const CENTER: Vec3 = vec3(0.2, -0.3, 0.1);
const RADIUS: f32 = 0.5;

/// A closed room with a ball in it.
fn room(ball: Material) -> Scene {
    let half = vec3(2.0, 1.5, 2.5);
    let mut scene = Scene::new("room");
    let wall = scene.add_material(Material::matt("wall", Vec3::splat(0.5)));
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut outward = Vec3::ZERO;
            outward[axis] = sign;
            let right = outward.any_orthonormal_vector();
            let up = (-outward).cross(right);
            let corner = (outward - right - up) * half;
            let mesh = scene.add_mesh(quad(corner, 2.0 * right * half, 2.0 * up * half, 1));
            scene.add_instance("wall", mesh, wall, Mat4::IDENTITY);
        }
    }
    let mesh = scene.add_mesh(sphere(RADIUS, 96));
    let material = scene.add_material(ball);
    scene.add_instance("ball", mesh, material, Mat4::from_translation(CENTER));
    scene
}

fn glass() -> Material {
    Material {
        transmission: 1.0,
        roughness: 0.0,
        ior: 1.5,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

fn mirror() -> Material {
    Material::metal("mirror", Vec3::ONE, 0.0)
}

/// Flux in the first object's cube after `frames` frames.
fn flux(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)], frames: u32) -> DVec3 {
    fluxes(gpu, scene, settings, frames)[0]
}

/// Flux in each object's cube after `frames` frames.
fn fluxes(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)], frames: u32) -> Vec<DVec3> {
    let technique = generated(gpu, scene, settings, frames);
    let caustics = &technique.maps.get().unwrap().caustics;
    caustics.iter().map(|caustic| caustic.flux(gpu)).collect()
}

/// The technique after `frames` frames.
fn generated(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)], frames: u32) -> Caustics {
    generated_by(gpu, scene, settings, frames, None)
}

/// As `generated`, with other bounds on the invocations that share a photon.
fn generated_by(
    gpu: &Gpu,
    scene: &Scene,
    settings: &[(&str, &str)],
    frames: u32,
    splat_lanes: Option<[u32; 2]>,
) -> Caustics {
    let mut scene = GpuScene::with_texels(gpu, scene).unwrap();
    let kernels = CaptureKernels::new(gpu, &scene).unwrap();
    let mut technique = Caustics::new(gpu, &scene).unwrap();
    if let Some(lanes) = splat_lanes {
        technique.kernels.splat_lanes = lanes;
    }
    for (name, value) in [
        ("cube-resolution", "32"),
        ("shape-resolution", "64"),
        ("bounces", "16"),
    ]
    .iter()
    .chain(settings)
    {
        technique.settings_mut().set(name, value).unwrap();
    }
    let claims = technique.plan(&scene, &[], &[]).claims;
    scene.assign(gpu, &claims);
    let camera = Camera::look_at("", Vec3::Z, Vec3::ZERO, 1.0);
    let view = View::new(&camera, [1, 1], Vec2::ZERO, 0, 0, 1.0);
    let mut emission = Emission::new(gpu, &scene).unwrap();
    let mut shared = Shared::new(gpu, &scene, &kernels).unwrap();
    for _ in 0..frames {
        let mut frame = Frame::new(gpu, false);
        scene.merge(&mut frame);
        let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut []), &mut shared);
        technique
            .generate(&mut frame, &scene, &view, &mut lit)
            .unwrap();
        frame.submit().unwrap();
    }
    technique
}

/// There is no map without a light.
#[test]
fn the_map_of_a_cube_holds_its_irradiance() {
    let Some(gpu) = test_gpu() else { return };
    let lamp = Light::new("", LightKind::Point, Vec3::ONE);
    for lights in [vec![], vec![lamp.aimed(CENTER + Vec3::Y, Vec3::ZERO)]] {
        let is_lit = !lights.is_empty();
        let mut scene = room(mirror());
        scene.lights = lights;
        let technique = generated(&gpu, &scene, &[("resolution", "64")], 1);
        let maps = technique.inspect().maps;
        assert_eq!(maps.len(), usize::from(is_lit));
        if !is_lit {
            continue;
        }
        assert!(maps[0].name.ends_with(".irradiance"));
        let Texels::Buffer {
            buffer,
            size: [32, 192],
            stride: 32,
            is_number: false,
        } = &maps[0].texels
        else {
            panic!("{:?}", maps[0]);
        };
        let texels: Vec<[f32; 8]> = read_buffer(&gpu, buffer, 32 * 192 * 32).unwrap();
        let lit = texels.iter().filter(|texel| texel[0] > 0.0).count();
        assert!(lit > 500, "{lit} texels");
        // At least the counters, the caustic map with its depth, and the photons of mirrored light.
        assert!(technique.inspect().work_bytes >= 32 * 192 * 24 + 64 * 64 * (8 + 32));
    }
}

/// Flux that falls on the ball from a point light at a distance: intensity times the solid angle of the ball's disc.
fn falling(distance: f64, intensity: f64) -> f64 {
    let sine = f64::from(RADIUS) / distance;
    2.0 * PI * (1.0 - (1.0 - sine * sine).sqrt()) * intensity
}

fn check(name: &str, found: DVec3, expected: DVec3, tolerance: f64) {
    println!("{name}: {found} W of {expected} W");
    let off = (found / expected - 1.0).abs().max_element();
    assert!(off < tolerance, "{name}: {found} W, not {expected} W");
}

/// A mirror sends on all light that falls on it, and so does clear glass, however often light is reflected inside.
#[test]
fn flux_of_points_arrives() {
    let Some(gpu) = test_gpu() else { return };
    let toward = vec3(0.3, 0.8, 0.5).normalize();
    let light = Light::new("", LightKind::Point, vec3(3.0, 2.0, 1.0))
        .aimed(CENTER + toward * 1.2, Vec3::ZERO);
    let expected = falling(1.2, 1.0) * DVec3::new(3.0, 2.0, 1.0);
    for (name, ball) in [("mirror", mirror()), ("glass", glass())] {
        let mut scene = room(ball);
        scene.lights.push(light.clone());
        for resolution in ["64", "200"] {
            let found = flux(&gpu, &scene, &[("resolution", resolution)], 1);
            check(name, found, expected, 0.01);
        }
        let settings = [("resolution", "32"), ("frames", "8")];
        check(name, flux(&gpu, &scene, &settings, 8), expected, 0.01);
        let settings = [("tracer", "rays"), ("resolution", "64")];
        check(name, flux(&gpu, &scene, &settings, 1), expected, 0.01);
    }
}

/// What a mirror throws at a ball of clear glass goes on to the walls: all of it, whatever is drawn at the glass.
#[test]
fn flux_arrives_by_way_of_several_objects() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room(mirror());
    let mut other = scene.instances.last().unwrap().clone();
    other.material = scene.add_material(glass());
    other.world_from_mesh = Mat4::from_translation(CENTER + vec3(-1.1, 0.3, 0.2));
    other.name = "glass".into();
    scene.instances.push(other);
    let at = CENTER + vec3(-0.6, 1.0, 0.4);
    let light = Light::new("", LightKind::Point, Vec3::ONE);
    scene.lights = vec![light.aimed(at, Vec3::ZERO)];
    let settings = [("tracer", "rays"), ("resolution", "64"), ("frames", "8")];
    let found = fluxes(&gpu, &scene, &settings, 8);
    let all = falling(f64::from((at - CENTER).length()), 1.0) * DVec3::ONE;
    check("rays", found[0], all, 0.01);
    let settings = [("resolution", "64"), ("frames", "8")];
    let found = fluxes(&gpu, &scene, &settings, 8);
    assert!(
        found[0].x < 0.99 * all.x,
        "maps lose what meets the glass: {found:?}"
    );
}

/// A processor lets one invocation splat a whole photon, a GPU several: the light is the same.
#[test]
fn flux_does_not_depend_on_how_many_share_a_photon() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room(glass());
    let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(10.0));
    scene.lights = vec![lamp.aimed(CENTER + vec3(0.3, 1.2, 0.4), Vec3::ZERO)];
    let settings = [("resolution", "64")];
    let [one, several] = [[1, 1], [4, 64]].map(|splat_lanes| {
        let technique = generated_by(&gpu, &scene, &settings, 1, Some(splat_lanes));
        assert_eq!(technique.kernels.lanes(64, 1), splat_lanes[1]);
        technique.maps.get().unwrap().caustics[0].flux(&gpu)
    });
    check("several invocations", several, one, 1e-3);
    let is_software = gpu.adapter.is_software();
    let own = generated(&gpu, &scene, &settings, 1).kernels.splat_lanes;
    assert_eq!(own, if is_software { [1, 1] } else { [4, 64] });
}

#[test]
fn flux_of_spots_and_directions_arrives() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room(mirror());
    scene.lights = vec![
        Light::new("", LightKind::Directional, vec3(1.0, 2.0, 3.0))
            .aimed(vec3(0.0, 1.0, 0.3), Vec3::ZERO),
    ];
    // Remove the walls: they would block a light from outside.
    scene.instances.retain(|instance| instance.name == "ball");
    let floor = quad(
        vec3(-90.0, -1.0, 90.0),
        Vec3::X * 180.0,
        Vec3::NEG_Z * 180.0,
        1,
    );
    let mesh = scene.add_mesh(floor);
    scene.add_instance("floor", mesh, 0, Mat4::IDENTITY);
    let disc = PI * f64::from(RADIUS * RADIUS);
    // A mirror ball reflects a parallel beam equally into all directions. Half goes below the horizon, less what misses
    // the floor beyond its edge.
    let found = flux(&gpu, &scene, &[("resolution", "128")], 1);
    check(
        "directional",
        found,
        0.5 * disc * DVec3::new(1.0, 2.0, 3.0),
        0.03,
    );

    let mut scene = room(mirror());
    let spot = LightKind::Spot {
        inner_cone_angle: 0.8,
        outer_cone_angle: 1.0,
    };
    let at = CENTER + vec3(0.0, 1.1, 0.0);
    scene.lights = vec![Light::new("", spot, Vec3::splat(2.0)).aimed(at, CENTER)];
    let found = flux(&gpu, &scene, &[("resolution", "128")], 1);
    check(
        "spot",
        found,
        falling(f64::from((at - CENTER).length()), 2.0) * DVec3::ONE,
        0.01,
    );
    // A spot that points away.
    scene.lights = vec![Light::new("", spot, Vec3::splat(2.0)).aimed(at, at + Vec3::Y)];
    assert_eq!(flux(&gpu, &scene, &[], 1), DVec3::ZERO);
}

/// An area light is the sum of its sample points, each a small light.
#[test]
fn flux_of_lamps_arrives() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room(mirror());
    let side = 0.2;
    let lamp = quad(
        CENTER + vec3(-side / 2.0, 1.4, -side / 2.0),
        Vec3::X * side,
        Vec3::Z * side,
        1,
    );
    assert!(lamp.normals[0].y < 0.0);
    let mesh = scene.add_mesh(lamp);
    let material = scene.add_material(Material::emitter("lamp", Vec3::splat(5.0)));
    scene.add_instance("lamp", mesh, material, Mat4::IDENTITY);
    let settings = [("resolution", "256"), ("area-samples", "64")];
    let found = flux(&gpu, &scene, &settings, 1);
    // L A times the form factor of a sphere straight below a small square (Howell's catalogue, B-37): pi (R/h)^2 to
    // three digits.
    let expected = 5.0 * f64::from(side * side) * PI * (f64::from(RADIUS) / 1.4).powi(2);
    check("lamp", found, expected * DVec3::ONE, 0.02);
}

/// An occluder between a light and the ball blocks the light.
#[test]
fn flux_is_kept_by_what_is_in_the_way() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room(glass());
    let above = CENTER + Vec3::Y * 1.2;
    scene.lights = vec![Light::new("", LightKind::Point, Vec3::ONE).aimed(above, Vec3::ZERO)];
    for turned in [1.0, -1.0] {
        let mut covered = scene.clone();
        let screen = quad(
            above - vec3(turned * 0.5, 0.3, 0.5),
            Vec3::X * turned,
            Vec3::Z,
            1,
        );
        let mesh = covered.add_mesh(screen);
        covered.add_instance("screen", mesh, 0, Mat4::IDENTITY);
        assert_eq!(flux(&gpu, &covered, &[], 1), DVec3::ZERO, "{turned}");
    }
}

/// Glass between a light and the ball blocks the light, too: what passes through it belongs to its own caustic.
#[test]
fn flux_is_not_counted_twice() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room(glass());
    let mut above = scene.instances.last().unwrap().clone();
    above.world_from_mesh = Mat4::from_translation(CENTER + Vec3::Y * 1.05);
    above.name = "above".into();
    let light = Light::new("", LightKind::Point, Vec3::ONE);
    scene.lights = vec![light.aimed(CENTER + Vec3::Y * 1.7, Vec3::ZERO)];
    let alone = flux(&gpu, &scene, &[], 1);
    assert!(alone.x > 0.1, "{alone}");
    scene.instances.push(above);
    let found = fluxes(&gpu, &scene, &[], 1);
    assert_eq!(found[0], DVec3::ZERO, "the ball is in the other's shadow");
    assert!(found[1].x > 0.1, "{found:?}");
}

/// Frames whose sample points lie on lamps that do not shine on the object count as frames without light, whichever
/// comes first.
#[test]
fn flux_of_lamps_that_face_away_is_none() {
    let Some(gpu) = test_gpu() else { return };
    let side = Vec3::splat(0.2);
    let settings = [("area-samples", "1"), ("frames", "8")];
    let found = [true, false].map(|first| {
        let mut scene = room(mirror());
        let material = scene.add_material(Material::emitter("lamp", Vec3::splat(5.0)));
        for down in [first, !first] {
            let away = if down { Vec3::Z } else { Vec3::NEG_Z };
            let corner = CENTER + 1.3 * Vec3::Y - side * (Vec3::X + away) / 2.0;
            let mesh = scene.add_mesh(quad(corner, side * Vec3::X, side * away, 1));
            scene.add_instance("lamp", mesh, material, Mat4::IDENTITY);
        }
        flux(&gpu, &scene, &settings, 8)
    });
    let expected = 5.0 * 0.04 * PI * (f64::from(RADIUS) / 1.3).powi(2);
    for found in found {
        check("lamp", found, expected * DVec3::ONE, 0.2);
    }
}
