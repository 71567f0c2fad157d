//! Features of the path tracer's image: what the camera's rays see of surfaces.

use super::PathTracer;
use super::tile::{BLOCK_PIXELS, Tile};
use crate::denoise::Features;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, begin_read_buffer};
use crate::scene::GpuScene;
use crate::shader;

/// Samples after which features are known well enough.
pub(super) const MOST_SAMPLES: u32 = 32;

/// The kernel that looks at surfaces.
#[derive(Debug)]
pub(super) struct Looker {
    kernel: Kernel,
    view: wgpu::Buffer,
    parameters: wgpu::Buffer,
    automaton: wgpu::Buffer,
}

impl Looker {
    /// `constants` beside those of rays; the buffers are the path tracer's.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        constants: &[(&str, f64)],
        [view, parameters, automaton]: [&wgpu::Buffer; 3],
    ) -> Result<Self, GpuError> {
        Ok(Self {
            kernel: scene.ray_kernel(gpu, &shader!("reference.features"), constants)?,
            view: view.clone(),
            parameters: parameters.clone(),
            automaton: automaton.clone(),
        })
    }

    /// Features of `pixels` pixels.
    pub fn film(&self, gpu: &Gpu, pixels: u32) -> Result<wgpu::Buffer, GpuError> {
        let bytes = u64::from(pixels) * size_of::<Features>() as u64;
        gpu.buffer(
            "path-tracer.features [bytes]",
            bytes,
            wgpu::BufferUsages::STORAGE,
        )
    }

    /// Adds the samples of a batch of `blocks` blocks of a tile, which `parameters` describe, to its features.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        features: &wgpu::Buffer,
        blocks: u32,
    ) -> Result<(), GpuError> {
        let resources: [Named<'_>; 4] = [
            ("seen", &self.view),
            ("settings", &self.parameters),
            ("automaton", &self.automaton),
            ("film", features),
        ];
        frame.compute("path-tracer.features", |pass| {
            let scene = Some(&scene.ray_bind_group);
            let invocations = [blocks * BLOCK_PIXELS, 1, 1];
            self.kernel.run(pass, scene, &resources, invocations)
        })
    }
}

impl PathTracer {
    /// Begins the picture anew, and keeps what its pixels see of surfaces ([`PathTracer::features`]): 80 bytes per pixel.
    /// That takes up to 32 rays per pixel, and more through glass, which limits of rays do not count.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn keep_features(&mut self) -> Result<(), GpuError> {
        if self.looker.is_none() {
            self.forget();
            self.tiles.clear();
            let constants = &[(
                "HAS_TRANSMISSION",
                f64::from(u8::from(self.has_transmission)),
            )];
            let buffers = [&self.view, &self.parameters, &self.automaton];
            self.looker = Some(Looker::new(&self.gpu, &self.scene, constants, buffers)?);
            if let Err(error) = self.make_tiles() {
                self.looker = None;
                self.make_tiles()?;
                return Err(error);
            }
        }
        Ok(())
    }

    /// What the pixels see of surfaces, over the first 32 samples or fewer, in rows from top to bottom; empty without
    /// [`PathTracer::keep_features`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn features(&self) -> Result<Vec<Features>, GpuError> {
        let width = self.size[0] as usize;
        let kept = self
            .tiles
            .iter()
            .filter_map(|tile| Some((tile, tile.features.as_ref()?)));
        let read = |(tile, features): (&Tile, &wgpu::Buffer)| {
            let bytes = u64::from(tile.pixels()) * size_of::<Features>() as u64;
            Ok::<_, GpuError>((
                tile.origin,
                tile.size,
                begin_read_buffer(&self.gpu, features, bytes)?,
            ))
        };
        let tiles: Vec<_> = kept.map(read).collect::<Result<_, _>>()?;
        let mut all = match tiles.is_empty() {
            true => Vec::new(),
            false => vec![Features::default(); width * self.size[1] as usize],
        };
        for (origin, size, features) in tiles {
            let features: Vec<Features> = features.wait()?;
            for (row, of_row) in features.chunks_exact(size[0] as usize).enumerate() {
                let first = (origin[1] as usize + row) * width + origin[0] as usize;
                all[first..first + of_row.len()].copy_from_slice(of_row);
            }
        }
        Ok(all)
    }
}
