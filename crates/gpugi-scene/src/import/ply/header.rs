//! Parses the text at the start of a PLY file.

use crate::import::quoted;

/// Encoding of the values after the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Size in a binary file (bytes).
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The largest value of an integer type; `None` for floats.
    pub fn largest(self) -> Option<f64> {
        match self {
            Self::I8 => Some(f64::from(i8::MAX)),
            Self::U8 => Some(f64::from(u8::MAX)),
            Self::I16 => Some(f64::from(i16::MAX)),
            Self::U16 => Some(f64::from(u16::MAX)),
            Self::I32 => Some(f64::from(i32::MAX)),
            Self::U32 => Some(f64::from(u32::MAX)),
            Self::F32 | Self::F64 => None,
        }
    }
}

/// A property of each entry of an element: a value or a list of values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
    /// Type of the count before a list; `None` if the property is not a list.
    pub list_count: Option<Kind>,
}

/// A table in the file, such as vertices or faces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

/// The contents of the header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    pub format: Format,
    pub elements: Vec<Element>,
    /// Size of the header (bytes), which is the offset of the first value.
    pub size: usize,
}

impl Header {
    /// Parses the header; the error is a line number and a reason.
    pub fn parse(bytes: &[u8]) -> Result<Self, (usize, String)> {
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut size = 0;
        for (index, line) in bytes.split_inclusive(|&byte| byte == b'\n').enumerate() {
            size += line.len();
            let number = index + 1;
            let fail = |reason: String| Err((number, reason));
            let Ok(text) = std::str::from_utf8(line) else {
                return fail("the header holds bytes that are no text".into());
            };
            let words: Vec<&str> = text.split_whitespace().collect();
            match words[..] {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return fail("a PLY file starts with the line \"ply\"".into()),
                [] | ["comment" | "obj_info", ..] => {}
                ["format", name, "1.0"] => {
                    format = Some(match name {
                        "ascii" => Format::Ascii,
                        "binary_little_endian" => Format::LittleEndian,
                        "binary_big_endian" => Format::BigEndian,
                        _ => return fail(format!("unknown format \"{}\"", quoted(name))),
                    });
                }
                ["element", name, count] => {
                    let Ok(count) = count.parse() else {
                        return fail(format!("\"{}\" is no count", quoted(count)));
                    };
                    elements.push(Element {
                        name: name.into(),
                        count,
                        properties: Vec::new(),
                    });
                }
                ["property", ref words @ ..] => {
                    let Some(element) = elements.last_mut() else {
                        return fail("a property comes before any element".into());
                    };
                    let Some(property) = property(words) else {
                        return fail(format!("\"{}\" is no property", quoted(text.trim())));
                    };
                    element.properties.push(property);
                }
                ["end_header"] => {
                    let Some(format) = format else {
                        return fail("the header ends without a format line".into());
                    };
                    return Ok(Self {
                        format,
                        elements,
                        size,
                    });
                }
                _ => return fail(format!("\"{}\" is no header line", quoted(text.trim()))),
            }
        }
        let last = bytes.split(|&byte| byte == b'\n').count();
        Err((last, "the file ends before the header does".into()))
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let (list_count, kind, name) = match *words {
        ["list", count, kind, name] => (Some(Kind::parse(count)?), kind, name),
        [kind, name] => (None, kind, name),
        _ => return None,
    };
    Some(Property {
        name: name.into(),
        kind: Kind::parse(kind)?,
        list_count,
    })
}
