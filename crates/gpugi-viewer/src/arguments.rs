//! What the viewer starts with, as the command line or a page's address says it.

use std::collections::BTreeMap;
use std::path::Path;

use clap::Parser;
use clap::error::ErrorKind;
use gpugi::picture::Effects;
use gpugi::techniques::Registry;
use gpugi_arguments::scene_argument::SceneArguments;
use gpugi_arguments::{DisplayArguments, Usage, split_settings, technique_names};
use percent_encoding::percent_decode_str;
use serde_json::Value;

use crate::technique_set::{PATH_TRACER, TechniqueSet};
use crate::viewer::{Look, Start, Walks};

/// Name of the scene in an address or a view file. Everything else has the name of its option.
pub(crate) const SCENE: &str = "scene";

/// Options that may be repeated.
pub(crate) const REPEATED: [&str; 2] = ["set", "edit"];

/// Options that select what is seen.
#[derive(Debug, clap::Args)]
pub struct ViewArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Scene camera by name or index, or "eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEG"
    #[arg(long)]
    camera: Option<String>,
    #[command(flatten)]
    display: DisplayArguments,
    /// Techniques, separated by commas, or path-tracer, or none (default: what suits the scene in
    /// motion)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    technique: Vec<String>,
    /// A technique's setting (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    set: Vec<String>,
    /// Samples per pixel of a picture at rest (default: 64; 1024 for path-tracer)
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub samples: Option<u32>,
    /// Frames per second that are wanted while something moves (default: 60)
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(5..=240))]
    frame_rate: Option<u32>,
    /// Run the scene's animation from the beginning
    #[arg(long)]
    play: bool,
    /// Walk, with the eye so many metres above the ground (default: what suits the scene)
    #[arg(
        long,
        value_name = "HEIGHT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "",
        value_parser = parse_walks
    )]
    walk: Option<Walks>,
}

impl ViewArguments {
    /// The view file that they name in place of a scene, if they do.
    ///
    /// # Errors
    /// [`Usage`] if there are other options that say what is seen.
    pub fn view_file(&self) -> anyhow::Result<Option<&Path>> {
        let Self {
            scene,
            camera,
            display,
            technique,
            set,
            samples: _,
            frame_rate: _,
            play: _,
            walk: _,
        } = self;
        let name = &scene.scene;
        if !is_view_file(Path::new(name)) {
            return Ok(None);
        }
        let is_alone = *scene == SceneArguments::of(name)
            && camera.is_none()
            && *display == DisplayArguments::default()
            && technique.is_empty()
            && set.is_empty();
        if !is_alone {
            let message = format!("{name} says what is seen: options belong into it");
            return Err(Usage(message).into());
        }
        Ok(Some(Path::new(name)))
    }

    /// What they ask for.
    ///
    /// # Errors
    /// [`Usage`], which names the option.
    pub fn start(&self) -> anyhow::Result<Start> {
        let mut set = TechniqueSet {
            names: technique_names(&self.technique),
            ..TechniqueSet::default()
        };
        let (effects, settings) = (self.display).effects(Effects::of_live_view(), &self.set)?;
        let registry = Registry::default();
        for [technique, name, value] in split_settings(&settings)? {
            if technique != PATH_TRACER && registry.find(technique).is_none() {
                let message =
                    format!("--set {technique}.{name}: there is no technique {technique:?}");
                return Err(Usage(message).into());
            }
            set.set(technique, name, value);
        }
        Ok(Start {
            scene: self.scene.clone(),
            set,
            look: Look {
                camera: self.camera.clone(),
                effects,
                samples: self.samples,
                frame_rate: self.frame_rate.unwrap_or(Look::default().frame_rate),
                plays: self.play,
                walks: self.walk,
            },
        })
    }
}

/// What `--walk` says: nothing, or the height of the eye above the ground (m).
fn parse_walks(text: &str) -> Result<Walks, String> {
    let is_height = |height: &f32| height.is_finite() && *height > 0.0;
    let height = text.parse().ok().filter(is_height);
    match height {
        None if !text.is_empty() => Err("expected a height above 0 (m)".into()),
        eye_height => Ok(Walks { eye_height }),
    }
}

/// Whether a file's name is that of a view file.
pub fn is_view_file(file: &Path) -> bool {
    let extension = file.extension();
    extension.is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// What an address holds after `#`: `scene=NAME` and options of `gpugi view`, joined by `&`, such as
/// `scene=cornell&technique=shadow-map&set=shadow-map.taps=16`. Without a scene, the Cornell box.
///
/// # Errors
/// A sentence.
pub fn of_address(text: &str) -> Result<Start, String> {
    let mut options = Vec::new();
    for part in text.split('&').filter(|part| !part.is_empty()) {
        let (name, value) = part.split_once('=').unwrap_or((part, ""));
        let value = percent_decode_str(value).decode_utf8();
        let value = value.map_err(|_| format!("{part:?} is no UTF-8"))?;
        options.push((name.to_owned(), value.into_owned()));
    }
    of_options(options)
}

/// What a view file holds: a JSON object with the scene and options of `gpugi view`, such as
/// `{"scene": "cornell", "technique": "shadow-map", "set": ["shadow-map.taps=16"]}`.
///
/// # Errors
/// A sentence.
pub fn of_view_file(text: &[u8]) -> Result<Start, String> {
    let view: BTreeMap<String, Value> =
        serde_json::from_slice(text).map_err(|error| format!("no view file: {error}"))?;
    let mut options = Vec::new();
    for (name, value) in view {
        let values = match value {
            Value::Array(values) => values,
            value => vec![value],
        };
        for value in values {
            let value = match value {
                Value::String(text) => text,
                Value::Number(number) => number.to_string(),
                value => return Err(format!("{name}: {value} is neither a text nor a number")),
            };
            options.push((name.clone(), value));
        }
    }
    of_options(options)
}

fn of_options(options: Vec<(String, String)>) -> Result<Start, String> {
    #[derive(Parser)]
    struct Options {
        #[command(flatten)]
        view: ViewArguments,
    }
    let mut scene = "cornell".to_owned();
    let mut words = vec!["gpugi".to_owned()];
    for (name, value) in options {
        if name == SCENE {
            scene = value;
        } else {
            words.push(format!("--{name}={value}"));
        }
    }
    words.extend(["--".to_owned(), scene]);
    let options = Options::try_parse_from(words).map_err(|error| match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => "there is no help here".to_owned(),
        _ => {
            let text = error.to_string();
            let line = text.lines().next().unwrap_or_default();
            line.trim_start_matches("error: ").to_owned()
        }
    });
    let start = options?.view.start();
    start.map_err(|error| format!("{error:#}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_scene_and_options() {
        let start = of_address(
            "scene=glass%2Droom&camera=eye=1,2,-3;target=0,0,0;fov=35&exposure=-1.5&technique=shadow-map,caustics\
             &set=shadow-map.taps=16&samples=3&frame-rate=30&time=2.5",
        )
        .unwrap();
        assert_eq!(
            (start.scene.scene.as_str(), start.scene.time),
            ("glass-room", 2.5)
        );
        assert_eq!(
            start.look.camera.as_deref(),
            Some("eye=1,2,-3;target=0,0,0;fov=35")
        );
        assert_eq!(start.look.effects.exposure.value.to_string(), "-1.5");
        assert_eq!((start.look.samples, start.look.frame_rate), (Some(3), 30));
        assert_eq!(
            start.set.names.as_deref().unwrap(),
            ["shadow-map", "caustics"]
        );
        assert_eq!(start.set.settings["shadow-map"]["taps"], "16");
        assert_eq!(start.look.walks, None);
        for (address, eye_height) in [("walk", None), ("walk=", None), ("walk=0.17", Some(0.17))] {
            let walks = of_address(address).unwrap().look.walks;
            assert_eq!(walks, Some(Walks { eye_height }), "{address}");
        }
        let empty = of_address("").unwrap();
        assert_eq!(
            (empty.scene.scene.as_str(), empty.set.names),
            ("cornell", None)
        );
        assert_eq!(
            of_address("technique=none").unwrap().set.names,
            Some(Vec::new())
        );
    }

    #[test]
    fn a_view_file_is_a_scene_and_options() {
        let start = of_view_file(
            br#"{"scene": "room", "time": 2.5, "set": ["shadow-map.taps=16"], "edit": ["light.0.position=0,1,0"]}"#,
        )
        .unwrap();
        assert_eq!(
            (start.scene.scene.as_str(), start.scene.time),
            ("room", 2.5)
        );
        assert_eq!(start.scene.edit, ["light.0.position=0,1,0"]);
        assert_eq!(start.set.settings["shadow-map"]["taps"], "16");
        for (wrong, said) in [
            ("", "no view file"),
            ("[]", "no view file"),
            (r#"{"flavour": "mild"}"#, "--flavour"),
            (r#"{"samples": {}}"#, "samples: {}"),
            (r#"{"samples": [1, 2]}"#, "--samples"),
            (r#"{"edit": [[]]}"#, "edit: []"),
        ] {
            let error = of_view_file(wrong.as_bytes()).err();
            let error = error.unwrap_or_else(|| panic!("{wrong:?} is no view file"));
            assert!(error.contains(said), "{wrong:?}: {error}");
        }
    }

    #[test]
    fn what_is_wrong_with_an_address_is_said() {
        for (wrong, said) in [
            ("flavour=mild", "--flavour"),
            ("samples=0", "samples"),
            ("frame-rate=4", "frame-rate"),
            ("samples=999999999999", "samples"),
            ("exposure=nan", "--exposure"),
            ("walk=-1", "--walk"),
            ("walk=inf", "--walk"),
            ("set=shadow-map.taps", "technique.key=value"),
            ("set=fog.taps=3", "no technique"),
            ("scene=%ff", "UTF-8"),
            ("help=1", ""),
            ("help", ""),
        ] {
            let error = of_address(wrong).err();
            let error = error.unwrap_or_else(|| panic!("{wrong:?} is no address"));
            assert!(error.contains(said), "{wrong:?}: {error}");
        }
    }
}
