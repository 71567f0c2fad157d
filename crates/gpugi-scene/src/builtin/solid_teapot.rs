//! Newell's teapot as one closed solid, as if cast in glass. The gap between lid and rim and the end of the spout are
//! closed. Handle and spout grow out of the body, which has holes where they begin. Coordinates are Newell's, z upward,
//! as in teapot.rs.

use std::f32::consts::{PI, TAU};
use std::ops::Range;

use glam::{Vec2, Vec3, vec2};

use super::shapes::{Vertex, grid, join};
use super::teapot::{
    Across, PROFILES, Patch, Profile, TUBES, down, half_tube, normal, patch, placed, surface,
    turned,
};
use crate::Mesh;

/// Upper and lower part of the body in [`PROFILES`].
const BODY: Range<usize> = 1..3;

/// The solid in metres, +Y up, with its spout toward +X. `divisions` as for the teapot.
pub(super) fn solid_teapot(divisions: u32) -> Mesh {
    let [handle, spout] = [&TUBES[..2], &TUBES[2..]].map(|rows| Tube::new(rows, divisions));
    let handle_start = handle.crossings(-0.25, 1.0);
    let handle_end = handle.crossings(2.25, 1.0);
    let spout_start = spout.crossings(-0.25, 1.0);
    let tip = vec![2.0; spout_start.len()];
    let body = Body::new(divisions);
    let holes = [
        Hole::new(&body, handle.ring(&handle_start), PI),
        Hole::new(&body, handle.ring(&handle_end), PI),
        Hole::new(&body, spout.ring(&spout_start), 0.0),
    ];
    let others = (0..PROFILES.len()).filter(|index| !BODY.contains(index));
    let rounds = others.flat_map(|index| turned(&PROFILES[index]));
    // A flat ring between the edge of the lid and the inner edge of the rim.
    let gap = |index: usize, row: usize| (PROFILES[index].0[row], PROFILES[index].1[row]);
    let ((lid, round), (rim, _)) = (gap(4, 3), gap(0, 0));
    let across = |part: f32| Vec2::from(lid).lerp(rim.into(), part).to_array();
    let gap = turned(&([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(across), [round; 4]));
    let mut mesh = join(
        "solid teapot",
        rounds
            .chain(gap)
            .map(|points| patch(&points, divisions))
            .chain([body.mesh(&holes)])
            .chain(holes.iter().map(|hole| hole.seam(&body)))
            .chain([
                handle.mesh(&handle_start, &handle_end, 2 * divisions),
                spout.mesh(&spout_start, &tip, 2 * divisions),
                lid_of(&spout.ring(&tip)),
            ]),
    );
    // The texture coordinates of the seams would not match the others.
    mesh.uvs[0].clear();
    mesh
}

/// Handle or spout. v runs along it from 0 to 2 and continues in a straight line beyond; columns run around it.
struct Tube {
    /// Patches of the -y side and of the +y side, each in order along the tube.
    patches: [[Patch; 2]; 2],
    divisions: u32,
}

impl Tube {
    fn new(rows: &[[Across; 4]], divisions: u32) -> Self {
        Self {
            patches: [-1.0, 1.0].map(|side| [0, 1].map(|part| half_tube(&rows[part], side))),
            divisions,
        }
    }

    /// Number of columns once around.
    fn columns(&self) -> u32 {
        2 * self.divisions
    }

    /// Position and normal at a column and at `v`.
    fn at(&self, column: u32, v: f32) -> (Vec3, Vec3) {
        let column = column % self.columns();
        let u = (column % self.divisions) as f32 / self.divisions as f32;
        let part = usize::from(v > 1.0);
        let points = &self.patches[(column / self.divisions) as usize][part];
        let along = v - part as f32;
        let uv = vec2(u, along.clamp(0.0, 1.0));
        let beyond = along - uv.y;
        let position = surface(points, uv);
        let moved = if beyond == 0.0 {
            position
        } else {
            position + beyond * down(points, uv)
        };
        (moved, normal(points, uv))
    }

    /// For each column, the v between `inside` and `outside` at which the tube leaves the body.
    fn crossings(&self, inside: f32, outside: f32) -> Vec<f32> {
        let crossing = |column| {
            bisect(inside, outside, |v| {
                let point = self.at(column, v).0;
                let (radius, _) = body_at(point.z);
                point.truncate().length() < radius
            })
        };
        (0..self.columns()).map(crossing).collect()
    }

    /// The position of each column at its `v`.
    fn ring(&self, v: &[f32]) -> Vec<Vec3> {
        (0..)
            .zip(v)
            .map(|(column, &v)| self.at(column, v).0)
            .collect()
    }

    /// The surface of the tube; each column runs from its `start` to its `end`.
    fn mesh(&self, start: &[f32], end: &[f32], rows: u32) -> Mesh {
        grid(self.columns(), rows, |column, row| {
            let index = (column % self.columns()) as usize;
            let v = match row {
                0 => start[index],
                _ if row == rows => end[index],
                _ => start[index] + (end[index] - start[index]) * (row as f32 / rows as f32),
            };
            let (position, normal) = self.at(column, v);
            placed(position, normal, Vec2::ZERO)
        })
    }
}

/// The boundary between `inside`, where `is_inside` holds, and `outside`, by bisection.
fn bisect(mut inside: f32, mut outside: f32, is_inside: impl Fn(f32) -> bool) -> f32 {
    for _ in 0..32 {
        let middle = 0.5 * (inside + outside);
        *(if is_inside(middle) {
            &mut inside
        } else {
            &mut outside
        }) = middle;
    }
    0.5 * (inside + outside)
}

/// Radius of the body at a height, and its normal there as (outward, upward).
fn body_at(height: f32) -> (f32, Vec2) {
    let [upper, lower] = [1, 2].map(|index| turned(&PROFILES[index])[0]);
    let points = if height > lower[0][0].z { upper } else { lower };
    let at = |v: f32| surface(&points, vec2(0.0, v));
    let v = bisect(0.0, 1.0, |v| at(v).z > height);
    let normal = normal(&points, vec2(0.0, v));
    (at(v).x, vec2(normal.x, normal.z))
}

/// The body without the parts above and below it; rows run downward, columns around.
struct Body {
    quarters: [[Patch; 4]; 2],
    divisions: u32,
}

impl Body {
    fn new(divisions: u32) -> Self {
        let parts: [&Profile; 2] = [&PROFILES[BODY.start], &PROFILES[BODY.start + 1]];
        Self {
            quarters: parts.map(turned),
            divisions,
        }
    }

    fn columns(&self) -> u32 {
        4 * self.divisions
    }

    fn rows(&self) -> u32 {
        2 * self.divisions
    }

    fn at(&self, column: u32, row: u32) -> (Vec3, Vec3) {
        let column = column % self.columns();
        let part = u32::from(row > self.divisions);
        let points = &self.quarters[part as usize][(column / self.divisions) as usize];
        let cell = vec2(
            (column % self.divisions) as f32,
            (row - part * self.divisions) as f32,
        );
        let uv = cell / self.divisions as f32;
        (surface(points, uv), normal(points, uv))
    }

    fn vertex(&self, column: u32, row: u32) -> Vertex {
        let (position, normal) = self.at(column, row);
        placed(position, normal, Vec2::ZERO)
    }

    /// The body without the cells that lie in holes.
    fn mesh(&self, holes: &[Hole]) -> Mesh {
        let mut mesh = grid(self.columns(), self.rows(), |column, row| {
            self.vertex(column, row)
        });
        let is_whole = |(cell, _): &(u32, &[u32; 6])| {
            let (column, row) = (cell % self.columns(), cell / self.columns());
            !holes.iter().any(|hole| hole.contains(self, column, row))
        };
        let cells = (0..).zip(mesh.indices.as_chunks::<6>().0);
        mesh.indices = cells.filter(is_whole).flat_map(|(_, cell)| *cell).collect();
        mesh
    }
}

/// A hole in the body: a block of cells around the ring where a tube begins.
struct Hole {
    ring: Vec<Vec3>,
    /// Azimuth of its centre around the axis (rad).
    azimuth: f32,
    /// First column, and the number of columns.
    column: u32,
    columns: u32,
    rows: Range<u32>,
}

impl Hole {
    fn new(body: &Body, ring: Vec<Vec3>, azimuth: f32) -> Self {
        let middle = (azimuth / TAU * body.columns() as f32).round() as u32;
        // Leave a margin of a quarter of a cell, so that no triangle becomes too thin.
        let room = |near: Vec2, far: Vec2| (far - near).abs() * 0.25;
        let mut hole = Self {
            ring,
            azimuth,
            column: 0,
            columns: 0,
            rows: 0..body.rows(),
        };
        let chart: Vec<Vec2> = hole.ring.iter().map(|&point| hole.chart(point)).collect();
        let widest = chart.iter().map(|point| point.x.abs()).fold(0.0, f32::max);
        let top = chart.iter().map(|point| point.y).fold(f32::MIN, f32::max);
        let bottom = chart.iter().map(|point| point.y).fold(f32::MAX, f32::min);
        let of = |column: u32, row: u32| hole.chart(body.at(column, row).0);
        let side = (1..body.divisions)
            .find(|&step| {
                let [near, far] = [step - 1, step].map(|step| of(middle + step, 0));
                far.x - room(near, far).x > widest
            })
            .unwrap_or(body.divisions);
        let above = (1..body.rows()).rev().find(|&row| {
            let [here, below] = [row, row + 1].map(|row| of(middle, row));
            here.y - room(here, below).y > top
        });
        let below = (1..body.rows()).find(|&row| {
            let [above, here] = [row - 1, row].map(|row| of(middle, row));
            here.y + room(above, here).y < bottom
        });
        hole.rows = above.unwrap_or(0)..below.unwrap_or(body.rows());
        hole.column = (middle + body.columns() - side) % body.columns();
        hole.columns = 2 * side;
        hole
    }

    /// Maps a point of the body to a plane as seen from outside: x to the right around the axis, y upward.
    fn chart(&self, point: Vec3) -> Vec2 {
        let around = Vec2::from_angle(-self.azimuth).rotate(point.truncate());
        vec2(2.0 * around.to_angle(), point.z)
    }

    fn contains(&self, body: &Body, column: u32, row: u32) -> bool {
        let along = (column + body.columns() - self.column) % body.columns();
        along < self.columns && self.rows.contains(&row)
    }

    /// The vertices around the block of cells.
    fn border(&self, body: &Body) -> Vec<(Vec3, Vec3)> {
        let Range { start, end } = self.rows;
        let right = self.column + self.columns;
        let upper_and_lower =
            (self.column..=right).flat_map(|column| [(column, start), (column, end)]);
        let sides = (start + 1..end).flat_map(|row| [(self.column, row), (right, row)]);
        let places = upper_and_lower.chain(sides);
        places.map(|(column, row)| body.at(column, row)).collect()
    }

    /// The part of the body between the border of the block and the ring. Both are sorted by their direction from the
    /// centre and joined by triangles.
    fn seam(&self, body: &Body) -> Mesh {
        let of_body = |&point: &Vec3| {
            let (_, normal) = body_at(point.z);
            let outward = point.truncate().normalize() * normal.x;
            (point, outward.extend(normal.y))
        };
        let middle = self
            .ring
            .iter()
            .map(|&point| self.chart(point))
            .sum::<Vec2>()
            / self.ring.len() as f32;
        let [outer, inner] =
            [self.border(body), self.ring.iter().map(of_body).collect()].map(|points| {
                let angle = |(point, _): &(Vec3, Vec3)| (self.chart(*point) - middle).to_angle();
                let mut points: Vec<_> = points
                    .into_iter()
                    .map(|point| (angle(&point), point))
                    .collect();
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                points
            });
        let mut mesh = Mesh::default();
        for (_, (position, normal)) in outer.iter().chain(&inner) {
            let vertex = placed(*position, *normal, Vec2::ZERO);
            mesh.positions.push(vertex.position);
            mesh.normals.push(vertex.normal);
            mesh.uvs[0].push(vertex.uv);
        }
        // Directions continue beyond a full turn.
        let direction = |points: &[(f32, _)], step: usize| {
            points[step % points.len()].0 + TAU * (step / points.len()) as f32
        };
        let (mut i, mut o) = (0, 0);
        let index_outer = |step: usize| (step % outer.len()) as u32;
        let index_inner = |step: usize| (outer.len() + step % inner.len()) as u32;
        while i < inner.len() || o < outer.len() {
            let here = [index_inner(i), index_outer(o)];
            let outer_is_next = o < outer.len()
                && (i == inner.len() || direction(&outer, o + 1) < direction(&inner, i + 1));
            let next = if outer_is_next {
                o += 1;
                index_outer(o)
            } else {
                i += 1;
                index_inner(i)
            };
            mesh.indices.extend([here[0], here[1], next]);
        }
        mesh
    }
}

/// Closes a flat ring at the end of a tube; faces upward.
fn lid_of(ring: &[Vec3]) -> Mesh {
    let middle = ring.iter().sum::<Vec3>() / ring.len() as f32;
    grid(ring.len() as u32, 1, |column, row| {
        let position = if row == 0 {
            ring[column as usize % ring.len()]
        } else {
            middle
        };
        placed(position, Vec3::Z, Vec2::ZERO)
    })
}
