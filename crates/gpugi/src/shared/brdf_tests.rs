//! Tests values of the scattering models: reciprocity, albedos against quadrature, energy, Fresnel, delta materials.

use glam::{DVec3, Vec3};

use super::cpu::{Case, GOLD, conductor, dielectric};
use crate::gpu::{Gpu, Shader};
use crate::shader;
use crate::testing::{Random, run_kernel, test_gpu};

pub fn shader() -> Shader {
    shader!("testing.brdf")
}

/// Runs an entry point of testing/brdf.wesl.
pub fn run(
    gpu: &Gpu,
    shader: &Shader,
    entry: &str,
    cases: &[Case],
    directions: &[DVec3],
    [count, invocations]: [usize; 2],
) -> Vec<[f32; 4]> {
    let rows: Vec<[f32; 4]> = directions
        .iter()
        .map(|d| d.as_vec3().extend(0.0).to_array())
        .collect();
    let cases = gpu.storage("cases", cases).unwrap();
    let directions = gpu.storage("directions", &rows).unwrap();
    let inputs = [("cases", &cases), ("directions", &directions)];
    run_kernel(gpu, shader, entry, &inputs, count, invocations as u32).unwrap()
}

/// Value and density of the diffuse lobe, the glossy reflection and the transmission at `directions`. Evaluates one
/// case for all directions, or one case per direction.
pub fn evaluate(gpu: &Gpu, cases: &[Case], directions: &[DVec3]) -> Vec<[[f32; 4]; 3]> {
    let count = directions.len();
    let size = [count * 3, count];
    let rows = run(gpu, &shader(), "evaluate", cases, directions, size);
    rows.as_chunks::<3>().0.to_vec()
}

/// Reflected and transmitted light of each case by importance sampling, in all channels.
fn sampled_albedos(gpu: &Gpu, shader: &Shader, cases: &[Case]) -> Vec<[Vec3; 2]> {
    let rows = run(
        gpu,
        shader,
        "albedo",
        cases,
        &[DVec3::Z],
        [cases.len() * 2, cases.len()],
    );
    let pairs = rows.as_chunks::<2>().0.iter();
    pairs
        .map(|pair| pair.map(|row| Vec3::new(row[0], row[1], row[2])))
        .collect()
}

#[test]
fn host_and_shader_cases_have_one_layout() {
    let module = shader().parse().unwrap();
    let (_, ty) = module
        .types
        .iter()
        .find(|(_, ty)| ty.name.as_deref() == Some("Case"))
        .unwrap();
    let naga::TypeInner::Struct { span, .. } = ty.inner else {
        panic!()
    };
    assert_eq!(span as usize, std::mem::size_of::<Case>());
}

#[test]
fn reflection_is_reciprocal() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(3);
    let mut materials: Vec<Case> = [0.1, 0.25, 0.5, 0.75, 1.0]
        .iter()
        .flat_map(|&roughness| {
            [
                Case::dielectric(roughness),
                Case::metal(roughness),
                Case::gold(roughness),
            ]
        })
        .collect();
    materials.extend([1.0, 20.0, 400.0].map(Case::phong));
    materials.extend([0.0, 3.0, 80.0, 1600.0].map(Case::blinn));
    let mut pairs = Vec::new();
    for material in materials {
        let material = material.seen_at(0.0);
        let n = Vec3::from(material.normal);
        let mut upper = || {
            let d = random.direction();
            if d.dot(n) > 0.0 { d } else { -d }
        };
        for _ in 0..4 {
            let a = upper();
            for index in 0..32 {
                // Directions anywhere, and directions near the mirror direction, where narrow lobes are.
                let mirror = 2.0 * a.dot(n) * n - a;
                let b = if index < 16 {
                    upper()
                } else {
                    (mirror + upper() * 0.1).normalize()
                };
                if b.dot(n) > 0.0 {
                    pairs.push((material, [a, b]));
                }
            }
        }
    }
    let value = |eye: usize| {
        let seen = |(case, pair): &(Case, [Vec3; 2])| Case {
            wo: pair[eye].to_array(),
            ..*case
        };
        let cases: Vec<Case> = pairs.iter().map(seen).collect();
        let lights: Vec<DVec3> = pairs
            .iter()
            .map(|pair| pair.1[1 - eye].as_dvec3())
            .collect();
        evaluate(&gpu, &cases, &lights)
    };
    let mut seen = 0;
    for (((material, _), forward), backward) in pairs.iter().zip(value(0)).zip(value(1)) {
        for lobe in 0..2 {
            for (f, g) in forward[lobe][..3].iter().zip(&backward[lobe][..3]) {
                seen += u32::from(*f > 0.0);
                assert!(
                    (f - g).abs() <= 2e-3 * f.abs().max(g.abs()) + 1e-6,
                    "lobe {lobe}: {f} and {g}: {material:?}"
                );
            }
        }
    }
    assert!(seen > 3000, "only {seen} values are more than zero");
}

fn furnace_cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for degrees in [5.0, 45.0, 75.0] {
        for roughness in [0.05, 0.1, 0.4, 1.0] {
            let materials = [
                Case::dielectric(roughness),
                Case::metal(roughness),
                Case::gold(roughness),
                Case::glass(roughness, 1.5),
                Case::glass(roughness, 1.0 / 1.5),
                Case::pane(roughness),
            ];
            cases.extend(materials.map(|case| case.seen_at(degrees)));
        }
        cases.extend([2.0, 60.0].map(|shininess| Case::phong(shininess).seen_at(degrees)));
        cases.extend([0.0, 2.0, 240.0].map(|shininess| Case::blinn(shininess).seen_at(degrees)));
    }
    for case in &mut cases {
        case.samples = 1 << 14;
    }
    cases
}

/// White furnace: in a uniform white environment a surface scatters its albedo, never more than all the light, and the
/// estimator value x cosine / density finds exactly that.
#[test]
fn albedos_are_those_of_quadrature() {
    let Some(gpu) = test_gpu() else { return };
    let cases = furnace_cases();
    let found = sampled_albedos(&gpu, &shader(), &cases);
    for (case, [reflected, passed]) in cases.iter().zip(found) {
        for (channel, value) in reflected.to_array().into_iter().enumerate() {
            let expected = case.diffuse_albedo(channel) + case.glossy_albedo(channel);
            assert!(
                (f64::from(value) - expected).abs() <= 0.01 * expected + 1e-3,
                "channel {channel}: sampled {value}, quadrature {expected}: {case:?}"
            );
        }
        let expected = match case.transmission > 0.0 {
            true => case.transmitted_albedo(),
            false => 0.0,
        };
        assert!(
            (f64::from(passed.x) - expected).abs() <= 0.01 * expected + 1e-3,
            "passed {passed}, quadrature {expected}: {case:?}"
        );
        // Little light is lost if few facets occlude each other.
        let whole = reflected.x + passed.x;
        if case.transmission > 0.0 && case.roughness < 0.2 {
            assert!((whole - 1.0).abs() < 0.01, "{whole} of the light: {case:?}");
        }
    }
}

#[test]
fn formulas_of_albedos_are_near_quadrature() {
    let Some(gpu) = test_gpu() else { return };
    let mut cases = Vec::new();
    for degrees in [0.0, 30.0, 60.0, 75.0, 85.0, 89.0] {
        let phong = [2.0, 20.0, 300.0].map(|shininess| (Case::phong(shininess), 0.035));
        let blinn = [0.0, 1.0, 5.0, 20.0, 300.0, 2000.0];
        let blinn = blinn.map(|shininess| (Case::blinn(shininess), 0.04));
        let of_angle = phong.into_iter().chain(blinn);
        cases.extend(of_angle.map(|(case, bound)| (case.seen_at(degrees), bound)));
    }
    let only: Vec<Case> = cases.iter().map(|(case, _)| *case).collect();
    let size = [cases.len(); 2];
    let found = run(&gpu, &shader(), "approximate", &only, &[DVec3::Z], size);
    for ((case, bound), found) in cases.iter().zip(found) {
        let expected = case.glossy_albedo(1);
        let error = (f64::from(found[1]) / expected - 1.0).abs();
        assert!(error < *bound, "{}, not {expected}: {case:?}", found[1]);
    }
}

/// White surfaces of every kind, from all sides: none scatters more light than it receives.
#[test]
fn energy_is_never_above_one() {
    let Some(gpu) = test_gpu() else { return };
    let mut cases = Vec::new();
    for degrees in [0.0, 30.0, 50.0, 65.0, 75.0, 80.0, 85.0, 89.0] {
        for roughness in [0.02, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0] {
            for (f0, f90) in [
                (0.0, 0.0),
                (0.0, 1.0),
                (0.02, 0.5),
                (0.04, 1.0),
                (0.3, 1.0),
                (1.0, 1.0),
            ] {
                cases.push(Case {
                    f0: [f0; 3],
                    f90,
                    ..Case::dielectric(roughness)
                });
            }
            cases.push(Case::translucent(roughness));
            // Exponents 0 to 100.
            let blinn = Case::blinn(100.0 * (roughness - 0.02) * (roughness - 0.02));
            cases.push(Case {
                diffuse: [0.0; 3],
                f0: [1.0; 3],
                ..blinn
            });
            for eta in [1.5, 1.0 / 1.5, 1.0, 2.4] {
                for transmission in [0.3, 1.0] {
                    let glass = Case {
                        transmission,
                        diffuse: [1.0 - transmission; 3],
                        ..Case::glass(roughness, eta)
                    };
                    let half_specular = Case {
                        f0: [0.02; 3],
                        f90: 0.5,
                        ..glass
                    };
                    let pane = Case { thin: 1, ..glass };
                    cases.extend([glass, half_specular, pane]);
                }
            }
        }
        cases
            .iter_mut()
            .filter(|case| case.samples == 0)
            .for_each(|case| {
                *case = Case {
                    samples: 4096,
                    ..case.seen_at(degrees)
                };
            });
    }
    for (case, [reflected, passed]) in cases.iter().zip(sampled_albedos(&gpu, &shader(), &cases)) {
        let whole = reflected.x + passed.x;
        let bound = if case.f90 == 0.0 {
            1.0 + 1e-5
        } else {
            1.01 + 0.01
        };
        assert!(whole < bound, "{whole} of the light: {case:?}");
        if case.f90 == 0.0 {
            assert!(whole > 1.0 - 1e-5, "Lambert's surface is white: {whole}");
        }
    }
}

/// f(wo, wi) / n_o^2 is the same in both directions, from above the surface and from below.
#[test]
fn refraction_is_reciprocal_but_for_the_square_of_the_index() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(5);
    for (roughness, thin) in [(0.2, 0), (0.7, 0), (0.5, 1)] {
        let above = Case {
            thin,
            ..Case::glass(roughness, 1.5).seen_at(35.0)
        };
        let opposite = -above.wo();
        let n_dot_v = above.normal().dot(above.wo());
        let refracted = (opposite + n_dot_v * above.normal()) / 1.5 - 0.92 * above.normal();
        let axis = if thin == 1 { opposite } else { refracted };
        let mut near = || axis + random.direction().as_dvec3() * f64::from(roughness) * 0.5;
        let lights: Vec<DVec3> = (0..16).map(|_| near().normalize()).collect();
        let from_below = lights.iter().map(|wi| Case {
            eta: if thin == 1 { 1.5 } else { 1.0 / 1.5 },
            normal: (-above.normal()).as_vec3().to_array(),
            wo: wi.as_vec3().to_array(),
            ..above
        });
        let forward = evaluate(&gpu, &[above], &lights);
        let backward = evaluate(&gpu, &from_below.collect::<Vec<_>>(), &[above.wo(); 16]);
        let scale = if thin == 1 { 1.0 } else { 1.5 * 1.5 };
        let mut seen = 0;
        for (forward, backward) in forward.iter().zip(&backward) {
            let (forward, backward) = (forward[2][0], backward[2][0]);
            assert!(
                (forward * scale - backward).abs() <= 2e-3 * backward + 1e-6,
                "{forward} and {backward}: {above:?}"
            );
            seen += u32::from(forward > 0.0);
        }
        assert!(seen > 8, "{above:?} lets nothing pass");
    }
}

#[test]
fn smooth_glass_bends_light_by_snell_and_reflects_it_whole_beyond_the_critical_angle() {
    let Some(gpu) = test_gpu() else { return };
    let mut cases = Vec::new();
    for degrees in [0.0, 20.0, 40.0, 43.0, 70.0] {
        for case in [
            Case::glass(0.0, 1.5),
            Case::glass(0.0, 1.0 / 1.5),
            Case::pane(0.0),
        ] {
            cases.push(case.seen_at(degrees));
        }
    }
    let count = cases.len();
    let rows = run(
        &gpu,
        &shader(),
        "choose",
        &cases,
        &[DVec3::Z],
        [count * 2, count],
    );
    for (case, rows) in cases.iter().zip(rows.as_chunks::<2>().0) {
        let [weights, passed] = rows.map(|row| row.map(f64::from));
        let (n, wo, eta) = (case.normal(), case.wo(), f64::from(case.eta));
        let wi = DVec3::new(passed[0], passed[1], passed[2]);
        let cosine = n.dot(wo);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let reflectance = dielectric(eta, cosine);
        if case.thin == 1 {
            assert!((wi + wo).length() < 1e-6, "a thin wall does not bend: {wi}");
            assert!((passed[3] - (1.0 - reflectance)).abs() < 1e-5);
        } else if sine > eta {
            assert_eq!(wi, DVec3::ZERO, "{case:?}");
            assert_eq!(reflectance, 1.0);
        } else {
            let tangential = wi - n.dot(wi) * n;
            let expected = -(wo - cosine * n) / eta;
            assert!((tangential - expected).length() < 1e-5, "{case:?}");
            assert!((wi.length() - 1.0).abs() < 1e-5 && n.dot(wi) < 0.0);
            let radiance = (1.0 - reflectance) / (eta * eta);
            assert!(
                (passed[3] - radiance).abs() < 1e-4 * radiance.max(1.0),
                "{case:?}"
            );
        }
        // Glass has two lobes, chosen with probabilities equal to their shares of the light.
        assert!(
            (weights[1] - reflectance).abs() < 1e-4,
            "{weights:?}: {case:?}"
        );
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-5 && weights[0] == 0.0);
    }
}

#[test]
fn no_lobe_that_sends_on_light_is_left_unchosen() {
    let Some(gpu) = test_gpu() else { return };
    let mut cases = vec![
        Case::phong(3.0).seen_at(20.0),
        Case::gold(0.1).seen_at(20.0),
    ];
    for degrees in [0.0, 60.0, 89.0] {
        for roughness in [0.02, 1.0] {
            let dark = Case {
                f0: [0.0; 3],
                ..Case::dielectric(roughness)
            };
            let blue = Case {
                diffuse: [0.0, 0.0, 0.01],
                transmission: 0.5,
                tint: [0.0, 0.0, 1.0],
                ..Case::glass(roughness, 1.0 / 1.5)
            };
            let unseen = Case {
                f0: [0.0; 3],
                f90: 0.0,
                ..Case::glass(roughness, 1.0 / 1.2)
            };
            cases.extend([dark, blue, unseen].map(|case| case.seen_at(degrees)));
        }
    }
    let black = Case {
        diffuse: [0.0; 3],
        f0: [0.0; 3],
        f90: 0.0,
        ..Case::dielectric(0.5)
    };
    cases.push(black);
    let count = cases.len();
    let rows = run(
        &gpu,
        &shader(),
        "choose",
        &cases,
        &[DVec3::Z],
        [count * 2, count],
    );
    for (case, rows) in cases.iter().zip(rows.as_chunks::<2>().0) {
        let weights = rows[0];
        assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
        let sum: f32 = weights.iter().sum();
        let drawn = Case {
            samples: 256,
            ..*case
        };
        let samples = run(
            &gpu,
            &shader(),
            "draw",
            &[drawn],
            &[DVec3::Z],
            [256 * 3, 256],
        );
        for (lobe, weight) in weights[..3].iter().enumerate() {
            let largest = samples.iter().skip(lobe).step_by(3).map(|row| row[3]);
            let largest = largest.fold(0.0, f32::max);
            assert!(
                largest <= 0.0 || *weight > 0.0,
                "lobe {lobe} of weight {largest} is never chosen: {case:?}"
            );
        }
        let whole = if *case == black { 0.0 } else { 1.0 };
        assert!((sum - whole).abs() < 1e-5, "{weights:?}: {case:?}");
    }
}

#[test]
fn metals_have_exact_fresnel_reflectance() {
    let Some(gpu) = test_gpu() else { return };
    let cosines: Vec<f64> = (0..=64).map(|step| f64::from(step) / 64.0).collect();
    let directions: Vec<DVec3> = cosines.iter().map(|&cosine| DVec3::X * cosine).collect();
    let count = cosines.len();
    let found = run(
        &gpu,
        &shader(),
        "facet",
        &[Case::gold(0.3)],
        &directions,
        [count, count],
    );
    let (n, k) = GOLD;
    for channel in 0..3 {
        for (cosine, found) in cosines.iter().zip(&found) {
            let expected = conductor(n[channel].into(), k[channel].into(), *cosine);
            let value = f64::from(found[channel]);
            assert!(
                (value - expected).abs() < 1e-4,
                "at cosine {cosine}: {value}, not {expected}"
            );
        }
        // Normal incidence: ((n-1)^2 + k^2) / ((n+1)^2 + k^2).
        let (n, k) = (n[channel], k[channel]);
        let normal = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
        assert!((found[count - 1][channel] - normal).abs() < 1e-5);
    }
}

#[test]
fn glass_has_exact_fresnel_reflectance() {
    let Some(gpu) = test_gpu() else { return };
    let cosines: Vec<f64> = (1..=64).map(|step| f64::from(step) / 64.0).collect();
    let directions: Vec<DVec3> = cosines.iter().map(|&cosine| DVec3::X * cosine).collect();
    let count = cosines.len();
    for eta in [1.5, 1.0 / 1.5, 1.01, 2.4] {
        let case = Case::glass(0.3, eta);
        let found = run(
            &gpu,
            &shader(),
            "facet",
            &[case],
            &directions,
            [count, count],
        );
        for (cosine, found) in cosines.iter().zip(&found) {
            let expected = dielectric(eta.into(), *cosine);
            assert!(
                (f64::from(found[0]) - expected).abs() < 1e-5,
                "index {eta}, cosine {cosine}: {}, not {expected}",
                found[0]
            );
        }
    }
    // Half the specular weight halves the reflectance at all angles, except for total internal reflection.
    let half = Case {
        f0: [0.02; 3],
        f90: 0.5,
        ..Case::glass(0.3, 1.0 / 1.5)
    };
    let found = run(
        &gpu,
        &shader(),
        "facet",
        &[half],
        &directions,
        [count, count],
    );
    for (cosine, found) in cosines.iter().zip(&found) {
        let whole = dielectric(1.0 / 1.5, *cosine);
        let expected = if whole == 1.0 { 1.0 } else { whole / 2.0 };
        assert!((f64::from(found[0]) - expected).abs() < 1e-5, "{cosine}");
    }
}

#[test]
fn delta_materials_evaluate_to_zero() {
    let Some(gpu) = test_gpu() else { return };
    for (case, is_delta) in [
        (Case::metal(0.009), true),
        (Case::gold(0.0), true),
        (Case::dielectric(0.0), true),
        (Case::metal(0.011), false),
    ] {
        let case = case.seen_at(30.0);
        let [_, glossy, _] = evaluate(&gpu, &[case], &[case.glossy_lobe().0])[0];
        assert_eq!(
            glossy[0] == 0.0,
            is_delta,
            "roughness {}: {glossy:?}",
            case.roughness
        );
    }
}

#[test]
fn nothing_reflects_below_the_surface() {
    let Some(gpu) = test_gpu() else { return };
    for case in [
        Case::dielectric(0.5),
        Case::gold(0.5),
        Case::phong(3.0),
        Case::blinn(3.0),
    ] {
        let case = case.seen_at(80.0);
        let below: Vec<DVec3> = [-1.0, -0.3, -1e-3]
            .iter()
            .map(|&height| {
                (case.glossy_lobe().0
                    + (height - case.glossy_lobe().0.dot(case.normal())) * case.normal())
                .normalize()
            })
            .collect();
        for [diffuse, glossy, _] in evaluate(&gpu, &[case], &below) {
            assert_eq!(
                (&diffuse[..3], &glossy[..3]),
                (&[0.0; 3][..], &[0.0; 3][..]),
                "{case:?}"
            );
        }
    }
}

/// The switch in brdf.wesl restores the energy that a rough white metal loses by single scattering.
#[test]
fn energy_compensation_makes_white_metals_white() {
    let Some(gpu) = test_gpu() else { return };
    let plain = shader();
    let at = plain
        .source
        .find("ENERGY_COMPENSATION: bool = false")
        .expect("the switch");
    let switched = plain.source[at..].replacen("= false", "= true", 1);
    let compensated = Shader {
        name: "testing.brdf with energy compensation",
        source: format!("{}{switched}", &plain.source[..at]).into(),
    };
    let mut cases: Vec<Case> = [0.3, 0.5, 0.7, 0.85, 1.0]
        .iter()
        .flat_map(|&roughness| {
            [10.0, 50.0, 70.0].map(|degrees| Case::metal(roughness).seen_at(degrees))
        })
        .collect();
    for case in &mut cases {
        case.f0 = [1.0; 3];
        case.samples = 1 << 13;
    }
    let before = sampled_albedos(&gpu, &plain, &cases);
    let after = sampled_albedos(&gpu, &compensated, &cases);
    for ((case, before), after) in cases.iter().zip(before).zip(after) {
        let (before, after) = (before[0].x, after[0].x);
        assert!(
            (after - 1.0).abs() < 0.05,
            "albedo {after} instead of {before}: {case:?}"
        );
    }
    // The loss to compensate: seen from straight above, alpha 1 reflects 1 - ln 2.
    let case = Case {
        samples: 1 << 13,
        ..Case::metal(1.0)
    };
    let dark = sampled_albedos(&gpu, &plain, &[case])[0][0].x;
    assert!(
        (dark - (1.0 - std::f32::consts::LN_2)).abs() < 0.01,
        "{dark}"
    );
}
