//! Which triangles are near: those in boxes that overlap a box, found in the same rows as rays.

use glam::{Mat4, Vec3, Vec4};

use super::node::NODE_ROWS;
use super::rows::{INSTANCE_ROWS, ROUNDING, Row, TRIANGLE_ROWS};
use super::traverse::INNER;
use crate::Bounds;

/// Tells `found` of each triangle whose leaf overlaps `near` (world space, m): the numbers of its instance and of the
/// triangle within the mesh. Some of them only lie close to `near`; none that meets it is missing. Ends early once `found`
/// returns false. `start` is that of [`super::TopLevel`]. Spheres are the triangles of their meshes here.
pub fn overlapping(
    rows: &[Row],
    start: [u32; 2],
    near: &Bounds,
    mut found: impl FnMut(u32, u32) -> bool,
) {
    let near = grown(near);
    let mut meet_instance = |row: u32| {
        let at = row as usize;
        let [x, y, z] = [0, 1, 2].map(|i| Vec4::from_array(rows[at + i].map(f32::from_bits)));
        let mesh_from_world = Mat4::from_cols(x, y, z, Vec4::W).transpose();
        let [root, instance, ..] = rows[at + 3];
        let near = grown(&near.transformed(&mesh_from_world));
        visit(rows, root, &near, TRIANGLE_ROWS, &mut |row| {
            found(instance, rows[row as usize][3])
        })
    };
    match start[1] & INNER {
        0 => meet_instance(start[0]),
        _ => visit(rows, start[0], &near, INSTANCE_ROWS, &mut meet_instance),
    };
}

/// The box, larger by what rounding may have taken from it.
fn grown(near: &Bounds) -> Bounds {
    let slack = near.min.abs().max(near.max.abs()) * ROUNDING as f32;
    Bounds {
        min: near.min - slack,
        max: near.max + slack,
    }
}

/// Tells `meet` the rows of leaf items, `item_rows` each, whose boxes overlap `near`, below the node at `root`. Returns
/// whether `meet` wanted all of them.
fn visit(
    rows: &[Row],
    root: u32,
    near: &Bounds,
    item_rows: u32,
    meet: &mut impl FnMut(u32) -> bool,
) -> bool {
    let mut nodes = vec![root];
    while let Some(row) = nodes.pop() {
        let node = &rows[row as usize..(row + NODE_ROWS) as usize];
        let origin = Vec3::from_array([0, 1, 2].map(|axis| f32::from_bits(node[0][axis])));
        let step = [0, 8, 16].map(|shift| f32::from_bits(((node[0][3] >> shift) & 255) << 23));
        let byte = |words: &[u32], slot: usize| (words[slot / 4] >> (slot % 4 * 8)) & 255;
        let mut inner = 0;
        for slot in 0..8 {
            let meta = byte(&node[1][2..], slot);
            let overlaps = (0..3).all(|axis| {
                let plane = |first: usize| {
                    let cells = byte(&node[2 + axis][first..], slot) as f32;
                    origin[axis] + cells * step[axis]
                };
                plane(0) <= near.max[axis] && plane(2) >= near.min[axis]
            });
            if meta & 0x18 == 0x18 {
                if overlaps {
                    nodes.push(node[1][0] + inner * NODE_ROWS);
                }
                inner += 1;
            } else if overlaps {
                let first = meta & 31;
                for item in first..first + (meta >> 5).count_ones() {
                    if !meet(node[1][1] + item * item_rows) {
                        return false;
                    }
                }
            }
        }
    }
    true
}
