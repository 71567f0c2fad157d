//! `gpugi bake`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use gpugi::gpu::Gpu;
use gpugi::techniques::environment_map::{self, export};
use gpugi_scene::image::save_ktx2;
use gpugi_scene::{Limits, import_environment};

use crate::output::write_json;
use crate::render::split_settings;
use crate::{Common, Usage};

/// Options of `gpugi bake`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Equirectangular environment map (.exr, .hdr)
    #[arg(value_name = "FILE")]
    environment: PathBuf,
    /// Folder to write into; made if there is none
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Technique whose maps are written
    #[arg(long, value_parser = [environment_map::INFO.name])]
    technique: String,
    /// A setting of the technique (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    set: Vec<String>,
}

/// Makes the maps of an environment and writes them: each file complete or not at all.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    let mut settings = environment_map::Settings::default();
    for [technique, key, value] in split_settings(&arguments.set)? {
        if technique != arguments.technique {
            let message = format!(
                "--set {technique}.{key}: {technique} is not in use, {} is",
                arguments.technique
            );
            return Err(Usage(message).into());
        }
        if ["irradiance", "metals", "refraction", "objects"].contains(&key) {
            let message =
                format!("--set {technique}.{key}: changes how maps are read, not what they hold");
            return Err(Usage(message).into());
        }
        settings
            .set(key, value)
            .map_err(|error| Usage(format!("--set {technique}.{error}")))?;
    }
    let environment = import_environment(&arguments.environment, &Limits::default())?;
    let folder = &arguments.output;
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made", folder.display()))?;
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

fn say(common: &Common, path: &Path, what: &str) {
    if !common.quiet {
        println!("{}: {what}", path.display());
    }
}
