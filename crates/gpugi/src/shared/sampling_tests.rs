//! Tests that sampled directions follow their densities and that their weights stay within their limits.

use glam::DVec3;

use super::brdf_tests::{evaluate, run, shader};
use super::cpu::Case;
use crate::gpu::Gpu;
use crate::testing::chi_square::{Bins, assert_follows};
use crate::testing::test_gpu;

const SAMPLES: usize = 1 << 17;

/// Approximate number of tests in this file.
const TESTS: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Lobe {
    Diffuse,
    Glossy,
    Transmission,
}

/// Compares samples of a lobe with its density over the whole sphere. Returns the density's integral over the sphere,
/// and the largest weight f |cos| / density.
fn check(gpu: &Gpu, case: &Case, lobe: Lobe) -> (f64, f32) {
    let (axis, width) = match lobe {
        Lobe::Diffuse => (case.normal(), 0.5),
        Lobe::Glossy => case.glossy_lobe(),
        Lobe::Transmission => case.transmitted_lobe(),
    };
    let drawn = Case {
        samples: SAMPLES as u32,
        ..*case
    };
    let size = [SAMPLES * 3, SAMPLES];
    let rows = run(gpu, &shader(), "draw", &[drawn], &[DVec3::Z], size);
    let rows: Vec<_> = rows.iter().skip(lobe as usize).step_by(3).collect();
    let samples: Vec<DVec3> = rows
        .iter()
        .map(|row| DVec3::new(row[0].into(), row[1].into(), row[2].into()))
        .collect();
    let what = format!("{lobe:?} of {case:?}");
    let bins = Bins::around(axis, width);
    let fit = assert_follows(&what, TESTS, &bins, &samples, |directions| {
        let rows = evaluate(gpu, &[*case], directions);
        rows.iter()
            .map(|row| row[lobe as usize][3].into())
            .collect()
    });
    assert!(
        rows.iter().all(|row| row[3].is_finite() && row[3] >= 0.0),
        "{what}"
    );
    let largest = rows.iter().map(|row| row[3]).fold(0.0, f32::max);
    if lobe != Lobe::Transmission {
        assert!((fit.mass - 1.0).abs() < 0.003, "{fit:?}: {what}");
    }
    (fit.mass, largest)
}

#[test]
fn diffuse_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for degrees in [0.0, 40.0] {
        check(&gpu, &Case::dielectric(1.0).seen_at(degrees), Lobe::Diffuse);
    }
}

#[test]
fn ggx_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for roughness in [0.02, 0.1, 0.5, 1.0] {
        for degrees in [0.0, 50.0, 85.0, 89.0] {
            // Narrow lobes at grazing angles are too flat for round bins.
            if degrees > 80.0 && roughness < 0.1 || degrees > 88.0 && roughness < 0.5 {
                continue;
            }
            let case = Case::metal(roughness).seen_at(degrees);
            let (_, largest) = check(&gpu, &case, Lobe::Glossy);
            // The weight is F G2 / G1.
            assert!(largest < 1.002, "a weight of {largest}: {case:?}");
        }
    }
}

#[test]
fn phong_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for shininess in [0.0, 5.0, 300.0] {
        for degrees in [0.0, 60.0, 88.0] {
            let case = Case::phong(shininess).seen_at(degrees);
            let (_, largest) = check(&gpu, &case, Lobe::Glossy);
            assert!(largest <= 1.0001 * (shininess + 2.0) / (shininess + 1.0));
        }
    }
}

#[test]
fn blinn_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for shininess in [0.0, 5.0, 40.0, 1200.0_f32] {
        for degrees in [0.0, 60.0, 80.0] {
            // The density of wide lobes is infinite in direction -wo, below the surface, which bins cannot integrate.
            // The furnace has such cases.
            if degrees > 0.0 && f64::to_radians(degrees).sin().powf(shininess.into()) > 0.01 {
                continue;
            }
            let case = Case::blinn(shininess).seen_at(degrees);
            let (_, largest) = check(&gpu, &case, Lobe::Glossy);
            // 8 pi s / (n + 2) v.h n.l / n.h, and n.l / n.h < 2 v.h.
            let bound = 2.0 * (shininess + 4.0) / (shininess + (-0.5 * shininess).exp2());
            assert!(largest <= 1.001 * bound, "a weight of {largest}: {case:?}");
        }
    }
}

#[test]
fn refracted_samples_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for roughness in [0.05, 0.2, 0.6, 1.0] {
        for degrees in [0.0, 35.0, 60.0, 85.0] {
            for eta in [1.5, 1.0 / 1.5] {
                if roughness < 0.1 && eta < 1.0 && degrees > 42.0 {
                    // Total internal reflection: almost no facet transmits light.
                    continue;
                }
                let case = Case::glass(roughness, eta).seen_at(degrees);
                let (_, largest) = check(&gpu, &case, Lobe::Transmission);
                // The weight is (1 - F) G1 times the factor of radiance.
                assert!(
                    largest * eta * eta < 1.002,
                    "a weight of {largest}: {case:?}"
                );
            }
        }
    }
    // Almost no refraction.
    check(
        &gpu,
        &Case::glass(0.5, 1.02).seen_at(30.0),
        Lobe::Transmission,
    );
}

#[test]
fn samples_through_thin_walls_follow_their_density() {
    let Some(gpu) = test_gpu() else { return };
    for roughness in [0.05, 0.5, 1.0] {
        for degrees in [0.0, 50.0, 85.0] {
            let case = Case::pane(roughness).seen_at(degrees);
            let (_, largest) = check(&gpu, &case, Lobe::Transmission);
            assert!(largest < 1.002, "a weight of {largest}: {case:?}");
        }
    }
}
