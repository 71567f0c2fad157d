//! Shape generators: counter-clockwise triangles that face outward, unit normals, texture coordinates with v downward.
//!
//! Every shape is built from grids of vertices. Seams repeat their positions bitwise, so that the solids pass
//! [`Mesh::is_closed`].

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat3, Mat4, Quat, Vec2, Vec3, vec2, vec3};

use crate::Mesh;
use crate::normals::smooth_normals;

/// A vertex of a generated shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// Position in mesh space (m).
    pub position: Vec3,
    /// Unit normal in mesh space.
    pub normal: Vec3,
    /// Texture coordinates, v downward.
    pub uv: Vec2,
}

/// A grid of `columns` x `rows` cells with `vertex(column, row)` at their corners. Seen from the front, columns run to
/// the right and rows downward. Triangles with two equal corners (at poles) are left out.
pub fn grid(columns: u32, rows: u32, vertex: impl Fn(u32, u32) -> Vertex) -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let Vertex {
                position,
                normal,
                uv,
            } = vertex(column, row);
            mesh.positions.push(position);
            mesh.normals.push(normal);
            mesh.uvs[0].push(uv);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let top_left = row * (columns + 1) + column;
            let bottom_left = top_left + columns + 1;
            for triangle in [
                [top_left, bottom_left, bottom_left + 1],
                [top_left, bottom_left + 1, top_left + 1],
            ] {
                let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
                if a != b && b != c && c != a {
                    mesh.indices.extend(triangle);
                }
            }
        }
    }
    mesh
}

/// Joins all `parts` into one mesh, in their order. Keeps only positions, normals, first texture coordinates and
/// indices.
pub fn join(name: &str, parts: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut joined = Mesh {
        name: name.into(),
        ..Mesh::default()
    };
    for part in parts {
        let offset = joined.positions.len() as u32;
        joined.positions.extend(part.positions);
        joined.normals.extend(part.normals);
        let [uvs, _] = part.uvs;
        joined.uvs[0].extend(uvs);
        let indices = part.indices.iter().map(|index| index + offset);
        joined.indices.extend(indices);
    }
    joined
}

/// `mesh` transformed by an affine matrix that does not mirror.
pub fn transformed(mut mesh: Mesh, matrix: &Mat4) -> Mesh {
    let normal_matrix = Mat3::from_mat4(*matrix).inverse().transpose();
    for position in &mut mesh.positions {
        *position = matrix.transform_point3(*position);
    }
    for normal in &mut mesh.normals {
        *normal = (normal_matrix * *normal).normalize();
    }
    mesh
}

/// A parallelogram seen from its front: the `lower_left` corner and the edges that lead right and up from it (m). The
/// normal is right x up. Each side is divided into `divisions` parts.
pub fn quad(lower_left: Vec3, right: Vec3, up: Vec3, divisions: u32) -> Mesh {
    quadrilateral(
        [
            lower_left,
            lower_left + right,
            lower_left + right + up,
            lower_left + up,
        ],
        divisions,
    )
}

/// A flat quadrilateral with counter-clockwise corners, starting at the lower left.
pub fn quadrilateral(corners: [Vec3; 4], divisions: u32) -> Mesh {
    let [a, b, c, d] = corners;
    let normal = (c - a).cross(d - b).normalize();
    grid(divisions, divisions, |column, row| {
        let left = between(d, a, row, divisions);
        let right = between(c, b, row, divisions);
        Vertex {
            position: between(left, right, column, divisions),
            normal,
            uv: vec2(column as f32, row as f32) / divisions as f32,
        }
    })
}

/// The point after `step` of `steps` equal steps from `a` to `b`. It is bitwise the same when counted from either end,
/// so that neighbouring faces share their edges.
fn between(a: Vec3, b: Vec3, step: u32, steps: u32) -> Vec3 {
    match step {
        0 => a,
        _ if step == steps => b,
        _ => (a * (steps - step) as f32 + b * step as f32) / steps as f32,
    }
}

/// A solid with a four-cornered bottom and top. Both run counter-clockwise as seen from above; corner i of the bottom
/// lies below corner i of the top.
pub fn hexahedron(bottom: [Vec3; 4], top: [Vec3; 4], divisions: u32) -> Mesh {
    let sides = (0..4).map(|i| {
        let next = (i + 1) % 4;
        quadrilateral([bottom[i], bottom[next], top[next], top[i]], divisions)
    });
    let [a, b, c, d] = bottom;
    let caps = [
        quadrilateral(top, divisions),
        quadrilateral([d, c, b, a], divisions),
    ];
    join("hexahedron", sides.chain(caps))
}

/// An axis-aligned box between two corners (m).
pub fn cuboid(min: Vec3, max: Vec3, divisions: u32) -> Mesh {
    let level = |y: f32| {
        [
            vec3(min.x, y, max.z),
            vec3(max.x, y, max.z),
            vec3(max.x, y, min.z),
            vec3(min.x, y, min.z),
        ]
    };
    hexahedron(level(min.y), level(max.y), divisions)
}

/// A slab between two corners (m), pierced along `axis` (0, 1 or 2) by rectangular openings. An opening is given by two
/// corners in the plane of the slab: z and y, x and z, or x and y.
pub fn pierced(min: Vec3, max: Vec3, axis: usize, openings: &[[Vec2; 2]]) -> Mesh {
    let [across, along] = [[2, 1], [0, 2], [0, 1]][axis];
    let block = |[left, right]: [f32; 2], [low, high]: [f32; 2]| {
        let (mut from, mut to) = (min, max);
        (from[across], to[across]) = (left, right);
        (from[along], to[along]) = (low, high);
        cuboid(from, to, 1)
    };
    let mut cuts = vec![min[across], max[across]];
    cuts.extend(openings.iter().flat_map(|[low, high]| [low.x, high.x]));
    cuts.sort_by(f32::total_cmp);
    cuts.dedup();
    let mut blocks = Vec::new();
    for strip in cuts.windows(2) {
        let strip = [strip[0], strip[1]];
        let is_across = |[low, high]: &&[Vec2; 2]| low.x <= strip[0] && strip[1] <= high.x;
        let mut holes: Vec<_> = openings.iter().filter(is_across).collect();
        holes.sort_by(|a, b| a[0].y.total_cmp(&b[0].y));
        let mut low = min[along];
        for hole in holes {
            if hole[0].y > low {
                blocks.push(block(strip, [low, hole[0].y]));
            }
            low = hole[1].y;
        }
        if low < max[along] {
            blocks.push(block(strip, [low, max[along]]));
        }
    }
    join("pierced", blocks)
}

/// A bar of `length` (m) along X, bent about it: the part of a ring with these radii (m) up to `half_angle` (rad) on
/// either side of +Y. Its axis runs through the origin.
pub fn bow([inner, outer]: [f32; 2], half_angle: f32, length: f32, steps: u32) -> Mesh {
    let direction = |step: u32| {
        let angle = half_angle * (2.0 * step as f32 / steps as f32 - 1.0);
        vec3(0.0, angle.cos(), angle.sin())
    };
    let half = Vec3::X * length / 2.0;
    let at = |side: f32, radius: f32, step: u32| direction(step) * radius + half * side;
    let vertex = |position: Vec3, normal: Vec3, column: u32, row: u32| Vertex {
        position,
        normal,
        uv: vec2(column as f32, row as f32),
    };
    let side = |column: u32| 2.0 * column as f32 - 1.0;
    let radius = |row: u32| if row == 0 { outer } else { inner };
    let above = grid(1, steps, |column, row| {
        vertex(at(side(column), outer, row), direction(row), column, row)
    });
    let below = grid(1, steps, |column, row| {
        let step = steps - row;
        vertex(at(side(column), inner, step), -direction(step), column, row)
    });
    let left = grid(steps, 1, |column, row| {
        vertex(at(-1.0, radius(row), column), Vec3::NEG_X, column, row)
    });
    let right = grid(steps, 1, |column, row| {
        let step = steps - column;
        vertex(at(1.0, radius(row), step), Vec3::X, column, row)
    });
    let foot = |step: u32, first: f32| {
        let [a, b] = [first, -first];
        quadrilateral(
            [
                at(a, inner, step),
                at(b, inner, step),
                at(b, outer, step),
                at(a, outer, step),
            ],
            1,
        )
    };
    join(
        "bow",
        [above, below, left, right, foot(steps, -1.0), foot(0, 1.0)],
    )
}

/// A closed surface about +Y, from its top to its bottom. `point` takes the way down and the turn from +Z toward +X, both
/// 0 to 1; the first and last rows shrink to the point at turn 0.
pub fn lofted(columns: u32, rows: u32, point: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let mut mesh = grid(columns, rows, |column, row| {
        let turn = match row {
            0 => 0,
            _ if row == rows => 0,
            _ => column % columns,
        };
        Vertex {
            position: point(row as f32 / rows as f32, turn as f32 / columns as f32),
            normal: Vec3::Y,
            uv: vec2(column as f32 / columns as f32, row as f32 / rows as f32),
        }
    });
    smooth_normals(&mut mesh, 1.0);
    named("lofted", mesh)
}

/// `mesh` with texture coordinates and tangents of a texture that covers `side` x `side` (m), laid on from the axis that
/// each normal is nearest to.
pub fn papered(mut mesh: Mesh, side: f32) -> Mesh {
    let axes = |normal: Vec3| {
        let size = normal.abs();
        let sign = |value: f32| 1.0_f32.copysign(value);
        if size.y >= size.max_element() {
            (Vec3::X, Vec3::Z * sign(normal.y))
        } else if size.x >= size.z {
            (Vec3::NEG_Z * sign(normal.x), Vec3::NEG_Y)
        } else {
            (Vec3::X * sign(normal.z), Vec3::NEG_Y)
        }
    };
    let vertices = mesh.positions.iter().zip(&mesh.normals);
    (mesh.uvs[0], mesh.tangents) = vertices
        .map(|(position, normal)| {
            let (right, down) = axes(*normal);
            let tangent = right.reject_from_normalized(*normal).normalize();
            (
                vec2(position.dot(right), position.dot(down)) / side,
                tangent.extend(1.0),
            )
        })
        .unzip();
    mesh
}

/// A point of a profile for [`revolution`]: x is the distance from the axis, y the height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePoint {
    /// Distance from the +Y axis and height (m).
    pub position: Vec2,
    /// Unit normal in the same plane, pointing away from the solid.
    pub normal: Vec2,
}

/// A surface of revolution about +Y. The outside lies to the left of the profile's direction, so a profile runs down
/// the outside of a solid. To make a sharp edge, repeat a point with another normal. u grows once around the axis, v
/// along the length of the profile.
pub fn revolution(profile: &[ProfilePoint], columns: u32) -> Mesh {
    let mut lengths = vec![0.0];
    for pair in profile.windows(2) {
        let step = pair[0].position.distance(pair[1].position);
        lengths.push(lengths[lengths.len() - 1] + step);
    }
    let total = lengths[lengths.len() - 1];
    grid(columns, profile.len() as u32 - 1, |column, row| {
        // The last column repeats the first one bitwise.
        let (sine, cosine) = ((column % columns) as f32 / columns as f32 * TAU).sin_cos();
        let turn = |p: Vec2| vec3(p.x * sine, p.y, p.x * cosine);
        let point = profile[row as usize];
        Vertex {
            position: turn(point.position),
            normal: turn(point.normal),
            uv: vec2(
                column as f32 / columns as f32,
                lengths[row as usize] / total,
            ),
        }
    })
}

/// A profile of straight segments with sharp corners, for [`revolution`].
pub fn sharp_profile(corners: &[Vec2]) -> Vec<ProfilePoint> {
    corners
        .windows(2)
        .flat_map(|pair| {
            let normal = (pair[1] - pair[0]).perp().normalize();
            [pair[0], pair[1]].map(|position| ProfilePoint { position, normal })
        })
        .collect()
}

/// The arc of a circle from angle `start` to `end` (rad), measured from +x toward +y, in `steps` segments.
pub fn arc_profile(
    center: Vec2,
    radius: f32,
    start: f32,
    end: f32,
    steps: u32,
) -> Vec<ProfilePoint> {
    (0..=steps)
        .map(|step| {
            let along = step as f32 / steps as f32;
            let normal = Vec2::from_angle(start * (1.0 - along) + end * along);
            ProfilePoint {
                position: center + normal * radius,
                normal,
            }
        })
        .collect()
}

/// A sphere centred at the origin, with `segments` segments from pole to pole and twice as many around.
pub fn sphere(radius: f32, segments: u32) -> Mesh {
    let segments = segments.max(2);
    let mut profile = arc_profile(Vec2::ZERO, radius, FRAC_PI_2, -FRAC_PI_2, segments);
    // Rounding must not open the poles.
    profile[0].position.x = 0.0;
    profile[segments as usize].position.x = 0.0;
    named("sphere", revolution(&profile, 2 * segments))
}

/// A cylinder about +Y that stands on the plane y = 0, with caps.
pub fn cylinder(radius: f32, height: f32, columns: u32) -> Mesh {
    let corners = [
        vec2(0.0, height),
        vec2(radius, height),
        vec2(radius, 0.0),
        Vec2::ZERO,
    ];
    named(
        "cylinder",
        revolution(&sharp_profile(&corners), columns.max(3)),
    )
}

/// A cylinder around the way between two points (m), with caps.
pub fn rod(from: Vec3, to: Vec3, radius: f32, columns: u32) -> Mesh {
    let way = to - from;
    let turn = Quat::from_rotation_arc(Vec3::Y, way.normalize());
    let place = Mat4::from_rotation_translation(turn, from);
    named(
        "rod",
        transformed(cylinder(radius, way.length(), columns), &place),
    )
}

/// A cone about +Y that stands on the plane y = 0, with its base.
pub fn cone(radius: f32, height: f32, columns: u32) -> Mesh {
    let corners = [vec2(0.0, height), vec2(radius, 0.0), Vec2::ZERO];
    named("cone", revolution(&sharp_profile(&corners), columns.max(3)))
}

/// A torus about the origin with axis +Y. `ring` is the radius of the tube's centre line and `tube` that of the tube
/// itself. It has `segments` segments around the tube and twice as many around the axis.
pub fn torus(ring: f32, tube: f32, segments: u32) -> Mesh {
    let segments = segments.max(3);
    let mut profile = arc_profile(vec2(ring, 0.0), tube, PI, -PI, segments);
    profile[segments as usize] = profile[0];
    named("torus", revolution(&profile, 2 * segments))
}

fn named(name: &str, mut mesh: Mesh) -> Mesh {
    mesh.name = name.into();
    mesh
}
