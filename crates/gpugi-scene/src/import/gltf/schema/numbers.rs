//! How numbers are read.

use serde::{Deserialize, Deserializer, de};

/// The default of factors.
pub fn one() -> f32 {
    1.0
}

/// The default of colours and scales.
pub fn ones<const N: usize>() -> [f32; N] {
    [1.0; N]
}

/// Reads floats and rejects those that become infinite in 32 bits: JSON can hold 1e99.
pub fn finite<'de, D: Deserializer<'de>, T: Deserialize<'de> + Finite>(
    deserializer: D,
) -> Result<T, D::Error> {
    let value = T::deserialize(deserializer)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(de::Error::custom("a number exceeds 32-bit floats"))
    }
}

/// Reads a float, finite or not: null, which exporters write for what is no number, is NaN.
pub fn any_number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    let number: Option<f64> = Option::deserialize(deserializer)?;
    Ok(number.map_or(f32::NAN, |number| number as f32))
}

/// What can be told to be finite in 32 bits.
pub trait Finite {
    fn is_finite(&self) -> bool;
}

impl Finite for f32 {
    fn is_finite(&self) -> bool {
        f32::is_finite(*self)
    }
}

impl Finite for f64 {
    fn is_finite(&self) -> bool {
        (*self as f32).is_finite()
    }
}

impl<T: Finite, const N: usize> Finite for [T; N] {
    fn is_finite(&self) -> bool {
        self.iter().all(Finite::is_finite)
    }
}

impl Finite for Vec<f32> {
    fn is_finite(&self) -> bool {
        self.iter().all(Finite::is_finite)
    }
}

impl<T: Finite> Finite for Option<T> {
    fn is_finite(&self) -> bool {
        self.as_ref().is_none_or(Finite::is_finite)
    }
}
