//! What techniques that keep light in the texels of an atlas have in common.

use std::ops::Range;

use gpugi_scene::Atlas;
use gpugi_scene::atlas::Seams;

use super::{
    AtlasCapture, AtlasCaptureOptions, AtlasLookup, Dilation, LeakTest, SeamFilter, TexelGather,
};
use crate::capture::{Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::GpuScene;
use crate::shader;

/// The texels of an atlas, where triangles find them, and which of them leak.
#[derive(Debug)]
pub(crate) struct KeptTexels {
    pub capture: AtlasCapture,
    pub lookup: AtlasLookup,
    pub leaks: LeakTest,
}

impl KeptTexels {
    /// The texels of an atlas of the scene, with at most `most` in one buffer.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, atlas: &Atlas, most: u32) -> Result<Self, GpuError> {
        let host = scene.host().ok_or_else(|| GpuError::Pass {
            pass: "capture.atlas".into(),
            reason: "there is an atlas, but no scene that it is one of".into(),
        })?;
        let options = AtlasCaptureOptions {
            most_texels: most,
            ..AtlasCaptureOptions::default()
        };
        let capture = AtlasCapture::new(gpu, host, scene, atlas, &options)?;
        Ok(Self {
            lookup: AtlasLookup::new(gpu, host, atlas)?,
            leaks: LeakTest::new(gpu, scene, &capture)?,
            capture,
        })
    }

    /// Captures and tests the points again if the scene has changed.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<(), GpuError> {
        self.capture.record(frame, scene)?;
        self.leaks.record(frame, scene, &self.capture);
        Ok(())
    }

    /// Width and height of all pages.
    pub fn size(&self) -> [u32; 2] {
        [self.capture.size, self.capture.size * self.capture.pages]
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let states = self.leaks.states().map(wgpu::Buffer::size);
        self.capture.bytes + self.lookup.words.size() + states.sum::<u64>()
    }
}

/// Cuts pieces of so many points into tiles of at most `most`: the number of a piece, and a range of its points.
pub(crate) fn tiles_of(pieces: impl Iterator<Item = u32>, most: u32) -> Vec<(usize, Range<u32>)> {
    let of_piece = |(number, count): (usize, u32)| {
        let firsts = (0..count).step_by(most as usize);
        firsts.map(move |first| (number, first..count.min(first + most)))
    };
    pieces.enumerate().flat_map(of_piece).collect()
}

/// Irradiance in texels, or in vertices, which gathers look up.
#[derive(Debug)]
pub(crate) struct KeptIrradiance {
    /// Irradiance (W/m^2) of all texels, row by row, with 1 in a.
    pub target: Target,
    /// Fills texels without a point from those around them, and makes seams agree.
    around: Option<(Dilation, SeamFilter)>,
    gather: TexelGather,
}

impl KeptIrradiance {
    /// For images of `size` texels, of an atlas of the scene unless they are vertices. `constants`: of the gather.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        size: [u32; 2],
        atlas: Option<&Atlas>,
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let target = Target::new(gpu, size[0] * size[1])?;
        let around = match (scene.host(), atlas) {
            (Some(host), Some(atlas)) => {
                let seams = SeamFilter::new(gpu, &Seams::new(host, atlas), &target)?;
                Some((Dilation::new(gpu, size)?, seams))
            }
            _ => None,
        };
        Ok(Self {
            gather: TexelGather::new(gpu, scene, &shader!("capture.atlas.gather"), constants)?,
            target,
            around,
        })
    }

    /// Fills texels without a point: pass `capture.atlas.dilate`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn fill(&self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        match &self.around {
            Some((dilation, _)) => dilation.record(frame, &self.target),
            None => Ok(()),
        }
    }

    /// The same, and makes both sides of seams agree: passes `capture.atlas.dilate` and `capture.atlas.seams`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn finish(&self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        self.fill(frame)?;
        if let Some((_, seams)) = &self.around {
            seams.record(frame);
        }
        Ok(())
    }

    /// Adds the light at the receiver's points, which find their texels by `lookup`, in the pass `name`. `texels`: those
    /// of the atlas, if their own points may be lit.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        receiver: &Receiver,
        (texels, lookup): (Option<&AtlasCapture>, &wgpu::Buffer),
    ) -> Result<(), GpuError> {
        let kept: [Named<'_>; 2] = [("atlas", lookup), ("irradiance", &self.target)];
        self.gather
            .record(frame, name, scene, texels, receiver, &kept)
    }

    /// Bytes beside the irradiance.
    pub fn work_bytes(&self) -> u64 {
        let around = self.around.as_ref();
        around.map_or(0, |(dilation, seams)| dilation.bytes() + seams.bytes)
    }
}
