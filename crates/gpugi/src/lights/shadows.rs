//! The depth maps of light samples, in one atlas.

use super::LightList;
use super::gpu::table;
use crate::capture::depth::{DepthAtlas, DepthKernels};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel};
use crate::scene::GpuScene;

/// Light samples and their depth maps, for passes that import table.wesl.
#[derive(Debug)]
pub struct Shadows {
    kernels: DepthKernels,
    comparison: wgpu::Sampler,
    maps: Option<DepthMaps>,
}

/// The samples and views of a list of lights.
#[derive(Debug)]
struct DepthMaps {
    atlas: DepthAtlas,
    table: HostBuffer,
    light_count: u32,
}

impl Shadows {
    /// Compiles the passes that draw depth.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: DepthKernels::of_lamps(gpu, scene)?,
            comparison: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("shadow comparison"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                // A point is lit if it is at least as near as the map's depth.
                compare: Some(wgpu::CompareFunction::GreaterEqual),
                ..Default::default()
            }),
            maps: None,
        })
    }

    /// Draws the maps of `list` in the pass `pass`; returns whether earlier results of [`Shadows::bind`] are stale.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the views do not fit one atlas.
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pass: &str,
        list: LightList,
    ) -> Result<bool, GpuError> {
        let gpu = frame.gpu;
        let light_count = list.samples.len() as u32;
        if light_count == 0 {
            return Ok(self.maps.take().is_some());
        }
        // A light that moved needs no new tiles: only their content changes.
        let reused = self.maps.take().and_then(|mut made| {
            let is_same = made.light_count == light_count && made.atlas.update(gpu, &list.views);
            is_same.then_some(made)
        });
        let is_new = reused.is_none();
        let made = match reused {
            Some(made) => {
                let rows = table(&list.samples, &made.atlas.uniforms());
                made.table.write(gpu, &rows);
                made
            }
            None => {
                let atlas = DepthAtlas::new(gpu, &self.kernels, list.views)?;
                let rows = table(&list.samples, &atlas.uniforms());
                let size = std::mem::size_of_val(rows.as_slice()) as u64;
                let usage = wgpu::BufferUsages::STORAGE;
                let table = HostBuffer::new(gpu, "light table [bytes]", size, usage)?;
                table.write(gpu, &rows);
                DepthMaps {
                    table,
                    atlas,
                    light_count,
                }
            }
        };
        made.atlas
            .record(frame, pass, &self.kernels, scene.casters());
        self.maps = Some(made);
        Ok(is_new)
    }

    /// Bind group 2 of a kernel that imports table.wesl and uses group 2 for it alone; `None` without lights.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn bind(&self, gpu: &Gpu, kernel: &Kernel) -> Result<Option<wgpu::BindGroup>, GpuError> {
        let Some(made) = &self.maps else {
            return Ok(None);
        };
        let resources = [
            (
                "shadow_atlas",
                wgpu::BindingResource::TextureView(&made.atlas.view),
            ),
            (
                "shadow_comparison",
                wgpu::BindingResource::Sampler(&self.comparison),
            ),
            ("light_table", made.table.as_entire_binding()),
        ];
        kernel.bind(gpu, 2, &resources).map(Some)
    }

    /// Number of light samples.
    pub fn light_count(&self) -> u32 {
        self.maps.as_ref().map_or(0, |made| made.light_count)
    }

    /// The depth atlas, once generated.
    pub fn atlas(&self) -> Option<&DepthAtlas> {
        self.maps.as_ref().map(|made| &made.atlas)
    }
}
