//! What moves while live frames are measured.

use std::borrow::Cow;
use std::f32::consts::TAU;
use std::fmt::{self, Display};
use std::str::FromStr;

use glam::{Mat4, Quat, Vec3};
use gpugi_scene::names::{UnknownObject, check_names, is_named_by};
use gpugi_scene::{Camera, Instance, LightKind, Scene};

/// Frames that are measured while something moves, and those of them that are compared.
pub(super) const FRAMES: u32 = 36;
pub(super) const COMPARED: [u32; 3] = [27, 31, 35];
/// Frames per second.
const RATE: f32 = 60.0;
/// Degrees of an orbit per frame.
const SPEED: f32 = 0.3;
/// Seconds of a swing to and fro, how far it goes, as a part of the scene's diagonal, and how far lights at infinity turn [rad].
const SWING_SECONDS: f32 = 2.0;
const SWING: f32 = 0.05;
const TURN: f32 = 0.1;
/// The first frame without the light that goes off: 15 frames, a quarter of a second, before the last.
const OFF: u32 = FRAMES - 16;

/// What moves while live frames are measured, 60 per second.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Moves {
    /// The camera, in an orbit about the middle of the scene's bounds, 0.3 degrees per frame.
    #[default]
    Camera,
    /// The scene's own animation.
    Animation,
    /// Lights and objects of these names, sideways: a swing of 2 s, a twentieth of the scene's diagonal to each side, fastest
    /// in the last frame, where they are where they belong. Lights at infinity turn by a tenth of a radian instead.
    Swing(String),
    /// Nothing, but lights and objects of these names go off a quarter of a second before the last frame.
    Off(String),
}

impl FromStr for Moves {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.split_once('=')) {
            ("camera", _) => Ok(Self::Camera),
            ("animation", _) => Ok(Self::Animation),
            (_, Some(("swing", names))) => Ok(Self::Swing(names.to_owned())),
            (_, Some(("off", names))) => Ok(Self::Off(names.to_owned())),
            _ => Err("camera, animation, swing=NAMES or off=NAMES are known".to_owned()),
        }
    }
}

impl Display for Moves {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera => write!(f, "camera"),
            Self::Animation => write!(f, "animation"),
            Self::Swing(names) => write!(f, "swing={names}"),
            Self::Off(names) => write!(f, "off={names}"),
        }
    }
}

impl Moves {
    /// Checks that something of a scene moves so.
    ///
    /// # Errors
    /// Why nothing does.
    pub fn check(&self, scene: &Scene) -> Result<(), String> {
        match self {
            Self::Camera => Ok(()),
            Self::Animation => match scene.rig.as_ref().is_some_and(|rig| rig.moves()) {
                true => Ok(()),
                false => Err("nothing moves in the scene".to_owned()),
            },
            Self::Swing(names) | Self::Off(names) => {
                let objects = scene.instances.iter().map(|object| object.name.as_str());
                let lights = scene.lights.iter().map(|light| light.name.as_str());
                let found = check_names(names, objects.clone().chain(lights.clone()));
                found.map_err(|unknown: UnknownObject| unknown.to_string())?;
                let shines = |object: &&Instance| {
                    scene.materials[object.material].emissive.max_element() > 0.0
                };
                let emitters = scene.instances.iter().filter(shines);
                let emitters = emitters.map(|object| object.name.as_str());
                let is_named = |name: &str| is_named_by(name, names);
                match self {
                    Self::Off(_) if !emitters.chain(lights.clone()).any(is_named) => {
                        Err("nothing of these names shines".to_owned())
                    }
                    Self::Swing(_) if !objects.chain(lights).any(is_named) => {
                        Err("nothing is named".to_owned())
                    }
                    _ => Ok(()),
                }
            }
        }
    }

    /// Scene and camera at a frame. `time`: that of the scene in the first frame (s).
    pub(super) fn at<'a>(
        &self,
        (scene, camera): (&'a Scene, &'a Camera),
        time: f32,
        frame: u32,
    ) -> (Cow<'a, Scene>, Cow<'a, Camera>) {
        let left = (FRAMES - 1 - frame) as f32;
        let mut moved = Cow::Borrowed(scene);
        let mut seen = Cow::Borrowed(camera);
        match self {
            Self::Camera => {
                let center = Mat4::from_translation(scene.bounds().center());
                let turn = Mat4::from_quat(Quat::from_rotation_y((-SPEED * left).to_radians()));
                seen.to_mut().world_from_view =
                    center * turn * center.inverse() * camera.world_from_view;
            }
            Self::Animation => {
                let moment = time + frame as f32 / RATE;
                moved.to_mut().pose(moment);
                *seen.to_mut() = scene.camera_at(camera, moment);
            }
            Self::Swing(names) => {
                let far = SWING * scene.bounds().diagonal();
                let phase = TAU * left / (RATE * SWING_SECONDS);
                let across = camera.world_from_view.transform_vector3(Vec3::X);
                let by = Mat4::from_translation(-across.normalize_or_zero() * far * phase.sin());
                let away = camera.world_from_view.transform_vector3(Vec3::Z);
                let turn = Quat::from_axis_angle(away.normalize_or(Vec3::Z), TURN * phase.sin());
                let moved = moved.to_mut();
                for light in &mut moved.lights {
                    if is_named_by(&light.name, names) {
                        let by = match light.kind {
                            LightKind::Directional => Mat4::from_quat(turn),
                            _ => by,
                        };
                        light.world_from_light = by * light.world_from_light;
                    }
                }
                for object in &mut moved.instances {
                    if is_named_by(&object.name, names) {
                        object.world_from_mesh = by * object.world_from_mesh;
                    }
                }
            }
            Self::Off(names) if frame >= OFF => {
                let dark = moved.to_mut();
                for light in &mut dark.lights {
                    if is_named_by(&light.name, names) {
                        light.intensity = Vec3::ZERO;
                    }
                }
                for index in 0..dark.instances.len() {
                    if is_named_by(&dark.instances[index].name, names) {
                        let mut material = dark.materials[dark.instances[index].material].clone();
                        material.emissive = Vec3::ZERO;
                        dark.instances[index].material = dark.add_material(material);
                    }
                }
            }
            Self::Off(_) => {}
        }
        (moved, seen)
    }
}

#[cfg(test)]
mod tests {
    use gpugi_scene::builtin::builtin;

    use super::*;

    fn scene(name: &str) -> Scene {
        builtin(name, 1).unwrap()
    }

    #[test]
    fn words_say_what_moves() {
        for text in ["camera", "animation", "swing=lamp,ball*", "off=lamp"] {
            assert_eq!(text.parse::<Moves>().unwrap().to_string(), text);
        }
        assert!("lamp".parse::<Moves>().is_err() && "spin=lamp".parse::<Moves>().is_err());
        let room = scene("room");
        let swing = |names: &str| Moves::Swing(names.to_owned()).check(&room);
        assert!(
            swing("spot,sphere").is_ok() && swing("spot,nothing").unwrap_err().contains("nothing")
        );
        assert!(swing("").is_err() && Moves::Off("box".to_owned()).check(&room).is_err());
        assert!(
            Moves::Off("light".to_owned())
                .check(&scene("cornell"))
                .is_ok()
        );
        assert!(Moves::Animation.check(&room).is_err());
        assert!(Moves::Animation.check(&scene("station")).is_ok());
    }

    /// Lights and objects swing across the view, and end where they belong.
    #[test]
    fn what_swings_passes_its_own_place() {
        let room = scene("room");
        let camera = &room.cameras[0];
        let swing = Moves::Swing("spot,sphere".to_owned());
        let at = |frame| swing.at((&room, camera), 0.0, frame);
        let (last, seen) = at(FRAMES - 1);
        assert!(*last == room && *seen == *camera);
        let (first, _) = at(0);
        let place = |scene: &Scene, name: &str| {
            let light = scene
                .lights
                .iter()
                .find(|light| light.name.as_str() == name);
            let object = (scene.instances.iter()).find(|object| object.name.as_str() == name);
            let world = light.map(|light| light.world_from_light);
            let world = world.or(object.map(|object| object.world_from_mesh));
            world.unwrap().w_axis.truncate()
        };
        let across = camera.world_from_view.x_axis.truncate();
        // 35 of 120 frames of a swing: nearly its widest.
        let far = SWING * room.bounds().diagonal() * (TAU * 35.0 / 120.0).sin();
        for name in ["spot", "sphere"] {
            let by = place(&first, name) - place(&room, name);
            assert!(by.abs_diff_eq(-across * far, 1e-5), "{name}: {by}");
        }
        assert_eq!(place(&first, "box"), place(&room, "box"));
        let shapes = scene("shapes");
        let sun = Moves::Swing("sun".to_owned());
        let turned = sun.at((&shapes, &shapes.cameras[0]), 0.0, 0).0;
        let direction = |scene: &Scene| {
            let mut lights = scene.lights.iter();
            let sun = lights.find(|light| light.kind == LightKind::Directional);
            sun.unwrap().world_from_light.z_axis.truncate()
        };
        let angle = direction(&turned).angle_between(direction(&shapes));
        assert!(angle > 0.02 && angle < TURN, "{angle}");
    }

    #[test]
    fn lamps_go_off_alone() {
        let (room, cornell) = (scene("room"), scene("cornell"));
        for (scene, name) in [(&room, "spot"), (&cornell, "light")] {
            let off = Moves::Off(name.to_owned());
            let at = |frame| off.at((scene, &scene.cameras[0]), 0.0, frame).0;
            assert_eq!(*at(OFF - 1), *scene);
            let dark = at(OFF);
            let light = |scene: &Scene| -> Vec<Vec3> {
                let lights = scene.lights.iter().map(|light| light.intensity);
                let objects = scene.instances.iter();
                let emissive = objects.map(|object| scene.materials[object.material].emissive);
                lights.chain(emissive).collect()
            };
            let changed = light(scene).into_iter().zip(light(&dark));
            let changed: Vec<_> = changed.filter(|(before, after)| before != after).collect();
            assert!(changed.len() == 1 && changed[0].1 == Vec3::ZERO, "{name}");
        }
    }

    #[test]
    fn animations_play() {
        let station = scene("station");
        let (moved, _) = Moves::Animation.at((&station, &station.cameras[0]), 2.0, 30);
        let mut posed = station.clone();
        posed.pose(2.5);
        assert!(*moved == posed && posed != station);
    }
}
