//! `gpugi bake --irradiance-volume`: indirect light at the points of a grid, for what moves in another program.

use std::path::Path;

use anyhow::Context;
use clap::ValueEnum;
use gpugi::bake::{HarmonicVolume, IrradianceVolume, Volume, VolumeLight};
use gpugi::gpu::Gpu;
use gpugi_arguments::split_settings;
use gpugi_scene::image::{replace_file, save_ktx2};

use super::{Arguments, has_extension, lights, say};
use crate::render::print_notes;
use crate::{Common, Usage, scene_argument};

/// How a volume holds the light at a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Representation {
    /// Irradiance over pi of surfaces that face along and against the axes.
    Cubes,
    /// Nine spherical harmonics of the radiance.
    Harmonics,
}

/// Bakes a volume of `density` voxels per metre and writes it, completely or not at all.
pub fn run(common: &Common, arguments: &Arguments, density: f32) -> anyhow::Result<()> {
    let Arguments {
        scene,
        output,
        technique,
        set,
        volume_as,
        ..
    } = arguments;
    let refuse = |message: String| Err(Usage(message).into());
    if !(density.is_finite() && density > 0.0) {
        return refuse(format!("--irradiance-volume {density}: voxels per metre"));
    }
    let is_json = has_extension(output, &["json"]);
    let volume_as = match volume_as {
        Some(given) => *given,
        None if is_json => Representation::Harmonics,
        None => Representation::Cubes,
    };
    let shown = output.display();
    if !is_json && !has_extension(output, &["ktx2"]) {
        return refuse(format!(
            "-o {shown}: irradiance volumes are .ktx2 or .json files"
        ));
    }
    if is_json && volume_as == Representation::Cubes {
        return refuse(format!(
            "-o {shown}: ambient cubes are written to .ktx2 files"
        ));
    }
    let in_volumes = lights::in_volumes();
    let is_held = |name: &&String| in_volumes.contains(&name.as_str());
    let Some(adds) = technique.iter().find(is_held) else {
        let held = in_volumes.join(" or ");
        return refuse(format!(
            "--irradiance-volume: volumes hold the light of {held}; name it with --technique, after those whose light it reflects"
        ));
    };
    crate::output::check_folders([output.as_path()])?;
    let (scene, notes) = scene_argument::load(scene)?;
    print_notes(common, &notes);
    let gpu = Gpu::open(&common.adapter)?;
    let light = VolumeLight {
        names: technique,
        settings: &split_settings(set)?,
        adds,
    };
    let (counts, bounds, what) = match volume_as {
        Representation::Cubes => {
            let volume = IrradianceVolume::bake(&gpu, &scene, &light, density)?;
            save_ktx2(output, &volume.texture()).context("cannot be written")?;
            (volume.counts, volume.bounds, "ambient cubes")
        }
        Representation::Harmonics => {
            let volume = HarmonicVolume::bake(&gpu, &scene, &light, density)?;
            save_harmonics(output, &volume, is_json).context("cannot be written")?;
            (volume.counts, volume.bounds, "times nine harmonics")
        }
    };
    let [low, high] = bounds.map(|corner| scene.in_world(corner));
    let what = format!(
        "{} x {} x {} {what} around {} m, in {} m",
        counts.x,
        counts.y,
        counts.z,
        scene.in_file((low + high) * 0.5),
        high - low
    );
    say(common, output, &what);
    Ok(())
}

fn save_harmonics(path: &Path, volume: &HarmonicVolume, is_json: bool) -> anyhow::Result<()> {
    if !is_json {
        return Ok(save_ktx2(path, &volume.texture())?);
    }
    // On one line: there are 27 numbers per voxel.
    let text = serde_json::to_vec(volume)?;
    replace_file(path, |file| std::io::Write::write_all(file, &text))?;
    Ok(())
}
