//! Output of the commands: images, quantities of surface points, maps, JSON.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use gpugi::gpu::Gpu;
use gpugi::techniques::Map;
use gpugi::{Renderer, capture};
use gpugi_scene::image::{save_exr, save_hdr, save_png};

use crate::Usage;

/// Writes a line to standard output. Ends the command, as if it were done, if the reader has closed its end; what else
/// goes wrong there is no reason to lose a picture.
pub fn print_line(line: std::fmt::Arguments<'_>) {
    let result = writeln!(std::io::stdout(), "{line}");
    if result.is_err_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe) {
        std::process::exit(0);
    }
}

/// The middle value; NaN of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// An image file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// 8-bit sRGB.
    Png,
    /// Linear radiance, 32-bit floats.
    Exr,
    /// Linear radiance with shared exponents.
    Hdr,
}

/// The format that a file's extension selects.
pub fn format(path: &Path) -> anyhow::Result<Format> {
    let extension = path
        .extension()
        .map(|extension| extension.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("png") => Ok(Format::Png),
        Some("exr") => Ok(Format::Exr),
        Some("hdr") => Ok(Format::Hdr),
        _ => Err(Usage(format!(
            "-o {}: the name must end in .png, .exr or .hdr",
            path.display()
        ))
        .into()),
    }
}

/// Rejects paths whose folder does not exist, before hours are spent on their content.
pub fn check_folders<'a>(paths: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<()> {
    for path in paths {
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        anyhow::ensure!(
            folder.is_dir(),
            "{}: there is no folder {}",
            path.display(),
            folder.display()
        );
    }
    Ok(())
}

/// Creates a folder and its parents.
pub fn make_folder(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))
}

/// Where a frame of a folder of frames is: `0000.png` and so on.
pub fn frame_path(folder: &Path, frame: u32) -> PathBuf {
    folder.join(format!("{frame:04}.png"))
}

/// Writes display pixels: 8-bit sRGB, RGBA.
pub fn write_png(path: &Path, [width, height]: [u32; 2], pixels: &[u8]) -> anyhow::Result<()> {
    save_png(path, width, height, pixels).with_context(|| cannot_write(path))
}

/// Writes linear radiance, three floats per pixel, as EXR or HDR.
pub fn write_radiance(
    path: &Path,
    format: Format,
    [width, height]: [u32; 2],
    radiance: &[f32],
) -> anyhow::Result<()> {
    match format {
        Format::Hdr => save_hdr(path, width, height, radiance),
        Format::Exr | Format::Png => save_exr(path, width, height, radiance),
    }
    .with_context(|| cannot_write(path))
}

fn cannot_write(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}

/// Writes JSON to a temporary file, then renames it.
pub fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    gpugi_scene::image::replace_file(path, |file| {
        std::io::Write::write_all(file, text.as_bytes())
    })
    .with_context(|| format!("{}: cannot be written", path.display()))
}

/// A quantity of surface points that can be written as an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Aov {
    /// Diffuse albedo plus reflectance at normal incidence.
    Albedo,
    /// Shading normal in world space.
    Normal,
    /// Distance along the view direction (m).
    Depth,
    /// Position in the file's coordinates (m).
    Position,
}

/// Writes surface points as linear EXR images named `OUTPUT-aov.exr`. The background is zero.
pub fn write_aovs(
    renderer: &Renderer,
    output: &Path,
    [width, height]: [u32; 2],
    aovs: &[Aov],
    camera: &gpugi_scene::Camera,
    scene: &gpugi_scene::Scene,
) -> anyhow::Result<()> {
    if aovs.is_empty() {
        return Ok(());
    }
    let points = renderer.surface_points()?;
    let eye = camera.world_from_view.w_axis.truncate();
    let forward = -camera.world_from_view.z_axis.truncate();
    for aov in aovs {
        let value = |point: &capture::VisiblePoint| match aov {
            Aov::Albedo => point.albedo,
            Aov::Normal => point.normal,
            Aov::Depth => glam::Vec3::splat((point.position - eye).dot(forward)),
            Aov::Position => (point.position.as_dvec3() + scene.origin).as_vec3(),
        };
        let texels: Vec<f32> = points
            .iter()
            .flat_map(|point| point.as_ref().map_or(glam::Vec3::ZERO, value).to_array())
            .collect();
        let name = format!("{aov:?}").to_lowercase();
        let stem = output.file_stem().unwrap_or_default().to_string_lossy();
        let path = output.with_file_name(format!("{stem}-{name}.exr"));
        save_exr(&path, width, height, &texels)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

/// Writes the finest level of each technique's maps as EXR. Depth stays reversed, as stored. Integers become grey.
/// Faces of a cube and pages of an atlas are stacked vertically.
pub fn dump_maps(gpu: &Gpu, maps: &[Map], folder: &Path) -> anyhow::Result<()> {
    make_folder(folder)?;
    for map in maps {
        let mut texels = Vec::new();
        let mut size = [0, 0];
        for layer in 0..map.layers() {
            let read = map.begin_read(gpu, layer, 0)?;
            size = [read.size[0], size[1] + read.size[1]];
            texels.extend(read.wait()?);
        }
        let path = folder.join(format!("{}.exr", map.name));
        save_exr(&path, size[0], size[1], &texels)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}
