//! Probes: points in free space whose surroundings are captured in cubes and lit, in turns. Shared by what keeps light at
//! points, in a grid or elsewhere.

mod cubes;
mod grid;
mod placing;
#[cfg(test)]
mod tests;

pub use cubes::ProbeCubes;
pub use grid::Grid;
pub use placing::Placing;
