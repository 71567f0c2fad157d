//! The transfer vectors of an atlas's texels, computed in steps: bounce by bounce, tile by tile.

use std::ops::Range;

use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

use super::glossy::Glossy;
use super::gpu::{COEFFICIENT_BYTES, Work};
use super::places::Places;
use super::{Basis, Cut, Settings, haar, harmonics};
use crate::capture::atlas::tiles_of;
use crate::gpu::{Frame, Gpu, GpuError, Named, join, read_buffer};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::stage::Stage;

/// The transfer vectors of an atlas's texels.
#[derive(Debug)]
pub(super) struct Transfer {
    settings: Settings,
    /// Coefficients of all texels with the bounces that are done: `vec2u` of coefficients.wesl or haar/wavelets.wesl.
    /// `None` once they are compressed.
    vectors: Option<wgpu::Buffer>,
    /// Their size (bytes).
    size_of_vectors: u64,
    /// The same with one bounce more, while that is computed.
    next: Option<wgpu::Buffer>,
    albedos: wgpu::Buffer,
    rays: Rays,
    /// Number of a piece and range of its points, per tile.
    tiles: Vec<(usize, Range<u32>)>,
    /// Matrices of glossy texels, which follow the tiles of the last bounce.
    pub glossy: Option<Glossy>,
    /// The surfaces that they are made for.
    surfaces: Stage<Versions>,
    state: State,
}

/// Kernels of a basis.
#[derive(Debug)]
enum Rays {
    Harmonics(Box<harmonics::Rays>),
    Wavelets(Box<haar::Rays>),
}

/// Texels whose vectors are computed in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    pub points: u32,
    pub is_first_bounce: bool,
}

/// How far the vectors are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct State {
    /// Bounces that are done.
    pub bounces: u32,
    /// Tiles of the next bounce that are done, those of matrices among them.
    pub tiles: u32,
}

/// Progress that was saved: [`State`], and the buffers that later steps read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Saved {
    pub bounces: u32,
    pub tiles: u32,
    pub vectors: Vec<u32>,
    /// Empty if no tile of the next bounce is done.
    pub next: Vec<u32>,
    pub albedos: Vec<u32>,
    /// Transfer matrices; empty if none is begun.
    pub matrices: Vec<Vec<u32>>,
}

impl Transfer {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        places: &Places,
        glossy: Option<Glossy>,
        cut: Cut,
    ) -> Result<Self, GpuError> {
        let rays_per_texel = settings.rays_per_texel();
        let at_once = (cut.rays_of_step / rays_per_texel).max(1);
        let pieces = places.pieces().into_iter();
        let tiles = tiles_of(pieces.map(|piece| piece.count), at_once);
        let rays = match settings.basis {
            Basis::Harmonics => {
                let rays = harmonics::Rays::new(gpu, scene, settings, places)?;
                Rays::Harmonics(Box::new(rays))
            }
            Basis::Haar => {
                let most = tiles.iter().map(|(_, points)| points.len() as u32).max();
                let most = most.unwrap_or(1);
                let rays = haar::Rays::new(gpu, scene, settings, places, most)?;
                Rays::Wavelets(Box::new(rays))
            }
        };
        let [width, height] = places.map_size().map(u64::from);
        let texels = width * height;
        let vectors = vectors(
            gpu,
            texels * u64::from(settings.terms()) * COEFFICIENT_BYTES,
        )?;
        Ok(Self {
            settings: settings.clone(),
            size_of_vectors: vectors.size(),
            vectors: Some(vectors),
            next: None,
            albedos: gpu.room("albedos of texels [bytes]", texels * 8)?,
            rays,
            tiles,
            glossy,
            surfaces: Stage::default(),
            state: State::default(),
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let size = |buffer: &Option<wgpu::Buffer>| buffer.as_ref().map_or(0, wgpu::Buffer::size);
        let work = match &self.rays {
            Rays::Harmonics(_) => 0,
            Rays::Wavelets(rays) => rays.bytes(),
        };
        let matrices = self.glossy.as_ref().map_or(0, Glossy::bytes);
        size(&self.vectors) + size(&self.next) + self.albedos.size() + work + matrices
    }

    /// Bounces that are done.
    pub fn bounces(&self) -> u32 {
        self.state.bounces
    }

    /// Whether all bounces are done.
    pub fn is_done(&self) -> bool {
        self.state.bounces == self.settings.bounces
    }

    /// Part of the work that is done (0 to 1).
    pub fn progress(&self) -> f32 {
        if self.is_done() {
            return 1.0;
        }
        let matrices = self.glossy.as_ref().map_or(0, Glossy::steps);
        let all = self.settings.bounces * self.tiles.len() as u32 + matrices;
        let done = self.state.bounces * self.tiles.len() as u32 + self.state.tiles;
        done as f32 / all.max(1) as f32
    }

    /// Tiles of the next bounce.
    fn tiles_of_bounce(&self) -> u32 {
        let is_last = self.state.bounces + 1 == self.settings.bounces;
        let glossy = self.glossy.as_ref().filter(|_| is_last);
        self.tiles.len() as u32 + glossy.map_or(0, Glossy::steps)
    }

    /// The vectors with the bounces that are done; `None` once they are compressed.
    pub fn vectors(&self) -> Option<&wgpu::Buffer> {
        self.vectors.as_ref()
    }

    /// Frees the vectors, which have been compressed.
    pub fn free_vectors(&mut self) {
        self.vectors = None;
    }

    /// Restarts if geometry or materials have changed, and returns whether they have. The vectors remain until the
    /// first bounce is done.
    pub fn follow(&mut self, scene: &GpuScene) -> bool {
        let has_changed = self.surfaces.renew(scene.versions.of(Inputs::SURFACES));
        if has_changed {
            self.state = State::default();
        }
        has_changed
    }

    /// Computes the next bounce of one tile, and returns its number of rays: pass `radiance-transfer.rays`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn step(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        places: &Places,
    ) -> Result<u64, GpuError> {
        let gpu = frame.gpu;
        let next = match self.next.take() {
            Some(next) => next,
            None => vectors(gpu, self.size_of_vectors)?,
        };
        let before = match self.vectors.take() {
            Some(before) => before,
            None => vectors(gpu, self.size_of_vectors)?,
        };
        if self.state.tiles == 0 {
            // Texels may have lost their points since.
            frame.clear(&next);
        }
        // What passes read and write, for all texels. Albedos are written with the first bounce.
        let vectors: [Named<'_>; 4] = [
            ("before", &before),
            ("after", &next),
            ("albedos", &self.albedos),
            ("atlas", places.lookup()),
        ];
        let mut rays = 0;
        if let Some((piece, points)) = self.tiles.get(self.state.tiles as usize) {
            let piece = places.pieces()[*piece];
            let work = Work {
                first_texel: piece.first,
                first_point: points.start,
                end_point: points.end,
                rays: self.settings.rays,
                seed: self.settings.seed,
                ..Work::zeroed()
            };
            let work = gpu.constant("radiance transfer", &work)?;
            let tile = Tile {
                points: points.len() as u32,
                is_first_bounce: self.state.bounces == 0,
            };
            let resources = join(&vectors, &[("work", &work), ("points", piece.points)]);
            match &self.rays {
                Rays::Harmonics(rays) => rays.record(frame, scene, tile, &resources)?,
                Rays::Wavelets(rays) => rays.record(frame, scene, tile, &resources)?,
            }
            rays = points.len() as u64 * u64::from(self.settings.rays_per_texel());
        } else if let Some(glossy) = &self.glossy {
            let step = self.state.tiles - self.tiles.len() as u32;
            rays = glossy.record(frame, scene, places, step, &vectors)?;
        }
        self.state.tiles += 1;
        self.vectors = Some(before);
        self.next = Some(next);
        if self.state.tiles >= self.tiles_of_bounce() {
            self.end_bounce();
        }
        Ok(rays)
    }

    /// All tiles are done: the vectors have one bounce more.
    fn end_bounce(&mut self) {
        if let Some(next) = self.next.take() {
            let before = self.vectors.replace(next);
            self.state.bounces += 1;
            self.state.tiles = 0;
            if !self.is_done() {
                self.next = before;
            }
        }
    }

    /// Saved progress; `None` while there is none. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self, gpu: &Gpu) -> Result<Option<Saved>, GpuError> {
        let State { bounces, tiles, .. } = self.state;
        if bounces == 0 && tiles == 0 {
            return Ok(None);
        }
        let read = |buffer: &wgpu::Buffer| read_buffer(gpu, buffer, buffer.size());
        let next = self.next.as_ref().filter(|_| tiles > 0);
        Ok(Some(Saved {
            bounces,
            tiles,
            vectors: self
                .vectors
                .as_ref()
                .map(read)
                .transpose()?
                .unwrap_or_default(),
            next: next.map(read).transpose()?.unwrap_or_default(),
            albedos: read(&self.albedos)?,
            matrices: match &self.glossy {
                Some(glossy) if self.has_matrices(bounces, tiles) => glossy.save(gpu)?,
                _ => Vec::new(),
            },
        }))
    }

    /// Whether matrices are begun when so many bounces, and tiles of the next, are done.
    fn has_matrices(&self, bounces: u32, tiles: u32) -> bool {
        bounces == self.settings.bounces || tiles as usize > self.tiles.len()
    }

    /// Continues from saved progress, which has no vectors if they are compressed.
    ///
    /// # Errors
    /// Why it does not fit these texels.
    pub fn resume(&mut self, gpu: &Gpu, saved: &Saved, is_compressed: bool) -> Result<(), String> {
        let is_of_steps = if saved.bounces < self.settings.bounces {
            let matrices = self.glossy.as_ref();
            let matrices = matrices.filter(|_| saved.bounces + 1 == self.settings.bounces);
            saved.tiles < self.tiles.len() as u32 + matrices.map_or(0, Glossy::steps)
        } else {
            saved.bounces == self.settings.bounces && saved.tiles == 0
        };
        if !is_of_steps || (is_compressed && saved.bounces < self.settings.bounces) {
            return Err("another number of steps".into());
        }
        let has_next = saved.tiles > 0;
        let is_whole = |words: &[u32], exists: bool, size: u64| {
            words.len() as u64 * 4 == if exists { size } else { 0 }
        };
        if !is_whole(&saved.vectors, !is_compressed, self.size_of_vectors)
            || !is_whole(&saved.next, has_next, self.size_of_vectors)
            || !is_whole(&saved.albedos, true, self.albedos.size())
        {
            return Err("other texels".into());
        }
        let glossy = self.glossy.as_ref();
        let glossy = glossy.filter(|_| self.has_matrices(saved.bounces, saved.tiles));
        if !glossy.map_or(saved.matrices.is_empty(), |glossy| {
            glossy.fits(&saved.matrices)
        }) {
            return Err("other matrices".into());
        }
        if !saved
            .vectors
            .iter()
            .chain(&saved.next)
            .chain(saved.matrices.iter().flatten())
            .all(|&word| are_finite(word))
        {
            return Err("coefficients that are not finite".into());
        }
        let write = |into: &mut Option<wgpu::Buffer>, words: &[u32]| {
            if words.is_empty() {
                *into = None;
                return Ok(());
            }
            let buffer = match into.take() {
                Some(buffer) => buffer,
                None => vectors(gpu, self.size_of_vectors).map_err(|error| error.to_string())?,
            };
            gpu.write(&buffer, 0, words);
            *into = Some(buffer);
            Ok::<_, String>(())
        };
        write(&mut self.vectors, &saved.vectors)?;
        write(&mut self.next, &saved.next)?;
        gpu.write(&self.albedos, 0, &saved.albedos);
        if let Some(glossy) = glossy {
            glossy.resume(gpu, &saved.matrices);
        }
        self.state.bounces = saved.bounces;
        self.state.tiles = saved.tiles;
        Ok(())
    }
}

/// Whether both 16-bit floats in a word are finite.
pub(super) fn are_finite(word: u32) -> bool {
    const EXPONENT: u32 = 0x7c00;
    [word, word >> 16]
        .iter()
        .all(|half| half & EXPONENT != EXPONENT)
}

/// A buffer of transfer vectors.
fn vectors(gpu: &Gpu, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
    gpu.room("transfer vectors [bytes]", bytes)
}
