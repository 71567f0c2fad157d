//! `gpugi compare`.

use std::path::PathBuf;

use anyhow::Context;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use gpugi_scene::image::metrics::{
    Comparison, Metric, MetricError, both_display_referred, compare, heat_map, load_picture,
};
use serde_json::{Map, Value, json};

use crate::output::{write_json, write_png};
use crate::scene_argument::parse_limits;
use crate::{Common, Usage};

/// Options of `gpugi compare`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Image under test (.png, .jpg, .hdr, .exr, .ktx2)
    #[arg(value_name = "A")]
    test: PathBuf,
    /// Reference image of the same size
    #[arg(value_name = "B")]
    reference: PathBuf,
    /// Metric to compute (default: all)
    #[arg(long, value_parser = metric_parser())]
    metric: Option<Metric>,
    /// Write a heat map of the metric's error per pixel (rel-mse if no metric is given)
    #[arg(long, value_name = "FILE.png")]
    diff: Option<PathBuf>,
    /// Exit with 1 if the metric is above this value (psnr and ssim, where larger is better: below)
    #[arg(
        long,
        value_name = "VALUE",
        requires = "metric",
        allow_negative_numbers = true
    )]
    max: Option<f64>,
    /// Write the result as JSON; an infinite psnr is null
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Raises, or lowers, what files may ask for, as in side=32768,images=32GiB (docs/security.md)
    #[arg(
        long,
        value_name = "NAME=VALUE,...",
        default_value = "",
        hide_default_value = true
    )]
    limits: String,
}

fn metric_parser() -> impl TypedValueParser<Value = Metric> {
    PossibleValuesParser::new(Metric::ALL.map(Metric::name)).try_map(|name| {
        let named = Metric::ALL.into_iter().find(|metric| metric.name() == name);
        named.ok_or("there is no such metric")
    })
}

/// Compares, prints and writes the requested files, then checks the result against the bound.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.max.is_some_and(f64::is_nan) {
        return Err(Usage("--max needs a number".into()).into());
    }
    if let Some(path) = &arguments.diff
        && path
            .extension()
            .is_none_or(|extension| !extension.eq_ignore_ascii_case("png"))
    {
        let message = format!("--diff {}: the name must end in .png", path.display());
        return Err(Usage(message).into());
    }
    let limits = parse_limits(&arguments.limits)?;
    let test = load_picture(&arguments.test, &limits)?;
    let reference = load_picture(&arguments.reference, &limits)?;
    let names = [&arguments.test, &arguments.reference].map(|path| path.display().to_string());
    let pair = names.join(" against ");
    let as_display = both_display_referred(&test, &reference);
    let mut notes = Vec::new();
    if !as_display {
        for (picture, name) in [&test, &reference].into_iter().zip(&names) {
            if picture.is_display_referred() {
                notes.push(format!(
                    "{name} is decoded from sRGB to compare it with radiance: that is fair only if it was written \
                     with --exposure 0 --tone-map none and nothing in it is brighter than 1"
                ));
            }
        }
    }
    let metrics = arguments
        .metric
        .map_or(Metric::ALL.to_vec(), |metric| vec![metric]);
    let mut results = Vec::new();
    for metric in metrics {
        match compare(metric, &test, &reference) {
            Ok(result) => results.push((metric, result)),
            Err(reason @ MetricError::TooSmall) if arguments.metric.is_none() => {
                notes.push(format!("no {}: {reason}", metric.name()));
            }
            Err(error) => return Err(error).context(pair),
        }
    }

    let size = test.size();
    let compared_as = if as_display { "display" } else { "radiance" };
    if !common.quiet {
        for note in &notes {
            eprintln!("note: {note}");
        }
        println!("{pair}: {}x{}, as {compared_as}", size[0], size[1]);
        for (metric, result) in &results {
            print_line(*metric, result);
        }
    }
    let [(metric, first), ..] = &results[..] else {
        unreachable!("rel-mse compares any two pictures of one size")
    };
    if let Some(path) = &arguments.diff {
        write_png(path, size, &heat_map(*metric, &first.map))?;
    }
    if let Some(path) = &arguments.json {
        let metrics: Map<String, Value> = results
            .iter()
            .map(|(metric, result)| (metric.name().to_owned(), in_json(result)))
            .collect();
        let report = json!({
            "test": names[0],
            "reference": names[1],
            "size": size,
            "compared_as": compared_as,
            "metrics": metrics,
            "notes": notes,
        });
        write_json(path, &report)?;
    }
    if let Some(bound) = arguments.max
        && !metric.within(first.value, bound)
    {
        let side = if metric.larger_is_better() {
            "below"
        } else {
            "above"
        };
        anyhow::bail!(
            "{pair}: {} is {}, {side} the bound {bound}",
            metric.name(),
            first.value
        );
    }
    Ok(())
}

/// Prints one line: name, value, and the metric's parameters.
pub fn print_line(metric: Metric, result: &Comparison) {
    let unit = if metric == Metric::Psnr { "dB" } else { "" };
    let parameters: Vec<String> = result
        .parameters
        .iter()
        .map(|&(name, value)| format!("{} {}", name.replace('_', " "), value as f32))
        .collect();
    let line = format!(
        "  {:10} {:14.8} {unit:3} {}",
        metric.name(),
        result.value,
        parameters.join(", ")
    );
    println!("{}", line.trim_end());
}

/// A metric's value and parameters as JSON; an infinite value is null.
pub fn in_json(result: &Comparison) -> Value {
    let value = ("value".to_owned(), json!(result.value));
    let parameters = result.parameters.iter();
    std::iter::once(value)
        .chain(parameters.map(|&(name, value)| (name.to_owned(), json!(value))))
        .collect::<Map<_, _>>()
        .into()
}
