//! The path tracer's work in batches, which the GPU is given one after the other.

use web_time::Instant;

use super::photons::{self, Begun, Photons};
use super::tile::BLOCK_PIXELS;
use super::{Pass, PathTracer, features, wavefront};
use crate::gpu::{Frame, GpuError, ReadBack, begin_read_buffer};
use crate::paths::gpu::{Header, Parameters};

/// Target duration of a batch (s). It is long enough to fill a GPU. Each of a batch's many dispatches is short enough
/// for any driver's watchdog.
pub(super) const BATCH_SECONDS: f64 = 0.2;
/// What the GPU has been given to do, and when.
#[derive(Debug)]
pub(super) struct Batch {
    work: Work,
    started: Instant,
}

#[derive(Debug)]
enum Work {
    /// Paths, with how far they are.
    Paths(wavefront::Batch, ReadBack<Vec<Header>>),
    /// So many photons, or points of theirs, with something that arrives after them.
    Photons(Begun, ReadBack<Vec<u32>>),
}

impl PathTracer {
    /// Continues the pass by as many blocks or photons as should take [`BATCH_SECONDS`]. No submission traces more than
    /// about `rays` rays.
    pub(super) fn begin_batch(&mut self, rays: u64) -> Result<(), GpuError> {
        let started = Instant::now();
        let tile = &self.tiles[self.pass.tile];
        let work = match (&self.photons, &tile.photons) {
            (Some(photons), Some(film)) if self.pass.block == tile.blocks() => {
                let place = photons::Place {
                    first: self.photon_count,
                    done: self.pass.photons,
                    points: self.pass.points,
                    first_sample: self.samples,
                    samples: self.pass.samples,
                };
                let film_of_tile = (tile, film);
                let (gpu, scene, settings) = (&self.gpu, &self.scene, &self.settings);
                let begun = photons.begin(gpu, scene, film_of_tile, settings, &place, rays)?;
                Work::Photons(begun, begin_read_buffer(gpu, &film.pixels, 4)?)
            }
            _ => {
                let mut batch = self.begin_paths(rays);
                let (gpu, scene) = (&self.gpu, &self.scene);
                if let (Some(looker), Some(features)) = (&self.looker, &tile.features)
                    && self.samples < features::MOST_SAMPLES
                {
                    let mut frame = Frame::new(gpu, false);
                    looker.record(&mut frame, scene, features, batch.blocks)?;
                    frame.submit()?;
                }
                let state = self.wavefront.advance(gpu, scene, &mut batch, rays)?;
                Work::Paths(batch, state)
            }
        };
        self.batch = Some(Batch { work, started });
        self.pieces += 1;
        Ok(())
    }

    /// Takes notice of what the GPU has done of a batch, and gives it more to do until the batch ends. Returns whether
    /// none is left; if it `waits`, that is so.
    pub(super) fn follow_batch(&mut self, rays: u64, waits: bool) -> Result<bool, GpuError> {
        while let Some(Batch { work, started }) = self.batch.take() {
            let tile = &self.tiles[self.pass.tile];
            match work {
                Work::Paths(mut batch, state) => {
                    let Some(after) = arrived(&state, waits) else {
                        let work = Work::Paths(batch, state);
                        self.batch = Some(Batch { work, started });
                        return Ok(false);
                    };
                    let film = &tile.film_group;
                    let (gpu, scene) = (&self.gpu, &self.scene);
                    if !(self.wavefront).follow(gpu, film, &mut batch, &after?[0])? {
                        let state = self.wavefront.advance(gpu, scene, &mut batch, rays)?;
                        let work = Work::Paths(batch, state);
                        self.batch = Some(Batch { work, started });
                        self.pieces += 1;
                        continue;
                    }
                    let seconds = started.elapsed().as_secs_f64().max(1e-5);
                    let work = f64::from(batch.blocks * BLOCK_PIXELS);
                    let work = work * f64::from(self.pass.samples);
                    // Small batches do not fill the GPU, so approach its rate from below.
                    self.rate =
                        (work / seconds).min((self.rate * 4.0).max(work / seconds.max(0.01)));
                    self.pass.block += batch.blocks;
                }
                Work::Photons(begun, after) => {
                    let Some(after) = arrived(&after, waits) else {
                        let work = Work::Photons(begun, after);
                        self.batch = Some(Batch { work, started });
                        return Ok(false);
                    };
                    after?;
                    match begun {
                        Begun::Points(count) => self.pass.points += count,
                        Begun::Photons(count) => {
                            let seconds = started.elapsed().as_secs_f64().max(1e-5);
                            if let Some(photons) = &mut self.photons {
                                photons.measure(count, seconds);
                            }
                            self.pass.photons += count;
                            self.pass.points = 0;
                        }
                    }
                }
            }
            let of_pass = |photons: &Photons| photons.of_pass(self.pass.samples);
            let photons = self.photons.as_ref().map_or(0, of_pass);
            if self.pass.block == tile.blocks() && self.pass.photons == photons {
                self.pass = Pass {
                    samples: self.pass.samples,
                    tile: self.pass.tile + 1,
                    ..Pass::default()
                };
            }
        }
        Ok(true)
    }

    /// Continues the tile's paths.
    fn begin_paths(&self, rays: u64) -> wavefront::Batch {
        let Pass {
            samples,
            tile,
            block,
            ..
        } = self.pass;
        let tile = &self.tiles[tile];
        let affordable = self.rate * BATCH_SECONDS / f64::from(samples * BLOCK_PIXELS);
        let blocks = (affordable as u32)
            .max(64)
            .min(self.wavefront.items() / (samples * BLOCK_PIXELS))
            .min(tile.blocks() - block);
        let parameters = Parameters {
            tile_x: tile.origin[0],
            tile_y: tile.origin[1],
            tile_width: tile.size[0],
            tile_height: tile.size[1],
            first_block: block,
            samples,
            first_sample: self.samples,
            max_bounces: self.settings.max_bounces,
            roulette_after: self.settings.roulette_after,
            light_count: self.lit.table.rows.len() as u32,
            sky_probability: self.lit.table.sky_probability,
            emission_classes: self.emission_classes,
            solids: self.around_eye,
            near_light: self.scene.near_in_media(),
            ..bytemuck::Zeroable::zeroed()
        };
        self.gpu
            .write(&self.parameters, 0, std::slice::from_ref(&parameters));
        let place = (self.samples, self.seed);
        self.wavefront
            .begin(&self.gpu, blocks, samples, place, rays)
    }
}

/// What has arrived on the host, if it has; if `waits`, it has.
fn arrived<T>(data: &ReadBack<T>, waits: bool) -> Option<Result<T, GpuError>> {
    match waits {
        true => Some(data.wait()),
        false => data.get(),
    }
}
