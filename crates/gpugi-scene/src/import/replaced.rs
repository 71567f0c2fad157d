//! What a file holds that no surface can have, or that gpugi cannot show as it is, and what it becomes instead.
//! Exporters write such values for degenerate faces; they cost a note, never the scene.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

/// What is replaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Broken {
    Normal,
    Tangent,
    /// Of a morph target.
    NormalOffset,
    Uv,
    Color,
    Face,
}

impl Display for Broken {
    fn fmt(&self, formatter: &mut Formatter) -> fmt::Result {
        formatter.write_str(match self {
            Self::Normal => "normals without a direction become those of the faces",
            Self::Tangent => "tangents without a direction become any along the surface",
            Self::NormalOffset => "offsets of normals or tangents that are not finite become 0",
            Self::Uv => "texture coordinates that are not finite become 0",
            Self::Color => "vertex colours that are not finite become white",
            Self::Face => "concave faces with more than 300 corners are not cut exactly",
        })
    }
}

/// How many of each kind were replaced, and where the first ones are.
#[derive(Debug, Default)]
pub struct Replaced(BTreeMap<Broken, (usize, String)>);

impl Replaced {
    /// Counts `count` more; `place` is where the first of them is.
    pub fn add(&mut self, broken: Broken, count: usize, place: &str) {
        if count > 0 {
            let place = || (0, place.to_owned());
            self.0.entry(broken).or_insert_with(place).0 += count;
        }
    }

    /// Replaces each of `values` that has a component that is not finite, and counts them.
    pub fn replace<const N: usize>(
        &mut self,
        values: &mut [[f32; N]],
        broken: Broken,
        with: [f32; N],
        place: &str,
    ) {
        let is_broken = |value: &&mut [f32; N]| !value.iter().all(|number| number.is_finite());
        let mut count = 0;
        for value in values.iter_mut().filter(is_broken) {
            *value = with;
            count += 1;
        }
        self.add(broken, count, place);
    }

    /// One note for each kind.
    pub fn notes(&self) -> impl Iterator<Item = String> {
        let all = self.0.iter();
        all.map(|(broken, (count, place))| format!("{place}: {broken} ({count} of them)"))
    }
}
