//! Output of the commands: images, quantities of surface points, maps, JSON.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use gpugi::gpu::TextureAspect::{All, DepthOnly};
use gpugi::gpu::{Gpu, read_buffer, read_texture};
use gpugi::techniques::{Map, Texels};
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
    /// Position in world space (m).
    Position,
}

/// Writes surface points as linear EXR images named `OUTPUT-aov.exr`. The background is zero.
pub fn write_aovs(
    renderer: &Renderer,
    output: &Path,
    [width, height]: [u32; 2],
    aovs: &[Aov],
    camera: &gpugi_scene::Camera,
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
            Aov::Position => point.position,
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
        let (size, texels) = texels(gpu, &map.texels)?;
        let path = folder.join(format!("{}.exr", map.name));
        save_exr(&path, size[0], size[1], &texels)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

/// The colour of a word with a shared exponent.
fn rgb9e5(word: u32) -> [f32; 3] {
    let scale = 2.0_f32.powi((word >> 27) as i32 - 24);
    [0, 9, 18].map(|shift| (word >> shift & 511) as f32 * scale)
}

/// The number of the low 16 bits.
fn half(word: u32) -> f32 {
    half::f16::from_bits(word as u16).to_f32()
}

/// Width and height, and three numbers per texel.
fn texels(gpu: &Gpu, texels: &Texels) -> anyhow::Result<([u32; 2], Vec<f32>)> {
    let grey = |value: f32| [value; 3];
    let texture = match texels {
        Texels::Texture(texture) => texture,
        Texels::Buffer {
            buffer,
            size,
            stride,
            is_number,
        } => {
            let count = u64::from(size[0]) * u64::from(size[1]);
            let words: Vec<u32> = read_buffer(gpu, buffer, count * stride)?;
            let texels = words.chunks_exact(*stride as usize / 4);
            let values = texels.flat_map(|texel| match *texel {
                [number, ..] if *is_number => grey(number as f32),
                [r, g, b, ..] => [r, g, b].map(f32::from_bits),
                [word] => rgb9e5(word),
                [low, high] => [low, low >> 16, high].map(half),
                _ => grey(0.0),
            });
            return Ok((*size, values.collect()));
        }
    };
    let layers = texture.depth_or_array_layers();
    let mut values: Vec<f32> = Vec::new();
    for layer in 0..layers {
        match texture.format() {
            format if format.is_depth_stencil_format() => {
                let depth: Vec<f32> = read_texture(gpu, texture, DepthOnly, layer, 0)?;
                values.extend(depth.into_iter().flat_map(grey));
            }
            format if format.block_copy_size(None) == Some(4) => {
                let numbers: Vec<u32> = read_texture(gpu, texture, All, layer, 0)?;
                values.extend(numbers.iter().flat_map(|&number| grey(number as f32)));
            }
            _ => {
                let colors: Vec<[half::f16; 4]> = read_texture(gpu, texture, All, layer, 0)?;
                let colors = colors.iter();
                values
                    .extend(colors.flat_map(|[r, g, b, _]| [r, g, b].map(|value| value.to_f32())));
            }
        }
    }
    Ok(([texture.width(), texture.height() * layers], values))
}
