//! Tests Hammersley's points: their nets, what is near what, and the independence of seeds.

use crate::gpu::Gpu;
use crate::shader;
use crate::testing::{run_kernel, test_gpu};

/// The `count` points of each seed.
fn points(gpu: &Gpu, seeds: &[u32], count: usize) -> Vec<Vec<[f64; 2]>> {
    let rows: Vec<[u32; 4]> = seeds.iter().map(|&s| [s, count as u32, 0, 0]).collect();
    let rows = gpu.storage("sets", &rows).unwrap();
    let total = count * seeds.len();
    let found: Vec<[u32; 2]> = run_kernel(
        gpu,
        &shader!("testing.hammersley"),
        "points",
        &[("sets", &rows)],
        total,
        total as u32,
    )
    .unwrap();
    let point = |bits: &[u32; 2]| bits.map(|bits| f64::from(f32::from_bits(bits)));
    found
        .chunks(count)
        .map(|points| points.iter().map(point).collect())
        .collect()
}

#[test]
fn points_fill_every_elementary_interval_once() {
    let Some(gpu) = test_gpu() else { return };
    for m in [0_u32, 1, 2, 5, 10] {
        for points in points(&gpu, &[0, 7], 1 << m) {
            assert!(points.iter().flatten().all(|x| (0.0..1.0).contains(x)));
            for across in 0..=m {
                let mut is_taken = vec![false; 1 << m];
                for [x, y] in &points {
                    let column = (x * f64::from(1 << across)) as usize;
                    let row = (y * f64::from(1 << (m - across))) as usize;
                    let taken = &mut is_taken[column << (m - across) | row];
                    assert!(!*taken, "two of 2^{m} points in one interval");
                    *taken = true;
                }
            }
        }
    }
}

/// Any number of points has one in each of as many intervals of the second coordinate.
#[test]
fn every_number_of_points_is_stratified() {
    let Some(gpu) = test_gpu() else { return };
    for count in [3, 100, 1000] {
        let mut rows: Vec<_> = points(&gpu, &[5], count)[0]
            .iter()
            .map(|point| (point[1] * count as f64) as usize)
            .collect();
        rows.sort_unstable();
        assert_eq!(rows, (0..count).collect::<Vec<_>>());
    }
}

#[test]
fn consecutive_points_are_near_each_other() {
    let Some(gpu) = test_gpu() else { return };
    for run in points(&gpu, &[3], 1024)[0].chunks(32) {
        let extent = [0, 1].map(|axis| {
            let of = run.iter().map(|point| point[axis]);
            of.clone().fold(0.0, f64::max) - of.fold(1.0, f64::min)
        });
        assert!(extent[0] < 0.25 && extent[1] < 0.125, "{extent:?}");
    }
}

/// Over all seeds, each of 16 x 16 cells is equally likely for any point.
#[test]
fn each_point_is_uniform_over_seeds() {
    let Some(gpu) = test_gpu() else { return };
    let seeds: Vec<u32> = (0..4096).collect();
    let all = points(&gpu, &seeds, 12);
    for index in [0, 5, 11] {
        let mut cells = vec![0.0; 256];
        // A point stays in its interval of the second coordinate and is uniform within.
        let interval = (all[0][index][1] * 12.0).floor();
        for points in &all {
            let [x, y] = points[index];
            cells[(x * 16.0) as usize * 16 + ((y * 12.0 - interval) * 16.0) as usize] += 1.0;
        }
        let expected = seeds.len() as f64 / 256.0;
        let statistic: f64 = cells
            .iter()
            .map(|cell| (cell - expected) * (cell - expected) / expected)
            .sum();
        // 255 degrees of freedom, six standard deviations.
        assert!(
            (statistic - 255.0).abs() < 6.0 * 22.6,
            "point {index}: chi-square {statistic}"
        );
    }
}
