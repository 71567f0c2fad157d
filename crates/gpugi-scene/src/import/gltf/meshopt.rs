//! EXT_meshopt_compression: buffer views compressed by meshoptimizer.

use bytemuck::{Pod, Zeroable};
use meshopt::{
    decode_filter_exp, decode_filter_oct, decode_filter_quat, decode_index_buffer,
    decode_index_sequence, decode_vertex_buffer,
};

use super::schema::Meshopt;
use crate::import::quoted;

const MOST_BYTES_PER_BYTE: u64 = 1024;

/// Decodes `bytes` to `count` elements of `byte_stride` bytes. The caller has checked that product against its limits.
pub fn decode(view: &Meshopt, bytes: &[u8]) -> Result<Vec<u8>, String> {
    let stride = view.byte_stride;
    // The densest encoding stores 256 vertices' worth of four bytes in one byte. A file that claims more is damaged; do
    // not allocate that much.
    if view.count.saturating_mul(stride) / MOST_BYTES_PER_BYTE > bytes.len() as u64 {
        return Err(format!(
            "{} bytes cannot hold {} elements",
            bytes.len(),
            view.count
        ));
    }
    let count = usize::try_from(view.count).map_err(|_| "count is too large")?;
    // The decoder has nothing to say but a number.
    let failed = |_: meshopt::Error| "the compressed data is damaged".to_owned();
    let wrong_stride = || {
        format!(
            "byteStride {stride} does not fit mode {}",
            quoted(&view.mode)
        )
    };
    match (view.mode.as_str(), stride) {
        ("ATTRIBUTES", _) => {
            let decoded = vertices(bytes, count, stride).ok_or_else(wrong_stride)?;
            filter(&view.filter, stride, decoded.map_err(failed)?)
        }
        ("TRIANGLES", _) if !count.is_multiple_of(3) => {
            Err(format!("{count} indices are no whole triangles"))
        }
        ("TRIANGLES", 2) => decode_index_buffer::<u16>(bytes, count)
            .map(|indices| bytemuck::cast_slice(&indices).to_vec())
            .map_err(failed),
        ("TRIANGLES", 4) => decode_index_buffer::<u32>(bytes, count)
            .map(|indices| bytemuck::cast_slice(&indices).to_vec())
            .map_err(failed),
        ("INDICES", 2) => decode_index_sequence::<u16>(bytes, count)
            .map(|indices| bytemuck::cast_slice(&indices).to_vec())
            .map_err(failed),
        ("INDICES", 4) => decode_index_sequence::<u32>(bytes, count)
            .map(|indices| bytemuck::cast_slice(&indices).to_vec())
            .map_err(failed),
        ("TRIANGLES" | "INDICES", _) => Err(wrong_stride()),
        (mode, _) => Err(format!("mode \"{}\" is unknown", quoted(mode))),
    }
}

/// A vertex of `N` bytes. A type of its own, because arrays longer than 32 do not implement `Default`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(transparent)]
struct Vertex<const N: usize>([u8; N]);

impl<const N: usize> Default for Vertex<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// Compiled for each of 64 strides, so its caller does all that does not depend on the stride.
fn vertices_of<const N: usize>(bytes: &[u8], count: usize) -> Result<Vec<u8>, meshopt::Error> {
    let vertices = decode_vertex_buffer::<Vertex<N>>(bytes, count)?;
    Ok(bytemuck::cast_slice(&vertices).to_vec())
}

/// The decoder takes the stride as a type. `None` unless the stride is a multiple of 4 up to 256.
fn vertices(bytes: &[u8], count: usize, stride: u64) -> Option<Result<Vec<u8>, meshopt::Error>> {
    macro_rules! by_stride {
        ($($quarter:literal)*) => {
            match stride {
                $(stride if stride == 4 * $quarter => Some(vertices_of::<{ 4 * $quarter }>(bytes, count)),)*
                _ => None,
            }
        };
    }
    by_stride!(
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64
    )
}

/// Undoes the filter that made the vertices easier to compress.
fn filter(name: &str, stride: u64, bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    match (name, stride) {
        ("NONE", _) => Ok(bytes),
        ("OCTAHEDRAL", 4) => {
            let mut vertices: Vec<[i8; 4]> = bytemuck::pod_collect_to_vec(&bytes);
            decode_filter_oct(&mut vertices);
            Ok(bytemuck::cast_slice(&vertices).to_vec())
        }
        ("OCTAHEDRAL", 8) => {
            let mut vertices: Vec<[i16; 4]> = bytemuck::pod_collect_to_vec(&bytes);
            decode_filter_oct(&mut vertices);
            Ok(bytemuck::cast_slice(&vertices).to_vec())
        }
        ("QUATERNION", 8) => {
            let mut vertices: Vec<[i16; 4]> = bytemuck::pod_collect_to_vec(&bytes);
            decode_filter_quat(&mut vertices);
            Ok(bytemuck::cast_slice(&vertices).to_vec())
        }
        ("EXPONENTIAL", _) => {
            // Each word is decoded separately, so the vertex size does not matter.
            let mut words: Vec<[u32; 1]> = bytemuck::pod_collect_to_vec(&bytes);
            decode_filter_exp(&mut words);
            Ok(bytemuck::cast_slice(&words).to_vec())
        }
        ("OCTAHEDRAL" | "QUATERNION", _) => {
            Err(format!("byteStride {stride} does not fit filter {name}"))
        }
        _ => Err(format!("filter \"{}\" is unknown", quoted(name))),
    }
}
