//! One frame's commands: named passes, timed if the adapter supports it.

use std::ops::Range;

use super::read_back::{ReadBack, record_buffer};
use super::{Gpu, GpuError, Kernel, Named, Quad};

/// GPU time of one pass.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Timing {
    /// The pass, such as `shadow-map.gather`.
    pub pass: String,
    /// GPU milliseconds.
    pub milliseconds: f64,
}

/// Maximum number of timed passes per frame.
const TIMED_PASSES: u32 = 1024;

/// The commands of one frame, recorded pass by pass and submitted together.
#[derive(Debug)]
pub struct Frame<'a> {
    /// The device they run on.
    pub gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    /// The compute pass that later untimed dispatches join. A separate pass per dispatch would cost more than the
    /// dispatch itself, and WebGPU orders the dispatches within one pass, too.
    joined: Option<wgpu::ComputePass<'static>>,
    queries: Option<wgpu::QuerySet>,
    passes: Vec<String>,
    never_waits: bool,
}

fn encoder(gpu: &Gpu) -> wgpu::CommandEncoder {
    gpu.device
        .create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("frame"),
        })
}

/// Which contents the targets of a render pass keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Keeps {
    /// Nothing: colours are cleared to all ones, depth to 0 (infinitely far).
    Nothing,
    /// Colours; depth is cleared to 0.
    Colors,
    /// Colours and depth.
    Everything,
}

fn load<V>(keeps: bool, cleared: V) -> wgpu::LoadOp<V> {
    if keeps {
        wgpu::LoadOp::Load
    } else {
        wgpu::LoadOp::Clear(cleared)
    }
}

/// Where a render pass writes its times.
fn timestamps(
    queries: &Option<(wgpu::QuerySet, u32)>,
) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
    queries
        .as_ref()
        .map(|(query_set, at)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(*at),
            end_of_pass_write_index: Some(at + 1),
        })
}

impl<'a> Frame<'a> {
    /// An empty frame. `timed` asks for timestamps, which some adapters lack.
    pub fn new(gpu: &'a Gpu, timed: bool) -> Self {
        let queries = (timed && gpu.has_timestamps).then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass timings"),
                ty: wgpu::QueryType::Timestamp,
                count: TIMED_PASSES * 2,
            })
        });
        Self {
            gpu,
            encoder: encoder(gpu),
            joined: None,
            queries,
            passes: Vec::new(),
            never_waits: false,
        }
    }

    /// As [`Frame::new`], for loops that must not block. A pass waits for its shaders; in such a frame, techniques whose
    /// shaders are still being compiled record none, and what they light is pending.
    pub fn without_waiting(gpu: &'a Gpu, timed: bool) -> Self {
        Self {
            never_waits: true,
            ..Self::new(gpu, timed)
        }
    }

    /// Whether it is one of [`Frame::without_waiting`].
    pub(crate) fn never_waits(&self) -> bool {
        self.never_waits
    }

    /// Whether shaders are being compiled that it must not wait for. In a browser, each call compiles one.
    pub fn awaits_shaders(&self) -> bool {
        self.never_waits && self.gpu.is_compiling()
    }

    /// The query set for the next pass and the first of its two query indices, if the pass is timed.
    fn next_queries(&mut self, name: &str) -> Option<(wgpu::QuerySet, u32)> {
        let at = self.passes.len() as u32;
        let queries = self.queries.clone().filter(|_| at < TIMED_PASSES)?;
        self.passes.push(name.to_owned());
        Some((queries, at * 2))
    }

    /// The encoder, for commands outside compute passes.
    fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.joined = None;
        &mut self.encoder
    }

    /// Records a compute pass. An untimed one joins the compute pass before it.
    pub fn compute<T>(
        &mut self,
        name: &str,
        record: impl FnOnce(&mut wgpu::ComputePass<'_>) -> T,
    ) -> T {
        let Some((query_set, at)) = self.next_queries(name) else {
            let encoder = &mut self.encoder;
            let pass = self.joined.get_or_insert_with(|| {
                encoder
                    .begin_compute_pass(&Default::default())
                    .forget_lifetime()
            });
            return record(pass);
        };
        let descriptor = wgpu::ComputePassDescriptor {
            label: Some(name),
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: &query_set,
                beginning_of_pass_write_index: Some(at),
                end_of_pass_write_index: Some(at + 1),
            }),
        };
        record(&mut self.encoder().begin_compute_pass(&descriptor))
    }

    /// Records a compute pass in which one kernel runs: see [`Kernel::run`].
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn run(
        &mut self,
        name: &str,
        kernel: &Kernel,
        scene: Option<&wgpu::BindGroup>,
        resources: &[Named<'_>],
        invocations: [u32; 3],
    ) -> Result<(), GpuError> {
        self.compute(name, |pass| kernel.run(pass, scene, resources, invocations))
    }

    /// Records a render pass that clears its targets: colours to all ones, depth to 0 (infinitely far).
    pub fn render<T>(
        &mut self,
        name: &str,
        colors: &[&wgpu::TextureView],
        depth: &wgpu::TextureView,
        record: impl FnOnce(&mut wgpu::RenderPass<'_>) -> T,
    ) -> T {
        self.render_onto(name, Keeps::Nothing, colors, depth, record)
    }

    /// Like [`Frame::render`], but the targets keep what `keeps` says.
    pub fn render_onto<T>(
        &mut self,
        name: &str,
        keeps: Keeps,
        colors: &[&wgpu::TextureView],
        depth: &wgpu::TextureView,
        record: impl FnOnce(&mut wgpu::RenderPass<'_>) -> T,
    ) -> T {
        let queries = self.next_queries(name);
        let attachments: Vec<_> = colors
            .iter()
            .map(|view| {
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        // In an unsigned integer target this is the largest number, which means "no hit".
                        load: load(
                            keeps >= Keeps::Colors,
                            wgpu::Color {
                                r: f64::from(u32::MAX),
                                g: f64::from(u32::MAX),
                                b: 0.0,
                                a: 0.0,
                            },
                        ),
                        store: wgpu::StoreOp::Store,
                    },
                })
            })
            .collect();
        let mut pass = self
            .encoder()
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(name),
                color_attachments: &attachments,
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: depth,
                    depth_ops: Some(wgpu::Operations {
                        load: load(keeps >= Keeps::Everything, 0.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                timestamp_writes: timestamps(&queries),
                ..Default::default()
            });
        record(&mut pass)
    }

    /// Records a render pass that draws in front of `depth`, which it only reads. The colour target keeps its contents,
    /// or is cleared to zeros.
    pub fn render_in_front<T>(
        &mut self,
        name: &str,
        keeps: bool,
        color: &wgpu::TextureView,
        depth: &wgpu::TextureView,
        record: impl FnOnce(&mut wgpu::RenderPass<'_>) -> T,
    ) -> T {
        let queries = self.next_queries(name);
        let mut pass = self
            .encoder()
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(name),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: color,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: load(keeps, wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: depth,
                    depth_ops: None,
                    stencil_ops: None,
                }),
                timestamp_writes: timestamps(&queries),
                ..Default::default()
            });
        record(&mut pass)
    }

    /// Records a pass that fills `target` with one triangle; it is not timed.
    pub(crate) fn draw_quad(
        &mut self,
        name: &str,
        quad: &Quad,
        group: &wgpu::BindGroup,
        target: &wgpu::TextureView,
    ) {
        quad.draw(self.encoder(), name, group, target);
    }

    /// Fills a buffer with zeros.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.encoder().clear_buffer(buffer, 0, None);
    }

    /// Fills these bytes of a buffer, from and to multiples of 4, with zeros.
    pub fn clear_range(&mut self, buffer: &wgpu::Buffer, bytes: Range<u64>) {
        let size = bytes.end.saturating_sub(bytes.start);
        self.encoder().clear_buffer(buffer, bytes.start, Some(size));
    }

    /// Copies the first `bytes` of a buffer to `offset` in another one (both multiples of 4).
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, [offset, bytes]: [u64; 2]) {
        self.encoder()
            .copy_buffer_to_buffer(from, 0, to, offset, bytes);
    }

    /// Copies a buffer into a texture; the buffer's rows lie `bytes_per_row` apart (a multiple of 256).
    pub fn fill(&mut self, texture: &wgpu::Texture, buffer: &wgpu::Buffer, bytes_per_row: u32) {
        self.encoder().copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(bytes_per_row),
                    rows_per_image: None,
                },
            },
            texture.as_image_copy(),
            texture.size(),
        );
    }

    /// Copies some rows of a texture to another texture of the same size and format.
    pub fn copy_rows(&mut self, from: &wgpu::Texture, to: &wgpu::Texture, rows: Range<u32>) {
        let at = |texture| wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d {
                y: rows.start,
                ..Default::default()
            },
            aspect: wgpu::TextureAspect::All,
        };
        let extent = wgpu::Extent3d {
            height: rows.end - rows.start,
            ..from.size()
        };
        self.encoder()
            .copy_texture_to_texture(at(from), at(to), extent);
    }

    /// Copies a buffer's first `size` bytes, as they are at this point of the frame, to the host. The data arrives some
    /// time after the frame is submitted.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn read_back<T: bytemuck::Pod>(
        &mut self,
        buffer: &wgpu::Buffer,
        size: u64,
    ) -> Result<ReadBack<Vec<T>>, GpuError> {
        record_buffer(self.gpu, self.encoder(), buffer, size)
    }

    /// Submits what is recorded so far, so that the GPU begins with it while the CPU records the rest. Errors arrive at
    /// [`Frame::submit`].
    pub fn flush(&mut self) {
        self.joined = None;
        let recorded = std::mem::replace(&mut self.encoder, encoder(self.gpu));
        self.gpu.submit(recorded.finish());
    }

    /// Submits the frame to the GPU without waiting for it. Returns the future times of its passes, if the frame is
    /// timed.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when a pass is invalid (the message names its pipeline), [`GpuError::Lost`],
    /// [`GpuError::OutOfMemory`].
    pub fn submit(mut self) -> Result<Timings, GpuError> {
        let gpu = self.gpu;
        self.joined = None;
        let count = self.passes.len() as u32;
        let mut timings = Timings::default();
        if let Some(queries) = self.queries.filter(|_| count > 0) {
            let size = u64::from(count) * 16;
            let resolved = gpu.buffer("pass timings", size, wgpu::BufferUsages::QUERY_RESOLVE)?;
            self.encoder
                .resolve_query_set(&queries, 0..count * 2, &resolved, 0);
            timings.frames.push(TimedFrame {
                ticks: record_buffer(gpu, &mut self.encoder, &resolved, size)?,
                period: f64::from(gpu.queue.get_timestamp_period()) * 1e-6,
                passes: self.passes,
            });
        }
        gpu.submit(self.encoder.finish());
        gpu.bindings.end_frame();
        gpu.check()?;
        Ok(timings)
    }
}

/// GPU times of the passes of one or more frames, on their way to the host. Empty for untimed frames.
#[derive(Debug, Default)]
pub struct Timings {
    frames: Vec<TimedFrame>,
}

#[derive(Debug)]
struct TimedFrame {
    ticks: ReadBack<Vec<u64>>,
    /// Milliseconds per tick.
    period: f64,
    passes: Vec<String>,
}

impl TimedFrame {
    fn times(self, ticks: &[u64]) -> impl Iterator<Item = Timing> {
        let milliseconds = ticks
            .chunks(2)
            .map(|ticks| ticks[1].saturating_sub(ticks[0]) as f64 * self.period);
        let milliseconds: Vec<f64> = milliseconds.collect();
        let passes = self.passes.into_iter().zip(milliseconds);
        passes.map(|(pass, milliseconds)| Timing { pass, milliseconds })
    }
}

impl Timings {
    /// Appends the times of a later frame.
    pub fn then(mut self, later: Self) -> Self {
        self.frames.extend(later.frames);
        self
    }

    /// The times, once they have arrived.
    ///
    /// # Errors
    /// [`GpuError::Lost`].
    pub async fn arrival(self) -> Result<Vec<Timing>, GpuError> {
        let mut all = Vec::new();
        for mut frame in self.frames {
            let ticks = (&mut frame.ticks).await?;
            all.extend(frame.times(&ticks));
        }
        Ok(all)
    }

    /// Blocks until the times have arrived.
    ///
    /// # Errors
    /// [`GpuError::Lost`].
    pub fn wait(self) -> Result<Vec<Timing>, GpuError> {
        if let Some(frame) = self.frames.first() {
            frame.ticks.gpu().wait()?;
        }
        pollster::block_on(self.arrival())
    }
}
