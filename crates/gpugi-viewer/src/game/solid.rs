//! The scene as something to stand on and to bump into: the hierarchy of its triangles, as rays of the renderer have one,
//! on the CPU. It follows what moves and what deforms.

use std::ops::Range;
use std::sync::Arc;

use glam::{Mat4, Vec3};
use gpugi_scene::bvh::traverse::{Ray, closest_hit};
use gpugi_scene::bvh::{BottomLevel, BvhError, BvhInstance, Row, overlapping};
use gpugi_scene::{Bounds, Document, Edit, Mesh};

/// Most triangles that are looked at around a body in one frame. What is finer does not stop it.
const MOST: usize = 8192;

/// The scene's triangles. Whether a material is see-through or has holes does not matter: all of them are solid, from both
/// sides.
#[derive(Debug)]
pub struct Solid {
    meshes: Vec<Arc<Mesh>>,
    /// World space from mesh space.
    instances: Vec<BvhInstance>,
    /// Instances that are not solid.
    left_out: Range<usize>,
    bottom: BottomLevel,
    /// Those of `bottom`, then those of the top level.
    rows: Vec<Row>,
    start: [u32; 2],
    /// The document's revision that this is.
    revision: u64,
}

/// Where a ray meets something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// World space (m).
    pub point: Vec3,
    /// Index of the instance.
    pub instance: usize,
}

/// A triangle in world space (m).
pub type Triangle = [Vec3; 3];

impl Solid {
    /// The scene as it is now, without the instances in `left_out`.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn new(document: &Document, left_out: Range<usize>) -> Result<Self, BvhError> {
        let scene = document.scene();
        let instances = scene.instances.iter().map(|instance| BvhInstance {
            mesh: instance.mesh,
            world_from_mesh: instance.world_from_mesh,
            flags: 0,
            sphere: None,
        });
        let mut solid = Self {
            meshes: scene.meshes.clone(),
            instances: instances.collect(),
            left_out,
            bottom: BottomLevel::default(),
            rows: Vec::new(),
            start: [0, 0],
            revision: document.revision(),
        };
        solid.build()?;
        Ok(solid)
    }

    /// Builds all of it, with the trees that the meshes had before or brought along.
    fn build(&mut self) -> Result<(), BvhError> {
        let meshes = self.meshes.iter().map(|mesh| {
            let tree = mesh.tree.clone();
            let corners = corners(mesh);
            gpugi_scene::bvh::MeshTriangles { corners, tree }
        });
        (self.bottom, self.rows) = self.bottom.following(meshes)?;
        self.place()
    }

    /// Builds the top level, for instances that have moved.
    fn place(&mut self) -> Result<(), BvhError> {
        let mut instances = self.instances.clone();
        for instance in &mut instances[self.left_out.clone()] {
            // The hierarchy leaves out what has no volume.
            instance.world_from_mesh = Mat4::ZERO;
        }
        let (top, rows) = self.bottom.top_level(&instances)?;
        self.rows.truncate(self.bottom.end() as usize);
        self.rows.extend(rows);
        self.start = top.start;
        Ok(())
    }

    /// Follows the document's edits since it last did. Returns whether something solid has changed.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn follow(&mut self, document: &Document) -> Result<bool, BvhError> {
        if document.revision() == self.revision {
            return Ok(false);
        }
        let edits = document.since(self.revision);
        self.revision = document.revision();
        let (mut has_moved, mut has_another_tree) = (false, false);
        for edit in edits {
            match edit {
                Edit::Instance {
                    index,
                    world_from_mesh,
                } if !self.left_out.contains(&index) => {
                    self.instances[index].world_from_mesh = world_from_mesh;
                    has_moved = true;
                }
                Edit::Mesh { index, mesh } => {
                    let bent = self.bottom.bend(index, &corners(&mesh))?;
                    self.meshes[index] = mesh;
                    has_moved = true;
                    match bent {
                        Some((first, rows)) => {
                            let first = first as usize;
                            self.rows[first..first + rows.len()].copy_from_slice(&rows);
                        }
                        None => has_another_tree = true,
                    }
                }
                _ => {}
            }
        }
        if has_another_tree {
            self.build()?;
        } else if has_moved {
            self.place()?;
        }
        Ok(has_moved)
    }

    /// World space from the mesh space of an instance.
    pub fn place_of(&self, instance: usize) -> Mat4 {
        self.instances[instance].world_from_mesh
    }

    /// What lies first on the way from `origin` along `way` (world space (m)).
    pub fn cast(&self, origin: Vec3, way: Vec3) -> Option<Touch> {
        if !(origin.is_finite() && way.is_finite()) || way == Vec3::ZERO {
            return None;
        }
        let ray = Ray {
            origin,
            t_min: 0.0,
            direction: way,
            t_max: 1.0,
        };
        let hit = closest_hit(&self.rows, self.start, &ray, |_, _, _| true).hit?;
        Some(Touch {
            point: origin + way * hit.t,
            instance: hit.instance as usize,
        })
    }

    /// The triangles that may meet a box (world space (m)).
    pub fn near(&self, bounds: &Bounds) -> Vec<Triangle> {
        let mut near = Vec::new();
        overlapping(&self.rows, self.start, bounds, |instance, triangle| {
            let BvhInstance {
                mesh,
                world_from_mesh,
                ..
            } = &self.instances[instance as usize];
            let mesh = &self.meshes[*mesh];
            let first = 3 * triangle as usize;
            let corner = |corner: usize| {
                let position = mesh.positions[mesh.indices[first + corner] as usize];
                world_from_mesh.transform_point3(position)
            };
            near.push([corner(0), corner(1), corner(2)]);
            near.len() < MOST
        });
        near
    }
}

/// The corners of a mesh's triangles.
fn corners(mesh: &Mesh) -> Vec<Triangle> {
    let triangles = mesh.indices.as_chunks::<3>().0.iter();
    let corner = |&index: &u32| mesh.positions[index as usize];
    triangles
        .map(|triangle| triangle.each_ref().map(corner))
        .collect()
}

/// The point of a triangle that is nearest to `point`. Ericson, "Real-Time Collision Detection" (2005), section 5.1.5.
pub fn nearest_on([a, b, c]: Triangle, point: Vec3) -> Vec3 {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    // Twice the areas of the triangles that the projected point makes with the edges, times the whole one's.
    let (of_a, of_b, of_c) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let (along, back) = (d4 - d3, d5 - d6);
    if of_a <= 0.0 && along >= 0.0 && back >= 0.0 {
        return b + (c - b) * (along / (along + back));
    }
    let all = of_a + of_b + of_c;
    a + (ab * of_b + ac * of_c) / all
}
