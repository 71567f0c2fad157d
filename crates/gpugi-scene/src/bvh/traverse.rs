//! CPU traversal: the counterpart of the renderer's scene/bvh.wesl, over the same rows. Tests compare the two.

use glam::{Mat4, Vec2, Vec3, Vec3Swizzles, Vec4};

use super::node::NODE_ROWS;
use super::rows::{
    FLAG_ALPHA, FLAG_BLACK_BACK, FLAG_SPHERE, INSTANCE_ROWS, ROUNDING, Row, TRIANGLE_ROWS,
};

/// A ray in world space: origin + t * direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Position at t = 0 (m).
    pub origin: Vec3,
    /// Hits have a larger t.
    pub t_min: f32,
    /// Direction, not necessarily of unit length.
    pub direction: Vec3,
    /// Hits have a smaller t.
    pub t_max: f32,
}

/// Where a ray meets a triangle, or a sphere: then the triangle is the one below, as seen from the sphere's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in units of the length of the ray's direction.
    pub t: f32,
    /// Instance number.
    pub instance: u32,
    /// Triangle number within the mesh.
    pub primitive: u32,
    /// Weights of the triangle's second and third vertices.
    pub barycentrics: Vec2,
}

/// The result of a traversal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Traversal {
    /// The closest hit or, for [`any_hit`], the first hit found.
    pub hit: Option<Hit>,
    /// Largest number of entries on the stack.
    pub stack: usize,
}

/// A ray in the space of the top level or in a mesh's units.
struct Local {
    origin: Vec3,
    inverse: Vec3,
    /// Three bits, each set if the direction is positive along that axis: 4 for x, 2 for y, 1 for z.
    octant: u32,
    /// The axis of the largest direction component; [`turned`] makes it the third axis.
    axis: usize,
    /// The other two direction components divided by the largest, negated.
    slopes: Vec2,
    /// 1 / largest direction component.
    inverse_length: f32,
}

/// Permutes the axes cyclically so that `axis` becomes the third.
fn turned(v: Vec3, axis: usize) -> Vec3 {
    match axis {
        0 => v.yzx(),
        1 => v.zxy(),
        _ => v,
    }
}

impl Local {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        let magnitude = direction.abs();
        let tiny = magnitude.max_element() * 2.0_f32.powi(-64);
        let nonzero = |d: f32| match (d.abs() < tiny, d >= 0.0) {
            (false, _) => d,
            (true, true) => tiny,
            (true, false) => -tiny,
        };
        let d = Vec3::from_array(direction.to_array().map(nonzero));
        let bit = |d: f32, bit: u32| if d < 0.0 { 0 } else { bit };
        let axis = if magnitude.z >= magnitude.x.max(magnitude.y) {
            2
        } else {
            usize::from(magnitude.x < magnitude.y)
        };
        let along = turned(direction, axis);
        Self {
            origin,
            inverse: 1.0 / d,
            octant: bit(d.x, 4) | bit(d.y, 2) | bit(d.z, 1),
            axis,
            slopes: -along.xy() / along.z,
            inverse_length: 1.0 / along.z,
        }
    }

    /// The children of the node at `row` that the ray meets between `t_min` and `t_max`. Bits 24 and up are inner
    /// children, ordered by the ray's octant with the nearest in the highest bit; the bits below are leaf items.
    fn node(&self, rows: &[Row], row: u32, t_min: f32, t_max: f32) -> u32 {
        let node = &rows[row as usize..(row + NODE_ROWS) as usize];
        let origin = Vec3::from_array([0, 1, 2].map(|axis| f32::from_bits(node[0][axis])));
        let step = Vec3::from_array(
            [0, 8, 16].map(|shift| f32::from_bits(((node[0][3] >> shift) & 255) << 23)),
        ) * self.inverse;
        let base = (origin - self.origin) * self.inverse;
        let slack = (base.abs() + 255.0 * step.abs()) * ROUNDING as f32;
        let (near, far) = (base - slack, base + slack);
        let mut hits = 0;
        for child in 0..8 {
            let byte = |words: [u32; 2]| (words[child / 4] >> (child % 4 * 8)) & 255;
            let meta = byte([node[1][2], node[1][3]]);
            let (mut enter, mut leave) = (t_min, t_max);
            for axis in 0..3 {
                let [a, b, c, d] = node[2 + axis];
                let (mut low, mut high) = (byte([a, b]) as f32, byte([c, d]) as f32);
                if self.inverse[axis] < 0.0 {
                    (low, high) = (high, low);
                }
                enter = enter.max(low.mul_add(step[axis], near[axis]));
                leave = leave.min(high.mul_add(step[axis], far[axis]));
            }
            if enter <= leave {
                let index = if meta & 0x18 == 0x18 {
                    meta ^ self.octant
                } else {
                    meta
                };
                hits |= (meta >> 5) << (index & 31);
            }
        }
        hits
    }

    /// Watertight: Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (JCGT 2013). All triangles project
    /// their corners by the same operations, so if two triangles share an edge, its edge functions differ only in sign.
    fn triangle(&self, rows: &[Row], row: u32) -> Option<Crossing> {
        let [a, b, c] = [0, 1, 2].map(|corner| {
            let [x, y, z, _] = rows[(row + corner) as usize].map(f32::from_bits);
            let p = turned(Vec3::new(x, y, z) - self.origin, self.axis);
            Vec3::new(
                self.slopes.x.mul_add(p.z, p.x),
                self.slopes.y.mul_add(p.z, p.y),
                self.inverse_length * p.z,
            )
        });
        // edge(p, q) = -edge(q, p) bit for bit, however `mul_add` rounds.
        let edge =
            |p: Vec3, q: Vec3| p.x.mul_add(q.y, -(p.y * q.x)) - p.y.mul_add(q.x, -(p.x * q.y));
        let weights = Vec3::new(edge(c, b), edge(a, c), edge(b, a));
        let determinant = weights.x + weights.y + weights.z;
        if weights.min_element() < 0.0 && weights.max_element() > 0.0 || determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let t = (weights.x * a.z + weights.y * b.z + weights.z * c.z) * inverse;
        let terms = (weights * Vec3::new(a.z, b.z, c.z)).abs();
        let is_back = determinant * self.inverse_length < 0.0;
        Some(Crossing {
            t,
            barycentrics: Vec2::new(weights.y, weights.z) * inverse,
            slack: match is_back {
                true => terms.max_element() * inverse.abs() * BACK_SLACK,
                false => 0.0,
            },
        })
    }
}

/// Where a ray meets a triangle.
struct Crossing {
    t: f32,
    barycentrics: Vec2,
    /// Where the ray meets the triangle's back, an allowance for rounding of `t`; otherwise 0.
    slack: f32,
}

/// Allowance for rounding of the distance to a triangle, relative to its terms.
const BACK_SLACK: f32 = 0.000_001_907_348_6; // 2^-19

/// Where a line enters and leaves a sphere, in multiples of the direction's length; `None` if it misses it. Haines,
/// Guenther and Akenine-Moeller, "Precision Improvements for Ray/Sphere Intersection" (Ray Tracing Gems, 2019).
fn crossings(origin: Vec3, direction: Vec3, center: Vec3, radius: f32) -> Option<[f32; 2]> {
    let f = origin - center;
    let a = direction.length_squared();
    let b = -f.dot(direction);
    let nearest = f + direction * (b / a);
    let discriminant = radius * radius - nearest.length_squared();
    if discriminant <= 0.0 {
        return None;
    }
    let c = (f.length() - radius) * (f.length() + radius);
    let q = b + (a * discriminant).sqrt().copysign(b);
    let (first, second) = (c / q, q / a);
    Some([first.min(second), first.max(second)])
}

/// The hit on the sphere of an instance in these rows, beyond `t_min`.
fn on_sphere(rows: &[Row], row: usize, ray: &Ray) -> Option<Hit> {
    let (origin, direction) = in_mesh(rows, row, ray);
    let [root, instance, _, sphere] = rows[row + 3];
    let [x, y, z, radius] = rows[sphere as usize].map(f32::from_bits);
    let center = Vec3::new(x, y, z);
    let [enters, leaves] = crossings(origin, direction, center, radius)?;
    let t = if enters > ray.t_min { enters } else { leaves };
    let from_center = origin + direction * t - center;
    let mut below = None;
    let outward = Local::new(center, from_center);
    let mut nodes = vec![root];
    while let Some(row) = nodes.pop() {
        let hits = outward.node(rows, row, 0.0, f32::MAX);
        let node = &rows[row as usize..];
        for bit in (24..32).filter(|bit| hits & 1 << bit != 0) {
            let slot = (bit - 24) ^ outward.octant;
            let inner = node[0][3] >> 24;
            nodes.push(node[1][0] + (inner & !(u32::MAX << slot)).count_ones() * NODE_ROWS);
        }
        for item in (0..24).filter(|item| hits & 1 << item != 0) {
            let row = node[1][1] + item * TRIANGLE_ROWS;
            let found = outward.triangle(rows, row).filter(|found| found.t > 0.0);
            below = found
                .map(|found| (rows[row as usize][3], found.barycentrics))
                .or(below);
        }
    }
    let (primitive, barycentrics) = below?;
    (t > ray.t_min).then_some(Hit {
        t,
        instance,
        primitive,
        barycentrics,
    })
}

/// A ray in the mesh's units of the instance in these rows: origin and direction.
fn in_mesh(rows: &[Row], row: usize, ray: &Ray) -> (Vec3, Vec3) {
    let [x, y, z] = [0, 1, 2].map(|i| Vec4::from_array(rows[row + i].map(f32::from_bits)));
    let mesh_from_world = Mat4::from_cols(x, y, z, Vec4::W).transpose();
    (
        mesh_from_world.transform_point3(ray.origin),
        mesh_from_world.transform_vector3(ray.direction),
    )
}

/// The closest hit of `ray`, traversing from the `start` that [`super::TopLevel`] provides. On instances with alpha,
/// `exists` accepts or rejects each candidate (instance, triangle, barycentrics).
pub fn closest_hit(
    rows: &[Row],
    start: [u32; 2],
    ray: &Ray,
    exists: impl Fn(u32, u32, Vec2) -> bool,
) -> Traversal {
    traverse(rows, start, ray, exists, false)
}

/// Like [`closest_hit`], but returns the first hit found.
pub fn any_hit(
    rows: &[Row],
    start: [u32; 2],
    ray: &Ray,
    exists: impl Fn(u32, u32, Vec2) -> bool,
) -> Traversal {
    traverse(rows, start, ray, exists, true)
}

/// Bits of a group that mark nodes still to visit.
pub(super) const INNER: u32 = 0xff00_0000;

/// Bits of a group that consists of a single node.
pub(super) const FIRST_NODE: u32 = 0x8000_0000;

/// A group is a row and a bit field. In a node group, bits 24 and up mark the nodes to visit, and the bits below are
/// the mask of inner children. In an item group, the bits mark leaf items.
fn traverse(
    rows: &[Row],
    start: [u32; 2],
    ray: &Ray,
    exists: impl Fn(u32, u32, Vec2) -> bool,
    any: bool,
) -> Traversal {
    let mut result = Traversal::default();
    let mut t_max = ray.t_max;
    let mut local = Local::new(ray.origin, ray.direction);
    let mut stack: Vec<[u32; 2]> = Vec::new();
    let mut nodes = start;
    // Number, flags and stack height of the instance being traversed.
    let mut inside: Option<(u32, u32, usize)> = None;
    loop {
        let mut items = nodes;
        nodes = [0, 0];
        if items[1] & INNER != 0 {
            let [first, bits] = items;
            let bit = bits.ilog2();
            let others = bits & !(1 << bit);
            if others & INNER != 0 {
                stack.push([first, others]);
            }
            let slot = (bit - 24) ^ local.octant;
            let before = (bits & !(u32::MAX << slot)).count_ones();
            let row = first + before * NODE_ROWS;
            let hits = local.node(rows, row, ray.t_min, t_max);
            let node = &rows[row as usize..];
            nodes = [node[1][0], hits & INNER | node[0][3] >> 24];
            items = [node[1][1], hits & !INNER];
        }
        if let Some((instance, flags, _)) = inside {
            while items[1] != 0 {
                let item = items[1].ilog2();
                items[1] &= !(1 << item);
                let row = items[0] + item * TRIANGLE_ROWS;
                let Some(crossing) = local.triangle(rows, row) else {
                    continue;
                };
                let (mut t, barycentrics) = (crossing.t, crossing.barycentrics);
                if flags & FLAG_BLACK_BACK != 0 {
                    t += crossing.slack;
                }
                let primitive = rows[row as usize][3];
                if crossing.t > ray.t_min
                    && t < t_max
                    && (flags & FLAG_ALPHA == 0 || exists(instance, primitive, barycentrics))
                {
                    t_max = t;
                    result.hit = Some(Hit {
                        t,
                        instance,
                        primitive,
                        barycentrics,
                    });
                    if any {
                        return result;
                    }
                }
            }
        } else if items[1] != 0 {
            let item = items[1].ilog2();
            let others = items[1] & !(1 << item);
            if others != 0 {
                stack.push([items[0], others]);
            }
            if nodes[1] & INNER != 0 {
                stack.push(nodes);
            }
            let row = (items[0] + item * INSTANCE_ROWS) as usize;
            let [mesh, instance, flags, _] = rows[row + 3];
            if flags & FLAG_SPHERE != 0 {
                nodes = [0, 0];
                if let Some(hit) = on_sphere(rows, row, ray).filter(|hit| hit.t < t_max) {
                    t_max = hit.t;
                    result.hit = Some(hit);
                    if any {
                        return result;
                    }
                }
            } else {
                let (origin, direction) = in_mesh(rows, row, ray);
                local = Local::new(origin, direction);
                inside = Some((instance, flags, stack.len()));
                nodes = [mesh, FIRST_NODE];
            }
        }
        result.stack = result.stack.max(stack.len());
        if nodes[1] & INNER == 0 {
            if inside.is_some_and(|(_, _, height)| height == stack.len()) {
                inside = None;
                local = Local::new(ray.origin, ray.direction);
            }
            match stack.pop() {
                Some(group) => nodes = group,
                None => return result,
            }
        }
    }
}
