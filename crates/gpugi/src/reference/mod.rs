//! The path tracer, which provides the ground truth. It uses the same scene, materials and reflection models as every
//! technique, and can be restricted to the same light paths, so that each technique is compared with exactly the light
//! that it claims to compute.
//!
//! Unidirectional path tracing with next-event estimation and multiple importance sampling; light tracing adds the
//! caustics that paths from the eye do not find.
//! `docs/techniques/path-tracer.md` describes what is sampled and how.

mod batches;
mod check;
mod denoised;
#[cfg(test)]
mod edit_tests;
mod edits;
mod features;
mod lit;
#[cfg(test)]
mod media_tests;
mod photons;
mod picture;
mod settings;
mod surroundings;
#[cfg(test)]
mod tests;
mod tile;
mod wavefront;
#[cfg(test)]
mod wavefront_tests;

pub use denoised::ImageFilter;
pub use settings::Settings;

use std::ops::ControlFlow;

use glam::{Vec2, Vec3};
use gpugi_scene::{Camera, Lens, Scene};

use crate::capture::View;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::light_paths::{self, LightClass, LightPaths};
use crate::lighting::LightingError;
use crate::paths::gpu::{EyeUniform, Parameters, ThinLensUniform};
use crate::paths::{LightBuffers, Sky, has_light_tree, has_straight};
use crate::scene::{GpuScene, has_smooth_objects};
use crate::settings::SettingError;
use crate::shader;
use crate::shutter::{Motion, moment};
use crate::techniques::{Cost, Info, Needs, Role};
use batches::Batch;
use features::Looker;
use lit::Lit;
use photons::Photons;
use picture::{Noise, Sums};
use tile::{BLOCK_PIXELS, Tile, tiles};
use wavefront::Wavefront;

/// The path tracer's description.
pub const INFO: Info = Info {
    name: "path-tracer",
    summary: "the reference: every light path, by path tracing and light tracing",
    source: "Kajiya 1986; Veach 1997; pbrt 4th edition, chapter 13",
    paths: &[
        LightPaths::new(LightClass::Punctual, "L.*E"),
        LightPaths::new(LightClass::Area, "L.*E"),
        LightPaths::new(LightClass::Environment, "L.*E"),
    ],
    role: Role::Reference,
    needs: Needs::RAYS,
    cost: Cost::Picture,
    ..Info::BASE
};

/// Largest side of a tile (pixels). The film of such a tile fits into 128 MiB, the smallest storage binding that WebGPU
/// guarantees.
const TILE_SIDE: u32 = 2048;
/// Samples with which the noise is estimated first: fewer cannot estimate their own variance.
const LEAST_SAMPLES: u32 = 16;
/// Moments of one sample at which a picture is taken while the shutter is open and things move; later ones have more, up to
/// [`MOST_PER_MOMENT`]. Before as many, nobody knows how noisy the picture is.
const MOMENTS: u32 = 256;
const MOST_PER_MOMENT: u32 = 16;
/// A pass over the image, and its progress.
#[derive(Debug, Clone, Copy, Default)]
struct Pass {
    /// Samples that the pass adds to each pixel; 0 if no pass has begun.
    samples: u32,
    /// The next tile, and the next block within it.
    tile: usize,
    block: u32,
    /// Photons traced for the tile, and points of their round if it has none yet.
    photons: u64,
    points: u32,
}

/// Rays of a submission that may take as long as it likes.
const UNLIMITED: u64 = u64::MAX;

/// Progress of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Samples that every pixel has so far.
    pub samples: u32,
    /// Samples requested.
    pub of: u32,
    /// Fraction of the work done, 0 to 1.
    pub fraction: f64,
    /// Estimated relative mean squared error when it was last measured.
    pub noise: Option<f64>,
}

/// Renders a scene, which may be edited, at one image size at a time.
#[derive(Debug)]
pub struct PathTracer {
    gpu: Gpu,
    scene: GpuScene,
    settings: Settings,
    size: [u32; 2],
    wavefront: Wavefront,
    photons: Option<Photons>,
    looker: Option<Looker>,
    /// Whether light passes through any surface.
    has_transmission: bool,
    noise_kernel: Kernel,
    shown_kernel: Kernel,
    view: wgpu::Buffer,
    parameters: wgpu::Buffer,
    automaton: wgpu::Buffer,
    tiles: Vec<Tile>,
    tile_side: u32,
    lit: Lit,
    lights: LightBuffers,
    /// Whether the kernels leave light of lamps to the light tracer.
    looks_for_lamps: bool,
    /// Whether they look for points and spots in media.
    looks_in_media: bool,
    /// Which emission may end a path: bit 0 for surfaces, bit 1 for the sky.
    emission_classes: u32,
    /// Materials of the solids that contain the eye, innermost first.
    around_eye: [u32; 4],
    samples: u32,
    /// Photons of the image so far.
    photon_count: u64,
    /// Samples of which the noise of both tracers decided last how many photons there are.
    balanced: u32,
    pass: Pass,
    /// What moves while the shutter is open.
    motion: Option<Motion>,
    /// Whether the scene on the GPU is at another time than at first.
    is_later: bool,
    /// Moments so far.
    moments: u32,
    /// What the GPU is at work on.
    batch: Option<Batch>,
    /// Pieces of work given to the GPU so far.
    pieces: u64,
    /// The noise of an image of so many samples, on its way to the host.
    sums: Option<(u32, Sums)>,
    /// The noise that was measured last, of so many samples.
    noise: Option<(u32, Noise)>,
    seed: u32,
    /// Pixel samples per second that the latest batches reached; 0 before the first batch.
    rate: f64,
}

/// Light of `scene` that its pictures lack, if any: a few words for each class of lights, with a shortest path.
pub fn left_out(scene: &Scene, settings: &Settings) -> Vec<String> {
    let mut present = settings.classes().unwrap_or_default();
    present.retain(|class| *class != LightClass::Punctual || !scene.lights.is_empty());
    let specular = has_smooth_objects(scene).then_some('S');
    let medium = (!scene.media.is_empty()).then_some('V');
    let lobes: String = "DG".chars().chain(specular).chain(medium).collect();
    light_paths::left_out(&found(settings), &present, &lobes)
}

/// The light paths that it finds, or by which no light comes: mirrors show nothing of a light without extent.
fn found(settings: &Settings) -> Vec<LightPaths> {
    let of_eye = [
        LightPaths::new(LightClass::Punctual, "L([DGV].*|S*)E"),
        LightPaths::new(LightClass::Area, "L.*E"),
        LightPaths::new(LightClass::Environment, "L.*E"),
    ];
    let merged = match settings.merge_radius > 0.0 {
        true => &photons::MERGED[..],
        false => &[],
    };
    of_eye
        .iter()
        .chain(&photons::SPLATTED)
        .chain(merged)
        .cloned()
        .collect()
}

impl PathTracer {
    /// A path tracer of `scene` for images of `size` pixels.
    ///
    /// # Errors
    /// [`LightingError::Gpu`] when the scene or the image does not fit the adapter (the message gives the sizes);
    /// [`LightingError::Setting`] when a setting is invalid; [`crate::gpu::GpuError::Input`] when something in the
    /// scene is not finite or the image has no pixels.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        settings: &Settings,
    ) -> Result<Self, LightingError> {
        Self::with_tiles(gpu, scene, size, settings, TILE_SIDE, true)
    }

    /// [`PathTracer::new`] with a different tile side (pixels). Without photons, paths from the eye alone make up the
    /// picture.
    fn with_tiles(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        settings: &Settings,
        tile_side: u32,
        has_photons: bool,
    ) -> Result<Self, LightingError> {
        let refused = |source: SettingError| LightingError::Setting {
            technique: INFO.name.to_owned(),
            source,
        };
        let value = |name: &str, value: &str, reason: String| {
            refused(SettingError::Value {
                name: name.to_owned(),
                value: value.to_owned(),
                reason,
            })
        };
        let filter = settings
            .filter()
            .map_err(|error| value("paths", &settings.paths, error.to_string()))?;
        let classes = settings
            .classes()
            .map_err(|reason| value("lights", &settings.lights, reason))?;
        check::check_size(size)?;
        check::check(scene)?;
        let gpu = &gpu.apart();
        let on_gpu = GpuScene::with_rays(gpu, scene)?;
        let sky = match &scene.environment {
            Some(environment) if classes.contains(&LightClass::Environment) => {
                Sky::new(&environment.image)
            }
            _ => Sky::none(),
        };
        let of_settings = (settings, &classes[..]);
        let lit = Lit::new(&on_gpu, of_settings, sky.luminance, has_photons);
        let lights = LightBuffers::new(gpu, &lit.table, sky.upload(gpu)?)?;
        let flag = |set: bool| f64::from(u8::from(set));
        let has_transmission = scene.instances.iter().any(|instance| {
            let material = &scene.materials[instance.material];
            material.transmission > 0.0 || material.is_translucent()
        });
        let mut constants = vec![
            ("HAS_TRANSMISSION", flag(has_transmission)),
            ("HAS_STRAIGHT", flag(has_straight(scene))),
            (
                "HAS_PATH_FILTER",
                flag(settings.paths != Settings::default().paths),
            ),
        ];
        constants.extend(on_gpu.ray_constants());
        constants.extend(on_gpu.tracking_constants());
        let uniform = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::UNIFORM);
        let view = uniform("path-tracer.view", size_of::<EyeUniform>() as u64)?;
        let parameters = uniform(
            "path-tracer.settings",
            std::mem::size_of::<Parameters>() as u64,
        )?;
        let automaton = gpu.storage("path-tracer.automaton", &filter.automaton().words())?;
        let mut buffers = vec![
            ("seen", &view),
            ("settings", &parameters),
            ("automaton", &automaton),
        ];
        let merges = photons::merges(settings, &classes);
        let merged = (&filter, merges.then_some(settings.merge_radius as f32));
        let photons = (lit.aims.as_ref())
            .map(|aims| Photons::new(gpu, &on_gpu, aims, merged, &constants, &buffers))
            .transpose()?;
        constants.push(("LIGHT_TRACER_HAS_LAMPS", flag(lit.has_lamps)));
        constants.push(("HAS_LIGHT_TREE", flag(has_light_tree(&on_gpu))));
        let looks_in_media = on_gpu.has_lit_media();
        constants.push(("HAS_LIT_MEDIA", flag(looks_in_media)));
        // Whatever paths are kept, so that parts of the light take the same paths as all light.
        let may_merge = settings.merge_radius > 0.0;
        constants.push(("LIGHT_TRACER_MERGES", flag(may_merge)));
        let of_film = KernelOptions {
            constants: &[("HAS_LIGHT_TRACER", flag(photons.is_some()))],
            ..Default::default()
        };
        let of_film = |shader| Kernel::with_options(gpu, &shader, "main", None, &of_film);
        let noise_kernel = of_film(shader!("reference.noise"))?;
        let shown_kernel = of_film(shader!("reference.shown"))?;
        buffers.extend(lights.named());
        let wavefront = Wavefront::new(gpu, &on_gpu, &constants, &buffers)?;
        let mut tracer = Self {
            gpu: gpu.clone(),
            scene: on_gpu,
            settings: settings.clone(),
            size,
            wavefront,
            photons,
            looker: None,
            has_transmission,
            noise_kernel,
            shown_kernel,
            view,
            parameters,
            automaton,
            tiles: Vec::new(),
            tile_side,
            looks_for_lamps: lit.has_lamps,
            looks_in_media,
            lit,
            lights,
            emission_classes: u32::from(classes.contains(&LightClass::Area))
                | u32::from(classes.contains(&LightClass::Environment)) << 1,
            around_eye: surroundings::around(&[], Vec3::ZERO),
            samples: 0,
            photon_count: 0,
            balanced: 0,
            pass: Pass::default(),
            motion: None,
            is_later: false,
            moments: 0,
            batch: None,
            pieces: 0,
            sums: None,
            noise: None,
            seed: 0,
            rate: 0.0,
        };
        tracer.make_tiles()?;
        Ok(tracer)
    }

    /// The settings that the path tracer was created with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Width and height of the picture (pixels).
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether its pipelines are still being compiled: until then, [`PathTracer::try_render`] traces nothing. In a
    /// browser, each call compiles one.
    pub fn is_compiling(&self) -> bool {
        self.gpu.is_compiling()
    }

    /// The scene on the GPU.
    pub fn scene(&self) -> &GpuScene {
        &self.scene
    }

    /// Restarts with a new seed for all random numbers. The same seed produces the same image on the same adapter.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn restart(&mut self, seed: u32) -> Result<(), LightingError> {
        self.seed = seed;
        self.forget();
        let mut frame = Frame::new(&self.gpu, false);
        for tile in &self.tiles {
            frame.clear(&tile.film);
            if let Some(photons) = &tile.photons {
                photons.clear(&mut frame);
            }
            if let Some(features) = &tile.features {
                frame.clear(features);
            }
        }
        frame.submit()?;
        Ok(())
    }

    /// Moves the scene while the shutter of the camera is open: samples are dealt to moments of that time, at each of which
    /// instances, lights, the camera and meshes that deform are where the animation has them. `None`: nothing moves. To be
    /// set before the first sample, and again after edits.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn set_motion(&mut self, motion: Option<Motion>) -> Result<(), LightingError> {
        self.take_first_pose()?;
        self.motion = motion;
        Ok(())
    }

    /// Samples that every pixel has so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Adds samples of the view of `camera` until every pixel has `samples`, the `noise` setting is reached, or
    /// `report` breaks off. If `report` breaks off, the sample counts of pixels may differ by the samples of one pass;
    /// the next call finishes that pass first. `report` is called after every batch. Call [`PathTracer::restart`]
    /// before rendering another camera, because samples are added to the existing ones.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn render(
        &mut self,
        camera: &Camera,
        samples: u32,
        report: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
    ) -> Result<Progress, LightingError> {
        let mut progress = Progress {
            samples: self.samples,
            of: samples,
            fraction: 0.0,
            noise: None,
        };
        while self.samples < samples {
            if self.awaits_balance() {
                let noise = self.begin_sums()?.wait()?;
                self.balance(&noise);
            }
            self.begin_pass(camera, samples)?;
            while self.pass.tile < self.tiles.len() {
                if self.batch.is_none() {
                    self.begin_batch(UNLIMITED)?;
                }
                self.follow_batch(UNLIMITED, true)?;
                progress.fraction = self.fraction(samples, progress.noise);
                if report(&progress).is_break() {
                    return Ok(progress);
                }
            }
            self.end_pass();
            progress.samples = self.samples;
            if self.settings.noise > 0.0 && self.samples >= self.least_samples(camera) {
                let noise = self.noise()?;
                progress.noise = Some(noise);
                if noise <= self.settings.noise {
                    break;
                }
            }
        }
        progress.fraction = 1.0;
        report(&progress).is_break();
        Ok(progress)
    }

    /// A piece of [`PathTracer::render`] that never waits for the GPU, for loops that must not block: to be called again
    /// and again, such as once per frame, until its progress has a fraction of 1. While the GPU is still at work on the
    /// last piece, or compiles, nothing is added. A piece traces no more than about `rays` rays, but at least those of
    /// one step of some paths. The image does not depend on the pieces. The noise is slightly older than the samples,
    /// until the end.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn try_render(
        &mut self,
        camera: &Camera,
        samples: u32,
        rays: u64,
    ) -> Result<Progress, LightingError> {
        let is_free = self.follow_batch(rays, false)?;
        if self.pass.samples > 0 && self.pass.tile == self.tiles.len() {
            self.end_pass();
        }
        if let Some((samples, sums)) = &self.sums {
            if let Some(sums) = sums.get() {
                self.noise = Some((*samples, sums?));
                self.sums = None;
            }
        } else if self.pass.samples == 0 && self.noise.map_or(0, |(of, _)| of) < self.samples {
            self.sums = Some((self.samples, self.begin_sums()?));
        }
        let of_samples = self.noise.filter(|(of, _)| *of == self.samples);
        if let Some((_, noise)) = of_samples.filter(|_| self.awaits_balance()) {
            self.balance(&noise);
        }
        let noise = self.noise.map(|(_, noise)| noise.variance / self.pixels());
        let limit = self.settings.noise;
        let is_enough = limit > 0.0
            && self.samples >= self.least_samples(camera)
            && noise.is_some_and(|noise| noise <= limit);
        let is_done = self.samples >= samples || is_enough;
        if is_free && !is_done && !self.gpu.is_compiling() && !self.awaits_balance() {
            self.begin_pass(camera, samples)?;
            self.begin_batch(rays)?;
        }
        let is_measured = self.noise.is_some_and(|(of, _)| of == self.samples);
        Ok(Progress {
            samples: self.samples,
            of: samples,
            fraction: match is_done && (is_measured || self.samples == 0) {
                true => 1.0,
                // At the end, the noise is still to be measured.
                false => self.fraction(samples, noise).min(0.999),
            },
            noise,
        })
    }

    /// Pieces of work given to the GPU so far. [`PathTracer::try_render`] gives one when the GPU has done the last, so
    /// their pace says how long they take.
    pub fn pieces(&self) -> u64 {
        self.pieces
    }

    /// Takes the view of a camera.
    fn look(&mut self, camera: &Camera) -> Result<(), GpuError> {
        let view = View::new(
            camera,
            self.size,
            Vec2::ZERO,
            0,
            self.seed,
            self.scene.diagonal(),
        );
        let [right, up, _, eye] =
            [0, 1, 2, 3].map(|column| camera.world_from_view.col(column).truncate());
        let Lens {
            aperture,
            focus,
            blades,
        } = camera.lens;
        let eye_uniform = EyeUniform {
            view: view.uniform,
            lens: ThinLensUniform {
                right: (aperture * right).to_array(),
                focus,
                up: (aperture * up).to_array(),
                blades,
            },
        };
        self.gpu.write(&self.view, 0, &[eye_uniform]);
        self.around_eye = surroundings::around(&self.lit.solids, eye);
        let has_lens = !camera.lens.is_pinhole();
        let photons = self.photons.as_mut();
        photons.map_or(Ok(()), |photons| photons.look(&self.gpu, has_lens))
    }

    /// Pixels of the image.
    fn pixels(&self) -> f64 {
        self.tiles.iter().map(|tile| f64::from(tile.pixels())).sum()
    }

    /// Begins a pass, if none has begun.
    fn begin_pass(&mut self, camera: &Camera, samples: u32) -> Result<(), LightingError> {
        if self.pass.samples > 0 {
            return Ok(());
        }
        let motion = self.motion.take();
        let moves = motion.as_ref().filter(|_| camera.shutter > 0.0);
        let begun = match moves {
            Some(motion) => self.begin_moment(motion, camera, samples),
            None => self.begin_still(motion.as_ref(), camera, samples),
        };
        self.motion = motion;
        begun
    }

    /// Most samples of a pass of a picture of `samples` samples.
    fn most_of_pass(&self, samples: u32) -> u32 {
        let most = self.wavefront.items() / BLOCK_PIXELS;
        (samples - self.samples).min(most)
    }

    /// Begins a pass at a moment of its own.
    fn begin_moment(
        &mut self,
        motion: &Motion,
        camera: &Camera,
        samples: u32,
    ) -> Result<(), LightingError> {
        let seconds = camera.shutter * moment(self.moments);
        self.is_later = true;
        self.take_pose(&motion.after(seconds))?;
        self.look(&motion.camera_after(camera, seconds))?;
        self.moments += 1;
        let of_moment = (self.samples / MOMENTS).clamp(1, MOST_PER_MOMENT);
        self.pass.samples = of_moment.min(self.most_of_pass(samples));
        Ok(())
    }

    /// Begins a pass in which nothing moves.
    fn begin_still(
        &mut self,
        motion: Option<&Motion>,
        camera: &Camera,
        samples: u32,
    ) -> Result<(), LightingError> {
        if let Some(motion) = motion.filter(|_| self.is_later) {
            self.take_pose(motion.scene())?;
            self.is_later = false;
        }
        self.look(camera)?;
        // About a batch, but at most a quarter more samples, so that the image converges evenly and the noise is measured
        // often enough. How long batches take has no say: sums of photons and the estimate of their noise depend on passes.
        let of_batch = (Wavefront::most_items(&self.gpu) as f64 / self.pixels()) as u32;
        let of_pass = of_batch.clamp(1, self.samples / 4 + 1);
        self.pass.samples = of_pass.min(self.most_of_pass(samples));
        Ok(())
    }

    /// Samples before which the noise ends no picture.
    fn least_samples(&self, camera: &Camera) -> u32 {
        match self.motion.is_some() && camera.shutter > 0.0 {
            true => MOMENTS,
            false => LEAST_SAMPLES,
        }
    }

    /// Whether the next pass has to wait until it is known how noisy the samples so far are.
    fn awaits_balance(&self) -> bool {
        let is_due = self.samples >= (4 * self.balanced).max(LEAST_SAMPLES);
        self.photons.is_some() && self.pass.samples == 0 && is_due
    }

    /// Sends as many photons from now on as suit the noise of both tracers.
    fn balance(&mut self, noise: &Noise) {
        if let Some(photons) = &mut self.photons {
            photons.balance(noise.variance - noise.of_photons, noise.of_photons);
        }
        self.balanced = self.samples;
    }

    fn end_pass(&mut self) {
        let of_pass = |photons: &Photons| photons.of_pass(self.pass.samples);
        self.photon_count += self.photons.as_ref().map_or(0, of_pass);
        self.samples += self.pass.samples;
        self.pass = Pass::default();
    }

    /// Fraction of the work that is done, of `samples` samples or until the `noise` setting is reached.
    fn fraction(&self, samples: u32, noise: Option<f64>) -> f64 {
        let done = self.done() / self.pixels();
        let taken = f64::from(self.samples) + done.min(1.0) * f64::from(self.pass.samples);
        // Noise falls at least as fast as 1 / samples.
        let enough = noise.map_or(f64::INFINITY, |noise| {
            f64::from(self.samples) * noise / self.settings.noise
        });
        (taken / f64::from(samples).min(enough)).min(1.0)
    }

    /// Pixels of the pass that are done. Half of a tile's work is that of its photons.
    fn done(&self) -> f64 {
        let whole = self.tiles[..self.pass.tile].iter();
        let whole: f64 = whole.map(|tile| f64::from(tile.pixels())).sum();
        let of_blocks = f64::from(self.pass.block * BLOCK_PIXELS);
        let photons = self.photons.as_ref();
        let Some(photons) = photons.filter(|photons| photons.of_pass(1) > 0) else {
            return whole + of_blocks;
        };
        let Some(tile) = self.tiles.get(self.pass.tile) else {
            return whole;
        };
        let of_photons = self.pass.photons as f64 / photons.of_pass(self.pass.samples) as f64;
        let pixels = f64::from(tile.pixels());
        whole + (of_blocks.min(pixels) + of_photons * pixels) / 2.0
    }
}
