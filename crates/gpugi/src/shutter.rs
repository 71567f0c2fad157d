//! What moves while a camera's shutter is open.

use gpugi_scene::{Camera, Scene};

use crate::sequences::GOLDEN_RATIO;

/// A scene with an animation, at a time of it.
#[derive(Debug, Clone)]
pub struct Motion {
    scene: Scene,
    time: f32,
}

impl Motion {
    /// That of `scene`, which is posed at `time` (s). `None` if nothing in it moves.
    pub fn new(scene: &Scene, time: f32) -> Option<Self> {
        let moves = scene.rig.as_ref().is_some_and(|rig| rig.moves());
        moves.then(|| Self {
            scene: scene.clone(),
            time,
        })
    }

    /// That of `scene` while the shutter of `camera` is open, if anything moves then.
    pub fn seen_by(camera: &Camera, scene: &Scene, time: f32) -> Option<Self> {
        match camera.shutter > 0.0 {
            true => Self::new(scene, time),
            false => None,
        }
    }

    /// The scene at its time, as it was given.
    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The scene, so long after its time (s). Animations loop, so a shutter may be open for longer than one of them.
    pub(crate) fn after(&self, seconds: f32) -> Scene {
        let mut scene = self.scene.clone();
        scene.pose(self.time + seconds);
        scene
    }

    /// The camera, so long after its time (s).
    pub(crate) fn camera_after(&self, camera: &Camera, seconds: f32) -> Camera {
        self.scene.camera_at(camera, self.time + seconds)
    }
}

/// The part of a shutter's time (0 to 1) at which sample `index` of a picture is taken: an additive sequence, so the first
/// n samples are spread evenly, whatever n is.
pub(crate) fn moment(index: u32) -> f32 {
    (0.5 + GOLDEN_RATIO * f64::from(index)).fract() as f32
}
