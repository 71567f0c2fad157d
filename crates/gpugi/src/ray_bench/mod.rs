//! Measures rays per second for `gpugi bench --technique bvh`.

use web_time::Instant;

use glam::Vec3;
use gpugi_scene::Scene;

use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, read_buffer};
use crate::scene::GpuScene;
use crate::shader;

/// Results for rays of one kind.
#[derive(Debug, Clone, serde::Serialize)]
pub struct RayRate {
    /// `primary`, `diffuse` or `shadow`.
    pub kind: &'static str,
    /// Whether the shader checks its accesses against the bounds of buffers and arrays.
    pub checked: bool,
    /// Rays per launch.
    pub rays: u64,
    /// Fraction of the rays that hit something.
    pub hit_fraction: f64,
    /// Duration of the fastest launch (ms).
    pub best_ms: f64,
    /// Duration of the median launch (ms).
    pub median_ms: f64,
    /// Million rays per second in the fastest launch.
    pub best_mrays: f64,
    /// Million rays per second in the median launch.
    pub median_mrays: f64,
    /// Average number of nodes that a ray is tested against.
    pub nodes: f64,
    /// Average number of triangles that a ray is tested against.
    pub triangles: f64,
    /// Average number of instances that a ray enters.
    pub instances: f64,
    /// Average number of bytes of the hierarchy that a ray reads.
    pub bytes: f64,
}

/// Timed launches per kind.
const LAUNCHES: usize = 20;

/// `Settings` of ray_bench/rays.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Settings {
    pub eye: [f32; 3],
    pub width: u32,
    pub direction: [f32; 3],
    pub height: u32,
    pub direction_dx: [f32; 3],
    pub offset: f32,
    pub direction_dy: [f32; 3],
    pub seed: u32,
    pub light: [f32; 3],
    pub padding: u32,
}

impl Settings {
    /// The camera looks at the middle of the scene from a point that is offset by (0.25, 0.2, 1) * 1.1 scene diagonals;
    /// its vertical field of view is 35 degrees. The light is above the scene.
    fn new(scene: &Scene, [width, height]: [u32; 2]) -> Self {
        let bounds = scene.bounds();
        let diagonal = bounds.diagonal();
        let eye = bounds.center() + Vec3::new(0.25, 0.2, 1.0) * 1.1 * diagonal;
        let forward = (bounds.center() - eye).normalize_or(Vec3::NEG_Z);
        let right = forward.cross(Vec3::Y).normalize_or(Vec3::X);
        let down = forward.cross(right);
        let pixel = 2.0 * 17.5_f32.to_radians().tan() / height as f32;
        let corner = forward
            - right * (pixel * 0.5 * (width as f32 - 1.0))
            - down * (pixel * 0.5 * (height as f32 - 1.0));
        Self {
            eye: eye.to_array(),
            width,
            direction: corner.to_array(),
            height,
            direction_dx: (right * pixel).to_array(),
            offset: 1e-4 * diagonal,
            direction_dy: (down * pixel).to_array(),
            seed: 1,
            light: (bounds.center() + Vec3::new(0.3, 1.0, 0.4) * diagonal).to_array(),
            padding: 0,
        }
    }
}

/// `Hit` of scene/bvh.wesl. Counting launches write nodes, triangles and instances instead.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Record {
    t: f32,
    nodes: u32,
    triangles: u32,
    padding: u32,
    instances: f32,
    padding_1: f32,
}

const RAY_BYTES: u64 = 32;

/// Measures closest hits of primary rays, closest hits of one diffuse bounce, and shadow rays (any hit toward a point
/// light above the scene). Each is measured with and without the shader's bounds checks.
///
/// # Errors
/// [`GpuError`].
pub fn measure(gpu: &Gpu, scene: &Scene, size: [u32; 2]) -> Result<Vec<RayRate>, GpuError> {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let bench = Bench {
        gpu,
        scene: GpuScene::with_rays(gpu, scene)?,
        size,
        settings: gpu.uniform("bench settings", &Settings::new(scene, size))?,
        hits: storage(gpu, pixels * std::mem::size_of::<Record>() as u64)?,
        primary: storage(gpu, pixels * std::mem::size_of::<Record>() as u64)?,
        rays: storage(gpu, pixels * RAY_BYTES)?,
        count: storage(gpu, 4)?,
    };
    let mut rates = Vec::new();
    for checked in [true, false] {
        for (kind, list, trace) in [
            ("primary", None, "primary"),
            ("diffuse", Some("bounces"), "closest"),
            ("shadow", Some("shadows"), "any"),
        ] {
            rates.push(bench.rate(kind, list, trace, checked)?);
        }
    }
    Ok(rates)
}

fn storage(gpu: &Gpu, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
    gpu.buffer("bench rays [bytes]", bytes, wgpu::BufferUsages::STORAGE)
}

struct Bench<'a> {
    gpu: &'a Gpu,
    scene: GpuScene,
    size: [u32; 2],
    settings: wgpu::Buffer,
    /// Written by the launches that are measured.
    hits: wgpu::Buffer,
    /// Hits of the primary rays, where the other rays start.
    primary: wgpu::Buffer,
    rays: wgpu::Buffer,
    count: wgpu::Buffer,
}

impl Bench<'_> {
    fn rate(
        &self,
        kind: &'static str,
        list: Option<&str>,
        trace: &str,
        checked: bool,
    ) -> Result<RayRate, GpuError> {
        let [width, height] = self.size;
        let pixels = [width, height, 1];
        let invocations = match list {
            None => pixels,
            Some(list) => {
                self.launch("primary", &self.primary, pixels, true, false, 1)?;
                self.gpu.write(&self.count, 0, &[0_u32]);
                self.launch(list, &self.primary, pixels, true, false, 1)?;
                let count: Vec<u32> = read_buffer(self.gpu, &self.count, 4)?;
                [count[0], 1, 1]
            }
        };
        let rays = u64::from(invocations[0]) * u64::from(invocations[1]);
        self.launch(trace, &self.hits, invocations, checked, true, 1)?;
        let counted: Vec<Record> = self.records(rays)?;
        let mean =
            |of: fn(&Record) -> f64| counted.iter().map(of).sum::<f64>() / rays.max(1) as f64;
        let [nodes, triangles, instances] = [
            mean(|record| f64::from(record.nodes)),
            mean(|record| f64::from(record.triangles)),
            mean(|record| f64::from(record.instances)),
        ];
        self.launch(trace, &self.hits, invocations, checked, false, 3)?;
        let mut times = self.launch(trace, &self.hits, invocations, checked, false, LAUNCHES)?;
        times.sort_by(f64::total_cmp);
        let hit = |record: &&Record| match trace {
            "any" => record.t > 0.0,
            _ => record.nodes != u32::MAX,
        };
        let hits = self.records(rays)?.iter().filter(hit).count();
        let mrays = |milliseconds: f64| rays as f64 / milliseconds / 1e3;
        let (best_ms, median_ms) = (times[0], times[times.len() / 2]);
        Ok(RayRate {
            kind,
            checked,
            rays,
            hit_fraction: hits as f64 / rays.max(1) as f64,
            best_ms,
            median_ms,
            best_mrays: mrays(best_ms),
            median_mrays: mrays(median_ms),
            nodes,
            triangles,
            instances,
            bytes: nodes * 80.0 + triangles * 48.0 + instances * 64.0,
        })
    }

    fn records(&self, count: u64) -> Result<Vec<Record>, GpuError> {
        read_buffer(
            self.gpu,
            &self.hits,
            count * std::mem::size_of::<Record>() as u64,
        )
    }

    /// Runs the entry point `times` times and returns the milliseconds of each launch.
    fn launch(
        &self,
        entry: &str,
        hits: &wgpu::Buffer,
        invocations: [u32; 3],
        checked: bool,
        count_tests: bool,
        times: usize,
    ) -> Result<Vec<f64>, GpuError> {
        let counts = ("COUNT_TESTS", f64::from(u8::from(count_tests)));
        let kernel = Kernel::with_options(
            self.gpu,
            &shader!("ray_bench.rays"),
            entry,
            Some(&self.scene.ray_layout),
            &KernelOptions {
                constants: &[&self.scene.ray_constants()[..], &[counts]].concat(),
                unchecked: !checked,
            },
        )?;
        let group = kernel.bind(
            self.gpu,
            1,
            &[
                ("settings", self.settings.as_entire_binding()),
                ("hits", hits.as_entire_binding()),
                ("rays", self.rays.as_entire_binding()),
                ("ray_count", self.count.as_entire_binding()),
            ],
        )?;
        let record = |frame: &mut Frame<'_>| {
            frame.compute(entry, |pass| {
                kernel.dispatch(
                    pass,
                    &[(0, &self.scene.ray_bind_group), (1, &group)],
                    invocations,
                );
            });
        };
        if !self.gpu.has_timestamps {
            return (0..times)
                .map(|_| {
                    let started = Instant::now();
                    let mut frame = Frame::new(self.gpu, false);
                    record(&mut frame);
                    frame.submit()?;
                    // Wait for the launch.
                    let _: Vec<u32> = read_buffer(self.gpu, &self.count, 4)?;
                    Ok(started.elapsed().as_secs_f64() * 1e3)
                })
                .collect();
        }
        // Use one frame per launch, so that a slow adapter's watchdog does not see all launches at once.
        (0..times)
            .map(|_| {
                let mut frame = Frame::new(self.gpu, true);
                record(&mut frame);
                Ok(frame.submit()?.wait()?[0].milliseconds)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::test_gpu;

    #[test]
    fn rates_are_of_the_rays_that_were_asked_for() {
        let Some(gpu) = test_gpu() else { return };
        let scene = gpugi_scene::builtin::builtin("cornell", 1).expect("a built-in scene");
        let rates = measure(&gpu, &scene, [40, 30]).unwrap();
        let kinds = rates.iter().map(|rate| (rate.kind, rate.checked));
        let all = [true, false]
            .map(|checked| ["primary", "diffuse", "shadow"].map(|kind| (kind, checked)));
        assert!(kinds.eq(all.into_iter().flatten()));
        for rates in rates.chunks(3) {
            let [primary, diffuse, shadow] = rates else {
                panic!()
            };
            assert_eq!(primary.rays, 40 * 30);
            let hits = primary.hit_fraction * primary.rays as f64;
            assert!(hits > 100.0 && hits < 1100.0, "{hits}");
            assert_eq!([diffuse.rays, shadow.rays], [hits.round() as u64; 2]);
            // The box is open only toward the eye, and the light is outside.
            assert!(diffuse.hit_fraction > 0.5 && diffuse.hit_fraction < 1.0);
            assert!(shadow.hit_fraction > 0.5, "{}", shadow.hit_fraction);
            for rate in rates {
                assert!(rate.nodes >= 1.0 && rate.triangles > 0.0 && rate.instances > 0.0);
                assert!(rate.best_ms > 0.0 && rate.best_ms <= rate.median_ms);
            }
        }
    }

    #[test]
    fn an_empty_scene_has_rates() {
        let Some(gpu) = test_gpu() else { return };
        let rates = measure(&gpu, &Scene::new("empty"), [8, 8]).unwrap();
        assert_eq!(rates[0].hit_fraction, 0.0);
        assert_eq!((rates[1].rays, rates[1].nodes), (0, 0.0));
    }
}
