//! The scene in the making, with the materials and nodes that its parts share.

use glam::Mat4;

use super::motion::Motion;
use super::palette::Palette;
use crate::builtin::shapes::join;
use crate::{Mesh, Scene};

/// The scene that is built: its static parts by material, and what moves.
pub struct Stage {
    pub scene: Scene,
    pub motion: Motion,
    pub palette: Palette,
    /// Factor of the number of segments of curves.
    pub detail: u32,
}

impl Stage {
    pub fn new(name: &str, detail: u32) -> Self {
        let mut scene = Scene::new(name);
        Self {
            palette: Palette::new(&mut scene),
            scene,
            motion: Motion::default(),
            detail,
        }
    }

    /// Adds what stands still, joined into one mesh; returns its instance.
    pub fn place(
        &mut self,
        name: &str,
        material: Finish,
        parts: impl IntoIterator<Item = Mesh>,
    ) -> usize {
        let mesh = material.applied(join(name, parts));
        let mesh = self.scene.add_mesh(mesh);
        self.scene
            .add_instance(name, mesh, material.material, Mat4::IDENTITY)
    }

    /// Adds what a node carries; the parts are in the node's space.
    pub fn carry(
        &mut self,
        name: &str,
        node: usize,
        material: Finish,
        parts: impl IntoIterator<Item = Mesh>,
    ) -> usize {
        let instance = self.place(name, material, parts);
        self.scene.instances[instance].node = Some(node);
        instance
    }

    /// The scene at time 0.
    pub fn finish(mut self) -> Scene {
        self.scene.rig = Some(self.motion.rig);
        self.scene.pose(0.0);
        self.scene
    }
}

/// A material, and how large its texture is.
#[derive(Clone, Copy)]
pub struct Finish {
    pub material: usize,
    /// Side of the texture's tile (m); `None` keeps the texture coordinates of the shapes.
    pub tile: Option<f32>,
}

impl Finish {
    fn applied(self, mesh: Mesh) -> Mesh {
        match self.tile {
            Some(side) => crate::builtin::shapes::papered(mesh, side),
            None => mesh,
        }
    }
}
