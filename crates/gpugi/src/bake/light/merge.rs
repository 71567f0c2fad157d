//! How the results of a light bake's tasks become texels.

use std::ops::Range;

use glam::Vec3;

use super::state::{LitRows, TexelPart, are_squares, are_sums};
use super::{LightBake, Quantity, Solver, unfit};
use crate::capture::Target;
use crate::capture::atlas::{self, Dilation};
use crate::denoise::TexelDenoiser;
use crate::gpu::{Frame, read_buffer};
use crate::lighting::LightingError;

impl LightBake {
    /// Whether a part fits a task of this bake; with `whole`, all samples of the task.
    pub(super) fn check(&self, part: &TexelPart, whole: bool) -> Result<(), LightingError> {
        let TexelPart { tile, samples, .. } = part;
        let place = self.tiles.get(*tile as usize);
        let is_of = |task: Range<u32>| {
            let has_end = if whole {
                task.end == samples.end
            } else {
                samples.end > samples.start && samples.end < task.end
            };
            task.start == samples.start && has_end
        };
        let fits = place.is_some_and(|place| {
            let texels = place.captured.len() * self.side();
            self.shares().of_tile().any(is_of) && part.is_sound(texels, self.denoises())
        });
        fits.then_some(())
            .ok_or_else(|| unfit("the result of a task of another bake"))
    }

    /// Texels per row.
    pub(super) fn side(&self) -> usize {
        self.atlas.size as usize
    }

    /// The first task whose result is missing.
    pub(super) fn next_task(&self) -> Option<(u32, Range<u32>)> {
        let tile = self.done.iter().position(Option::is_none)? as u32;
        let is_known = |samples: &Range<u32>| {
            let mut parts = self.parts.iter();
            parts.any(|part| part.tile == tile && part.samples == *samples)
        };
        let mut tasks = self.shares().of_tile();
        Some((tile, tasks.find(|samples| !is_known(samples))?))
    }

    /// Keeps the result of a task, and finishes its tile if it was the last one.
    pub(super) fn keep(&mut self, part: TexelPart) -> Result<(), LightingError> {
        let number = part.tile;
        let is_known = |known: &TexelPart| known.tile == number && known.samples == part.samples;
        if self.done[number as usize].is_some() || self.parts.iter().any(is_known) {
            return Ok(());
        }
        self.parts.push(part);
        let of_tile = self.parts.iter().filter(|part| part.tile == number);
        if of_tile.count() < self.shares().of_tile().count() {
            return Ok(());
        }
        let (mut parts, others): (Vec<_>, Vec<_>) = std::mem::take(&mut self.parts)
            .into_iter()
            .partition(|part| part.tile == number);
        self.parts = others;
        // Sums of floats depend on the order: always that of the samples.
        parts.sort_unstable_by_key(|part| part.samples.start);
        let mut parts = parts.into_iter();
        let Some(TexelPart {
            mut sums,
            mut squares,
            leak_map,
            ..
        }) = parts.next()
        else {
            return Ok(());
        };
        for part in parts {
            for (sum, more) in sums.iter_mut().flatten().zip(part.sums.iter().flatten()) {
                *sum += more;
            }
            for (sum, more) in squares
                .iter_mut()
                .flatten()
                .zip(part.squares.iter().flatten())
            {
                *sum += more;
            }
        }
        // Finite parts may have sums that are not.
        if !are_sums(&sums, self.options.samples.max(1) as usize) || !are_squares(&squares) {
            return Err(unfit("the light of the tasks together is not finite"));
        }
        let captured = self.means(number, &sums, &squares)?;
        let (place, size) = (&self.tiles[number as usize], self.atlas.size);
        self.done[number as usize] = Some(LitRows {
            texels: place.of(&captured, size).to_vec(),
            leak_map: place.of(&leak_map, size).to_vec(),
        });
        Ok(())
    }

    /// Means of the samples in a tile's captured texels, filtered if the bake is denoised; empty texels are filled from
    /// their neighbours.
    fn means(
        &mut self,
        tile: u32,
        sums: &[[f32; 4]],
        squares: &[[f32; 3]],
    ) -> Result<Vec<Vec3>, LightingError> {
        let size = self.atlas.size;
        let rows = self.tiles[tile as usize].captured.clone();
        let unit = match self.options.quantity {
            Quantity::Irradiance => std::f32::consts::FRAC_1_PI,
            Quantity::Diffuse | Quantity::All => 1.0,
        };
        let pieces = atlas::cut(&self.solver.gpu, size, rows, u32::MAX)?;
        let mut targets = Vec::new();
        let mut rest = sums;
        for piece in &pieces {
            let (these, others) = rest.split_at(piece.len() * size as usize);
            rest = others;
            let target = Target::new(&self.solver.gpu, these.len() as u32)?;
            self.solver.gpu.write(&target.radiance, 0, these);
            targets.push(target);
        }
        if self.denoises() {
            self.denoise(tile, &targets, squares)?;
        }
        let gpu = &self.solver.gpu;
        let mut means = Vec::new();
        for (piece, target) in pieces.iter().zip(&targets) {
            let mut frame = Frame::new(gpu, false);
            Dilation::new(gpu, [size, piece.len() as u32])?.record(&mut frame, target)?;
            frame.submit()?;
            let filled = read_buffer::<[f32; 4]>(gpu, &target.radiance, target.radiance.size())?;
            // `a` is the number of samples in the sum; a filled texel holds one mean.
            let mean = |[r, g, b, a]: [f32; 4]| Vec3::new(r, g, b) * unit / a.max(1.0);
            means.extend(filled.into_iter().map(mean));
        }
        Ok(means)
    }

    /// Filters the sums of a tile's captured texels, one target per piece.
    fn denoise(
        &mut self,
        tile: u32,
        targets: &[Target],
        squares: &[[f32; 3]],
    ) -> Result<(), LightingError> {
        let (mut capture, mut leaks) = self.capture(tile)?;
        let Solver { gpu, on_gpu, .. } = &mut self.solver;
        let mut frame = Frame::new(gpu, false);
        capture.record(&mut frame, on_gpu)?;
        leaks.record(&mut frame, on_gpu, &capture);
        frame.submit()?;
        let mut rest = squares;
        for (piece, target) in capture.pieces().iter().zip(targets) {
            let (these, others) = rest.split_at(piece.points.count as usize);
            rest = others;
            let these: Vec<[f32; 4]> = these.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
            let squares = gpu.storage("denoise.squares [bytes]", &these)?;
            let size = [self.atlas.size, piece.rows.end - piece.rows.start];
            let mut frame = Frame::new(gpu, false);
            let denoiser = TexelDenoiser::new(gpu, size)?;
            denoiser.record(&mut frame, &piece.points, [&target.radiance, &squares])?;
            frame.submit()?;
        }
        Ok(())
    }
}
