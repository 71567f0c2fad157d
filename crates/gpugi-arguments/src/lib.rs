//! Arguments that the `gpugi` command, the viewer and its page share: which scene, which techniques, how it is shown.

pub mod edits;
pub mod files;
pub mod scene_argument;

use std::str::FromStr;

use gpugi::display::{DisplaySettings, Exposure, ToneMap};

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

/// The names of techniques that `--technique` holds; `None` without the option.
pub fn technique_names(option: &[String]) -> Option<Vec<String>> {
    match option {
        [] => None,
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

/// Display settings from `--exposure` and `--tone-map`.
pub fn display_settings(exposure: &str, tone_map: Option<&str>) -> anyhow::Result<DisplaySettings> {
    let exposure = match exposure {
        "auto" => Exposure::Auto,
        text => Exposure::Manual(
            text.parse()
                .ok()
                .filter(|ev: &f32| ev.is_finite())
                .ok_or_else(|| Usage(format!("--exposure {text}: a number of EV or auto")))?,
        ),
    };
    let mut settings = DisplaySettings {
        exposure,
        ..Default::default()
    };
    if let Some(name) = tone_map {
        settings.tone_map = name
            .parse::<ToneMap>()
            .map_err(|error| Usage(format!("--tone-map: {error}")))?;
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

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
