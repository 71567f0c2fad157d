//! Whether the path tracer makes a picture, and how.

use gpugi::default_set::StillPicture;
use gpugi::picture::Effects;
use gpugi::reference;
use gpugi_arguments::split_settings;

use super::{Arguments, PATH_TRACER_SAMPLES, is_path_tracer, path_tracer_settings};
use crate::Usage;
use crate::output::{Aov, Format};

/// How the path tracer makes the picture.
pub(super) struct Tracing {
    pub settings: reference::Settings,
    pub samples: u32,
    pub is_denoised: bool,
    /// Nobody named it.
    pub is_default: bool,
}

/// How the path tracer makes the picture, if it does: because it was named, or because it makes still pictures on this
/// adapter and no option asks for something of techniques. Only filtered it has less error than these, so radiance that is
/// not to be filtered is theirs, too.
pub(super) fn path_tracing(
    arguments: &Arguments,
    format: Format,
    effects: &Effects,
    still: StillPicture,
) -> anyhow::Result<Option<Tracing>> {
    let picture = &arguments.picture;
    if is_path_tracer(&picture.technique)? {
        return Ok(Some(Tracing {
            settings: path_tracer_settings(&picture.set)?,
            samples: arguments.samples.unwrap_or(PATH_TRACER_SAMPLES),
            is_denoised: arguments.denoise,
            is_default: false,
        }));
    }
    let settings = split_settings(&picture.set)?;
    let is_of_techniques = |[technique, _, _]: &[&str; 3]| *technique != reference::INFO.name;
    let is_denoised = arguments.denoise || format == Format::Png;
    let asks_for_techniques = !picture.technique.is_empty()
        || !is_denoised
        || arguments.dump_maps.is_some()
        // It follows the lights that a renderer lists.
        || effects.flare.strength > 0.0
        || settings.iter().any(is_of_techniques);
    match still {
        StillPicture::PathTracer { samples, noise } if !asks_for_techniques => {
            let mut settings = path_tracer_settings(&picture.set)?;
            if settings.noise == 0.0 && arguments.samples.is_none() {
                settings.noise = noise;
            }
            Ok(Some(Tracing {
                settings,
                samples: arguments.samples.unwrap_or(samples),
                is_denoised,
                is_default: true,
            }))
        }
        _ if arguments.denoise => Err(Usage(
            "--denoise filters pictures of --technique path-tracer. Of techniques, path-tracing alone has noise that differs \
             from pixel to pixel, and live views filter it; the others share directions and points of lights among pixels"
                .into(),
        )
        .into()),
        _ if arguments.aov.contains(&Aov::Variance) => {
            Err(Usage("--aov variance: path-tracer alone knows it".into()).into())
        }
        _ => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::output;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    /// What makes a picture by these options, written into a file with this extension.
    fn tracing(extension: &str, options: &[&str]) -> anyhow::Result<Option<Tracing>> {
        let output = format!("picture.{extension}");
        let line = [&["render", "cornell", "-o", &output][..], options].concat();
        let arguments = Line::try_parse_from(line)?.arguments;
        let format = output::format(&arguments.output)?;
        let picture = &arguments.picture;
        let (effects, set) = (picture.display).effects(Effects::default(), &picture.set)?;
        let mut arguments = arguments.clone();
        arguments.picture.set = set;
        let still = StillPicture::PathTracer {
            samples: 512,
            noise: 2e-4,
        };
        path_tracing(&arguments, format, &effects, still)
    }

    #[test]
    fn where_paths_are_traced_techniques_can_be_asked_for() {
        let by_default = tracing("png", &[]).unwrap().unwrap();
        assert!(by_default.is_denoised && by_default.is_default);
        assert_eq!((by_default.samples, by_default.settings.noise), (512, 2e-4));
        let of_eight = tracing("png", &["--samples", "8"]).unwrap().unwrap();
        assert_eq!((of_eight.samples, of_eight.settings.noise), (8, 0.0));
        assert!(tracing("exr", &["--denoise"]).unwrap().unwrap().is_denoised);
        let named = tracing("png", &["--technique", "path-tracer"])
            .unwrap()
            .unwrap();
        assert!(!named.is_denoised && !named.is_default);
        for options in [
            &["--technique", "default"][..],
            &["--technique", "shadow-map"],
            &["--set", "shadow-map.taps=8"],
            &["--set", "flare.strength=1"],
            &["--dump-maps", "maps"],
        ] {
            assert!(tracing("png", options).unwrap().is_none(), "{options:?}");
        }
        assert!(tracing("exr", &[]).unwrap().is_none());
        for refused in ["--denoise", "--aov=variance"] {
            assert!(tracing("png", &["--technique", "default", refused]).is_err());
        }
    }
}
