//! Mutations inside containers with lengths and checksums, which are written anew.

use super::{binary, json};
use crate::random::Random;

/// Magic number and checksum of a checkpoint (bytes).
const CHECKPOINT_START: usize = 16 + 32;

pub fn mutate_glb(random: &mut Random, bytes: &mut Vec<u8>, donor: &[u8]) {
    let Some((mut document, mut binary)) = split_glb(bytes) else {
        return binary::mutate(random, bytes, donor);
    };
    if random.below(3) > 0 || binary.is_empty() {
        json::mutate_text(random, &mut document);
    } else {
        let donor = split_glb(donor).map(|(_, binary)| binary);
        binary::mutate(random, &mut binary, &donor.unwrap_or_default());
    }
    *bytes = glb(&document, &binary);
}

fn split_glb(bytes: &[u8]) -> Option<(Vec<u8>, Vec<u8>)> {
    let length = |at: usize| {
        let bytes = bytes.get(at..)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*bytes) as usize)
    };
    let json_length = length(12)?;
    let document = bytes.get(20..20_usize.checked_add(json_length)?)?.to_vec();
    let rest = bytes.get(20 + json_length..)?;
    Some((document, rest.get(8..).unwrap_or_default().to_vec()))
}

/// A binary glTF file.
pub fn glb(document: &[u8], binary: &[u8]) -> Vec<u8> {
    let mut file = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, content, fill) in [(b"JSON", document, b' '), (b"BIN\0", binary, 0)] {
        let length = content.len().next_multiple_of(4);
        file.extend((length as u32).to_le_bytes());
        file.extend(kind);
        file.extend(content);
        file.resize(file.len() + length - content.len(), fill);
    }
    let length = file.len() as u32;
    file[8..12].copy_from_slice(&length.to_le_bytes());
    file
}

pub fn mutate_png(random: &mut Random, bytes: &mut Vec<u8>, donor: &[u8]) {
    let mut chunks = Vec::new();
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some(length) = rest.first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        let Some(chunk) = length.checked_add(8).and_then(|end| rest.get(4..end)) else {
            break;
        };
        chunks.push(chunk.to_vec());
        rest = rest.get(length + 12..).unwrap_or_default();
    }
    if chunks.is_empty() {
        return binary::mutate(random, bytes, donor);
    }
    let at = random.below(chunks.len());
    match random.below(6) {
        0 => drop(chunks.remove(at)),
        1 => chunks.insert(at, chunks[at].clone()),
        _ => binary::mutate(random, &mut chunks[at], donor),
    }
    bytes.truncate(8);
    for chunk in chunks {
        bytes.extend((chunk.len().saturating_sub(4) as u32).to_be_bytes());
        bytes.extend(&chunk);
        bytes.extend(crc(&chunk).to_be_bytes());
    }
}

/// CRC-32 as PNG defines it.
fn crc(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & 0_u32.wrapping_sub(crc & 1));
        }
    }
    !crc
}

pub fn mutate_checkpoint(random: &mut Random, bytes: &mut Vec<u8>, donor: &[u8]) {
    if bytes.len() < CHECKPOINT_START {
        return binary::mutate(random, bytes, donor);
    }
    let mut content = bytes.split_off(CHECKPOINT_START);
    binary::mutate(
        random,
        &mut content,
        donor.get(CHECKPOINT_START..).unwrap_or_default(),
    );
    bytes[16..].copy_from_slice(blake3::hash(&content).as_bytes());
    bytes.extend(content);
}
