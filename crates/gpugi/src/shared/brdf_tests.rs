//! Values of the reflection models: reciprocity, albedos against quadrature, Fresnel, delta materials.

use glam::{DVec3, Vec3};

use super::cpu::{Case, GOLD, conductor};
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

/// Diffuse and glossy value and density of `case` at `directions`.
pub fn evaluate(gpu: &Gpu, case: &Case, directions: &[DVec3]) -> Vec<[[f32; 4]; 2]> {
    let count = directions.len();
    let rows = run(
        gpu,
        &shader(),
        "evaluate",
        &[*case],
        directions,
        [count * 2, count],
    );
    rows.as_chunks::<2>().0.to_vec()
}

/// Albedo of each case by importance sampling, all channels.
fn sampled_albedos(gpu: &Gpu, shader: &Shader, cases: &[Case]) -> Vec<[f32; 4]> {
    run(
        gpu,
        shader,
        "albedo",
        cases,
        &[DVec3::Z],
        [cases.len(), cases.len()],
    )
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
    for material in materials {
        let material = material.seen_at(0.0);
        let n = Vec3::from(material.normal);
        let mut upper = || {
            let d = random.direction();
            if d.dot(n) > 0.0 { d } else { -d }
        };
        let mut seen = 0.0_f32;
        for _ in 0..4 {
            let a = upper();
            // Directions near the mirror direction, where narrow lobes are, and anywhere.
            let mirror = 2.0 * a.dot(n) * n - a;
            let others: Vec<Vec3> = (0..32)
                .map(|index| {
                    if index < 16 {
                        upper()
                    } else {
                        (mirror + upper() * 0.1).normalize()
                    }
                })
                .filter(|d| d.dot(n) > 0.0)
                .collect();
            let forward = Case {
                wo: a.to_array(),
                ..material
            };
            let directions: Vec<DVec3> = others.iter().map(|d| d.as_dvec3()).collect();
            let forward = evaluate(&gpu, &forward, &directions);
            // Backward in one dispatch: a case per direction would need as many; four suffice.
            for at in [0, 5, others.len() - 2, others.len() - 1] {
                let backward = Case {
                    wo: others[at].to_array(),
                    ..material
                };
                let backward = evaluate(&gpu, &backward, &[a.as_dvec3()])[0];
                for lobe in 0..2 {
                    for channel in 0..3 {
                        let (f, g) = (forward[at][lobe][channel], backward[lobe][channel]);
                        seen = seen.max(f);
                        assert!(
                            (f - g).abs() <= 2e-3 * f.abs().max(g.abs()) + 1e-6,
                            "{material:?}: {f} and {g}"
                        );
                    }
                }
            }
        }
        assert!(seen > 0.0, "{material:?} reflects nothing");
    }
}

fn furnace_cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for degrees in [5.0, 45.0, 75.0] {
        for roughness in [0.1, 0.4, 1.0] {
            let materials = [
                Case::dielectric(roughness),
                Case::metal(roughness),
                Case::gold(roughness),
            ];
            cases.extend(materials.map(|case| case.seen_at(degrees)));
        }
        cases.extend([2.0, 60.0].map(|shininess| Case::phong(shininess).seen_at(degrees)));
    }
    for case in &mut cases {
        case.samples = 1 << 15;
    }
    cases
}

/// White furnace: a surface in a uniform white environment reflects its albedo, never more than all, and the estimator
/// value x cosine / density finds just that. (The dielectric of glTF's appendix B does exceed one at grazing angles: its
/// diffuse lobe loses F(v.h), whose mean over all lights is less than what the glossy lobe reflects there.)
#[test]
fn albedos_are_those_of_quadrature_and_never_above_one() {
    let Some(gpu) = test_gpu() else { return };
    let cases = furnace_cases();
    let found = sampled_albedos(&gpu, &shader(), &cases);
    for (case, found) in cases.iter().zip(found) {
        for (channel, value) in found[..3].iter().enumerate() {
            let expected = case.diffuse_albedo(channel) + case.glossy_albedo(channel);
            let value = f64::from(*value);
            let grazing_dielectric = case.is_dielectric() && case.normal().dot(case.wo()) < 0.5;
            let bound = if grazing_dielectric { 1.25 } else { 1.01 };
            assert!(value < bound, "albedo {value} above {bound}: {case:?}");
            assert!(
                (value - expected).abs() <= 0.01 * expected,
                "channel {channel}: sampled {value}, quadrature {expected}: {case:?}"
            );
        }
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
fn delta_materials_evaluate_to_zero() {
    let Some(gpu) = test_gpu() else { return };
    for (case, is_delta) in [
        (Case::metal(0.009), true),
        (Case::gold(0.0), true),
        (Case::dielectric(0.0), true),
        (Case::metal(0.011), false),
    ] {
        let case = case.seen_at(30.0);
        let [_, glossy] = evaluate(&gpu, &case, &[case.glossy_lobe().0])[0];
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
    for case in [Case::dielectric(0.5), Case::gold(0.5), Case::phong(3.0)] {
        let case = case.seen_at(80.0);
        let below: Vec<DVec3> = [-1.0, -0.3, -1e-3]
            .iter()
            .map(|&height| {
                (case.glossy_lobe().0
                    + (height - case.glossy_lobe().0.dot(case.normal())) * case.normal())
                .normalize()
            })
            .collect();
        for [diffuse, glossy] in evaluate(&gpu, &case, &below) {
            assert_eq!(
                (&diffuse[..3], &glossy[..3]),
                (&[0.0; 3][..], &[0.0; 3][..]),
                "{case:?}"
            );
        }
    }
}

/// The switch in brdf.wesl gives a rough white metal back what single scattering loses.
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
        source: Box::leak(format!("{}{switched}", &plain.source[..at]).into_boxed_str()),
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
        assert!(
            (after[0] - 1.0).abs() < 0.05,
            "albedo {} instead of {}: {case:?}",
            after[0],
            before[0]
        );
    }
    // What there is to compensate: seen from straight above, alpha 1 reflects 1 - ln 2.
    let case = Case {
        samples: 1 << 13,
        ..Case::metal(1.0)
    };
    let dark = sampled_albedos(&gpu, &plain, &[case])[0][0];
    assert!(
        (dark - (1.0 - std::f32::consts::LN_2)).abs() < 0.01,
        "{dark}"
    );
}
