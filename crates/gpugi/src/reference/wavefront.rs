//! The path tracer as a wavefront. Storage buffers hold a pool of paths. One kernel traces their rays and another
//! processes the vertices where the rays end, step by step (Laine, Karras, Aila, "Megakernels Considered Harmful:
//! Wavefront Path Tracing on GPUs", HPG 2013). Each kernel is small enough to leave a GPU's registers free for many
//! lanes, and all lanes of a step do the same work. New paths replace those that end.
//!
//! A step runs `plan` (one lane, which counts the paths and rays), `trace` (the shadow rays of the previous step and
//! the paths' rays) and `shade` (the vertices; lists the paths and shadow rays to continue with). The host reads
//! nothing back until it has submitted the estimated number of steps, or as many as the caller lets it trace rays. It
//! adds steps until the batch is done; then `resolve` adds the batch's samples to the film.

use crate::gpu::{Frame, Gpu, GpuError, Kernel, ReadBack, begin_read_buffer};
use crate::paths::gpu::Header;
use crate::paths::{Kernels, PATH_ROWS};
use crate::scene::GpuScene;
use crate::shader;

const ROW_BYTES: u64 = 16;
/// Paths in flight. On a GPU, enough to fill the largest GPUs for a millisecond; on a processor, as many as its caches
/// hold.
const PATHS: u64 = 1 << 20;
const PATHS_IN_SOFTWARE: u64 = 1 << 13;
/// Paths in flight where few rays may be traced at a time: fewer would leave most lanes of any GPU idle.
const LEAST_PATHS: u32 = 1 << 10;
/// Samples in a batch per path in flight. The pool runs empty only at the end of a batch.
const ITEMS_PER_PATH: u64 = 16;
/// Steps added if a batch takes more than the previous one.
const MORE_STEPS: u32 = 8;
/// Steps per submission, which a driver's watchdog sees as one piece of work. A step takes a millisecond on a large GPU
/// and about ten on a small one.
const STEPS_A_SUBMISSION: u32 = 16;

/// The kernels, the pool and their bind groups.
#[derive(Debug)]
pub(super) struct Wavefront {
    plan: Stage,
    trace: Stage,
    shade: Stage,
    resolve: Kernel,
    resolve_pool: wgpu::BindGroup,
    pub(super) lights: wgpu::BindGroup,
    pool: wgpu::Buffer,
    /// Workgroup counts of `trace` and `shade`, written by `plan`.
    arguments: wgpu::Buffer,
    pub(super) capacity: u32,
    /// Number of samples for which the results of a batch have room.
    pub(super) items: u32,
    /// Steps that the last batch took per round of as many items as the pool has paths.
    steps_per_round: f64,
}

/// A batch of samples that is being traced.
#[derive(Debug)]
pub(super) struct Batch {
    /// Number of its blocks.
    pub blocks: u32,
    items: u32,
    rounds: f64,
    /// Steps that it should still take.
    steps: u32,
    /// Most paths that a step may have.
    most_paths: u32,
}

/// A kernel with its bind groups 1 and 3.
#[derive(Debug)]
struct Stage {
    kernel: Kernel,
    own: wgpu::BindGroup,
    pool: wgpu::BindGroup,
}

/// Buffers with their names in the shaders.
pub(super) type Named<'a> = [(&'a str, &'a wgpu::Buffer)];

/// What [`Wavefront::light`] binds.
const LIGHTS: [&str; 3] = ["lights", "emitter_rows", "sky_grid"];

/// Most paths in flight.
fn paths(gpu: &Gpu) -> u64 {
    match gpu.adapter.device_type {
        wgpu::DeviceType::Cpu => PATHS_IN_SOFTWARE,
        _ => PATHS,
    }
}

/// A pool of so many rows.
fn pool(gpu: &Gpu, rows: u64) -> Result<wgpu::Buffer, GpuError> {
    let bytes = size_of::<Header>() as u64 + rows * ROW_BYTES;
    gpu.buffer(
        "path-tracer.pool [bytes]",
        bytes,
        wgpu::BufferUsages::STORAGE,
    )
}

fn bind(
    gpu: &Gpu,
    kernel: &Kernel,
    group: u32,
    buffers: &Named<'_>,
    names: &[&str],
) -> Result<wgpu::BindGroup, GpuError> {
    let resources: Vec<_> = buffers
        .iter()
        .filter(|(name, _)| names.contains(name))
        .map(|(name, buffer)| (*name, buffer.as_entire_binding()))
        .collect();
    kernel.bind(gpu, group, &resources)
}

impl Wavefront {
    /// The kernels. `constants` are those of path_state.wesl and bvh.wesl; `buffers` are `seen`, `settings`,
    /// `automaton`, `lights`, `emitter_rows` and `sky_grid`. [`Wavefront::resize`] has to follow.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        constants: &[(&str, f64)],
        buffers: &Named<'_>,
    ) -> Result<Self, GpuError> {
        // A binding must hold at least one row.
        let pool = pool(gpu, 1)?;
        let arguments = gpu.buffer(
            "path-tracer.arguments",
            24,
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT,
        )?;
        let mut all = buffers.to_vec();
        all.extend([("pool", &pool), ("arguments", &arguments)]);
        let Kernels { plan, trace, shade } = Kernels::new(gpu, scene, constants)?;
        let resolve = Kernel::new(gpu, &shader!("reference.resolve"), "main", None)?;
        let trace = Stage::new(gpu, trace, &all, &["seen", "settings", "automaton"])?;
        let shade = Stage::new(gpu, shade, &all, &["settings", "automaton"])?;
        Ok(Self {
            lights: bind(gpu, &shade.kernel, 2, &all, &LIGHTS)?,
            plan: Stage::new(gpu, plan, &all, &["arguments"])?,
            trace,
            shade,
            resolve_pool: bind(gpu, &resolve, 3, &all, &["pool"])?,
            resolve,
            pool,
            arguments,
            capacity: 0,
            items: 0,
            steps_per_round: 3.0,
        })
    }

    /// Takes other `lights`, `emitter_rows` and `sky_grid`.
    pub fn light(&mut self, gpu: &Gpu, buffers: &Named<'_>) -> Result<(), GpuError> {
        self.lights = bind(gpu, &self.shade.kernel, 2, buffers, &LIGHTS)?;
        Ok(())
    }

    /// Has memory for images of `size` pixels. Memory for larger ones stays.
    pub fn resize(&mut self, gpu: &Gpu, size: [u32; 2]) -> Result<(), GpuError> {
        let limits = gpu.limits();
        let rows = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size)
            / ROW_BYTES
            - 16;
        // Small images take several samples per pixel at once.
        let paths = paths(gpu);
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let wanted = (4 * pixels.min(paths)).next_multiple_of(64).min(paths);
        let capacity = wanted.min(rows / (PATH_ROWS + 4)) & !63;
        if capacity <= u64::from(self.capacity) {
            return Ok(());
        }
        let items = (rows - capacity * PATH_ROWS).min(capacity * ITEMS_PER_PATH) & !63;
        self.pool = pool(gpu, capacity * PATH_ROWS + items)?;
        let named = [("pool", &self.pool)];
        for stage in [&mut self.plan, &mut self.trace, &mut self.shade] {
            stage.pool = bind(gpu, &stage.kernel, 3, &named, &["pool"])?;
        }
        self.resolve_pool = bind(gpu, &self.resolve, 3, &named, &["pool"])?;
        (self.capacity, self.items) = (capacity as u32, items as u32);
        Ok(())
    }

    /// The bind group that `run` needs to write a film.
    pub fn film_group(
        &self,
        gpu: &Gpu,
        settings: &wgpu::Buffer,
        film: &wgpu::Buffer,
    ) -> Result<wgpu::BindGroup, GpuError> {
        let buffers = [("settings", settings), ("pixels", film)];
        bind(gpu, &self.resolve, 1, &buffers, &["settings", "pixels"])
    }

    /// Pixel samples in a batch of a large image.
    pub fn most_items(gpu: &Gpu) -> u64 {
        paths(gpu) * ITEMS_PER_PATH
    }

    /// Maximum number of pixel samples in a batch.
    pub fn items(&self) -> u32 {
        self.items
    }

    /// Begins the batch of samples that the settings describe, `blocks` blocks with `samples` samples per pixel from
    /// `first_sample` on. No more
    /// than about `rays` paths are in flight, so that a step traces no more.
    pub fn begin(
        &self,
        gpu: &Gpu,
        blocks: u32,
        samples: u32,
        (first_sample, seed): (u32, u32),
        rays: u64,
    ) -> Batch {
        let least = self.capacity.min(LEAST_PATHS);
        let capacity = rays.clamp(u64::from(least), u64::from(self.capacity)) as u32;
        let header = Header {
            capacity,
            items: blocks * 64 * samples,
            seed,
            first_sample,
            interval: 1,
            ..Default::default()
        };
        gpu.write(&self.pool, 0, std::slice::from_ref(&header));
        let rounds = f64::from(header.items) / f64::from(capacity) + 1.0;
        Batch {
            blocks,
            items: header.items,
            rounds,
            steps: (self.steps_per_round * rounds) as u32 + MORE_STEPS / 2,
            most_paths: capacity,
        }
    }

    /// Submits steps of a batch: as many as it should take, but at least one and about as many as trace `rays` rays.
    /// What it returns is for [`Wavefront::follow`].
    pub fn advance(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        batch: &mut Batch,
        rays: u64,
    ) -> Result<ReadBack<Vec<Header>>, GpuError> {
        let affordable = (rays / u64::from(batch.most_paths.max(1))).max(1);
        let mut left = u64::from(batch.steps).min(affordable) as u32;
        batch.steps -= left;
        while left > 0 {
            let portion = left.min(STEPS_A_SUBMISSION);
            let mut frame = Frame::new(gpu, false);
            frame.compute("path-tracer", |pass| {
                for _ in 0..portion {
                    self.step(pass, scene);
                }
            });
            frame.submit()?;
            left -= portion;
        }
        begin_read_buffer(gpu, &self.pool, std::mem::size_of::<Header>() as u64)
    }

    /// Takes notice of how far a batch is. Once it is done, adds it to a film and returns true.
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        film: &wgpu::BindGroup,
        batch: &mut Batch,
        after: &Header,
    ) -> Result<bool, GpuError> {
        let begun = after.first_item + after.alive - after.kept;
        let listed = after.listed + after.listed_shadow_rays;
        if begun < batch.items || listed > 0 {
            // The last paths of a batch leave most of the pool empty: more steps then trace as many rays.
            batch.most_paths = after.capacity.min(after.listed + (batch.items - begun));
            if batch.steps == 0 {
                batch.steps = MORE_STEPS;
            }
            return Ok(false);
        }
        self.steps_per_round = f64::from(after.steps) / batch.rounds;
        let mut frame = Frame::new(gpu, false);
        frame.compute("path-tracer.resolve", |pass| {
            let groups = [(1, film), (3, &self.resolve_pool)];
            let invocations = [batch.blocks * 64, 1, 1];
            self.resolve.dispatch(pass, &groups, invocations);
        });
        frame.submit()?;
        Ok(true)
    }

    fn step(&self, pass: &mut wgpu::ComputePass<'_>, scene: &GpuScene) {
        let Self {
            plan, trace, shade, ..
        } = self;
        let scene = (0, &scene.ray_bind_group);
        plan.kernel
            .dispatch(pass, &[(1, &plan.own), (3, &plan.pool)], [1, 1, 1]);
        let groups = [scene, (1, &trace.own), (3, &trace.pool)];
        trace
            .kernel
            .dispatch_indirect(pass, &groups, &self.arguments, 0);
        let groups = [scene, (1, &shade.own), (2, &self.lights), (3, &shade.pool)];
        shade
            .kernel
            .dispatch_indirect(pass, &groups, &self.arguments, 12);
    }
}

impl Stage {
    fn new(gpu: &Gpu, kernel: Kernel, buffers: &Named<'_>, own: &[&str]) -> Result<Self, GpuError> {
        Ok(Self {
            own: bind(gpu, &kernel, 1, buffers, own)?,
            pool: bind(gpu, &kernel, 3, buffers, &["pool"])?,
            kernel,
        })
    }
}
