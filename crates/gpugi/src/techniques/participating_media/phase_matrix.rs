//! Phase functions between the directions of the network.

use glam::DVec3;
use gpugi_scene::PhaseFunction;

use super::particles::bounded;

/// Direction i of `directions`: that of network.wesl.
pub fn direction(directions: u32, i: u32) -> DVec3 {
    let half = directions / 2;
    let number = f64::from(i % half);
    let z = 1.0 - (2.0 * number + 1.0) / f64::from(directions);
    let phi = std::f64::consts::TAU * (number * 0.618_033_99).fract();
    let sine = (1.0 - z * z).sqrt();
    let above = DVec3::new(sine * phi.cos(), sine * phi.sin(), z);
    if i < half { above } else { -above }
}

/// W[i][d] = 4 pi / D P(w_d, w_i), scaled to s_i W s_d such that every row and every column sums to 1: scattering
/// neither gains nor loses light, and stays reciprocal (Sinkhorn's iteration on a symmetric matrix). Row by row.
pub fn phase_matrix(phase: PhaseFunction, directions: u32) -> Vec<f32> {
    let count = directions as usize;
    let all: Vec<DVec3> = (0..directions).map(|i| direction(directions, i)).collect();
    let mut matrix = Vec::with_capacity(count * count);
    for out in &all {
        matrix.extend(all.iter().map(|into| relative(phase, out.dot(*into))));
    }
    let mut scales = vec![1.0_f64; count];
    for _ in 0..200 {
        let mut largest: f64 = 0.0;
        let sums: Vec<f64> = matrix
            .chunks_exact(count)
            .zip(&scales)
            .map(|(row, own)| own * row.iter().zip(&scales).map(|(w, s)| w * s).sum::<f64>())
            .collect();
        for (scale, sum) in scales.iter_mut().zip(sums) {
            largest = largest.max((sum - 1.0).abs());
            *scale /= sum.sqrt();
        }
        if largest < 1e-12 {
            break;
        }
    }
    let scaled = matrix.iter().enumerate();
    scaled
        .map(|(index, value)| (value * scales[index / count] * scales[index % count]) as f32)
        .collect()
}

/// The phase function but for a constant factor.
fn relative(phase: PhaseFunction, cosine: f64) -> f64 {
    let henyey_greenstein = |g: f32| {
        let g = f64::from(bounded(g));
        (1.0 + g * g - 2.0 * g * cosine).powf(-1.5)
    };
    match phase {
        PhaseFunction::HenyeyGreenstein(g) => henyey_greenstein(g),
        PhaseFunction::CornetteShanks(g) => henyey_greenstein(g) * (1.0 + cosine * cosine),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_columns_sum_to_one() {
        for phase in [
            PhaseFunction::HenyeyGreenstein(0.0),
            PhaseFunction::HenyeyGreenstein(0.6),
            PhaseFunction::HenyeyGreenstein(-1.0),
            PhaseFunction::CornetteShanks(0.9),
        ] {
            let matrix = phase_matrix(phase, 64);
            for i in 0..64 {
                let row: f32 = matrix[64 * i..64 * (i + 1)].iter().sum();
                let column: f32 = (0..64).map(|d| matrix[64 * d + i]).sum();
                assert!((row - 1.0).abs() < 1e-5, "{phase:?}, row {i}: {row}");
                assert!(
                    (column - 1.0).abs() < 1e-5,
                    "{phase:?}, column {i}: {column}"
                );
            }
        }
    }

    /// The mean cosine of the scattering angle is that of the phase function.
    #[test]
    fn scattering_keeps_its_mean_cosine() {
        for g in [-0.4, 0.0, 0.6] {
            let matrix = phase_matrix(PhaseFunction::HenyeyGreenstein(g), 128);
            let mut sum = 0.0;
            for i in 0..128 {
                for d in 0..128 {
                    let cosine = direction(128, i).dot(direction(128, d));
                    sum += f64::from(matrix[(128 * i + d) as usize]) * cosine / 128.0;
                }
            }
            assert!((sum - f64::from(g)).abs() < 0.02, "{g}: {sum}");
        }
    }
}
