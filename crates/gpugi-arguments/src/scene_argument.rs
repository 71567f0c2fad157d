//! Scene selection: a file or a built-in name.

use std::path::{Path, PathBuf};

use anyhow::Context;
use glam::{DVec3, Vec3};
use gpugi_scene::{
    Camera, Environment, FileResolver, Lens, Limits, Projection, Scene, builtin, import,
    import_environment, import_file, import_file_within, lens,
};
use serde::{Deserialize, Serialize};

use crate::edits;
use crate::files::Files;
use crate::{Usage, numbers};

/// Options that select the scene.
#[derive(Debug, Clone, PartialEq, clap::Args, Serialize, Deserialize)]
pub struct SceneArguments {
    /// Scene file (.gltf, .glb, .obj, .ply) or name of a built-in scene (`gpugi list scenes`)
    pub scene: String,
    /// Tessellation level of a built-in scene
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub detail: u32,
    /// Equirectangular environment map (.hdr, .exr, .ktx2, .png, .jpg)
    #[arg(long, value_name = "FILE")]
    pub environment: Option<PathBuf>,
    /// Animation time (s)
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    pub time: f32,
    /// Objects, lights and media to leave out: names separated by commas; * stands for any characters
    #[arg(
        long,
        value_name = "NAME,...",
        default_value = "",
        hide_default_value = true
    )]
    pub without: String,
    /// Edit lights, objects, materials or the environment: light.0.position=0,2,0 (repeatable; docs/viewer.md)
    #[arg(long, value_name = "WHAT.KEY=VALUE", allow_hyphen_values = true)]
    pub edit: Vec<String>,
    /// Also read files in this folder and below it if the scene refers to them (docs/security.md)
    #[arg(long, value_name = "FOLDER")]
    pub files_from: Option<PathBuf>,
    /// Raises, or lowers, what files may ask for: file=BYTES, side=TEXELS, images=BYTES, scene=BYTES, expansion=N,
    /// displacement=TRIANGLES, separated by commas; bytes may end in KiB, MiB or GiB (docs/security.md)
    #[arg(
        long,
        value_name = "NAME=VALUE,...",
        default_value = "",
        hide_default_value = true
    )]
    pub limits: String,
}

impl SceneArguments {
    /// Selects the scene `name`, and leaves everything else as it is by default.
    pub fn of(name: &str) -> Self {
        Self {
            scene: name.to_owned(),
            detail: 1,
            environment: None,
            time: 0.0,
            without: String::new(),
            edit: Vec::new(),
            files_from: None,
            limits: String::new(),
        }
    }

    /// As they are written on the command line, without the time and the edits.
    pub fn in_words(&self) -> Vec<String> {
        let Self {
            scene,
            detail,
            environment,
            time: _,
            without,
            edit: _,
            files_from,
            limits,
        } = self;
        let path = |path: &Option<PathBuf>| path.as_ref().map(|path| path.display().to_string());
        let text = |text: &String| (!text.is_empty()).then(|| text.clone());
        let options = [
            ("--detail", (*detail != 1).then(|| detail.to_string())),
            ("--environment", path(environment)),
            ("--without", text(without)),
            ("--files-from", path(files_from)),
            ("--limits", text(limits)),
        ];
        let set = options
            .into_iter()
            .filter_map(|(name, value)| Some([name.to_owned(), value?]));
        std::iter::once(scene.clone())
            .chain(set.flatten())
            .collect()
    }

    /// The limits on what files may ask for.
    pub fn limits(&self) -> anyhow::Result<Limits> {
        parse_limits(&self.limits)
    }

    /// Reads the files that the scene refers to.
    pub fn resolver(&self) -> anyhow::Result<FileResolver> {
        let folder = Path::new(&self.scene).parent().unwrap_or(Path::new("."));
        let limits = self.limits()?;
        Ok(match &self.files_from {
            Some(root) => FileResolver::within(folder, root, limits),
            None => FileResolver::new(folder, limits),
        })
    }
}

/// The limits that `--limits` sets.
pub fn parse_limits(text: &str) -> anyhow::Result<Limits> {
    let mut limits = Limits::default();
    let set = limits.set(text);
    set.map_err(|reason| Usage(format!("--limits: {reason}")))?;
    Ok(limits)
}

/// Loads the scene, adds a sky if it has no light, and edits it. Also returns notes for the user.
pub fn load(arguments: &SceneArguments) -> anyhow::Result<(Scene, Vec<String>)> {
    load_among(arguments, &Files::default())
}

/// As [`load`]; `files` take the place of those on disk that have their names.
pub fn load_among(
    arguments: &SceneArguments,
    files: &Files,
) -> anyhow::Result<(Scene, Vec<String>)> {
    let limits = arguments.limits()?;
    let mut scene = scene_of(arguments, files, &limits)?;
    if !arguments.time.is_finite() {
        return Err(Usage("--time needs a finite number of seconds".into()).into());
    }
    if arguments.time != 0.0 {
        scene.pose(arguments.time);
    }
    if let Some(path) = &arguments.environment {
        scene.environment = Some(environment_of(path, files, &limits)?);
    }
    let mut notes = scene.warnings.clone();
    let things = |scene: &Scene| scene.instances.len() + scene.lights.len();
    let count = things(&scene);
    scene
        .remove(&arguments.without)
        .map_err(|unknown| Usage(format!("--without {}: {unknown}", arguments.without)))?;
    let left = things(&scene);
    if left < count {
        let removed = count - left;
        notes.push(format!(
            "{removed} of {count} objects and lights are left out: {}",
            arguments.without
        ));
    }
    if !scene.has_light() {
        scene.environment = Some(Environment::default_sky());
        notes.push(
            "the scene has no light: lit by a default sky (choose one with --environment FILE)"
                .into(),
        );
    }
    edits::apply(&arguments.edit, &mut scene)?;
    if scene.instances.is_empty() {
        notes.push("the scene holds no triangles".into());
    }
    Ok((scene, notes))
}

/// The scene's file, or what the built-in scene's name stands for.
fn scene_of(arguments: &SceneArguments, files: &Files, limits: &Limits) -> anyhow::Result<Scene> {
    let name = &arguments.scene;
    let path = Path::new(name);
    if let Some(bytes) = files.get(name) {
        return Ok(import(name, bytes, files, limits)?);
    }
    if path.extension().is_some() || name.contains(std::path::MAIN_SEPARATOR) {
        check_is_readable(name)?;
        return Ok(match &arguments.files_from {
            Some(root) if !root.is_dir() => {
                let reason = format!("--files-from {}: there is no such folder", root.display());
                return Err(Usage(reason).into());
            }
            Some(root) => import_file_within(path, root, limits)?,
            None => import_file(path, limits)?,
        });
    }
    builtin::builtin(name, arguments.detail).ok_or_else(|| {
        let names: Vec<_> = builtin::SCENES.iter().map(|scene| scene.name).collect();
        let names = names.join(", ");
        let reason = format!(
            "there is no built-in scene {name:?}; there are: {names} (a file needs its extension)"
        );
        Usage(reason).into()
    })
}

/// The environment in an image file.
pub fn environment_of(path: &Path, files: &Files, limits: &Limits) -> anyhow::Result<Environment> {
    let name = path.display().to_string();
    if let Some(bytes) = files.get(&name) {
        return Ok(Environment::from_file(&name, bytes, limits)?);
    }
    check_is_readable(&name)?;
    Ok(import_environment(path, limits)?)
}

/// Refuses files where there is no file system.
fn check_is_readable(name: &str) -> anyhow::Result<()> {
    anyhow::ensure!(
        !cfg!(target_arch = "wasm32"),
        "{name}: drop it on the page to open it; a page reads no other files"
    );
    Ok(())
}

/// The camera that `choice` selects, for an image of the given aspect ratio (width / height).
pub fn camera(scene: &Scene, choice: Option<&str>, aspect: f32) -> anyhow::Result<Camera> {
    view(scene, choice, aspect).map(|(camera, _)| camera)
}

/// As [`camera`], with the point (world space (m)) at which it looks, if `choice` says so.
pub fn view(
    scene: &Scene,
    choice: Option<&str>,
    aspect: f32,
) -> anyhow::Result<(Camera, Option<Vec3>)> {
    match choice.filter(|choice| choice.contains('=')) {
        Some(text) => {
            let seen = look_at(scene, text);
            Ok(seen.map_err(|error| Usage(format!("--camera: {error:#}")))?)
        }
        None => Ok((camera_of_scene(scene, choice, aspect)?, None)),
    }
}

/// The camera with a name or an index; without, the first, or one that frames the scene.
fn camera_of_scene(scene: &Scene, choice: Option<&str>, aspect: f32) -> anyhow::Result<Camera> {
    let Some(choice) = choice else {
        return Ok(match scene.cameras.first() {
            Some(camera) => camera.clone(),
            None => Camera::framing(&scene.bounds(), aspect),
        });
    };
    let by_index = choice
        .parse::<usize>()
        .ok()
        .and_then(|index| scene.cameras.get(index));
    let named = scene
        .cameras
        .iter()
        .find(|camera| camera.name == choice)
        .or(by_index);
    named.cloned().ok_or_else(|| {
        let names: Vec<_> = scene
            .cameras
            .iter()
            .map(|camera| camera.name.as_str())
            .collect();
        Usage(format!(
            "there is no camera {choice:?}; there are {}: {}",
            names.len(),
            names.join(", ")
        ))
        .into()
    })
}

/// What `--camera` may say of a camera.
const KEYS: [&str; 9] = [
    "eye", "target", "up", "fov", "from", "aperture", "focus", "blades", "shutter",
];

/// Parses `eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEGREES;aperture=M;focus=M;blades=N;shutter=S`, with eye and target in the
/// file's coordinates, and returns the target, too. A missing eye or target is chosen to frame the scene; a missing up is
/// +Y, a missing fov 35 degrees, a missing focus is at the target. Without eye and target, it is a camera of the scene:
/// that which `from` names, else the first; what is missing is as this camera has it, and there is no target.
fn look_at(scene: &Scene, text: &str) -> anyhow::Result<(Camera, Option<Vec3>)> {
    let mut given = std::collections::BTreeMap::new();
    for part in text.split(';').filter(|part| !part.trim().is_empty()) {
        let (key, value) = part.split_once('=').context("expected key=value")?;
        let key = key.trim();
        let known = KEYS.join(", ");
        anyhow::ensure!(
            KEYS.contains(&key),
            "there is no {key:?}; there are {known}"
        );
        given.insert(key, value.trim());
    }
    let number = |key: &str, unit: &str| {
        let parse = |value: &&str| {
            let number: Result<f32, _> = value.parse();
            number.with_context(|| format!("{key} needs {unit}, not {value:?}"))
        };
        given.get(key).map(parse).transpose()
    };
    let point = |key: &str| {
        let parse = |text: &&str| anyhow::Ok(scene.in_world(DVec3::from_array(numbers(text)?)));
        given.get(key).map(parse).transpose()
    };
    let (eye, target) = (point("eye")?, point("target")?);
    let degrees = number("fov", "a number of degrees")?;
    anyhow::ensure!(
        degrees.is_none_or(|degrees| (1.0..=170.0).contains(&degrees)),
        "fov must lie between 1 and 170 degrees"
    );
    let (mut camera, target) = if eye.is_none() && target.is_none() {
        (
            camera_of_scene(scene, given.get("from").copied(), 1.0)?,
            None,
        )
    } else {
        anyhow::ensure!(
            !given.contains_key("from"),
            "give either from, or eye and target"
        );
        let framing = Camera::framing(&scene.bounds(), 1.0);
        let eye = eye.unwrap_or(framing.world_from_view.w_axis.truncate());
        let target = target.unwrap_or(scene.bounds().center());
        anyhow::ensure!(eye.distance(target) > 1e-9, "eye and target must differ");
        (
            Camera::look_at("command line", eye, target, 35.0_f32.to_radians()),
            Some((eye, target)),
        )
    };
    if let Some(degrees) = degrees {
        camera.projection = Projection::Perspective {
            vertical_fov: degrees.to_radians(),
        };
    }
    if let Some(up) = given.get("up") {
        let up = Vec3::from(numbers(up)?);
        let backward = camera.world_from_view.z_axis.truncate();
        let right = up.normalize_or_zero().cross(backward);
        anyhow::ensure!(right.length() > 1e-6, "up must point aside of the view");
        let right = right.normalize();
        camera.world_from_view.x_axis = right.extend(0.0);
        camera.world_from_view.y_axis = backward.cross(right).extend(0.0);
    }
    let aperture = number("aperture", "a radius in metres")?.unwrap_or(camera.lens.aperture);
    let of_camera = (!camera.lens.is_pinhole()).then_some(camera.lens.focus);
    let of_target = target.map(|(eye, target)| eye.distance(target));
    let focus = number("focus", "a distance in metres")?
        .or(of_target)
        .or(of_camera);
    anyhow::ensure!(
        focus.is_some() || aperture <= 0.0,
        "an aperture needs focus=, the distance at which the camera sees sharply (m)"
    );
    let blades = match given.get("blades") {
        Some(value) => {
            let count = value.parse();
            count.with_context(|| format!("blades needs a number, not {value:?}"))?
        }
        None => camera.lens.blades,
    };
    camera.lens = Lens::new(aperture, focus.unwrap_or(1.0), blades)?;
    camera.shutter =
        lens::shutter(number("shutter", "a number of seconds")?.unwrap_or(camera.shutter))?;
    Ok((camera, target.map(|(_, target)| target)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Far from the origin, too, an eye stands where it was told to, to the millimetre.
    #[test]
    fn eye_and_target_are_in_the_coordinates_of_the_file() {
        let mut scene = builtin::builtin("cornell", 1).unwrap();
        scene.origin = DVec3::new(500_000.0, 0.0, -4_200_000.0);
        let words = "eye=500000.001,1,-4199997;target=500000.001,1,-4200000";
        let (camera, target) = view(&scene, Some(words), 1.0).unwrap();
        let eye = camera.world_from_view.w_axis.truncate();
        assert!(eye.distance(Vec3::new(0.001, 1.0, 3.0)) < 1e-6, "{eye}");
        assert!(target.unwrap().distance(Vec3::new(0.001, 1.0, 0.0)) < 1e-6);
    }

    #[test]
    fn up_turns_a_camera_around_its_view() {
        let scene = builtin::builtin("cornell", 1).unwrap();
        let seen_as = |words: &str| view(&scene, Some(words), 1.0);
        let (camera, target) = seen_as("eye=0,3,0;target=0,1,0;up=2,0,0;fov=50").unwrap();
        assert_eq!(target, Some(Vec3::Y));
        let axes = [0, 1, 2, 3].map(|axis| camera.world_from_view.col(axis).truncate());
        assert_eq!(axes, [Vec3::Z, Vec3::X, Vec3::Y, Vec3::new(0.0, 3.0, 0.0)]);
        for (wrong, said) in [
            ("eye=0,3,0;target=0,1,0;up=0,1,0", "aside"),
            ("eye=0,3,0;target=0,1,0;up=0,0,0", "aside"),
            ("eye=0,3,0;target=0,1,0;up=1,nan,0", "x,y,z"),
            (
                "eye=0,3,0;down=0,1,0",
                "there are eye, target, up, fov, from,",
            ),
            ("eye=0,1,0;target=0,1,0", "differ"),
            ("eye=0,1,3;aperture=-1", "an aperture of -1 m"),
            ("eye=0,1,3;aperture=nan", "an aperture of NaN m"),
            ("eye=0,1,3;aperture=0.1;focus=0", "a focus of 0 m"),
            ("eye=0,1,3;aperture=0.1;blades=2", "2 blades"),
            ("eye=0,1,3;blades=six", "blades needs a number"),
            ("eye=0,1,3;shutter=-1", "a shutter of -1 s"),
            ("aperture=0.1", "needs focus="),
            ("from=nobody;fov=30", "there is no camera"),
            ("from=0;eye=0,1,3", "either from"),
            ("=5", "there is no \"\""),
        ] {
            let error = format!("{:#}", seen_as(wrong).unwrap_err());
            assert!(error.contains(said), "{wrong}: {error}");
        }
    }

    #[test]
    fn a_lens_is_put_on_a_camera_of_the_scene_or_focused_on_the_target() {
        let mut scene = builtin::builtin("cornell", 1).unwrap();
        let seen_as = |scene: &Scene, words: &str| view(scene, Some(words), 1.0).unwrap();
        let (camera, _) = seen_as(&scene, "eye=0,1,3;target=0,1,0;aperture=0.05;blades=6");
        assert_eq!(camera.lens, Lens::new(0.05, 3.0, 6).unwrap());
        let (camera, target) = seen_as(&scene, "aperture=0.1;focus=2.5;shutter=0.02");
        assert_eq!((target, camera.shutter), (None, 0.02));
        assert_eq!(camera.lens, Lens::new(0.1, 2.5, 0).unwrap());
        assert_eq!(camera.world_from_view, scene.cameras[0].world_from_view);
        scene.cameras.push(camera);
        let last = format!("from={};aperture=0.2", scene.cameras.len() - 1);
        assert_eq!(
            seen_as(&scene, &last).0.lens,
            Lens::new(0.2, 2.5, 0).unwrap()
        );
        assert_eq!(seen_as(&scene, "aperture=0").0.lens, Lens::PINHOLE);
    }
}
