//! Arguments that the `gpugi` command, the viewer and its page share: which scene, which techniques, how it is shown.

pub mod edits;
pub mod files;
pub mod scene_argument;

use std::str::FromStr;

use gpugi::picture::Effects;
use gpugi::settings::SettingSet;
use serde::{Deserialize, Serialize};

/// Invalid arguments: exit code 2.
#[derive(Debug)]
pub struct Usage(pub String);

impl std::fmt::Display for Usage {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for Usage {}

/// Width and height from `WIDTHxHEIGHT`.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|&side| side > 0);
    text.split_once('x')
        .and_then(|(width, height)| Some([side(width)?, side(height)?]))
        .ok_or_else(|| "expected WIDTHxHEIGHT, such as 1280x1024".to_owned())
}

/// As many finite numbers as asked for, separated by commas.
///
/// # Errors
/// A sentence.
pub fn numbers<T, const COUNT: usize>(text: &str) -> anyhow::Result<[T; COUNT]>
where
    T: FromStr + Into<f64> + Copy,
{
    let is_finite = |number: &T| ((*number).into() as f32).is_finite();
    let number = |text: &str| text.trim().parse().ok().filter(is_finite);
    let numbers: Option<Vec<T>> = text.split(',').map(number).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| match COUNT {
        1 => anyhow::anyhow!("{text:?} is no number"),
        3 => anyhow::anyhow!("{text:?} is not of the form x,y,z"),
        _ => anyhow::anyhow!("{text:?} is not {COUNT} numbers that commas separate"),
    })
}

/// The word that `--technique` has for no technique at all.
pub const NO_TECHNIQUE: &str = "none";

/// The word that `--technique` has for the default set of techniques, where something else is the default.
pub const DEFAULT_TECHNIQUES: &str = "default";

/// The names of techniques that `--technique` holds; `None` for the default set.
pub fn technique_names(option: &[String]) -> Option<Vec<String>> {
    match option {
        [] => None,
        [word] if word == DEFAULT_TECHNIQUES => None,
        [word] if word == NO_TECHNIQUE => Some(Vec::new()),
        names => Some(names.to_vec()),
    }
}

/// Splits `--set` options into technique, key and value.
pub fn split_settings(settings: &[String]) -> anyhow::Result<Vec<[&str; 3]>> {
    settings
        .iter()
        .map(|setting| {
            setting
                .split_once('=')
                .and_then(|(path, value)| {
                    let (technique, key) = path.split_once('.')?;
                    Some([technique, key, value])
                })
                .ok_or_else(|| {
                    Usage(format!("--set {setting}: expected technique.key=value")).into()
                })
        })
        .collect()
}

/// Options that say how a picture is displayed. Each is short for a setting of an effect.
#[derive(Debug, Clone, PartialEq, clap::Args, Serialize, Deserialize)]
pub struct DisplayArguments {
    /// Exposure in EV (0 shows radiance 1 as 1), or auto
    #[arg(
        long,
        value_name = "EV|auto",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    pub exposure: String,
    /// Tone mapping: none, reinhard, aces, agx, neutral [default: that of the look]
    #[arg(long, value_name = "NAME")]
    pub tone_map: Option<String>,
    /// Effects to start from; --set changes them
    #[arg(long, value_enum, value_name = "NAME", default_value_t)]
    pub look: Look,
}

/// Effects to start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Look {
    /// What the scene sends to the eye
    #[default]
    Plain,
    /// What a camera makes of it: glow, flare, exposure that adapts, ACES; a vignette if it has an aperture
    Film,
}

impl Default for DisplayArguments {
    fn default() -> Self {
        Self {
            exposure: "auto".into(),
            tone_map: None,
            look: Look::Plain,
        }
    }
}

impl DisplayArguments {
    /// The effects `of` a purpose, changed by these options and by those of `--set` that name an effect; and the rest of
    /// the latter.
    ///
    /// # Errors
    /// [`Usage`], which names the option.
    pub fn effects(&self, of: Effects, set: &[String]) -> anyhow::Result<(Effects, Vec<String>)> {
        let mut effects = match self.look {
            Look::Plain => of,
            Look::Film => of.of_a_camera(),
        };
        effects.exposure.value = (self.exposure.parse())
            .map_err(|error| Usage(format!("--exposure {}: {error}", self.exposure)))?;
        if let Some(name) = &self.tone_map {
            (effects.tone_map.set("operator", name))
                .map_err(|error| Usage(format!("--tone-map {name}: {error}")))?;
        }
        with_settings(effects, set)
    }
}

/// Effects, changed by the options of `--set` that name one; and the rest of these options.
///
/// # Errors
/// [`Usage`], which names the option.
pub fn with_settings(
    mut effects: Effects,
    set: &[String],
) -> anyhow::Result<(Effects, Vec<String>)> {
    let mut rest = Vec::new();
    for ([name, key, value], setting) in split_settings(set)?.into_iter().zip(set) {
        match effects.set(name, key, value) {
            Some(done) => {
                done.map_err(|error| Usage(format!("--set {setting}: {error}")))?;
            }
            None => rest.push(setting.clone()),
        }
    }
    Ok((effects, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_change_the_effects_of_a_look() {
        let film = DisplayArguments {
            look: Look::Film,
            ..DisplayArguments::default()
        };
        let (plain, _) = (DisplayArguments::default().effects(Effects::default(), &[])).unwrap();
        assert_eq!(plain, Effects::default());
        let (effects, _) = film.effects(Effects::default(), &[]).unwrap();
        assert_eq!(effects, Effects::default().of_a_camera());
        assert!(effects.flare.is_on() && effects.glow.is_on());
        let less = DisplayArguments {
            tone_map: Some("reinhard".into()),
            ..film
        };
        let set = [
            "flare.strength=0".to_owned(),
            "caustics.photons=9".to_owned(),
        ];
        let (effects, rest) = less.effects(Effects::default(), &set).unwrap();
        assert!(!effects.flare.is_on() && effects.glow.is_on());
        assert_eq!(effects.tone_map.operator.name(), "reinhard");
        assert_eq!(rest, set[1..]);
    }

    #[test]
    fn none_names_no_technique() {
        let names = |option: &[&str]| {
            let option: Vec<String> = option.iter().map(ToString::to_string).collect();
            technique_names(&option)
        };
        assert_eq!(names(&[]), None);
        assert_eq!(names(&["none"]), Some(Vec::new()));
        let two = ["shadow-map", "caustics"];
        assert_eq!(names(&two), Some(two.map(str::to_owned).to_vec()));
    }
}
