//! Entry points and light samples on the GPU: a receiver, which earlier techniques light.

use bytemuck::Zeroable;

use gpugi_scene::LightPathPanes;

use super::entries::{COLUMN, Entries};
use super::{Settings, stored};
use crate::capture::{Output, Receiver, SurfacePoints, Target, ViewUniform};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::scene::GpuScene;
use crate::shader;

/// Points per row of their hit records.
pub(super) const WIDTH: u32 = 128;

/// Entry points, and light samples behind them.
#[derive(Debug)]
pub(super) struct EntryPoints {
    /// What the host knows of them.
    pub entries: Entries,
    /// The points, and their irradiance (W/m^2).
    pub receiver: Receiver,
    /// First entry point of each cluster, and behind the last one the end of all; then the same of light samples.
    pub firsts: wgpu::Buffer,
    places: wgpu::Buffer,
    resolve: Kernel,
}

impl EntryPoints {
    /// Room for the entry points of a scene.
    pub fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
        let rows = (settings.entries * settings.light_samples).div_ceil(WIDTH);
        let count = WIDTH * rows;
        let mut view = ViewUniform {
            width: WIDTH,
            height: rows,
            seed: settings.seed,
            ..Zeroable::zeroed()
        };
        let output = Output::Irradiance;
        output.write(&mut view);
        let view = gpu.uniform("view of entry points", &view)?;
        let label = "entry points [bytes]";
        let points = SurfacePoints::room(gpu, label, [WIDTH, rows], view, output)?;
        let firsts = 2 * (u64::from(settings.clusters) + 1) * 4;
        Ok(Self {
            entries: Entries::default(),
            receiver: Receiver::new(&points, &Target::new(gpu, count)?),
            firsts: gpu.room("clusters of entry points [bytes]", firsts)?,
            places: gpu.room("places of entry points [bytes]", u64::from(count) * 16)?,
            resolve: Kernel::new(
                gpu,
                &shader!("techniques.light_path_map.entries"),
                "main",
                Some(&scene.layout),
            )?,
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let Receiver { points, target, .. } = &self.receiver;
        let kept = [&points.points, &target.radiance, &self.firsts, &self.places];
        kept.iter().map(|buffer| buffer.size()).sum()
    }

    /// Chooses the points anew, on the scene's surfaces as they are, or takes those of `stored` panes.
    pub fn choose(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        stored: Option<&LightPathPanes>,
    ) {
        self.entries = match (scene.host(), stored) {
            (Some(host), Some(stored)) => stored::entries(host, stored),
            (Some(host), None) => {
                let samples = settings.entries * (settings.light_samples - 1);
                let (entries, clusters) = (settings.entries, settings.clusters);
                Entries::new(host, entries, samples, clusters)
            }
            (None, _) => Entries::default(),
        };
        self.write(gpu);
    }

    /// Clusters the entry points by rows of numbers, one row per entry point, instead.
    pub fn cluster_by(&mut self, gpu: &Gpu, columns: &[[f32; COLUMN]]) {
        self.entries.cluster_by(columns);
        self.write(gpu);
    }

    /// Copies the points and their clusters to the GPU.
    fn write(&self, gpu: &Gpu) {
        let entries = self.entries.points();
        let places = entries.map(|entry| {
            let [u, v] = entry.barycentrics.to_array().map(f32::to_bits);
            [entry.instance, entry.triangle, u, v]
        });
        gpu.write(&self.places, 0, &places.collect::<Vec<_>>());
        let firsts = [&self.entries.firsts[..], &self.entries.first_samples].concat();
        gpu.write(&self.firsts, 0, &firsts);
    }

    /// Captures the points: pass `light-path-map.entries`. `work`: `Work` of light_path.wesl.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn resolve(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        work: &wgpu::Buffer,
    ) -> Result<(), GpuError> {
        let points = &self.receiver.points;
        let own: [Named<'_>; 2] = [("work", work), ("places", &self.places)];
        let resources = join(&points.resources(), &own);
        let (name, scene) = ("light-path-map.entries", Some(&scene.bind_group));
        frame.run(name, &self.resolve, scene, &resources, [points.count, 1, 1])
    }
}
