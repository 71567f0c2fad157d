//! Temporal anti-aliasing: a live frame has one sample per pixel, each frame at another place in the pixel. The average of
//! what the latest frames saw of the same surfaces has smooth edges, and less noise. docs/effects/temporal-antialiasing.md.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::picture::live::Live;
use crate::shader;

/// Frames that live views average.
pub const LIVE_FRAMES: u32 = 16;

/// Lookups at each pixel above which frames light one pixel of four, unless told otherwise: of the built-in scenes, those
/// of the station alone, which take one H100 20 ms per million pixels.
const MANY_LOOKUPS: u32 = 320;

/// Frames that are averaged while more than the camera moves.
const CHANGING_FRAMES: f32 = 6.0;

/// Deviations from the mean of its neighbours that the history of a diffuse surface may have: while only the camera moves,
/// and while anything else does. What differs then is noise, or a change of light.
const DEVIATIONS: [f32; 2] = [16.0, 1.0];

/// Frames that are averaged of pictures whose noise is filtered: more would only make them softer.
const FILTERED_FRAMES: u32 = 4;

/// Samples of a picture at rest after which what earlier frames saw no longer counts.
const REST_SAMPLES: u32 = 32;

crate::settings! {
    /// Settings of temporal anti-aliasing.
    #[derive(Copy)]
    pub struct Settings {
        /// Frames that are averaged while something moves; 1: off. At rest, a picture's own samples replace them.
        pub frames: u32 = 1 => in_range(1.0, 64.0),
        /// Distance, along rows and columns, of the pixels that a frame lights while something moves; 1: all; 0: 2 where
        /// techniques look up much at each pixel, else 1. The others follow from these and from the frames before, in which
        /// they had their turn.
        pub interval: u32 = 1 => in_range(0.0, 4.0).unit("pixels"),
    }
}

impl Settings {
    /// The interval of pictures that are lit by so many lookups at each pixel.
    pub(crate) fn interval_of(&self, lookups: u32) -> u32 {
        match self.interval {
            0 if lookups > MANY_LOOKUPS => 2,
            0 => 1,
            interval => interval,
        }
    }

    /// Whether frames remember those before them.
    pub fn is_on(&self) -> bool {
        self.frames > 1
    }
}

/// `Blend` of blend.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct BlendUniform {
    size: [u32; 2],
    /// Samples of this picture.
    samples: f32,
    /// Most frames before it that count, less as it gets samples of its own; 0: there are none.
    most_before: f32,
    deviations: f32,
    edges: f32,
    padding: [u32; 2],
}

/// The pass.
#[derive(Debug, Clone)]
pub(in crate::picture) struct Pass {
    kernel: Kernel,
    blend: HostBuffer,
    sampler: wgpu::Sampler,
}

impl Pass {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = shader!("picture.effects.temporal_antialiasing.blend");
        let bytes = size_of::<BlendUniform>() as u64;
        Ok(Self {
            kernel: Kernel::new(gpu, &shader, "main", None)?,
            blend: HostBuffer::new(gpu, "blend", bytes, wgpu::BufferUsages::UNIFORM)?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("history"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        })
    }

    /// Blends `radiance`, the film's, whose noise is filtered or not, with the picture before it. The film has `samples` of
    /// the `of` samples that it will have at rest. Pass
    /// `picture.temporal-antialiasing`. `exposure`: the exposure value of the frame before. Returns the picture.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record<'a>(
        &self,
        frame: &mut Frame<'_>,
        film: &'a Live,
        (radiance, is_filtered): (&wgpu::TextureView, bool),
        [samples, of]: [u32; 2],
        exposure: &wgpu::Buffer,
        settings: &Settings,
    ) -> Result<&'a wgpu::TextureView, GpuError> {
        let gpu = frame.gpu;
        let wgpu::Extent3d { width, height, .. } = radiance.texture().size();
        let size = [width, height];
        let (now, before) = (film.now(), film.before());
        // Of a picture at rest, the last sample ends their share.
        let end = REST_SAMPLES.min(of).max(2);
        let rest = end.saturating_sub(samples) as f32 / (end - 1) as f32;
        let [versions_now, versions_before] =
            [now, before].map(|image| image.shot.map(|shot| shot.versions));
        let is_changing = versions_now != versions_before;
        let frames = match is_filtered {
            true => settings.frames.min(FILTERED_FRAMES),
            false => settings.frames,
        };
        let most = (frames - 1) as f32;
        let blend = BlendUniform {
            size,
            samples: samples as f32,
            most_before: match before.shot {
                Some(_) if is_changing => most.min(CHANGING_FRAMES) * rest,
                Some(_) => most * rest,
                None => 0.0,
            },
            deviations: DEVIATIONS[usize::from(is_changing)],
            edges: rest / samples.max(1) as f32,
            padding: [0; 2],
        };
        self.blend.write(gpu, &[blend]);
        let resources: [Named<'_>; 9] = [
            ("radiance", radiance),
            ("surfaces", &now.surfaces),
            ("motion", &film.motion),
            ("history", &before.radiance),
            ("surfaces_before", &before.surfaces),
            ("between", &self.sampler),
            ("blend", &self.blend),
            ("exposure", exposure),
            ("blended", &now.radiance),
        ];
        frame.compute("picture.temporal-antialiasing", |pass| {
            self.kernel
                .run(pass, None, &resources, [size[0], size[1], 1])
        })?;
        Ok(&now.radiance)
    }
}
