//! Determines which instance each texel of a page belongs to, so that each instance can have its own scale.

use std::collections::VecDeque;

use glam::Vec2;

use crate::atlas::{Atlas, InstanceUvs};

/// In [`Parts::of_texels`]: no lookup reads the texel.
pub const NOBODY: u32 = u32::MAX;

/// Divides the texels of a page into parts: those that an instance's bilinear lookups read. Instances that share a
/// texel, as they may if gutters are narrower than two texels, form one part.
pub struct Parts {
    pub count: usize,
    /// The part of each texel, or [`NOBODY`].
    pub of_texels: Vec<u32>,
    /// The instances of the page and their parts.
    pub of_instances: Vec<(usize, usize)>,
    size: usize,
}

impl Parts {
    pub fn new(atlas: &Atlas, page: u32) -> Self {
        let instances = atlas.instances.iter().enumerate();
        let instances = instances.filter_map(|(number, uvs)| Some((number, uvs.as_ref()?)));
        let instances: Vec<_> = instances.filter(|(_, uvs)| uvs.page == page).collect();
        let size = atlas.size as usize;
        let mut of_texels = vec![NOBODY; size * size];
        // Union-find: parts that were merged refer to the part that they joined.
        let mut one: Vec<u32> = (0..instances.len() as u32).collect();
        for (part, (_, uvs)) in instances.iter().enumerate() {
            for_texels(uvs, size, |texel| {
                let owner = &mut of_texels[texel];
                if *owner != NOBODY {
                    let (a, b) = (root(&mut one, *owner), root(&mut one, part as u32));
                    one[a.max(b) as usize] = a.min(b);
                }
                *owner = part as u32;
            });
        }
        let mut numbers = vec![NOBODY; instances.len()];
        let mut count = 0;
        for part in 0..instances.len() {
            let root = root(&mut one, part as u32) as usize;
            if numbers[root] == NOBODY {
                numbers[root] = count;
                count += 1;
            }
            numbers[part] = numbers[root];
        }
        for owner in of_texels.iter_mut().filter(|owner| **owner != NOBODY) {
            *owner = numbers[*owner as usize];
        }
        let instances = instances.iter().zip(&numbers);
        Self {
            count: count as usize,
            of_texels,
            of_instances: instances
                .map(|((number, _), &part)| (*number, part as usize))
                .collect(),
            size,
        }
    }

    /// Assigns texels that no lookup reads to the nearest part, for viewers that filter more widely.
    pub fn spread(&mut self) {
        let size = self.size;
        let neighbours = |texel: usize| {
            let (x, y) = (texel % size, texel / size);
            let neighbours = [
                (x > 0).then(|| texel - 1),
                (x + 1 < size).then(|| texel + 1),
                (y > 0).then(|| texel - size),
                (y + 1 < size).then(|| texel + size),
            ];
            neighbours.into_iter().flatten()
        };
        let parts = &mut self.of_texels;
        let is_at_border = |texel: &usize| {
            parts[*texel] != NOBODY && neighbours(*texel).any(|other| parts[other] == NOBODY)
        };
        let mut front: VecDeque<usize> = (0..parts.len()).filter(is_at_border).collect();
        while let Some(texel) = front.pop_front() {
            for neighbour in neighbours(texel) {
                if parts[neighbour] == NOBODY {
                    parts[neighbour] = parts[texel];
                    front.push_back(neighbour);
                }
            }
        }
    }
}

/// The part into which `part` was merged.
fn root(one: &mut [u32], mut part: u32) -> u32 {
    while one[part as usize] != part {
        one[part as usize] = one[one[part as usize] as usize];
        part = one[part as usize];
    }
    part
}

/// Calls `visit` for the texels that bilinear lookups on the triangles read: those whose centres are less than one
/// texel away from a triangle along both axes.
fn for_texels(uvs: &InstanceUvs, size: usize, mut visit: impl FnMut(usize)) {
    let last = size as f32 - 1.0;
    let texel = |at: f32| at.clamp(0.0, last) as usize;
    for corners in uvs.corners.as_chunks::<3>().0 {
        let corners = corners.map(|uv| uv * size as f32);
        let rows = corners.map(|corner| corner.y);
        let low = rows.into_iter().fold(f32::INFINITY, f32::min);
        let high = rows.into_iter().fold(f32::NEG_INFINITY, f32::max);
        for y in texel(low - 0.5)..=texel(high + 0.5) {
            // Lookups beyond the page read its border.
            let above = if y == 0 { f32::MIN } else { y as f32 - 0.5 };
            let below = if y as f32 == last {
                f32::MAX
            } else {
                y as f32 + 1.5
            };
            let Some([left, right]) = extent(corners, above.max(low), below.min(high)) else {
                continue;
            };
            for x in texel(left - 0.5)..=texel(right + 0.5) {
                visit(y * size + x);
            }
        }
    }
}

/// The leftmost and rightmost x of a triangle between two rows.
fn extent(corners: [Vec2; 3], top: f32, bottom: f32) -> Option<[f32; 2]> {
    let [a, b, c] = corners;
    let edges = [(a, b), (b, c), (c, a)];
    let ends = edges.into_iter().filter_map(|(p, q)| {
        let (p, q) = if p.y <= q.y { (p, q) } else { (q, p) };
        let (from, to) = (top.max(p.y), bottom.min(q.y));
        let at = |y: f32| p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y).max(f32::MIN_POSITIVE));
        (from <= to).then(|| {
            if p.y == q.y {
                [p.x, q.x]
            } else {
                [at(from), at(to)]
            }
        })
    });
    let xs = ends.flatten();
    xs.fold(None, |extent, x| {
        let [left, right] = extent.unwrap_or([x, x]);
        Some([left.min(x), right.max(x)])
    })
}
