//! The light in the texels of an atlas: direct light from other techniques, and the iteration that computes the
//! indirect light.

use std::ops::Range;

use gpugi_scene::Atlas;

use super::choosing::{self, Choosing};
use super::gpu::{MOST_CHOSEN, TEXEL_BYTES, Work};
use super::shooting::{Batch, Shooting};
use crate::capture::atlas::{AtlasPiece, KeptIrradiance, KeptTexels};
use crate::capture::{Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, read_buffer};
use crate::scene::GpuScene;
use crate::shader;
use crate::stage::Stage;
use crate::techniques::{Map, Slice, Unready};

/// Texels that trace rays in a frame, if the budget allows fewer (but the rest of an iterate).
const LEAST_TRACED: u64 = 8192;

/// The passes of the iteration.
#[derive(Debug)]
pub(super) struct Kernels {
    begin: Kernel,
    rays: Kernel,
    average: Kernel,
}

impl Kernels {
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        Ok(Self {
            begin: kernel(shader!("techniques.radiosity.begin"))?,
            average: kernel(shader!("techniques.radiosity.average"))?,
            rays: scene.ray_kernel(
                gpu,
                &shader!("techniques.radiosity.rays"),
                &[
                    ("HAS_GLOSS", f64::from(u8::from(scene.has_gloss()))),
                    scene.media_constant(),
                ],
            )?,
        })
    }
}

/// The light in the texels of an atlas.
#[derive(Debug)]
pub struct Solution {
    pub(super) irradiance: KeptIrradiance,
    pub(super) texels: KeptTexels,
    /// Iterates so far, including dropped ones.
    pub iterates: u32,
    /// Texels of all pieces that have traced the rays of the next iterate.
    traced: u32,
    /// What [`Solution::begin`] was given.
    work: Work,
    pieces: Vec<Piece>,
    /// Two buffers of iterates, used in turn.
    light: [wgpu::Buffer; 2],
    /// Index of the buffer that holds the last iterate.
    last: usize,
    choosing: Choosing,
    chosen: wgpu::Buffer,
    /// Number of texels that each iterate chooses.
    chosen_count: u32,
    /// Rays per texel and iterate, or shooters.
    work_per_texel: u64,
    /// Shooters and hemicubes; nothing in the mode that traces rays.
    shooting: Stage<Batch, Shooting>,
}

/// One piece of the atlas.
#[derive(Debug)]
struct Piece {
    first_texel: u32,
    count: u32,
    direct: Target,
}

impl Solution {
    pub(super) fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        atlas: &Atlas,
        most_texels: u32,
    ) -> Result<Self, GpuError> {
        let texels = KeptTexels::new(gpu, scene, atlas, most_texels)?;
        let size = texels.size();
        let count = size[0] * size[1];
        let bytes = u64::from(count) * TEXEL_BYTES;
        let iterates = [0, 1].map(|_| gpu.room("light of texels [bytes]", bytes));
        let [one, other] = iterates;
        let iterates = [one?, other?];
        let piece = |piece: &AtlasPiece| {
            let count = piece.points.count;
            Ok(Piece {
                first_texel: piece.rows.start * atlas.size,
                count,
                direct: Target::new(gpu, count)?,
            })
        };
        let pieces = texels.capture.pieces().iter().map(piece);
        Ok(Self {
            pieces: pieces.collect::<Result<_, GpuError>>()?,
            choosing: Choosing::new(gpu, scene, count)?,
            chosen: choosing::room(gpu)?,
            chosen_count: 0,
            work_per_texel: 0,
            irradiance: KeptIrradiance::new(gpu, scene, size, Some(atlas), &[])?,
            texels,
            iterates: 0,
            traced: 0,
            work: bytemuck::Zeroable::zeroed(),
            light: iterates,
            last: 0,
            shooting: Stage::default(),
        })
    }

    /// Irradiance of all rows; for each piece, its direct light and the states of its texels (0 empty, 1 good, 2 moved,
    /// 3 invalid).
    pub(super) fn maps(&self) -> Vec<Map> {
        let (name, size) = (super::INFO.name, self.texels.size());
        let irradiance = &self.irradiance.target.radiance;
        let irradiance = Map::of_colors(format!("{name}.irradiance"), irradiance, size, 16);
        let mut maps = vec![irradiance];
        let pieces = self.texels.capture.pieces().iter().zip(&self.pieces);
        let states = self.texels.leaks.states();
        for (number, ((of, piece), states)) in pieces.zip(states).enumerate() {
            let size = [size[0], of.rows.end - of.rows.start];
            let direct = &piece.direct.radiance;
            let of_direct = format!("{name}.direct.{number}");
            maps.push(Map::of_colors(of_direct, direct, size, 16));
            let of_states = format!("{name}.coverage.{number}");
            maps.push(Map::of_numbers(of_states, states, size, 4));
        }
        maps
    }

    /// Bytes that are not in maps.
    pub(super) fn work_bytes(&self) -> u64 {
        let light = self.light.iter().map(wgpu::Buffer::size).sum::<u64>();
        let shooting = self.shooting.get().map_or(0, |shooting| shooting.bytes);
        let texels = self.texels.capture.bytes + self.texels.lookup.words.size();
        let choosing = self.choosing.bytes() + self.chosen.size();
        light + texels + self.irradiance.work_bytes() + choosing + shooting
    }

    /// Updates the texels' points, and finds those that leak: with a budget, in as many steps as it allows. Returns
    /// whether that is done.
    pub(super) fn capture(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        budget: Option<&mut Slice>,
    ) -> Result<bool, GpuError> {
        let Some(budget) = budget else {
            return self.texels.record(frame, scene).map(|()| true);
        };
        let KeptTexels { capture, leaks, .. } = &mut self.texels;
        capture.record(frame, scene)?;
        while !leaks.is_done(capture) && budget.may_step() {
            budget.count(leaks.record_part(frame, scene, capture, 1));
        }
        Ok(leaks.is_done(capture))
    }

    /// Number of parts in which the texels are lit directly.
    pub(super) fn parts(&self) -> usize {
        let pieces = self.texels.capture.pieces().iter();
        pieces.map(|piece| piece.parts.len()).sum()
    }

    /// What is to be lit directly once the first `lit` parts are, and how many parts it is: a whole piece of the atlas, if
    /// so many points fit the frame's budget, or else a part.
    pub(super) fn next_direct(
        &self,
        mut lit: usize,
        fits: impl Fn(u64) -> bool,
    ) -> Option<(Receiver, usize)> {
        for (captured, piece) in self.texels.capture.pieces().iter().zip(&self.pieces) {
            let parts = captured.parts.len();
            if lit == 0 && fits(piece.count.into()) {
                return Some((Receiver::new(&captured.points, &piece.direct), parts));
            }
            if let Some(part) = captured.parts.get(lit) {
                return Some((Receiver::new(&part.points, &piece.direct), 1));
            }
            lit -= parts;
        }
        None
    }

    /// Drops the light of the last iterate, before the iteration restarts.
    pub(super) fn forget(&self, frame: &mut Frame<'_>) {
        frame.clear(&self.light[self.last]);
    }

    /// Prepares to shoot, or to trace rays if `batch` is `None`. The iteration has to begin again.
    pub(super) fn shoot(
        &mut self,
        frame: &Frame<'_>,
        scene: &GpuScene,
        batch: Option<Batch>,
    ) -> Result<(), Unready> {
        let Some(batch) = batch else {
            self.shooting.clear();
            return Ok(());
        };
        let make = |_| Shooting::new(frame.gpu, scene, batch);
        self.shooting.compiled(frame, batch, make).map(drop)
    }

    /// What all passes bind for each piece, in which some texels of all pieces trace rays; with their number.
    fn resources<'a>(&'a self, works: &'a [wgpu::Buffer]) -> Vec<(u32, [Named<'a>; 8])> {
        let points = self.texels.capture.points();
        let captured = points.zip(&self.pieces).zip(works);
        let of_pieces = captured.map(|((points, piece), work)| {
            let resources: [Named<'_>; 8] = [
                ("work", work),
                ("points", &points.points),
                ("direct", &piece.direct),
                ("before", &self.light[self.last]),
                ("after", &self.light[1 - self.last]),
                ("atlas", &self.texels.lookup.words),
                ("chosen_texels", &self.chosen),
                ("irradiance", &self.irradiance.target),
            ];
            (piece.count, resources)
        });
        of_pieces.collect()
    }

    /// The work of each piece, in which `part` of all texels trace rays.
    fn works(&self, gpu: &Gpu, part: &Range<u32>) -> Result<Vec<wgpu::Buffer>, GpuError> {
        let work = |piece: &Piece| {
            let traced = piece.texels_of(part);
            let work = Work {
                first_texel: piece.first_texel,
                count: piece.count,
                first_traced: traced.start,
                end_traced: traced.end,
                ..self.work
            };
            gpu.constant("radiosity", &work)
        };
        self.pieces.iter().map(work).collect()
    }

    /// Restarts the iteration from the light of the last iterate and discards all else: pass `radiosity.begin`.
    pub(super) fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        kernels: &Kernels,
        work: &Work,
    ) -> Result<(), GpuError> {
        (self.iterates, self.traced) = (0, 0);
        let texels = self.pieces.iter().map(|piece| piece.count).sum();
        let batch = self.shooting.get().map(|shooting| shooting.batch);
        self.chosen_count = match batch {
            Some(batch) => batch.shooters,
            None if work.light_sampled > 0 => MOST_CHOSEN,
            None => 0,
        };
        self.work_per_texel = match batch {
            Some(batch) => batch.shooters.into(),
            None => (work.rays + work.light_sampled).into(),
        };
        self.work = Work {
            texels,
            chosen: self.chosen_count,
            ..*work
        };
        let gpu = frame.gpu;
        let works = self.works(gpu, &(0..texels))?;
        frame.compute("radiosity.begin", |pass| {
            for (piece, work) in self.pieces.iter().zip(&works) {
                let last = &self.light[self.last];
                let resources: [Named<'_>; 2] = [("work", work), ("after", last)];
                let count = [piece.count, 1, 1];
                kernels.begin.run(pass, None, &resources, count)?;
            }
            Ok(())
        })
    }

    /// The texels that trace the rays of the next iterate in a frame with a budget of `units`, at least
    /// [`LEAST_TRACED`]. A frame may do one part of an iterate, or whole ones: the passes read one range of texels.
    pub(super) fn next_part(&self, units: u64) -> Range<u32> {
        let most = units / self.work_per_texel.max(1);
        let end = most.max(LEAST_TRACED).saturating_add(self.traced.into());
        let end = end.min(self.work.texels.into()) as u32;
        match self.shooting.get() {
            Some(_) => 0..self.work.texels,
            None => self.traced..end,
        }
    }

    /// Number of texels of all pieces.
    pub(super) fn texel_count(&self) -> u32 {
        self.work.texels
    }

    /// Computes the next iterate, or a part of it ([`Solution::next_part`]). Returns the number of rays, or of texels that
    /// shooters are compared with: passes `radiosity.choose`, and `radiosity.rays` or those of shooting.
    pub(super) fn iterate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        part: Range<u32>,
    ) -> Result<u64, GpuError> {
        let works = self.works(frame.gpu, &part)?;
        let pieces = self.resources(&works);
        if self.chosen_count > 0 && self.traced == 0 {
            let chosen = self.chosen_count;
            self.choosing.record(frame, scene, &pieces, chosen)?;
        }
        if let Some(shooting) = self.shooting.get() {
            shooting.iterate(frame, scene, &pieces)?;
        } else {
            frame.compute("radiosity.rays", |pass| {
                for (piece, (_, resources)) in self.pieces.iter().zip(&pieces) {
                    let texels = piece.texels_of(&part).len() as u32;
                    if texels > 0 {
                        let (rays, scene) = (&kernels.rays, Some(&scene.ray_bind_group));
                        rays.run(pass, scene, resources, [texels, 1, 1])?;
                    }
                }
                Ok::<_, GpuError>(())
            })?;
        }
        self.traced = part.end;
        if part.end == self.work.texels {
            self.traced = 0;
            self.last = 1 - self.last;
            self.iterates += 1;
        }
        Ok(part.len() as u64 * self.work_per_texel)
    }

    /// Averages the iterates into the irradiance that other passes look up: passes `radiosity.average`,
    /// `capture.atlas.dilate` and `capture.atlas.seams`.
    pub(super) fn average(&self, frame: &mut Frame<'_>, kernels: &Kernels) -> Result<(), GpuError> {
        let works = self.works(frame.gpu, &(0..self.work.texels))?;
        frame.compute("radiosity.average", |pass| {
            let mut pieces = self.resources(&works).into_iter();
            pieces.try_for_each(|(count, resources)| {
                kernels.average.run(pass, None, &resources, [count, 1, 1])
            })
        })?;
        self.irradiance.finish(frame)
    }

    /// The state from which the next iterate continues: `Texel` of texel.wesl. Waits for the GPU.
    pub(super) fn light(&self, gpu: &Gpu) -> Result<Vec<u32>, GpuError> {
        let last = &self.light[self.last];
        read_buffer(gpu, last, last.size())
    }

    /// Continues from the state that [`Solution::light`] returned after `iterates` iterates, which started from the
    /// same direct light. Returns false if `light` has a different number of texels, or light that is not finite.
    pub(super) fn resume(&mut self, gpu: &Gpu, iterates: u32, light: &[u32]) -> bool {
        let last = &self.light[self.last];
        // Each texel is two vectors of floats, and a number behind each.
        let mut vectors = light.chunks(4);
        let is_finite = |word: &u32| f32::from_bits(*word).is_finite();
        let fits = light.len() as u64 * 4 == last.size()
            && vectors.all(|vector| vector.iter().take(3).all(is_finite));
        if !fits {
            return false;
        }
        gpu.write(last, 0, light);
        (self.iterates, self.traced) = (iterates, 0);
        true
    }
}

impl Piece {
    /// Texels of the piece that are among these of all pieces.
    fn texels_of(&self, texels: &Range<u32>) -> Range<u32> {
        let here = |texel: u32| texel.saturating_sub(self.first_texel).min(self.count);
        here(texels.start)..here(texels.end)
    }
}
