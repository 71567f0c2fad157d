//! The picture: from lit pixels to those of a display. A film collects radiance; effects change it in the order of
//! [`Picture::record`]; the last one encodes it in 8 bits.

mod comparison;
pub mod effects;
mod film;
mod live;
mod present;
mod surfaces;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use comparison::{Compared, Comparison};
pub use effects::Effects;
pub use effects::exposure::Exposure;
pub use effects::tone_map::ToneMap;
pub use film::{Shot, Strip};
pub use present::Present;
pub use surfaces::{Quantity, Surfaces};

use crate::gpu::{Frame, Gpu, GpuError, ReadBack, begin_read_buffer, read_buffer, read_texture};
use crate::scene::GpuScene;
use effects::{
    denoise, depth_of_field, encode, exposure, flare, glow, motion_blur, temporal_antialiasing,
};
use film::Still;
use gpugi_scene::{Camera, Lens, Projection};
use live::Live;

/// What is shown.
#[derive(Debug, Clone, Copy)]
pub enum Shown<'a> {
    /// The picture.
    Picture,
    /// The picture and its reference.
    Compared(&'a Comparison, Compared),
    /// What its pixels see, in colours.
    Surfaces(&'a Surfaces, Quantity),
}

/// Turns the radiance of pictures of one size into pixels, once per frame.
#[derive(Debug)]
pub struct Picture {
    size: [u32; 2],
    /// Made when a still picture is shown, or a live one.
    still: Option<Still>,
    live: Option<(Live, temporal_antialiasing::Pass)>,
    denoise: denoise::Pass,
    depth_of_field: depth_of_field::Pass,
    motion_blur: motion_blur::Pass,
    glow: glow::Pass,
    flare: flare::Pass,
    exposure: exposure::Pass,
    encode: encode::Pass,
}

/// A picture's pixels as they are lit.
#[derive(Debug, Clone, Copy)]
pub struct Lit<'a> {
    /// Its strips that have been lit, from top to bottom.
    pub strips: &'a [Strip<'a>],
    /// Samples that it has.
    pub samples: u32,
    /// How many it will sum at rest.
    pub of: u32,
    /// How it is seen.
    pub shot: Shot,
    /// Whether its samples see through points of the lens, instead of its middle.
    pub is_through_lens: bool,
    /// Time between this picture and the one before (s), for what changes over time; 0 if it is not known.
    pub seconds: f32,
}

impl Picture {
    /// For pictures of `size` pixels (width, height).
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Ok(Self {
            size,
            still: None,
            live: None,
            denoise: denoise::Pass::default(),
            depth_of_field: depth_of_field::Pass::default(),
            motion_blur: motion_blur::Pass::default(),
            glow: glow::Pass::default(),
            flare: flare::Pass::default(),
            exposure: exposure::Pass::new(gpu)?,
            encode: encode::Pass::new(gpu, size)?,
        })
    }

    /// The same for pictures of another size; it compiles nothing. Live pictures remember what earlier ones showed, and how
    /// these were exposed; of still ones, the exposure alone.
    ///
    /// # Errors
    /// As [`Picture::new`].
    pub fn resized(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let mut frame = Frame::without_waiting(gpu, false);
        let live = self.live.as_ref().map(|(live, blend)| {
            let live = live.resized(&mut frame, size)?;
            Ok::<_, GpuError>((live, blend.clone()))
        });
        let live = live.transpose()?;
        frame.submit()?;
        Ok(Self {
            size,
            still: None,
            live,
            denoise: self.denoise.resized(),
            depth_of_field: self.depth_of_field.resized(),
            motion_blur: self.motion_blur.resized(),
            glow: self.glow.resized(),
            flare: self.flare.resized(),
            exposure: self.exposure.clone(),
            encode: self.encode.resized(gpu, size)?,
        })
    }

    /// Makes what `effects` need of a scene's pictures, and begins to compile it. `is_noisy`: techniques tell which part of
    /// their light is.
    ///
    /// # Errors
    /// As [`Picture::new`].
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        (camera, is_noisy): (&Camera, bool),
        effects: &Effects,
    ) -> Result<(), GpuError> {
        if is_noisy && effects.temporal_antialiasing.is_on() {
            self.denoise.prepare(gpu)?;
        }
        let radiance = if effects.temporal_antialiasing.is_on() {
            &live(&mut self.live, gpu, scene, self.size)?.0.radiance
        } else {
            &still(&mut self.still, gpu, self.size)?.radiance
        };
        let format = radiance.texture().format();
        if effects.temporal_antialiasing.is_on() {
            (self.depth_of_field).prepare(gpu, &camera.lens, &effects.depth_of_field)?;
            (self.motion_blur).prepare(gpu, camera.shutter, &effects.motion_blur)?;
        }
        self.glow.prepare(gpu, format, &effects.glow)?;
        self.flare.prepare(gpu, format, &effects.flare)
    }

    /// Forgets what earlier pictures showed.
    pub fn forget(&mut self) {
        if let Some((live, _)) = &mut self.live {
            live.forget();
        }
        self.depth_of_field.forget();
        self.exposure.forget();
    }

    /// Notes that the next picture is another one, and this one the one before.
    pub fn advance(&mut self) {
        if let Some((live, _)) = &mut self.live {
            live.advance();
        }
        self.exposure.advance();
    }

    /// Records the passes from lit pixels to those of a display: film, effects, display. Negative radiance shows as 0,
    /// infinite radiance as white, NaN as black. Record at most once per frame, because the settings reach the GPU when the
    /// frame is submitted.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when what is shown has another size.
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        lit: Lit<'_>,
        shown: Shown<'_>,
        effects: &Effects,
    ) -> Result<(), GpuError> {
        let camera = Optics {
            tangent: lit.shot.tangent,
            lens: lit.shot.lens,
            seconds: lit.seconds,
        };
        if let Shown::Surfaces(surfaces, quantity) = shown {
            let colors = surfaces.record(frame, lit.strips, quantity)?;
            return self.finish(frame, colors, camera, None, &effects.of_colors());
        }
        let (gpu, size) = (frame.gpu, self.size);
        let antialiasing = &effects.temporal_antialiasing;
        let radiance = if antialiasing.is_on() {
            let (film, blend) = live(&mut self.live, gpu, scene, size)?;
            film.record(frame, scene, lit.strips, lit.shot)?;
            let samples = [lit.samples, lit.of];
            let is_filtered = denoise::is_noisy(lit.strips);
            let lit_film =
                self.denoise
                    .record(frame, film, lit.strips, size, samples, &effects.denoise)?;
            if lit.is_through_lens {
                // What frames saw through the middle of the lens is another picture.
                film.end_history();
                &(self.depth_of_field).fade(frame, &lit_film, size, samples)?
            } else {
                let exposure = &self.exposure.value;
                let radiance = blend.record(
                    frame,
                    film,
                    (&lit_film, is_filtered),
                    samples,
                    exposure,
                    antialiasing,
                )?;
                let settings = &effects.depth_of_field;
                let radiance = &(self.depth_of_field)
                    .record(frame, radiance, film, &lit.shot, size, settings)?;
                // At rest nothing moves, and while no time passes nobody knows how far.
                let time = match lit.of <= 1 && lit.seconds > 0.0 {
                    true => lit.shot.shutter / lit.seconds,
                    false => 0.0,
                };
                let settings = &effects.motion_blur;
                &(self.motion_blur).record(frame, radiance, film, time, size, settings)?
            }
        } else {
            let film = still(&mut self.still, gpu, size)?;
            film.record(frame, lit.strips, size[0])?;
            &film.radiance
        };
        let radiance = &radiance.clone();
        let seen = Some(flare::Seen {
            scene,
            shot: &lit.shot,
            strips: lit.strips,
        });
        match shown {
            Shown::Compared(comparison, compared) => {
                let colors = comparison.record(frame, radiance, self.size, compared)?;
                self.finish(frame, colors, camera, seen, &compared.effects(effects))
            }
            _ => self.finish(frame, radiance, camera, seen, effects),
        }
    }

    /// The effects from glow on, of a picture by `camera`. `seen`: by the picture's pixels.
    fn finish(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        camera: Optics,
        seen: Option<flare::Seen<'_>>,
        effects: &Effects,
    ) -> Result<(), GpuError> {
        let size = self.size;
        let glowing = &(self.glow).record(frame, radiance, size, camera.tangent, &effects.glow)?;
        let radiance = &(self.flare).record(frame, glowing, camera, seen, &effects.flare)?;
        (self.exposure).record(frame, radiance, size, camera, effects)?;
        let exposure = &self.exposure.value;
        (self.encode).record(frame, radiance, size, camera, exposure, effects)
    }

    /// The pixels of the last submitted frame: RGBA, 8 bits per channel, sRGB-encoded, alpha 255, in rows from top to
    /// bottom.
    ///
    /// # Errors
    /// The errors of [`read_buffer`].
    pub fn pixels(&self, gpu: &Gpu) -> Result<Vec<u8>, GpuError> {
        self.begin_pixels(gpu)?.wait()
    }

    /// Mean linear radiance of the last live picture, filtered and averaged over frames, before lens and display: three
    /// floats per pixel, in rows from top to bottom. Empty if there was none.
    ///
    /// # Errors
    /// The errors of [`read_texture`].
    pub fn live_radiance(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        let Some((live, _)) = &self.live else {
            return Ok(Vec::new());
        };
        let texture = live.now().radiance.texture();
        let halves: Vec<[half::f16; 4]> =
            read_texture(gpu, texture, wgpu::TextureAspect::All, 0, 0)?;
        let rgb = |&[r, g, b, _]: &[half::f16; 4]| [r, g, b].map(f32::from);
        Ok(halves.iter().flat_map(rgb).collect())
    }

    /// The future of [`Picture::pixels`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin_pixels(&self, gpu: &Gpu) -> Result<ReadBack<Vec<u8>>, GpuError> {
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        begin_read_buffer(gpu, &self.encode.pixels, pixels * 4)
    }

    /// The exposure value (EV) of the last submitted frame: the manual value, or the result of automatic exposure.
    ///
    /// # Errors
    /// The errors of [`read_buffer`].
    pub fn exposure_value(&self, gpu: &Gpu) -> Result<f32, GpuError> {
        let value: Vec<f32> = read_buffer(gpu, &self.exposure.value, size_of::<f32>() as u64)?;
        Ok(value[0])
    }
}

/// What effects know of the camera of a picture.
#[derive(Debug, Clone, Copy)]
struct Optics {
    /// Tangent of half its vertical field of view; 0 if all rays are parallel.
    tangent: f32,
    lens: Lens,
    /// Time since the picture before (s), or 0.
    seconds: f32,
}

/// The film of live pictures of `size` pixels, and the pass that blends them; made on first use.
fn live<'a>(
    kept: &'a mut Option<(Live, temporal_antialiasing::Pass)>,
    gpu: &Gpu,
    scene: &GpuScene,
    size: [u32; 2],
) -> Result<&'a mut (Live, temporal_antialiasing::Pass), GpuError> {
    match kept {
        Some(made) => Ok(made),
        none => Ok(none.insert((
            Live::new(gpu, scene, size)?,
            temporal_antialiasing::Pass::new(gpu)?,
        ))),
    }
}

/// The film of still pictures of `size` pixels; made on first use.
fn still<'a>(
    kept: &'a mut Option<Still>,
    gpu: &Gpu,
    size: [u32; 2],
) -> Result<&'a mut Still, GpuError> {
    match kept {
        Some(made) => Ok(made),
        none => Ok(none.insert(Still::new(gpu, size)?)),
    }
}

/// Tangent of half the vertical field of view, 45 degrees, of pictures whose camera is not known.
const TANGENT: f32 = 0.414_213_57;

/// The pixels of a picture of `size` pixels on the host, given as three floats of mean radiance per pixel, in rows from
/// top to bottom. They have the format of [`Picture::pixels`]. Effects that depend on the field of view take 45 degrees.
///
/// # Errors
/// [`GpuError::TooLarge`] when the adapter's textures are smaller, [`GpuError::OutOfMemory`], [`GpuError::Lost`].
pub fn developed(
    gpu: &Gpu,
    size: [u32; 2],
    radiance: &[f32],
    effects: &Effects,
) -> Result<Vec<u8>, GpuError> {
    let camera = Optics {
        tangent: TANGENT,
        lens: Lens::PINHOLE,
        seconds: 0.0,
    };
    develop(gpu, size, radiance, camera, effects)
}

/// As [`developed`], of what `camera` saw.
///
/// # Errors
/// As [`developed`].
pub fn developed_of(
    gpu: &Gpu,
    size: [u32; 2],
    radiance: &[f32],
    camera: &Camera,
    effects: &Effects,
) -> Result<Vec<u8>, GpuError> {
    let tangent = match camera.projection {
        Projection::Perspective { vertical_fov } => (vertical_fov / 2.0).tan(),
        Projection::Orthographic { .. } => 0.0,
    };
    let camera = Optics {
        tangent,
        lens: camera.lens,
        seconds: 0.0,
    };
    develop(gpu, size, radiance, camera, effects)
}

fn develop(
    gpu: &Gpu,
    size: [u32; 2],
    radiance: &[f32],
    camera: Optics,
    effects: &Effects,
) -> Result<Vec<u8>, GpuError> {
    if size.contains(&0) {
        return Ok(Vec::new());
    }
    let film = film::radiance_32(gpu, size)?;
    let padded: Vec<[f32; 4]> = radiance
        .as_chunks::<3>()
        .0
        .iter()
        .map(|&[r, g, b]| [r, g, b, 1.0])
        .collect();
    let texture = film.texture();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(size[0] * 16),
        rows_per_image: None,
    };
    gpu.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&padded),
        layout,
        texture.size(),
    );
    let mut picture = Picture::new(gpu, size)?;
    let mut frame = Frame::new(gpu, false);
    picture.finish(&mut frame, &film, camera, None, effects)?;
    frame.submit()?;
    picture.pixels(gpu)
}
