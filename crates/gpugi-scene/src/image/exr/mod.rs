//! OpenEXR. Sizes, windows and lengths of chunks in a file may be anything. So the header and the table of chunks are
//! read first and checked against the file's length and the limits. Then one block after the other is unpacked, and its
//! samples go to their texels.
//!
//! Format: "OpenEXR File Layout", <https://openexr.com/en/latest/OpenEXRFileLayout.html>

mod header;

use ::exr::math::RoundingMode;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{
    ChannelDescription, Compression, IntegerBounds, LevelMode, LineOrder, SampleType, Text,
    TileDescription,
};
use ::exr::meta::header::Header;
use ::exr::prelude::{Vec2, f16};

use glam::{DMat3, DVec3};

use super::primaries::{Chromaticities, rec709_from};
use super::size::{RADIANCE_TEXEL, check_expansion, check_size};
use crate::import::budget::ImageLimits;
use crate::import::quoted;
use crate::{Image, ImportError, Pixels};
use header::{Bytes, Fault, Part, fault, read_part};

/// Copies of a block that its decompression makes: sections, planes and sums of several channels.
const COPIES: u64 = 6;

/// Decodes the first part that has the channels R, G and B, or else Y, or else those of a layer, to
/// [`Pixels::Rgba32Float`] with alpha 1. Texels outside the data window are 0.
pub(super) fn decode(name: &str, bytes: &[u8], limits: &ImageLimits) -> Result<Image, ImportError> {
    let error = |(place, reason): Fault| ImportError::new(name, place, reason);
    let part = read_part(bytes).map_err(error)?;
    part.check_limits(name, bytes.len(), limits)?;
    part.check_blocks(bytes).map_err(error)?;
    let (width, height) = part.display.size();
    let mut texels = part.texels(bytes).map_err(error)?;
    if let Some(layer) = &part.layer {
        tracing::warn!("{name}: its layer {} is read", quoted(layer));
    }
    if let Some(chromaticities) = &part.chromaticities {
        convert(name, chromaticities, &mut texels);
    }
    Ok(Image {
        name: name.to_owned(),
        width,
        height,
        pixels: Pixels::Rgba32Float(texels),
    })
}

/// Converts texels of these chromaticities to Rec. 709.
fn convert(name: &str, chromaticities: &Chromaticities, texels: &mut [f32]) {
    let Some(rec709_from_file) = rec709_from(chromaticities) else {
        tracing::warn!("{name}: its chromaticities make no colours: those of Rec. 709 are used");
        return;
    };
    if rec709_from_file == DMat3::IDENTITY {
        return;
    }
    for [r, g, b, _] in texels.as_chunks_mut::<4>().0 {
        let color = rec709_from_file * DVec3::from([*r, *g, *b].map(f64::from));
        [*r, *g, *b] = color.as_vec3().to_array();
    }
}

/// A block of texels, as it is stored.
struct Block<'a> {
    /// Column and row among the blocks.
    at: [u32; 2],
    /// Its first texel, relative to the data window.
    corner: [u32; 2],
    /// Width and height, cut at the data window (texels).
    size: [u32; 2],
    content: &'a [u8],
}

impl Part<'_> {
    /// Bytes of a stored texel over all channels.
    fn texel(&self) -> u64 {
        let sizes = self.channels.iter();
        sizes
            .map(|channel| channel.samples.bytes_per_sample() as u64)
            .sum()
    }

    /// Width and height of a block, before it is cut at the data window.
    fn block_size(&self) -> [u32; 2] {
        let lines = self.compression.scan_lines_per_block() as u32;
        self.tiles.unwrap_or([self.data.size().0, lines])
    }

    /// Columns and rows of blocks.
    fn block_counts(&self) -> [u32; 2] {
        let (width, height) = self.data.size();
        let size = self.block_size();
        [width.div_ceil(size[0]), height.div_ceil(size[1])]
    }

    /// Rejects a part whose texels, those that are stored or those of the picture, exceed the limits. `given`: bytes of
    /// the file.
    fn check_limits(
        &self,
        name: &str,
        given: usize,
        limits: &ImageLimits,
    ) -> Result<(), ImportError> {
        let shown = self.display.size();
        check_size(name, shown, RADIANCE_TEXEL, limits)?;
        check_expansion(name, shown, RADIANCE_TEXEL, given, true, limits)?;
        let stored = self.data.size();
        let block = self.block_size();
        let block_bytes =
            u64::from(block[0].min(stored.0)) * u64::from(block[1].min(stored.1)) * self.texel();
        let texels = u64::from(shown.0) * u64::from(shown.1) * RADIANCE_TEXEL;
        check_size(name, stored, self.texel(), limits)
            .and_then(|()| check_expansion(name, stored, self.texel(), given, true, limits))
            .and_then(|()| {
                let checked = limits.check_bytes(texels.saturating_add(COPIES * block_bytes));
                checked.map_err(|reason| ImportError::new(name, "", reason))
            })
            .map_err(|mut error| {
                error.place = "attribute dataWindow".into();
                error
            })
    }

    /// Checks that the finest level has all its blocks, inside the file and inside the data window.
    fn check_blocks(&self, bytes: &[u8]) -> Result<(), Fault> {
        let [columns, rows] = self.block_counts();
        let count = u64::from(columns) * u64::from(rows);
        // Each has an entry in the table, and a place and a size of its own.
        if count * 16 > bytes.len() as u64 {
            let reason = format!("{count} chunks are in no file of {} bytes", bytes.len());
            return fault("table of chunks", reason);
        }
        let mut is_used = vec![false; count as usize];
        for index in 0..is_used.len() {
            let place = format!("chunk {index}");
            let Some(block) = self.block(bytes, index) else {
                let reason = "it lies outside the file or outside the data window";
                return fault(&place, reason);
            };
            let number = block.at[1] as usize * columns as usize + block.at[0] as usize;
            if std::mem::replace(&mut is_used[number], true) {
                return fault(&place, "another chunk has the same place");
            }
            self.check_content(&block)
                .map_err(|reason| (place, reason.to_owned()))?;
        }
        Ok(())
    }

    /// The block to which an entry in the table of chunks leads.
    fn block<'b>(&self, bytes: &'b [u8], index: usize) -> Option<Block<'b>> {
        let entry = bytes.get(self.table.checked_add(index.checked_mul(8)?)?..)?;
        let offset = Bytes(entry).array().map(u64::from_le_bytes)?;
        let mut rest = Bytes(bytes.get(usize::try_from(offset).ok()?..)?);
        if let Some(number) = self.number
            && rest.u32()? != number
        {
            return None;
        }
        let block = self.block_size();
        let at = if self.tiles.is_some() {
            let at = [rest.u32()?, rest.u32()?];
            if [rest.u32()?, rest.u32()?] != [0, 0] {
                return None;
            }
            at
        } else {
            let line = rest.i32()?.checked_sub(self.data.min[1])?;
            let line = u32::try_from(line).ok()?;
            if !line.is_multiple_of(block[1]) {
                return None;
            }
            [0, line / block[1]]
        };
        let counts = self.block_counts();
        if at[0] >= counts[0] || at[1] >= counts[1] {
            return None;
        }
        let length = rest.u32()? as usize;
        let (width, height) = self.data.size();
        let corner = [at[0] * block[0], at[1] * block[1]];
        Some(Block {
            at,
            corner,
            // The last block of a row or a column may be smaller.
            size: [
                block[0].min(width - corner[0]),
                block[1].min(height - corner[1]),
            ],
            content: rest.take(length)?,
        })
    }

    /// Checks what a compressed block says about its own sizes, which decide how much its decompression allocates.
    fn check_content(&self, block: &Block) -> Result<(), &'static str> {
        let [width, height] = block.size.map(u64::from);
        let most = width * height * self.texel();
        // What compression would make larger is stored as it is.
        if block.content.len() as u64 > most {
            return Err("it is larger than its texels");
        }
        let is_dwa = matches!(
            self.compression,
            Compression::DWAA(_) | Compression::DWAB(_)
        );
        if !is_dwa || block.content.len() as u64 == most {
            return Ok(());
        }
        // Version; bytes of what is not transformed, before and after compression; bytes of AC and DC coefficients, both
        // compressed; bytes of runs compressed, packed and unpacked; numbers of AC and DC coefficients; how AC is
        // compressed.
        let mut counters = [0; 11];
        let mut rest = Bytes(block.content);
        for counter in &mut counters {
            *counter = rest.array().map_or(u64::MAX, u64::from_le_bytes);
        }
        let coefficients =
            width.next_multiple_of(8) * height.next_multiple_of(8) * self.channels.len() as u64;
        let most = [
            2,
            most,
            u64::MAX,
            u64::MAX,
            u64::MAX,
            u64::MAX,
            2 * most,
            most,
            coefficients,
            coefficients,
            1,
        ];
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

    /// The texels of the picture: red, green, blue and 1.
    fn texels(&self, bytes: &[u8]) -> Result<Vec<f32>, Fault> {
        let header = self.decoder_header();
        let (width, height) = self.display.size();
        let mut texels = [0.0, 0.0, 0.0, 1.0].repeat(width as usize * height as usize);
        let [columns, rows] = self.block_counts();
        for index in 0..columns as usize * rows as usize {
            let block = self.block(bytes, index).expect("it was checked");
            let [left, top] = block.corner.map(|side| side as i32);
            let [across, down] = block.size.map(|side| side as usize);
            let unpacked = self.compression.decompress_image_section_from_le(
                &header,
                block.content.to_vec(),
                IntegerBounds::new((left, top), (across, down)),
                false,
            );
            let unpacked =
                unpacked.map_err(|error| (format!("chunk {index}"), error.to_string()))?;
            self.place(&block, &unpacked, &mut texels);
        }
        Ok(texels)
    }

    /// Copies the samples of a block to their texels. `samples`: line by line, the channels of each one after the other.
    fn place(&self, block: &Block, samples: &[u8], texels: &mut [f32]) {
        let (width, height) = self.display.size();
        let first = |axis: usize| {
            i64::from(block.corner[axis]) + i64::from(self.data.min[axis])
                - i64::from(self.display.min[axis])
        };
        // The columns of the block that the picture shows.
        let shown = |first: i64, size: u32, most: u32| {
            let start = (-first).clamp(0, i64::from(size));
            let end = (i64::from(most) - first).clamp(start, i64::from(size));
            start as usize..end as usize
        };
        let columns = shown(first(0), block.size[0], width);
        if columns.is_empty() {
            return;
        }
        let line = block.size[0] as usize * self.texel() as usize;
        for row in shown(first(1), block.size[1], height) {
            let y = (first(1) + row as i64) as usize;
            let mut rest = &samples[row * line..(row + 1) * line];
            for channel in &self.channels {
                let size = channel.samples.bytes_per_sample();
                let (own, others) = rest.split_at(size * block.size[0] as usize);
                rest = others;
                let own = &own[columns.start * size..columns.end * size];
                let x = (first(0) + columns.start as i64) as usize;
                for (color, name) in self.colors.iter().enumerate() {
                    if name != channel.name {
                        continue;
                    }
                    let target = texels[(y * width as usize + x) * 4..].chunks_exact_mut(4);
                    for (texel, sample) in target.zip(own.chunks_exact(size)) {
                        texel[color] = float(channel.samples, sample);
                    }
                }
            }
        }
    }

    /// The header as decompression reads it.
    fn decoder_header(&self) -> Header {
        let channels = self.channels.iter().map(|channel| {
            let name = Text::from_slice_unchecked(channel.name);
            ChannelDescription::new(name, channel.samples, channel.is_linear)
        });
        let (width, height) = self.data.size();
        let blocks = match self.tiles {
            None => BlockDescription::ScanLines,
            Some([width, height]) => BlockDescription::Tiles(TileDescription {
                tile_size: Vec2(width as usize, height as usize),
                level_mode: LevelMode::Singular,
                rounding_mode: RoundingMode::Down,
            }),
        };
        let size = Vec2(width as usize, height as usize);
        Header::new(Text::default(), size, channels.collect()).with_encoding(
            self.compression,
            blocks,
            LineOrder::Increasing,
        )
    }
}

/// A sample as a float. `bytes`: in the order of this machine.
fn float(kind: SampleType, bytes: &[u8]) -> f32 {
    match (kind, bytes) {
        (SampleType::F16, &[a, b]) => f16::from_ne_bytes([a, b]).to_f32(),
        (SampleType::F32, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
        (SampleType::U32, &[a, b, c, d]) => u32::from_ne_bytes([a, b, c, d]) as f32,
        _ => unreachable!("samples have the size of their kind"),
    }
}
