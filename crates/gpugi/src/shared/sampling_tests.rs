//! Sampled directions are distributed as their densities say: chi-square tests over bins around each lobe.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::brdf_tests::{evaluate, run, shader};
use super::cpu::{Case, frame};
use crate::gpu::Gpu;
use crate::testing::test_gpu;

/// Bins along the distance from the lobe's axis and around it.
const RINGS: usize = 12;
const SECTORS: usize = 8;
/// Midpoints along each side of a bin.
const STEPS: usize = 24;
const SAMPLES: usize = 1 << 16;

/// Bins of a lobe: its frame and width. The distance coordinate is q = T / (T + width^2) with T = tan^2(psi / 2).
struct Bins {
    frame: DMat3,
    width: f64,
}

impl Bins {
    fn of(&self, direction: DVec3) -> usize {
        let local = self.frame.transpose() * direction;
        let t = (1.0 - local.z) / (1.0 + local.z).max(1e-12);
        let q = t / (t + self.width * self.width);
        let turn = (local.y.atan2(local.x) / TAU).rem_euclid(1.0);
        let ring = ((q * RINGS as f64) as usize).min(RINGS - 1);
        ring * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
    }

    /// Midpoints of all bins, bin after bin, and the solid angle of each.
    fn midpoints(&self) -> Vec<(DVec3, f64)> {
        let mut points = Vec::new();
        for bin in 0..RINGS * SECTORS {
            for i in 0..STEPS {
                for j in 0..STEPS {
                    let q =
                        ((bin / SECTORS) as f64 + (i as f64 + 0.5) / STEPS as f64) / RINGS as f64;
                    let phi = TAU * ((bin % SECTORS) as f64 + (j as f64 + 0.5) / STEPS as f64)
                        / SECTORS as f64;
                    let w2 = self.width * self.width;
                    let t = w2 * q / (1.0 - q);
                    let c = (1.0 - t) / (1.0 + t);
                    let s = (1.0 - c * c).max(0.0).sqrt();
                    // |d cos / dt| dt/dq dq dphi
                    let measure =
                        2.0 / (1.0 + t).powi(2) * w2 / (1.0 - q).powi(2) / (RINGS * STEPS) as f64
                            * TAU
                            / (SECTORS * STEPS) as f64;
                    points.push((
                        self.frame * DVec3::new(s * phi.cos(), s * phi.sin(), c),
                        measure,
                    ));
                }
            }
        }
        points
    }
}

/// Compares samples of lobe 0 (diffuse) or 1 (glossy) with the density that the shader states for them, over the whole sphere.
fn check(gpu: &Gpu, case: &Case, lobe: usize) {
    let (axis, width) = if lobe == 0 {
        (case.normal(), 0.5)
    } else {
        case.glossy_lobe()
    };
    let bins = Bins {
        frame: frame(axis),
        width,
    };
    let midpoints = bins.midpoints();
    let directions: Vec<DVec3> = midpoints.iter().map(|(direction, _)| *direction).collect();
    let densities = evaluate(gpu, &[*case], &directions);
    let mut expected = vec![0.0; RINGS * SECTORS];
    for (index, ((_, measure), density)) in midpoints.iter().zip(densities).enumerate() {
        expected[index / (STEPS * STEPS)] += f64::from(density[lobe][3]) * measure * SAMPLES as f64;
    }
    let whole: f64 = expected.iter().sum::<f64>() / SAMPLES as f64;
    assert!(
        (whole - 1.0).abs() < 0.005,
        "the density of lobe {lobe} integrates to {whole}: {case:?}"
    );

    let drawn = Case {
        samples: SAMPLES as u32,
        ..*case
    };
    let rows = run(
        gpu,
        &shader(),
        "draw",
        &[drawn],
        &[DVec3::Z],
        [SAMPLES * 3, SAMPLES],
    );
    let mut observed = vec![0.0; RINGS * SECTORS];
    for row in rows.iter().skip(lobe).step_by(3) {
        let direction = DVec3::new(row[0].into(), row[1].into(), row[2].into());
        assert!(
            (direction.length() - 1.0).abs() < 1e-4,
            "{direction} is no unit vector"
        );
        observed[bins.of(direction)] += 1.0;
    }
    // Bins that expect few samples are pooled.
    let (mut statistic, mut freedom) = (0.0, 0.0_f64);
    let (mut few_expected, mut few_observed) = (0.0, 0.0);
    for (expected, observed) in expected.iter().zip(&observed) {
        if *expected < 20.0 {
            few_expected += expected;
            few_observed += observed;
        } else {
            statistic += (observed - expected) * (observed - expected) / expected;
            freedom += 1.0;
        }
    }
    if few_expected > 5.0 {
        statistic += (few_observed - few_expected) * (few_observed - few_expected) / few_expected;
    } else {
        assert!(
            few_observed < 25.0,
            "{few_observed} samples where none belong: {case:?}"
        );
    }
    // The statistic has mean `freedom` and variance 2 `freedom`; quadrature adds a little.
    let bound = freedom + 6.0 * (2.0 * freedom).sqrt() + 10.0;
    assert!(freedom > 15.0, "only {freedom} bins in use: {case:?}");
    assert!(
        statistic < bound,
        "chi-square {statistic} above {bound}, lobe {lobe}: {case:?}"
    );
}

#[test]
fn diffuse_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    check(&gpu, &Case::dielectric(1.0), 0);
    check(&gpu, &Case::dielectric(1.0).seen_at(40.0), 0);
}

#[test]
fn ggx_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for roughness in [0.1, 0.5, 1.0] {
        for degrees in [0.0, 50.0, 85.0] {
            check(&gpu, &Case::metal(roughness).seen_at(degrees), 1);
        }
    }
}

#[test]
fn phong_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for shininess in [0.0, 5.0, 300.0] {
        check(&gpu, &Case::phong(shininess).seen_at(60.0), 1);
    }
}
