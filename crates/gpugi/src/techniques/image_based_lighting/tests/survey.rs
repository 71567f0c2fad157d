//! Tests of the survey that decides from which parts of the environment each sample draws.

use glam::Vec3;
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::{Material, Scene};

use super::super::draws::Draws;
use super::super::survey::Key;
use super::{ImageBasedLighting, Settings, Sight, integral, still, sunny};
use crate::gpu::Gpu;
use crate::scene::{GpuScene, Versions};
use crate::techniques::Technique as _;
use crate::testing::test_gpu;

/// A room around the camera of [`Sight`], with a window toward -X.
fn room() -> Scene {
    let mut scene = sunny([128, 64]);
    let (low, high) = (Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 2.5, 3.5));
    let size = high - low;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let left = |bottom: f32, top: f32, back: f32, front: f32| {
        let corner = Vec3::new(low.x, bottom, front);
        quad(
            corner,
            Vec3::NEG_Z * (front - back),
            Vec3::Y * (top - bottom),
            1,
        )
    };
    let walls = [
        quad(low.with_z(high.z), x, -z, 1),
        quad(low.with_y(high.y), x, z, 1),
        quad(low, x, y, 1),
        quad(high.with_y(low.y), -x, y, 1),
        quad(high.with_y(low.y).with_z(low.z), z, y, 1),
        left(low.y, 0.8, low.z, high.z),
        left(1.8, high.y, low.z, high.z),
        left(0.8, 1.8, low.z, -0.7),
        left(0.8, 1.8, 0.7, high.z),
    ];
    let material = scene.add_material(Material::matt("wall", Vec3::splat(0.7)));
    for wall in walls {
        let mesh = scene.add_mesh(wall);
        scene.add_instance("wall", mesh, material, glam::Mat4::IDENTITY);
    }
    scene
}

/// The draws for what the camera of [`Sight`] sees of a scene.
fn surveyed(gpu: &Gpu, scene: &Scene) -> (ImageBasedLighting, Key) {
    let mut on_gpu = GpuScene::new(gpu, scene).unwrap();
    let mut technique = ImageBasedLighting::new(gpu, &on_gpu).unwrap();
    for (name, value) in [("per-sample", "true"), ("resolution", "64")] {
        technique.settings_mut().set(name, value).unwrap();
    }
    let mut sight = Sight::new(gpu, &on_gpu);
    sight.frame(gpu, &mut on_gpu, &mut technique);
    let versions = Versions {
        lights: 0,
        ..on_gpu.versions
    };
    let key = Key::new(versions, &technique.settings, &sight.view);
    (technique, key)
}

impl ImageBasedLighting {
    fn surveyed(&mut self, key: &Key) -> &Draws {
        let cells = self.sources.get().unwrap().cells.as_ref().unwrap();
        let survey = self.survey.get_mut().unwrap();
        survey.latest(key.clone(), cells)
    }

    fn blind(&self) -> Draws {
        let cells = self.sources.get().unwrap().cells.as_ref().unwrap();
        Draws::new(cells, Settings::default().samples, |_| 1.0)
    }
}

/// Share of the draws of some samples that lie on the window's side of the sky, and the light of all.
fn drawn(draws: &Draws) -> (f32, f32) {
    let of_samples = (0..64).flat_map(|turn| draws.of_sample(turn));
    let all: Vec<_> = of_samples.collect();
    let before = all.iter().filter(|domain| domain.toward.x < -0.1).count();
    let light: f32 = all.iter().map(|domain| domain.flux_density.x).sum();
    (before as f32 / all.len() as f32, light / 64.0)
}

#[test]
fn in_a_room_directions_lead_through_the_window() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room();
    let (mut technique, key) = surveyed(&gpu, &scene);
    let (blind, _) = drawn(&technique.blind());
    let draws = technique.surveyed(&key);
    let (found, light) = drawn(draws);
    println!("{blind} of the draws by power lie before the window, {found} after the survey");
    assert!(blind < 0.5 && found > 0.6, "{blind} {found}");
    // All light is still drawn from.
    let exact = integral(&scene)[0] as f32;
    assert!((light / exact - 1.0).abs() < 0.05, "{light}, {exact}");
    let (mut again, key) = surveyed(&gpu, &scene);
    assert_eq!(again.surveyed(&key).of_sample(3), draws.of_sample(3));
}

#[test]
fn in_the_open_draws_follow_power_alone() {
    let Some(gpu) = test_gpu() else { return };
    let (mut technique, key) = surveyed(&gpu, &still([128, 64]));
    let blind = technique.blind();
    assert_eq!(technique.surveyed(&key).of_sample(5), blind.of_sample(5));
}
