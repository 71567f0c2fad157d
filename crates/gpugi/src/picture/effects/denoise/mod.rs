//! Denoising: the light that techniques draw for each point by chance is averaged over the latest frames and over the pixels
//! around that show the same surface; light without noise stays sharp. docs/effects/denoise.md.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use crate::capture::Target;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::picture::film::{Shot, Strip, texture};
use crate::picture::live::Live;
use crate::scene::{Inputs, Versions};
use crate::shader;

crate::choices! {
    /// What noisy light is averaged over.
    pub enum Filter {
        /// Nothing.
        None = "none",
        /// The pixels around.
        Spatial = "spatial",
        /// The frames before, and the pixels around.
        Temporal = "temporal",
    }
}

crate::settings! {
    /// Settings of denoising.
    #[derive(Copy)]
    pub struct Settings {
        /// What noisy light of live pictures is averaged over: none; spatial, pixels around that show the same surface;
        /// temporal, these and the frames before.
        pub filter: Filter = Filter::Temporal => any(),
        /// Frames that are averaged while something moves.
        pub frames: u32 = 32 => in_range(1.0, 255.0),
        /// Whether a pixel that is brighter than all around it becomes as bright as the brightest of them.
        pub clamp: bool = false => any(),
        /// Passes over the pixels around, each twice as far as the one before.
        pub passes: u32 = 5 => in_range(1.0, 6.0),
    }
}

/// Whether any technique tells which part of its light is noisy.
pub(in crate::picture) fn is_noisy(strips: &[Strip<'_>]) -> bool {
    let mut targets = strips.iter().map(|strip| &strip.receiver.target);
    targets.any(Target::is_noisy)
}

/// Frames after a change in which the history is not trusted as it is.
const UNSETTLED_FRAMES: u32 = 16;

/// Frames that count after lights or materials have changed, which changes light everywhere.
const FEW_FRAMES: u32 = 4;

/// Deviations from the mean of what the latest frames saw around a pixel that the history may have after objects have
/// moved, whose shadows change light here and there.
const DEVIATIONS: f32 = 0.5;

/// Samples of a picture at rest after which what earlier frames saw no longer counts, and if they saw other light.
const REST_SAMPLES: u32 = 32;
const REST_SAMPLES_OF_OTHER_LIGHT: u32 = 8;

/// `Filter` of guide.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct FilterUniform {
    size: [u32; 2],
    samples: f32,
    most_before: f32,
    deviations: f32,
    step: u32,
    is_last: u32,
    has_moved: u32,
    clamps: u32,
    padding: [u32; 3],
}

/// What is remembered of a picture: rgba16float.
#[derive(Debug)]
struct Memory {
    /// Mean of many frames, and their number.
    long: wgpu::TextureView,
    /// Mean of few, and the root mean square of their luminance.
    short: wgpu::TextureView,
    /// What guides the filter: rgba32uint.
    guides: wgpu::TextureView,
}

/// Textures of pictures of one size.
#[derive(Debug)]
struct Textures {
    /// This picture's and that of the picture before, by [`Live::turn`].
    memories: [Memory; 2],
    incident: wgpu::TextureView,
    signals: [wgpu::TextureView; 2],
    lit: wgpu::TextureView,
}

#[derive(Debug, Clone)]
struct Kernels {
    prepare: Kernel,
    accumulate: Kernel,
    estimate: Kernel,
    smooth: Kernel,
}

/// The passes.
#[derive(Debug, Default)]
pub(in crate::picture) struct Pass {
    kernels: Option<Kernels>,
    textures: Option<Textures>,
    /// [`Live::turn`] of the picture that was filtered last.
    turn: Option<usize>,
    /// Frames since anything changed, and since more did than places.
    settled: [u32; 2],
}

impl Pass {
    /// The same for pictures of another size, without memory; it compiles nothing.
    pub fn resized(&self) -> Self {
        Self {
            kernels: self.kernels.clone(),
            // Another size changes nothing that was seen.
            settled: self.settled,
            ..Self::default()
        }
    }

    /// Begins to compile it.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn prepare(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.kernels.is_some() {
            return Ok(());
        }
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        self.kernels = Some(Kernels {
            prepare: kernel(shader!("picture.effects.denoise.prepare"))?,
            accumulate: kernel(shader!("picture.effects.denoise.accumulate"))?,
            estimate: kernel(shader!("picture.effects.denoise.estimate"))?,
            smooth: kernel(shader!("picture.effects.denoise.smooth"))?,
        });
        Ok(())
    }

    /// Filters the noise of a film of `samples` samples, which will have `of` at rest: passes `picture.denoise`. Returns
    /// the film's radiance with it.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        film: &Live,
        strips: &[Strip<'_>],
        size: [u32; 2],
        [samples, of]: [u32; 2],
        settings: &Settings,
    ) -> Result<wgpu::TextureView, GpuError> {
        let gpu = frame.gpu;
        if !is_noisy(strips) {
            return Ok(film.radiance.clone());
        }
        self.prepare(gpu)?;
        let Some(kernels) = &self.kernels else {
            return Ok(film.radiance.clone());
        };
        let (now, before) = (film.now(), film.before());
        let [versions, versions_before] =
            [now, before].map(|image| image.shot.map(|shot| shot.versions));
        let is_new = self.turn.replace(film.turn()) != Some(film.turn());
        let but_places = Inputs::GEOMETRY.without();
        let light = |versions: Option<Versions>| versions.map(|versions| versions.of(but_places));
        let has_changed = [
            versions != versions_before,
            light(versions) != light(versions_before),
        ];
        for (settled, has_changed) in self.settled.iter_mut().zip(has_changed) {
            *settled = match (versions_before, has_changed) {
                (None, _) => UNSETTLED_FRAMES,
                // Samples of one picture all have the history of the picture before.
                (Some(_), true) => 0,
                (Some(_), false) => settled.saturating_add(is_new.into()),
            };
        }
        let textures = match &mut self.textures {
            Some(textures) => textures,
            none => none.insert(Textures::new(gpu, size)?),
        };
        let seen_from = |shot: &Shot| shot.film_from_world;
        let has_moved = now.shot.as_ref().map(seen_from) != before.shot.as_ref().map(seen_from);
        let end = match has_changed[1] {
            true => REST_SAMPLES_OF_OTHER_LIGHT,
            false => REST_SAMPLES,
        };
        let end = end.min(of).max(2);
        let rest = end.saturating_sub(samples) as f32 / (end - 1) as f32;
        let [is_settled, is_lit_alike] = self.settled.map(|frames| frames >= UNSETTLED_FRAMES);
        let frames = match is_lit_alike {
            true => settings.frames,
            false => settings.frames.min(FEW_FRAMES),
        };
        let remembers = before.shot.is_some() && settings.filter == Filter::Temporal;
        let filter = FilterUniform {
            size,
            samples: samples as f32,
            most_before: match remembers {
                true => (frames - 1) as f32 * rest,
                false => 0.0,
            },
            deviations: match is_settled {
                true => 0.0,
                false => DEVIATIONS,
            },
            step: (settings.filter != Filter::None).into(),
            is_last: 0,
            has_moved: has_moved.into(),
            clamps: settings.clamp.into(),
            padding: [0; 3],
        };
        let uniform = gpu.constant("denoise", &filter)?;
        let memory = &textures.memories[film.turn()];
        let last = &textures.memories[1 - film.turn()];
        for strip in strips {
            let of_strip = FilterUniform {
                samples: strip.samples.max(1) as f32,
                ..filter
            };
            let of_strip = gpu.constant("denoise", &of_strip)?;
            let own: [Named<'_>; 4] = [
                ("surfaces", &now.surfaces),
                ("parameters", &of_strip),
                ("incident", &textures.incident),
                ("guides", &memory.guides),
            ];
            let rows = strip.rows.end - strip.rows.start;
            let resources = join(&strip.receiver.resources(), &own);
            let name = "picture.denoise.prepare";
            frame.run(name, &kernels.prepare, None, &resources, [size[0], rows, 1])?;
        }
        let invocations = [size[0], size[1], 1];
        let resources: [Named<'_>; 9] = [
            ("noise", &textures.incident),
            ("guides", &memory.guides),
            ("motion", &film.motion),
            ("long_before", &last.long),
            ("short_before", &last.short),
            ("guides_before", &last.guides),
            ("parameters", &uniform),
            ("long", &memory.long),
            ("short", &memory.short),
        ];
        let name = "picture.denoise.accumulate";
        frame.run(name, &kernels.accumulate, None, &resources, invocations)?;
        let resources: [Named<'_>; 5] = [
            ("guides", &memory.guides),
            ("long", &memory.long),
            ("short", &memory.short),
            ("parameters", &uniform),
            ("signal", &textures.signals[0]),
        ];
        let name = "picture.denoise.estimate";
        frame.run(name, &kernels.estimate, None, &resources, invocations)?;
        // One pass that averages nothing gives the light its reflectance back.
        let passes = match settings.filter {
            Filter::None => 1,
            Filter::Spatial | Filter::Temporal => settings.passes,
        };
        for pass in 0..passes {
            let is_last = pass + 1 == passes;
            let filter = FilterUniform {
                step: filter.step << pass,
                is_last: is_last.into(),
                ..filter
            };
            let uniform = gpu.constant("denoise", &filter)?;
            let [from, to] =
                [pass % 2, 1 - pass % 2].map(|index| &textures.signals[index as usize]);
            let resources: [Named<'_>; 7] = [
                ("long", &memory.long),
                ("guides", &memory.guides),
                ("motion", &film.motion),
                ("radiance", &film.radiance),
                ("signal", from),
                ("parameters", &uniform),
                ("smoothed", if is_last { &textures.lit } else { to }),
            ];
            let name = "picture.denoise.smooth";
            frame.run(name, &kernels.smooth, None, &resources, invocations)?;
        }
        Ok(textures.lit.clone())
    }
}

impl Textures {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let guides = || texture(gpu, "denoise.guides", wgpu::TextureFormat::Rgba32Uint, size);
        let texture = |label: &str| texture(gpu, label, wgpu::TextureFormat::Rgba16Float, size);
        let memory = || {
            Ok::<_, GpuError>(Memory {
                long: texture("denoise.long")?,
                short: texture("denoise.short")?,
                guides: guides()?,
            })
        };
        Ok(Self {
            memories: [memory()?, memory()?],
            incident: texture("denoise.incident")?,
            signals: [texture("denoise.signal")?, texture("denoise.signal")?],
            lit: texture("denoise.lit")?,
        })
    }
}
