//! The tree of light_tree.wesl, by which next-event estimation chooses among lights that are near. Built from the top: nodes are
//! split where the sum over both children of intensity, size and spread of directions is least (Conty Estevez and Kulla 2018,
//! section 4.1, without their regularization).

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;

const NONE: u32 = u32::MAX;
/// Words of a node in light_tree.wesl.
const WORDS: usize = 16;
/// Parts of a node's box between which it may be split; nodes of more lights are split in halves, which takes less time.
const BINS: usize = 12;
const MANY: usize = 256;
/// Triangles that face about the same way (rad) are chosen in proportion to their intensity if there are no more: to tell them
/// apart takes more time than it saves.
const FEW: usize = 4;
const NARROW: f32 = 0.5;
/// Least cone around the axis (rad), so that rounding leaves no light out.
const MARGIN: f32 = 1e-3;

/// What a place needs to know of a light, or of several.
#[derive(Debug, Clone, Copy)]
pub struct Bound {
    /// Box (m).
    pub least: Vec3,
    pub most: Vec3,
    /// Unit axis; angle within which the axes of all lights are, and up to which they shine beside theirs (rad).
    pub axis: Vec3,
    pub spread: f32,
    pub reach: f32,
    /// Largest intensity (W/sr), summed over the lights.
    pub intensity: f64,
}

impl Bound {
    /// A point with a radius. `cone`: axis and half angle of a spot.
    pub fn of_point(at: Vec3, radius: f32, intensity: f64, cone: Option<(Vec3, f32)>) -> Self {
        let (axis, spread) = cone.unwrap_or((Vec3::Z, PI));
        Self {
            least: at - radius,
            most: at + radius,
            axis,
            spread: (spread + MARGIN).min(PI),
            reach: MARGIN,
            intensity,
        }
    }

    /// A triangle with its radiance.
    pub fn of_triangle(corners: [Vec3; 3], radiance: f64, two_sided: bool) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        Self {
            least: a.min(b).min(c),
            most: a.max(b).max(c),
            axis: normal.try_normalize().unwrap_or(Vec3::Z),
            spread: if two_sided { PI } else { MARGIN },
            reach: FRAC_PI_2,
            intensity: radiance * f64::from(normal.length()) / 2.0,
        }
    }

    fn centre(&self) -> Vec3 {
        0.5 * self.least + 0.5 * self.most
    }

    fn with(&self, other: &Self) -> Self {
        let (axis, spread) = cone((self.axis, self.spread), (other.axis, other.spread));
        Self {
            least: self.least.min(other.least),
            most: self.most.max(other.most),
            axis,
            spread,
            reach: self.reach.max(other.reach),
            intensity: self.intensity + other.intensity,
        }
    }

    /// How dear it is: intensity, times the square of its size, times the measure of the directions into which it shines.
    fn cost(&self) -> f64 {
        let size = f64::from((self.most - self.least).length_squared());
        let (o, w) = (self.spread, (self.spread + self.reach).min(PI));
        let of_axes = 2.0 * PI * (1.0 - o.cos());
        let beside = 2.0 * w * o.sin() - (o - 2.0 * w).cos() - 2.0 * o * o.sin() + o.cos();
        self.intensity * size * f64::from(of_axes + FRAC_PI_2 * beside)
    }
}

/// The least cone around two, by axis and half angle.
fn cone(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (a, b) = if a.1 >= b.1 { (a, b) } else { (b, a) };
    if a.1 >= PI {
        return a;
    }
    let between = a.0.angle_between(b.0);
    if (between + b.1).min(PI) <= a.1 {
        return a;
    }
    let spread = 0.5 * (a.1 + between + b.1);
    let around = a.0.cross(b.0).try_normalize();
    match around {
        Some(around) if spread < PI => {
            let axis = glam::Quat::from_axis_angle(around, spread - a.1) * a.0;
            (axis.normalize(), spread)
        }
        // Rounding keeps apart what is parallel.
        None if a.0.dot(b.0) > 0.0 => (a.0, between + b.1),
        _ => (Vec3::Z, PI),
    }
}

/// A node: its children, or its light.
struct Node {
    parent: u32,
    children: [u32; 2],
    /// Index of the light.
    light: usize,
}

/// The tree over `lights`, which have rows and positive intensities, as words of light_tree.wesl; and row and node of each light.
pub fn build(lights: &[(u32, Bound)]) -> (Vec<u32>, Vec<(u32, u32)>) {
    let nodes = nodes(lights);
    // Children come after their parents.
    let mut bounds: Vec<Bound> = nodes.iter().map(|node| lights[node.light].1).collect();
    for (index, node) in nodes.iter().enumerate().rev() {
        if let [first, second] = node.children
            && first != NONE
        {
            bounds[index] = bounds[first as usize].with(&bounds[second as usize]);
        }
    }
    let mut words = Vec::with_capacity(nodes.len() * WORDS);
    let mut leaves = Vec::with_capacity(lights.len());
    let mut counts = vec![1_usize; nodes.len()];
    for (index, node) in nodes.iter().enumerate().rev() {
        if node.children[0] != NONE {
            counts[index] = node
                .children
                .map(|child| counts[child as usize])
                .iter()
                .sum();
        }
    }
    for (index, (node, bound)) in nodes.iter().zip(&bounds).enumerate() {
        // Far from the origin, positions are rounded.
        let rounding = 1e-6 * bound.centre().abs().max_element();
        let radius = 0.5 * (bound.most - bound.least).length() * (1.0 + 1e-5) + rounding;
        let (sine, cosine) = bound.spread.sin_cos();
        let reach = bound.reach.cos() - 1e-6;
        // Of all lights, so that no number overflows.
        let intensity = (bound.intensity / bounds[0].intensity) as f32;
        let [x, y, z] = bound.centre().to_array();
        let axis = bound.axis;
        let of_first = match node.children {
            [first, _] if counts[index] <= FEW && counts[index] > 1 && bound.spread < NARROW => {
                (bounds[first as usize].intensity / bound.intensity) as f32
            }
            _ => -1.0,
        };
        let mut links = [node.parent, node.children[0], node.children[1]];
        if node.children[0] == NONE {
            links[2] = lights[node.light].0;
            leaves.push((links[2], index as u32));
        }
        let floats = [
            x,
            y,
            z,
            radius,
            axis.x,
            axis.y,
            axis.z,
            intensity,
            cosine,
            sine.max(0.0),
            reach,
            0.0,
        ];
        words.extend(floats.map(f32::to_bits));
        words.extend(links);
        words.push(of_first.to_bits());
    }
    (words, leaves)
}

/// The nodes of the tree, without what they know of their lights.
fn nodes(lights: &[(u32, Bound)]) -> Vec<Node> {
    let mut order: Vec<usize> = (0..lights.len()).collect();
    let mut nodes: Vec<Node> = Vec::with_capacity(2 * lights.len());
    // Ranges of `order` that are to be nodes, with their parents, and whether they are second children.
    let mut stack = vec![(0, order.len(), NONE, 0)];
    while let Some((first, end, parent, child)) = stack.pop() {
        if first == end {
            continue;
        }
        let node = nodes.len() as u32;
        if let Some(parent) = nodes.get_mut(parent as usize) {
            parent.children[child] = node;
        }
        let part = &mut order[first..end];
        nodes.push(Node {
            parent,
            children: [NONE; 2],
            light: part[0],
        });
        if part.len() > 1 {
            let middle = first + split(part, lights);
            stack.push((middle, end, node, 1));
            stack.push((first, middle, node, 0));
        }
    }
    nodes
}

/// Sorts lights into two parts; returns how many the first one has.
fn split(part: &mut [usize], lights: &[(u32, Bound)]) -> usize {
    let centre = |light: usize| lights[light].1.centre();
    let (least, most) = part.iter().fold(
        (Vec3::INFINITY, Vec3::NEG_INFINITY),
        |(least, most), &light| (least.min(centre(light)), most.max(centre(light))),
    );
    let sides = most - least;
    let half = part.len() / 2;
    if part.len() > MANY {
        let longest = (0..3)
            .max_by(|&a, &b| sides[a].total_cmp(&sides[b]))
            .unwrap_or(0);
        let along = |light: usize| centre(light)[longest];
        part.select_nth_unstable_by(half, |&a, &b| along(a).total_cmp(&along(b)));
        return half;
    }
    let bin = |axis: usize, light: usize| {
        let along = (centre(light)[axis] - least[axis]) / sides[axis];
        ((along * BINS as f32) as usize).min(BINS - 1)
    };
    let joined = |bins: &[Option<Bound>]| bins.iter().flatten().copied().reduce(|a, b| a.with(&b));
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| sides[axis] > 0.0 && sides[axis].is_finite()) {
        let mut bins: [Option<Bound>; BINS] = [None; BINS];
        for &light in part.iter() {
            let bound = &lights[light].1;
            let of_bin = &mut bins[bin(axis, light)];
            *of_bin = Some(of_bin.map_or(*bound, |before| before.with(bound)));
        }
        for at in 1..BINS {
            if let (Some(a), Some(b)) = (joined(&bins[..at]), joined(&bins[at..])) {
                let cost = a.cost() + b.cost();
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, at));
                }
            }
        }
    }
    let Some((_, axis, at)) = best else {
        // All in one place.
        return half;
    };
    part.sort_by_key(|&light| bin(axis, light));
    part.partition_point(|&light| bin(axis, light) < at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    /// Words of a node before its children.
    const CHILDREN: usize = 13;

    /// Points, spots and triangles here and there, some in one place.
    fn lights(count: u32) -> Vec<(u32, Bound)> {
        let mut random = Random(7);
        let mut place = || Vec3::from_array([0; 3].map(|_| random.next() as f32 * 10.0 - 5.0));
        (0..count)
            .map(|row| {
                let at = if row % 7 == 0 { Vec3::ONE } else { place() };
                let intensity = 0.1 + f64::from(place().x.abs());
                let bound = match row % 3 {
                    0 => Bound::of_point(at, 0.1, intensity, None),
                    1 => Bound::of_point(at, 0.0, intensity, Some((place().normalize(), 0.4))),
                    _ => Bound::of_triangle(
                        [at, at + place() * 0.1, at + place() * 0.1],
                        2.0,
                        row % 2 == 0,
                    ),
                };
                (row + 10, bound)
            })
            .collect()
    }

    fn float(words: &[u32], node: u32, word: usize) -> f32 {
        f32::from_bits(words[node as usize * WORDS + word])
    }

    fn vector(words: &[u32], node: u32, word: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| float(words, node, word + i)))
    }

    #[test]
    fn nodes_contain_their_lights() {
        let lights = lights(200);
        let (words, leaves) = build(&lights);
        assert_eq!(words.len(), (2 * lights.len() - 1) * WORDS);
        let mut rows: Vec<u32> = leaves.iter().map(|&(row, _)| row).collect();
        rows.sort_unstable();
        assert_eq!(rows, (10..210).collect::<Vec<_>>(), "each light once");
        for (row, leaf) in leaves {
            let link = |node: u32, word| words[node as usize * WORDS + word];
            assert_eq!(
                [link(leaf, CHILDREN), link(leaf, CHILDREN + 1)],
                [NONE, row]
            );
            let bound = lights[row as usize - 10].1;
            let mut node = leaf;
            let mut depth = 0;
            loop {
                let (centre, radius) = (vector(&words, node, 0), float(&words, node, 3));
                for corner in [bound.least, bound.most] {
                    assert!(
                        corner.distance(centre) <= radius * 1.0001 + 1e-6,
                        "sphere of {node}"
                    );
                }
                let (cosine, sine) = (float(&words, node, 8), float(&words, node, 9));
                let spread = sine.atan2(cosine);
                let between = vector(&words, node, 4).angle_between(bound.axis);
                assert!(
                    (between + bound.spread).min(PI) <= spread + 2e-3,
                    "cone of {node}"
                );
                assert!(
                    float(&words, node, 10) <= bound.reach.cos(),
                    "reach of {node}"
                );
                let parent = link(node, CHILDREN - 1);
                if parent == NONE {
                    assert_eq!(node, 0);
                    break;
                }
                assert!([link(parent, CHILDREN), link(parent, CHILDREN + 1)].contains(&node));
                (node, depth) = (parent, depth + 1);
            }
            assert!(depth < 40, "{depth} nodes above a light");
        }
        assert_eq!(float(&words, 0, 7), 1.0);
    }

    #[test]
    fn cones_contain_both() {
        let close = |(axis, spread): (Vec3, f32), to: (Vec3, f32)| {
            assert!(axis.distance(to.0) < 1e-5 && (spread - to.1).abs() < 1e-5);
        };
        close(cone((Vec3::X, 0.1), (Vec3::X, 0.3)), (Vec3::X, 0.3));
        let both = (Vec3::X + Vec3::Y).normalize();
        close(
            cone((Vec3::X, 0.2), (Vec3::Y, 0.2)),
            (both, 0.2 + FRAC_PI_2 / 2.0),
        );
        assert_eq!(cone((Vec3::X, 0.1), (Vec3::NEG_X, 0.1)).1, PI);
    }

    #[test]
    fn few_lights_and_lights_in_one_place_have_trees() {
        assert_eq!(build(&[]), (Vec::new(), Vec::new()));
        let (words, leaves) = build(&lights(1));
        assert_eq!((words.len(), leaves.len()), (WORDS, 1));
        let one = [(0, lights(1)[0].1); 3];
        assert_eq!(build(&one).1.len(), 3);
    }
}
