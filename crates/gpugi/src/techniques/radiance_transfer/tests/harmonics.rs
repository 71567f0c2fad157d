//! The functions themselves.

use glam::{Quat, Vec3, Vec3Swizzles};

use crate::gpu::Gpu;
use crate::shader;
use crate::techniques::radiance_transfer::rotation::matrices;
use crate::testing::{Random, run_kernel, test_gpu};

/// Functions of order 8, and those of an irradiance.
const ALL: usize = 64 + 9;

/// All functions at each direction.
fn at(gpu: &Gpu, directions: &[Vec3]) -> Vec<f32> {
    let input: Vec<[f32; 4]> = directions
        .iter()
        .map(|direction| direction.extend(0.0).to_array())
        .collect();
    let input = gpu.storage("directions", &input).unwrap();
    let inputs = [("directions", &input)];
    let shader = shader!("testing.harmonics");
    let count = directions.len();
    run_kernel(gpu, &shader, "main", &inputs, count * ALL, count as u32).unwrap()
}

/// Values of the light with these coefficients in many directions of the world.
pub fn series(gpu: &Gpu, light: &[Vec3]) -> Vec<Vec3> {
    let mut random = Random(3);
    let directions: Vec<Vec3> = (0..4096).map(|_| random.direction().zxy()).collect();
    let values = at(gpu, &directions);
    let sum = |values: &[f32]| values.iter().zip(light).map(|(y, l)| *y * *l).sum();
    values.chunks(ALL).map(sum).collect()
}

/// Nodes and weights of Gauss-Legendre quadrature over -1 to 1, by Newton's method.
fn gauss_legendre(count: u32) -> Vec<(f64, f64)> {
    let node = |index: u32| {
        let n = f64::from(count);
        let mut x = (std::f64::consts::PI * (f64::from(index) + 0.75) / (n + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..20 {
            let (mut before, mut value) = (1.0, x);
            for l in 2..=count {
                let l = f64::from(l);
                (before, value) = (
                    value,
                    ((2.0 * l - 1.0) * x * value - (l - 1.0) * before) / l,
                );
            }
            slope = n * (x * value - before) / (x * x - 1.0);
            x -= value / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(node).collect()
}

/// Quadrature that is exact for products of two functions of order 8.
#[test]
fn functions_are_orthonormal_and_begin_with_those_of_an_irradiance() {
    let Some(gpu) = test_gpu() else { return };
    let (mut directions, mut weights) = (Vec::new(), Vec::new());
    for (z, weight) in gauss_legendre(8) {
        for column in 0..16 {
            let phi = std::f64::consts::TAU * f64::from(column) / 16.0;
            let (sine, cosine) = phi.sin_cos();
            let radius = (1.0 - z * z).sqrt();
            directions.push(glam::dvec3(radius * cosine, radius * sine, z).as_vec3());
            weights.push(weight * std::f64::consts::TAU / 16.0);
        }
    }
    let values = at(&gpu, &directions);
    let rows = values.chunks(ALL).zip(&weights);
    for i in 0..64 {
        for j in 0..=i {
            let product = |(row, weight): (&[f32], &f64)| f64::from(row[i] * row[j]) * weight;
            let product: f64 = rows.clone().map(product).sum();
            let expected = f64::from(u8::from(i == j));
            assert!((product - expected).abs() < 1e-5, "{i} {j}: {product}");
        }
    }
    for row in values.chunks(ALL) {
        let (all, nine) = row.split_at(64);
        let pairs = all.iter().zip(nine);
        assert!(
            pairs
                .clone()
                .all(|(value, other)| (value - other).abs() < 1e-6)
        );
    }
}

/// A light of all functions, turned about a crooked axis, has in each direction what it had in the direction turned back.
#[test]
fn matrices_turn_functions_about_any_axis() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(5);
    let axis = random.direction();
    for rotation in [
        Quat::from_axis_angle(axis, 2.2),
        Quat::from_rotation_y(-0.7),
        Quat::from_rotation_x(std::f32::consts::FRAC_PI_2),
    ] {
        let light: Vec<f32> = (0..64).map(|_| random.next() as f32 - 0.5).collect();
        let matrices = matrices(rotation, 8);
        let mut first = 0;
        let mut turned = Vec::new();
        for l in 0..8 {
            let side = 2 * l + 1;
            let rows = matrices[first..first + side * side].chunks(side);
            let band = &light[l * l..(l + 1) * (l + 1)];
            turned.extend(rows.map(|row| row.iter().zip(band).map(|(r, l)| r * l).sum::<f32>()));
            first += side * side;
        }
        assert_eq!(first, matrices.len());
        let world: Vec<Vec3> = (0..64).map(|_| random.direction()).collect();
        let before: Vec<Vec3> = world.iter().map(|&d| rotation.inverse() * d).collect();
        // `functions` of coefficients.wesl.
        let [after, before] = [world, before].map(|directions| {
            at(
                &gpu,
                &directions.iter().map(|d| d.zxy()).collect::<Vec<_>>(),
            )
        });
        let sum = |values: &[f32], light: &[f32]| -> f32 {
            values.iter().zip(light).map(|(y, l)| y * l).sum()
        };
        for (after, before) in after.chunks(ALL).zip(before.chunks(ALL)) {
            let [found, expected] = [sum(after, &turned), sum(before, &light)];
            assert!((found - expected).abs() < 1e-4, "{found} {expected}");
        }
    }
}
