//! The text at the start of a PLY file.

/// How the values after the header are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A number's type.
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

    /// Bytes in a binary file.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The largest value of an integer type.
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

/// A value, or a list of them, that each entry of an element has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
    /// The type of the count in front of a list.
    pub list_count: Option<Kind>,
}

/// A table of the file: vertices, faces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

/// What the file says about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    pub format: Format,
    pub elements: Vec<Element>,
    /// Bytes up to the first value.
    pub size: usize,
}

impl Header {
    /// Reads the header; the error is a line number and a reason.
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
                        _ => return fail(format!("unknown format \"{name}\"")),
                    });
                }
                ["element", name, count] => {
                    let Ok(count) = count.parse() else {
                        return fail(format!("\"{count}\" is no count"));
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
                        return fail(format!("\"{}\" is no property", text.trim()));
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
                _ => return fail(format!("\"{}\" is no header line", text.trim())),
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
