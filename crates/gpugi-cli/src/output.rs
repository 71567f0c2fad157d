//! Output of the commands: images, quantities of surface points, maps, JSON.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::ValueEnum;
use glam::DVec3;
use gpugi::denoise::Features;
use gpugi::gpu::Gpu;
use gpugi::techniques::Map;
use gpugi_scene::Scene;
use gpugi_scene::image::{save_exr, save_exr_layers, save_hdr, save_png};

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

/// What pixels see, as layers of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Aov {
    /// Diffuse albedo plus reflectance at normal incidence.
    Albedo,
    /// Shading normal in world space.
    Normal,
    /// Distance along the view's axis (m).
    Depth,
    /// Position in the file's coordinates (m).
    Position,
    /// Albedo, past ideal mirrors and glass, for denoisers.
    DenoisingAlbedo,
    /// Shading normal, past ideal mirrors and glass, for denoisers.
    DenoisingNormal,
    /// Estimated variance of the radiance; of the path tracer alone.
    Variance,
}

impl Aov {
    /// The one of a name, in which words are separated by - or _.
    pub fn named(name: &str) -> Option<Self> {
        let all = Self::value_variants().iter().copied();
        all.into_iter()
            .find(|aov| aov.identifier() == name.replace('-', "_"))
    }

    /// All names, as identifiers.
    pub fn names() -> impl Iterator<Item = String> {
        Self::value_variants().iter().map(|aov| aov.identifier())
    }

    /// Its name as an identifier of a program.
    pub fn identifier(self) -> String {
        let name = self.to_possible_value().expect("none is hidden");
        name.get_name().replace('-', "_")
    }

    /// Number of its channels.
    pub fn channels(self) -> usize {
        self.layer().1.len()
    }

    /// Its layer's name, as compositors know it, and its channels.
    fn layer(self) -> (&'static str, &'static str) {
        match self {
            Self::Albedo => ("Albedo", "RGB"),
            Self::Normal => ("Normal", "XYZ"),
            Self::Depth => ("Depth", "Z"),
            Self::Position => ("Position", "XYZ"),
            Self::DenoisingAlbedo => ("Denoising Albedo", "RGB"),
            Self::DenoisingNormal => ("Denoising Normal", "XYZ"),
            Self::Variance => ("Variance", "RGB"),
        }
    }

    /// Its value for a pixel: the mean over samples that hit a surface, for denoisers over all samples.
    pub fn value(self, features: &Features, scene: &Scene) -> [f32; 3] {
        let of_hits = |sum: [f32; 3]| sum.map(|sum| sum / features.hits.max(1.0));
        let of_all = |sum: [f32; 3]| sum.map(|sum| sum / features.samples.max(1.0));
        match self {
            Self::Albedo => of_hits(features.albedo),
            Self::Normal => of_hits(features.normal),
            Self::Depth => of_hits([features.depth; 3]),
            Self::Position if features.hits == 0.0 => [0.0; 3],
            Self::Position => {
                let position = DVec3::from(of_hits(features.position).map(f64::from));
                (position + scene.origin).as_vec3().to_array()
            }
            Self::DenoisingAlbedo => of_all(features.followed_albedo),
            Self::DenoisingNormal => of_all(features.followed_normal),
            Self::Variance => [0.0; 3],
        }
    }
}

/// What is seen of a picture beside its radiance.
#[derive(Debug, Default)]
pub struct Seen {
    /// Of each pixel, row by row from the top.
    pub features: Vec<Features>,
    /// Three floats per pixel, if they are known.
    pub variance: Vec<f32>,
}

/// Writes an image and `aovs` as an EXR file with layers. Alpha: the share of samples that hit a surface.
pub fn write_layers(
    path: &Path,
    [width, height]: [u32; 2],
    radiance: &[f32],
    seen: &Seen,
    aovs: &[Aov],
    scene: &Scene,
) -> anyhow::Result<()> {
    let of = |name: &str, channel: char, values: Vec<f32>| {
        (format!("ViewLayer.{name}.{channel}"), values)
    };
    let mut channels = Vec::new();
    for (index, channel) in "RGB".chars().enumerate() {
        let values = radiance.iter().skip(index).step_by(3).copied();
        channels.push(of("Combined", channel, values.collect()));
    }
    let alpha = |features: &Features| features.hits / features.samples.max(1.0);
    let alpha = seen.features.iter().map(alpha).collect();
    channels.push(of("Combined", 'A', alpha));
    for &aov in aovs {
        let (name, of_layer) = aov.layer();
        for (index, channel) in of_layer.chars().enumerate() {
            let values = match aov {
                Aov::Variance => seen
                    .variance
                    .iter()
                    .skip(index)
                    .step_by(3)
                    .copied()
                    .collect(),
                _ => {
                    let features = seen.features.iter();
                    features.map(|seen| aov.value(seen, scene)[index]).collect()
                }
            };
            channels.push(of(name, channel, values));
        }
    }
    save_exr_layers(path, width, height, channels).with_context(|| cannot_write(path))
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
