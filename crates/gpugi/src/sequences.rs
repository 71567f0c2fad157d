//! Low-discrepancy sequences on the host.

use glam::Vec2;

/// Steps of the additive sequences of lowest discrepancy in one and two dimensions: the golden ratio, and powers of the
/// root of x^3 = x + 1 (Roberts 2018).
pub const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;
pub const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// Powers of the root of x^4 = x + 1, for three dimensions.
pub const R3: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_3,
];

/// Point `index` of an additive sequence that begins at zero.
pub fn additive<const N: usize>(steps: [f64; N], index: u32) -> [f64; N] {
    steps.map(|step| (step * f64::from(index)).fract())
}

/// Point `index` of the two-dimensional Sobol sequence, in the middle of its cell of 2^-24: shared/sobol.wesl is its twin
/// and says how. For what is drawn beside a place in the pixel, which has [`R2`].
pub fn sobol(index: u32) -> Vec2 {
    let mut p = index;
    for (shift, mask) in [
        (1, 0x5555_5555),
        (2, 0x3333_3333),
        (4, 0x0f0f_0f0f),
        (8, 0x00ff_00ff),
        (16, 0x0000_ffff),
    ] {
        p ^= (p >> shift) & mask;
    }
    let unit = |bits: u32| ((bits.reverse_bits() >> 8) as f32 + 0.5) / 16_777_216.0;
    Vec2::new(unit(index), unit(p))
}

/// Point `index` of the additive R2 sequence in the unit square, the first in its middle.
pub fn low_discrepancy(index: u32) -> Vec2 {
    Vec2::from_array(additive(R2, index).map(|coordinate| (0.5 + coordinate).fract() as f32))
}
