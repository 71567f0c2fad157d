//! Repeatable randomness for tests.

/// Marsaglia's 64-bit xorshift: the same numbers everywhere.
pub struct Random(pub u64);

impl Random {
    /// A number below `bound`.
    pub fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 33) % bound as u64) as usize
    }

    /// `bytes` damaged in one to three places: cut short, overwritten, words swapped for nasty ones, parts repeated.
    pub fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let nasty: [&[u8]; 9] = [
            b"nan",
            b"-1",
            b"4294967295",
            b"99999999999999999999",
            b"1e39",
            b"",
            b"\n",
            b"\xff\xfe",
            b"0/0/0",
        ];
        let mut damaged = bytes.to_vec();
        for _ in 0..=self.below(3) {
            if damaged.is_empty() {
                break;
            }
            let at = self.below(damaged.len());
            match self.below(5) {
                0 => damaged.truncate(at),
                1 => damaged[at] = self.below(256) as u8,
                2 => damaged[at] ^= 1 << self.below(8),
                3 => {
                    let is_space = |&byte: &u8| byte.is_ascii_whitespace();
                    let length = damaged[at..].iter().position(is_space).unwrap_or(0);
                    let word = nasty[self.below(nasty.len())];
                    damaged.splice(at..at + length, word.iter().copied());
                }
                _ => {
                    let length = self.below(20).min(damaged.len() - at);
                    let part = damaged[at..at + length].to_vec();
                    damaged.splice(at..at, part);
                }
            }
        }
        damaged
    }
}
