//! `gpugi bake --irradiance-volume`: indirect light at the points of a grid, for what moves in another program.

use anyhow::Context;
use gpugi::bake::IrradianceVolume;
use gpugi::gpu::Gpu;
use gpugi::techniques::final_gather;
use gpugi_scene::image::save_ktx2;

use super::{Arguments, has_extension, say};
use crate::render::{print_notes, split_settings};
use crate::{Common, Usage, scene_argument};

/// The technique whose light a volume holds.
const ADDS: &str = final_gather::INFO.name;

/// Bakes a volume of `density` voxels per metre and writes it, completely or not at all.
pub fn run(common: &Common, arguments: &Arguments, density: f32) -> anyhow::Result<()> {
    let Arguments {
        scene,
        output,
        technique,
        set,
        ..
    } = arguments;
    let refuse = |message: String| Err(Usage(message).into());
    if !(density.is_finite() && density > 0.0) {
        return refuse(format!("--irradiance-volume {density}: voxels per metre"));
    }
    if !has_extension(output, &["ktx2"]) {
        let output = output.display();
        return refuse(format!("-o {output}: irradiance volumes are .ktx2 files"));
    }
    if !technique.iter().any(|name| name == ADDS) {
        return refuse(format!(
            "--irradiance-volume: volumes hold the light of {ADDS}; name it with --technique, after those whose light it reflects"
        ));
    }
    crate::output::check_folders([output.as_path()])?;
    let (scene, notes) = scene_argument::load(scene)?;
    print_notes(common, &notes);
    let gpu = Gpu::open(&common.adapter)?;
    let settings = split_settings(set)?;
    let volume = IrradianceVolume::bake(&gpu, &scene, technique, &settings, ADDS, density)?;
    save_ktx2(output, &volume.texture()).context("cannot be written")?;
    let (middle, extent) = (
        volume.bounds.center(),
        volume.bounds.max - volume.bounds.min,
    );
    let what = format!(
        "{} x {} x {} ambient cubes around {middle} m, in {extent} m",
        volume.counts.x, volume.counts.y, volume.counts.z
    );
    say(common, output, &what);
    Ok(())
}
