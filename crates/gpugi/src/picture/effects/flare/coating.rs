//! How much light surfaces of a lens reflect, with and without a coating.

use std::f64::consts::TAU;

crate::choices! {
    /// What surfaces between glass and air are coated with.
    #[derive(Default)]
    pub enum Coating {
        /// Nothing: each reflects five to seven percent.
        None = "none",
        /// A quarter of a wave of magnesium fluoride, for 550, 480 and 620 nm in turn: about one percent.
        #[default]
        Single = "single",
    }
}

/// Wavelengths that stand for red, green and blue (m).
pub const WAVELENGTHS: [f64; 3] = [610e-9, 550e-9, 465e-9];

/// Wavelengths for which surfaces are coated, in turn (m).
const COATED_FOR: [f64; 3] = [550e-9, 480e-9, 620e-9];

/// Refractive index of magnesium fluoride.
const MAGNESIUM_FLUORIDE: f64 = 1.38;

/// Share of light that the surface number `index` of a lens reflects, by wavelength. It comes from a medium of the
/// refractive index `from`, at an angle whose cosine is `cosine`.
pub fn reflectance(
    coating: Coating,
    index: usize,
    [from, into]: [f64; 2],
    cosine: f64,
) -> [f64; 3] {
    // Cement joins glasses of nearly the same index.
    let is_cemented = from > 1.0 && into > 1.0;
    WAVELENGTHS.map(|wavelength| match coating {
        Coating::Single if !is_cemented => {
            let thickness = COATED_FOR[index % COATED_FOR.len()] / (4.0 * MAGNESIUM_FLUORIDE);
            through_film(
                [from, MAGNESIUM_FLUORIDE, into],
                thickness / wavelength,
                cosine,
            )
        }
        _ => through_film([from, from, into], 0.0, cosine),
    })
}

/// The share that a film between two media reflects, `thickness` wavelengths thick. Airy's sum over all reflections within
/// it, of the amplitudes a and b of its two sides, R = (a^2 + b^2 + 2 a b cos 2d) / (1 + a^2 b^2 + 2 a b cos 2d), with the
/// phase d = 2 pi n t cos; the mean of both polarizations. Born, Wolf, "Principles of Optics", section 1.6.4.
fn through_film(indices: [f64; 3], thickness: f64, cosine: f64) -> f64 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    // Total reflection, if not at the film, then behind it.
    if indices[0] * sine >= indices[2] {
        return 1.0;
    }
    let cosines = indices.map(|index| (1.0 - (indices[0] * sine / index).powi(2)).max(0.0).sqrt());
    let phase = 2.0 * TAU * indices[1] * thickness * cosines[1];
    let amplitudes = |side: usize, is_parallel: bool| {
        let [n, m] = [indices[side], indices[side + 1]];
        let [c, d] = [cosines[side], cosines[side + 1]];
        let [one, two] = if is_parallel {
            [m * c, n * d]
        } else {
            [n * c, m * d]
        };
        (one - two) / (one + two)
    };
    let shares = [false, true].map(|is_parallel| {
        let [a, b] = [amplitudes(0, is_parallel), amplitudes(1, is_parallel)];
        let both = 2.0 * a * b * phase.cos();
        (a * a + b * b + both) / (1.0 + a * a * b * b + both)
    });
    (shares[0] + shares[1]) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_reflect_by_the_closed_forms() {
        let close = |found: f64, expected: f64| {
            assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
        };
        for ways in [[1.0, 1.67], [1.67, 1.0]] {
            let bare = reflectance(Coating::None, 0, ways, 1.0);
            for share in bare {
                close(share, (0.67_f64 / 2.67).powi(2));
            }
            // Where a coating is a quarter of a wave thick: ((n m - f^2) / (n m + f^2))^2.
            let square = MAGNESIUM_FLUORIDE * MAGNESIUM_FLUORIDE;
            let least = ((1.67 - square) / (1.67 + square)).powi(2);
            let coated = reflectance(Coating::Single, 0, ways, 1.0);
            close(coated[1], least);
            assert!(coated[0] > least && coated[2] > coated[0]);
        }
        let cemented = reflectance(Coating::Single, 0, [1.67, 1.699], 1.0);
        close(cemented[0], (0.029_f64 / 3.369).powi(2));
        assert_eq!(reflectance(Coating::Single, 0, [1.67, 1.0], 0.5), [1.0; 3]);
        // At Brewster's angle, the parallel half is lost.
        let angle = 1.5_f64.atan();
        let half = ((1.5 * 1.5 - 1.0) / (1.5_f64 * 1.5 + 1.0)).powi(2) / 2.0;
        close(
            reflectance(Coating::None, 0, [1.0, 1.5], angle.cos())[0],
            half,
        );
    }
}
