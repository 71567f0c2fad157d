//! Light from infinitely far away.

use std::sync::Arc;

use glam::{EulerRot, Quat, Vec3};
use serde::{Deserialize, Serialize};

use crate::{Image, Pixels};

/// Light from infinitely far away: an equirectangular image. +Y is up, the centre looks toward -Z, and u grows toward
/// +X.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Environment {
    /// Linear radiance.
    pub image: Arc<Image>,
    /// World space from the image's; a unit quaternion.
    pub rotation: Quat,
    /// Factor applied to the radiance.
    pub intensity: f32,
}

impl Environment {
    /// The rotation by yaw, pitch and roll (rad): rolled about +Z first, then pitched about +X, then turned about +Y.
    pub fn rotation_by([yaw, pitch, roll]: [f32; 3]) -> Quat {
        Quat::from_euler(EulerRot::YXZ, yaw, pitch, roll)
    }

    /// Yaw, pitch and roll (rad) of the rotation: the inverse of [`Environment::rotation_by`].
    pub fn angles(&self) -> [f32; 3] {
        let (yaw, pitch, roll) = self.rotation.to_euler(EulerRot::YXZ);
        [yaw, pitch, roll]
    }

    /// A clear sky with a low sun behind the viewer's left shoulder, and grey ground. Lights scenes that have no light
    /// of their own.
    pub fn default_sky() -> Self {
        let sun = Vec3::new(-0.45, 0.65, 0.6).normalize();
        Self::procedural("default sky", |direction| {
            // A sun disc of 5 degrees radius: small enough to cast distinct shadows, wide enough for the texel grid.
            let toward_sun = direction.dot(sun);
            let disc = if toward_sun > 0.9962 { 180.0 } else { 0.0 };
            let glow = toward_sun.max(0.0).powi(64) * 0.8;
            clear_sky_radiance(direction) + Vec3::new(1.0, 0.92, 0.8) * (disc + glow)
        })
    }

    /// The same sky without its sun.
    pub(crate) fn clear_sky() -> Self {
        Self::procedural("clear sky", clear_sky_radiance)
    }

    /// An environment with the given radiance by direction.
    fn procedural(name: &str, radiance: impl Fn(Vec3) -> Vec3) -> Self {
        const WIDTH: u32 = 256;
        const HEIGHT: u32 = 128;
        let mut texels = Vec::with_capacity((WIDTH * HEIGHT * 4) as usize);
        for y in 0..HEIGHT {
            let theta = std::f32::consts::PI * (y as f32 + 0.5) / HEIGHT as f32;
            for x in 0..WIDTH {
                let phi = std::f32::consts::TAU * ((x as f32 + 0.5) / WIDTH as f32 - 0.5);
                let direction = Vec3::new(
                    phi.sin() * theta.sin(),
                    theta.cos(),
                    -phi.cos() * theta.sin(),
                );
                let radiance = radiance(direction);
                texels.extend([radiance.x, radiance.y, radiance.z, 1.0]);
            }
        }
        Self {
            image: Arc::new(Image {
                name: name.to_owned(),
                width: WIDTH,
                height: HEIGHT,
                pixels: Pixels::Rgba32Float(texels),
            }),
            rotation: Quat::IDENTITY,
            intensity: 1.0,
        }
    }
}

/// Radiance of a clear sky above grey ground.
fn clear_sky_radiance(direction: Vec3) -> Vec3 {
    if direction.y > 0.0 {
        let height = direction.y.sqrt();
        Vec3::new(0.75, 0.85, 1.0).lerp(Vec3::new(0.18, 0.36, 0.8), height)
    } else {
        Vec3::splat(0.22)
    }
}
