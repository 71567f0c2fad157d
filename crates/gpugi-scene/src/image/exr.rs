//! OpenEXR. The decoder of the image crate trusts what a file says: sizes, windows and the lengths of chunks. So this
//! reads the header and the table of chunks first, checks them against the file's length and the limits, and gives the
//! decoder a file that holds nothing but what was checked: one part, one level, and the attributes that matter.
//!
//! Format: "OpenEXR File Layout", <https://openexr.com/en/latest/OpenEXRFileLayout.html>

use std::io::Cursor;

use image::DynamicImage;
use image::codecs::openexr::OpenExrDecoder;

use super::decode::{check_expansion, check_size, finish};
use crate::ImportError;
use crate::import::budget::ImageLimits;
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

/// Decodes the first part that has the channels R, G and B. `texel`: bytes per decoded texel.
pub(super) fn decode(
    name: &str,
    bytes: &[u8],
    limits: &ImageLimits,
    texel: u64,
) -> Result<DynamicImage, ImportError> {
    let error = |(place, reason): Fault| ImportError::new(name, place, reason);
    let (part, table) = read_parts(bytes).map_err(error)?;
    check_size(name, part.display.size(), texel, limits)?;
    check_expansion(name, part.display.size(), texel, bytes.len(), true, limits)?;
    check_stored(name, &part, bytes.len(), limits)?;
    let chunks = part.chunks(bytes, table).map_err(error)?;
    let checked = part.written(&chunks);
    let decoder = OpenExrDecoder::new(Cursor::new(checked));
    let decoder = decoder.map_err(|error| ImportError::new(name, "header", error))?;
    finish(name, decoder, limits, texel)
}

/// Where a file is wrong, and why.
type Fault = (String, String);

fn fault<T>(place: &str, reason: impl Into<String>) -> Result<T, Fault> {
    Err((place.to_owned(), reason.into()))
}

/// A rectangle of texels, both corners included.
#[derive(Clone, Copy)]
struct Window {
    min: [i32; 2],
    max: [i32; 2],
}

impl Window {
    fn size(&self) -> (u32, u32) {
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
    line_order: Option<u8>,
    /// Width and height of tiles.
    tiles: Option<[u32; 2]>,
    chunks: Option<u64>,
    kind: Option<&'a [u8]>,
}

/// A part that can be decoded.
struct Part<'a> {
    channels: &'a [u8],
    /// Bytes of a texel over all channels.
    texel: u64,
    /// Samples of a texel: the number of channels.
    samples: u64,
    compression: u8,
    data: Window,
    display: Window,
    line_order: u8,
    tiles: Option<[u32; 2]>,
    /// Its number, if the file has several parts.
    number: Option<u32>,
}

/// A sequence of bytes that is read from its start.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.first_chunk().copied()
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_le_bytes)
    }

    /// Text that ends with a zero byte.
    fn text(&mut self) -> Option<&'a [u8]> {
        let end = self.0.iter().take(256).position(|&byte| byte == 0)?;
        let text = self.take(end)?;
        self.take(1)?;
        Some(text)
    }

    fn window(&mut self) -> Option<Window> {
        let mut corner = || Some([self.i32()?, self.i32()?]);
        Some(Window {
            min: corner()?,
            max: corner()?,
        })
    }
}

/// The first part that has RGB, and where its table of chunks starts.
fn read_parts(bytes: &[u8]) -> Result<(Part<'_>, usize), Fault> {
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
    let mut table = bytes.len() - rest.0.len();
    let mut deep = version & FLAG_DEEP != 0 && !has_parts;
    for (number, header) in headers.iter().enumerate() {
        let is_tiled = match header.kind {
            Some(kind) => kind.starts_with(b"tiled"),
            None => version & FLAG_TILES != 0,
        };
        deep |= header.kind.is_some_and(|kind| kind.starts_with(b"deep"));
        if !deep && header.channels.is_some_and(has_rgb) {
            let number = has_parts.then_some(number as u32);
            return Ok((header.part(is_tiled, number)?, table));
        }
        let skipped = header.chunks.and_then(|chunks| chunks.checked_mul(8));
        let skipped = skipped.and_then(|bytes| usize::try_from(bytes).ok());
        table = skipped
            .and_then(|bytes| table.checked_add(bytes))
            .ok_or_else(|| ("header".to_owned(), "chunkCount is missing".to_owned()))?;
        deep = false;
    }
    fault(
        "header",
        "no part has the channels R, G and B, or only a deep one",
    )
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
            (b"lineOrder", b"lineOrder") => {
                header.line_order = content.array().map(|[order]| order);
                header.line_order.is_some()
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
            _ => true,
        };
        if !is_whole {
            return fault(&place(), format!("{length} bytes are too few"));
        }
    }
}

/// The channels of a list: name and bytes per sample. `None` if the list is damaged, or a channel has fewer samples
/// than texels.
fn channels(list: &[u8]) -> Option<Vec<(&[u8], u64)>> {
    let mut rest = Bytes(list);
    let mut found = Vec::new();
    loop {
        let name = rest.text()?;
        if name.is_empty() {
            return rest.0.is_empty().then_some(found);
        }
        let size = match rest.u32()? {
            0 | 2 => 4,
            1 => 2,
            _ => return None,
        };
        let _is_linear = rest.u32()?;
        let sampling = [rest.u32()?, rest.u32()?];
        let is_sorted = found.last().is_none_or(|&(last, _)| last < name);
        if sampling != [1, 1] || found.len() == MOST_CHANNELS || !is_sorted {
            return None;
        }
        found.push((name, size));
    }
}

fn has_rgb(list: &[u8]) -> bool {
    let mut names = Bytes(list);
    let mut found = 0;
    while let Some(name) = names.text().filter(|name| !name.is_empty()) {
        found += u32::from(matches!(name, b"R" | b"G" | b"B"));
        if names.take(16).is_none() {
            break;
        }
    }
    found >= 3
}

impl<'a> Header<'a> {
    fn part(&self, is_tiled: bool, number: Option<u32>) -> Result<Part<'a>, Fault> {
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
        if compression > 9 {
            let reason = format!("compression {compression} is not supported");
            return fault("attribute compression", reason);
        }
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
            channels: list,
            texel: channels.iter().map(|(_, size)| size).sum(),
            samples: channels.len() as u64,
            compression,
            data: window(self.data, "dataWindow")?,
            display: window(self.display, "displayWindow")?,
            line_order: self.line_order.unwrap_or(0).min(2),
            tiles,
            number,
        })
    }
}

/// Rejects a part whose stored texels, of all channels, exceed the limits.
fn check_stored(
    name: &str,
    part: &Part,
    given: usize,
    limits: &ImageLimits,
) -> Result<(), ImportError> {
    let in_data_window = |mut error: ImportError| {
        error.place = "attribute dataWindow".into();
        error
    };
    let size = part.data.size();
    check_size(name, size, part.texel, limits).map_err(in_data_window)?;
    check_expansion(name, size, part.texel, given, true, limits).map_err(in_data_window)
}

impl Part<'_> {
    /// Width and height of a block, before it is cut at the data window.
    fn block(&self) -> (u32, u32) {
        const LINES: [u32; 10] = [1, 1, 1, 16, 32, 16, 32, 32, 32, 256];
        match self.tiles {
            Some([width, height]) => (width, height),
            None => (self.data.size().0, LINES[usize::from(self.compression)]),
        }
    }

    /// The chunks of the finest level, each with its place, its size and its content, without the number of the part.
    /// They are inside the file and inside the data window.
    fn chunks<'b>(&self, bytes: &'b [u8], table: usize) -> Result<Vec<&'b [u8]>, Fault> {
        let (width, height) = self.data.size();
        let block = self.block();
        let counts = [width.div_ceil(block.0), height.div_ceil(block.1)];
        let count = u64::from(counts[0]) * u64::from(counts[1]);
        // Each has an entry in the table, and a place and a size of its own.
        if count * 16 > bytes.len() as u64 {
            let reason = format!("{count} chunks are in no file of {} bytes", bytes.len());
            return fault("table of chunks", reason);
        }
        let mut offsets = Bytes(bytes.get(table..).unwrap_or_default());
        let mut chunks = Vec::with_capacity(count as usize);
        let mut is_used = vec![false; count as usize];
        for index in 0..count {
            let place = format!("chunk {index}");
            let offset = offsets.array().map(u64::from_le_bytes);
            let offset = offset.and_then(|offset| usize::try_from(offset).ok());
            let chunk = offset.and_then(|offset| self.chunk(bytes.get(offset..)?, counts));
            let Some((number, chunk, content)) = chunk else {
                return fault(
                    &place,
                    "it lies outside the file or outside the data window",
                );
            };
            if std::mem::replace(&mut is_used[number], true) {
                return fault(&place, "another chunk has the same place");
            }
            let at = [number as u32 % counts[0], number as u32 / counts[0]];
            self.check_content(content, at)
                .map_err(|reason| (place, reason.to_owned()))?;
            chunks.push(chunk);
        }
        Ok(chunks)
    }

    /// The chunk at the start of `bytes`: its number, itself, and its content.
    fn chunk<'b>(&self, bytes: &'b [u8], counts: [u32; 2]) -> Option<(usize, &'b [u8], &'b [u8])> {
        let mut rest = Bytes(bytes);
        if let Some(number) = self.number
            && rest.u32()? != number
        {
            return None;
        }
        let start = rest.0;
        let at = if self.tiles.is_some() {
            let at = [rest.u32()?, rest.u32()?];
            if [rest.u32()?, rest.u32()?] != [0, 0] {
                return None;
            }
            at
        } else {
            let line = rest.i32()?.checked_sub(self.data.min[1])?;
            let line = u32::try_from(line).ok()?;
            let lines = self.block().1;
            if !line.is_multiple_of(lines) {
                return None;
            }
            [0, line / lines]
        };
        if at[0] >= counts[0] || at[1] >= counts[1] {
            return None;
        }
        let length = rest.u32()? as usize;
        let content = rest.take(length)?;
        let number = at[1] as usize * counts[0] as usize + at[0] as usize;
        let chunk = &start[..start.len() - rest.0.len()];
        Some((number, chunk, content))
    }

    /// Checks what a compressed block says about its own sizes, which decide how much the decoder allocates.
    /// `at`: the block's column and row.
    fn check_content(&self, content: &[u8], at: [u32; 2]) -> Result<(), &'static str> {
        const DWA: [u8; 2] = [8, 9];
        let (whole, block) = (self.data.size(), self.block());
        // The last block of a row or a column may be smaller.
        let width = block.0.min(whole.0 - at[0] * block.0);
        let height = block.1.min(whole.1 - at[1] * block.1);
        let [width, height] = [width, height].map(u64::from);
        let most = width * height * self.texel;
        if content.len() as u64 > 2 * most + 65_536 {
            return Err("it is far larger than its texels");
        }
        if !DWA.contains(&self.compression) || content.len() as u64 == most {
            return Ok(());
        }
        // Version; bytes of what is not transformed, before and after compression; bytes of AC and DC coefficients, both
        // compressed; bytes of runs compressed, packed and unpacked; numbers of AC and DC coefficients; how AC is
        // compressed.
        let mut counters = [0; 11];
        let mut rest = Bytes(content);
        for counter in &mut counters {
            *counter = rest.array().map_or(u64::MAX, u64::from_le_bytes);
        }
        let coefficients = width.next_multiple_of(8) * height.next_multiple_of(8) * self.samples;
        let least = [
            2,
            most,
            u64::MAX,
            u64::MAX,
            u64::MAX,
            u64::MAX,
            2 * most,
            most,
        ];
        let most = [least.as_slice(), &[coefficients, coefficients, 1]].concat();
        let fits = counters
            .iter()
            .zip(&most)
            .all(|(counter, most)| counter <= most);
        let stored = counters[2..6]
            .iter()
            .try_fold(0_u64, |sum, &size| sum.checked_add(size));
        if fits && stored.is_some_and(|stored| stored <= rest.0.len() as u64) {
            Ok(())
        } else {
            Err("its sizes do not fit its texels")
        }
    }

    /// A file of this part alone, at its finest level.
    fn written(&self, chunks: &[&[u8]]) -> Vec<u8> {
        let flags = if self.tiles.is_some() { FLAG_TILES } else { 0 };
        let mut file = [&MAGIC[..], &(VERSION | flags).to_le_bytes()].concat();
        let mut attribute = |name: &str, kind: &str, value: &[u8]| {
            file.extend([name.as_bytes(), b"\0", kind.as_bytes(), b"\0"].concat());
            file.extend((value.len() as u32).to_le_bytes());
            file.extend(value);
        };
        let window = |window: &Window| {
            let corners = [window.min, window.max].concat();
            corners
                .into_iter()
                .flat_map(i32::to_le_bytes)
                .collect::<Vec<u8>>()
        };
        let one = 1_f32.to_le_bytes();
        attribute("channels", "chlist", self.channels);
        attribute("compression", "compression", &[self.compression]);
        attribute("dataWindow", "box2i", &window(&self.data));
        attribute("displayWindow", "box2i", &window(&self.display));
        attribute("lineOrder", "lineOrder", &[self.line_order]);
        attribute("pixelAspectRatio", "float", &one);
        attribute("screenWindowCenter", "v2f", &[0; 8]);
        attribute("screenWindowWidth", "float", &one);
        if let Some(size) = self.tiles {
            let size: Vec<u8> = size.into_iter().flat_map(u32::to_le_bytes).collect();
            // One level.
            attribute("tiles", "tiledesc", &[&size[..], &[0]].concat());
        }
        file.push(0);
        let mut at = (file.len() + chunks.len() * 8) as u64;
        for chunk in chunks {
            file.extend(at.to_le_bytes());
            at += chunk.len() as u64;
        }
        file.extend(chunks.concat());
        file
    }
}
