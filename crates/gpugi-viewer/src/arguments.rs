//! What the viewer starts with, as the command line or a page's address says it.

use clap::Parser;
use clap::error::ErrorKind;
use gpugi::techniques::Registry;
use gpugi_arguments::scene_argument::SceneArguments;
use gpugi_arguments::{Usage, display_settings, split_settings};
use percent_encoding::percent_decode_str;

use crate::technique_set::TechniqueSet;
use crate::viewer::{Look, Start};

/// Name of the scene in an address. Everything else has the name of its option.
pub(crate) const SCENE: &str = "scene";

/// Options that select what is seen.
#[derive(Debug, clap::Args)]
pub struct ViewArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Scene camera by name or index, or "eye=x,y,z;target=x,y,z;fov=DEG"
    #[arg(long)]
    camera: Option<String>,
    /// Exposure in EV (0 shows radiance 1 as 1), or auto
    #[arg(
        long,
        value_name = "EV|auto",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    exposure: String,
    /// Tone mapping: none, reinhard, aces, agx, neutral
    #[arg(long, value_name = "NAME")]
    tone_map: Option<String>,
    /// Techniques, separated by commas (default: what suits the scene in motion)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    technique: Vec<String>,
    /// A technique's setting (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    set: Vec<String>,
    /// Samples per pixel of a picture at rest (default: 64)
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub samples: Option<u32>,
}

impl ViewArguments {
    /// What they ask for.
    ///
    /// # Errors
    /// [`Usage`], which names the option.
    pub fn start(&self) -> anyhow::Result<Start> {
        // An empty name stands for no technique at all.
        let names = self.technique.iter().filter(|name| !name.is_empty());
        let mut set = TechniqueSet {
            names: (!self.technique.is_empty()).then(|| names.cloned().collect()),
            ..TechniqueSet::default()
        };
        let registry = Registry::default();
        for [technique, name, value] in split_settings(&self.set)? {
            if registry.find(technique).is_none() {
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
                display: display_settings(&self.exposure, self.tone_map.as_deref())?,
                samples: self.samples.unwrap_or(Look::default().samples),
            },
        })
    }
}

/// What an address holds after `#`: `scene=NAME` and options of `gpugi view`, joined by `&`, such as
/// `scene=cornell&technique=shadow-map&set=shadow-map.taps=16`. Without a scene, the Cornell box.
///
/// # Errors
/// A sentence.
pub fn of_address(text: &str) -> Result<Start, String> {
    #[derive(Parser)]
    struct Address {
        #[command(flatten)]
        view: ViewArguments,
    }
    let mut scene = "cornell".to_owned();
    let mut words = vec!["gpugi".to_owned()];
    for part in text.split('&').filter(|part| !part.is_empty()) {
        let (name, value) = part.split_once('=').unwrap_or((part, ""));
        let value = percent_decode_str(value).decode_utf8();
        let value = value.map_err(|_| format!("{part:?} is no UTF-8"))?;
        if name == SCENE {
            scene = value.into_owned();
        } else {
            words.push(format!("--{name}={value}"));
        }
    }
    words.extend(["--".to_owned(), scene]);
    let address = Address::try_parse_from(words).map_err(|error| match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => "this is an address".to_owned(),
        _ => {
            let text = error.to_string();
            let line = text.lines().next().unwrap_or_default();
            line.trim_start_matches("error: ").to_owned()
        }
    });
    let start = address?.view.start();
    start.map_err(|error| format!("{error:#}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_scene_and_options() {
        let start = of_address(
            "scene=glass%2Droom&camera=eye=1,2,-3;target=0,0,0;fov=35&exposure=-1.5&technique=shadow-map,caustics\
             &set=shadow-map.taps=16&samples=3&time=2.5",
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
        assert_eq!(start.look.display.exposure.to_string(), "-1.5");
        assert_eq!(start.look.samples, 3);
        assert_eq!(
            start.set.names.as_deref().unwrap(),
            ["shadow-map", "caustics"]
        );
        assert_eq!(start.set.settings["shadow-map"]["taps"], "16");
        let empty = of_address("").unwrap();
        assert_eq!(
            (empty.scene.scene.as_str(), empty.set.names),
            ("cornell", None)
        );
        assert_eq!(
            of_address("technique=").unwrap().set.names,
            Some(Vec::new())
        );
    }

    #[test]
    fn what_is_wrong_with_an_address_is_said() {
        for (wrong, said) in [
            ("flavour=mild", "--flavour"),
            ("samples=0", "samples"),
            ("samples=999999999999", "samples"),
            ("exposure=nan", "--exposure"),
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
