//! Spherical harmonics under rotation: Ivanic and Ruedenberg, "Rotation Matrices for Real Spherical Harmonics. Direct
//! Determination by Recursion" (1996), with the corrections of 1998.

use glam::{DMat3, Quat};

/// A matrix of 2 l + 1 rows, which turns the coefficients of band l. Row and column count m from -l to l.
struct Band {
    l: i32,
    values: Vec<f64>,
}

impl Band {
    /// The element of row `m` and column `n`.
    fn at(&self, m: i32, n: i32) -> f64 {
        let l = self.l;
        self.values[((m + l) * (2 * l + 1) + n + l) as usize]
    }

    /// The next band, from this one and the rotation of space: equation 8.1 and table 2.
    fn next(&self, space: &DMat3) -> Self {
        let l = self.l + 1;
        let first = |i: i32, j: i32| space.col((j + 1) as usize)[(i + 1) as usize];
        let product = |i: i32, m: i32, n: i32| match n {
            _ if n == l => first(i, 1) * self.at(m, l - 1) - first(i, -1) * self.at(m, 1 - l),
            _ if n == -l => first(i, 1) * self.at(m, 1 - l) + first(i, -1) * self.at(m, l - 1),
            _ => first(i, 0) * self.at(m, n),
        };
        let element = |m: i32, n: i32| {
            let size = m.abs();
            let below = f64::from(match n.abs() == l {
                true => 2 * l * (2 * l - 1),
                false => (l + n) * (l - n),
            });
            let root = |product: i32| (f64::from(product) / below).sqrt();
            // Products with a factor of 0 would ask for elements that the band before lacks.
            let u = match size < l {
                true => root((l + m) * (l - m)) * product(0, m, n),
                false => 0.0,
            };
            let v = 0.5 * root((l + size - 1) * (l + size));
            let v = match m {
                0 => -v * 2f64.sqrt() * (product(1, 1, n) + product(-1, -1, n)),
                1 => v * 2f64.sqrt() * product(1, 0, n),
                -1 => v * 2f64.sqrt() * product(-1, 0, n),
                _ if m > 0 => v * (product(1, m - 1, n) - product(-1, 1 - m, n)),
                _ => v * (product(1, m + 1, n) + product(-1, -m - 1, n)),
            };
            let w = match size {
                0 => 0.0,
                _ if size + 1 >= l => 0.0,
                _ if m > 0 => product(1, m + 1, n) + product(-1, -m - 1, n),
                _ => product(1, m - 1, n) - product(-1, 1 - m, n),
            };
            u + v - 0.5 * root((l - size - 1) * (l - size)) * w
        };
        let places = -l..=l;
        let values = places
            .clone()
            .flat_map(|m| places.clone().map(move |n| (m, n)));
        Self {
            l,
            values: values.map(|(m, n)| element(m, n)).collect(),
        }
    }
}

/// Matrices that turn the coefficients of bands below `order`, one after the other, row by row: what the coefficients of
/// a function in the space before `rotation` become in the space after it.
pub(super) fn matrices(rotation: Quat, order: u32) -> Vec<f32> {
    let space = DMat3::from_quat(rotation.as_dquat().normalize());
    // Functions of band 1 go with x, y and z of world space in this order: `functions` of coefficients.wesl.
    let mut band = Band {
        l: 1,
        values: space.transpose().to_cols_array().to_vec(),
    };
    let mut all = vec![1.0];
    for _ in 1..order {
        all.extend(band.values.iter().map(|&value| value as f32));
        band = band.next(&space);
    }
    all
}
