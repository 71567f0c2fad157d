//! Handles over the picture: lights to be clicked, suns to be dragged, arrows that move what is selected, and a ring
//! that turns it.

use eframe::egui::{self, Color32, Id, Pos2, Rect, Sense, Stroke, Ui, Vec2};
use glam::{Mat4, Vec3};
use gpugi::scene::Edit;
use gpugi_scene::{Camera, Light, LightKind, Projection, Scene};

/// Length of an arrow, as a part of the picture's height.
const ARROW: f32 = 0.12;
/// Radius of the ball on which the suns are, as a part of the picture's height.
const BALL: f32 = 0.3;
/// Side of the square that the mouse can grasp (points).
const GRIP: f32 = 18.0;
/// Corners of the ring.
const CORNERS: usize = 48;
/// Of lights.
const LAMP: Color32 = Color32::from_rgb(255, 220, 100);
const AXES: [(Vec3, Color32); 3] = [
    (Vec3::X, Color32::from_rgb(230, 70, 70)),
    (Vec3::Y, Color32::from_rgb(80, 200, 80)),
    (Vec3::Z, Color32::from_rgb(80, 120, 240)),
];

/// What is selected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Selected {
    /// An instance, by its index.
    Object(usize),
    /// A punctual light with a place, by its index.
    Light(usize),
}

/// Where points of the world are on the picture.
#[derive(Debug, Clone, Copy)]
pub struct Projector {
    view_from_world: Mat4,
    projection: Projection,
    rect: Rect,
}

impl Projector {
    /// Of a camera whose picture fills `rect` (points).
    pub fn new(camera: &Camera, rect: Rect) -> Self {
        Self {
            view_from_world: camera.world_from_view.inverse(),
            projection: camera.projection,
            rect,
        }
    }

    /// Height of the picture at the depth of a point (m); `None` behind the camera.
    fn height_at(&self, point: Vec3) -> Option<f32> {
        match self.projection {
            Projection::Orthographic { height } => Some(height),
            Projection::Perspective { vertical_fov } => {
                let depth = -self.view_from_world.transform_point3(point).z;
                (depth > 1e-6).then(|| 2.0 * depth * (vertical_fov / 2.0).tan())
            }
        }
    }

    /// The place of a point (points of the window); `None` behind the camera.
    pub fn place(&self, point: Vec3) -> Option<Pos2> {
        let height = self.height_at(point)?;
        let seen = self.view_from_world.transform_point3(point) / height;
        let up = Vec2::new(seen.x, -seen.y) * self.rect.height();
        Some(self.rect.center() + up)
    }

    /// How far along `axis` (unit) a point goes if it follows the mouse by `drag` (m); 0 for an axis toward the eye.
    fn way_along(&self, point: Vec3, axis: Vec3, drag: Vec2) -> f32 {
        let step = self.height_at(point).unwrap_or(1.0) * 0.01;
        let places = [0.0, step].map(|way| self.place(point + axis * way));
        let [Some(from), Some(to)] = places else {
            return 0.0;
        };
        let per_step = to - from;
        if per_step.length() < 1e-4 * self.rect.height() {
            return 0.0;
        }
        step * drag.dot(per_step) / per_step.length_sq()
    }
}

/// Draws the handles and lets people grasp them. Returns the edit that they ask for.
pub fn show(
    ui: &Ui,
    rect: Rect,
    (scene, camera): (&Scene, &Camera),
    selected: &mut Option<Selected>,
) -> Option<Edit> {
    let projector = Projector::new(camera, rect);
    let id = ui.scope_id().with("gizmo");
    let painter = ui.painter_at(rect);
    let mut edit = None;
    for (index, light) in scene.lights.iter().enumerate() {
        if matches!(light.kind, LightKind::Directional) {
            if let Some(light) = sun(ui, &projector, id.with(("light", index)), light) {
                edit = Some(Edit::Light { index, light });
            }
            continue;
        }
        let Some(place) = projector.place(light.position()) else {
            continue;
        };
        let is_selected = *selected == Some(Selected::Light(index));
        let color = if is_selected { Color32::WHITE } else { LAMP };
        painter.circle_stroke(place, 6.0, Stroke::new(2.0, color));
        let grip = grip(ui, rect, id.with(("light", index)), place, Sense::click());
        if grip.on_hover_text(light.name.as_str()).clicked() {
            *selected = Some(Selected::Light(index));
        }
    }
    if edit.is_some() {
        return edit;
    }
    let center = center(scene, (*selected)?)?;
    let length = ARROW * projector.height_at(center)?;
    let from = projector.place(center)?;
    let mut way = Vec3::ZERO;
    for (index, (axis, color)) in AXES.into_iter().enumerate() {
        let Some(to) = projector.place(center + axis * length) else {
            continue;
        };
        painter.arrow(from, to - from, Stroke::new(2.5, color));
        let grip = grip(ui, rect, id.with(index), to, Sense::drag());
        if grip.hovered() || grip.dragged() {
            painter.circle_filled(to, 6.0, color);
        }
        way += axis * projector.way_along(center, axis, drag(ui, &grip));
    }
    match (*selected)? {
        Selected::Light(index) => {
            let mut light = scene.lights[index].clone();
            light.world_from_light.w_axis += way.extend(0.0);
            (way != Vec3::ZERO).then_some(Edit::Light { index, light })
        }
        Selected::Object(index) => {
            let angle = ring(ui, rect, id.with("ring"), &projector, center, length);
            let before = scene.instances[index].world_from_mesh;
            let turn = Mat4::from_translation(center)
                * Mat4::from_rotation_y(angle)
                * Mat4::from_translation(-center);
            let world_from_mesh = Mat4::from_translation(way) * turn * before;
            (way != Vec3::ZERO || angle != 0.0).then_some(Edit::Instance {
                index,
                world_from_mesh,
            })
        }
    }
}

/// A directional light's handle: on a ball in the middle of the picture, where the light comes from. Returns the light
/// as it is dragged to.
fn sun(ui: &Ui, projector: &Projector, id: Id, light: &Light) -> Option<Light> {
    let rect = projector.rect;
    let radius = BALL * rect.height();
    let seen = projector
        .view_from_world
        .transform_vector3(-light.direction());
    let place = rect.center() + radius * Vec2::new(seen.x, -seen.y);
    let painter = ui.painter_at(rect);
    let grip = grip(ui, rect, id, place, Sense::drag());
    if grip.hovered() || grip.dragged() {
        painter.circle_stroke(rect.center(), radius, Stroke::new(1.0, LAMP));
    }
    // In front of the ball it is full.
    if seen.z >= 0.0 {
        painter.circle_filled(place, 6.0, LAMP);
    }
    painter.circle_stroke(place, 6.0, Stroke::new(2.0, LAMP));
    let inward = 0.2 * (rect.center() - place);
    painter.arrow(place, inward, Stroke::new(2.0, LAMP));
    let grip = grip.on_hover_text(light.name.as_str());
    if grip.drag_started() {
        let pressed = ui.input(|input| input.pointer.press_origin())?;
        ui.data_mut(|data| data.insert_temp(id, (seen, pressed)));
    }
    if !(grip.dragged() || grip.drag_stopped()) {
        return None;
    }
    let (start, pressed): (Vec3, Pos2) = ui.data(|data| data.get_temp(id))?;
    let way = (grip.interact_pointer_pos()? - pressed) / radius.max(1.0);
    let toward = on_ball(start, glam::vec2(way.x, -way.y));
    let toward = projector
        .view_from_world
        .inverse()
        .transform_vector3(toward);
    let position = light.position();
    (toward.distance(-light.direction()) > 1e-4)
        .then(|| light.clone().aimed(position, position - toward))
}

/// Where a handle on the unit ball at `start` comes to, seen along -Z, if the mouse drags it by `way`. Beyond the rim it
/// goes on along the other side.
fn on_ball(start: Vec3, way: glam::Vec2) -> Vec3 {
    let flat = start.truncate() + way;
    let length = flat.length();
    let side = if start.z >= 0.0 { 1.0 } else { -1.0 };
    let (inside, side) = if length <= 1.0 {
        (flat, side)
    } else {
        (flat * ((2.0 - length).max(0.0) / length), -side)
    };
    let depth = (1.0 - inside.length_squared()).max(0.0).sqrt();
    inside.extend(side * depth).normalize()
}

/// Where the arrows begin (m).
fn center(scene: &Scene, selected: Selected) -> Option<Vec3> {
    match selected {
        Selected::Light(index) => Some(scene.lights.get(index)?.position()),
        Selected::Object(index) => {
            let instance = scene.instances.get(index)?;
            let bounds = scene.meshes[instance.mesh].bounds();
            Some(bounds.transformed(&instance.world_from_mesh).center())
        }
    }
}

/// A ring about the vertical through `center`, to be turned by its grip. Returns the angle (rad).
fn ring(ui: &Ui, rect: Rect, id: Id, projector: &Projector, center: Vec3, radius: f32) -> f32 {
    let place = |part: f32| {
        let (sin, cos) = (part * std::f32::consts::TAU).sin_cos();
        projector.place(center + Vec3::new(cos, 0.0, sin) * (0.8 * radius))
    };
    let corners = (0..=CORNERS).map(|corner| place(corner as f32 / CORNERS as f32));
    let corners: Option<Vec<Pos2>> = corners.collect();
    let (Some(corners), Some(grasped), Some(from)) =
        (corners, place(0.125), projector.place(center))
    else {
        return 0.0;
    };
    let color = AXES[1].1;
    let painter = ui.painter_at(rect);
    painter.line(corners, Stroke::new(1.5, color));
    painter.circle_filled(grasped, 4.0, color);
    let grip = grip(ui, rect, id, grasped, Sense::drag());
    // Sideways, the length of an arrow is a radian.
    let width = ARROW * rect.height();
    let toward = if grasped.y >= from.y { 1.0 } else { -1.0 };
    toward * drag(ui, &grip).x / width.max(1.0)
}

/// The way of the mouse that has grasped a handle, since the last frame. egui's own leaves out the frame in which the
/// mouse lets go, which is long where frames are slow.
fn drag(ui: &Ui, grip: &egui::Response) -> Vec2 {
    let Some(mouse) = grip.interact_pointer_pos() else {
        return Vec2::ZERO;
    };
    let pressed = ui.input(|input| input.pointer.press_origin());
    let before = if grip.drag_started() {
        pressed
    } else {
        ui.data(|data| data.get_temp::<Pos2>(grip.id))
    };
    ui.data_mut(|data| data.insert_temp(grip.id, mouse));
    match before {
        Some(before) if grip.dragged() || grip.drag_stopped() => mouse - before,
        _ => Vec2::ZERO,
    }
}

fn grip(ui: &Ui, rect: Rect, id: Id, place: Pos2, sense: Sense) -> egui::Response {
    let area = Rect::from_center_size(place, Vec2::splat(GRIP)).intersect(rect);
    ui.interact(area, id, sense)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projector() -> Projector {
        let camera = Camera::look_at("", Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 1.0);
        let rect = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(300.0, 200.0));
        Projector::new(&camera, rect)
    }

    #[test]
    fn points_are_where_the_camera_sees_them() {
        let projector = projector();
        assert_eq!(projector.place(Vec3::ZERO), Some(Pos2::new(160.0, 120.0)));
        let top = Vec3::Y * 4.0 * 0.5_f32.tan();
        let place = projector.place(top).unwrap();
        assert!(place.distance(Pos2::new(160.0, 20.0)) < 1e-3, "{place:?}");
        assert_eq!(projector.place(Vec3::Z * 5.0), None);
    }

    #[test]
    fn what_is_dragged_stays_under_the_mouse() {
        let projector = projector();
        let point = Vec3::new(0.3, -0.2, 0.5);
        let from = projector.place(point).unwrap();
        for axis in [Vec3::X, Vec3::Y] {
            let to = projector.place(point + axis * 0.25).unwrap();
            let way = projector.way_along(point, axis, to - from);
            assert!((way - 0.25).abs() < 1e-3, "{axis}: {way}");
        }
        let sideways = projector.way_along(Vec3::ZERO, Vec3::X, Vec2::new(0.0, 30.0));
        assert!(sideways.abs() < 1e-6);
        assert_eq!(
            projector.way_along(Vec3::ZERO, Vec3::Z, Vec2::splat(9.0)),
            0.0
        );
    }

    #[test]
    fn suns_stay_under_the_mouse_and_pass_the_rim() {
        let near = |a: Vec3, b: Vec3| assert!(a.distance(b) < 1e-5, "{a} is not {b}");
        for side in [1.0, -1.0] {
            let start = Vec3::new(0.0, 0.6, 0.8 * side);
            near(on_ball(start, glam::Vec2::ZERO), start);
            let dragged = on_ball(start, glam::vec2(0.3, 0.2));
            near(dragged.with_z(0.0), Vec3::new(0.3, 0.8, 0.0));
            assert!(dragged.z * side > 0.0);
            // 0.4 to the rim, and 0.4 back on the other side.
            near(
                on_ball(start, glam::vec2(0.0, 0.8)),
                Vec3::new(0.0, 0.6, -0.8 * side),
            );
            near(on_ball(start, glam::vec2(0.0, 9.0)), Vec3::NEG_Z * side);
        }
    }
}
