//! Reads the values after a PLY header.

use crate::import::quoted;

use super::header::{Element, Format, Kind, Property};

/// Reads numbers in sequence and checks every length against the remaining bytes.
pub struct Values<'a> {
    rest: &'a [u8],
    format: Format,
}

impl<'a> Values<'a> {
    /// Reads the values in `bytes`, which start right after the header.
    pub fn new(bytes: &'a [u8], format: Format) -> Self {
        Self {
            rest: bytes,
            format,
        }
    }

    /// Checks that the remaining bytes can hold an element of this size.
    pub fn expect(&self, element: &Element) -> Result<(), String> {
        let least = element
            .properties
            .iter()
            .map(|property| self.least(property.list_count.unwrap_or(property.kind)))
            .sum::<usize>() as u64;
        let needed = element.count.saturating_mul(least);
        // The last number of an ASCII file needs no separator.
        if needed > self.rest.len() as u64 + 1 {
            return Err(format!(
                "{} entries take at least {needed} bytes and only {} are left",
                element.count,
                self.rest.len()
            ));
        }
        Ok(())
    }

    /// Minimum size of a number including its separator (bytes).
    fn least(&self, kind: Kind) -> usize {
        match self.format {
            Format::Ascii => 2,
            _ => kind.size(),
        }
    }

    /// The next number.
    pub fn number(&mut self, kind: Kind) -> Result<f64, String> {
        match self.format {
            Format::Ascii => self.word()?.parse_number(kind),
            Format::LittleEndian => self.binary(kind, false),
            Format::BigEndian => self.binary(kind, true),
        }
    }

    /// The length of the next list; the remaining bytes can hold that many values.
    pub fn list_count(&mut self, property: &Property) -> Result<usize, String> {
        let kind = property.list_count.unwrap_or(Kind::U8);
        let count = self.number(kind)?;
        let possible = (self.rest.len() + 1) / self.least(property.kind);
        if !(count >= 0.0 && count <= possible as f64 && count.fract() == 0.0) {
            return Err(format!(
                "a list of {count} values, and there is room for {possible}"
            ));
        }
        Ok(count as usize)
    }

    /// Current position of the reader, for error messages.
    pub fn place(&self, file: &[u8]) -> String {
        let offset = file.len() - self.rest.len();
        match self.format {
            Format::Ascii => {
                let lines = file[..offset].iter().filter(|&&byte| byte == b'\n').count();
                format!("line {}", lines + 1)
            }
            _ => format!("byte {offset}"),
        }
    }

    fn word(&mut self) -> Result<Word<'a>, String> {
        let start = self
            .rest
            .iter()
            .position(|byte| !byte.is_ascii_whitespace())
            .ok_or("the file ends too early")?;
        let rest = &self.rest[start..];
        let end = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        self.rest = &rest[end..];
        Ok(Word(&rest[..end]))
    }

    fn binary(&mut self, kind: Kind, big_endian: bool) -> Result<f64, String> {
        let (bytes, rest) = self
            .rest
            .split_at_checked(kind.size())
            .ok_or("the file ends too early")?;
        self.rest = rest;
        let mut little = [0; 8];
        little[..bytes.len()].copy_from_slice(bytes);
        if big_endian {
            little[..bytes.len()].reverse();
        }
        let [a, b, c, d, ..] = little;
        Ok(match kind {
            Kind::I8 => f64::from(a as i8),
            Kind::U8 => f64::from(a),
            Kind::I16 => f64::from(i16::from_le_bytes([a, b])),
            Kind::U16 => f64::from(u16::from_le_bytes([a, b])),
            Kind::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Kind::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Kind::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Kind::F64 => f64::from_le_bytes(little),
        })
    }
}

/// A word in an ASCII file.
struct Word<'a>(&'a [u8]);

impl Word<'_> {
    fn parse_number(&self, kind: Kind) -> Result<f64, String> {
        let text = String::from_utf8_lossy(self.0);
        let number = match kind {
            // Parse 32-bit floats directly: rounding via 64 bits could change the last bit.
            Kind::F32 => text.parse::<f32>().map(f64::from).ok(),
            _ => text.parse::<f64>().ok(),
        };
        number.ok_or_else(|| format!("\"{}\" is no number", quoted(&text)))
    }
}
