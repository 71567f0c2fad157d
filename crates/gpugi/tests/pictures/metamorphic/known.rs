//! What fails today. What no longer fails fails the test, so that the table stays true.

/// Relation, scene, and ways to light it in which the picture differs.
type Known = (&'static str, &'static str, &'static [&'static str]);

/// The atlas of the test has 64 texels a side: other charts have other texels.
const COARSE_TEXELS: &[Known] = &[("subdivided", "cornell", &["baked"])];

/// final-gather knows a reference point outside of a room by the backs of walls that it sees. Where these have surfaces of
/// their own, the point counts.
const HIDDEN_BACKS: &[Known] = &[
    ("backed", "glazed", &["live"]),
    ("backed", "glossy", &["live"]),
];

/// final-gather keeps its grid while a scene stays within it. Here it is that of the relation before, whose boxes are
/// larger.
const KEPT_GRID: &[Known] = &[
    ("on black ground", "glazed", &["live"]),
    ("on black ground", "glossy", &["live"]),
];

pub fn is_known(relation: &str, scene: &str, way: &str) -> bool {
    let all = [COARSE_TEXELS, HIDDEN_BACKS, KEPT_GRID];
    let is_it = |known: &&Known| known.0 == relation && known.1 == scene && known.2.contains(&way);
    all.into_iter().flatten().any(|known| is_it(&known))
}
