//! `gpugi bake --technique radiance-transfer` and `--technique light-path-map`: a scene with what the technique computes
//! once, for programs that relight it.

use std::path::Path;
use std::time::Instant;

use gpugi::bake::{Bake, PrecomputedBake};
use gpugi::gpu::Gpu;
use gpugi::techniques::Precomputed;
use gpugi::techniques::light_path_map::LightPathMap;
use gpugi::techniques::radiance_transfer::RadianceTransfer;
use gpugi_arguments::split_settings;
use gpugi_scene::export::{
    ExportError, Exported, Original, TransferFormat, export_panes, export_transfer,
};
use gpugi_scene::{LightPathPanes, Scene, TransferVectors};

use super::has_extension;
use super::options::SceneOptions;
use super::scene::{too_thin, write};
use super::work::begin;
use crate::progress::Progress;
use crate::render::{print_notes, usage};
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, interrupt};

/// How a file stores transfer vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// 16-bit floats, 8 bytes per texel and function
    Half,
    /// 8 bits with a scale per function, 4 bytes per texel and function
    Byte,
}

/// Settings that the options of the atlas take the place of.
const OF_ATLAS: [(&str, &str); 2] = [
    ("resolution", "--atlas-size"),
    ("density", "--texel-density"),
];

/// A technique whose maps are baked.
pub trait Baked: Precomputed {
    /// The maps, in words.
    const MAPS: &'static str;

    /// Side of a page of the atlas, where no option says it.
    fn page_size(gpu: &Gpu, settings: &[[&str; 3]]) -> u32;

    /// Makes the file.
    fn export(
        original: Option<Original>,
        scene: &Scene,
        stored: &Self::Stored,
        options: &SceneOptions,
    ) -> Result<Exported, ExportError>;

    /// What there is per texel, in words.
    fn described(stored: &Self::Stored) -> String;
}

impl Baked for RadianceTransfer {
    const MAPS: &'static str = "transfer vectors";

    /// The largest page, of 1024 texels per side at most, whose vectors fit a binding of the GPU.
    fn page_size(gpu: &Gpu, settings: &[[&str; 3]]) -> u32 {
        let order = settings.iter().find(|[_, key, _]| *key == "order");
        let order = order.and_then(|[_, _, value]| value.parse().ok());
        let functions = order.unwrap_or(6_u64).min(8).pow(2);
        // Of a texel: three 16-bit floats and padding.
        let bytes_per_function = 8;
        let limits = gpu.limits();
        let bytes = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        let fits = |size: &u32| u64::from(*size).pow(2) * functions * bytes_per_function <= bytes;
        [1024, 512].into_iter().find(fits).unwrap_or(256)
    }

    fn export(
        original: Option<Original>,
        scene: &Scene,
        vectors: &TransferVectors,
        options: &SceneOptions,
    ) -> Result<Exported, ExportError> {
        let format = match options.transfer_format {
            Format::Half => TransferFormat::Half,
            Format::Byte => TransferFormat::Byte,
        };
        export_transfer(original, scene, vectors, format)
    }

    fn described(vectors: &TransferVectors) -> String {
        format!("{} functions", vectors.functions())
    }
}

impl Baked for LightPathMap {
    const MAPS: &'static str = "panes";

    /// The tutorial's.
    fn page_size(_: &Gpu, _: &[[&str; 3]]) -> u32 {
        256
    }

    fn export(
        original: Option<Original>,
        scene: &Scene,
        panes: &LightPathPanes,
        _: &SceneOptions,
    ) -> Result<Exported, ExportError> {
        export_panes(original, scene, panes)
    }

    fn described(panes: &LightPathPanes) -> String {
        format!("{} panes", panes.clusters())
    }
}

/// Bakes and writes the file, completely or not at all.
pub fn run<T: Baked>(
    common: &Common,
    arguments: &SceneArguments,
    output: &Path,
    settings: &[String],
    options: &SceneOptions,
) -> anyhow::Result<()> {
    let started = Instant::now();
    let (name, maps) = (T::INFO.name, T::MAPS);
    if !has_extension(output, &["glb"]) {
        let message = format!("-o {}: scenes are baked into .glb files", output.display());
        return Err(Usage(message).into());
    }
    if arguments.time != 0.0 {
        let message = format!("--time: {maps} are those of the scene as its file has it");
        return Err(Usage(message).into());
    }
    let settings_of = split_settings(settings)?;
    for [technique, key, _] in &settings_of {
        if *technique != name {
            let message = format!("--set {technique}.{key}: {technique} is not in use, {name} is");
            return Err(Usage(message).into());
        }
        if let Some((_, option)) = OF_ATLAS.iter().find(|(setting, _)| setting == key) {
            return Err(Usage(format!("--set {name}.{key}: {option} decides it")).into());
        }
        if *key == "stored" {
            let message = format!("--set {name}.stored: a bake computes the {maps}");
            return Err(Usage(message).into());
        }
    }
    crate::output::check_folders([output])?;
    let (scene, mut notes) = scene_argument::load(arguments)?;
    let gpu = Gpu::open(&common.adapter)?;
    let mut options = options.clone();
    options
        .atlas_size
        .get_or_insert_with(|| T::page_size(&gpu, &settings_of));
    let options = &options;
    interrupt::catch();
    let techniques = [name.to_owned()];
    let mut work = begin(
        Progress::new(common.quiet),
        &gpu,
        [output, &std::env::current_exe()?],
        &scene,
        (&techniques, settings, options),
    )?;
    let atlas = work.done.atlas.clone();
    notes.extend(too_thin(atlas.slivers(&scene)));
    if scene.rig.is_some() {
        notes.push(format!(
            "{maps} are those of still objects: where some move, they do not fit"
        ));
    }
    let (size, pages) = (atlas.size, atlas.pages);
    let mut bake = PrecomputedBake::<T>::new(&gpu, &scene, atlas).map_err(usage)?;
    for [_, key, value] in settings_of {
        bake.set(key, value).map_err(usage)?;
    }
    work.timed("setup");
    if let Some(saved) = work.done.precomputed.take() {
        bake.resume(saved);
    }
    while let Some(at) = bake.step()? {
        work.progress.show(f64::from(at.done), "rays");
        work.after_step(|checkpoint| {
            checkpoint.precomputed = Some(bake.save()?);
            Ok(())
        })?;
    }
    work.progress.finish();
    work.timed("rays");
    let stored = bake.finish()?;
    let warnings = write(Some(arguments), output, |original| {
        T::export(original, &scene, &stored, options)?.changed(&options.changes(None))
    })?;
    notes.extend(warnings);
    work.timed("writing");
    work.forget();
    print_notes(common, &notes);
    if !common.quiet {
        println!(
            "{}: {} at {pages} x {size} x {size} texels, {:.2} s on {} ({})",
            output.display(),
            T::described(&stored),
            started.elapsed().as_secs_f64(),
            gpu.adapter.name,
            work.times.join(", ")
        );
    }
    Ok(())
}
