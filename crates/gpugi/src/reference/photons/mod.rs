//! The light tracer adds to the path tracer's picture the caustics that no path from the eye finds, or finds only by
//! chance: paths `LS.*[DGV]E` of points, spots and directions, and `LS.*[DV]E` of the lamps that `mark_lamps` chooses.
//! Photons leave the lights toward objects with ideal lobes, and are splatted onto the image at every diffuse or glossy
//! lobe that they meet, and where media scatter them. Where mirrors or glass show such places to the eye, they are merged
//! with what it sees there (`merging`): paths `LS.*[DGV].*SE` of points, spots and directions, and `LS.*[DV](G|S)*SE` of
//! those lamps.
//!
//! The path tracer leaves exactly these paths out, so each path is found once.

mod aims;
#[cfg(test)]
mod aims_tests;
#[cfg(test)]
mod media_tests;
mod merging;
#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use super::Settings;
use super::batches::BATCH_SECONDS;
use super::tile::Tile;
use super::wavefront::Named;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::light_paths::{LightClass, LightPaths, PathFilter, overlap};
use crate::scene::GpuScene;
use crate::shader;
pub(super) use aims::{Aims, Measured, mark_lamps, spheres};
use merging::Merging;

/// Paths that the light tracer finds, and the path tracer leaves out. The environment is the path tracer's.
pub(super) const SPLATTED: [LightPaths; 2] = [
    LightPaths::new(LightClass::Punctual, "LS.*[DGV]E"),
    LightPaths::new(LightClass::Area, "LS.*[DV]E"),
];
/// Those that it finds by merging: of lamps, only where each G is narrow.
pub(super) const MERGED: [LightPaths; 2] = [
    LightPaths::new(LightClass::Punctual, "LS.*[DGV].*SE"),
    LightPaths::new(LightClass::Area, "LS.*[DV][GS]*SE"),
];

/// Bytes per pixel of an image.
pub(super) const BYTES: u64 = SUMS_BYTES + PIXEL_BYTES;
/// Bytes of a pixel's sums: `WORDS` of photons/splats.wesl.
const SUMS_BYTES: u64 = 32;
/// Size of `PhotonPixel` in photons/film.wesl (bytes).
const PIXEL_BYTES: u64 = 32;
/// Photons per pixel and sample, until it is known how noisy they are beside paths: as many as suit `room` and
/// `glass-room`. Then no fewer and no more than these.
const PHOTONS_PER_SAMPLE: f64 = 0.125;
const LEAST_PER_SAMPLE: f64 = 1.0 / 64.0;
const MOST_PER_SAMPLE: f64 = 2.0;
/// Time of a path, light and all, over that of a photon: 0.2 in `room` on an H200, 0.6 in software.
const PATH_OVER_PHOTON: f64 = 0.3;
/// Photons of the first batch.
const FIRST_BATCH: u64 = 1 << 12;
/// Rays that a photon takes, about.
const RAYS_OF_PHOTON: u64 = 4;
/// Most photons of a batch.
const LARGEST_BATCH: u64 = 1 << 22;

/// `Settings` of reference/photons/emission.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Emission {
    tile_x: u32,
    tile_y: u32,
    tile_width: u32,
    tile_height: u32,
    first_photon: u32,
    first_photon_high: u32,
    photons: u32,
    light_count: u32,
    sphere_count: u32,
    max_bounces: u32,
    roulette_after: u32,
    scale: f32,
    done_of_round: u32,
    per_sample: u32,
    first_joint: u32,
    eye_states: u32,
    near_eye: f32,
    padding: [u32; 3],
}

/// `Settings` of reference/photons/resolve.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Resolution {
    pixels: u32,
    weight: f32,
    step: f32,
    padding: u32,
}

/// The light tracer of a scene.
#[derive(Debug)]
pub(super) struct Photons {
    trace: Kernel,
    resolve: Kernel,
    emission: wgpu::Buffer,
    resolution: wgpu::Buffer,
    own: wgpu::BindGroup,
    rows: wgpu::Buffer,
    aims: wgpu::Buffer,
    /// `rows` and `aims`, and the points of `merging`.
    lights: wgpu::BindGroup,
    /// What mirrors and glass show, if photons are merged with it.
    merging: Option<Merging>,
    /// `first_joint` and `eye_states` of photons/emission.wesl.
    joint: [u32; 2],
    resolve_own: wgpu::BindGroup,
    light_count: u32,
    sphere_count: u32,
    /// Whether there are lights that send photons.
    is_lit: bool,
    /// Whether `trace` knows of the lens.
    has_lens: bool,
    /// Pixels of the image.
    pixels: f64,
    /// Photons per pixel and sample from now on, if any light sends some.
    share: f64,
    /// Radiance of one step of a sum [W/sr/m^2].
    step: f32,
    /// Photons per second that the latest batches reached; 0 before the first batch.
    rate: f64,
    /// Most photons of a batch.
    largest_batch: u64,
}

/// How far a tile's pass is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Number of the pass's first photon, and photons done.
    pub first: u64,
    pub done: u64,
    /// Points of the round that are done, as long as it has no photons.
    pub points: u32,
    /// Number of the pass's first sample, and its samples per pixel.
    pub first_sample: u32,
    pub samples: u32,
}

/// What a batch has begun.
#[derive(Debug, Clone, Copy)]
pub(super) enum Begun {
    /// Points with which photons will be merged: some of a round.
    Points(u32),
    Photons(u64),
}

/// The light tracer's part of a tile.
#[derive(Debug)]
pub(super) struct PhotonFilm {
    sums: wgpu::Buffer,
    pub pixels: wgpu::Buffer,
    sums_group: wgpu::BindGroup,
    resolve_group: wgpu::BindGroup,
}

/// The classes of lights whose photons the settings keep.
///
/// # Panics
/// If the settings' pattern is invalid.
pub(super) fn kept_classes(settings: &Settings, classes: &[LightClass]) -> Vec<LightClass> {
    let is_kept = |class: &LightClass| {
        settings.max_bounces >= 2
            && (keeps(settings, *class, &SPLATTED) || merges(settings, &[*class]))
    };
    classes.iter().copied().filter(is_kept).collect()
}

/// Whether photons of lights of some classes are merged with what mirrors and glass show.
///
/// # Panics
/// If the settings' pattern is invalid.
pub(super) fn merges(settings: &Settings, classes: &[LightClass]) -> bool {
    let mut classes = classes.iter();
    settings.merge_radius > 0.0 && classes.any(|class| keeps(settings, *class, &MERGED))
}

/// Whether the settings keep any of these paths of a class of lights.
fn keeps(settings: &Settings, class: LightClass, paths: &[LightPaths]) -> bool {
    let kept = LightPaths {
        class,
        pattern: settings.paths.clone().into(),
    };
    overlap(&[kept], paths).is_some()
}

impl Photons {
    /// The light tracer of a scene. `constants` are those of path_state.wesl and bvh.wesl, `of_eye`: `seen`, `settings` and
    /// `automaton` of the paths from the eye. `radius`: within which photons are merged at first (pixels), if they are.
    /// [`Photons::resize`] has to follow.
    pub fn new(
        gpu: &Gpu,
        on_gpu: &GpuScene,
        aims: &Aims,
        (filter, radius): (&PathFilter, Option<f32>),
        constants: &[(&str, f64)],
        of_eye: &Named<'_>,
    ) -> Result<Self, GpuError> {
        let merging = radius
            .map(|radius| Merging::new(gpu, on_gpu, constants, of_eye, radius))
            .transpose()?;
        let is_merging = f64::from(u8::from(merging.is_some()));
        let of_trace: Vec<_> = constants
            .iter()
            .copied()
            .chain([("HAS_MERGING", is_merging)])
            .collect();
        let options = KernelOptions {
            constants: &of_trace,
            // Indices are in range: those of tables because the host wrote them, those of sums because `splat` compares
            // the pixel with the tile, which has as many sums.
            unchecked: true,
        };
        let layout = Some(&on_gpu.ray_layout);
        let shader = shader!("reference.photons.trace");
        let trace = Kernel::with_options(gpu, &shader, "main", layout, &options)?;
        let resolve = Kernel::new(gpu, &shader!("reference.photons.resolve"), "main", None)?;
        let uniform = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::UNIFORM);
        let emission = uniform("photons.settings", std::mem::size_of::<Emission>() as u64)?;
        let resolution = uniform("photons.pass", std::mem::size_of::<Resolution>() as u64)?;
        let mut words = filter.light_automaton().words();
        let joint = [
            words.len() as u32,
            filter.automaton().transitions.len() as u32,
        ];
        words.extend(filter.joint().into_iter().map(u32::from));
        let automaton = gpu.storage("photons.automaton", &words)?;
        let seen = of_eye.iter().filter(|(name, _)| *name == "seen").copied();
        let of_trace = [("settings", &emission), ("automaton", &automaton)];
        let own: Vec<_> = seen.chain(of_trace).collect();
        let [rows, words] = of_lights(gpu, aims)?;
        let of_resolve: &Named<'_> = &[("settings", &resolution)];
        Ok(Self {
            own: bind(gpu, &trace, 1, &own)?,
            lights: bind_lights(gpu, &trace, (&rows, &words), merging.as_ref())?,
            rows,
            aims: words,
            merging,
            joint,
            resolve_own: bind(gpu, &resolve, 1, of_resolve)?,
            trace,
            resolve,
            emission,
            resolution,
            light_count: aims.rows.len() as u32,
            sphere_count: aims.spheres,
            is_lit: true,
            has_lens: false,
            pixels: 0.0,
            share: PHOTONS_PER_SAMPLE,
            step: step(aims),
            rate: 0.0,
            largest_batch: LARGEST_BATCH,
        })
    }

    /// Looks through a lens from now on, or through a pinhole.
    pub fn look(&mut self, gpu: &Gpu, has_lens: bool) -> Result<(), GpuError> {
        if self.has_lens != has_lens {
            let constant = ("HAS_LENS", f64::from(u8::from(has_lens)));
            self.trace = self.trace.variant(gpu, &[constant])?;
            self.has_lens = has_lens;
        }
        Ok(())
    }

    /// Sends photons elsewhere from now on, or none. Sums that go on keep their step.
    pub fn aim(
        &mut self,
        gpu: &Gpu,
        aims: Option<&Aims>,
        sums_go_on: bool,
    ) -> Result<(), GpuError> {
        self.is_lit = aims.is_some();
        if let Some(aims) = aims {
            [self.rows, self.aims] = of_lights(gpu, aims)?;
            self.bind_lights(gpu)?;
            (self.light_count, self.sphere_count) = (aims.rows.len() as u32, aims.spheres);
            if !sums_go_on {
                self.step = step(aims);
            }
        }
        Ok(())
    }

    /// Sends as many photons as images of `size` pixels need, whose tiles have up to `of_tile` pixels.
    pub fn resize(&mut self, gpu: &Gpu, size: [u32; 2], of_tile: [u32; 2]) -> Result<(), GpuError> {
        self.pixels = f64::from(size[0]) * f64::from(size[1]);
        if let Some(merging) = &mut self.merging {
            merging.resize(gpu, of_tile, self.pixels)?;
            self.bind_lights(gpu)?;
        }
        Ok(())
    }

    /// Another picture begins.
    pub fn begin_anew(&mut self) {
        self.share = PHOTONS_PER_SAMPLE;
    }

    /// Sends as many photons from now on as lower the noise most in the same time, given the variances of both tracers so far.
    pub fn balance(&mut self, of_paths: f64, of_photons: f64) {
        self.share = balanced(self.share, of_paths, of_photons);
    }

    fn bind_lights(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        let buffers = (&self.rows, &self.aims);
        self.lights = bind_lights(gpu, &self.trace, buffers, self.merging.as_ref())?;
        Ok(())
    }

    /// The light tracer's film of a tile of `pixels` pixels.
    pub fn film(&self, gpu: &Gpu, pixels: u32) -> Result<PhotonFilm, GpuError> {
        let storage = |label: &str, bytes_per_pixel: u64| {
            let bytes = u64::from(pixels) * bytes_per_pixel;
            gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE)
        };
        let sums = storage("photons.sums [bytes]", SUMS_BYTES)?;
        let film = storage("photons.film [bytes]", PIXEL_BYTES)?;
        let sums_group = bind(gpu, &self.trace, 3, &[("sums", &sums)])?;
        let both: &Named<'_> = &[("sums", &sums), ("light_film", &film)];
        Ok(PhotonFilm {
            sums_group,
            resolve_group: bind(gpu, &self.resolve, 3, both)?,
            sums,
            pixels: film,
        })
    }

    /// Photons of a pass of `samples` samples per pixel.
    pub fn of_pass(&self, samples: u32) -> u64 {
        u64::from(self.is_lit) * self.per_sample() * u64::from(samples)
    }

    /// Photons per sample of all pixels.
    fn per_sample(&self) -> u64 {
        (self.pixels * self.share).ceil() as u64
    }

    /// Continues a tile's pass by as many photons as should take half of [`BATCH_SECONDS`], because they are one dispatch,
    /// and trace no more than about `rays` rays. Where photons are merged, the points of a round come before its photons.
    /// The last batch adds the pass to the tile's film.
    pub fn begin(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        (tile, film): (&Tile, &PhotonFilm),
        settings: &Settings,
        at: &Place,
        rays: u64,
    ) -> Result<Begun, GpuError> {
        let Place {
            first,
            done,
            points,
            samples,
            ..
        } = *at;
        let affordable = (self.rate * BATCH_SECONDS / 2.0) as u64;
        let left = self.of_pass(samples) - done;
        let of_round = match &self.merging {
            Some(merging) => self.of_pass(merging.samples_of_round(tile)),
            None => u64::MAX,
        };
        let done_of_round = done % of_round;
        if let Some(merging) = self.merging.as_ref().filter(|_| done_of_round == 0) {
            let before = (done / self.per_sample()) as u32;
            let of_round = merging.samples_of_round(tile).min(samples - before);
            let round = [at.first_sample + before, of_round];
            let begun = merging.begin(gpu, scene, tile, round, points, rays)?;
            if points + begun < Merging::points_of_round(tile, of_round) {
                return Ok(Begun::Points(begun));
            }
        }
        let photons = affordable.max(FIRST_BATCH).min(self.largest_batch);
        let photons = photons.min((rays / RAYS_OF_PHOTON).max(1)).min(left);
        let photons = photons.min(of_round - done_of_round);
        let emission = Emission {
            tile_x: tile.origin[0],
            tile_y: tile.origin[1],
            tile_width: tile.size[0],
            tile_height: tile.size[1],
            first_photon: (first + done) as u32,
            first_photon_high: ((first + done) >> 32) as u32,
            photons: photons as u32,
            light_count: self.light_count,
            sphere_count: self.sphere_count,
            max_bounces: settings.max_bounces,
            roulette_after: settings.roulette_after,
            scale: 1.0 / (self.pixels as f32 * self.step),
            done_of_round: done_of_round as u32,
            per_sample: self.per_sample() as u32,
            first_joint: self.joint[0],
            eye_states: self.joint[1],
            near_eye: scene.near_in_media(),
            padding: [0; 3],
        };
        gpu.write(&self.emission, 0, std::slice::from_ref(&emission));
        let mut frame = Frame::new(gpu, false);
        frame.compute("photons.trace", |pass| {
            let groups = [
                (0, &scene.ray_bind_group),
                (1, &self.own),
                (2, &self.lights),
                (3, &film.sums_group),
            ];
            self.trace.dispatch(pass, &groups, [photons as u32, 1, 1]);
        });
        frame.submit()?;
        if photons == left {
            let resolution = Resolution {
                pixels: tile.pixels(),
                weight: (self.of_pass(samples) as f64 / self.pixels) as f32,
                step: self.step,
                padding: 0,
            };
            gpu.write(&self.resolution, 0, std::slice::from_ref(&resolution));
            let mut frame = Frame::new(gpu, false);
            frame.compute("photons.resolve", |pass| {
                let groups = [(1, &self.resolve_own), (3, &film.resolve_group)];
                self.resolve.dispatch(pass, &groups, [tile.pixels(), 1, 1]);
            });
            frame.submit()?;
        }
        Ok(Begun::Photons(photons))
    }

    /// Takes notice of how long a batch took.
    pub fn measure(&mut self, photons: u64, seconds: f64) {
        // Small batches do not fill the GPU, so approach its rate from below.
        let rate = photons as f64 / seconds;
        self.rate = rate.min((self.rate * 4.0).max(photons as f64 / seconds.max(0.01)));
    }
}

impl PhotonFilm {
    /// Forgets all photons.
    pub fn clear(&self, frame: &mut Frame<'_>) {
        frame.clear(&self.sums);
        frame.clear(&self.pixels);
    }
}

/// Photons per path that lower the noise most in the same time, if with `share` of them, the variance of the picture is that
/// of paths and of photons. With N paths of variance V and cost c each, and n photons of variance v and cost k, V / N + v / n
/// is least for n / N = sqrt(v c / (V k)). It is rounded to a power of two, so that adapters whose rounding differs send the
/// same photons.
fn balanced(share: f64, of_paths: f64, of_photons: f64) -> f64 {
    let ratio = share * of_photons.max(0.0) * PATH_OVER_PHOTON / of_paths.max(0.0);
    match ratio.is_nan() {
        // No light so far.
        true => share,
        false => {
            let best = ratio.sqrt().clamp(LEAST_PER_SAMPLE, MOST_PER_SAMPLE);
            best.log2().round().exp2()
        }
    }
}

/// Radiance of one step of a sum [W/sr/m^2]. The sums have room for a million samples of a caustic 10,000 times as bright
/// as the light on the object, in any hue. For blue light, with a luminance of 0.07, that takes 10^10 / (0.07 pi) < 2^36,
/// or 2^32 steps of 2^4.
fn step(aims: &Aims) -> f32 {
    let exponent = aims.irradiance.log2().round() + 4.0;
    // A power of two, so that scaling loses no digits.
    match exponent.is_finite() {
        true => exponent.clamp(-60.0, 60.0).exp2() as f32,
        false => 1.0,
    }
}

/// The lights that send photons, and where to.
fn of_lights(gpu: &Gpu, aims: &Aims) -> Result<[wgpu::Buffer; 2], GpuError> {
    let rows = gpu.storage("photons.lights [bytes]", &aims.rows)?;
    Ok([rows, gpu.storage("photons.aims [bytes]", &aims.words)?])
}

/// Binds them, and the points with which photons are merged.
fn bind_lights(
    gpu: &Gpu,
    trace: &Kernel,
    (rows, aims): (&wgpu::Buffer, &wgpu::Buffer),
    merging: Option<&Merging>,
) -> Result<wgpu::BindGroup, GpuError> {
    // Without points, any buffer will do.
    let shown = merging.map_or(aims, |merging| &merging.points);
    let buffers: &Named<'_> = &[("lights", rows), ("aims", aims), ("shown", shown)];
    bind(gpu, trace, 2, buffers)
}

fn bind(
    gpu: &Gpu,
    kernel: &Kernel,
    group: u32,
    buffers: &Named<'_>,
) -> Result<wgpu::BindGroup, GpuError> {
    let resources: Vec<_> = buffers
        .iter()
        .map(|(name, buffer)| (*name, buffer.as_entire_binding()))
        .collect();
    kernel.bind(gpu, group, &resources)
}
