//! Compares obscurances with closed forms and with a direct evaluation of their integral in double precision.

mod ambient;
mod openness;
mod sampling;
mod scenes;

use glam::{DVec3, Vec3};
use gpugi_scene::atlas::AtlasOptions;
use gpugi_scene::{Atlas, Scene};

use super::{Falloff, Mode, ObscurancePage, Settings, Solution};
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;
use crate::testing::read_points;

/// A texel with a surface: its place, and the values found there.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    instance: u32,
    position: DVec3,
    normal: DVec3,
    area: f64,
    plain: f64,
    colored: DVec3,
}

/// A scene, its upload as a mode needs it, and its obscurances.
struct Bench {
    scene: Scene,
    on_gpu: GpuScene,
    capture: AtlasCapture,
    obscurances: Solution,
}

impl Bench {
    fn new(
        gpu: &Gpu,
        scene: Scene,
        atlas: &AtlasOptions,
        capture: &AtlasCaptureOptions,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let atlas = Atlas::new(&scene, atlas).unwrap();
        let on_gpu = match settings.mode {
            Mode::Rays => GpuScene::with_rays(gpu, &scene)?,
            Mode::Peeling => GpuScene::new(gpu, &scene)?,
        };
        let capture = AtlasCapture::new(gpu, &scene, &on_gpu, &atlas, capture)?;
        let obscurances = Solution::new(gpu, &scene, &on_gpu, &atlas, &capture, settings)?;
        Ok(Self {
            scene,
            on_gpu,
            capture,
            obscurances,
        })
    }

    /// Takes one step.
    fn step(&mut self, gpu: &Gpu) {
        let mut frame = Frame::new(gpu, false);
        self.on_gpu.merge(&mut frame);
        self.capture.record(&mut frame, &self.on_gpu).unwrap();
        self.obscurances
            .record(&mut frame, &self.on_gpu, &self.capture)
            .unwrap();
        frame.submit().unwrap();
    }

    /// Takes steps until all are done.
    fn finish(&mut self, gpu: &Gpu) -> Vec<ObscurancePage> {
        self.step(gpu);
        while !self.obscurances.is_done() {
            self.step(gpu);
        }
        assert_eq!(self.obscurances.progress(), 1.0);
        self.obscurances.pages(gpu).unwrap()
    }

    fn follow(&mut self, gpu: &Gpu, after: Scene) {
        self.on_gpu.update(gpu, &after).unwrap();
        self.scene = after;
    }

    /// The texels with surfaces.
    fn found(&self, gpu: &Gpu, pages: &[ObscurancePage]) -> Vec<Found> {
        let plain = pages.iter().flat_map(|page| &page.obscurance);
        let colored = pages.iter().flat_map(|page| {
            page.colored
                .clone()
                .unwrap_or(vec![Vec3::ZERO; page.obscurance.len()])
        });
        let points = self.capture.points();
        let points = points.flat_map(|points| read_points(gpu, &self.on_gpu, points));
        let found = points.zip(plain.zip(colored));
        let found = found.filter(|(point, _)| point.instance != u32::MAX);
        found
            .map(|(point, (&plain, colored))| Found {
                instance: point.instance,
                position: point.position.as_dvec3(),
                normal: point.geometric_normal.as_dvec3(),
                area: f64::from(point.area),
                plain: f64::from(plain),
                colored: colored.as_dvec3(),
            })
            .collect()
    }
}

/// All obscurances of a scene.
fn found(gpu: &Gpu, scene: &Scene, size: u32, settings: &Settings) -> Vec<Found> {
    let atlas = AtlasOptions {
        size,
        ..Default::default()
    };
    let options = AtlasCaptureOptions::default();
    let mut bench = Bench::new(gpu, scene.clone(), &atlas, &options, settings).unwrap();
    let pages = bench.finish(gpu);
    bench.found(gpu, &pages)
}

/// Root mean square.
fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = errors.fold((0.0, 0), |(sum, count), error| {
        (sum + error * error, count + 1)
    });
    assert!(count > 0, "nothing is compared");
    (sum / f64::from(count)).sqrt()
}
