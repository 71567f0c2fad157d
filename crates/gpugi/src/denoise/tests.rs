//! The filter on pictures whose noise is known.

use super::filter::{Denoiser, Noisy, NonLocalMeans};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::testing::test_gpu;

const SIZE: [u32; 2] = [40, 36];
/// Standard deviation of the noise.
const SIGMA: f32 = 0.1;

/// A number between -1 and 1, and of mean 0, for each pixel and channel.
fn random(index: usize, channel: usize) -> f32 {
    let hash = (index * 3 + channel + 1) as u32;
    let hash = hash.wrapping_mul(0x9e37_79b9) ^ hash.wrapping_mul(0x85eb_ca6b).rotate_left(15);
    let hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
    (hash >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// Light 0.5 on the left and `right` on the right, with noise, on a plane at the distance 1.
fn picture(right: f32) -> Vec<Noisy> {
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    let pixel = |index: usize| {
        let is_right = index as u32 % SIZE[0] >= SIZE[0] / 2;
        let light = if is_right { right } else { 0.5 };
        // The variance of what is uniform between -1 and 1 is 1/3.
        let noise = |channel| SIGMA * 3.0_f32.sqrt() * random(index, channel);
        Noisy {
            light: [0, 1, 2].map(|channel| light + noise(channel)),
            depth: 1.0,
            variance: [SIGMA * SIGMA; 3],
            normal: 0x0000_7f00,
            guide: [0.8; 3],
            surface: 0,
        }
    };
    (0..pixels).map(pixel).collect()
}

/// Filters a picture, in windows of no more than `rows` rows. Returns red over albedo.
fn filtered(gpu: &Gpu, pixels: &[Noisy], rows: u32) -> Vec<f32> {
    let denoiser = Denoiser::with_rows(gpu, SIZE, rows).unwrap();
    let mut picture: Vec<[f32; 4]> = Vec::new();
    for window in denoiser.means.windows() {
        let [first, end] = [window.read.start, window.read.end].map(|row| (row * SIZE[0]) as usize);
        gpu.write(&denoiser.means.pixels, 0, &pixels[first..end]);
        let mut frame = Frame::new(gpu, false);
        denoiser.record(&mut frame, &window).unwrap();
        frame.submit().unwrap();
        let bytes = u64::from(window.written.end - window.written.start) * u64::from(SIZE[0]) * 16;
        picture.extend(read_buffer::<[f32; 4]>(gpu, &denoiser.filtered, bytes).unwrap());
    }
    let light = picture.iter().zip(pixels);
    light
        .map(|(radiance, pixel)| radiance[0] / pixel.guide[0])
        .collect()
}

/// Mean squared difference from the light without noise.
fn error(picture: &[f32], right: f32) -> f32 {
    let squares = picture.iter().enumerate().map(|(index, light)| {
        let is_right = index as u32 % SIZE[0] >= SIZE[0] / 2;
        (light - if is_right { right } else { 0.5 }).powi(2)
    });
    squares.sum::<f32>() / picture.len() as f32
}

#[test]
fn noise_goes_and_edges_stay() {
    let Some(gpu) = test_gpu() else { return };
    // Nothing but light tells both halves apart.
    for right in [0.5, 1.5] {
        let after = error(&filtered(&gpu, &picture(right), SIZE[1]), right);
        assert!(after < SIGMA * SIGMA / 25.0, "{right}: {after}");
    }
    // An edge as faint as the noise is kept if normals, albedos or depths tell it.
    type Mark = fn(&mut Noisy);
    let marks: [Mark; 3] = [
        |pixel| pixel.normal = 0x007f_0000,
        |pixel| pixel.guide = [0.2; 3],
        |pixel| pixel.depth = 2.0,
    ];
    for (index, mark) in marks.into_iter().enumerate() {
        let mut marked = picture(0.6);
        let right = |index: usize| index as u32 % SIZE[0] >= SIZE[0] / 2;
        marked
            .iter_mut()
            .enumerate()
            .filter(|(index, _)| right(*index))
            .for_each(|(_, pixel)| mark(pixel));
        let after = error(&filtered(&gpu, &marked, SIZE[1]), 0.6);
        let blurred = error(&filtered(&gpu, &picture(0.6), SIZE[1]), 0.6);
        assert!(
            after < 0.75 * blurred,
            "mark {index}: {after}, not below {blurred}"
        );
    }
}

#[test]
fn what_has_no_noise_stays() {
    let Some(gpu) = test_gpu() else { return };
    let mut pixels = picture(1.5);
    for pixel in &mut pixels {
        pixel.variance = [0.0; 3];
    }
    for (after, before) in filtered(&gpu, &pixels, SIZE[1]).iter().zip(&pixels) {
        assert!(
            (after - before.light[0]).abs() < 1e-5,
            "{after}, not {}",
            before.light[0]
        );
    }
}

#[test]
fn windows_do_not_show() {
    let Some(gpu) = test_gpu() else { return };
    let mut pixels = picture(1.5);
    for (index, pixel) in pixels.iter_mut().enumerate() {
        let row = index as u32 / SIZE[0];
        pixel.depth = 1.0 + 0.03 * row as f32 + (row / 11) as f32;
        pixel.normal = [0x0000_7f00, 0x0000_7f20, 0x0010_7f00][index % 3];
    }
    let whole = filtered(&gpu, &pixels, SIZE[1]);
    assert_eq!(filtered(&gpu, &pixels, 27), whole);
    let denoiser = Denoiser::with_rows(&gpu, SIZE, 27).unwrap();
    assert_eq!(denoiser.means.windows().count(), 4);
}

/// Texels 0.1 m apart, in the same order as the pixels, all on one surface.
fn texels(right: f32) -> Vec<Noisy> {
    let mut texels = picture(right);
    for (index, texel) in texels.iter_mut().enumerate() {
        let [x, y] = [index as u32 % SIZE[0], index as u32 / SIZE[0]].map(|at| at as f32 * 0.1);
        (texel.guide, texel.depth, texel.surface) = ([x, y, 0.0], 0.1, 1);
        texel.normal = 0x007f_0000;
    }
    texels
}

fn filtered_texels(gpu: &Gpu, texels: &[Noisy]) -> Vec<f32> {
    let means = NonLocalMeans::of_texels(gpu, SIZE).unwrap();
    gpu.write(&means.pixels, 0, texels);
    let mut frame = Frame::new(gpu, false);
    means.record_all(&mut frame).unwrap();
    frame.submit().unwrap();
    let sums = read_buffer::<[f32; 4]>(gpu, &means.sums, means.sums.size()).unwrap();
    sums.iter().map(|sum| sum[0] / sum[3]).collect()
}

/// A difference that noise hides leaks across one surface, but neither to another one nor to another place.
#[test]
fn texels_take_nothing_from_other_surfaces() {
    let Some(gpu) = test_gpu() else { return };
    let is_right = |index: usize| index as u32 % SIZE[0] >= SIZE[0] / 2;
    // Of the columns beside the border.
    let leak = |filtered: &[f32]| {
        let beside = |column: u32| {
            let column = filtered
                .iter()
                .skip(column as usize)
                .step_by(SIZE[0] as usize);
            column.sum::<f32>() / SIZE[1] as f32
        };
        beside(SIZE[0] / 2 - 1) - 0.5 + 0.65 - beside(SIZE[0] / 2)
    };
    let one = leak(&filtered_texels(&gpu, &texels(0.65)));
    assert!(one > 0.06, "{one}");
    type Mark = fn(&mut Noisy);
    let marks: [Mark; 4] = [
        |texel| texel.surface = 2,
        |texel| texel.guide[1] += 30.0,
        |texel| texel.guide[2] = 0.8,
        |texel| texel.normal = 0x0000_007f,
    ];
    for (number, mark) in marks.into_iter().enumerate() {
        let mut apart = texels(0.65);
        let right = apart
            .iter_mut()
            .enumerate()
            .filter(|(index, _)| is_right(*index));
        right.for_each(|(_, texel)| mark(texel));
        let leak = leak(&filtered_texels(&gpu, &apart));
        assert!(leak.abs() < 0.03, "{number}: {leak}");
    }
}

/// Beside empty texels, noise goes as well as elsewhere, and their black goes nowhere.
#[test]
fn empty_texels_tell_nothing() {
    let Some(gpu) = test_gpu() else { return };
    let mut holed = texels(0.5);
    let is_hole = |index: usize| (index as u32 % SIZE[0]) % 8 >= 5;
    for (index, texel) in holed.iter_mut().enumerate() {
        if is_hole(index) {
            *texel = bytemuck::Zeroable::zeroed();
        }
    }
    let after = filtered_texels(&gpu, &holed);
    let left: Vec<f32> = (after.iter().enumerate())
        .filter(|(index, _)| !is_hole(*index))
        .map(|(_, light)| (light - 0.5).powi(2))
        .collect();
    let error = left.iter().sum::<f32>() / left.len() as f32;
    assert!(error < SIGMA * SIGMA / 20.0, "{error}");
}
