//! The functions themselves.

use glam::{Vec3, Vec3Swizzles};

use crate::gpu::Gpu;
use crate::shader;
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
