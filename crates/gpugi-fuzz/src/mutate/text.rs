//! Mutations of lines and words.

use crate::random::Random;

const WORDS: [&str; 24] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1",
    "2",
    "1e39",
    "1e38",
    "-3e38",
    "1e-45",
    "1e-7",
    "4294967295",
    "4294967296",
    "99999999999999999999",
    "-9223372036854775808",
    "1/1/1",
    "-1/-1/-1",
    "0/0/0",
    "..",
    "#",
    "\\",
    "\\\n",
    "\u{fffd}\u{1F600}",
    "",
];

const LINES: [&str; 12] = [
    "f 1 2 3",
    "f 1 2 3 4 5 1 2",
    "usemtl plain",
    "g some group",
    "mtllib a.mtl a.mtl",
    "vt 0.5",
    "v 1e30 0 0",
    "map_Kd -s 1 2 -o 3 a.png",
    "map_d a.png",
    "norm -bm 2 a.png",
    "newmtl plain",
    "element vertex 100000",
];

pub fn mutate(random: &mut Random, bytes: &mut Vec<u8>) {
    if bytes.is_empty() {
        return;
    }
    let at = random.below(bytes.len());
    let word = word_at(bytes, at);
    let line = line_at(bytes, at);
    match random.below(8) {
        0..=2 => {
            let new = random.pick(&WORDS).as_bytes();
            bytes.splice(word, new.iter().copied());
        }
        3 => drop(bytes.drain(line)),
        4 => {
            let part = bytes[line.clone()].to_vec();
            let times = 1 << random.below(6);
            if bytes.len() + part.len() * times < 1 << 17 {
                bytes.splice(line.start..line.start, part.repeat(times));
            }
        }
        5 => {
            let new = format!("{}\n", random.pick(&LINES));
            bytes.splice(line.start..line.start, new.into_bytes());
        }
        6 => {
            // A word from elsewhere.
            let from = random.below(bytes.len());
            let other = bytes[word_at(bytes, from)].to_vec();
            bytes.splice(word, other);
        }
        _ => {
            let times = 1 << random.below(12);
            let part = bytes[word.clone()].to_vec();
            if bytes.len() + part.len() * times < 1 << 17 {
                bytes.splice(word.end..word.end, [b" ", &part[..]].concat().repeat(times));
            }
        }
    }
}

fn word_at(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    around(bytes, at, u8::is_ascii_whitespace)
}

fn line_at(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let range = around(bytes, at, |&byte| byte == b'\n');
    range.start..(range.end + 1).min(bytes.len())
}

fn around(bytes: &[u8], at: usize, ends: impl Fn(&u8) -> bool) -> std::ops::Range<usize> {
    let start = bytes[..at].iter().rposition(&ends).map_or(0, |end| end + 1);
    let length = bytes[start..].iter().position(&ends);
    start..length.map_or(bytes.len(), |length| start + length)
}
