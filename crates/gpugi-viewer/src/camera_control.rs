//! A camera that people steer: it orbits around a target, pans, zooms, flies and looks around, and follows its goal
//! smoothly.

use glam::{Mat3, Mat4, Vec2, Vec3};
use gpugi_scene::{Bounds, Camera, Projection};

/// Steepest angle against the horizon (rad): straight up, the camera would have no side that is up.
const STEEPEST: f32 = 1.55;
/// Time in which the camera covers all but 1/e of the way to its goal (s).
const DAMPING_SECONDS: f32 = 0.06;
/// Perspective cameras keep their vertical field of view between these (rad).
const FIELDS_OF_VIEW: [f32; 2] = [0.05, 2.4];

/// Where the camera stands and what it looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Viewpoint {
    /// World space (m).
    target: Vec3,
    /// From the eye to the target (m).
    distance: f32,
    /// Angle of the eye around +Y, seen from the target; 0 is +Z (rad).
    yaw: f32,
    /// Height of the eye above the horizon, seen from the target (rad).
    pitch: f32,
    /// Vertical field of view (rad), or the height of a parallel projection's volume (m).
    opening: f32,
}

impl Viewpoint {
    /// Unit vector from the target to the eye, world space.
    fn backward(&self) -> Vec3 {
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        Vec3::new(cos_pitch * sin_yaw, sin_pitch, cos_pitch * cos_yaw)
    }

    fn eye(&self) -> Vec3 {
        self.target + self.distance * self.backward()
    }

    /// Columns: right, up and backward, world space.
    fn axes(&self) -> Mat3 {
        let backward = self.backward();
        let right = Vec3::Y.cross(backward).normalize_or(Vec3::X);
        Mat3::from_cols(right, backward.cross(right), backward)
    }

    /// Turns the view by keeping the eye.
    fn turn_around_eye(&mut self, yaw: f32, pitch: f32) {
        let eye = self.eye();
        self.yaw = yaw;
        self.pitch = pitch.clamp(-STEEPEST, STEEPEST);
        self.target = eye - self.distance * self.backward();
    }

    /// The point that lies `part` of the way to `goal`.
    fn toward(&self, goal: &Self, part: f32) -> Self {
        Self {
            target: self.target.lerp(goal.target, part),
            distance: self.distance + (goal.distance - self.distance) * part,
            yaw: self.yaw + (goal.yaw - self.yaw) * part,
            pitch: self.pitch + (goal.pitch - self.pitch) * part,
            opening: self.opening + (goal.opening - self.opening) * part,
        }
    }

    /// Whether nobody sees the difference.
    fn is_near(&self, other: &Self) -> bool {
        let turned = (self.yaw - other.yaw).abs() + (self.pitch - other.pitch).abs();
        let moved = self.eye().distance(other.eye()) / self.distance.max(1e-6);
        turned < 1e-4 && moved < 1e-4 && (self.opening / other.opening - 1.0).abs() < 1e-4
    }
}

/// A camera that people steer.
#[derive(Debug, Clone)]
pub struct CameraControl {
    /// The scene's camera, exactly as it is, until somebody steers.
    untouched: Option<Camera>,
    shown: Viewpoint,
    goal: Viewpoint,
    is_parallel: bool,
    /// Size of the scene, by which it zooms and flies (m).
    diagonal: f32,
}

impl CameraControl {
    /// Stands where `camera` stands in a scene within `bounds`.
    pub fn new(camera: &Camera, bounds: &Bounds) -> Self {
        let viewpoint = viewpoint_of(camera, bounds);
        Self {
            untouched: Some(camera.clone()),
            shown: viewpoint,
            goal: viewpoint,
            is_parallel: matches!(camera.projection, Projection::Orthographic { .. }),
            diagonal: bounds.diagonal().max(1e-3),
        }
    }

    /// The camera of this frame.
    pub fn camera(&self) -> Camera {
        if let Some(camera) = &self.untouched {
            return camera.clone();
        }
        let axes = self.shown.axes();
        let opening = self.shown.opening;
        Camera {
            name: "viewer".into(),
            world_from_view: Mat4::from_cols(
                axes.x_axis.extend(0.0),
                axes.y_axis.extend(0.0),
                axes.z_axis.extend(0.0),
                self.shown.eye().extend(1.0),
            ),
            projection: if self.is_parallel {
                Projection::Orthographic { height: opening }
            } else {
                Projection::Perspective {
                    vertical_fov: opening,
                }
            },
            node: None,
        }
    }

    /// The camera as an argument of `gpugi render --camera`: its name, if it is one of the scene's `cameras`. None for
    /// what that cannot say.
    pub fn argument(&self, cameras: &[Camera]) -> Option<String> {
        let of_scene = |camera: &&Camera| cameras.iter().any(|one| one.name == camera.name);
        if let Some(camera) = self.untouched.as_ref().filter(of_scene) {
            return Some(camera.name.to_string());
        }
        if self.is_parallel {
            return None;
        }
        let point = |point: Vec3| format!("{:.5},{:.5},{:.5}", point.x, point.y, point.z);
        Some(format!(
            "eye={};target={};fov={:.3}",
            point(self.goal.eye()),
            point(self.goal.target),
            self.goal.opening.to_degrees()
        ))
    }

    /// Moves toward the goal for `seconds`. Returns whether the camera moves.
    pub fn advance(&mut self, seconds: f32) -> bool {
        if self.shown == self.goal {
            return false;
        }
        let part = 1.0 - (-seconds / DAMPING_SECONDS).exp();
        self.shown = self.shown.toward(&self.goal, part);
        if self.shown.is_near(&self.goal) {
            self.shown = self.goal;
        }
        true
    }

    /// Turns around the target, by angles (rad): to the right and up.
    pub fn orbit(&mut self, angles: Vec2) {
        self.untouched = None;
        self.goal.yaw -= angles.x;
        self.goal.pitch = (self.goal.pitch + angles.y).clamp(-STEEPEST, STEEPEST);
    }

    /// Looks around from where it stands, by angles (rad): to the right and up.
    pub fn look(&mut self, angles: Vec2) {
        self.untouched = None;
        let (yaw, pitch) = (self.goal.yaw - angles.x, self.goal.pitch - angles.y);
        self.goal.turn_around_eye(yaw, pitch);
    }

    /// Shifts the view in its plane, in heights of the picture: what was seen there moves right and up.
    pub fn pan(&mut self, heights: Vec2) {
        self.untouched = None;
        let height = if self.is_parallel {
            self.goal.opening
        } else {
            2.0 * self.goal.distance * (self.goal.opening / 2.0).tan()
        };
        let axes = self.goal.axes();
        self.goal.target -= (axes.x_axis * heights.x + axes.y_axis * heights.y) * height;
    }

    /// Goes nearer (factor below 1) or farther from the target.
    pub fn zoom(&mut self, factor: f32) {
        self.untouched = None;
        if self.is_parallel {
            self.goal.opening = (self.goal.opening * factor).clamp(1e-4, 100.0 * self.diagonal);
            return;
        }
        let range = [1e-4, 100.0].map(|times| times * self.diagonal);
        self.goal.distance = (self.goal.distance * factor).clamp(range[0], range[1]);
    }

    /// Flies right, up and forward; a length of 1 crosses the scene in four seconds.
    pub fn fly(&mut self, direction: Vec3, seconds: f32) {
        self.untouched = None;
        let axes = self.goal.axes();
        let way = axes.x_axis * direction.x + Vec3::Y * direction.y - axes.z_axis * direction.z;
        self.goal.target += way * (seconds * self.diagonal / 4.0);
    }

    /// Turns toward a point, around which it orbits from now on (world space (m)).
    pub fn focus(&mut self, point: Vec3) {
        let eye = self.goal.eye();
        let way = eye - point;
        if way.length() < 1e-4 * self.diagonal || !point.is_finite() {
            return;
        }
        self.untouched = None;
        let [yaw, pitch] = angles_of(way.normalize());
        // The shorter way around.
        let turn = (yaw - self.goal.yaw + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU);
        self.goal.yaw += turn - std::f32::consts::PI;
        self.goal.pitch = pitch;
        self.goal.distance = way.length();
        self.goal.target = eye - self.goal.distance * self.goal.backward();
    }

    /// Vertical field of view (degrees); none for a parallel projection.
    pub fn field_of_view(&self) -> Option<f32> {
        (!self.is_parallel).then(|| self.goal.opening.to_degrees())
    }

    /// Sets the vertical field of view (degrees).
    pub fn set_field_of_view(&mut self, degrees: f32) {
        self.untouched = None;
        let [least, most] = FIELDS_OF_VIEW;
        self.goal.opening = degrees.to_radians().clamp(least, most);
    }
}

/// Yaw and pitch of a unit vector from the target to the eye.
fn angles_of(backward: Vec3) -> [f32; 2] {
    let pitch = backward.y.clamp(-1.0, 1.0).asin();
    [
        backward.x.atan2(backward.z),
        pitch.clamp(-STEEPEST, STEEPEST),
    ]
}

/// The viewpoint of a camera. It looks at the point of its axis that is nearest to the middle of the scene.
fn viewpoint_of(camera: &Camera, bounds: &Bounds) -> Viewpoint {
    let eye = camera.world_from_view.w_axis.truncate();
    let backward = camera.world_from_view.z_axis.truncate();
    let backward = backward.normalize_or(Vec3::Z);
    let diagonal = bounds.diagonal().max(1e-3);
    let along = (eye - bounds.center()).dot(backward);
    let [yaw, pitch] = angles_of(backward);
    let distance = along.clamp(0.1 * diagonal, 10.0 * diagonal);
    let mut viewpoint = Viewpoint {
        target: Vec3::ZERO,
        distance,
        yaw,
        pitch,
        opening: match camera.projection {
            Projection::Perspective { vertical_fov } => vertical_fov,
            Projection::Orthographic { height } => height,
        },
    };
    viewpoint.target = eye - distance * viewpoint.backward();
    viewpoint
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds() -> Bounds {
        Bounds::of([Vec3::splat(-1.0), Vec3::ONE])
    }

    fn control() -> CameraControl {
        let camera = Camera::look_at("first", Vec3::new(1.0, 2.0, 5.0), Vec3::ZERO, 0.7);
        CameraControl::new(&camera, &bounds())
    }

    fn settle(control: &mut CameraControl) -> Camera {
        for _ in 0..200 {
            if !control.advance(0.016) {
                return control.camera();
            }
        }
        panic!("the camera never comes to rest");
    }

    fn eye(camera: &Camera) -> Vec3 {
        camera.world_from_view.w_axis.truncate()
    }

    #[test]
    fn an_untouched_camera_is_the_scenes_own() {
        let mut control = control();
        assert!(!control.advance(1.0));
        assert_eq!(control.camera().name.as_str(), "first");
        let of_scene = [control.camera()];
        assert_eq!(control.argument(&of_scene).as_deref(), Some("first"));
        let elsewhere = control.argument(&[]).unwrap();
        assert!(
            elsewhere.starts_with("eye=1.00000,2.00000,5.00000;"),
            "{elsewhere}"
        );
        // What it becomes when somebody steers stands at the same place.
        let before = control.camera();
        control.orbit(Vec2::ZERO);
        let after = control.camera();
        let difference = before.world_from_view - after.world_from_view;
        let largest = difference.to_cols_array().map(f32::abs);
        assert!(largest.iter().all(|one| *one < 1e-4), "{difference}");
    }

    #[test]
    fn orbiting_keeps_the_distance_and_never_turns_over() {
        let mut control = control();
        let before = control.goal;
        control.orbit(Vec2::new(0.5, 9.0));
        let after = eye(&settle(&mut control));
        assert!((after.distance(before.target) - before.distance).abs() < 1e-3);
        assert!(control.camera().world_from_view.y_axis.y > 0.0);
    }

    #[test]
    fn looking_around_keeps_the_eye_and_zooming_the_direction() {
        let mut control = control();
        let before = control.goal.eye();
        control.look(Vec2::new(0.4, 0.1));
        assert!(eye(&settle(&mut control)).distance(before) < 1e-3);
        let (target, distance) = (control.goal.target, control.goal.distance);
        control.zoom(0.5);
        settle(&mut control);
        assert_eq!(control.goal.target, target);
        assert!((control.goal.distance - distance / 2.0).abs() < 1e-4);
    }

    #[test]
    fn what_is_dragged_follows_the_pointer() {
        let mut control = control();
        settle(&mut control);
        let point = control.goal.target;
        control.pan(Vec2::new(0.25, 0.0));
        let camera = settle(&mut control);
        let seen = camera.world_from_view.inverse().transform_point3(point);
        // A quarter of the picture's height, at the target's distance.
        let height = 2.0 * -seen.z * (0.35_f32).tan();
        assert!((seen.x / height - 0.25).abs() < 1e-3, "{seen}");
    }

    #[test]
    fn focus_puts_a_point_in_the_middle_from_the_same_place() {
        let mut control = control();
        let from = control.goal.eye();
        let point = Vec3::new(-0.5, 0.2, -0.7);
        control.focus(point);
        let camera = settle(&mut control);
        assert!(eye(&camera).distance(from) < 1e-3);
        let seen = camera.world_from_view.inverse().transform_point3(point);
        assert!(seen.x.abs() < 1e-3 && seen.y.abs() < 1e-3 && seen.z < 0.0);
        assert!(control.goal.target.distance(point) < 1e-3);
        // Nothing to look at, or no point at all.
        let before = control.goal;
        control.focus(from);
        control.focus(Vec3::NAN);
        assert_eq!(control.goal, before);
    }

    #[test]
    fn flying_moves_eye_and_target_alike() {
        let mut control = control();
        let before = control.goal;
        control.fly(Vec3::Z, 1.0);
        let way = control.goal.eye() - before.eye();
        assert!((way.length() - bounds().diagonal() / 4.0).abs() < 1e-4);
        assert!(way.normalize().dot(-before.backward()) > 0.999);
        assert!((control.goal.distance - before.distance).abs() < 1e-6);
    }
}
