//! Numbers in the lines of a file.

use std::str::FromStr;

use crate::import::quoted;

/// Parses `COUNT` numbers from `words` that are finite in 32 bits; the error says why that fails.
pub fn numbers<T, const COUNT: usize>(words: &[&str]) -> Result<[T; COUNT], String>
where
    T: FromStr + Into<f64> + Default + Copy,
{
    let numbers: [T; COUNT] = any_numbers(words)?;
    let is_finite = |number: &T| ((*number).into() as f32).is_finite();
    let broken = numbers.iter().position(|number| !is_finite(number));
    match broken {
        Some(at) => Err(no_number(words[at])),
        None => Ok(numbers),
    }
}

fn no_number(word: &str) -> String {
    format!("\"{}\" is no finite number", quoted(word))
}

/// As [`numbers`], of any value.
pub fn any_numbers<T: FromStr + Default + Copy, const COUNT: usize>(
    words: &[&str],
) -> Result<[T; COUNT], String> {
    if words.len() < COUNT {
        return Err(format!("{} numbers where {COUNT} belong", words.len()));
    }
    let mut values = [T::default(); COUNT];
    for (value, word) in values.iter_mut().zip(words) {
        let number = word.parse().map_err(|_| no_number(word))?;
        *value = number;
    }
    Ok(values)
}
