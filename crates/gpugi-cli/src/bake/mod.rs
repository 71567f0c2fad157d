//! `gpugi bake`: bakes a scene's light, or what relights it, into texture space, or an environment into maps.

mod lights;
mod options;
mod precomputed;
mod scene;
mod tasks;
mod volume;
mod work;

use std::path::{Path, PathBuf};

use anyhow::Context;
use gpugi::gpu::Gpu;
use gpugi::settings::SettingSet;
use gpugi::techniques::environment_map::{self, export};
use gpugi::techniques::light_path_map::{self, LightPathMap};
use gpugi::techniques::radiance_transfer::{self, RadianceTransfer};
use gpugi_arguments::split_settings;
use gpugi_scene::image::save_ktx2;
use gpugi_scene::import_environment;

use crate::output::{make_folder, write_json};
use crate::scene_argument::SceneArguments;
use crate::{Common, Usage};
pub use options::{LightUnits, SceneOptions};
pub use scene::{Baked, Order, Subject, bake, write};
pub use tasks::SharedBake;

/// Options of `gpugi bake`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// File to write (.glb; .ktx2 or .json for an irradiance volume), or folder for an environment's maps
    #[arg(short, long, value_name = "FILE|DIR")]
    output: PathBuf,
    /// Techniques whose light is baked, separated by commas; radiance-transfer alone writes what relights the scene under
    /// any environment, light-path-map alone what does so under any lights; environment-map alone writes an environment's
    /// maps (SCENE is an .exr or .hdr)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    technique: Vec<String>,
    /// A technique's setting (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    set: Vec<String>,
    /// Instead of texels, write a .ktx2 or .json with the light of final-gather in a grid of this many voxels per metre
    #[arg(long, value_name = "DENSITY")]
    irradiance_volume: Option<f32>,
    /// What the voxels hold: ambient cubes as Bevy reads them (.ktx2), or nine spherical harmonics each (.ktx2, .json)
    #[arg(long, value_enum, requires = "irradiance_volume")]
    volume_as: Option<volume::Representation>,
    #[command(flatten)]
    options: SceneOptions,
}

/// Bakes.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(edit) = arguments.scene.edit.first() {
        // What is baked is added to the scene's own file.
        let message = format!("--edit {edit}: a bake is of the scene as its file has it");
        return Err(Usage(message).into());
    }
    let alone = [
        environment_map::INFO.name,
        radiance_transfer::INFO.name,
        light_path_map::INFO.name,
    ];
    let is_alone = matches!(&arguments.technique[..], [name] if alone.contains(&&**name));
    if arguments.options.denoise && (is_alone || arguments.irradiance_volume.is_some()) {
        let message = "--denoise: filters the light of texels, which is not baked";
        return Err(Usage(message.into()).into());
    }
    if let Some(density) = arguments.irradiance_volume {
        return volume::run(common, arguments, density);
    }
    if arguments.technique == [environment_map::INFO.name] {
        return environment(common, arguments);
    }
    let scene = &arguments.scene.scene;
    if has_extension(Path::new(scene), &["exr", "hdr"]) {
        return Err(Usage(format!(
            "{scene}: the maps of an environment are baked with --technique {}",
            environment_map::INFO.name
        ))
        .into());
    }
    let Arguments {
        scene,
        output,
        technique,
        set,
        options,
        ..
    } = arguments;
    match &technique[..] {
        [name] if name == radiance_transfer::INFO.name => {
            precomputed::run::<RadianceTransfer>(common, scene, output, set, options)
        }
        [name] if name == light_path_map::INFO.name => {
            precomputed::run::<LightPathMap>(common, scene, output, set, options)
        }
        _ => scene::run(common, scene, output, (technique, set, options)),
    }
}

/// Builds the maps of an environment and writes them. Each file is written completely or not at all.
fn environment(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    let mut settings = environment_map::Settings::default();
    for [technique, key, value] in split_settings(&arguments.set)? {
        if technique != environment_map::INFO.name {
            let message = format!(
                "--set {technique}.{key}: {technique} is not in use, {} is",
                environment_map::INFO.name
            );
            return Err(Usage(message).into());
        }
        if ["irradiance", "metals", "refraction", "objects"].contains(&key) {
            let message =
                format!("--set {technique}.{key}: changes how maps are read, not what they hold");
            return Err(Usage(message).into());
        }
        SettingSet::set(&mut settings, key, value)
            .map_err(|error| Usage(format!("--set {technique}.{error}")))?;
    }
    let limits = arguments.scene.limits()?;
    let environment = import_environment(Path::new(&arguments.scene.scene), &limits)?;
    let folder = &arguments.output;
    make_folder(folder)?;
    let gpu = Gpu::open(&common.adapter)?;
    let baked = export::bake(&gpu, &environment.image, &settings)?;
    for (name, texture) in [
        ("radiance.ktx2", &baked.radiance),
        ("irradiance.ktx2", &baked.irradiance),
        ("ggx.ktx2", &baked.ggx),
        ("phong.ktx2", &baked.phong),
        ("albedo.ktx2", &baked.albedo),
    ] {
        let path = folder.join(name);
        save_ktx2(&path, texture).context("cannot be written")?;
        let [width, height] = texture.size;
        say(
            common,
            &path,
            &format!(
                "{width}x{height}, faces {}, levels {}",
                texture.faces,
                texture.levels.len()
            ),
        );
    }
    let path = folder.join("irradiance-sh.json");
    write_json(&path, &baked.description)?;
    say(
        common,
        &path,
        "nine spherical harmonics, roughness of each level",
    );
    Ok(())
}

/// Whether a path has one of these extensions, ignoring case.
pub fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|found| {
        extensions
            .iter()
            .any(|extension| found.eq_ignore_ascii_case(extension))
    })
}

fn say(common: &Common, path: &Path, what: &str) {
    if !common.quiet {
        println!("{}: {what}", path.display());
    }
}
