//! Where reference points are.

/// Where reference points are: the `PLACES_` constants of lights.wesl.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Places {
    /// In a grid: they light everything.
    #[default]
    Grid = 0,
    /// In the centres of objects: they light these alone.
    Objects = 1,
    /// Where the camera is: it lights everything.
    Camera = 2,
}
