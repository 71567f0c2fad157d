//! Edits of a scene in words, as `--edit` takes them: `light.0.position=0,2,0`.

use std::fmt::Display;

use anyhow::Context;
use glam::{DVec3, Mat4, Quat, Vec3};
use gpugi::scene::Edit;
use gpugi_scene::{Environment, MaterialModel, Scene};

use crate::{Usage, numbers};

/// What can be edited, for messages.
const HELP: &str = "expected light.NAME.(position|direction|intensity), object.NAME.(position|place), \
    material.NAME.(base-color|roughness|metallic|emission|lobe) or environment.(rotation|intensity), = and numbers that \
    commas separate; an index from 0 may take the place of a name";

/// Degrees and normalized directions are rounded by about so much.
const ROUNDING: f32 = 1e-6;

/// Brings about what `--edit` asks for, one after the other.
///
/// # Errors
/// [`Usage`]: what is wrong with which.
pub fn apply(edits: &[String], scene: &mut Scene) -> anyhow::Result<()> {
    for text in edits {
        edit_of(text, scene)?.apply_to(scene);
    }
    Ok(())
}

/// The edit of `scene` that `text` asks for.
///
/// # Errors
/// [`Usage`]: what is wrong with it.
pub fn edit_of(text: &str, scene: &Scene) -> anyhow::Result<Edit> {
    parse(text, scene).map_err(|reason| Usage(format!("--edit {text}: {reason:#}")).into())
}

fn parse(text: &str, scene: &Scene) -> anyhow::Result<Edit> {
    let (path, value) = text.split_once('=').context(HELP)?;
    let (kind, rest) = path.split_once('.').context(HELP)?;
    if kind == "environment" {
        let mut environment = scene.environment.clone().context("there is none")?;
        match rest {
            "rotation" => environment.rotation = rotation(value)?,
            "intensity" => environment.intensity = at_least_zero(number(value)?)?,
            _ => anyhow::bail!(HELP),
        }
        return Ok(Edit::Environment(environment));
    }
    let (name, key) = rest.rsplit_once('.').context(HELP)?;
    match kind {
        "light" => {
            let index = index(name, scene.lights.iter().map(|light| light.name.as_str()))?;
            let mut light = scene.lights[index].clone();
            let (position, direction) = (light.position(), light.direction());
            match key {
                "position" => light.world_from_light.w_axis = point(value, scene)?.extend(1.0),
                "direction" => {
                    let direction = vector(value)?.try_normalize().unwrap_or(direction);
                    light = light.aimed(position, position + direction);
                }
                "intensity" => light.intensity = positive(value)?,
                _ => anyhow::bail!(HELP),
            }
            Ok(Edit::Light { index, light })
        }
        "object" => {
            let index = index(
                name,
                scene
                    .instances
                    .iter()
                    .map(|instance| instance.name.as_str()),
            )?;
            let mut place = scene.instances[index].world_from_mesh;
            match key {
                "position" => place.w_axis = point(value, scene)?.extend(1.0),
                "place" => place = place_of(value, scene)?,
                _ => anyhow::bail!(HELP),
            }
            Ok(Edit::Instance {
                index,
                world_from_mesh: place,
            })
        }
        "material" => {
            let index = index(
                name,
                scene
                    .materials
                    .iter()
                    .map(|material| material.name.as_str()),
            )?;
            let mut material = Box::new(scene.materials[index].clone());
            match key {
                "base-color" => {
                    material.base_color = positive(value)?.extend(material.base_color.w);
                }
                "roughness" => material.roughness = part(value)?,
                "metallic" => material.metallic = part(value)?,
                "emission" => material.emissive = positive(value)?,
                "lobe" => material.model = with_lobe(material.model, value)?,
                _ => anyhow::bail!(HELP),
            }
            Ok(Edit::Material { index, material })
        }
        _ => anyhow::bail!(HELP),
    }
}

/// What an edit changes in `scene`, in words.
pub fn in_words(edit: &Edit, scene: &Scene) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = |path: String, value: String| words.push(format!("{path}={value}"));
    match edit {
        Edit::Environment(after) => {
            let before = scene.environment.as_ref();
            if before.is_some_and(|before| angles(before) != angles(after)) {
                word("environment.rotation".into(), angles(after));
            }
            if before.is_some_and(|before| before.intensity != after.intensity) {
                word("environment.intensity".into(), after.intensity.to_string());
            }
        }
        Edit::Light {
            index,
            light: after,
        } => {
            let before = &scene.lights[*index];
            let path = |key: &str| format!("light.{index}.{key}");
            if before.direction().distance(after.direction()) > ROUNDING {
                word(path("direction"), written(after.direction()));
            }
            let [before_at, after_at] =
                [before, after].map(|light| scene.in_file(light.position()));
            if before_at != after_at {
                word(path("position"), written(after_at));
            }
            if before.intensity != after.intensity {
                word(path("intensity"), written(after.intensity));
            }
        }
        Edit::Instance {
            index,
            world_from_mesh: after,
        } => {
            let before = &scene.instances[*index].world_from_mesh;
            let path = |key: &str| format!("object.{index}.{key}");
            let axes = |place: &Mat4| [place.x_axis, place.y_axis, place.z_axis];
            let position = |place: &Mat4| scene.in_file(place.w_axis.truncate());
            if axes(before) != axes(after) {
                let columns = axes(after).map(|axis| written(axis.truncate()));
                let columns = columns.join(",");
                word(
                    path("place"),
                    format!("{columns},{}", written(position(after))),
                );
            } else if position(before) != position(after) {
                word(path("position"), written(position(after)));
            }
        }
        Edit::Material {
            index,
            material: after,
        } => {
            let before = &scene.materials[*index];
            let path = |key: &str| format!("material.{index}.{key}");
            if before.base_color != after.base_color {
                word(path("base-color"), written(after.base_color.truncate()));
            }
            if before.roughness != after.roughness {
                word(path("roughness"), after.roughness.to_string());
            }
            if before.metallic != after.metallic {
                word(path("metallic"), after.metallic.to_string());
            }
            if before.emissive != after.emissive {
                word(path("emission"), written(after.emissive));
            }
            if let (Some(before), Some(after)) = (lobe(&before.model), lobe(&after.model))
                && before != after
            {
                word(path("lobe"), after.to_owned());
            }
        }
        // No words hold these.
        Edit::Mesh { .. } | Edit::Lights(_) | Edit::Media(_) | Edit::Camera { .. } => {}
    }
    words
}

/// Those of `edits` that hold in `scene`: an animation may have moved on what was edited.
pub fn holding(edits: &[String], scene: &Scene) -> Vec<String> {
    let holds = |text: &&String| {
        let edit = parse(text, scene);
        edit.is_ok_and(|edit| in_words(&edit, scene).is_empty())
    };
    edits.iter().filter(holds).cloned().collect()
}

/// The edits in `first` and then those in `then`, without those that a later one makes void.
pub fn followed_by(first: &[String], then: Vec<String>) -> Vec<String> {
    let mut all = first.to_vec();
    all.extend(then);
    let path = |edit: &str| edit.split_once('=').map(|(path, _)| path.to_owned());
    let later = |index: usize| all[index + 1..].iter().map(|edit| path(edit));
    let kept = (0..all.len()).filter(|&index| later(index).all(|later| later != path(&all[index])));
    kept.map(|index| all[index].clone()).collect()
}

fn written<T: Display>(vector: impl Into<[T; 3]>) -> String {
    let [x, y, z] = vector.into();
    format!("{x},{y},{z}")
}

/// Index of the thing with this name, or with this index.
fn index<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> anyhow::Result<usize> {
    let names: Vec<&str> = names.collect();
    let named = names.iter().position(|known| *known == name);
    let by_index = || name.parse().ok().filter(|index| *index < names.len());
    named.or_else(by_index).with_context(|| {
        let some: Vec<&str> = names.iter().copied().take(20).collect();
        match names.len() {
            0 => "the scene has none".to_owned(),
            count => format!(
                "there is no {name:?} among these {count}: {}",
                some.join(", ")
            ),
        }
    })
}

fn vector(text: &str) -> anyhow::Result<Vec3> {
    Ok(Vec3::from_array(numbers(text)?))
}

/// A point in world space (m), from the file's coordinates.
fn point(text: &str, scene: &Scene) -> anyhow::Result<Vec3> {
    Ok(scene.in_world(DVec3::from_array(numbers(text)?)))
}

/// Colours and intensities.
fn positive(text: &str) -> anyhow::Result<Vec3> {
    let vector = vector(text)?;
    at_least_zero(vector.min_element())?;
    Ok(vector)
}

/// The name of a glossy lobe with an exponent.
fn lobe(model: &MaterialModel) -> Option<&'static str> {
    match model {
        MaterialModel::Phong { .. } => Some("phong"),
        MaterialModel::Blinn { .. } => Some("blinn"),
        MaterialModel::MetallicRoughness | MaterialModel::Conductor { .. } => None,
    }
}

/// The same albedos and exponent with the other lobe.
fn with_lobe(model: MaterialModel, name: &str) -> anyhow::Result<MaterialModel> {
    let (MaterialModel::Phong { kd, ks, shininess } | MaterialModel::Blinn { kd, ks, shininess }) =
        model
    else {
        anyhow::bail!("only lobes with an exponent (Phong's and Blinn's) take each other's place");
    };
    match name {
        "phong" => Ok(MaterialModel::Phong { kd, ks, shininess }),
        "blinn" => Ok(MaterialModel::Blinn { kd, ks, shininess }),
        _ => anyhow::bail!("expected phong or blinn"),
    }
}

/// Degrees about +Y, or yaw, pitch and roll: [`Environment::angles`].
fn rotation(text: &str) -> anyhow::Result<Quat> {
    let degrees = match text.contains(',') {
        true => numbers(text)?,
        false => [number(text)?, 0.0, 0.0],
    };
    Ok(Environment::rotation_by(degrees.map(f32::to_radians)))
}

/// Its inverse, to a ten-thousandth of a degree.
fn angles(environment: &Environment) -> String {
    let rounded = |angle: f32| (angle.to_degrees() * 1e4).round() / 1e4 + 0.0;
    match environment.angles().map(rounded) {
        [yaw, 0.0, 0.0] => yaw.to_string(),
        [yaw, pitch, roll] => format!("{yaw},{pitch},{roll}"),
    }
}

fn number(text: &str) -> anyhow::Result<f32> {
    let [number] = numbers(text)?;
    Ok(number)
}

fn at_least_zero(number: f32) -> anyhow::Result<f32> {
    anyhow::ensure!(number >= 0.0, "{number} is below 0");
    Ok(number)
}

fn part(text: &str) -> anyhow::Result<f32> {
    let number = number(text)?;
    anyhow::ensure!(
        (0.0..=1.0).contains(&number),
        "{number} does not lie between 0 and 1"
    );
    Ok(number)
}

/// World space from mesh space: its three axes, then its origin (m).
fn place_of(text: &str, scene: &Scene) -> anyhow::Result<Mat4> {
    let numbers: [f64; 12] = numbers(text)?;
    let column = |index: usize| DVec3::from_slice(&numbers[3 * index..3 * index + 3]);
    let axis = |index: usize| column(index).as_vec3().extend(0.0);
    let place = Mat4::from_cols(
        axis(0),
        axis(1),
        axis(2),
        scene.in_world(column(3)).extend(1.0),
    );
    anyhow::ensure!(
        place.inverse().is_finite(),
        "its axes lie in a plane: nothing would be left of the object"
    );
    Ok(place)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gpugi_scene::builtin::builtin;

    #[test]
    fn what_was_edited_is_edited_in_words() {
        let mut scene = builtin("cornell", 1).unwrap();
        let (kd, ks, shininess) = (Vec3::splat(0.5), Vec3::splat(0.2), 9.0);
        scene.materials[1].model = MaterialModel::Phong { kd, ks, shininess };
        scene.lights = builtin("room", 1).unwrap().lights;
        scene.environment = Some(gpugi_scene::Environment::default_sky());
        let before = scene.clone();
        let mut environment = scene.environment.clone().unwrap();
        environment.intensity = 0.7;
        environment.rotation = Environment::rotation_by([0.5, -1.2, 2.0]);
        let mut light = scene.lights[0].clone();
        light.intensity *= 0.3;
        light = light.aimed(Vec3::new(0.1, 2.0, 0.7), Vec3::ZERO);
        let mut material = Box::new(scene.materials[0].clone());
        (material.emissive, material.roughness) = (Vec3::new(0.0, 1.0, 2.5), 0.25);
        let mut other = Box::new(scene.materials[1].clone());
        other.model = MaterialModel::Blinn { kd, ks, shininess };
        let place = |index: usize| scene.instances[index].world_from_mesh;
        let mut moved = place(1);
        moved.w_axis.y += 0.1;
        let edits = [
            Edit::Environment(environment),
            Edit::Light { index: 0, light },
            Edit::Material { index: 0, material },
            Edit::Material {
                index: 1,
                material: other,
            },
            Edit::Instance {
                index: 0,
                world_from_mesh: place(0) * Mat4::from_rotation_y(0.3),
            },
            Edit::Instance {
                index: 1,
                world_from_mesh: moved,
            },
        ];
        let mut words = Vec::new();
        for edit in &edits {
            words.extend(in_words(edit, &scene));
            edit.apply_to(&mut scene);
            assert!(in_words(edit, &scene).is_empty(), "{edit:?}");
        }
        assert_eq!(words.len(), 10, "{words:?}");
        assert!(holding(&words, &before).is_empty());
        let mut edited = before;
        apply(&words, &mut edited).unwrap();
        for edit in &edits {
            assert!(in_words(edit, &edited).is_empty(), "{words:?}");
        }
        assert_eq!(holding(&words, &edited), words);
    }

    #[test]
    fn the_last_edit_of_a_thing_counts() {
        let first = ["light.0.position=1,2,3", "environment.rotation=3"].map(str::to_owned);
        let then = vec!["light.0.position=4,5,6".to_owned()];
        assert_eq!(
            followed_by(&first, then),
            ["environment.rotation=3", "light.0.position=4,5,6"]
        );
    }

    #[test]
    fn one_angle_turns_the_environment_about_the_vertical_and_three_turn_it_anyhow() {
        let mut scene = builtin("room", 1).unwrap();
        scene.environment = Some(Environment::default_sky());
        let seen = |text: &str, d: Vec3| {
            let mut scene = scene.clone();
            let edit = edit_of(&format!("environment.rotation={text}"), &scene).unwrap();
            let words = in_words(&edit, &scene);
            edit.apply_to(&mut scene);
            assert_eq!(words, [format!("environment.rotation={text}")]);
            scene.environment.unwrap().rotation * d
        };
        // What was in the south comes to the east; what was above comes to the south, then to the east.
        assert!(seen("90", Vec3::Z).distance(Vec3::X) < 1e-6);
        assert!(seen("90,45,0", Vec3::Y).distance(Vec3::new(0.5, 0.5, 0.0).normalize()) < 1e-6);
        assert!(seen("0,0,30", Vec3::X).distance(Vec3::new(0.75f32.sqrt(), 0.5, 0.0)) < 1e-6);
    }

    #[test]
    fn what_is_wrong_with_an_edit_is_said() {
        let scene = builtin("room", 1).unwrap();
        for (wrong, said) in [
            ("light", "expected light.NAME"),
            ("light.0=1,2,3", "expected light.NAME"),
            ("light.99.position=1,2,3", "there is no \"99\""),
            ("light.0.position=1,2", "\"1,2\""),
            ("light.0.position=1,2,inf", "1,2,inf"),
            ("light.0.intensity=-1,0,0", "below 0"),
            ("light.0.flavour=1", "expected light.NAME"),
            ("object.0.place=0,0,0,0,0,0,0,0,0,0,0,0", "lie in a plane"),
            ("material.0.roughness=2", "between 0 and 1"),
            ("environment.rotation=1,2", "\"1,2\""),
        ] {
            let mut scene = scene.clone();
            scene.environment = Some(gpugi_scene::Environment::default_sky());
            let error = edit_of(wrong, &scene).unwrap_err().to_string();
            assert!(error.starts_with(&format!("--edit {wrong}: ")), "{error}");
            assert!(error.contains(said), "{wrong}: {error}");
        }
    }
}
