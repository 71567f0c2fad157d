//! How the results of a light bake's tasks become texels.

use std::ops::Range;

use glam::Vec3;

use super::state::{LitRows, TexelPart, are_sums};
use super::{LightBake, Quantity, unfit};
use crate::capture::Target;
use crate::capture::atlas::{self, Dilation};
use crate::gpu::{Frame, read_buffer};
use crate::lighting::LightingError;

impl LightBake<'_> {
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
            self.shares().of_tile().any(is_of) && part.is_sound(place.captured.len() * self.side())
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
            mut sums, leak_map, ..
        }) = parts.next()
        else {
            return Ok(());
        };
        for part in parts {
            for (sum, more) in sums.iter_mut().flatten().zip(part.sums.iter().flatten()) {
                *sum += more;
            }
        }
        // Finite parts may have sums that are not.
        if !are_sums(&sums, self.options.samples.max(1) as usize) {
            return Err(unfit("the light of the tasks together is not finite"));
        }
        let captured = self.means(number, &sums)?;
        let (place, size) = (&self.tiles[number as usize], self.atlas.size);
        self.done[number as usize] = Some(LitRows {
            texels: place.of(&captured, size).to_vec(),
            leak_map: place.of(&leak_map, size).to_vec(),
        });
        Ok(())
    }

    /// Means of the samples in a tile's captured texels; empty texels are filled from their neighbours.
    fn means(&self, tile: u32, sums: &[[f32; 4]]) -> Result<Vec<Vec3>, LightingError> {
        let (gpu, size) = (&self.solver.gpu, self.atlas.size);
        let rows = self.tiles[tile as usize].captured.clone();
        let unit = match self.options.quantity {
            Quantity::Irradiance => std::f32::consts::FRAC_1_PI,
            Quantity::Diffuse | Quantity::All => 1.0,
        };
        let (mut rest, mut means) = (sums, Vec::new());
        for piece in atlas::cut(gpu, size, rows, u32::MAX)? {
            let rows = piece.len() as u32;
            let (these, others) = rest.split_at((rows * size) as usize);
            rest = others;
            let target = Target::new(gpu, rows * size)?;
            gpu.write(&target.radiance, 0, these);
            let mut frame = Frame::new(gpu, false);
            Dilation::new(gpu, [size, rows])?.record(&mut frame, &target)?;
            frame.submit()?;
            let filled = read_buffer::<[f32; 4]>(gpu, &target.radiance, target.radiance.size())?;
            // `a` is the number of samples in the sum; a filled texel holds one mean.
            let mean = |[r, g, b, a]: [f32; 4]| Vec3::new(r, g, b) * unit / a.max(1.0);
            means.extend(filled.into_iter().map(mean));
        }
        Ok(means)
    }
}
