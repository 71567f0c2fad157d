//! Mutations of bytes: numbers of every width, parts removed, repeated and moved.

use crate::random::Random;

/// Numbers at the edges of types and of what sizes may be.
const NUMBERS: [u64; 22] = [
    0,
    1,
    2,
    3,
    7,
    8,
    16,
    127,
    128,
    255,
    256,
    1023,
    32_767,
    65_535,
    65_536,
    (1 << 24) - 1,
    (1 << 31) - 1,
    1 << 31,
    (1 << 32) - 1,
    1 << 32,
    i64::MAX as u64,
    u64::MAX,
];

/// Floats that arithmetic trips over, as bits.
const FLOATS: [f32; 10] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN_POSITIVE,
    1e-45,
    -0.0,
    -1.0,
    1e18,
    1e-7,
];

/// Longest file (bytes): longer ones only take longer.
const LONGEST: usize = 1 << 18;

pub fn mutate(random: &mut Random, bytes: &mut Vec<u8>, donor: &[u8]) {
    // Most of what matters stands at the start.
    let reach = if random.once_in(2) {
        bytes.len().min(512)
    } else {
        bytes.len()
    };
    let at = random.below(reach);
    let old = bytes.get(at).copied().unwrap_or(0);
    let length = 1 << random.below(10);
    let range = at..at.saturating_add(length).min(bytes.len());
    match random.below(10) {
        0 => set(bytes, at, &[random.next() as u8]),
        1 => set(bytes, at, &[old ^ (1 << random.below(8))]),
        2 | 3 => {
            let number = *random.pick(&NUMBERS);
            let width = *random.pick(&[1, 2, 4, 8]);
            let mut number = number.to_le_bytes();
            if random.once_in(3) {
                number[..width].reverse();
            }
            set(bytes, at, &number[..width]);
        }
        4 => {
            // A little more or less than it was.
            let change = *random.pick(&[1, 255, 2, 254, 16]);
            set(bytes, at, &[old.wrapping_add(change)]);
        }
        5 => {
            let bits = random.pick(&FLOATS).to_le_bytes();
            set(bytes, at / 4 * 4, &bits);
        }
        6 => drop(bytes.drain(range)),
        7 => {
            let part = bytes[range].to_vec();
            let times = 1 + random.below(4);
            insert(bytes, at, &part.repeat(times));
        }
        8 if !donor.is_empty() => {
            let from = random.below(donor.len());
            let part = &donor[from..from.saturating_add(length).min(donor.len())];
            if random.once_in(2) {
                insert(bytes, at, part);
            } else {
                set(bytes, at, part);
            }
        }
        _ => bytes.truncate(at),
    }
}

fn set(bytes: &mut [u8], at: usize, new: &[u8]) {
    for (byte, new) in bytes.iter_mut().skip(at).zip(new) {
        *byte = *new;
    }
}

fn insert(bytes: &mut Vec<u8>, at: usize, part: &[u8]) {
    if bytes.len() + part.len() <= LONGEST {
        bytes.splice(at..at, part.iter().copied());
    }
}
