//! Shape generators: counter-clockwise triangles that face outward, unit normals, texture coordinates with v downward.
//!
//! Every shape is built from grids of vertices. Seams repeat their positions bitwise, so that the solids pass
//! [`Mesh::is_closed`].

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat3, Mat4, Vec2, Vec3, vec2, vec3};

use crate::Mesh;

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
