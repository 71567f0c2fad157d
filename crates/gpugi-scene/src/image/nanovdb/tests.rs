//! Files are written here by the layout of NanoVDB 32, and read back.

use std::collections::BTreeMap;
use std::io::Write;

use base64::Engine;
use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::*;
use crate::Limits;

const VERSION: u32 = 32 << 21 | 6 << 10;
const UPPER_BYTES: usize = 270_400;
const LOWER_BYTES: usize = 33_856;
const FLOAT: u32 = 1;
const FP4: u32 = 13;
const FP8: u32 = 14;
const FP16: u32 = 15;
const FPN: u32 = 16;
/// Value of a region of 8 x 8 x 8 voxels that has no leaf.
const TILE_VALUE: f32 = 0.75;

type Voxel = [i64; 3];

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

fn put_corners(bytes: &mut [u8], at: usize, corners: [Voxel; 2]) {
    for (number, value) in corners.as_flattened().iter().enumerate() {
        put(bytes, at + 4 * number, &(*value as i32).to_le_bytes());
    }
}

/// Least multiples of 2^bits.
fn origin(voxel: Voxel, bits: u32) -> Voxel {
    voxel.map(|coordinate| coordinate >> bits << bits)
}

/// Number of an entry of a node whose entries have 2^bits voxels along each axis.
fn entry(voxel: Voxel, node: Voxel, bits: u32, side_bits: u32) -> usize {
    let [x, y, z]: Voxel = std::array::from_fn(|axis| (voxel[axis] - node[axis]) >> bits);
    ((x << side_bits | y) << side_bits | z) as usize
}

fn leaf(value_type: u32, value: impl Fn(Voxel) -> f32, at: Voxel) -> Vec<u8> {
    let values = (0..512).map(|voxel: i64| {
        value([
            at[0] + (voxel >> 6),
            at[1] + (voxel >> 3 & 7),
            at[2] + (voxel & 7),
        ])
    });
    let values: Vec<f32> = values.collect();
    if value_type == FLOAT {
        let mut bytes = vec![0; LEAF_TABLE];
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        return bytes;
    }
    // With a number of bits for each leaf, leaves have different ones.
    let log_bits = match value_type {
        FP4 => 2,
        FP8 => 3,
        FP16 => 4,
        _ => 3 + (at[0] >> 3 & 1) as u32,
    };
    let least = values.iter().copied().fold(f32::MAX, f32::min);
    let greatest = values.iter().copied().fold(f32::MIN, f32::max);
    let most = ((1_u32 << (1 << log_bits)) - 1) as f32;
    let quantum = (greatest - least) / most;
    let mut bytes = vec![0; LEAF_TABLE + (64 << log_bits)];
    put(&mut bytes, 12, &(log_bits << 29).to_le_bytes());
    put(&mut bytes, 80, &least.to_le_bytes());
    put(&mut bytes, 84, &quantum.to_le_bytes());
    for (voxel, value) in values.iter().enumerate() {
        let code = if quantum > 0.0 {
            ((value - least) / quantum).round() as u32
        } else {
            0
        };
        for bit in 0..1 << log_bits {
            let place = (voxel << log_bits) + bit;
            bytes[LEAF_TABLE + place / 8] |= ((code >> bit & 1) as u8) << (place % 8);
        }
    }
    bytes
}

/// A grid with leaves wherever `is_leaf`, by their first voxel, and tiles of [`TILE_VALUE`] elsewhere in the box.
fn grid(
    corners: [Voxel; 2],
    value_type: u32,
    is_leaf: impl Fn(Voxel) -> bool,
    value: impl Fn(Voxel) -> f32 + Copy,
) -> Vec<u8> {
    // Uppers with their lowers with their leaves, by their first voxels.
    let mut uppers: BTreeMap<Voxel, BTreeMap<Voxel, Vec<Voxel>>> = BTreeMap::new();
    let [first, last] = corners.map(|corner| origin(corner, 3));
    for x in (first[0]..=last[0]).step_by(8) {
        for y in (first[1]..=last[1]).step_by(8) {
            for z in (first[2]..=last[2]).step_by(8) {
                let at = [x, y, z];
                let lowers = uppers.entry(origin(at, 12)).or_default();
                lowers.entry(origin(at, 7)).or_default().push(at);
            }
        }
    }
    let root = GRID_DATA + 64;
    let mut bytes = vec![0; root + ROOT + TILE * uppers.len()];
    put(&mut bytes, 0, GRID);
    put(&mut bytes, 16, &VERSION.to_le_bytes());
    put(&mut bytes, 40, b"density");
    put(&mut bytes, 632, &2_u32.to_le_bytes());
    put(&mut bytes, 636, &value_type.to_le_bytes());
    put(&mut bytes, GRID_DATA + 24, &64_u64.to_le_bytes());
    put_corners(&mut bytes, root, corners);
    put(&mut bytes, root + 24, &(uppers.len() as u32).to_le_bytes());
    for (number, (upper_at, lowers)) in uppers.into_iter().enumerate() {
        let upper = bytes.len();
        bytes.resize(upper + UPPER_BYTES, 0);
        let tile = root + ROOT + TILE * number;
        let key = (upper_at.iter()).fold(0_u64, |key, &coordinate| {
            key << 21 | u64::from(coordinate as i32 as u32 >> 12)
        });
        put(&mut bytes, tile, &key.to_le_bytes());
        put(&mut bytes, tile + 8, &((upper - root) as u64).to_le_bytes());
        for (lower_at, leaves) in lowers {
            let lower = bytes.len();
            bytes.resize(lower + LOWER_BYTES, 0);
            let at = entry(lower_at, upper_at, 7, 5);
            bytes[upper + UPPER.child_mask + at / 8] |= 1 << (at % 8);
            put(
                &mut bytes,
                upper + UPPER.table + 8 * at,
                &((lower - upper) as u64).to_le_bytes(),
            );
            for leaf_at in leaves {
                let at = entry(leaf_at, lower_at, 3, 4);
                let place = lower + LOWER.table + 8 * at;
                if is_leaf(leaf_at) {
                    let offset = (bytes.len() - lower) as u64;
                    bytes[lower + LOWER.child_mask + at / 8] |= 1 << (at % 8);
                    put(&mut bytes, place, &offset.to_le_bytes());
                    bytes.extend(leaf(value_type, value, leaf_at));
                } else {
                    put(&mut bytes, place, &TILE_VALUE.to_le_bytes());
                }
            }
        }
    }
    let size = bytes.len() as u64;
    put(&mut bytes, 32, &size.to_le_bytes());
    bytes
}

/// A segment with these grids and their names.
fn file(codec: u16, grids: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let stored = |grid: &Vec<u8>| match codec {
        1 => {
            let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
            packed.write_all(grid).unwrap();
            let packed = packed.finish().unwrap();
            [&(packed.len() as u64).to_le_bytes()[..], &packed].concat()
        }
        _ => grid.clone(),
    };
    let mut bytes = SEGMENT[1].to_vec();
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((grids.len() as u16).to_le_bytes());
    bytes.extend(codec.to_le_bytes());
    for (name, grid) in grids {
        let mut head = [0; GRID_HEAD];
        put(&mut head, 0, &(grid.len() as u64).to_le_bytes());
        put(&mut head, 8, &(stored(grid).len() as u64).to_le_bytes());
        put(&mut head, 136, &(name.len() as u32 + 1).to_le_bytes());
        put(&mut head, 168, &codec.to_le_bytes());
        bytes.extend(head);
        bytes.extend(name.as_bytes());
        bytes.push(0);
    }
    for (_, grid) in grids {
        bytes.extend(stored(grid));
    }
    bytes
}

fn read(bytes: &[u8]) -> Result<DensityGrid, String> {
    let budget = Budget::new(&Limits::default(), bytes.len());
    assert!(is_nanovdb(bytes));
    let found = decode_nanovdb("a.nvdb", bytes, &budget);
    found.map_err(|error| format!("{}: {}", error.place, error.reason))
}

/// Around the origin, so that there are eight tiles of the root; wider than a lower node.
const CORNERS: [Voxel; 2] = [[-5, -9, -130], [10, 3, 6]];

fn value([x, y, z]: Voxel) -> f32 {
    (x + 8) as f32 + 0.125 * (y + 16) as f32 + 1e-3 * (z + 136) as f32
}

fn is_leaf(at: Voxel) -> bool {
    at[2] != -64
}

/// The greatest difference from `value`.
fn error(found: &DensityGrid) -> f32 {
    let [[x0, y0, z0], [x1, y1, z1]] = CORNERS;
    assert_eq!(
        found.size.map(i64::from),
        [x1 - x0 + 1, y1 - y0 + 1, z1 - z0 + 1]
    );
    let mut values = found.values.iter();
    let mut error = 0.0_f32;
    for z in z0..=z1 {
        for y in y0..=y1 {
            for x in x0..=x1 {
                let expected = match is_leaf(origin([x, y, z], 3)) {
                    true => value([x, y, z]),
                    false => TILE_VALUE,
                };
                error = error.max((values.next().unwrap() - expected).abs());
            }
        }
    }
    assert!(values.next().is_none());
    error
}

#[test]
fn grids_are_read_as_they_were_written() {
    for codec in [0, 1] {
        let grid = grid(CORNERS, FLOAT, is_leaf, value);
        assert_eq!(error(&read(&file(codec, &[("smoke", grid)])).unwrap()), 0.0);
    }
    // A file of nothing but a grid.
    assert_eq!(
        error(&read(&grid(CORNERS, FLOAT, is_leaf, value)).unwrap()),
        0.0
    );
}

#[test]
fn quantized_values_are_close() {
    // The values of a leaf differ by less than 8.
    for (value_type, least, greatest) in [
        (FP4, 0.02, 8.0 / 15.0),
        (FP8, 1e-3, 8.0 / 255.0),
        (FP16, 0.0, 8.0 / 65535.0),
        (FPN, 1e-3, 8.0 / 255.0),
    ] {
        let grid = grid(CORNERS, value_type, is_leaf, value);
        let error = error(&read(&file(0, &[("density", grid)])).unwrap());
        assert!((least..greatest).contains(&error), "{value_type}: {error}");
    }
}

#[test]
fn density_is_preferred() {
    let grid = |value: f32| grid([[0; 3], [7; 3]], FLOAT, |_| true, move |_| value);
    let grids = [("temperature", grid(1.0)), ("density", grid(2.0))];
    let both = file(0, &grids);
    assert_eq!(read(&both).unwrap().values, [2.0; 512]);
    // In another segment.
    let apart = [file(1, &grids[..1]), file(0, &grids[1..])].concat();
    assert_eq!(read(&apart).unwrap().values, [2.0; 512]);
    assert_eq!(read(&file(0, &grids[..1])).unwrap().values, [1.0; 512]);
}

#[test]
fn tiles_of_the_root_and_the_background_fill_what_they_cover() {
    let mut grid = grid([[-2, 0, 0], [1, 0, 0]], FLOAT, |_| true, |_| 1.0);
    let root = GRID_DATA + 64;
    // The left tile becomes one value, the right one moves away.
    put(&mut grid, root + ROOT + 8, &0_u64.to_le_bytes());
    put(&mut grid, root + ROOT + 20, &3.0_f32.to_le_bytes());
    put(&mut grid, root + ROOT + TILE, &(7_u64 << 42).to_le_bytes());
    put(&mut grid, root + 28, &0.5_f32.to_le_bytes());
    assert_eq!(read(&grid).unwrap().values, [3.0, 3.0, 0.5, 0.5]);
}

#[test]
fn what_is_wrong_is_said() {
    let grid = grid([[0; 3], [7; 3]], FLOAT, |_| true, |_| 1.0);
    let root = GRID_DATA + 64;
    let with = |at: usize, bytes: &[u8]| {
        let mut damaged = grid.clone();
        put(&mut damaged, at, bytes);
        read(&damaged).unwrap_err()
    };
    let large = 2_000_000_000_i32.to_le_bytes();
    for (reason, expected) in [
        (with(16, &(31_u32 << 21).to_le_bytes()), "version 31.0.0"),
        (with(632, &1_u32.to_le_bytes()), "level set"),
        (with(636, &2_u32.to_le_bytes()), "type 2 (double)"),
        (with(GRID_DATA + 24, &u64::MAX.to_le_bytes()), "offset"),
        (with(root + 12, &(-1_i32).to_le_bytes()), "no active voxels"),
        (with(root + 12, &large), "2000000001 x 8 x 8 voxels"),
        (
            with(root + 24, &u32::MAX.to_le_bytes()),
            "two tiles of the root",
        ),
        (
            with(root + ROOT + 8, &(1_u64 << 62).to_le_bytes()),
            "offset",
        ),
        (with(root + ROOT + 8, &(-9000_i64).to_le_bytes()), "offset"),
        (
            read(&file(2, &[("density", grid.clone())])).unwrap_err(),
            "Blosc",
        ),
        (read(&file(0, &[])).unwrap_err(), "no grid"),
        (
            read(&[&file(0, &[]), &b"more of it"[..]].concat()).unwrap_err(),
            "byte 16",
        ),
    ] {
        assert!(reason.contains(expected), "{reason}");
    }
    // Wherever the file ends.
    let whole = [
        file(0, &[("density", grid.clone())]),
        file(1, &[("density", grid)]),
    ];
    for file in whole {
        for part in 8..200.min(file.len()) {
            assert!(read(&file[..part]).is_err(), "{part}");
        }
        assert!(read(&file[..file.len() - 1]).is_err());
    }
}

/// Six voxels, written by OpenVDB 10.0.1 and `nanovdb_convert --zip` (NanoVDB 32.4.2).
const WRITTEN_BY_OPENVDB: &str = "\
TmFub1ZEQjACEAAEAQABAOAaDgAAAAAAlwUAAAAAAAAYAghsWggAAAYAAAAAAAAAAQAAAAAAAAAAAAAAAAAAwAAAAAAAAPC/AAAA\
AAAAAAAAAAAAAAAQQAAAAAAAACRAAAAAAAAAMED+/////////wAAAAADAAAACQAAAA8AAAAAAAAAAADwPwAAAAAAAPA/AAAAAAAA\
8D8IAAAABQAAAAMAAAADAAAAAQAAAAAAAAAAAAAAAAAAAAEAAAACEAAEZGVuc2l0eQCPBQAAAAAAAHic7d2xbtNQFABQx2mjViok\
M106MDDmC2KDmBkYGJhaCQaWMsDClg9gZUFCysLSf0BkYOQj8gWID4Ca59iV2zSkUSl5bXOOdHXv87Oeb6QkfnIj9cnB4etnjx/1\
vx89PSqCtJdsDJJKK8Tk3t1p/eLl4ZtXb98l62uYXTxe5px5458zx2ctO39V61w4P67HX8/O9/Iq369zP5/fX5Vbiy82tf/jzjSP\
DnameVIfrxdONkO06zitU+fjopLU52yH6J45fzio+hxnGx+fz3n9k6L4XWSjRU3+KrLJ3sbC17H3cGvu8dP9na7ThasBAAAAAAAA\
ADdF9fuI8vcJJwEAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAALGO8vxO7haiKoBVye6ZO47YFAAAAAAAAALdKK3YDSZ41AQAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAA8P+Nv23FbgEAAAAAAAAAuALtEJ06b4fohkijdgQAAACsUit2AwAAAMAKjLIk6eehyL/sdrPZ2fGD\
zdW3BAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAABca8dFZbZO47YFRNcKMRw0AQAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\
AAAAAADX0/h9K+r1i6DsoD1Tp1G7Albh4m+fPGsCAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAABYxqQX9/+XAwBxtEN06rwd\
ohsijdoR10XbO2HNjbIk6eehyL/sdrNz0x+qtP9ppU2dM/4c9/oAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAArLfjolIP\
00su02rK4aAJALit3OcWKfcW5eagXQ0vu79Ikq2TIs+aAAAudjvvmeXeolOV5f4i/7fVRlkTMcW+PgCsr/LZxWaI7bJO22efXzSj\
3vIrTsJ9vZcn032KZ0c3w8Re7MpM3/sAa698dlHuLbrV8O9/Hxkuu2I/bwK4PJ8h4Ob6AzkYm4Y=";

#[test]
fn files_of_openvdb_are_read() {
    let bytes = base64::engine::general_purpose::STANDARD.decode(WRITTEN_BY_OPENVDB);
    let found = read(&bytes.unwrap()).unwrap();
    assert_eq!(found.size, [6, 11, 16]);
    let mut values = [0.0; 6 * 11 * 16];
    for voxel in 0..6 {
        values[voxel + 6 * (2 * voxel + 11 * 3 * voxel)] = 0.5 * voxel as f32 + 0.25;
    }
    assert_eq!(found.values, values);
}
