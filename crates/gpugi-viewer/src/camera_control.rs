//! A camera that people steer: it orbits around a target, pans, zooms, flies and looks around, and follows its goal
//! smoothly.

#[cfg(test)]
mod tests;

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

    /// Goes where the scene's camera goes, which is one of `cameras`, until somebody steers.
    pub fn follow(&mut self, cameras: &[Camera], bounds: &Bounds) {
        let Some(before) = self
            .untouched
            .as_ref()
            .filter(|camera| camera.node.is_some())
        else {
            return;
        };
        let is_it = |camera: &&Camera| camera.node == before.node && camera.name == before.name;
        let now = cameras.iter().find(is_it);
        if let Some(now) = now.filter(|now| now.world_from_view != before.world_from_view) {
            let Viewpoint { lens, shutter, .. } = self.shown;
            self.shown = Viewpoint {
                lens,
                shutter,
                ..viewpoint_of(now, bounds)
            };
            self.goal = self.shown;
            self.untouched = Some(now.clone());
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

    /// Goes to a place, and looks where it looked (world space (m)).
    pub fn go_to(&mut self, eye: Vec3) {
        self.untouched = None;
        self.goal.target += eye - self.goal.eye();
    }

    /// Where it will stand (world space (m)), and unit vectors forward and, in the horizontal plane, to the right.
    pub fn sight(&self) -> (Vec3, Vec3, Vec3) {
        let (eye, backward) = self.eye_and_backward();
        (eye, -backward, self.goal.axes().x_axis)
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
