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

/// Powers of the root of x^5 = x + 1, for four dimensions: those that resemble [`R2`] least, by which a sample's place in
/// its pixel is chosen.
const OF_LENS: [f64; 2] = [0.628_706_721_037_808_7, 0.538_597_257_223_610_1];

/// Uniform numbers in the unit square for the point of the lens through which sample `index` is taken.
pub fn on_lens(index: u32) -> Vec2 {
    Vec2::from_array(additive(OF_LENS, index).map(|step| (0.5 + step).fract() as f32))
}

/// Point `index` of the additive R2 sequence in the unit square, the first in its middle.
pub fn low_discrepancy(index: u32) -> Vec2 {
    Vec2::from_array(additive(R2, index).map(|coordinate| (0.5 + coordinate).fract() as f32))
}
