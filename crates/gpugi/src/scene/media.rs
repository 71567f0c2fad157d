//! Media for shaders: parameters, densities, and majorant grids, which bound the densities of coarse cells so that
//! tracking takes long steps through thin parts.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use gpugi_scene::{DensityGrid, Medium, PhaseFunction, Scene};

use crate::gpu::GpuError;

/// Most media of a scene: shaders look at each of them in every step.
const MAX_MEDIA: usize = 64;
/// Words per medium, and cells of a majorant grid along each axis: scene/media.wesl.
const WORDS: usize = 32;
const MAJORANT_CELLS: u32 = 16;
/// Flags of a medium in scene/media.wesl.
const EVERYWHERE: u32 = 1;
const CORNETTE_SHANKS: u32 = 2;
/// Largest |g|. Beyond, all light goes on straight, as far as 32-bit floats can tell.
const MAX_ASYMMETRY: f32 = 0.999;

/// Rejects media that cannot be rendered.
pub(crate) fn check_media(scene: &Scene) -> Result<(), GpuError> {
    let refuse = |what: String| Err(GpuError::Input { what });
    if scene.media.len() > MAX_MEDIA {
        let count = scene.media.len();
        return refuse(format!("{count} media: a scene has at most {MAX_MEDIA}"));
    }
    for medium in &scene.media {
        if let Err(reason) = medium.check() {
            return refuse(format!("medium {:?}: {reason}", medium.name));
        }
    }
    Ok(())
}

/// `media` of scene/media.wesl, for media that [`check_media`] accepts.
pub(crate) fn media_words(scene: &Scene) -> Vec<u32> {
    let media = &scene.media;
    let mut words = vec![media.len() as u32];
    words.resize(1 + media.len() * WORDS, 0);
    // Grids that media share are written once: their addresses, and where they begin.
    let mut known: Vec<(*const DensityGrid, [u32; 8])> = Vec::new();
    for (index, medium) in media.iter().enumerate() {
        let unit = Arc::new(DensityGrid {
            size: [1; 3],
            values: vec![1.0],
        });
        let density = medium.density.as_ref().unwrap_or(&unit);
        let address = Arc::as_ptr(density);
        let found = known.iter().find(|(other, _)| *other == address);
        let grids = match (found, &medium.density) {
            (Some((_, grids)), Some(_)) => *grids,
            _ => {
                let grids = append(&mut words, density);
                known.push((address, grids));
                grids
            }
        };
        let first = 1 + index * WORDS;
        words[first..first + 24].copy_from_slice(&parameters(medium));
        words[first + 24..first + WORDS].copy_from_slice(&grids);
    }
    words
}

/// The first 24 words of a medium.
fn parameters(medium: &Medium) -> [u32; 24] {
    // The shader's box spans 0 to 1.
    let box_from_world = medium
        .world_from_box
        .map_or(Mat4::IDENTITY, |world_from_box| {
            Mat4::from_translation(Vec3::splat(0.5)) * world_from_box.inverse()
        });
    let (g, kind) = match medium.phase {
        PhaseFunction::HenyeyGreenstein(g) => (g, 0),
        PhaseFunction::CornetteShanks(g) => (g, CORNETTE_SHANKS),
    };
    let everywhere = match medium.world_from_box {
        Some(_) => 0,
        None => EVERYWHERE,
    };
    // Emission is collected where tracking stops, which it has to do about four times in an emissive box.
    let stops = match medium.bounds() {
        Some(bounds) if medium.emission != Vec3::ZERO => 4.0 / bounds.diagonal().max(1e-20),
        _ => 0.0,
    };
    let largest = medium.extinction.max_element().max(stops);
    let mut words = [0; 24];
    let rows = [0, 1, 2].map(|row| box_from_world.row(row).to_array());
    for (word, value) in words.iter_mut().zip(rows.as_flattened()) {
        *word = value.to_bits();
    }
    let bits = |vector: Vec3| vector.to_array().map(f32::to_bits);
    words[12..15].copy_from_slice(&bits(medium.extinction));
    words[15] = everywhere | kind;
    words[16..19].copy_from_slice(&bits(medium.albedo));
    words[19] = g.clamp(-MAX_ASYMMETRY, MAX_ASYMMETRY).to_bits();
    words[20..23].copy_from_slice(&bits(medium.emission));
    words[23] = largest.to_bits();
    words
}

/// Appends the densities and their majorants; returns the last eight words of a medium.
fn append(words: &mut Vec<u32>, density: &DensityGrid) -> [u32; 8] {
    let size = density.size;
    let first = words.len() as u32;
    words.extend(density.values.iter().map(|value| value.to_bits()));
    let cells = size.map(|side| side.min(MAJORANT_CELLS));
    let first_majorant = words.len() as u32;
    words.extend(
        majorants(density, cells)
            .iter()
            .map(|value| value.to_bits()),
    );
    [
        size[0],
        size[1],
        size[2],
        first,
        cells[0],
        cells[1],
        cells[2],
        first_majorant,
    ]
}

/// The largest interpolated density in each of `cells` cells; x varies fastest, then y.
fn majorants(density: &DensityGrid, cells: [u32; 3]) -> Vec<f32> {
    let [width, height, _] = density.size.map(|side| side as usize);
    // Values that interpolation reads in a cell, along one axis.
    let range = |axis: usize, cell: u32| {
        let (size, count) = (u64::from(density.size[axis]), u64::from(cells[axis]));
        let low = u64::from(cell) * size / count;
        let high = (u64::from(cell + 1) * size).div_ceil(count);
        (low.saturating_sub(1)) as usize..(high + 1).min(size) as usize
    };
    let mut largest = Vec::new();
    for z in 0..cells[2] {
        for y in 0..cells[1] {
            for x in 0..cells[0] {
                let mut most = 0.0_f32;
                for slice in range(2, z) {
                    for row in range(1, y) {
                        let line = (slice * height + row) * width;
                        let columns = range(0, x);
                        let values = &density.values[line + columns.start..line + columns.end];
                        most = values.iter().copied().fold(most, f32::max);
                    }
                }
                largest.push(most);
            }
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn majorants_bound_the_density_and_follow_it() {
        let size = [40, 3, 17];
        let count = size.iter().product::<u32>();
        let values = (0..count)
            .map(|index| (index * 7919 % 101) as f32)
            .collect();
        let density = DensityGrid { size, values };
        let cells = size.map(|side| side.min(MAJORANT_CELLS));
        let largest = majorants(&density, cells);
        assert_eq!(largest.len(), (16 * 3 * 16));
        // Every value is read up to the centres of its neighbours.
        for (index, &value) in density.values.iter().enumerate() {
            let index = index as u32;
            let at = [index % 40, index / 40 % 3, index / 120];
            for corner in 0..8 {
                let cell: Vec<u32> = (0..3)
                    .map(|axis| {
                        let reach = if corner >> axis & 1 == 0 { -0.5 } else { 1.5 };
                        let side = size[axis] as f32;
                        let place = (at[axis] as f32 + reach).clamp(0.0, side - 0.01) / side;
                        (place * cells[axis] as f32) as u32
                    })
                    .collect();
                let most = largest[((cell[2] * 3 + cell[1]) * 16 + cell[0]) as usize];
                assert!(most >= value, "{at:?} {cell:?}");
            }
        }
        let flat = DensityGrid {
            size: [64; 3],
            values: (0..64 * 64 * 64).map(|index| (index % 64) as f32).collect(),
        };
        let rising = majorants(&flat, [16; 3]);
        assert_eq!((rising[0], rising[15]), (4.0, 63.0));
    }
}
