//! Media for shaders: parameters, densities, and two grids of coarse cells: majorants bound the densities so that tracking
//! takes long steps through thin parts, and means stand for them where many rays share the work.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use gpugi_scene::{Bounds, DensityGrid, MAX_MEDIA, Medium, PhaseFunction, Scene};

use crate::gpu::GpuError;

/// Words per medium: scene/media.wesl.
const WORDS: usize = 36;
/// Fewest and most cells of majorants along an axis, if there are as many densities.
const MAJORANT_CELLS: [u32; 2] = [16, 64];
/// Densities along an axis that share a majorant, where that makes neither fewer nor more cells.
const PER_MAJORANT: u32 = 4;
/// Cells of means along an axis.
const MEAN_CELLS: u32 = 16;
/// Flags of a medium in scene/media.wesl.
const EVERYWHERE: u32 = 1;
const CORNETTE_SHANKS: u32 = 2;
const EVEN: u32 = 4;
/// Largest |g|. Beyond, all light goes on straight, as far as 32-bit floats can tell.
const MAX_ASYMMETRY: f32 = 0.999;

/// Rejects media that cannot be rendered.
pub(crate) fn check_media(media: &[Medium]) -> Result<(), GpuError> {
    let refuse = |what: String| Err(GpuError::Input { what });
    if media.len() > MAX_MEDIA {
        let count = media.len();
        return refuse(format!("{count} media: a scene has at most {MAX_MEDIA}"));
    }
    for medium in media {
        if let Err(reason) = medium.check() {
            return refuse(format!("medium {:?}: {reason}", medium.name));
        }
    }
    Ok(())
}

/// Whether any medium emits light, which counts as that of area lights.
pub(crate) fn emit_light(media: &[Medium]) -> bool {
    media.iter().any(|medium| medium.emission != Vec3::ZERO)
}

/// Whether the boxes of all media are apart from everything else, as clouds are from the ground.
pub(crate) fn stand_apart(scene: &Scene) -> bool {
    let meshes: Vec<Bounds> = scene.meshes.iter().map(|mesh| mesh.bounds()).collect();
    let meets_none = |medium: Bounds| {
        let mut instances = scene.instances.iter();
        instances.all(|instance| {
            let placed = meshes[instance.mesh].transformed(&instance.world_from_mesh);
            placed.min.cmpgt(medium.max).any() || placed.max.cmplt(medium.min).any()
        })
    };
    let mut boxes = scene.media.iter().map(Medium::bounds);
    boxes.all(|medium| medium.is_some_and(meets_none))
}

/// The box of a medium. One that fills everything is taken to fill `bounds`, those of the scene's instances, where
/// light is followed in steps.
pub(crate) fn world_from_box(medium: &Medium, bounds: &Bounds) -> Mat4 {
    medium.world_from_box.unwrap_or_else(|| {
        let centre = (bounds.min + bounds.max) / 2.0;
        Mat4::from_translation(centre) * Mat4::from_scale(bounds.max - bounds.min)
    })
}

/// Grids of densities, each once, and by medium the one that it has. The first is that of media without densities.
fn grids(media: &[Medium]) -> (Vec<Arc<DensityGrid>>, Vec<usize>) {
    let even = DensityGrid {
        size: [1; 3],
        values: vec![1.0],
    };
    let mut grids = vec![Arc::new(even)];
    let of_medium = media.iter().map(|medium| {
        let Some(density) = &medium.density else {
            return 0;
        };
        let known = grids.iter().position(|grid| Arc::ptr_eq(grid, density));
        known.unwrap_or_else(|| {
            grids.push(density.clone());
            grids.len() - 1
        })
    });
    let of_medium = of_medium.collect();
    (grids, of_medium)
}

/// Whether both have the same grids, so that [`density_words`] are the same.
pub(super) fn have_same_grids(before: &[Medium], after: &[Medium]) -> bool {
    let (before, of_before) = grids(before);
    let (after, of_after) = grids(after);
    let mut pairs = before.iter().zip(&after).skip(1);
    of_before == of_after && pairs.all(|(a, b)| Arc::ptr_eq(a, b))
}

/// Cells of the grid's majorants, then of its means. Fine grids are mostly those of sparse volumes, whose empty parts
/// small cells find (pbrt, 4th edition, has 16 cells for dense and 64 for sparse volumes).
fn coarse_cells(grid: &DensityGrid) -> [[u32; 3]; 2] {
    let [fewest, most] = MAJORANT_CELLS;
    let of_majorants = |side: u32| (side / PER_MAJORANT).clamp(fewest, most).min(side);
    [
        grid.size.map(of_majorants),
        grid.size.map(|side| side.min(MEAN_CELLS)),
    ]
}

/// The parameters of checked media, which [`density_words`] follow.
pub(super) fn medium_words(media: &[Medium], bounds: &Bounds) -> Vec<[u32; WORDS]> {
    let (grids, of_medium) = grids(media);
    let mut end = media.len() * WORDS;
    let places = grids.iter().map(|grid| {
        let [majorants, means] = coarse_cells(grid);
        let grids = [grid.size, majorants, means].map(|[x, y, z]| {
            let begin = end as u32;
            end += (x * y * z) as usize;
            [x, y, z, begin]
        });
        grids.as_flattened().try_into().expect("three rows")
    });
    let places: Vec<[u32; 12]> = places.collect();
    let rows = media.iter().zip(of_medium).map(|(medium, grid)| {
        let mut words = [0; WORDS];
        words[..24].copy_from_slice(&parameters(medium, bounds));
        words[24..].copy_from_slice(&places[grid]);
        words
    });
    rows.collect()
}

/// Densities, majorants and means of all grids that media have, in whole rows of four words.
pub(super) fn density_words(media: &[Medium]) -> Vec<u32> {
    if media.is_empty() {
        return Vec::new();
    }
    let mut words = Vec::new();
    for grid in grids(media).0 {
        let [of_majorants, of_means] = coarse_cells(&grid);
        let majorants = majorants(&grid, of_majorants);
        for values in [&grid.values, &majorants, &means(&grid, of_means)] {
            words.extend(values.iter().map(|value| value.to_bits()));
        }
    }
    words.resize(words.len().next_multiple_of(4), 0);
    words
}

/// Whether a medium has one density in its box.
pub(super) fn is_even(medium: &Medium) -> bool {
    match &medium.density {
        Some(density) => density.size == [1; 3],
        None => true,
    }
}

/// The largest density of each medium.
pub(super) fn densest(media: &[Medium]) -> Vec<f32> {
    let (grids, of_medium) = grids(media);
    let largest = grids
        .iter()
        .map(|grid| grid.values.iter().copied().fold(0.0, f32::max));
    let largest: Vec<f32> = largest.collect();
    of_medium.into_iter().map(|grid| largest[grid]).collect()
}

/// The first 24 words of a medium.
fn parameters(medium: &Medium, bounds: &Bounds) -> [u32; 24] {
    // The shader's box spans 0 to 1. Where there is no volume to fill, all points are outside of it.
    let to_unit = world_from_box(medium, bounds).inverse();
    let box_from_world = if to_unit.is_finite() {
        Mat4::from_translation(Vec3::splat(0.5)) * to_unit
    } else {
        Mat4::from_translation(Vec3::splat(2.0)) * Mat4::from_scale(Vec3::ZERO)
    };
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
    words[15] = everywhere | kind | if is_even(medium) { EVEN } else { 0 };
    words[16..19].copy_from_slice(&bits(medium.albedo));
    words[19] = g.clamp(-MAX_ASYMMETRY, MAX_ASYMMETRY).to_bits();
    words[20..23].copy_from_slice(&bits(medium.emission));
    words[23] = largest.to_bits();
    words
}

/// The largest interpolated density in each of `cells` cells; x varies fastest, then y.
fn majorants(density: &DensityGrid, cells: [u32; 3]) -> Vec<f32> {
    // Interpolation also reads the neighbours of the values in a cell.
    let largest = |values: &mut dyn Iterator<Item = f32>| values.fold(0.0, f32::max);
    by_cell(density, cells, 1, largest)
}

/// The mean of the densities in each of `cells` cells.
fn means(density: &DensityGrid, cells: [u32; 3]) -> Vec<f32> {
    let mean = |values: &mut dyn Iterator<Item = f32>| {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| {
            (sum + f64::from(value), count + 1.0)
        });
        (sum / count) as f32
    };
    by_cell(density, cells, 0, mean)
}

/// What `of` makes of the densities in each of `cells` cells, and of `reach` more in each direction; x varies fastest,
/// then y.
fn by_cell(
    density: &DensityGrid,
    cells: [u32; 3],
    reach: usize,
    of: impl Fn(&mut dyn Iterator<Item = f32>) -> f32,
) -> Vec<f32> {
    let [width, height, _] = density.size.map(|side| side as usize);
    // Values in a cell, along one axis.
    let range = |axis: usize, cell: u32| {
        let (size, count) = (u64::from(density.size[axis]), u64::from(cells[axis]));
        let low = (u64::from(cell) * size / count) as usize;
        let high = (u64::from(cell + 1) * size).div_ceil(count) as usize;
        low.saturating_sub(reach)..(high + reach).min(size as usize)
    };
    let mut found = Vec::new();
    for z in 0..cells[2] {
        for y in 0..cells[1] {
            for x in 0..cells[0] {
                let lines = range(2, z)
                    .flat_map(|slice| range(1, y).map(move |row| (slice * height + row) * width));
                let mut values = lines.flat_map(|line| {
                    let columns = range(0, x);
                    let values = &density.values[line + columns.start..line + columns.end];
                    values.iter().copied()
                });
                found.push(of(&mut values));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_stand_apart_and_fog_does_not() {
        for (name, is_apart) in [("cloud", true), ("fog-room", false)] {
            let mut scene = gpugi_scene::builtin::builtin(name, 1).unwrap();
            assert_eq!(stand_apart(&scene), is_apart, "{name}");
            scene.media[0].world_from_box = None;
            assert!(!stand_apart(&scene), "{name}");
        }
    }

    #[test]
    fn majorants_bound_the_density_and_follow_it() {
        let size = [40, 3, 17];
        let count = size.iter().product::<u32>();
        let values = (0..count)
            .map(|index| (index * 7919 % 101) as f32)
            .collect();
        let density = DensityGrid { size, values };
        let [cells, _] = coarse_cells(&density);
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
        let fine = DensityGrid {
            size: [300, 100, 8],
            values: vec![0.0; 240_000],
        };
        assert_eq!(coarse_cells(&fine), [[64, 25, 8], [16, 16, 8]]);
        let flat = DensityGrid {
            size: [64; 3],
            values: (0..64 * 64 * 64).map(|index| (index % 64) as f32).collect(),
        };
        let rising = majorants(&flat, [16; 3]);
        assert_eq!((rising[0], rising[15]), (4.0, 63.0));
        let means = means(&flat, [16; 3]);
        assert_eq!((means[0], means[15]), (1.5, 61.5));
    }
}
