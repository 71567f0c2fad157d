//! Tests of the export for other programs: texels equal the GPU's in KTX2's axes, and numbers mean what the description
//! says.

use glam::DVec3;
use gpugi_scene::image::HalfTexture;
use half::f16;

use super::Settings;
use super::export::{Baked, bake};
use super::tests::{Exact, Level, generated, harmonic, sunny};
use crate::gpu::{Gpu, read_buffer};
use crate::testing::{on_face, test_gpu};

fn settings() -> Settings {
    Settings {
        resolution: 32,
        samples: 16,
        ..Settings::default()
    }
}

fn baked(gpu: &Gpu) -> Baked {
    bake(gpu, &sunny(20, 5).image, &settings()).unwrap()
}

/// Directions and values of a level's texels, by the Vulkan specification's table of cube faces.
fn texels(cube: &HalfTexture, level: usize) -> impl Iterator<Item = (DVec3, [f16; 4])> + '_ {
    let side = cube.size[0] as usize >> level;
    cube.levels[level]
        .iter()
        .enumerate()
        .map(move |(i, &value)| {
            let place = |at: usize| (2.0 * at as f64 + 1.0) / side as f64 - 1.0;
            let direction = on_face(i / (side * side), place(i % side), place(i / side % side));
            (direction.normalize(), value)
        })
}

#[test]
fn exported_cubes_hold_what_the_gpu_holds_with_z_turned() {
    let Some(gpu) = test_gpu() else { return };
    let baked = baked(&gpu);
    let technique = generated(
        &gpu,
        &sunny(20, 5),
        &[("resolution", "32"), ("samples", "16")],
    );
    for (name, cube, levels) in [
        ("radiance", &baked.radiance, 6),
        ("irradiance", &baked.irradiance, 1),
        ("ggx", &baked.ggx, 3),
        ("phong", &baked.phong, 3),
    ] {
        assert_eq!((cube.faces, cube.levels.len()), (6, levels), "{name}");
        for level in 0..levels {
            let held = Level::read(&gpu, &technique, name, level as u32);
            assert_eq!(cube.levels[level].len(), held.texels.len());
            let held: Vec<_> = held.of_cube().collect();
            for (direction, value) in texels(cube, level).step_by(11) {
                let toward = direction * DVec3::new(1.0, 1.0, -1.0);
                let (_, _, expected) = held
                    .iter()
                    .find(|(held, _, _)| held.distance(toward) < 1e-6)
                    .expect("a texel in that direction");
                let [red, green, blue, alpha] = value.map(f64::from);
                assert_eq!(DVec3::new(red, green, blue), *expected, "{name}, {level}");
                assert_eq!(alpha, 1.0);
            }
        }
    }
    let table = Level::read(&gpu, &technique, "albedo", 0);
    assert_eq!((baked.albedo.size, baked.albedo.faces), ([64, 64], 1));
    for (found, expected) in baked.albedo.levels[0].iter().zip(&table.texels) {
        assert_eq!(found.map(f64::from)[..3], expected.to_array());
    }
}

#[test]
fn the_exported_sun_stands_where_the_image_has_it() {
    let Some(gpu) = test_gpu() else { return };
    let baked = baked(&gpu);
    let brightest = |cube: &HalfTexture| {
        let brighter = |a: &(DVec3, [f16; 4]), b: &(DVec3, [f16; 4])| a.1[0].total_cmp(&b.1[0]);
        texels(cube, 0).max_by(brighter).unwrap().0
    };
    // Centre of texel (20, 5) of 32 x 16, in KTX2's axes: right of the image's centre, which lies ahead, and above the
    // horizon.
    let (phi, theta) = ((20.5_f64 / 32.0 - 0.5) * 360.0, 5.5_f64 / 16.0 * 180.0);
    let (phi, theta) = (phi.to_radians(), theta.to_radians());
    let sun = DVec3::new(
        phi.sin() * theta.sin(),
        theta.cos(),
        phi.cos() * theta.sin(),
    );
    assert!(sun.min_element() > 0.3);
    for (cube, near) in [
        (&baked.radiance, 0.1),
        (&baked.ggx, 0.1),
        (&baked.irradiance, 0.15),
    ] {
        let found = brightest(cube);
        assert!(found.distance(sun) < near, "{found}, not {sun}");
    }
}

#[test]
fn exported_harmonics_are_the_sum_over_the_image() {
    let Some(gpu) = test_gpu() else { return };
    let (baked, exact) = (baked(&gpu), Exact::new(&sunny(20, 5)));
    let description = &baked.description;
    let largest = f64::from(description.radiance_coefficients[0][0]);
    for (i, found) in description.radiance_coefficients.iter().enumerate() {
        let expected = exact.integral(|d| harmonic(i, d));
        let found = DVec3::from_array(found.map(f64::from));
        let off = (found - expected).abs().max_element() / largest;
        assert!(off < 3e-3, "coefficient {i}: {found}, not {expected}");
    }
    // Irradiance, computed as the description says, agrees with the cube within the error of nine harmonics.
    let brightest = texels(&baked.irradiance, 0)
        .map(|(_, value)| f64::from(value[0]))
        .fold(0.0, f64::max);
    for (direction, value) in texels(&baked.irradiance, 0).step_by(37) {
        let normal = direction * DVec3::new(1.0, 1.0, -1.0);
        let sum: f64 = (0..9)
            .map(|i| {
                f64::from(description.cosine_factors[i])
                    * f64::from(description.radiance_coefficients[i][0])
                    * harmonic(i, normal)
            })
            .sum();
        let off = (sum - f64::from(value[0])).abs() / brightest;
        assert!(off < 0.09, "{normal}: {sum}, not {}", value[0]);
    }
    // The technique itself looks up the same numbers.
    let technique = generated(
        &gpu,
        &sunny(20, 5),
        &[("resolution", "32"), ("samples", "1")],
    );
    let held: Vec<[f32; 4]> = read_buffer(&gpu, technique.harmonics().unwrap(), 9 * 16).unwrap();
    for (held, found) in held.iter().zip(description.radiance_coefficients) {
        assert_eq!(held[..3], found);
    }
}

/// Evaluates the basis from its text.
#[test]
fn the_description_spells_out_the_basis() {
    let Some(gpu) = test_gpu() else { return };
    let description = baked(&gpu).description;
    let d = DVec3::new(0.48, 0.6, 0.64);
    for (i, text) in description.basis.iter().enumerate() {
        let variable = |word: &str| match word {
            "x" => d.x,
            "y" => d.y,
            "z" => d.z,
            "(3 z z - 1)" => 3.0 * d.z * d.z - 1.0,
            "(x x - y y)" => d.x * d.x - d.y * d.y,
            number => number.parse().unwrap(),
        };
        let (factors, bracket) = match text.split_once(" (") {
            Some((factor, rest)) => (factor, variable(&format!("({rest}"))),
            None => (*text, 1.0),
        };
        let value: f64 = factors.split(' ').map(variable).product::<f64>() * bracket;
        assert!((value - harmonic(i, d)).abs() < 1e-7, "{text}");
    }
    let levels = &description.glossy_levels;
    let sides: Vec<u32> = levels.iter().map(|level| level.side).collect();
    assert_eq!(sides, [32, 16, 8]);
    assert_eq!((levels[0].roughness, levels[0].phong_exponent), (0.0, None));
    assert_eq!(
        (levels[2].roughness, levels[2].phong_exponent),
        (1.0, Some(0.0))
    );
    let json = serde_json::to_value(&description).unwrap();
    assert_eq!(
        json["radiance_coefficients"].as_array().map(Vec::len),
        Some(9)
    );
}
