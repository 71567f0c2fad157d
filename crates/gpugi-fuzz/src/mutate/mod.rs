//! Mutations that know a format's structure, so that the damage gets past its checksums and its parser.

mod binary;
mod container;
mod json;
mod text;

pub use container::glb;

use crate::random::Random;

/// A file and those beside it: name and content. The first one is imported.
pub type Case = Vec<(String, Vec<u8>)>;

/// Damages a case in one to four places. `donor` gives parts that are spliced in.
pub fn mutate(random: &mut Random, case: &Case, donor: &Case) -> Case {
    let mut mutated = case.clone();
    for _ in 0..=random.below(4) {
        let file = if random.once_in(3) {
            random.below(mutated.len())
        } else {
            0
        };
        let given = donor.iter().find(|(name, _)| *name == mutated[file].0);
        let given = given.map_or(&[][..], |(_, bytes)| bytes);
        let (name, bytes) = &mut mutated[file];
        let extension = name.rsplit('.').next().unwrap_or_default();
        if random.once_in(12) {
            binary::mutate(random, bytes, given);
            continue;
        }
        match extension {
            "gltf" => json::mutate_text(random, bytes),
            "glb" => container::mutate_glb(random, bytes, given),
            "png" => container::mutate_png(random, bytes, given),
            "checkpoint" => container::mutate_checkpoint(random, bytes, given),
            "obj" | "mtl" => text::mutate(random, bytes),
            // A header of text before numbers.
            "ply" | "hdr" if random.once_in(2) => text::mutate(random, bytes),
            _ => binary::mutate(random, bytes, given),
        }
    }
    mutated
}
