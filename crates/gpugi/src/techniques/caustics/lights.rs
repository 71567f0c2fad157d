//! Views of objects from lights, for caustic maps.

use glam::{Vec2, Vec3};
use gpugi_scene::{Bounds, Camera, Projection};

use super::gpu::CausticMap;
use crate::capture::View;
use crate::lights::gpu::LightSample;

/// Largest tangent of half a caustic map's field of view: 150 degrees, for lights beside or inside an object.
const LARGEST_TANGENT: f32 = 3.7;

/// A light's view of an object.
#[derive(Debug, Clone, Copy)]
pub struct LightView {
    /// Camera of the capture.
    pub view: View,
    /// What the photon passes read. The caller sets `corner`, `counts` and `frame`.
    pub map: CausticMap,
}

impl LightView {
    /// The light's view in `framing`, `side` x `side` pixels. `jitter` in pixels; `diagonal` of the scene (m).
    pub fn new(
        light: &LightSample,
        framing: &Framing,
        side: u32,
        jitter: Vec2,
        seed: u32,
        diagonal: f32,
    ) -> Self {
        let view = View::new(&framing.camera, [side, side], jitter, 0, seed, diagonal);
        let pixel = 2.0 * framing.half / side as f32;
        Self {
            view,
            map: CausticMap {
                view: view.uniform,
                light: *light,
                corner: [0; 2],
                is_perspective: u32::from(framing.is_perspective),
                pixel_area: pixel * pixel,
                // Flux of a pixel at the map's centre, straight in front of the light: no other pixel receives more.
                unit: framing.intensity * pixel * pixel,
                counts: 0.0,
                seed,
                frame: 0,
            },
        }
    }
}

/// How a light's view frames an object.
#[derive(Debug, Clone)]
pub struct Framing {
    camera: Camera,
    is_perspective: bool,
    /// Half the width of the view: on the plane at distance 1 in front of the light, or, of a directional light, on one
    /// perpendicular to its direction (m).
    half: f32,
    /// The light's greatest intensity (W/sr), or irradiance (W/m^2).
    intensity: f32,
}

impl Framing {
    /// The view of the box `bounds` from a light, for a map of `side` x `side` pixels; `None` if the light does not
    /// reach the box. `diagonal` of the scene (m).
    pub fn new(light: &LightSample, bounds: &Bounds, side: u32, diagonal: f32) -> Option<Self> {
        let center = bounds.center();
        let position = Vec3::from_array(light.position);
        let direction = Vec3::from_array(light.direction);
        let is_perspective = light.kind != LightSample::DIRECTIONAL;
        let eye = if is_perspective {
            position
        } else {
            // Far enough back that every possible occluder lies in front.
            center - direction * diagonal
        };
        let intensity = Vec3::from_array(light.intensity).max_element();
        if !(shines_on(light, bounds) && intensity > 0.0 && intensity.is_finite()) {
            return None;
        }
        let mut camera = Camera::look_at("light", eye, center, 1.0);
        let [right, up, back] = [0, 1, 2].map(|axis| camera.world_from_view.col(axis).truncate());
        let half = bounds.corners().iter().fold(0.0_f32, |largest, corner| {
            let from_eye = *corner - eye;
            let across = from_eye.dot(right).abs().max(from_eye.dot(up).abs());
            let depth = -from_eye.dot(back);
            largest.max(match (is_perspective, depth > 0.0) {
                (false, _) => across,
                (true, true) => (across / depth).min(LARGEST_TANGENT),
                (true, false) => LARGEST_TANGENT,
            })
        });
        // A margin: the outermost pixels need neighbours, and jitter must not move the object out of view.
        let half = half * (1.0 + 4.0 / side as f32);
        if !(half > 0.0 && half.is_finite()) {
            return None;
        }
        camera.projection = if is_perspective {
            Projection::Perspective {
                vertical_fov: 2.0 * half.atan(),
            }
        } else {
            Projection::Orthographic { height: 2.0 * half }
        };
        Some(Self {
            camera,
            is_perspective,
            half,
            intensity,
        })
    }

    /// Upper bound on the flux that all pixels together receive (W).
    pub fn flux(&self) -> f64 {
        f64::from(self.intensity) * (2.0 * f64::from(self.half)).powi(2)
    }
}

/// Whether any of the light may reach the box.
fn shines_on(light: &LightSample, bounds: &Bounds) -> bool {
    let away = bounds.center() - Vec3::from_array(light.position);
    let radius = bounds.diagonal() / 2.0;
    let along = away.dot(Vec3::from_array(light.direction));
    match light.kind {
        LightSample::AREA => along > -radius,
        LightSample::SPOT => {
            let end = light.cone_end.acos();
            let distance = away.length();
            let own = (radius / distance.max(1e-12)).min(1.0).asin();
            distance <= radius || (along / distance).clamp(-1.0, 1.0).acos() < end + own
        }
        _ => true,
    }
}
