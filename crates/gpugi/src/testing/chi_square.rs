//! Tests whether sampled directions follow their density: Pearson's chi-square test over bins of the sphere, with
//! pooling of bins that expect few samples and Sidak's correction for multiple tests, as in the tests of pbrt (Pharr,
//! Jakob, Humphreys) and Mitsuba.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

/// Bins of the sphere: rings around an axis, divided into sectors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bins {
    frame: DMat3,
    width: f64,
    /// Midpoints along each side of a bin.
    steps: usize,
}

const RINGS: usize = 16;
const SECTORS: usize = 16;
/// Default number of midpoints along each side of a bin.
const STEPS: usize = 16;
/// Minimum number of expected samples per bin; bins with fewer are pooled.
const FEW: f64 = 5.0;
/// Probability that any of a family of tests fails although all samplers are correct.
const SIGNIFICANCE: f64 = 0.01;
/// Allowed quadrature error where a density ends abruptly, such as at a horizon (fraction of all samples).
const QUADRATURE: f64 = 0.003;

impl Bins {
    /// The whole sphere, uniformly, around +Z.
    pub fn sphere() -> Self {
        Self::around(DVec3::Z, 1.0)
    }

    /// Finer near `axis` (unit), for a lobe with an angular width of about 2 atan(`width`): half of the rings lie
    /// within it. The rings are evenly spaced in q = t / (t + width) with t = tan(psi / 2), psi the angle from the
    /// axis, as GGX's long tails require.
    pub fn around(axis: DVec3, width: f64) -> Self {
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        Self {
            frame: DMat3::from_cols(tangent, bitangent, axis),
            width,
            steps: STEPS,
        }
    }

    /// Sets the number of midpoints along each side of a bin. More are needed if edges of the density cut through bins.
    pub fn with_steps(self, steps: usize) -> Self {
        Self { steps, ..self }
    }

    fn of(&self, direction: DVec3) -> usize {
        let local = self.frame.transpose() * direction;
        // Avoid the difference 1 - cos, which for narrow lobes is below the rounding error of cos.
        let t = local.truncate().length() / (1.0 + local.z).max(1e-15);
        let q = t / (t + self.width);
        let turn = (local.y.atan2(local.x) / TAU).rem_euclid(1.0);
        let ring = ((q * RINGS as f64) as usize).min(RINGS - 1);
        ring * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
    }

    /// Midpoints of all bins, bin by bin, each with its solid angle.
    fn midpoints(&self) -> Vec<(DVec3, f64)> {
        let mut points = Vec::with_capacity(RINGS * SECTORS * self.steps * self.steps);
        for bin in 0..RINGS * SECTORS {
            for i in 0..self.steps {
                // tan(psi / 2) and 1 - cos psi at a fractional step.
                let tangent = |fraction: f64| {
                    let step = ((bin / SECTORS) * self.steps + i) as f64 + fraction;
                    let q = step / (RINGS * self.steps) as f64;
                    self.width * q / (1.0 - q).max(1e-15)
                };
                let height = |t: f64| 2.0 * t * t / (1.0 + t * t);
                let t = tangent(0.5);
                let (s, c) = (2.0 * t / (1.0 + t * t), 1.0 - height(t));
                let measure = (height(tangent(1.0)) - height(tangent(0.0))) * TAU
                    / (SECTORS * self.steps) as f64;
                for j in 0..self.steps {
                    let turn = (bin % SECTORS) as f64 + (j as f64 + 0.5) / self.steps as f64;
                    let phi = TAU * turn / SECTORS as f64;
                    let local = DVec3::new(s * phi.cos(), s * phi.sin(), c);
                    points.push((self.frame * local, measure));
                }
            }
        }
        points
    }
}

/// How well samples fit a density.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    /// Probability of a deviation at least this large if the density is right up to a factor.
    pub p_value: f64,
    /// The density's integral over the sphere.
    pub mass: f64,
    /// The fraction of samples that are directions; the mass should equal it.
    pub share: f64,
    /// Bins after pooling.
    pub bins: usize,
}

/// Compares `samples` (unit vectors, or zero where sampling produced none) with a density over solid angle [1/sr],
/// which `densities` evaluates for many directions at once. The density may integrate to less than 1; the zero samples
/// make up the rest.
///
/// # Panics
/// If a sample is neither a unit vector nor zero, or a density is negative, infinite or NaN.
pub(crate) fn chi_square(
    bins: &Bins,
    samples: &[DVec3],
    densities: impl FnOnce(&[DVec3]) -> Vec<f64>,
) -> Fit {
    let midpoints = bins.midpoints();
    let directions: Vec<DVec3> = midpoints.iter().map(|(direction, _)| *direction).collect();
    let densities = densities(&directions);
    // Expected and observed samples per bin.
    let mut cells = vec![(0.0, 0.0); RINGS * SECTORS];
    for (index, ((direction, measure), density)) in midpoints.iter().zip(densities).enumerate() {
        assert!(
            density.is_finite() && density >= 0.0,
            "a density of {density} toward {direction}"
        );
        cells[index / (bins.steps * bins.steps)].0 += density * measure;
    }
    let mass: f64 = cells.iter().map(|cell| cell.0).sum();
    let mut drawn = 0.0;
    for sample in samples.iter().filter(|sample| **sample != DVec3::ZERO) {
        assert!(
            (sample.length() - 1.0).abs() < 1e-4,
            "{sample} is no unit vector"
        );
        cells[bins.of(*sample)].1 += 1.0;
        drawn += 1.0;
    }
    cells.iter_mut().for_each(|cell| cell.0 *= drawn / mass);
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut statistic, mut bins) = (0.0, 0);
    let mut pool = (0.0, 0.0);
    for (expected, observed) in cells {
        pool = (pool.0 + expected, pool.1 + observed);
        if pool.0 >= FEW {
            statistic += (pool.1 - pool.0) * (pool.1 - pool.0) / pool.0;
            bins += 1;
            pool = (0.0, 0.0);
        }
    }
    Fit {
        p_value: upper_tail(statistic, bins.max(1) - 1),
        mass,
        share: drawn / samples.len() as f64,
        bins,
    }
}

/// Fails unless `samples` follow the density: see [`chi_square`]. `tests` is the number of tests in the family, for
/// Sidak's correction; `what` appears in the message. Returns the fit, so that the caller can check its mass.
///
/// # Panics
/// If the samples do not follow the density.
pub(crate) fn assert_follows(
    what: &str,
    tests: usize,
    bins: &Bins,
    samples: &[DVec3],
    densities: impl FnOnce(&[DVec3]) -> Vec<f64>,
) -> Fit {
    let fit = chi_square(bins, samples, densities);
    let least = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests as f64);
    // Three standard deviations of the number of samples that are directions.
    let chance = 3.0 * (fit.share * (1.0 - fit.share) / samples.len() as f64).sqrt();
    assert!(
        (fit.mass - fit.share).abs() < QUADRATURE + chance,
        "the density integrates to another number than the share of samples that are directions, {fit:?}: {what}"
    );
    assert!(fit.bins > 12, "only {} bins in use: {what}", fit.bins);
    assert!(
        fit.p_value > least,
        "samples do not follow their density, {fit:?}: {what}"
    );
    fit
}

/// Probability that a chi-square variable exceeds `statistic`. For an even number of degrees of freedom, this is the
/// probability that a Poisson variable of mean statistic / 2 is less than half of that number. For an odd number, one
/// more degree is assumed.
fn upper_tail(statistic: f64, freedom: usize) -> f64 {
    let mean = statistic / 2.0;
    let mut logarithm = -mean;
    let mut sum = 0.0;
    for i in 0..freedom.div_ceil(2) {
        if i > 0 {
            logarithm += (mean / i as f64).ln();
        }
        sum += logarithm.exp();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    #[test]
    fn tails_are_those_of_the_tables() {
        for (statistic, freedom, expected) in
            [(18.307, 10, 0.05), (37.566, 20, 0.01), (124.342, 100, 0.05)]
        {
            let found = upper_tail(statistic, freedom);
            assert!((found - expected).abs() < 1e-4, "{found}, not {expected}");
        }
    }

    #[test]
    fn right_densities_pass_and_wrong_ones_do_not() {
        let mut random = Random(9);
        let samples: Vec<DVec3> = (0..200_000)
            .map(|index| match index % 4 {
                // A quarter of the samples are zero.
                0 => DVec3::ZERO,
                _ => random.direction().as_dvec3(),
            })
            .collect();
        for bins in [
            Bins::sphere(),
            Bins::around(DVec3::new(0.6, 0.0, -0.8), 0.2),
        ] {
            let p_value = |tilt: f64| {
                let density = |d: &DVec3| 0.75 / (2.0 * TAU) * (1.0 + tilt * d.x);
                let densities = |all: &[DVec3]| all.iter().map(density).collect();
                chi_square(&bins, &samples, densities).p_value
            };
            assert!(p_value(0.0) > 1e-3);
            assert!(p_value(0.1) < 1e-6);
            let fit = assert_follows("even", 8, &bins, &samples, |all| {
                vec![0.75 / (2.0 * TAU); all.len()]
            });
            assert!((fit.mass - 0.75).abs() < 1e-9);
        }
    }
}
