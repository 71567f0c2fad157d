//! Flare: what a lens throws where it does not belong. Pairs of its surfaces reflect light twice, which makes ghosts, and
//! the edges of its stop diffract it, which makes rays. docs/effects/flare.md.

mod coating;
mod ghosts;
mod prescription;
mod sources;
#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

pub use coating::Coating;

use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::picture::Optics;
use crate::picture::film::{Shot, Strip, texture};
use crate::scene::GpuScene;
use crate::shader;
use gpugi_scene::Lens;
use prescription::Prescription;
use sources::{LAMPS, PLACES, Source};

crate::settings! {
    /// Settings of the flare.
    #[derive(Copy)]
    pub struct Settings {
        /// How much of the lens' stray light is shown; 0: off, 1: as much as in the lens.
        pub strength: f32 = 0.0 => in_range(0.0, 1000.0),
        /// Focal length of the lens over the diameter of its opening.
        pub f_number: f32 = 8.0 => in_range(2.0, 32.0),
        /// Blades of its stop, 3 to 16, where the camera's own lens has no aperture; fewer: it is round.
        pub blades: u32 = 6 => in_range(0.0, 16.0),
        /// What its surfaces are coated with: none, single.
        pub coating: Coating = Coating::Single => any(),
        /// Whether pairs of surfaces make ghosts.
        pub ghosts: bool = true => any(),
        /// Whether the stop's edges make rays, or a halo if it is round.
        pub rays: bool = true => any(),
    }
}

impl Settings {
    /// Whether the lens throws any light.
    pub fn is_on(&self) -> bool {
        self.strength > 0.0 && (self.ghosts || self.rays)
    }
}

/// Height of the film (m), that of 36 x 24 mm.
const FILM_HEIGHT: f32 = 0.024;
/// Rows of tiles, of which the light is summed, in a picture. A lamp as wide as a few of them is a few sources.
const TILE_ROWS: u32 = 16;
/// Least side of a tile (pixels).
const LEAST_TILE: u32 = 8;
/// Invocations of its workgroups.
const LANES: u32 = 256;
/// Bytes of `Ghost` of flare.wesl.
const GHOST_BYTES: u64 = 112;
/// Bytes of `Found` of sources.wesl.
const FOUND_BYTES: u64 = 16 + MOST_SOURCES * size_of::<Source>() as u64;
const MOST_SOURCES: u64 = PLACES as u64 + LAMPS as u64;

/// `Flare` of flare.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct FlareUniform {
    size: [u32; 2],
    pixel: f32,
    strength: f32,
    opening: f32,
    pupil: f32,
    radius: f32,
    blades: u32,
    tangent_step: f32,
    angles: u32,
    ghosts: u32,
    lamps: u32,
    tiles: [u32; 2],
    tile: u32,
    has_ghosts: u32,
    has_rays: u32,
    padding: u32,
}

/// `Strip` of seen.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct StripUniform {
    eye: [f32; 3],
    pixel: f32,
    size: [u32; 2],
    rows: [u32; 2],
}

/// What is seen of the punctual lights of a picture.
#[derive(Debug, Clone, Copy)]
pub(in crate::picture) struct Seen<'a> {
    pub scene: &'a GpuScene,
    pub shot: &'a Shot,
    pub strips: &'a [Strip<'a>],
}

/// The kernels that find sources and place ghosts.
#[derive(Debug, Clone)]
struct Kernels {
    tiles: Kernel,
    seen: Kernel,
    choose: Kernel,
    place: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            tiles: Kernel::new(gpu, &shader!("picture.effects.flare.tiles"), "main", None)?,
            seen: Kernel::new(gpu, &shader!("picture.effects.flare.seen"), "main", None)?,
            choose: Kernel::new(gpu, &shader!("picture.effects.flare.choose"), "main", None)?,
            place: Kernel::new(gpu, &shader!("picture.effects.flare.place"), "main", None)?,
        })
    }
}

/// The lens with one opening and coating, and its ghosts.
#[derive(Debug, Clone)]
struct Made {
    of: (f32, Coating),
    /// Radius of the stop's opening, in radii of the widest one.
    opening: f32,
    /// Radius of the widest entrance pupil, in focal lengths.
    pupil: f32,
    /// Ghosts at all angles.
    table: wgpu::Buffer,
    ghosts: u32,
}

/// Sources of pictures of one size and format, and the result.
#[derive(Debug)]
struct Images {
    format: wgpu::TextureFormat,
    tiles: wgpu::Buffer,
    lamps: wgpu::Buffer,
    seen_taps: wgpu::Buffer,
    found: wgpu::Buffer,
    placed: wgpu::Buffer,
    result: wgpu::TextureView,
}

/// The passes, made on first use.
#[derive(Debug, Default)]
pub(in crate::picture) struct Pass {
    kernels: Option<Kernels>,
    /// What adds the light, one of each format that was shown.
    adding: Vec<(wgpu::TextureFormat, Kernel)>,
    lens: Option<Made>,
    images: Option<Images>,
}

impl Made {
    fn new(gpu: &Gpu, f_number: f32, coating: Coating) -> Result<Self, GpuError> {
        let lens = Prescription::double_gauss();
        let opening = opening(&lens, f_number);
        let table = ghosts::ghosts(&lens, opening, coating);
        Ok(Self {
            of: (f_number, coating),
            opening: opening as f32,
            pupil: lens.pupil as f32,
            table: gpu.storage("flare.ghosts", &table)?,
            ghosts: lens.pairs().len() as u32,
        })
    }
}

/// Radius of the stop's opening, in radii of the widest one.
fn opening(lens: &Prescription, f_number: f32) -> f64 {
    (1.0 / (2.0 * lens.pupil * f64::from(f_number))).min(1.0)
}

/// Side of a tile of a picture (pixels).
fn tile(size: [u32; 2]) -> u32 {
    size[1].div_ceil(TILE_ROWS).max(LEAST_TILE)
}

impl Images {
    fn new(
        gpu: &Gpu,
        size: [u32; 2],
        format: wgpu::TextureFormat,
        ghosts: u32,
    ) -> Result<Self, GpuError> {
        let source = size_of::<Source>() as u64;
        let tiles: u64 = size
            .map(|side| u64::from(side.div_ceil(tile(size))))
            .iter()
            .product();
        let storage = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            format,
            tiles: storage("flare.tiles", tiles * source)?,
            lamps: storage("flare.lamps", LAMPS as u64 * source)?,
            seen_taps: storage("flare.seen", LAMPS as u64 * 4)?,
            found: storage("flare.sources", FOUND_BYTES)?,
            placed: storage(
                "flare.placed",
                MOST_SOURCES * u64::from(ghosts) * GHOST_BYTES,
            )?,
            result: texture(gpu, "flare", format, size)?,
        })
    }
}

/// The kernel that adds the light to pictures of this format, made on first use.
fn adding<'a>(
    made: &'a mut Vec<(wgpu::TextureFormat, Kernel)>,
    gpu: &Gpu,
    format: wgpu::TextureFormat,
) -> Result<&'a Kernel, GpuError> {
    let found = made.iter().position(|(of, _)| *of == format);
    let index = found.unwrap_or(made.len());
    if found.is_none() {
        let shader = match format {
            wgpu::TextureFormat::Rgba16Float => shader!("picture.effects.flare.halves"),
            _ => shader!("picture.effects.flare.floats"),
        };
        made.push((format, Kernel::new(gpu, &shader, "main", None)?));
    }
    Ok(&made[index].1)
}

impl Pass {
    /// The same for pictures of another size; it compiles nothing.
    pub fn resized(&self) -> Self {
        Self {
            kernels: self.kernels.clone(),
            adding: self.adding.clone(),
            lens: self.lens.clone(),
            images: None,
        }
    }

    /// Begins to compile what pictures of this format need, and makes the ghosts of the lens, if there is flare.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        if settings.is_on() {
            if self.kernels.is_none() {
                self.kernels = Some(Kernels::new(gpu)?);
            }
            adding(&mut self.adding, gpu, format)?;
            let of = (settings.f_number, settings.coating);
            if self.lens.as_ref().is_none_or(|made| made.of != of) {
                self.lens = Some(Made::new(gpu, of.0, of.1)?);
            }
        }
        Ok(())
    }

    /// Adds the flare to a picture by `camera`: pass `picture.flare`. Without what is `seen`, no punctual light makes one.
    /// Returns the picture, which is `radiance` if there is no flare, or if all rays are parallel.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        camera: Optics,
        seen: Option<Seen<'_>>,
        settings: &Settings,
    ) -> Result<wgpu::TextureView, GpuError> {
        if !settings.is_on() || camera.tangent <= 0.0 {
            self.images = None;
            return Ok(radiance.clone());
        }
        let gpu = frame.gpu;
        let texture = radiance.texture();
        let (format, size) = (texture.format(), [texture.width(), texture.height()]);
        self.prepare(gpu, format, settings)?;
        let (Some(kernels), Some(made)) = (&self.kernels, &self.lens) else {
            return Ok(radiance.clone());
        };
        let images = match self.images.take() {
            Some(images) if images.format == format => self.images.insert(images),
            _ => self
                .images
                .insert(Images::new(gpu, size, format, made.ghosts)?),
        };
        let lamps = seen.map_or_else(Vec::new, |seen| {
            sources::lamps(&seen.scene.lights, seen.shot, size)
        });
        let uniform = uniform(made, camera, size, lamps.len(), settings);
        let uniform_buffer = gpu.constant("flare", &uniform)?;
        let eye = seen.map_or(Vec3::ZERO, |seen| seen.shot.eye.truncate());
        let adding = adding(&mut self.adding, gpu, format)?;
        gpu.write(&images.lamps, 0, &lamps);
        frame.clear(&images.seen_taps);
        let resources: [Named<'_>; 9] = [
            ("radiance_unfilterable", radiance),
            ("tiles", &images.tiles),
            ("lamps", &images.lamps),
            ("seen_taps", &images.seen_taps),
            ("found", &images.found),
            ("table", &made.table),
            ("placed", &images.placed),
            ("lens", &uniform_buffer),
            ("written", &images.result),
        ];
        frame.compute("picture.flare", |pass| {
            let [columns, rows] = uniform.tiles;
            (kernels.tiles).run(pass, None, &resources, [columns * LANES, rows, 1])?;
            for strip in seen
                .filter(|_| !lamps.is_empty())
                .map_or(&[][..], |seen| seen.strips)
            {
                let uniform = StripUniform {
                    eye: eye.to_array(),
                    pixel: uniform.pixel,
                    size,
                    rows: [strip.rows.start, strip.rows.end],
                };
                let uniform = gpu.constant("flare.strip", &uniform)?;
                let own: [Named<'_>; 2] = [
                    ("points", &strip.receiver.points.points),
                    ("strip", &uniform),
                ];
                let resources = join(&resources, &own);
                (kernels.seen).run(pass, None, &resources, [LAMPS as u32, 1, 1])?;
            }
            (kernels.choose).run(pass, None, &resources, [1, 1, 1])?;
            let most = MOST_SOURCES as u32 * made.ghosts;
            (kernels.place).run(pass, None, &resources, [most, 1, 1])?;
            adding.run(pass, None, &resources, [size[0], size[1], 1])
        })?;
        Ok(images.result.clone())
    }
}

fn uniform(
    made: &Made,
    camera: Optics,
    size: [u32; 2],
    lamps: usize,
    settings: &Settings,
) -> FlareUniform {
    let Optics { tangent, lens, .. } = camera;
    let blades = match lens.is_pinhole() {
        // One or two blades leave no polygon.
        true if settings.blades < 3 => 0,
        true => settings.blades,
        false => lens.blades,
    };
    let pupil = made.opening * made.pupil;
    // The unit opening's area.
    let shape = Lens {
        aperture: 1.0,
        focus: 1.0,
        blades,
    };
    FlareUniform {
        size,
        pixel: 2.0 * tangent / size[1] as f32,
        strength: settings.strength,
        opening: made.opening,
        pupil: pupil * pupil * shape.area(),
        radius: pupil * FILM_HEIGHT / (2.0 * tangent),
        blades,
        tangent_step: ghosts::TANGENT_STEP as f32,
        angles: ghosts::ANGLES,
        ghosts: made.ghosts,
        lamps: lamps as u32,
        tiles: size.map(|side| side.div_ceil(tile(size))),
        tile: tile(size),
        has_ghosts: settings.ghosts.into(),
        has_rays: settings.rays.into(),
        padding: 0,
    }
}
