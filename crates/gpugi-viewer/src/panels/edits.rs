//! Controls that edit the scene: lights, environment, the selected object and its material.

use eframe::egui::{CollapsingHeader, DragValue, Slider, SliderClamping, Ui};
use glam::{Mat3, Mat4, Quat, Vec3};
use gpugi::scene::Edit;
use gpugi_scene::{Environment, Light, LightKind, Scene};

use super::Action;

/// The angles of [`Environment::angles`], and the largest of each (degrees).
const ANGLES: [(&str, f32); 3] = [
    ("turned by", 180.0),
    ("pitched by", 90.0),
    ("rolled by", 180.0),
];

/// Lights, environment, and the `selected` object.
pub fn edits(ui: &mut Ui, scene: &Scene, selected: Option<usize>, actions: &mut Vec<Action>) {
    CollapsingHeader::new("Lights").show(ui, |ui| {
        if let Some(environment) = &scene.environment {
            ui.strong("environment");
            let mut environment = environment.clone();
            let mut degrees = environment.angles().map(f32::to_degrees);
            let mut changed = false;
            for (degrees, (name, most)) in degrees.iter_mut().zip(ANGLES) {
                let slider = Slider::new(degrees, -most..=most).text(name).suffix("°");
                changed |= ui.add(slider).changed();
            }
            let intensity = Slider::new(&mut environment.intensity, 0.0..=10.0)
                .clamping(SliderClamping::Edits)
                .text("intensity");
            changed |= ui.add(intensity).changed();
            if changed {
                environment.rotation = Environment::rotation_by(degrees.map(f32::to_radians));
                actions.push(Action::Edit(Edit::Environment(environment)));
            }
        }
        for (index, light) in scene.lights.iter().enumerate() {
            ui.push_id(index, |ui| {
                ui.strong(title(&light.name, "light", index));
                if let Some(light) = light_controls(ui, light, scene) {
                    actions.push(Action::Edit(Edit::Light { index, light }));
                }
            });
        }
        if scene.lights.is_empty() {
            ui.weak("no point, spot or directional lights; lamps are objects that emit");
        }
    });
    CollapsingHeader::new("Object")
        .default_open(true)
        .show(ui, |ui| {
            let Some((index, instance)) =
                selected.and_then(|index| Some((index, scene.instances.get(index)?)))
            else {
                ui.weak("click an object to select it");
                return;
            };
            ui.strong(title(&instance.name, "object", index));
            if let Some(world_from_mesh) = place(ui, &instance.world_from_mesh, scene) {
                actions.push(Action::Edit(Edit::Instance {
                    index,
                    world_from_mesh,
                }));
            }
            let index = instance.material;
            let mut material = scene.materials[index].clone();
            let users = scene
                .instances
                .iter()
                .filter(|instance| instance.material == index)
                .count();
            if users > 1 {
                ui.weak(format!("its material is that of {users} objects"));
            }
            let mut changed = false;
            ui.horizontal(|ui| {
                let mut color = material.base_color.truncate().to_array();
                changed |= ui.color_edit_button_rgb(&mut color).changed();
                material.base_color = Vec3::from(color).extend(material.base_color.w);
                ui.label("base colour");
            });
            changed |= ui
                .add(Slider::new(&mut material.roughness, 0.0..=1.0).text("roughness"))
                .changed();
            changed |= ui
                .add(Slider::new(&mut material.metallic, 0.0..=1.0).text("metallic"))
                .changed();
            ui.horizontal(|ui| changed |= colored(ui, &mut material.emissive, "emission"));
            if changed {
                let material = Box::new(material);
                actions.push(Action::Edit(Edit::Material { index, material }));
            }
        });
}

fn title(name: &str, kind: &str, index: usize) -> String {
    if name.is_empty() {
        format!("{kind} {index}")
    } else {
        name.to_owned()
    }
}

/// A colour and its strength: their product is `value`.
fn colored(ui: &mut Ui, value: &mut Vec3, text: &str) -> bool {
    let mut strength = value.max_element();
    let mut color = if strength > 0.0 {
        (*value / strength).to_array()
    } else {
        [1.0; 3]
    };
    let speed = f64::from(strength.max(0.1)) * 0.01;
    let mut changed = ui.color_edit_button_rgb(&mut color).changed();
    let drag = DragValue::new(&mut strength).speed(speed).range(0.0..=1e9);
    changed |= ui.add(drag).changed();
    ui.label(text);
    if changed {
        *value = Vec3::from(color) * strength;
    }
    changed
}

/// A position to drag, in the file's coordinates.
fn position(ui: &mut Ui, position_in_world: &mut Vec3, scene: &Scene) -> bool {
    let speed = scene.bounds().diagonal() * 1e-3;
    let mut in_file = scene.in_file(*position_in_world);
    let changed = ui.horizontal(|ui| {
        let mut changed = false;
        for axis in 0..3 {
            let drag = DragValue::new(&mut in_file[axis])
                .speed(speed)
                .suffix(" m")
                .max_decimals(3);
            changed |= ui.add(drag).changed();
        }
        ui.label("position");
        changed
    });
    if changed.inner {
        *position_in_world = scene.in_world(in_file);
    }
    changed.inner
}

fn light_controls(ui: &mut Ui, light: &Light, scene: &Scene) -> Option<Light> {
    let mut light = light.clone();
    let unit = match light.kind {
        LightKind::Directional => "W/m²",
        LightKind::Point | LightKind::Spot { .. } => "W/sr",
    };
    let mut changed = ui
        .horizontal(|ui| colored(ui, &mut light.intensity, unit))
        .inner;
    let (mut place, mut direction) = (light.position(), light.direction());
    let mut moved = false;
    if light.kind != LightKind::Directional {
        moved |= position(ui, &mut place, scene);
    }
    if light.kind != LightKind::Point {
        // Where the light comes from, as a sun in the sky.
        let toward = -direction;
        let mut around = toward.x.atan2(toward.z).to_degrees();
        let mut above = toward.y.clamp(-1.0, 1.0).asin().to_degrees();
        let slider = Slider::new(&mut around, -180.0..=180.0).clamping(SliderClamping::Edits);
        let mut turned = ui.add(slider.text("from around").suffix("°")).changed();
        let slider = Slider::new(&mut above, -90.0..=90.0).clamping(SliderClamping::Edits);
        turned |= ui.add(slider.text("from above").suffix("°")).changed();
        // Only what is dragged: other angles would be rounded.
        if turned {
            let (yaw, pitch) = (around.to_radians(), above.to_radians());
            let toward = Vec3::new(
                yaw.sin() * pitch.cos(),
                pitch.sin(),
                yaw.cos() * pitch.cos(),
            );
            direction = -toward;
            moved = true;
        }
    }
    if moved {
        light = light.aimed(place, place + direction);
        changed = true;
    }
    changed.then_some(light)
}

/// Controls for the place of an object: the new one, if people changed it.
fn place(ui: &mut Ui, world_from_mesh: &Mat4, scene: &Scene) -> Option<Mat4> {
    let mut translation = world_from_mesh.w_axis.truncate();
    let moved = position(ui, &mut translation, scene);
    let mut degrees = 0.0_f32;
    let mut factor = 1.0_f32;
    let (turned, scaled) = ui
        .horizontal(|ui| {
            let turn = DragValue::new(&mut degrees).speed(1.0).suffix("°");
            let scale = DragValue::new(&mut factor)
                .speed(0.01)
                .range(0.1..=10.0)
                .prefix("x ");
            let changed = (ui.add(turn).changed(), ui.add(scale).changed());
            ui.label("turn, scale by");
            changed
        })
        .inner;
    (moved || turned || scaled).then(|| moved_to(world_from_mesh, translation, degrees, factor))
}

/// The place at `translation`, turned around +Y and scaled about its origin.
fn moved_to(world_from_mesh: &Mat4, translation: Vec3, degrees: f32, factor: f32) -> Mat4 {
    let axes = Mat3::from_mat4(*world_from_mesh);
    let turned = Mat3::from_quat(Quat::from_rotation_y(degrees.to_radians())) * axes * factor;
    let mut place = Mat4::from_mat3(turned);
    place.w_axis = translation.extend(1.0);
    place
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_turn_and_scale_about_their_own_origin() {
        let before = Mat4::from_translation(Vec3::new(1.0, 2.0, 3.0));
        let after = moved_to(&before, Vec3::new(4.0, 2.0, 3.0), 90.0, 2.0);
        let point = after.transform_point3(Vec3::X);
        assert!(point.distance(Vec3::new(4.0, 2.0, 1.0)) < 1e-5, "{point}");
        assert_eq!(after.transform_point3(Vec3::ZERO), Vec3::new(4.0, 2.0, 3.0));
    }
}
