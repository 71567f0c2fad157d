//! Directions drawn anew for each sample of a picture, so that the mean of its samples converges to the light of the
//! whole environment: domains.rs finds directions that serve all samples alike.

use std::f64::consts::{PI, TAU};

use glam::Vec3;
use gpugi_scene::image::luminance;

use super::domains::Domain;
use super::gpu::Grid;
use crate::gpu::{GpuError, ReadBack};
use crate::sequences::{R2, additive};

/// Iterations that find how many draws each cell expects.
const ROUNDS: usize = 16;
/// Step of the additive sequence of lowest discrepancy in one dimension.
const GOLDEN: [f64; 1] = [0.618_033_988_749_894_9];

/// The cells of an environment, as reduce.wesl writes them, on their way from the GPU.
#[derive(Debug)]
pub struct CellsOnTheWay {
    pub grid: Grid,
    pub rows: ReadBack<Vec<[f32; 4]>>,
}

impl CellsOnTheWay {
    /// The cells, once they have arrived.
    pub fn get(&self) -> Option<Result<CellsOfSky, GpuError>> {
        let rows = self.rows.get()?;
        Some(rows.map(|rows| CellsOfSky {
            grid: self.grid,
            rows,
        }))
    }
}

/// The cells of an environment, as reduce.wesl writes them.
#[derive(Debug)]
pub struct CellsOfSky {
    pub grid: Grid,
    pub rows: Vec<[f32; 4]>,
}

impl CellsOfSky {
    /// Column and row of each cell, the integral of the radiance over it (W/m^2), and its solid angle (sr); along a
    /// curve on which neighbours are neighbours on the map.
    pub fn all(&self) -> impl Iterator<Item = ([u32; 2], Vec3, f32)> {
        let Grid { width, height, .. } = self.grid;
        let side = width.div_ceil(2).max(height).next_power_of_two();
        let steps = (0..2 * side * side).map(move |step| along_curve(step, side));
        let within = steps.filter(move |&[column, row]| column < width && row < height);
        within.map(|[column, row]| {
            let [r, g, b, solid_angle] = self.rows[(row * self.grid.stride + column) as usize];
            ([column, row], Vec3::new(r, g, b), solid_angle)
        })
    }
}

/// The cells of an environment, with the number of draws that each expects.
#[derive(Debug)]
pub struct Draws {
    grid: Grid,
    count: u32,
    /// Cells with light, along a curve on which neighbours are neighbours on the map.
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    column: u32,
    row: u32,
    /// Integral of the radiance (W/m^2).
    flux_density: Vec3,
    /// (sr)
    solid_angle: f32,
    /// Draws expected of it, and of the cells before it.
    expected: f64,
    before: f64,
}

impl Draws {
    /// `count` draws per sample. The number that a cell expects is proportional to its power and to its importance
    /// (above 0), but at most 1: several draws from one cell would nearly coincide.
    pub fn new(cells: &CellsOfSky, count: u32, importance: impl Fn([u32; 2]) -> f64) -> Self {
        let grid = cells.grid;
        let of_sky = cells.all().map(|(cell, flux_density, solid_angle)| Cell {
            column: cell[0],
            row: cell[1],
            flux_density,
            solid_angle,
            expected: power(flux_density) * importance(cell),
            before: 0.0,
        });
        let mut cells: Vec<Cell> = of_sky.filter(|cell| cell.expected > 0.0).collect();
        // The power, times importance, that one draw stands for: where cells have more, the share of the others shrinks.
        let mut share = f64::INFINITY;
        for _ in 0..ROUNDS {
            let sum: f64 = cells.iter().map(|cell| cell.expected.min(share)).sum();
            share = sum / f64::from(count);
        }
        let mut before = 0.0;
        for cell in &mut cells {
            cell.before = before;
            cell.expected = (cell.expected / share).min(1.0);
            before += cell.expected;
        }
        Self { grid, count, cells }
    }

    /// Column and row of each cell with light, and the number of draws that it expects.
    pub fn expected(&self) -> impl Iterator<Item = ([u32; 2], f64)> {
        let cells = self.cells.iter();
        cells.map(|cell| ([cell.column, cell.row], cell.expected))
    }

    /// The directions of sample `turn`, with the light that each stands for: systematic sampling along the curve.
    pub fn of_sample(&self, turn: u32) -> Vec<Domain> {
        let [shift] = additive(GOLDEN, turn);
        let end = self
            .cells
            .last()
            .map_or(0.0, |cell| cell.before + cell.expected);
        let draws = (0..self.count).map(|index| (index, f64::from(index) + shift));
        draws
            .take_while(|(_, at)| *at < end)
            .map(|(index, at)| {
                let next = self.cells.partition_point(|cell| cell.before <= at);
                let cell = &self.cells[next - 1];
                let within = additive(R2, turn.wrapping_mul(self.count).wrapping_add(index));
                Domain {
                    toward: self.direction(cell, within),
                    flux_density: cell.flux_density / cell.expected as f32,
                    solid_angle: cell.solid_angle / cell.expected as f32,
                    lit_solid_angle: cell.solid_angle / cell.expected as f32,
                }
            })
            .collect()
    }

    /// The direction of a point of a cell, uniform over its solid angle.
    fn direction(&self, cell: &Cell, [x, y]: [f64; 2]) -> Vec3 {
        let edge = |row: u32| (PI * f64::from(row) / f64::from(self.grid.height)).cos();
        let phi = TAU * ((f64::from(cell.column) + x) / f64::from(self.grid.width) - 0.5);
        let cosine = edge(cell.row) + (edge(cell.row + 1) - edge(cell.row)) * y;
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        glam::dvec3(phi.sin() * sine, cosine, -phi.cos() * sine).as_vec3()
    }
}

/// Luminance of a flux density (W/m^2).
fn power(flux_density: Vec3) -> f64 {
    f64::from(luminance(flux_density))
}

/// `along_curve` of domains.wesl.
fn along_curve(step: u32, of_side: u32) -> [u32; 2] {
    let of_square = of_side * of_side;
    let mut rest = step % of_square;
    let mut cell = [0, 0];
    let mut side = 1;
    while side < of_side {
        let right = (rest / 2) & 1;
        let down = (rest ^ right) & 1;
        if down == 0 {
            if right == 1 {
                cell = cell.map(|coordinate| side - 1 - coordinate);
            }
            cell.swap(0, 1);
        }
        cell = [cell[0] + side * right, cell[1] + side * down];
        rest /= 4;
        side *= 2;
    }
    [cell[0] + step / of_square * of_side, cell[1]]
}
