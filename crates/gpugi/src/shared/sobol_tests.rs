//! Tests Sobol-Owen points: the sequence itself, its nets, the independence of pixels and dimensions, and convergence.

use std::f64::consts::TAU;

use crate::gpu::Gpu;
use crate::shader;
use crate::testing::{run_kernel, test_gpu};

/// A pixel's seed, a pair of dimensions and the first index.
#[derive(Debug, Clone, Copy)]
struct Sequence(u32, u32, u32);

fn run(gpu: &Gpu, entry: &str, sequences: &[Sequence], count: usize) -> Vec<[u32; 2]> {
    let rows: Vec<[u32; 4]> = sequences.iter().map(|s| [s.0, s.1, s.2, 0]).collect();
    let rows = gpu.storage("sequences", &rows).unwrap();
    let total = count * sequences.len();
    let inputs = [("sequences", &rows)];
    run_kernel(
        gpu,
        &shader!("testing.sobol"),
        entry,
        &inputs,
        total,
        total as u32,
    )
    .unwrap()
}

/// The first `count` points of each sequence.
fn points(gpu: &Gpu, sequences: &[Sequence], count: usize) -> Vec<Vec<[f64; 2]>> {
    run(gpu, "points", sequences, count)
        .chunks(count)
        .map(|points| {
            let point = |bits: &[u32; 2]| bits.map(|bits| f64::from(f32::from_bits(bits)));
            points.iter().map(point).collect()
        })
        .collect()
}

/// Compares with direction numbers: van der Corput's, and v(k+1) = v(k) ^ v(k) >> 1 of the primitive polynomial x + 1.
#[test]
fn the_sequence_is_sobols() {
    let Some(gpu) = test_gpu() else { return };
    for first in [0, 0x1234_5600, u32::MAX - 1024] {
        let found = run(&gpu, "plain", &[Sequence(0, 0, first)], 1024);
        for (found, index) in found.iter().zip(first..) {
            let (mut expected, mut direction) = ([0_u32; 2], 1_u32 << 31);
            for bit in 0..32 {
                if index >> bit & 1 == 1 {
                    expected[0] ^= 1 << (31 - bit);
                    expected[1] ^= direction;
                }
                direction ^= direction >> 1;
            }
            assert_eq!(found, &expected, "point {index}");
        }
    }
}

#[test]
fn scrambled_points_fill_every_elementary_interval_once() {
    let Some(gpu) = test_gpu() else { return };
    // The second sequence starts in the middle, at a multiple of its length.
    let sequences = [
        Sequence(7, 0, 0),
        Sequence(7, 3, 5 << 12),
        Sequence(0, 0, 0),
    ];
    for m in [0_u32, 1, 4, 9, 12] {
        for (points, sequence) in points(&gpu, &sequences, 1 << m).iter().zip(sequences) {
            assert!(points.iter().flatten().all(|x| (0.0..1.0).contains(x)));
            for across in 0..=m {
                let mut is_taken = vec![false; 1 << m];
                for [x, y] in points {
                    let column = (x * f64::from(1 << across)) as usize;
                    let row = (y * f64::from(1 << (m - across))) as usize;
                    let taken = &mut is_taken[column << (m - across) | row];
                    assert!(!*taken, "{sequence:?}: two of 2^{m} points in one interval");
                    *taken = true;
                }
            }
        }
    }
}

/// Points of different pixels or dimension pairs are independent. Plotting one coordinate against the other over all
/// points, each of 16 x 16 cells is equally likely.
#[test]
fn pixels_and_dimension_pairs_are_independent() {
    let Some(gpu) = test_gpu() else { return };
    const COUNT: usize = 256;
    const PAIRS: usize = 256;
    // Neighbouring dimension pairs of one pixel; the same dimension pair of neighbouring pixels.
    let of_pixel: Vec<_> = (0..=PAIRS as u32)
        .map(|pair| Sequence(11, pair, 0))
        .collect();
    let of_pair: Vec<_> = (0..=PAIRS as u32)
        .map(|pixel| Sequence(pixel, 2, 0))
        .collect();
    for sequences in [of_pixel, of_pair] {
        let all = points(&gpu, &sequences, COUNT);
        for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let mut cells = vec![0.0; 256];
            for neighbours in all.windows(2) {
                for (point, other) in neighbours[0].iter().zip(&neighbours[1]) {
                    cells[(point[a] * 16.0) as usize * 16 + (other[b] * 16.0) as usize] += 1.0;
                }
            }
            let expected = (COUNT * PAIRS / 256) as f64;
            let statistic: f64 = cells
                .iter()
                .map(|cell| (cell - expected) * (cell - expected) / expected)
                .sum();
            // 255 degrees of freedom. Each 16th of a coordinate holds exactly the expected number of points, so the
            // spread is smaller than by chance.
            assert!(
                (100.0..255.0 + 6.0 * 22.6).contains(&statistic),
                "chi-square {statistic}, coordinates {a} and {b}, first {:?}",
                sequences[0]
            );
        }
    }
}

/// For a smooth integrand, the error of Owen scrambling falls as n^(-3/2), that of random points as n^(-1/2).
#[test]
fn a_smooth_integral_converges_faster_than_by_chance() {
    let Some(gpu) = test_gpu() else { return };
    const SEEDS: u32 = 64;
    let sequences: Vec<_> = (0..SEEDS).map(|seed| Sequence(seed, seed % 5, 0)).collect();
    // Mean 1, variance 5/4: the error of random points is sqrt(5/4 / n).
    let f = |[x, y]: [f64; 2]| (1.0 + (TAU * x).sin()) * (1.0 + (TAU * y).cos());
    for (count, bound) in [(16, 0.6), (256, 0.05), (1024, 0.0125)] {
        let errors = points(&gpu, &sequences, count).into_iter().map(|points| {
            let mean = points.into_iter().map(f).sum::<f64>() / count as f64;
            (mean - 1.0) * (mean - 1.0)
        });
        let error = (errors.sum::<f64>() / f64::from(SEEDS)).sqrt();
        let by_chance = (1.25 / count as f64).sqrt();
        assert!(
            error < bound * by_chance,
            "{count} points: {error}, by chance {by_chance}"
        );
    }
}
