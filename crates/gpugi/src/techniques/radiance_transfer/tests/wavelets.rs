//! Wavelets: the functions, and what differs from harmonics.

use super::*;
use crate::shader;
use crate::techniques::radiance_transfer::gpu::CUBE_SIDE;
use crate::testing::{Random, run_kernel};

/// Settings of a small atlas in wavelets.
const HAAR: [(&str, &str); 2] = [("basis", "haar"), ("resolution", "16")];

/// The coefficients of faces, each of 64 x 64 texels.
fn transformed(gpu: &Gpu, faces: &[f32]) -> Vec<f32> {
    let texels = gpu.storage("texels", faces).unwrap();
    let shader = shader!("testing.wavelets");
    // 256 lanes for 4,096 texels.
    let invocations = faces.len() as u32 / 16;
    run_kernel(
        gpu,
        &shader,
        "main",
        &[("texels", &texels)],
        faces.len(),
        invocations,
    )
    .unwrap()
}

/// The transform keeps all dot products, so the wavelets are orthonormal, and as many as texels.
#[test]
fn wavelets_are_orthonormal() {
    const FACE: usize = (CUBE_SIDE * CUBE_SIDE) as usize;
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(7);
    let mut faces: Vec<f32> = (0..12 * FACE).map(|_| random.direction().x).collect();
    // Single texels meet one wavelet per level and orientation.
    for (face, texel) in [(0, 0), (1, 1), (2, 64), (3, 63 * 64 + 63), (4, 40 * 64 + 3)] {
        faces[face * FACE..][..FACE].fill(0.0);
        faces[face * FACE + texel] = 1.0;
    }
    faces[5 * FACE..6 * FACE].fill(1.0);
    let found = transformed(&gpu, &faces);
    let dot = |of: &[f32], i: usize, j: usize| -> f64 {
        let [one, other] = [i, j].map(|k| &of[k * FACE..][..FACE]);
        let pairs = one.iter().zip(other);
        pairs.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    };
    for i in 0..12 {
        for j in 0..=i {
            let (before, after) = (dot(&faces, i, j), dot(&found, i, j));
            let scale = (dot(&faces, i, i) * dot(&faces, j, j)).sqrt();
            assert!(
                (after - before).abs() < 1e-5 * scale,
                "{i} {j}: {before} {after}"
            );
        }
    }
    for face in 0..5 {
        let mut values: Vec<f32> = found[face * FACE..][..FACE]
            .iter()
            .map(|v| v.abs())
            .collect();
        values.sort_by(|a, b| b.total_cmp(a));
        // Three per level, from 1/2 on, and the mean.
        let expected = (1..=6).flat_map(|level| [0.5_f32.powi(level); 3]);
        let expected: Vec<f32> = expected.chain([0.5_f32.powi(6)]).collect();
        assert_eq!(values[..19], expected, "{face}");
        assert_eq!(values[19], 0.0);
    }
    assert_eq!(found[5 * FACE], 64.0);
    assert!(found[5 * FACE + 1..6 * FACE].iter().all(|&v| v == 0.0));
}

/// With nearly all terms, light is exact to the texels of the cube; with few, to some percent.
#[test]
fn smooth_light_and_a_sun_are_exact_on_a_plane() {
    let Some(gpu) = test_gpu() else { return };
    let linear = |direction: Vec3| Vec3::splat(1.0 + 0.8 * direction.dot(A));
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let scene = scene_of([plane.clone()], Some(sky(256, 0, linear)));
    let expected = PI * (1.0 + 0.8 * 2.0 / 3.0 * A.y);
    for (terms, most) in [("4096", 0.004), ("100", 0.03), ("30", 0.1)] {
        let settings = [&HAAR[..], &[("coefficients", terms)]].concat();
        let solver = Solver::new(&gpu, &scene, &settings).solve();
        let error = worst(&solver.texels(), PI, |_| Vec3::splat(expected));
        println!("{terms} terms: {error}");
        assert!(error < most, "{terms} terms: {error}");
    }
    let mut scene = scene_of([plane], None);
    let sun = Light::new("sun", LightKind::Directional, vec3(2.0, 1.0, 0.5));
    let toward = vec3(0.3, 0.8, -0.5);
    scene.lights.push(sun.aimed(toward, Vec3::ZERO));
    let settings = [("coefficients", "4096"), ("directional-lights", "true")];
    let solver = Solver::new(&gpu, &scene, &[&HAAR[..], &settings].concat()).solve();
    let cosine = toward.normalize().y;
    let error = worst(&solver.texels(), 2.0, |_| vec3(2.0, 1.0, 0.5) * cosine);
    println!("sun: {error}");
    // A texel of the cube is 1.4 degrees wide.
    assert!(error < 0.02, "{error}");
}

/// A turned environment is projected anew, as its turned image would be.
#[test]
fn turned_environments_are_projected_anew() {
    let Some(gpu) = test_gpu() else { return };
    let colors = |direction: Vec3| vec3(1.0 + direction.x, 1.0, (6.0 * direction.z).exp() / 50.0);
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let mut scene = scene_of([plane], Some(sky(128, 0, colors)));
    let mut solver = Solver::new(&gpu, &scene, &HAAR).solve();
    let straight = solver.light();
    // u grows as the angle about +Y falls.
    let rotation = -std::f32::consts::TAU * 21.0 / 128.0;
    let turned = Environment {
        rotation: glam::Quat::from_rotation_y(rotation),
        ..sky(128, 0, colors)
    };
    solver
        .scene
        .edit(&gpu, &[Edit::Environment(turned)])
        .unwrap();
    solver.frame();
    let found = solver.light();
    scene.environment = Some(sky(128, 21, colors));
    let expected = Solver::new(&gpu, &scene, &HAAR).solve().light();
    let off = |light: &[Vec3], other: &[Vec3]| {
        let pairs = light.iter().zip(other);
        pairs.fold(0.0, |most, (a, b)| {
            f32::max(most, (*a - *b).abs().max_element())
        })
    };
    let (error, change) = (off(&found, &expected), off(&found, &straight));
    println!("{error}; turning changes {change}");
    assert!(error < 1e-3 && change > 0.05, "{error} {change}");
}

/// A floor and a wall, which reflect light onto each other.
fn two_walls(environment: Environment) -> Scene {
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let wall = quad(vec3(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Y * 2.0, 1);
    scene_of([floor, wall], Some(environment))
}

/// A smooth sky, a corner and three bounces: both bases find the same light.
#[test]
fn wavelets_reflect_what_harmonics_reflect() {
    let Some(gpu) = test_gpu() else { return };
    let smooth = |d: Vec3| vec3(1.0, 1.0 + 0.7 * d.x, 0.6 - 0.5 * d.y);
    let scene = two_walls(sky(64, 0, smooth));
    let light = |of: &[(&str, &str)]| {
        let settings = [("resolution", "16"), ("bounces", "3"), ("rays", "256")];
        let solver = Solver::new(&gpu, &scene, &[&settings[..], of].concat()).solve();
        solver.texels()
    };
    let harmonics = light(&[("rays", "4096")]);
    let wavelets = light(&[("basis", "haar"), ("coefficients", "300")]);
    let direct = light(&[("rays", "4096"), ("bounces", "1")]);
    let sum = |of: &[(Point, Vec3)]| of.iter().map(|(_, found)| *found).sum::<Vec3>();
    let ratio = sum(&wavelets) / sum(&harmonics);
    let squares = |of: fn(Vec3, Vec3) -> f32| {
        let pairs = wavelets.iter().zip(&harmonics);
        pairs.map(|(a, b)| of(a.1, b.1)).sum::<f32>()
    };
    let error =
        (squares(|a, b| (a - b).length_squared()) / squares(|_, b| b.length_squared())).sqrt();
    let share = sum(&direct) / sum(&harmonics);
    println!("{ratio} of the light, RMSE {error}; {share} is direct");
    assert!((ratio - Vec3::ONE).abs().max_element() < 0.01, "{ratio}");
    assert!(error < 0.03, "{error}");
    assert!(share.max_element() < 0.9, "{share}");
}

/// The same bits, however the texels are cut and whenever the work stopped; other terms are refused.
#[test]
fn terms_are_the_same_bits_however_they_are_made() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("bounces", "2"), ("rays", "64"), ("coefficients", "20")];
    let settings = [&HAAR[..], &settings].concat();
    let scene = two_walls(Environment::default_sky());
    let whole = Solver::new(&gpu, &scene, &settings).solve();
    let mut cut = Solver::new(&gpu, &scene, &settings);
    cut.transfer.cut.most_texels = Some(16 * 5);
    assert!(whole.vectors() == cut.solve().vectors());
    // Each texel that has a point keeps 20 terms, among them the means of all faces, in the order of their numbers.
    let mut points = 0;
    for texel in whole.vectors().chunks(2 * 20) {
        let numbers: Vec<u32> = texel.chunks(2).map(|term| term[1] >> 16).collect();
        if numbers.iter().all(|&number| number == 0) {
            continue;
        }
        points += 1;
        assert!(numbers.windows(2).all(|two| two[0] < two[1]), "{numbers:?}");
        assert!((0..6).all(|face| numbers.contains(&(face * 4096 + 1))));
    }
    assert!(points > 20, "{points}");
    let step_by_step = [&settings[..], &[("steps", "1")]].concat();
    let mut first = Solver::new(&gpu, &scene, &step_by_step).with_atlas();
    let mut rest = Solver::new(&gpu, &scene, &step_by_step).with_atlas();
    while first.frame().progress < 0.6 {}
    let saved = first.transfer.save(&gpu).unwrap().unwrap();
    assert_eq!(rest.transfer.resume(&gpu, &saved), Ok(true));
    assert!(rest.solve().vectors() == whole.vectors());
    let others = [&step_by_step[..], &[("coefficients", "21")]].concat();
    let mut other = Solver::new(&gpu, &scene, &others).with_atlas();
    assert!(other.transfer.resume(&gpu, &saved).is_err());
}
