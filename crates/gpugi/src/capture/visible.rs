//! Surface points on the host: what images of them show.

use glam::{Vec2, Vec3};
use gpugi_scene::image::unpack_rgb9e5;

/// A surface point packed by capture/surface_point.wesl, unpacked on the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VisiblePoint {
    /// World space (m).
    pub position: Vec3,
    /// Unit shading normal, world space, toward the viewer.
    pub normal: Vec3,
    /// Diffuse albedo plus reflectance at normal incidence.
    pub albedo: Vec3,
    /// Index of the instance.
    pub instance: u32,
}

impl VisiblePoint {
    /// Unpacks the 12 words of a point; `None` where there is no surface.
    pub fn unpack(words: &[u32]) -> Option<Self> {
        let &[x, y, z, normal, _, _, diffuse, f0, _, _, instance, _] = words else {
            return None;
        };
        (instance != u32::MAX).then(|| Self {
            position: Vec3::from_array([x, y, z].map(f32::from_bits)),
            normal: octahedral(normal),
            albedo: (unpack_rgb9e5(diffuse) + unpack_rgb9e5(f0)).min(Vec3::ONE),
            instance,
        })
    }
}

/// CPU twin of `decode` in shared/octahedral.wesl.
fn octahedral(word: u32) -> Vec3 {
    let snorm = |half: u32| (f32::from(half as u16 as i16) / 32767.0).max(-1.0);
    let p = Vec2::new(snorm(word & 0xffff), snorm(word >> 16));
    let z = 1.0 - p.x.abs() - p.y.abs();
    let xy = if z < 0.0 {
        (Vec2::ONE - Vec2::new(p.y.abs(), p.x.abs()))
            * Vec2::new(1.0_f32.copysign(p.x), 1.0_f32.copysign(p.y))
    } else {
        p
    };
    xy.extend(z).normalize()
}
