//! The shape of a refractor, which stays valid while the object only moves and rotates.

use glam::{DMat3, DQuat, Mat4, Quat};
use wgpu::BindingResource::TextureView;

use super::ObjectMaps;
use super::textures::layers;
use crate::capture::{Capture, CaptureKernels, CubeView};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

/// Captures shapes. Later frames reuse the buffers. Within a frame each shape needs its own, because all writes to
/// buffers precede the frame's passes.
#[derive(Debug)]
pub(super) struct ShapePasses {
    kernels: CaptureKernels,
    store: Kernel,
    /// Captures, each with its points as bind group 1 of `store`.
    captures: Vec<(Capture, wgpu::BindGroup)>,
    /// How many of them serve in this frame.
    used: usize,
}

impl ShapePasses {
    pub fn new(gpu: &Gpu, scene: &GpuScene, kernels: &CaptureKernels) -> Result<Self, GpuError> {
        let store = shader!("impostor.store");
        Ok(Self {
            kernels: kernels.clone(),
            store: Kernel::new(gpu, &store, "shape", Some(&scene.layout))?,
            captures: Vec::new(),
            used: 0,
        })
    }

    /// Lets all captures serve again.
    pub fn begin_frame(&mut self) {
        self.used = 0;
    }

    /// A capture of a cube with faces of `side` x `side` texels that has not served in this frame.
    fn capture(
        &mut self,
        gpu: &Gpu,
        side: u32,
    ) -> Result<&mut (Capture, wgpu::BindGroup), GpuError> {
        let free = self.captures.iter().skip(self.used);
        let found = free
            .clone()
            .position(|(capture, _)| capture.size()[0] == side);
        match found {
            Some(ahead) => self.captures.swap(self.used, self.used + ahead),
            None => {
                let capture = Capture::of_cube(gpu, &self.kernels, side)?;
                let points = capture.points.bind(gpu, &self.store)?;
                self.captures.insert(self.used, (capture, points));
            }
        }
        self.used += 1;
        Ok(&mut self.captures[self.used - 1])
    }
}

/// The state of which a shape was captured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shaped {
    /// Version of the geometry since which the object has this mesh, and the versions of instances and of materials:
    /// normal maps and alpha affect the shape, too.
    versions: [u64; 3],
    world_from_mesh: Mat4,
}

impl Shaped {
    /// The parts move together: the first one's placement stands for all.
    fn new(scene: &GpuScene, instances: &[u32]) -> Self {
        let of = |&instance: &u32| scene.placements.get(instance as usize);
        let bent = instances
            .iter()
            .filter_map(of)
            .map(|placement| placement.bent)
            .max();
        let first = instances.first().and_then(of);
        let versions = scene.versions;
        Self {
            versions: [bent.unwrap_or(0), versions.instances, versions.materials],
            world_from_mesh: first.map_or(Mat4::IDENTITY, |placement| placement.world_from_mesh),
        }
    }

    /// Rotation of the object since then, if it only moved and rotated.
    fn turned_to(&self, now: &Self) -> Option<Quat> {
        (self.versions == now.versions)
            .then(|| rotation(&self.world_from_mesh, &now.world_from_mesh))
            .flatten()
    }
}

/// The rotation from one placement to another, if they differ only by a rotation and a translation.
fn rotation(from: &Mat4, to: &Mat4) -> Option<Quat> {
    /// How much a rotation's axes may differ from orthonormal ones: too little to show in a shape's texels.
    const TOLERANCE: f64 = 1e-4;
    let [from, to] = [from, to].map(|transform| DMat3::from_mat4(transform.as_dmat4()));
    if from == to {
        return Some(Quat::IDENTITY);
    }
    let turn = to * from.inverse();
    let off = turn.transpose() * turn - DMat3::IDENTITY;
    let is_rigid = off
        .to_cols_array()
        .iter()
        .all(|entry| entry.abs() < TOLERANCE);
    (is_rigid && turn.determinant() > 0.0).then(|| DQuat::from_mat3(&turn).normalize().as_quat())
}

impl ObjectMaps {
    /// Rotates the object's shape, if that is enough; otherwise a capture is due.
    pub(super) fn follow_shape(&mut self, scene: &GpuScene) {
        let now = Shaped::new(scene, &self.wanted.instances);
        match self.shaped.and_then(|shaped| shaped.turned_to(&now)) {
            Some(turn) => self.maps.world_from_shape = turn,
            None => self.is_shape_due = true,
        }
    }

    /// Captures the object's shape as it is now.
    pub(super) fn capture_shape(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        passes: &mut ShapePasses,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let side = self.maps.shape_normals.width();
        let stored = match &self.stored_shape {
            Some(stored) => stored,
            None => {
                let [distances, normals] = [&self.maps.shape, &self.maps.shape_normals];
                let [distances, normals] = [distances, normals].map(layers);
                let resources = [
                    ("distances", TextureView(&distances)),
                    ("normals", TextureView(&normals)),
                ];
                let stored = passes.store.bind(gpu, 3, &resources)?;
                self.stored_shape.insert(stored)
            }
        };
        let (capture, points) = passes.capture(gpu, side)?;
        let view = CubeView::new(self.maps.center, side, scene.near(), 0, 0);
        let wanted = &self.wanted;
        capture.record_cube(frame, scene, &view, |draw| {
            wanted
                .is_own(draw)
                .then(|| scene.whole_class(draw).from_both_sides())
        })?;
        let points = points.clone();
        frame.compute("impostor.store", |pass| {
            let groups = [(0, &scene.bind_group), (1, &points), (3, stored)];
            passes.store.dispatch(pass, &groups, [side, side, 6]);
        });
        self.shape_pyramid.record(frame);
        self.maps.world_from_shape = Quat::IDENTITY;
        self.shaped = Some(Shaped::new(scene, &self.wanted.instances));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, vec3};

    use super::*;

    #[test]
    fn only_rigid_movements_are_rotations() {
        let from = Mat4::from_scale_rotation_translation(
            vec3(2.0, -0.3, 0.01),
            Quat::from_rotation_x(0.4),
            vec3(5.0, 1.0, 0.0),
        );
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 1.0, 2.5, -0.7);
        let moved = |by: Mat4| rotation(&from, &(Mat4::from_translation(Vec3::ONE) * by * from));
        let found = moved(Mat4::from_quat(turn)).unwrap();
        assert!(found.angle_between(turn) < 1e-3, "{found}, not {turn}");
        assert_eq!(moved(Mat4::IDENTITY), Some(Quat::IDENTITY));
        let shear = Mat4::from_cols_array(&[
            1.0, 0.1, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        ]);
        let mirroring = Mat4::from_scale(vec3(1.0, 1.0, -1.0));
        for other in [shear, mirroring, Mat4::from_scale(Vec3::splat(1.01))] {
            assert_eq!(moved(other), None, "{other}");
        }
        let flat = Mat4::from_scale(vec3(1.0, 0.0, 1.0));
        assert_eq!(rotation(&flat, &flat), Some(Quat::IDENTITY));
        assert_eq!(rotation(&flat, &from), None);
    }
}
