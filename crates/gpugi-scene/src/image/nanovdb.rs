//! Densities in NanoVDB files (.nvdb): OpenVDB's sparse grids in the layout that GPUs read.
//!
//! Museth, "NanoVDB: A GPU-Friendly and Portable VDB Data Structure for Real-Time Rendering and Simulation" (SIGGRAPH
//! Talks 2021). A file holds segments of grids. A grid is a tree: a root with a table of tiles, upper nodes of 32^3
//! entries, lower nodes of 16^3 and leaves of 8^3 values. An entry is a child or one value for its whole region.

#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::collections::HashSet;
use std::io::Read;
use std::ops::Range;

use flate2::read::ZlibDecoder;

use crate::import::budget::Budget;
use crate::{DensityGrid, ImportError};

/// What a file of segments begins with: until version 32.5, and since.
const SEGMENT: [&[u8]; 2] = [b"NanoVDB0", b"NanoVDB2"];
/// What a grid begins with since version 32.6; also a file that is nothing but grids.
const GRID: &[u8] = b"NanoVDB1";
const MAJOR_VERSION: u32 = 32;

const SEGMENT_HEADER: usize = 16;
const GRID_HEAD: usize = 176;
const GRID_DATA: usize = 672;
const ROOT: usize = 64;
const TILE: usize = 32;
const LEAF_TABLE: usize = 96;
/// Bits of a coordinate within a root tile's region, which is as wide as an upper node's.
const TILE_BITS: u32 = 12;

/// Whether a file is a NanoVDB file.
pub(crate) fn is_nanovdb(bytes: &[u8]) -> bool {
    bytes.starts_with(b"NanoVDB")
}

/// Reads the grid named `density`, or else the first one, as densities: the box of its active voxels.
pub(crate) fn decode_nanovdb(
    name: &str,
    bytes: &[u8],
    budget: &Budget,
) -> Result<DensityGrid, ImportError> {
    let fail = |place: &str| {
        let place = place.to_owned();
        move |reason: String| ImportError::new(name, &place, reason)
    };
    let grids = stored_grids(bytes).map_err(fail("header"))?;
    let named = grids.iter().find(|grid| grid.name == "density");
    let stored = named.or(grids.first());
    let stored = stored.ok_or_else(|| fail("header")("the file holds no grid".to_owned()))?;
    let place = format!("grid {:?}", stored.name);
    let grid = unpacked(stored, budget).map_err(fail(&place))?;
    densities(&grid, budget).map_err(fail(&place))
}

/// A grid in a file.
struct Stored<'a> {
    name: String,
    codec: u16,
    /// Of the grid when it is unpacked (bytes).
    size: u64,
    bytes: &'a [u8],
}

/// All grids of a file, in order.
fn stored_grids(file: &[u8]) -> Result<Vec<Stored<'_>>, String> {
    if file.starts_with(GRID) {
        return Ok(vec![Stored {
            name: text(part(file, 40..296)?),
            codec: 0,
            size: u64_at(file, 32)?,
            bytes: file,
        }]);
    }
    let mut grids = Vec::new();
    let mut at = 0;
    while at < file.len() {
        if !SEGMENT.contains(&part(file, at..at + 8)?) {
            return Err(format!("there is no segment of grids at byte {at}"));
        }
        check_version(u32_at(file, at + 8)?)?;
        let count = u16_at(file, at + 12)?;
        at += SEGMENT_HEADER;
        let mut heads = Vec::new();
        for _ in 0..count {
            let head = part(file, at..at + GRID_HEAD)?;
            let name_bytes = u32_at(head, 136)? as usize;
            at += GRID_HEAD;
            heads.push((head, text(part(file, at..at.saturating_add(name_bytes))?)));
            at += name_bytes;
        }
        for (head, name) in heads {
            let stored = usize::try_from(u64_at(head, 8)?).unwrap_or(usize::MAX);
            let bytes = part(file, at..at.saturating_add(stored))?;
            at += stored;
            grids.push(Stored {
                name,
                codec: u16_at(head, 168)?,
                size: u64_at(head, 0)?,
                bytes,
            });
        }
    }
    Ok(grids)
}

fn check_version(version: u32) -> Result<(), String> {
    let [major, minor, patch] = [version >> 21, version >> 10 & 0x7ff, version & 0x3ff];
    match major {
        MAJOR_VERSION => Ok(()),
        _ => Err(format!(
            "version {major}.{minor}.{patch} of NanoVDB is not read: write the file with version {MAJOR_VERSION}"
        )),
    }
}

/// The bytes of a grid, unpacked.
fn unpacked<'a>(stored: &Stored<'a>, budget: &Budget) -> Result<Cow<'a, [u8]>, String> {
    match stored.codec {
        0 => Ok(Cow::Borrowed(stored.bytes)),
        1 => {
            budget.check(stored.size, 1)?;
            let packed = u64_at(stored.bytes, 0)?;
            let packed = usize::try_from(packed).unwrap_or(usize::MAX);
            let packed = part(stored.bytes, 8..packed.saturating_add(8))?;
            let mut grid = Vec::new();
            ZlibDecoder::new(packed)
                .take(stored.size)
                .read_to_end(&mut grid)
                .map_err(|error| format!("the compressed grid is damaged: {error}"))?;
            Ok(Cow::Owned(grid))
        }
        2 => Err(
            "the grid is compressed by Blosc, which is not read: write the file with ZIP or without compression \
             (nanovdb_convert --zip)"
                .to_owned(),
        ),
        codec => Err(format!("compression {codec} is unknown")),
    }
}

/// How leaves store their values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Codes {
    /// 32-bit floats.
    Float,
    /// Codes of 2^n bits between the leaf's least value and its greatest.
    Quantized(u32),
    /// Quantized, with n in each leaf.
    OwnBits,
}

fn codes_of(value_type: u32) -> Result<Codes, String> {
    Ok(match value_type {
        1 => Codes::Float,
        13 => Codes::Quantized(2),
        14 => Codes::Quantized(3),
        15 => Codes::Quantized(4),
        16 => Codes::OwnBits,
        other => {
            let name = match other {
                2 => "double",
                3..=5 | 10 => "integer",
                6 | 7 | 17 | 18 => "vector",
                9 => "half",
                8 | 11 => "mask",
                _ => "other",
            };
            return Err(format!(
                "values of type {other} ({name}) are not read: write 32-bit floats, Fp4, Fp8, Fp16 or FpN"
            ));
        }
    })
}

/// The densities in the box of a grid's active voxels.
fn densities(grid: &[u8], budget: &Budget) -> Result<DensityGrid, String> {
    let magic = part(grid, 0..8)?;
    if magic != GRID && magic != SEGMENT[0] {
        return Err("this is no grid".to_owned());
    }
    check_version(u32_at(grid, 16)?)?;
    if u32_at(grid, 632)? == 1 {
        return Err(
            "a level set holds distances, not densities: write a fog volume (OpenVDB's sdfToFogVolume)"
                .to_owned(),
        );
    }
    let codes = codes_of(u32_at(grid, 636)?)?;
    let root = child(grid, GRID_DATA, u64_at(grid, GRID_DATA + 24)?)?;
    let corner = |at: usize| -> Result<[i64; 3], String> {
        let mut corner = [0; 3];
        for (axis, value) in corner.iter_mut().enumerate() {
            *value = i64::from(u32_at(grid, root + at + 4 * axis)? as i32);
        }
        Ok(corner)
    };
    let (least, greatest) = (corner(0)?, corner(12)?);
    let mut size = [0; 3];
    for (axis, size) in size.iter_mut().enumerate() {
        let cells = greatest[axis] - least[axis] + 1;
        *size = u32::try_from(cells).map_err(|_| {
            format!("there are no active voxels between {least:?} and {greatest:?}")
        })?;
    }
    let [x, y, z] = size;
    if size.contains(&0) {
        return Err(format!(
            "there are no active voxels between {least:?} and {greatest:?}"
        ));
    }
    let cells = (u64::from(x) * u64::from(y)).saturating_mul(z.into());
    budget
        .charge(cells, size_of::<f32>())
        .map_err(|reason| format!("{x} x {y} x {z} voxels: {reason}"))?;
    let background = f32_at(grid, root + 28)?;
    let mut tree = Tree {
        grid,
        codes,
        least,
        size,
        values: vec![background; cells as usize],
    };
    let mut origins = HashSet::new();
    for tile in 0..u32_at(grid, root + 24)? as usize {
        let at = tile
            .checked_mul(TILE)
            .and_then(|offset| offset.checked_add(root + ROOT));
        let tile = at.ok_or_else(too_short)?;
        let key = u64_at(grid, tile)?;
        // 21 bits each; of the tile's number along an axis, the lowest 20 are the coordinate's highest.
        let origin =
            [42, 21, 0].map(|shift| i64::from(((key >> shift) as u32) << TILE_BITS) as i32);
        let origin = origin.map(i64::from);
        if !origins.insert(origin) {
            return Err(format!("two tiles of the root are at {origin:?}"));
        }
        match u64_at(grid, tile + 8)? {
            0 => tree.fill(origin, TILE_BITS, f32_at(grid, tile + 20)?),
            offset => tree.node(child(grid, root, offset)?, origin, &UPPER)?,
        }
    }
    Ok(DensityGrid {
        size,
        values: tree.values,
    })
}

/// A kind of inner node.
struct Inner {
    /// Bits of a coordinate within the node, and within an entry.
    bits: u32,
    entry_bits: u32,
    child_mask: usize,
    table: usize,
    /// What its children are; `None` for leaves.
    below: Option<&'static Self>,
}

const UPPER: Inner = Inner {
    bits: TILE_BITS,
    entry_bits: 7,
    child_mask: 4128,
    table: 8256,
    below: Some(&LOWER),
};
const LOWER: Inner = Inner {
    bits: 7,
    entry_bits: 3,
    child_mask: 544,
    table: 1088,
    below: None,
};

/// A grid, and what is read of it: voxels in the box of `size` from `least` on. Nothing else is visited, so the time is
/// bounded by the size of the box, whatever the file says.
struct Tree<'a> {
    grid: &'a [u8],
    codes: Codes,
    least: [i64; 3],
    size: [u32; 3],
    values: Vec<f32>,
}

impl Tree<'_> {
    /// The part within the box of a region of 2^bits voxels along each axis, relative to `origin`.
    fn inside(&self, origin: [i64; 3], bits: u32) -> [Range<i64>; 3] {
        std::array::from_fn(|axis| {
            let from = (self.least[axis] - origin[axis]).max(0);
            let end = self.least[axis] - origin[axis] + i64::from(self.size[axis]);
            from..end.min(1 << bits)
        })
    }

    /// Index of a voxel in the box.
    fn index(&self, voxel: [i64; 3]) -> usize {
        let [x, y, z] = std::array::from_fn(|axis| (voxel[axis] - self.least[axis]) as usize);
        let [width, height, _] = self.size.map(|side| side as usize);
        (z * height + y) * width + x
    }

    /// Gives all voxels of a region one value.
    fn fill(&mut self, origin: [i64; 3], bits: u32, value: f32) {
        let [xs, ys, zs] = self.inside(origin, bits);
        if xs.is_empty() {
            return;
        }
        for z in zs {
            for y in ys.clone() {
                let first = self.index([origin[0] + xs.start, origin[1] + y, origin[2] + z]);
                self.values[first..first + (xs.end - xs.start) as usize].fill(value);
            }
        }
    }

    fn node(&mut self, at: usize, origin: [i64; 3], kind: &Inner) -> Result<(), String> {
        let Inner {
            bits,
            entry_bits,
            child_mask,
            table,
            below,
        } = *kind;
        let entries = self.inside(origin, bits).map(|voxels| {
            let end = (voxels.end + (1 << entry_bits) - 1) >> entry_bits;
            voxels.start >> entry_bits..end
        });
        let [xs, ys, zs] = entries;
        let side = bits - entry_bits;
        for x in xs {
            for y in ys.clone() {
                for z in zs.clone() {
                    let entry = ((x << side | y) << side | z) as usize;
                    let place = [x, y, z].map(|coordinate| coordinate << entry_bits);
                    let from: [i64; 3] = std::array::from_fn(|axis| origin[axis] + place[axis]);
                    let mask = part(
                        self.grid,
                        at + child_mask + entry / 8..at + child_mask + entry / 8 + 1,
                    )?;
                    let value = at + table + 8 * entry;
                    if mask[0] >> (entry % 8) & 1 == 0 {
                        self.fill(from, entry_bits, f32_at(self.grid, value)?);
                        continue;
                    }
                    let node = child(self.grid, at, u64_at(self.grid, value)?)?;
                    match below {
                        Some(below) => self.node(node, from, below)?,
                        None => self.leaf(node, from)?,
                    }
                }
            }
        }
        Ok(())
    }

    fn leaf(&mut self, at: usize, origin: [i64; 3]) -> Result<(), String> {
        let grid = self.grid;
        let table = at + LEAF_TABLE;
        let log_bits = match self.codes {
            Codes::Float => None,
            Codes::Quantized(log_bits) => Some(log_bits),
            // The highest three bits of the flags.
            Codes::OwnBits => Some(u32_at(grid, at + 12)? >> 29),
        };
        if log_bits.is_some_and(|log_bits| log_bits > 4) {
            return Err("a leaf has codes of more than 16 bits".to_owned());
        }
        let [xs, ys, zs] = self.inside(origin, 3);
        for x in xs {
            for y in ys.clone() {
                for z in zs.clone() {
                    let voxel = (x << 6 | y << 3 | z) as usize;
                    let value = match log_bits {
                        None => f32_at(grid, table + 4 * voxel)?,
                        Some(log_bits) => {
                            let bit = voxel << log_bits;
                            let word = u32_at(grid, table + bit / 32 * 4)?;
                            let code = word >> (bit % 32) & ((1 << (1 << log_bits)) - 1);
                            code as f32 * f32_at(grid, at + 84)? + f32_at(grid, at + 80)?
                        }
                    };
                    let index = self.index([origin[0] + x, origin[1] + y, origin[2] + z]);
                    self.values[index] = value;
                }
            }
        }
        Ok(())
    }
}

/// Where a node is: `offset` bytes, with a sign, from the one that names it.
fn child(grid: &[u8], from: usize, offset: u64) -> Result<usize, String> {
    let at = (from as i64).checked_add(offset as i64);
    let at = at.and_then(|at| usize::try_from(at).ok());
    at.filter(|&at| at < grid.len()).ok_or_else(too_short)
}

fn too_short() -> String {
    "the file ends too early, or an offset in it is wrong".to_owned()
}

fn part(bytes: &[u8], range: Range<usize>) -> Result<&[u8], String> {
    bytes.get(range).ok_or_else(too_short)
}

fn word<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], String> {
    let word = bytes.get(at..).and_then(|rest| rest.first_chunk());
    word.copied().ok_or_else(too_short)
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, String> {
    word(bytes, at).map(u16::from_le_bytes)
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, String> {
    word(bytes, at).map(u32::from_le_bytes)
}

fn u64_at(bytes: &[u8], at: usize) -> Result<u64, String> {
    word(bytes, at).map(u64::from_le_bytes)
}

fn f32_at(bytes: &[u8], at: usize) -> Result<f32, String> {
    word(bytes, at).map(f32::from_le_bytes)
}

/// Text up to its terminating 0.
fn text(bytes: &[u8]) -> String {
    let text = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(text).into_owned()
}
