//! Principal component analysis: the mean of many vectors, and the directions in which they vary most.

/// The mean and the basis vectors of a subspace (tutorial, "Compression of transfer coefficients").
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Subspace {
    pub mean: Vec<f32>,
    /// Orthonormal, by descending variance along them.
    pub basis: Vec<Vec<f32>>,
}

impl Subspace {
    /// The subspace through the mean of `vectors` (with the factor 1 / K that the tutorial leaves out) with the `count`
    /// eigenvectors of the covariance that have the largest eigenvalues. At least one vector.
    pub fn new(vectors: &[Vec<f32>], count: usize) -> Self {
        let mean = mean(vectors.iter().cloned());
        let dimensions = mean.len();
        let mut covariance = vec![vec![0.0; dimensions]; dimensions];
        for vector in vectors {
            let off: Vec<f64> = vector
                .iter()
                .zip(&mean)
                .map(|(value, mean)| f64::from(*value) - mean)
                .collect();
            for (row, deviation) in covariance.iter_mut().zip(&off) {
                for (sum, other) in row.iter_mut().zip(&off) {
                    *sum += deviation * other;
                }
            }
        }
        let mut pairs = eigenpairs(covariance);
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        let narrow = |vector: &[f64]| vector.iter().map(|&value| value as f32).collect();
        Self {
            basis: pairs
                .iter()
                .take(count)
                .map(|(_, vector)| narrow(vector))
                .collect(),
            mean: narrow(&mean),
        }
    }

    /// Coordinates of a vector's projection: the dot products of its offset from the mean with the basis vectors.
    pub fn weights(&self, vector: &[f32]) -> Vec<f32> {
        let off = |i: usize| vector[i] - self.mean[i];
        let weight = |along: &Vec<f32>| along.iter().enumerate().map(|(i, b)| off(i) * b).sum();
        self.basis.iter().map(weight).collect()
    }
}

/// The mean of at least one vector; empty of none.
pub(super) fn mean(vectors: impl Iterator<Item = Vec<f32>>) -> Vec<f64> {
    let (mut sums, mut count) = (Vec::new(), 0);
    for vector in vectors {
        sums.resize(vector.len(), 0.0);
        for (sum, value) in sums.iter_mut().zip(vector) {
            *sum += f64::from(value);
        }
        count += 1;
    }
    for sum in &mut sums {
        *sum /= f64::from(count);
    }
    sums
}

/// Sweeps after which nothing changes any more, whatever the matrix.
const MOST_SWEEPS: u32 = 30;

/// Eigenvalues and orthonormal eigenvectors of a symmetric matrix, by Jacobi's method: rotations that remove one
/// element off the diagonal after the other, until all are negligible (Golub and Van Loan, "Matrix Computations",
/// section 8.5).
fn eigenpairs(mut a: Vec<Vec<f64>>) -> Vec<(f64, Vec<f64>)> {
    let n = a.len();
    // Row i is the vector that row and column i of the matrix belong to.
    let mut vectors = vec![vec![0.0; n]; n];
    for (i, vector) in vectors.iter_mut().enumerate() {
        vector[i] = 1.0;
    }
    let trace: f64 = (0..n).map(|i| a[i][i]).sum();
    let negligible = 1e-12 * trace;
    for _ in 0..MOST_SWEEPS {
        let mut has_rotated = false;
        for q in 1..n {
            for p in 0..q {
                if a[p][q].abs() <= negligible {
                    continue;
                }
                has_rotated = true;
                // The smaller root t of t^2 + 2 theta t - 1 = 0, theta = (a_qq - a_pp) / (2 a_pq).
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                rotate(&mut a, p, q, c, s);
                rotate(&mut vectors, p, q, c, s);
            }
        }
        if !has_rotated {
            break;
        }
    }
    let values = (0..n).map(|i| a[i][i]).collect::<Vec<_>>();
    values.into_iter().zip(vectors).collect()
}

/// Rotates rows p and q, p < q.
fn rotate(rows: &mut [Vec<f64>], p: usize, q: usize, c: f64, s: f64) {
    let (before, from) = rows.split_at_mut(q);
    for (x, y) in before[p].iter_mut().zip(&mut from[0]) {
        (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    /// Points of a plane in five dimensions, wider along one of two axes that are not orthogonal.
    #[test]
    fn points_of_a_plane_have_two_components() {
        let mut random = Random(5);
        let origin = [1.0, -2.0, 0.5, 3.0, 0.0];
        let [along, across] = [[1.0, 2.0, 0.0, -1.0, 0.5], [0.0, 1.0, 1.0, 1.0, -1.0]];
        let vectors: Vec<Vec<f32>> = (0..400)
            .map(|_| {
                let at = random.direction();
                let value = |i: usize| origin[i] + 3.0 * at.x * along[i] + at.y * across[i];
                (0..5).map(value).collect()
            })
            .collect();
        let found = Subspace::new(&vectors, 3);
        for (i, vector) in found.basis.iter().enumerate() {
            for (j, other) in found.basis.iter().enumerate() {
                let dot: f32 = vector.iter().zip(other).map(|(a, b)| a * b).sum();
                assert!(
                    (dot - f32::from(u8::from(i == j))).abs() < 1e-5,
                    "{i} {j}: {dot}"
                );
            }
        }
        let mut squares = [0.0; 3];
        for vector in &vectors {
            let weights = found.weights(vector);
            for (sum, weight) in squares.iter_mut().zip(&weights) {
                *sum += weight * weight;
            }
            for (i, expected) in vector.iter().enumerate() {
                let value =
                    found.mean[i] + weights[0] * found.basis[0][i] + weights[1] * found.basis[1][i];
                assert!((value - expected).abs() < 1e-4, "{value} {expected}");
            }
        }
        assert!(
            squares[0] > 2.0 * squares[1] && squares[2] < 1e-6 * squares[1],
            "{squares:?}"
        );
    }
}
