//! Colours of other primaries in those of Rec. 709.

use glam::{DMat3, DVec3};

/// x and y of red, green, blue and white.
pub(super) type Chromaticities = [[f64; 2]; 4];

/// Whose "red", "green" and "blue" are X, Y and Z.
pub(super) const XYZ: Chromaticities = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0; 2]];

const REC_709: Chromaticities = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];

/// Files round chromaticities to three or four digits.
const TOLERANCE: f64 = 1e-3;

/// Cone responses by XYZ of Bradford's chromatic adaptation (Lam 1985).
const BRADFORD: DMat3 = DMat3::from_cols(
    DVec3::new(0.8951, -0.7502, 0.0389),
    DVec3::new(0.2664, 1.7135, -0.0685),
    DVec3::new(-0.1614, 0.0367, 1.0296),
);

/// Linear Rec. 709 from linear colours of other primaries. White stays white; X, Y and Z have no white that could.
/// `None` if the chromaticities make no colours.
pub(super) fn rec709_from(chromaticities: &Chromaticities) -> Option<DMat3> {
    if is_close(chromaticities, &REC_709) {
        return Some(DMat3::IDENTITY);
    }
    let xyz_from_rec709 = xyz_from(&REC_709)?;
    let adaptation = if is_close(chromaticities, &XYZ) {
        DMat3::IDENTITY
    } else {
        let [from, to] = [chromaticities, &REC_709].map(|of| BRADFORD * white(of));
        BRADFORD.inverse() * DMat3::from_diagonal(to / from) * BRADFORD
    };
    let matrix = xyz_from_rec709.inverse() * adaptation * xyz_from(chromaticities)?;
    matrix.is_finite().then_some(matrix)
}

/// XYZ from linear RGB.
fn xyz_from(chromaticities: &Chromaticities) -> Option<DMat3> {
    let column = |[x, y]: [f64; 2]| DVec3::new(x, y, 1.0 - x - y);
    let [red, green, blue, _] = chromaticities.map(column);
    let directions = DMat3::from_cols(red, green, blue);
    let spans_colors = directions.determinant().abs() > 1e-6;
    let scale = directions.inverse() * white(chromaticities);
    (spans_colors && scale.is_finite()).then(|| directions * DMat3::from_diagonal(scale))
}

/// XYZ of white, with Y = 1.
fn white(chromaticities: &Chromaticities) -> DVec3 {
    let [.., [x, y]] = *chromaticities;
    DVec3::new(x, y, 1.0 - x - y) / y
}

fn is_close(a: &Chromaticities, b: &Chromaticities) -> bool {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.into_iter().all(|(a, b)| (a - b).abs() < TOLERANCE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_close(found: DVec3, expected: DVec3) {
        assert!(
            found.abs_diff_eq(expected, 2e-3),
            "{found} is not {expected}"
        );
    }

    #[test]
    fn colours_become_those_of_rec_709() {
        // Lindbloom's matrix from XYZ to sRGB, and the XYZ of D65.
        let from_xyz = rec709_from(&XYZ).unwrap();
        assert_close(from_xyz * DVec3::new(0.9505, 1.0, 1.0891), DVec3::ONE);
        assert_close(from_xyz * DVec3::Y, DVec3::new(-1.5371, 1.8760, -0.2040));
        // ITU-R BT.2087: Rec. 709 from Rec. 2020.
        let rec_2020 = [
            [0.708, 0.292],
            [0.17, 0.797],
            [0.131, 0.046],
            [0.3127, 0.329],
        ];
        let from_2020 = rec709_from(&rec_2020).unwrap();
        assert_close(from_2020 * DVec3::X, DVec3::new(1.6605, -0.1246, -0.0182));
        // ACES2065-1 has a white of its own, which becomes white.
        let aces = [
            [0.7347, 0.2653],
            [0.0, 1.0],
            [0.0001, -0.077],
            [0.32168, 0.33767],
        ];
        let from_aces = rec709_from(&aces).unwrap();
        assert_close(from_aces * DVec3::ONE, DVec3::ONE);
        assert_close(from_aces * DVec3::X, DVec3::new(2.5217, -0.2765, -0.0154));
        assert_eq!(rec709_from(&REC_709), Some(DMat3::IDENTITY));
    }

    #[test]
    fn chromaticities_without_colours_are_none() {
        assert_eq!(rec709_from(&[[0.3, 0.3]; 4]), None);
        assert_eq!(rec709_from(&[[f64::NAN; 2]; 4]), None);
        assert_eq!(
            rec709_from(&[[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3, 0.0]]),
            None
        );
    }
}
