//! Cameras: viewpoint and projection.

use glam::{Mat4, Vec3};
use serde::{Deserialize, Serialize};

use crate::bounds::Bounds;
use crate::lens::Lens;
use crate::names::Name;

/// How a camera projects the scene onto its image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Projection {
    /// Perspective with a vertical field of view (rad).
    Perspective {
        /// Full vertical field of view (rad).
        vertical_fov: f32,
    },
    /// Parallel projection.
    Orthographic {
        /// Full height of the visible volume (m).
        height: f32,
    },
}

/// A camera that looks along its local -Z; +Y is up. It sees through an ideal thin lens, and for as long as its shutter is
/// open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Name, for `--camera NAME`.
    pub name: Name,
    /// Rigid transform: columns are right, up, backward and the eye position in world space (m).
    pub world_from_view: Mat4,
    /// Perspective or orthographic.
    pub projection: Projection,
    /// What it does not see sharply.
    pub lens: Lens,
    /// Time for which the shutter is open, from the time of the picture on (s); 0: the picture is of one moment.
    pub shutter: f32,
    /// The animation node that carries the camera, if any.
    pub node: Option<usize>,
}

impl Camera {
    /// A perspective camera at `eye` that looks at `target` (both in world space (m)) with the given vertical field of
    /// view (rad).
    pub fn look_at(name: &str, eye: Vec3, target: Vec3, vertical_fov: f32) -> Self {
        let forward = (target - eye).normalize_or(Vec3::NEG_Z);
        let up = if forward.y.abs() > 0.999 {
            Vec3::Z
        } else {
            Vec3::Y
        };
        let right = forward.cross(up).normalize();
        let true_up = right.cross(forward);
        Self {
            name: name.into(),
            world_from_view: Mat4::from_cols(
                right.extend(0.0),
                true_up.extend(0.0),
                (-forward).extend(0.0),
                eye.extend(1.0),
            ),
            projection: Projection::Perspective { vertical_fov },
            lens: Lens::PINHOLE,
            shutter: 0.0,
            node: None,
        }
    }

    /// A camera that frames `bounds` from the front, slightly from the right and from above. `aspect` is the image's
    /// width over height.
    pub fn framing(bounds: &Bounds, aspect: f32) -> Self {
        let vertical_fov = 35.0_f32.to_radians();
        let center = bounds.center();
        let direction = Vec3::new(0.35, 0.25, 1.0).normalize();
        // Move back until all corners of the box lie inside the frustum.
        let view = Self::look_at("framing", center + direction, center, vertical_fov);
        let (right, up, back) = (
            view.world_from_view.x_axis.truncate(),
            view.world_from_view.y_axis.truncate(),
            view.world_from_view.z_axis.truncate(),
        );
        let tangent_y = (vertical_fov / 2.0).tan();
        let tangent_x = tangent_y * aspect;
        let distance = bounds
            .corners()
            .iter()
            .map(|corner| {
                let from_center = *corner - center;
                let across = from_center.dot(right).abs() / tangent_x;
                let along = from_center.dot(up).abs() / tangent_y;
                from_center.dot(back) + across.max(along)
            })
            .fold(1e-3_f32, f32::max);
        Self::look_at(
            "framing",
            center + direction * distance * 1.05,
            center,
            vertical_fov,
        )
    }
}
