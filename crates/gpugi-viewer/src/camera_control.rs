//! A camera that people steer: it orbits around a target, pans, zooms, flies and looks around, and follows its goal
//! smoothly.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::fmt::Display;
use std::ops::Add;

use glam::{Mat3, Mat4, Vec2, Vec3, Vec3Swizzles};
use gpugi_scene::{Bounds, Camera, Lens, Projection, Scene, lens};

/// Steepest angle against the horizon (rad): beyond straight up or down, the picture would stand on its head.
const STEEPEST: f32 = FRAC_PI_2;
/// Time in which the camera covers all but 1/e of the way to its goal (s).
const DAMPING_SECONDS: f32 = 0.06;
/// Perspective cameras keep their vertical field of view between these (rad).
const FIELDS_OF_VIEW: [f32; 2] = [0.05, 2.4];
/// Largest aperture that is offered, and least and most focus, as parts of the scene's size.
const APERTURE: f32 = 0.05;
const FOCUS: [f32; 2] = [1e-3, 10.0];

/// Where the camera stands, what it looks at, and how.
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
    /// Changes at once.
    lens: Lens,
    /// Changes at once (s).
    shutter: f32,
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

    /// Columns: right, up and backward, world space. Right is horizontal, straight up and down too.
    fn axes(&self) -> Mat3 {
        let backward = self.backward();
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let right = Vec3::new(cos_yaw, 0.0, -sin_yaw);
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
            lens: goal.lens,
            shutter: goal.shutter,
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
    /// The scene's camera, exactly where it is, until somebody steers. Its lens and its shutter may be others.
    untouched: Option<Camera>,
    /// Whether nobody has said yet what it orbits around.
    is_target_guessed: bool,
    shown: Viewpoint,
    goal: Viewpoint,
    is_parallel: bool,
    /// The lens that it had last, to be opened again.
    opened: Option<Lens>,
    /// Size of the scene, by which it zooms and flies (m).
    diagonal: f32,
}

impl CameraControl {
    /// Stands where `camera` stands in a scene within `bounds`, and orbits around the point of its axis that is nearest
    /// to the middle of the scene.
    pub fn new(camera: &Camera, bounds: &Bounds) -> Self {
        let viewpoint = viewpoint_of(camera, bounds);
        Self {
            untouched: Some(camera.clone()),
            is_target_guessed: true,
            shown: viewpoint,
            goal: viewpoint,
            is_parallel: matches!(camera.projection, Projection::Orthographic { .. }),
            opened: (!camera.lens.is_pinhole()).then_some(camera.lens),
            diagonal: size_of(bounds),
        }
    }

    /// Orbits around `target`, at which it looks (world space (m)).
    pub fn around(mut self, target: Vec3) -> Self {
        self.is_target_guessed = false;
        let distance = self.goal.eye().distance(target);
        if distance > 0.0 && distance.is_finite() {
            self.goal.distance = distance;
            self.goal.target = target;
            self.shown = self.goal;
        }
        self
    }

    /// Whether what is seen in the middle of the picture is a better target than the one that it has.
    pub fn wants_target(&self) -> bool {
        self.is_target_guessed && self.untouched.is_some()
    }

    /// Takes what is seen in the middle of the picture as its target, if that is anything (world space (m)).
    pub fn take_target(&mut self, seen: Option<Vec3>) {
        let is_wanted = self.wants_target();
        self.is_target_guessed = false;
        let eye = self.goal.eye();
        let backward = self.goal.backward();
        let distance = seen.map(|point| (eye - point).dot(backward));
        let distance = distance.filter(|distance| *distance > 0.0 && distance.is_finite());
        if let (Some(distance), true) = (distance, is_wanted) {
            // All else that the goal holds is shown by the next frame.
            for viewpoint in [&mut self.goal, &mut self.shown] {
                viewpoint.distance = distance;
                viewpoint.target = eye - distance * backward;
            }
        }
    }

    /// The camera of this frame.
    pub fn camera(&self) -> Camera {
        let Viewpoint { lens, shutter, .. } = self.shown;
        if let Some(camera) = &self.untouched {
            return Camera {
                lens,
                shutter,
                ..camera.clone()
            };
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
            lens,
            shutter,
            node: None,
        }
    }

    /// The camera as an argument of `gpugi render --camera`: its name, if it is one of the scene's cameras, and what is
    /// not as that has it. None for what an argument cannot say.
    pub fn argument(&self, scene: &Scene) -> Option<String> {
        let goal = &self.goal;
        let named = self.untouched.as_ref().and_then(|camera| {
            let mut known = scene.cameras.iter().enumerate();
            known.find(|(_, known)| known.name == camera.name)
        });
        if let Some((index, known)) = named {
            let mut changes = lens_in_words(goal, known.lens, known.shutter);
            if let (true, Some(camera)) = (!self.is_parallel, &self.untouched)
                && camera.projection != known.projection
            {
                changes += &format!(";fov={}", degrees_in_words(goal.opening));
            }
            let name = known.name.as_str();
            // As a part of an argument, a name is read to the next semicolon, without spaces around it.
            let is_readable = !name.contains(';') && name.trim() == name;
            return Some(match (changes.as_str(), is_readable) {
                ("", _) => name.to_owned(),
                (_, true) => format!("from={name}{changes}"),
                (_, false) => format!("from={index}{changes}"),
            });
        }
        if self.is_parallel {
            return None;
        }
        let (eye, _) = self.eye_and_backward();
        let target = goal.target;
        let mut words = format!(
            "eye={};target={}",
            in_words(scene.in_file(eye)),
            in_words(scene.in_file(target))
        );
        let axes = goal.axes();
        // Near the vertical, eye and target do not say what is up.
        if axes.z_axis.y.abs() > 0.99 {
            words += &format!(";up={}", in_words(axes.y_axis));
        }
        words += &format!(";fov={}", degrees_in_words(goal.opening));
        Some(words + &lens_in_words(goal, Lens::PINHOLE, 0.0))
    }

    /// Where it will stand, and the unit vector away from what it will look at (world space (m)).
    fn eye_and_backward(&self) -> (Vec3, Vec3) {
        match &self.untouched {
            Some(camera) => {
                let [backward, eye] =
                    [2, 3].map(|axis| camera.world_from_view.col(axis).truncate());
                (eye, backward.normalize_or(Vec3::Z))
            }
            None => (self.goal.eye(), self.goal.backward()),
        }
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
        let distance = self.goal.distance;
        let [nearest, farthest] = [1e-4, 100.0].map(|times| times * self.diagonal);
        // A camera that stands beyond is not moved at once.
        let range = [nearest.min(distance), farthest.max(distance)];
        self.goal.distance = (distance * factor).clamp(range[0], range[1]);
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
        let [yaw, pitch] = angles_of(way.normalize(), self.goal.axes().x_axis);
        // The shorter way around.
        let turn = (yaw - self.goal.yaw + PI).rem_euclid(TAU);
        self.goal.yaw += turn - PI;
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

    /// The lens.
    pub fn lens(&self) -> Lens {
        self.goal.lens
    }

    /// Sets the lens, and moves nothing. A lens that cannot be changes nothing.
    pub fn set_lens(&mut self, lens: Lens) {
        if let Ok(lens) = Lens::new(lens.aperture, lens.focus, lens.blades) {
            self.goal.lens = lens;
            if !lens.is_pinhole() {
                self.opened = Some(lens);
            }
        }
    }

    /// Opens the lens to a radius (m), or closes it to a pinhole, with 0. At first, what it orbits around is sharp.
    pub fn set_aperture(&mut self, aperture: f32) {
        let lens = self.opened.unwrap_or(Lens {
            focus: self.goal.distance,
            ..Lens::PINHOLE
        });
        self.set_lens(Lens { aperture, ..lens });
    }

    /// Focuses the lens on a point (world space (m)): what is as far along the camera's axis is sharp. A pinhole stays
    /// one, and nothing behind the camera becomes sharp.
    pub fn sharpen(&mut self, point: Vec3) {
        let (eye, backward) = self.eye_and_backward();
        self.set_lens(Lens {
            focus: (eye - point).dot(backward),
            ..self.goal.lens
        });
    }

    /// Time for which the shutter is open (s).
    pub fn shutter(&self) -> f32 {
        self.goal.shutter
    }

    /// Sets the time for which the shutter is open (s), and moves nothing. A time that cannot be changes nothing.
    pub fn set_shutter(&mut self, seconds: f32) {
        if let Ok(seconds) = lens::shutter(seconds) {
            self.goal.shutter = seconds;
        }
    }

    /// Largest aperture that suits the size of the scene (m).
    pub fn largest_aperture(&self) -> f32 {
        APERTURE * self.diagonal
    }

    /// The least and the largest focus that suit the size of the scene (m).
    pub fn focus_range(&self) -> [f32; 2] {
        FOCUS.map(|times| times * self.diagonal)
    }
}

/// Yaw and pitch of a camera by its axes: unit vectors from the target to the eye, and to the right.
fn angles_of(backward: Vec3, right: Vec3) -> [f32; 2] {
    let across = backward.xz().length();
    // Straight up or down, only the side says where it turns.
    let yaw = if across > 1e-3 {
        backward.x.atan2(backward.z)
    } else {
        (-right.z).atan2(right.x)
    };
    [yaw, backward.y.atan2(across).clamp(-STEEPEST, STEEPEST)]
}

/// A point in the shortest words that are read as the same numbers.
fn in_words<T: Add<Output = T> + Default + Display>(point: impl Into<[T; 3]>) -> String {
    // No -0.
    let [x, y, z] = point.into().map(|value| value + T::default());
    format!("{x},{y},{z}")
}

/// What tells the lens and the shutter of a viewpoint from those that an argument means without these words.
fn lens_in_words(seen: &Viewpoint, before: Lens, shutter: f32) -> String {
    let lens = seen.lens;
    let mut words = String::new();
    if lens != before {
        words += &format!(";aperture={}", lens.aperture);
        if !lens.is_pinhole() {
            words += &format!(";focus={}", lens.focus);
        }
        if !lens.is_pinhole() && lens.blades != before.blades {
            words += &format!(";blades={}", lens.blades);
        }
    }
    if seen.shutter != shutter {
        words += &format!(";shutter={}", seen.shutter);
    }
    words
}

/// An angle (rad) in degrees, in the shortest words that are read as the same angle.
fn degrees_in_words(angle: f32) -> String {
    let degrees = angle.to_degrees();
    let is_same = |words: &String| {
        let read = words.parse::<f32>();
        read.is_ok_and(|degrees| degrees.to_radians() == angle)
    };
    let mut rounded = (0..8).map(|digits| format!("{degrees:.digits$}"));
    rounded.find(is_same).unwrap_or_else(|| degrees.to_string())
}

/// The diagonal of a scene (m), or of what stands for one without extent.
fn size_of(bounds: &Bounds) -> f32 {
    let diagonal = bounds.diagonal();
    if diagonal > 0.0 { diagonal } else { 1.0 }
}

/// The viewpoint of a camera. It looks at the point of its axis that is nearest to the middle of the scene.
fn viewpoint_of(camera: &Camera, bounds: &Bounds) -> Viewpoint {
    let eye = camera.world_from_view.w_axis.truncate();
    let backward = camera.world_from_view.z_axis.truncate();
    let backward = backward.normalize_or(Vec3::Z);
    let along = (eye - bounds.center()).dot(backward);
    let [yaw, pitch] = angles_of(backward, camera.world_from_view.x_axis.truncate());
    // Farther away, rounding moves the eye by more than the scene.
    let [least, most] = [0.1, 1e6].map(|times| times * size_of(bounds));
    let distance = along.clamp(least, most);
    let mut viewpoint = Viewpoint {
        target: Vec3::ZERO,
        distance,
        yaw,
        pitch,
        opening: match camera.projection {
            Projection::Perspective { vertical_fov } => vertical_fov,
            Projection::Orthographic { height } => height,
        },
        lens: camera.lens,
        shutter: camera.shutter,
    };
    viewpoint.target = eye - distance * viewpoint.backward();
    viewpoint
}

#[cfg(test)]
mod tests {
    use gpugi_arguments::scene_argument;

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
        let mut scene = Scene::default();
        scene.cameras.push(control.camera());
        assert_eq!(control.argument(&scene).as_deref(), Some("first"));
        let elsewhere = control.argument(&Scene::default()).unwrap();
        assert!(elsewhere.starts_with("eye=1,2,5;"), "{elsewhere}");
        // What it becomes when somebody steers stands at the same place.
        let before = control.camera();
        control.orbit(Vec2::ZERO);
        let after = control.camera();
        let difference = before.world_from_view - after.world_from_view;
        let largest = difference.to_cols_array().map(f32::abs);
        assert!(largest.iter().all(|entry| *entry < 1e-4), "{difference}");
    }

    #[test]
    fn orbiting_keeps_the_distance_and_never_turns_over() {
        let mut control = control();
        let before = control.goal;
        control.orbit(Vec2::new(0.5, 9.0));
        let after = eye(&settle(&mut control));
        assert!((after.distance(before.target) - before.distance).abs() < 1e-3);
        // Straight down, up is horizontal.
        assert!(control.camera().world_from_view.y_axis.y > -1e-6);
    }

    /// Whether somebody who takes hold of the camera sees no jump.
    #[track_caller]
    fn assert_no_jump(control: &CameraControl) {
        let before = control.camera();
        let mut touched = control.clone();
        touched.orbit(Vec2::ZERO);
        let after = touched.camera();
        let difference = before.world_from_view - after.world_from_view;
        let scale = eye(&before).length().max(1.0);
        let largest = difference.to_cols_array().map(|entry| entry.abs() / scale);
        assert!(largest.iter().all(|entry| *entry < 1e-5), "{difference}");
    }

    #[test]
    fn a_camera_that_looks_straight_down_or_up_does_not_jump() {
        for (height, turn) in [(3.0, 0.0), (3.0, 2.0), (-3.0, -1.0)] {
            let mut camera = Camera::look_at("", Vec3::new(0.1, height, 0.2), Vec3::ZERO, 0.7);
            // Exactly vertical, and turned around that.
            camera.world_from_view = Mat4::from_translation(Vec3::new(0.1, height, 0.2))
                * Mat4::from_rotation_y(turn)
                * Mat4::from_rotation_x(-FRAC_PI_2 * f32::signum(height));
            let mut control = CameraControl::new(&camera, &bounds());
            assert_no_jump(&control);
            // A millimetre of orbiting turns it by that much.
            control.orbit(Vec2::new(0.001, 0.0));
            let turned = settle(&mut control).world_from_view.x_axis.truncate();
            let right = camera.world_from_view.x_axis.truncate();
            assert!(turned.angle_between(right) < 0.0015);
            // Its words stand for it.
            let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
            let words = control.argument(&scene).unwrap();
            let read = scene_argument::camera(&scene, Some(&words), 1.0).unwrap();
            let difference = read.world_from_view - control.camera().world_from_view;
            let largest = difference.to_cols_array().map(f32::abs);
            assert!(
                largest.iter().all(|entry| *entry < 1e-4),
                "{words}: {difference}"
            );
        }
    }

    #[test]
    fn the_target_is_what_is_seen_in_the_middle() {
        // In a room, looking at the wall behind; near one of many objects; and far away.
        for (eye_z, seen_z) in [(0.5, 0.9), (1.01, 1.0), (400.0, 1.0), (3000.0, 1.0)] {
            let from = Vec3::new(0.0, 0.0, eye_z);
            let seen = Vec3::new(0.0, 0.0, seen_z);
            let camera = Camera::look_at("", from, seen, 0.7);
            let mut control = CameraControl::new(&camera, &bounds());
            assert!(control.wants_target());
            // The ray through a pixel is not quite the axis.
            control.take_target(Some(seen + Vec3::new(1e-4, 0.0, 0.0)));
            assert!(!control.wants_target());
            assert_eq!(control.camera(), camera);
            assert_no_jump(&control);
            let close = 1e-6 * eye_z.max(1.0);
            assert!(control.goal.target.distance(seen) < close, "{eye_z}");
            // Zooming goes there from where it is.
            let distance = control.goal.distance;
            control.zoom(0.9);
            assert!((control.goal.distance / distance - 0.9).abs() < 1e-4);
        }
    }

    #[test]
    fn where_nothing_is_seen_the_target_is_as_far_as_the_middle_of_the_scene() {
        let from = Vec3::new(0.0, 0.0, 100.0);
        let camera = Camera::look_at("", from, Vec3::new(30.0, 0.0, 0.0), 0.7);
        let mut control = CameraControl::new(&camera, &bounds());
        control.take_target(None);
        assert!(!control.wants_target());
        let nearest = control.goal.target;
        let axis = (nearest - from).normalize();
        assert!(axis.dot(nearest).abs() < 1e-3, "{nearest}");
        // Who steers already keeps the target.
        let mut control = CameraControl::new(&camera, &bounds());
        control.orbit(Vec2::X);
        let before = control.goal;
        control.take_target(Some(Vec3::ZERO));
        assert_eq!(control.goal, before);
    }

    #[test]
    fn words_are_read_as_the_same_camera_however_small_it_is() {
        let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
        for size in [1e-6, 0.001, 1.0, 4321.0] {
            let bounds = Bounds::of([Vec3::splat(-size), Vec3::splat(size)]);
            let from = size * Vec3::new(1.234_567, 2.1, 4.9);
            let camera = Camera::look_at("", from, size * Vec3::new(0.1, 0.2, 0.3), 0.7);
            let mut control = CameraControl::new(&camera, &bounds);
            for (aperture, focus, blades, shutter) in [
                (0.0, 1.0, 0, 0.0),
                (size * 0.012_345_67, size * 3.3, 7, 0.0),
                (size * 0.5, 1e-5, 0, 1.0 / 48.0),
                (0.0, 1.0, 0, 0.1),
            ] {
                let lens = Lens::new(aperture, focus, blades).unwrap();
                control.set_lens(lens);
                control.set_shutter(shutter);
                let words = control.argument(&scene).unwrap();
                let (read, target) = scene_argument::view(&scene, Some(&words), 1.0).unwrap();
                let again = CameraControl::new(&read, &bounds).around(target.unwrap());
                assert_eq!(again.argument(&scene).unwrap(), words);
                assert_eq!(eye(&read), from, "{words}");
                assert_eq!((read.lens, read.shutter), (lens, shutter), "{words}");
                assert_eq!(again.goal.target, control.goal.target, "{words}");
                assert_eq!(again.goal.opening, 0.7, "{words}");
                assert!(!again.wants_target());
                // A pinhole needs no words.
                assert_eq!(words.contains("aperture"), aperture > 0.0);
                assert_eq!(words.contains("focus"), aperture > 0.0);
                assert_eq!(words.contains("blades"), blades > 0);
                assert_eq!(words.contains("shutter"), shutter > 0.0);
            }
        }
    }

    #[test]
    fn another_lens_keeps_a_camera_of_the_scene_where_it_is() {
        let mut scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
        let mut camera = control().camera();
        // Turned around its axis, as nobody can steer it.
        camera.world_from_view *= Mat4::from_rotation_z(0.3);
        camera.lens = Lens::new(0.02, 4.0, 6).unwrap();
        camera.shutter = 0.01;
        scene.cameras.push(camera.clone());
        for name in ["first", " a; b=1", "c=d", ""] {
            camera.name = name.into();
            scene.cameras.last_mut().unwrap().name = name.into();
            let mut control = CameraControl::new(&camera, &bounds());
            assert_eq!(control.argument(&scene).as_deref(), Some(name));
            for (lens, shutter) in [
                (Lens::new(0.03, 4.0, 6).unwrap(), 0.01),
                (Lens::new(0.02, 4.0, 0).unwrap(), 0.01),
                (Lens::PINHOLE, 0.01),
                (camera.lens, 0.0),
                (Lens::new(0.02, 2.5, 5).unwrap(), 0.02),
            ] {
                control.set_lens(lens);
                control.set_shutter(shutter);
                let expected = Camera {
                    lens,
                    shutter,
                    ..camera.clone()
                };
                // The picture begins anew, once.
                assert!(control.advance(0.0));
                assert!(!control.advance(0.0));
                assert_eq!(control.camera(), expected);
                assert!(control.wants_target());
                let words = control.argument(&scene).unwrap();
                assert!(words.starts_with("from="), "{words}");
                let (read, target) = scene_argument::view(&scene, Some(&words), 1.0).unwrap();
                assert_eq!((read, target), (expected, None), "{words}");
                let again = CameraControl::new(&control.camera(), &bounds());
                assert_eq!(again.argument(&scene).unwrap(), words);
            }
            control.set_lens(camera.lens);
            control.set_shutter(camera.shutter);
            assert_eq!(control.argument(&scene).as_deref(), Some(name));
        }
        // What was steered keeps its lens.
        let mut control = CameraControl::new(&camera, &bounds());
        control.orbit(Vec2::X);
        control.set_shutter(0.02);
        let steered = settle(&mut control);
        assert_eq!((steered.lens, steered.shutter), (camera.lens, 0.02));
        let words = control.argument(&scene).unwrap();
        let end = ";aperture=0.02;focus=4;blades=6;shutter=0.02";
        assert!(words.ends_with(end), "{words}");
    }

    #[test]
    fn a_field_of_view_that_was_put_on_a_camera_of_the_scene_stays_in_words() {
        let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
        let words = format!("from={};fov=20", scene.cameras[0].name);
        let (camera, _) = scene_argument::view(&scene, Some(&words), 1.0).unwrap();
        let control = CameraControl::new(&camera, &scene.bounds());
        assert_eq!(control.argument(&scene), Some(words));
    }

    #[test]
    fn a_lens_opens_with_a_sharp_target_and_opens_again_as_it_was() {
        let mut control = control();
        control.set_aperture(0.1);
        let distance = control.goal.distance;
        assert_eq!(control.lens(), Lens::new(0.1, distance, 0).unwrap());
        // A point beside the axis is as far as the foot of its perpendicular.
        let camera = control.camera();
        let point = camera
            .world_from_view
            .transform_point3(Vec3::new(0.7, 0.2, -2.0));
        control.sharpen(point);
        assert!((control.lens().focus - 2.0).abs() < 1e-5);
        control.set_lens(Lens {
            blades: 5,
            ..control.lens()
        });
        let open = control.lens();
        control.set_aperture(0.0);
        assert_eq!(control.lens(), Lens::PINHOLE);
        control.sharpen(Vec3::ZERO);
        assert_eq!(control.lens(), Lens::PINHOLE);
        control.set_aperture(0.1);
        assert_eq!(control.lens(), open);
        // Behind the camera, and what no lens is.
        let behind = camera.world_from_view.transform_point3(Vec3::Z);
        control.sharpen(behind);
        control.sharpen(Vec3::NAN);
        control.set_aperture(f32::NAN);
        control.set_shutter(-1.0);
        assert_eq!((control.lens(), control.shutter()), (open, 0.0));
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
