//! Seams: edges of the surface that lie in two places of an atlas, so that bilinear filters read different texels on
//! the two sides.
//!
//! Least squares finds the smallest change of the texels beside them that makes both sides agree. For samples along all
//! seams, J holds the weights of bilinear lookups on one side minus those on the other. For texels x0, x = x0 + d
//! minimizes |J x|^2 + s |d|^2, solved by conjugate gradients (after Iwanicki, "Lighting technology of The Last of Us",
//! 2013).

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::Atlas;
use crate::{Mesh, Scene};

/// How strongly texels resist change: s.
const STIFFNESS: f32 = 0.05;
/// Samples per texel along a seam.
const SAMPLES: f32 = 2.0;
/// Maximum number of conjugate gradient iterations, and the fraction of the initial residual at which they stop: what
/// remains is invisible.
const MOST_ITERATIONS: usize = 60;
const ENOUGH: f32 = 1e-4;
/// An edge whose two normals have a cosine of at most this is hard: its sides are lit differently.
const SMOOTH_COSINE: f32 = 0.99;

/// The seams of an atlas.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Seams {
    /// Indices of the texels beside seams in an image of all pages stacked vertically.
    texels: Vec<u32>,
    /// Eight entries per sample: indices into `texels`, and weights.
    rows: Vec<[(u32, f32); 8]>,
    image_len: usize,
}

impl Seams {
    /// Finds the smooth edges of an atlas's scene that lie in two places of the atlas. Edges of more than two triangles
    /// are ignored.
    ///
    /// # Panics
    /// If the atlas does not belong to the scene ([`Atlas::check`]).
    pub fn new(scene: &Scene, atlas: &Atlas) -> Self {
        let size = atlas.size as usize;
        let mut seams = Self {
            image_len: size * size * atlas.pages as usize,
            ..Default::default()
        };
        let mut numbers = HashMap::new();
        let mut edges_of: HashMap<usize, Vec<Edge>> = HashMap::new();
        for (index, _, uvs) in atlas.sides() {
            let instance = &scene.instances[index];
            let edges = edges_of
                .entry(instance.mesh)
                .or_insert_with(|| smooth_edges(&scene.meshes[instance.mesh]));
            let first_texel = uvs.page as usize * size * size;
            for edge in edges.iter() {
                let sides = edge.map(|side| side.map(|corner| uvs.corners[corner] * size as f32));
                if sides[0] == sides[1] {
                    continue;
                }
                let longest = sides.map(|[from, to]| from.distance(to));
                let count = (longest[0].max(longest[1]) * SAMPLES).ceil().max(1.0) as usize;
                for sample in 0..=count {
                    let along = sample as f32 / count as f32;
                    let [a, b] = sides.map(|[from, to]| taps(from.lerp(to, along), size));
                    let mut number = |(texel, weight): (usize, f32), sign: f32| {
                        let next = seams.texels.len() as u32;
                        let texel = (first_texel + texel) as u32;
                        let index = *numbers.entry(texel).or_insert(next);
                        if index == next {
                            seams.texels.push(texel);
                        }
                        (index, weight * sign)
                    };
                    let mut row = [(0, 0.0); 8];
                    for tap in 0..4 {
                        row[tap] = number(a[tap], 1.0);
                        row[tap + 4] = number(b[tap], -1.0);
                    }
                    seams.rows.push(row);
                }
            }
        }
        seams
    }

    /// Whether there are no seams.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Indices of the texels beside seams in an image of all pages stacked vertically.
    pub fn texels(&self) -> &[u32] {
        &self.texels
    }

    /// Samples along seams, eight entries each: indices into [`Seams::texels`] and the weights of bilinear lookups,
    /// positive on one side and negative on the other.
    pub fn rows(&self) -> &[[(u32, f32); 8]] {
        &self.rows
    }

    /// Root mean square difference between the two sides of seams.
    ///
    /// # Panics
    /// If the size of `image` is not that of all pages.
    pub fn difference(&self, image: &[Vec3]) -> f32 {
        assert_eq!(image.len(), self.image_len, "texels of all pages");
        let texels: Vec<Vec3> = self.texels.iter().map(|&at| image[at as usize]).collect();
        let sides = self.rows.iter().map(|row| across(row, &texels));
        let sum: f32 = sides.map(|difference| difference.length_squared()).sum();
        (sum / self.rows.len().max(1) as f32).sqrt()
    }

    /// Makes both sides of every seam agree as well as possible, in an image of all pages stacked vertically whose
    /// gutters are filled. Texels that no seam touches stay unchanged.
    ///
    /// # Panics
    /// If the size of `image` is not that of all pages.
    pub fn smooth(&self, image: &mut [Vec3]) {
        assert_eq!(image.len(), self.image_len, "texels of all pages");
        let before: Vec<Vec3> = self.texels.iter().map(|&at| image[at as usize]).collect();
        // (J^T J + s) d = -J^T J x0; solves all three channels at once, each with its own step size.
        let mut change = vec![Vec3::ZERO; before.len()];
        let mut residual: Vec<Vec3> = self.normal_product(&before).iter().map(|v| -*v).collect();
        let mut direction = residual.clone();
        let mut squared = dot(&residual, &residual);
        let first = squared;
        for _ in 0..MOST_ITERATIONS {
            // Written so that NaN ends the loop.
            if !squared.cmpgt(first * (ENOUGH * ENOUGH)).any() {
                break;
            }
            let mut product = self.normal_product(&direction);
            for (product, direction) in product.iter_mut().zip(&direction) {
                *product += *direction * STIFFNESS;
            }
            let step = quotient(squared, dot(&direction, &product));
            for (index, product) in product.iter().enumerate() {
                change[index] += step * direction[index];
                residual[index] -= step * *product;
            }
            let next = dot(&residual, &residual);
            let kept = quotient(next, squared);
            for (direction, residual) in direction.iter_mut().zip(&residual) {
                *direction = *residual + kept * *direction;
            }
            squared = next;
        }
        for ((&at, before), change) in self.texels.iter().zip(&before).zip(&change) {
            // Light must not become negative, but a texel that was negative may stay so.
            let after = *before + *change;
            if after.is_finite() {
                image[at as usize] = after.max(before.min(Vec3::ZERO));
            }
        }
    }

    /// J^T J v.
    fn normal_product(&self, values: &[Vec3]) -> Vec<Vec3> {
        let mut product = vec![Vec3::ZERO; values.len()];
        for row in &self.rows {
            let difference = across(row, values);
            for &(index, weight) in row {
                product[index as usize] += weight * difference;
            }
        }
        product
    }
}

fn across(row: &[(u32, f32); 8], values: &[Vec3]) -> Vec3 {
    row.iter()
        .map(|&(index, weight)| weight * values[index as usize])
        .sum()
}

fn dot(a: &[Vec3], b: &[Vec3]) -> Vec3 {
    a.iter().zip(b).map(|(a, b)| *a * *b).sum()
}

/// Per channel; 0 where the divisor is not positive.
fn quotient(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::select(b.cmpgt(Vec3::ZERO), a / b, Vec3::ZERO)
}

/// The texels that a bilinear lookup at `at` (texels) reads, and their weights.
fn taps(at: Vec2, size: usize) -> [(usize, f32); 4] {
    let last = (size - 1) as f32;
    let at = (at - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
    let low = at.floor().min(Vec2::splat((last - 1.0).max(0.0)));
    let share = at - low;
    let first = low.y as usize * size + low.x as usize;
    [
        (first, (1.0 - share.x) * (1.0 - share.y)),
        (first + 1, share.x * (1.0 - share.y)),
        (first + size, (1.0 - share.x) * share.y),
        (first + size + 1, share.x * share.y),
    ]
}

/// An edge with its two sides: on each side, the corner indices at its two ends, in the same order of ends.
type Edge = [[usize; 2]; 2];

/// Edges that exactly two triangles share and whose normals agree.
fn smooth_edges(mesh: &Mesh) -> Vec<Edge> {
    let welded = mesh.weld_positions();
    let vertex = |corner: usize| mesh.indices[corner] as usize;
    // In the order of their first triangles, independent of the hash map.
    let mut found: Vec<(u32, Edge)> = Vec::new();
    let mut numbers = HashMap::new();
    for triangle in 0..mesh.indices.len() / 3 {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let mut ends = [triangle * 3 + from, triangle * 3 + to];
            let key = |corner: usize| welded[vertex(corner)];
            if key(ends[0]) == key(ends[1]) {
                continue;
            }
            if key(ends[0]) > key(ends[1]) {
                ends.swap(0, 1);
            }
            let next = found.len();
            let number = *numbers.entry(ends.map(key)).or_insert(next);
            if number == next {
                found.push((1, [ends, ends]));
            } else {
                found[number].0 += 1;
                found[number].1[1] = ends;
            }
        }
    }
    let is_smooth = |edge: &Edge| {
        (0..2).all(|end| {
            let [a, b] = edge.map(|side| mesh.normals[vertex(side[end])]);
            a.dot(b) > SMOOTH_COSINE * a.length() * b.length()
        })
    };
    found
        .into_iter()
        .filter(|(count, edge)| *count == 2 && is_smooth(edge))
        .map(|(_, edge)| edge)
        .collect()
}
