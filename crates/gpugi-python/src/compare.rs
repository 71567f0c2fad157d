//! Errors of pictures, and pictures for displays.

use std::path::PathBuf;

use gpugi::measure::{MeasureError, Options, Quality};
use gpugi::picture::{Effects, developed};
use gpugi::{Motion, Purpose};
use gpugi_arguments::with_settings;
use gpugi_cli::render::{Chosen, is_path_tracer};
use gpugi_scene::image::metrics::{self, Metric, MetricError, Picture};
use gpugi_scene::image::write_png;
use numpy::{PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyBytes, PyDict};

use crate::camera::PyCamera;
use crate::errors::{raised, wrong};
use crate::gpu::device;
use crate::report::Report;
use crate::scene::{lock, scene_of};
use crate::values::{image, pixels};

/// A picture of radiance, or of bytes as displays show them.
fn picture_of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Picture> {
    if let Ok(bytes) = value.cast::<PyArray3<u8>>() {
        let shape = bytes.shape();
        let ([height, width], channels) = ([shape[0], shape[1]], shape[2]);
        if !(3..=4).contains(&channels) || width * height == 0 {
            return Err(wrong(
                name,
                "an array of shape (height, width, 3 or 4) is needed",
            ));
        }
        let contiguous = value
            .py()
            .import("numpy")?
            .call_method1("ascontiguousarray", (value,))?;
        let values = contiguous.cast::<PyArray3<u8>>()?.to_vec();
        let values = values.map_err(|error| wrong(name, error))?;
        let rgba = values
            .chunks_exact(channels)
            .flat_map(|pixel| [pixel[0], pixel[1], pixel[2], 255]);
        let rgba: Vec<u8> = rgba.collect();
        return Ok(Picture::of_pixels(width as u32, height as u32, &rgba));
    }
    let ([width, height], radiance) = pixels(name, value)?;
    Picture::of_radiance(width, height, radiance).map_err(|reason| wrong(name, reason))
}

fn metric_of(name: &str) -> PyResult<Metric> {
    let found = Metric::ALL.into_iter().find(|metric| metric.name() == name);
    found.ok_or_else(|| {
        let known = Metric::ALL.map(Metric::name).join(", ");
        wrong(
            "metrics",
            format!("there is no {name:?}; there are {known}"),
        )
    })
}

/// The error of a picture against its reference, by metric: the value, and the map of all pixels.
#[pyfunction]
pub fn compare<'py>(
    py: Python<'py>,
    test: &Bound<'py, PyAny>,
    reference: &Bound<'py, PyAny>,
    metrics: Option<Vec<String>>,
) -> PyResult<Bound<'py, PyDict>> {
    let [test, reference] = [
        picture_of("test", test)?,
        picture_of("reference", reference)?,
    ];
    if test.is_display_referred() != reference.is_display_referred() {
        return Err(wrong(
            "reference",
            "compare radiance with radiance, bytes with bytes",
        ));
    }
    let (chosen, is_all) = match metrics {
        Some(names) => {
            let chosen = names.iter().map(|name| metric_of(name));
            (chosen.collect::<PyResult<Vec<_>>>()?, false)
        }
        None => (Metric::ALL.to_vec(), true),
    };
    let result = PyDict::new(py);
    for metric in chosen {
        match py.detach(|| metrics::compare(metric, &test, &reference)) {
            Ok(found) => {
                let map = image(py, test.size(), 1, found.map)?;
                result.set_item(metric.name(), (found.value, map))?;
            }
            // Without being asked for.
            Err(MetricError::TooSmall) if is_all => {}
            Err(error) => return Err(wrong("test", error)),
        }
    }
    Ok(result)
}

/// An image file as linear values.
#[pyfunction]
pub fn read(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let read = py.detach(|| metrics::load_picture(&path, &gpugi_scene::Limits::default()));
    let picture = read.map_err(raised)?;
    image(py, picture.size(), 3, picture.rgb().to_vec())
}

/// What displays show of radiance: (height, width, 4) bytes, sRGB.
#[pyfunction]
pub fn develop<'py>(
    py: Python<'py>,
    radiance: &Bound<'py, PyAny>,
    settings: Vec<String>,
    adapter: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let (size, radiance) = pixels("image", radiance)?;
    if let Some(value) = radiance.iter().find(|value| !value.is_finite()) {
        return Err(wrong("image", format!("it holds {value}")));
    }
    let (effects, rest) = with_settings(Effects::default(), &settings).map_err(raised)?;
    if let Some(setting) = rest.first() {
        return Err(wrong(
            "settings",
            format!("{setting} is no setting of an effect"),
        ));
    }
    let gpu = device(py, adapter)?;
    let rgba = py.detach(|| developed(&gpu, size, &radiance, &effects));
    image(py, size, 4, rgba.map_err(raised)?)
}

/// Bytes of (height, width, 4) as a PNG file.
#[pyfunction]
pub fn png<'py>(py: Python<'py>, rgba: &Bound<'py, PyArray3<u8>>) -> PyResult<Bound<'py, PyBytes>> {
    let shape = rgba.shape();
    let [width, height] = [shape[1] as u32, shape[0] as u32];
    let values = rgba.to_vec().map_err(|error| wrong("image", error))?;
    let mut file = Vec::new();
    write_png(&mut file, width, height, &values).map_err(raised)?;
    Ok(PyBytes::new(py, &file))
}

/// Measures techniques against the path tracer on the same light paths, or on all.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn measure<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    camera: &Bound<'py, PyCamera>,
    size: [i64; 2],
    techniques: Vec<String>,
    settings: Vec<String>,
    samples: u32,
    reference_samples: u32,
    noise: f64,
    seed: u32,
    all_light: bool,
    adapter: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let size = crate::render::check_size(size)?;
    if is_path_tracer(&techniques).map_err(raised)? {
        return Err(wrong(
            "techniques",
            "path-tracer is the reference; name what to compare with it",
        ));
    }
    let shared = scene_of(scene)?;
    let camera = camera.get().0.get()?;
    let gpu = device(py, adapter)?;
    let kept = lock(&shared).clone();
    let options = Options {
        samples,
        reference: Quality {
            samples: reference_samples,
            noise,
        },
        seed,
        motion: Motion::seen_by(&camera, &kept.scene, kept.time),
        all_light,
        ..Options::default()
    };
    let mut report = Report::new(progress);
    let purpose = Purpose::StillPicture;
    let measured = py.detach(|| {
        let mut chosen = Chosen::new(&gpu, &kept.scene, size, purpose, &techniques, &settings)?;
        loop {
            let renderer = &mut chosen.renderer;
            let mut step = |at: &gpugi::measure::Progress| report.step(at.fraction, &at.stage);
            match gpugi::measure::measure(&gpu, &kept.scene, &camera, renderer, &options, &mut step)
            {
                Err(MeasureError::Render(error)) => chosen.without_atlas(error)?,
                measured => return anyhow::Ok(measured?),
            }
        }
    });
    report.end()?;
    let measured = measured.map_err(raised)?;
    let result = PyDict::new(py);
    let values = PyDict::new(py);
    for (metric, found) in &measured.metrics {
        values.set_item(metric.name(), found.value)?;
    }
    result.set_item("metrics", values)?;
    let passes = PyDict::new(py);
    for pass in &measured.passes {
        passes.set_item(&pass.pass, pass.milliseconds)?;
    }
    result.set_item("passes", passes)?;
    let memory = serde_json::to_value(measured.memory).unwrap_or_default();
    result.set_item("memory", crate::json::object(py, &memory)?)?;
    result.set_item("reference_noise", measured.truth.rel_mse())?;
    result.set_item("notes", measured.notes)?;
    result.set_item("color", image(py, size, 3, measured.radiance)?)?;
    result.set_item("reference", image(py, size, 3, measured.truth.radiance)?)?;
    Ok(result)
}
