//! Animation: a node hierarchy, skins and morph targets, posed by time.

/// What moves in a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rig {}
