//! `gpugi bake --technique radiance-transfer`: a scene with its transfer vectors, for programs that relight it.

use std::path::Path;
use std::time::Instant;

use gpugi::bake::{Bake, TransferBake};
use gpugi::gpu::Gpu;
use gpugi::techniques::radiance_transfer;
use gpugi_arguments::split_settings;
use gpugi_scene::export::{TransferFormat, export_transfer};

use super::has_extension;
use super::scene::{SceneOptions, too_thin, write};
use super::work::begin;
use crate::render::{print_notes, usage};
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, interrupt};

/// The technique whose vectors are baked.
pub const NAME: &str = radiance_transfer::INFO.name;

/// How a file stores transfer vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// 16-bit floats, 8 bytes per texel and function
    Half,
    /// 8 bits with a scale per function, 4 bytes per texel and function
    Byte,
}

/// Of a texel: three 16-bit floats and padding.
const BYTES_PER_FUNCTION: u64 = 8;

/// Settings that the options of the atlas take the place of.
const OF_ATLAS: [(&str, &str); 2] = [
    ("resolution", "--atlas-size"),
    ("density", "--texel-density"),
];

/// Bakes and writes the file, completely or not at all.
pub fn run(
    common: &Common,
    arguments: &SceneArguments,
    output: &Path,
    settings: &[String],
    options: &SceneOptions,
) -> anyhow::Result<()> {
    let started = Instant::now();
    if !has_extension(output, &["glb"]) {
        let message = format!("-o {}: scenes are baked into .glb files", output.display());
        return Err(Usage(message).into());
    }
    if arguments.time != 0.0 {
        let message = "--time: transfer vectors are those of the scene as its file has it";
        return Err(Usage(message.into()).into());
    }
    let settings_of = split_settings(settings)?;
    for [technique, key, _] in &settings_of {
        if *technique != NAME {
            let message = format!("--set {technique}.{key}: {technique} is not in use, {NAME} is");
            return Err(Usage(message).into());
        }
        if let Some((_, option)) = OF_ATLAS.iter().find(|(name, _)| name == key) {
            return Err(Usage(format!("--set {NAME}.{key}: {option} decides it")).into());
        }
        if *key == "stored" {
            let message = format!("--set {NAME}.stored: a bake computes the vectors");
            return Err(Usage(message).into());
        }
    }
    crate::output::check_folders([output])?;
    let (scene, mut notes) = scene_argument::load(arguments)?;
    let gpu = Gpu::open(&common.adapter)?;
    let mut options = options.clone();
    options
        .atlas_size
        .get_or_insert_with(|| page_size(&gpu, &settings_of));
    let options = &options;
    interrupt::catch();
    let techniques = [NAME.to_owned()];
    let mut work = begin(
        common,
        &gpu,
        output,
        &scene,
        (&techniques, settings, options),
    )?;
    let atlas = work.done.atlas.clone();
    notes.extend(too_thin(atlas.slivers(&scene)));
    if scene.rig.is_some() {
        notes.push(
            "transfer vectors are those of still objects: where some move, they do not fit".into(),
        );
    }
    let (size, pages) = (atlas.size, atlas.pages);
    let mut bake = TransferBake::new(&gpu, &scene, atlas).map_err(usage)?;
    for [_, key, value] in settings_of {
        bake.set(key, value).map_err(usage)?;
    }
    work.timed("setup");
    if let Some(saved) = work.done.transfer.take() {
        bake.resume(saved);
    }
    while let Some(at) = bake.step()? {
        work.progress.show(f64::from(at.done), "rays");
        work.after_step(|checkpoint| {
            checkpoint.transfer = Some(bake.save()?);
            Ok(())
        })?;
    }
    work.progress.finish();
    work.timed("rays");
    let vectors = bake.finish()?;
    let format = match options.transfer_format {
        Format::Half => TransferFormat::Half,
        Format::Byte => TransferFormat::Byte,
    };
    let warnings = write(arguments, output, |original| {
        export_transfer(original, &scene, &vectors, format)
    })?;
    notes.extend(warnings);
    work.timed("writing");
    work.forget();
    print_notes(common, &notes);
    if !common.quiet {
        println!(
            "{}: {} functions at {pages} x {size} x {size} texels, {:.2} s on {} ({})",
            output.display(),
            vectors.functions(),
            started.elapsed().as_secs_f64(),
            gpu.adapter.name,
            work.times.join(", ")
        );
    }
    Ok(())
}

/// The largest page, of 1024 texels per side at most, whose vectors fit a binding of the GPU.
fn page_size(gpu: &Gpu, settings: &[[&str; 3]]) -> u32 {
    let order = settings.iter().find(|[_, key, _]| *key == "order");
    let order = order.and_then(|[_, _, value]| value.parse().ok());
    let functions = order.unwrap_or(6_u64).min(8).pow(2);
    let limits = gpu.limits();
    let bytes = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let fits = |size: &u32| u64::from(*size).pow(2) * functions * BYTES_PER_FUNCTION <= bytes;
    [1024, 512].into_iter().find(fits).unwrap_or(256)
}
