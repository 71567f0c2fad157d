//! Options of `gpugi bake` for scenes.

use std::path::PathBuf;

use gpugi_arguments::DisplayArguments;
use gpugi_scene::export::Changes;

use super::lights::{Lights, Part};
use crate::Usage;

/// How a file stores light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Mode {
    /// Display values in baseColorTexture, with KHR_materials_unlit
    Unlit,
    /// Radiance in emissiveTexture over black, with KHR_materials_emissive_strength
    Emissive,
    /// Irradiance without albedo in a texture for MOZ_lightmap, and in one .exr per page beside the file
    Lightmap,
}

/// Programs that read lightmaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Reader {
    /// three.js: irradiance
    Three,
    /// Hubs, Ethereal Engine and others of their line: irradiance over pi, in the file as HDR, too
    Hubs,
    /// Bevy: irradiance over pi
    Bevy,
    /// Godot: irradiance over pi
    Godot,
    /// Unity: irradiance over pi
    Unity,
    /// Babylon.js: light that surfaces reflect, which is --bake-mode emissive
    Babylon,
}

/// Units of punctual lights in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LightUnits {
    /// One candela stands for one watt per steradian, as gpugi reads files
    Radiometric,
    /// 683 candelas stand for one watt per steradian
    Photometric,
}

/// Which reflections a file stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Lobes {
    /// Diffuse reflection, which looks the same from everywhere; surfaces without it, such as metals and glass, keep
    /// their materials
    Diffuse,
    /// All reflection, as seen from straight above each texel; highlights and metals do not change with the viewer
    All,
}

/// Options for baking scenes.
#[derive(Debug, Clone, clap::Args)]
pub struct SceneOptions {
    /// Texels per metre, in as many pages as needed (default: as many texels as fit one page)
    #[arg(long, value_name = "N")]
    pub texel_density: Option<f32>,
    /// Width and height of a page (texels; default: 1024, for transfer vectors as many of them as fit the GPU's buffers,
    /// and for panes of light-path-map 256)
    #[arg(long, value_name = "TEXELS")]
    pub atlas_size: Option<u32>,
    /// Minimum number of empty texels between charts
    #[arg(long, value_name = "TEXELS", default_value_t = 2)]
    pub gutter: u32,
    /// How the file stores light
    #[arg(long, value_name = "MODE", default_value = "unlit")]
    pub(super) bake_mode: Mode,
    /// Which program a lightmap is for (docs/bake.md)
    #[arg(long, value_name = "PROGRAM", default_value = "three")]
    pub(super) lightmap_for: Reader,
    /// Leave the lights out of the file, so that programs do not add their light once more (default: true for lightmaps that
    /// hold direct light, else false)
    #[arg(long, value_name = "true|false", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub(super) drop_baked_lights: Option<bool>,
    /// Units of the lights in the file: 1 W/sr as 1 cd, as gpugi reads it, or as 683 cd, as Blender does
    #[arg(long, value_name = "UNITS", default_value = "radiometric")]
    pub(super) light_units: LightUnits,
    /// Decode geometry that meshoptimizer or Draco has compressed, for programs without their decoders
    #[arg(long)]
    pub(super) decompress: bool,
    /// Leave out of the file what nothing shows any more, such as images of replaced materials (default: true for unlit bakes,
    /// else false)
    #[arg(long, value_name = "true|false", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub(super) prune: Option<bool>,
    /// Which reflections unlit and emissive bakes store
    #[arg(long, value_name = "LOBES", default_value = "diffuse")]
    pub(super) lobes: Lobes,
    /// Parts of light, separated by commas (default: both, unless techniques are given)
    #[arg(long, value_name = "PART,...", value_delimiter = ',')]
    pub(super) include: Vec<Part>,
    /// Samples per texel (default: 16; 128 where paths find the light, as they do on most adapters unless a technique is named)
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub(super) samples: Option<u32>,
    /// Filter the noise of path-tracing out of the texels (docs/denoising.md); always on where paths find the light unasked
    #[arg(long)]
    pub denoise: bool,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u32,
    /// How a file stores transfer vectors (radiance-transfer)
    #[arg(long, value_name = "FORMAT", default_value = "half")]
    pub transfer_format: super::precomputed::Format,
    #[command(flatten)]
    pub(super) display: DisplayArguments,
    /// GPU memory for the texels lit at once (MiB); scene and maps take more
    #[arg(long, value_name = "MIB", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) memory: u32,
    /// Resume a stopped bake from FILE.glb.checkpoint, or start it if there is none
    #[arg(long)]
    pub resume: bool,
    /// Write every technique's maps, and images of the texels inside geometry, into this folder
    #[arg(long, value_name = "DIR")]
    pub(super) dump_maps: Option<PathBuf>,
}

impl SceneOptions {
    /// Those of words as on the command line.
    ///
    /// # Errors
    /// [`Usage`].
    pub fn of_words(words: &[String]) -> anyhow::Result<Self> {
        #[derive(clap::Parser)]
        #[command(no_binary_name = true)]
        struct Line {
            #[command(flatten)]
            options: SceneOptions,
        }
        let line = <Line as clap::Parser>::try_parse_from(words).map_err(|error| {
            let message = error.to_string();
            let first = message.lines().next().unwrap_or_default();
            Usage(first.trim_start_matches("error: ").to_owned())
        })?;
        Ok(line.options)
    }

    /// Width and height of a page (texels).
    pub fn page_size(&self) -> u32 {
        self.atlas_size.unwrap_or(1024)
    }

    /// What they change of the file. `lights`: those that are baked, if light is.
    pub(super) fn changes(&self, lights: Option<&Lights>) -> Changes {
        let is_lightmap = self.bake_mode == Mode::Lightmap;
        let holds_direct = lights.is_some_and(Lights::hold_direct);
        let is_unlit = self.bake_mode == Mode::Unlit;
        let has_light = lights.is_some_and(|lights| !lights.names.is_empty());
        Changes {
            drops_lights: (self.drop_baked_lights).unwrap_or(is_lightmap && holds_direct),
            photometric: self.light_units == LightUnits::Photometric,
            unpacks: self.decompress,
            prunes: self.prune.unwrap_or(is_unlit && has_light),
        }
    }

    /// Those that decide the result.
    pub fn of_result(&self) -> Self {
        Self {
            resume: false,
            dump_maps: None,
            ..self.clone()
        }
    }
}
