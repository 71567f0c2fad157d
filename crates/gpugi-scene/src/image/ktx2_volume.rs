//! Densities in KTX2 files: 3D textures of one channel.

use half::f16;
use ktx2::Format;

use super::ktx2::{Channel, Head, finest_level, stored_texels, write_head};
use crate::import::budget::Budget;
use crate::{DensityGrid, ImportError};

/// Reads a 3D texture of one channel as densities: u runs along x, v along y, and slices along z.
pub(crate) fn decode_volume(
    name: &str,
    bytes: &[u8],
    budget: &Budget,
) -> Result<DensityGrid, ImportError> {
    let error = |reason: String| ImportError::new(name, "header", reason);
    let (stored, channels, channel) = stored_texels(name, bytes)?;
    let size = [stored.pixel_width, stored.pixel_height, stored.pixel_depth];
    let [width, height, depth] = size;
    if size.contains(&0) || stored.layer_count > 1 || stored.face_count != 1 {
        return Err(error("a density needs a 3D texture".to_owned()));
    }
    if channels != 1 || channel == (Channel::Byte { srgb: true }) {
        return Err(error(
            "a density needs one linear channel: R8_UNORM, R16_SFLOAT or R32_SFLOAT".to_owned(),
        ));
    }
    // The product of three sides may exceed 64 bits.
    let cells = u64::from(width) * u64::from(height);
    let cells = cells.saturating_mul(depth.into());
    budget
        .charge(cells, size_of::<f32>())
        .map_err(|reason| error(format!("{width} x {height} x {depth} texels: {reason}")))?;
    let wanted = cells.saturating_mul(channel.size() as u64);
    let texels = finest_level(bytes).unwrap_or_default();
    if (texels.len() as u64) < wanted {
        return Err(ImportError::new(
            name,
            "level 0",
            format!("{} bytes of texels where {wanted} are needed", texels.len()),
        ));
    }
    let texels = texels[..wanted as usize].chunks_exact(channel.size());
    Ok(DensityGrid {
        size,
        values: texels.map(|texel| value(channel, texel)).collect(),
    })
}

fn value(channel: Channel, texel: &[u8]) -> f32 {
    match (channel, texel) {
        (Channel::Half, &[a, b]) => f16::from_le_bytes([a, b]).to_f32(),
        (Channel::Float, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
        _ => f32::from(texel[0]) / 255.0,
    }
}

/// A KTX2 file of 32-bit floats.
pub(crate) fn encode_volume(density: &DensityGrid) -> std::io::Result<Vec<u8>> {
    let [width, height, depth] = density.size;
    let head = Head {
        format: Format::R32_SFLOAT,
        size: [width, height],
        depth,
        layers: 0,
        faces: 1,
        level_bytes: &[size_of_val(&density.values[..]) as u64],
    };
    let mut bytes = Vec::new();
    write_head(&mut bytes, &head)?;
    let values = density.values.iter().flat_map(|value| value.to_le_bytes());
    bytes.extend(values);
    Ok(bytes)
}
