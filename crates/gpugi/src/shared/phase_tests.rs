//! Tests that the directions drawn from phase functions follow them, and that these integrate to 1.

use glam::DVec3;

use crate::gpu::Gpu;
use crate::shader;
use crate::testing::chi_square::{Bins, assert_follows};
use crate::testing::{run_kernel, test_gpu};

const SAMPLES: usize = 1 << 17;

fn run(gpu: &Gpu, entry: &str, case: (f32, u32), directions: &[DVec3], count: usize) -> Vec<DVec3> {
    let case = gpu.storage("cases", &[[case.0.to_bits(), case.1]]).unwrap();
    let rows: Vec<[f32; 4]> = directions
        .iter()
        .map(|d| d.as_vec3().extend(0.0).to_array())
        .collect();
    let directions = gpu.storage("directions", &rows).unwrap();
    let inputs = [("cases", &case), ("directions", &directions)];
    let shader = shader!("testing.phase");
    let rows: Vec<[f32; 4]> =
        run_kernel(gpu, &shader, entry, &inputs, count, count as u32).unwrap();
    rows.iter()
        .map(|row| DVec3::new(row[0].into(), row[1].into(), row[2].into()))
        .collect()
}

#[test]
fn scattered_directions_follow_their_phase_function() {
    let Some(gpu) = test_gpu() else { return };
    let asymmetries = [-0.9, -0.3, -5e-4, 0.0, 5e-4, 2e-3, 0.3, 0.75, 0.95];
    for function in [0, 1] {
        for g in asymmetries {
            let what = format!("function {function}, g = {g}");
            let axis = DVec3::Z * if g < 0.0 { -1.0 } else { 1.0 };
            let width = 1.0 - f64::from(f32::abs(g));
            let samples = run(&gpu, "draw", (g, function), &[DVec3::Z], SAMPLES);
            let bins = Bins::around(axis, width);
            let tests = 2 * asymmetries.len();
            let fit = assert_follows(&what, tests, &bins, &samples, |directions| {
                let values = run(
                    &gpu,
                    "evaluate",
                    (g, function),
                    directions,
                    directions.len(),
                );
                values.iter().map(|value| value.x).collect()
            });
            assert!((fit.mass - 1.0).abs() < 0.003, "{fit:?}: {what}");
            if function == 0 {
                // g is the mean cosine of Henyey and Greenstein.
                let mean = samples.iter().map(|d| d.z).sum::<f64>() / SAMPLES as f64;
                assert!((mean - f64::from(g)).abs() < 0.01, "{mean}: {what}");
            }
        }
    }
}
