//! The header of an OpenEXR file, as far as it decides how texels are stored. Everything in it is checked here.

use std::collections::HashSet;

use exr::meta::attribute::{Compression, SampleType};

use crate::image::primaries::Chromaticities;
use crate::import::quoted;

const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
const VERSION: u32 = 2;
const FLAG_TILES: u32 = 0x200;
const FLAG_DEEP: u32 = 0x800;
const FLAG_PARTS: u32 = 0x1000;
/// Most channels of a part: far more than any renderer writes.
const MOST_CHANNELS: usize = 1024;
/// Farthest coordinate of a window, so that no difference of two overflows.
const FARTHEST: i32 = 1 << 24;

/// By their numbers in files.
const COMPRESSIONS: [Compression; 10] = [
    Compression::Uncompressed,
    Compression::RLE,
    Compression::ZIP1,
    Compression::ZIP16,
    Compression::PIZ,
    Compression::PXR24,
    Compression::B44,
    Compression::B44A,
    Compression::DWAA(None),
    Compression::DWAB(None),
];

/// Where a file is wrong, and why.
pub(super) type Fault = (String, String);

pub(super) fn fault<T>(place: &str, reason: impl Into<String>) -> Result<T, Fault> {
    Err((place.to_owned(), reason.into()))
}

/// A rectangle of texels, both corners included.
#[derive(Clone, Copy)]
pub(super) struct Window {
    pub min: [i32; 2],
    pub max: [i32; 2],
}

impl Window {
    pub fn size(&self) -> (u32, u32) {
        let side = |axis: usize| (self.max[axis] - self.min[axis] + 1) as u32;
        (side(0), side(1))
    }
}

/// The header of a part, as far as it matters.
#[derive(Default)]
struct Header<'a> {
    channels: Option<&'a [u8]>,
    compression: Option<u8>,
    data: Option<Window>,
    display: Option<Window>,
    /// Width and height of tiles.
    tiles: Option<[u32; 2]>,
    chunks: Option<u64>,
    kind: Option<&'a [u8]>,
    chromaticities: Option<Chromaticities>,
    is_cube: bool,
}

/// A channel of a part.
pub(super) struct Channel<'a> {
    pub name: &'a [u8],
    pub samples: SampleType,
    /// Whether lossy compressions see its samples as they are.
    pub is_linear: bool,
}

/// A part that can be decoded.
pub(super) struct Part<'a> {
    /// In the order in which they are stored.
    pub channels: Vec<Channel<'a>>,
    pub compression: Compression,
    pub data: Window,
    pub display: Window,
    /// Width and height of tiles.
    pub tiles: Option<[u32; 2]>,
    /// Its number, if the file has several parts.
    pub number: Option<u32>,
    /// Where its table of chunks starts.
    pub table: usize,
    /// The channels that are red, green and blue; of a grey picture, all the same.
    pub colors: [Vec<u8>; 3],
    /// The layer of these channels, if they belong to one.
    pub layer: Option<String>,
    pub chromaticities: Option<Chromaticities>,
}

/// A sequence of bytes that is read from its start.
pub(super) struct Bytes<'a>(pub &'a [u8]);

impl<'a> Bytes<'a> {
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.first_chunk().copied()
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_le_bytes)
    }

    /// Text that ends with a zero byte.
    fn text(&mut self) -> Option<&'a [u8]> {
        let end = self.0.iter().take(256).position(|&byte| byte == 0)?;
        let text = self.take(end)?;
        self.take(1)?;
        Some(text)
    }

    fn chromaticities(&mut self) -> Option<Chromaticities> {
        let mut values = [[0.0; 2]; 4];
        for value in values.as_flattened_mut() {
            *value = f64::from(self.array().map(f32::from_le_bytes)?);
        }
        Some(values)
    }

    fn window(&mut self) -> Option<Window> {
        let mut corner = || Some([self.i32()?, self.i32()?]);
        Some(Window {
            min: corner()?,
            max: corner()?,
        })
    }
}

/// The part that holds the picture ([`Picture::find`]).
pub(super) fn read_part(bytes: &[u8]) -> Result<Part<'_>, Fault> {
    let cut = || ("header".to_owned(), "the file ends too early".to_owned());
    let mut rest = Bytes(bytes);
    if rest.array() != Some(MAGIC) {
        return fault("header", "this is no OpenEXR file");
    }
    let version = rest.u32().ok_or_else(cut)?;
    if version & 0xff != VERSION {
        let version = version & 0xff;
        return fault("header", format!("gpugi reads version 2, not {version}"));
    }
    let has_parts = version & FLAG_PARTS != 0;
    let mut headers = Vec::new();
    loop {
        if has_parts && rest.0.first() == Some(&0) {
            rest.take(1);
            break;
        }
        headers.push(read_header(&mut rest)?);
        if !has_parts {
            break;
        }
    }
    let is_deep = |header: &Header| match header.kind {
        Some(kind) => kind.starts_with(b"deep"),
        None => version & FLAG_DEEP != 0,
    };
    let shallow = headers
        .iter()
        .enumerate()
        .filter(|(_, header)| !is_deep(header));
    let channels: Vec<(usize, &[u8])> = shallow
        .flat_map(|(number, header)| {
            names(header.channels.unwrap_or_default()).map(move |name| (number, name))
        })
        .collect();
    let Some(Picture {
        part,
        colors,
        layer,
    }) = Picture::find(&channels)?
    else {
        if headers.iter().any(is_deep) {
            return fault("header", "deep parts are not read; flatten them");
        }
        let found: Vec<_> = channels
            .iter()
            .map(|(_, name)| String::from_utf8_lossy(name))
            .collect();
        let found = quoted(&found.join(", "));
        let reason = format!("there are no channels R, G and B, nor Y; the channels are {found}");
        return fault("header", reason);
    };
    // The table of a part follows those of the parts before it.
    let mut table = bytes.len() - rest.0.len();
    for header in &headers[..part] {
        let skipped = header.chunks.and_then(|chunks| chunks.checked_mul(8));
        let skipped = skipped.and_then(|bytes| usize::try_from(bytes).ok());
        table = skipped
            .and_then(|bytes| table.checked_add(bytes))
            .ok_or_else(|| ("header".to_owned(), "chunkCount is missing".to_owned()))?;
    }
    let header = &headers[part];
    if header.is_cube {
        let reason = "cube maps are not read; exrenvmap -l makes an equirectangular map";
        return fault("attribute envmap", reason);
    }
    let is_tiled = match header.kind {
        Some(kind) => kind.starts_with(b"tiled"),
        None => version & FLAG_TILES != 0,
    };
    let number = has_parts.then_some(part as u32);
    Ok(Part {
        colors,
        layer,
        ..header.part(is_tiled, number, table)?
    })
}

/// The channels to read, and the part that has them.
struct Picture {
    part: usize,
    colors: [Vec<u8>; 3],
    layer: Option<String>,
}

impl Picture {
    /// Red, green and blue; without them, luminance; without it, those of the only layer that has colours, or of the
    /// one called Combined. `channels`: each with the number of its part.
    fn find(channels: &[(usize, &[u8])]) -> Result<Option<Self>, Fault> {
        let known: HashSet<&(usize, &[u8])> = channels.iter().collect();
        let has = |part: usize, name: &[u8]| known.contains(&(part, name));
        let of_layer = |part: usize, prefix: &[u8]| {
            let colors = [b'R', b'G', b'B'].map(|color| [prefix, &[color]].concat());
            let is_whole = colors.iter().all(|name| has(part, name));
            is_whole.then_some(Self {
                part,
                colors,
                layer: None,
            })
        };
        let mut parts: Vec<usize> = channels.iter().map(|&(part, _)| part).collect();
        parts.dedup();
        if let Some(found) = parts.iter().find_map(|&part| of_layer(part, b"")) {
            return Ok(Some(found));
        }
        if let Some(&part) = parts.iter().find(|&&part| has(part, b"Y")) {
            if has(part, b"RY") || has(part, b"BY") {
                let reason = "luminance and chroma (Y, RY, BY) are not read; save it as RGB";
                return fault("attribute channels", reason);
            }
            return Ok(Some(Self {
                part,
                colors: [b"Y"; 3].map(|name| name.to_vec()),
                layer: None,
            }));
        }
        let mut layers: Vec<(String, Self)> = Vec::new();
        for &(part, name) in channels {
            if let Some(prefix) = name
                .strip_suffix(b"R")
                .filter(|prefix| prefix.ends_with(b"."))
                && let Some(found) = of_layer(part, prefix)
            {
                let layer = String::from_utf8_lossy(&prefix[..prefix.len() - 1]).into_owned();
                layers.push((layer, found));
            }
        }
        let combined = layers
            .iter()
            .position(|(layer, _)| layer.ends_with("Combined"));
        let chosen = if layers.len() == 1 { Some(0) } else { combined };
        if let Some(chosen) = chosen {
            let (layer, picture) = layers.swap_remove(chosen);
            return Ok(Some(Self {
                layer: Some(layer),
                ..picture
            }));
        }
        if layers.is_empty() {
            return Ok(None);
        }
        let found: Vec<&str> = layers.iter().map(|(layer, _)| layer.as_str()).collect();
        let found = quoted(&found.join(", "));
        fault(
            "header",
            format!("several layers have colours ({found}); save one of them alone"),
        )
    }
}

fn read_header<'a>(rest: &mut Bytes<'a>) -> Result<Header<'a>, Fault> {
    let cut = || ("header".to_owned(), "the file ends too early".to_owned());
    let mut header = Header::default();
    loop {
        let name = rest.text().ok_or_else(cut)?;
        if name.is_empty() {
            return Ok(header);
        }
        let place = || format!("attribute {}", quoted(&String::from_utf8_lossy(name)));
        let kind = rest.text().ok_or_else(cut)?;
        let length = rest.u32().ok_or_else(cut)? as usize;
        let Some(value) = rest.take(length) else {
            let reason = format!("{length} bytes where {} are left", rest.0.len());
            return fault(&place(), reason);
        };
        let mut content = Bytes(value);
        let is_whole = match (name, kind) {
            (b"channels", b"chlist") => {
                header.channels = Some(value);
                true
            }
            (b"compression", b"compression") => {
                header.compression = content.array().map(|[number]| number);
                header.compression.is_some()
            }
            (b"dataWindow", b"box2i") => {
                header.data = content.window();
                header.data.is_some()
            }
            (b"displayWindow", b"box2i") => {
                header.display = content.window();
                header.display.is_some()
            }
            (b"tiles", b"tiledesc") => {
                let size = content.u32().zip(content.u32());
                header.tiles = size.map(|(width, height)| [width, height]);
                header.tiles.is_some()
            }
            (b"chunkCount", b"int") => {
                header.chunks = content.u32().map(u64::from);
                header.chunks.is_some()
            }
            (b"type", b"string") => {
                header.kind = Some(value);
                true
            }
            (b"chromaticities", b"chromaticities") => {
                header.chromaticities = content.chromaticities();
                header.chromaticities.is_some()
            }
            (b"envmap", b"envmap") => {
                header.is_cube = value == [1];
                true
            }
            _ => true,
        };
        if !is_whole {
            return fault(&place(), format!("{length} bytes are too few"));
        }
    }
}

/// The channels of a list. `None` if the list is damaged, or a channel has fewer samples than texels.
fn channels(list: &[u8]) -> Option<Vec<Channel<'_>>> {
    let mut rest = Bytes(list);
    let mut found: Vec<Channel> = Vec::new();
    loop {
        let name = rest.text()?;
        if name.is_empty() {
            return rest.0.is_empty().then_some(found);
        }
        let samples = match rest.u32()? {
            0 => SampleType::U32,
            1 => SampleType::F16,
            2 => SampleType::F32,
            _ => return None,
        };
        let is_linear = match rest.array()? {
            [0, _, _, _] => false,
            [1, _, _, _] => true,
            _ => return None,
        };
        let sampling = [rest.u32()?, rest.u32()?];
        let is_sorted = found.last().is_none_or(|last| last.name < name);
        if sampling != [1, 1] || found.len() == MOST_CHANNELS || !is_sorted {
            return None;
        }
        found.push(Channel {
            name,
            samples,
            is_linear,
        });
    }
}

/// The names of the channels of a list, up to where it is damaged.
fn names(list: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = Bytes(list);
    let names = std::iter::from_fn(move || {
        let name = rest.text().filter(|name| !name.is_empty())?;
        rest.take(16)?;
        Some(name)
    });
    names.take(MOST_CHANNELS)
}

impl<'a> Header<'a> {
    fn part(&self, is_tiled: bool, number: Option<u32>, table: usize) -> Result<Part<'a>, Fault> {
        let missing = |what: &str| {
            (
                "header".to_owned(),
                format!("the attribute {what} is missing"),
            )
        };
        let list = self.channels.ok_or_else(|| missing("channels"))?;
        let Some(channels) = channels(list) else {
            let reason = "the list is damaged, or a channel has not one sample per texel";
            return fault("attribute channels", reason);
        };
        let compression = self.compression.ok_or_else(|| missing("compression"))?;
        let Some(&compression) = COMPRESSIONS.get(usize::from(compression)) else {
            let reason = format!("compression {compression} is not supported");
            return fault("attribute compression", reason);
        };
        let window = |window: Option<Window>, name: &str| {
            let window = window.ok_or_else(|| missing(name))?;
            let Window { min, max } = window;
            let is_near = |side: i32| (-FARTHEST..=FARTHEST).contains(&side);
            if min.iter().chain(&max).all(|&side| is_near(side)) && (0..2).all(|i| min[i] <= max[i])
            {
                return Ok(window);
            }
            let place = format!("attribute {name}");
            fault(
                &place,
                format!("{min:?} to {max:?} is no rectangle of texels"),
            )
        };
        let tiles = is_tiled.then(|| self.tiles.ok_or_else(|| missing("tiles")));
        let tiles = tiles.transpose()?;
        let is_side = |side: u32| (1..=FARTHEST as u32).contains(&side);
        if let Some(tiles) = tiles.filter(|tiles| !tiles.iter().all(|&side| is_side(side))) {
            return fault("attribute tiles", format!("{tiles:?} is no size"));
        }
        Ok(Part {
            channels,
            compression,
            data: window(self.data, "dataWindow")?,
            display: window(self.display, "displayWindow")?,
            tiles,
            number,
            table,
            colors: Default::default(),
            layer: None,
            chromaticities: self.chromaticities,
        })
    }
}
