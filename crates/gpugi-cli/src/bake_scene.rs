//! `gpugi bake` of scenes: light into the texels of an atlas, and a .glb that shows it.

use std::path::{Path, PathBuf};

use anyhow::Context;
use glam::Vec3;
use gpugi::Renderer;
use gpugi::bake::{self, Bake, Quantity};
use gpugi::capture::atlas::LeakReport;
use gpugi::display::Display;
use gpugi::gpu::Gpu;
use gpugi::techniques::obscurances::{self, ObscurancePage};
use gpugi::techniques::{caustics, image_based_lighting, radiosity, shadow_map};
use gpugi_scene::export::{BakedLight, BakedPage, Original, export_bake};
use gpugi_scene::image::{replace_file, save_exr};
use gpugi_scene::{
    AlphaMode, Atlas, AtlasError, AtlasOptions, FileResolver, Limits, Scene, TexelDensity,
};

use crate::bake::has_extension;
use crate::progress::Progress;
use crate::render::{apply_settings, display_settings, print_notes, split_settings, usage};
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, interrupt};

/// Techniques that light what is diffuse, straight from lights.
const DIRECT: [&str; 3] = [
    shadow_map::INFO.name,
    image_based_lighting::INFO.name,
    caustics::INFO.name,
];
/// By way of diffuse surfaces.
const INDIRECT: &str = radiosity::INFO.name;
/// What is no light, but how much of it arrives.
const FACTOR: &str = obscurances::INFO.name;

/// Parts of light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    /// Straight from lights, and what mirrors and glass throw
    Direct,
    /// By way of diffuse surfaces: radiosity
    Indirect,
}

/// In which form a file holds light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Mode {
    /// What a display shows, in baseColorTexture, with KHR_materials_unlit
    Unlit,
    /// Radiance, in emissiveTexture, with KHR_materials_emissive_strength, over black
    Emissive,
    /// Irradiance without albedo, named in extras, with an .exr a page beside the file
    Lightmap,
}

/// Options of bakes of scenes.
#[derive(Debug, clap::Args)]
pub struct SceneOptions {
    /// Texels per metre, in as many pages as it takes; as many as fit one page when not given
    #[arg(long, value_name = "N")]
    texel_density: Option<f32>,
    /// Side of a page (texels)
    #[arg(long, value_name = "TEXELS", default_value_t = 1024)]
    atlas_size: u32,
    /// Empty texels between charts, at least
    #[arg(long, value_name = "TEXELS", default_value_t = 2)]
    gutter: u32,
    /// In which form the file holds light
    #[arg(long, value_name = "MODE", default_value = "unlit")]
    bake_mode: Mode,
    /// Parts of light, separated by commas; both when neither they nor techniques are named
    #[arg(long, value_name = "PART,...", value_delimiter = ',')]
    include: Vec<Part>,
    /// Samples a texel
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: u32,
    /// Seed of all that is stochastic
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Exposure of unlit bakes in EV (0 shows radiance 1 as 1), or auto
    #[arg(
        long,
        value_name = "EV|auto",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    exposure: String,
    /// Tone mapping of unlit bakes: none, reinhard, aces, agx, neutral
    #[arg(long, value_name = "NAME")]
    tone_map: Option<String>,
}

/// Bakes and writes: the file complete or not at all.
pub fn run(
    common: &Common,
    arguments: &SceneArguments,
    output: &Path,
    techniques: &[String],
    settings: &[String],
    options: &SceneOptions,
) -> anyhow::Result<()> {
    let started = std::time::Instant::now();
    if !has_extension(output, &["glb"]) {
        return Err(Usage(format!(
            "-o {}: scenes are baked into .glb files",
            output.display()
        ))
        .into());
    }
    crate::output::check_folders([output])?;
    let display = display_settings(&options.exposure, options.tone_map.as_deref())?;
    let is_known = |name: &str| DIRECT.contains(&name) || name == INDIRECT || name == FACTOR;
    if let Some(name) = techniques.iter().find(|name| !is_known(name)) {
        return Err(Usage(format!(
            "--technique {name}: baked into texels are {}, {INDIRECT}, {FACTOR}",
            DIRECT.join(", ")
        ))
        .into());
    }
    let (scene, mut notes) = scene_argument::load(arguments)?;
    let gpu = Gpu::open(&common.adapter)?;
    interrupt::catch();
    let mut progress = Progress::new(common.quiet);
    let mut atlas = unwrap(&scene, options, &mut progress)?;
    if options.bake_mode == Mode::Emissive {
        // Eight bits for a lamp and its light would leave few to the light: what shines goes on shining as it did.
        for (instance, place) in scene.instances.iter().zip(&mut atlas.instances) {
            if scene.materials[instance.material].emissive != Vec3::ZERO {
                *place = None;
            }
        }
    }
    let (of_factor, of_light): (Vec<&String>, Vec<&String>) = settings
        .iter()
        .partition(|one| one.starts_with(&format!("{FACTOR}.")));
    let mut pages = vec![BakedPage::default(); atlas.pages as usize];
    if techniques.iter().any(|name| name == FACTOR) {
        let found = factor(&gpu, &scene, &atlas, &of_factor, &mut progress)?;
        for (page, found) in pages.iter_mut().zip(found) {
            page.obscurance = Some(found.obscurance);
            page.colored_obscurance = found.colored;
        }
    } else if let Some(setting) = of_factor.first() {
        return Err(Usage(format!("--set {setting}: {FACTOR} is not in use")).into());
    }
    let lights = Lights::new(&gpu, &scene, techniques, &options.include)?;
    if !lights.names.is_empty() {
        let of_light: Vec<String> = of_light.into_iter().cloned().collect();
        let quantity = match options.bake_mode {
            Mode::Unlit | Mode::Emissive => Quantity::Diffuse,
            Mode::Lightmap => Quantity::White,
        };
        let mut bake = Bake::new(&gpu, &scene, &atlas, &lights.names, quantity).map_err(usage)?;
        apply_settings(bake.renderer(), &of_light)?;
        bake.renderer().set_seed(options.seed);
        let left_out = bake.renderer().left_out();
        if !left_out.is_empty() {
            notes.push(format!("not in this bake: {}", left_out.join("; ")));
        }
        notes.extend(alpha_is_lost(&scene, options.bake_mode));
        light(&gpu, &mut bake, &lights, options.samples, &mut progress)
            .with_context(|| format!("{} is not written", output.display()))?;
        notes.extend(moved(&bake.leaks()?));
        let images = bake.finish()?;
        for (number, (page, image)) in pages.iter_mut().zip(images).enumerate() {
            page.light = Some(match options.bake_mode {
                Mode::Unlit => {
                    let floats: Vec<f32> =
                        image.iter().flat_map(|texel| texel.to_array()).collect();
                    let pixels = Display::picture(&gpu, &floats, &display)?;
                    BakedLight::Unlit(bytemuck::cast_slice(&pixels).to_vec())
                }
                Mode::Emissive => BakedLight::Emissive(image),
                Mode::Lightmap => lightmap(image, atlas.size, output, number)?,
            });
        }
    }
    let warnings = write(&scene, &arguments.scene, &atlas, &pages, output)?;
    notes.extend(warnings);
    print_notes(common, &notes);
    if !common.quiet {
        println!(
            "{}: {} pages of {}x{} texels, {} samples, {:.2} s on {}",
            output.display(),
            atlas.pages,
            atlas.size,
            atlas.size,
            options.samples,
            started.elapsed().as_secs_f64(),
            gpu.adapter.name
        );
    }
    Ok(())
}

fn unwrap(scene: &Scene, options: &SceneOptions, progress: &mut Progress) -> anyhow::Result<Atlas> {
    let layout = AtlasOptions {
        size: options.atlas_size,
        density: match options.texel_density {
            Some(density) => TexelDensity::PerMetre(density),
            None => TexelDensity::OnePage,
        },
        gutter: options.gutter,
        ..AtlasOptions::default()
    };
    progress.show(0.0, "unwrapping");
    Atlas::with_progress(scene, &layout, |_| !interrupt::asked()).map_err(|error| match error {
        AtlasError::Option { .. } | AtlasError::TooManyPages { .. } => {
            Usage(error.to_string()).into()
        }
        error => error.into(),
    })
}

/// What became of texels that lie inside things.
fn moved(leaks: &LeakReport) -> Option<String> {
    let all = leaks.moved + leaks.invalid;
    (all > 0).then(|| {
        format!(
            "{all} texels lay inside something: {} were moved out, {} took their neighbours' light",
            leaks.moved, leaks.invalid
        )
    })
}

/// Irradiance from that over pi, also written beside the output.
fn lightmap(image: Vec<Vec3>, size: u32, output: &Path, page: usize) -> anyhow::Result<BakedLight> {
    let texels = image.into_iter().map(|texel| texel * std::f32::consts::PI);
    let irradiance: Vec<Vec3> = texels.collect();
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let exr = format!("{stem}-{page}.exr");
    let floats = bytemuck::cast_slice(&irradiance);
    save_exr(&output.with_file_name(&exr), size, size, floats).context("cannot be written")?;
    Ok(BakedLight::Lightmap { irradiance, exr })
}

/// Obscurances.
fn factor(
    gpu: &Gpu,
    scene: &Scene,
    atlas: &Atlas,
    options: &[&String],
    progress: &mut Progress,
) -> anyhow::Result<Vec<ObscurancePage>> {
    let mut settings = obscurances::Settings::default();
    for option in options {
        for [technique, key, value] in split_settings(std::slice::from_ref(*option))? {
            settings
                .set(key, value)
                .map_err(|error| Usage(format!("--set {technique}.{error}")))?;
        }
    }
    let found = bake::obscurances(gpu, scene, atlas, &settings, |done| {
        progress.show(f64::from(done), FACTOR);
        !is_interrupted(gpu)
    })?;
    found.context("interrupted: nothing is written")
}

/// Waits, so that bars tell the truth, the queue stays short and Ctrl-C is heard.
fn is_interrupted(gpu: &Gpu) -> bool {
    let wait = gpugi::gpu::PollType::wait_indefinitely();
    gpu.device.poll(wait).ok();
    interrupt::asked()
}

/// Lights all texels.
fn light(
    gpu: &Gpu,
    bake: &mut Bake,
    lights: &Lights,
    samples: u32,
    progress: &mut Progress,
) -> anyhow::Result<()> {
    let mut before = -1.0;
    loop {
        let done = bake.refine()?;
        progress.show(f64::from(done), "maps");
        anyhow::ensure!(!is_interrupted(gpu), "interrupted");
        if done >= 1.0 || done <= before {
            break;
        }
        before = done;
    }
    for sample in 1..=samples {
        bake.sample(|name| lights.adds(name))?;
        progress.show(
            f64::from(sample) / f64::from(samples),
            &format!("{sample} of {samples} samples"),
        );
        anyhow::ensure!(!is_interrupted(gpu), "interrupted");
    }
    progress.finish();
    Ok(())
}

/// The techniques that light texels.
struct Lights {
    names: Vec<String>,
    /// Whether direct light is only there for what it becomes.
    only_indirect: bool,
}

impl Lights {
    /// Those named and those that `parts` need: all, when there are neither.
    fn new(gpu: &Gpu, scene: &Scene, named: &[String], parts: &[Part]) -> anyhow::Result<Self> {
        let mut names: Vec<String> = named.to_vec();
        names.retain(|name| name != FACTOR);
        let all = [Part::Direct, Part::Indirect];
        let parts = if named.is_empty() && parts.is_empty() {
            &all
        } else {
            parts
        };
        let only_indirect = names.is_empty() && parts == [Part::Indirect];
        if !parts.is_empty() {
            let best = Renderer::new(gpu, scene, [1, 1], &[]).map_err(usage)?;
            let best = best.techniques().iter().map(|one| one.info().name);
            names.extend(best.filter(|name| DIRECT.contains(name)).map(str::to_owned));
        }
        if parts.contains(&Part::Indirect) {
            names.push(INDIRECT.to_owned());
        }
        Ok(Self {
            names,
            only_indirect,
        })
    }

    fn adds(&self, name: &str) -> bool {
        !(self.only_indirect && DIRECT.contains(&name))
    }
}

/// What unlit and black materials lose.
fn alpha_is_lost(scene: &Scene, mode: Mode) -> Option<String> {
    let has_alpha = scene
        .materials
        .iter()
        .any(|material| material.alpha_mode != AlphaMode::Opaque);
    (mode == Mode::Unlit && has_alpha)
        .then(|| "unlit bakes are opaque: alpha is not kept".to_owned())
}

/// Writes the file; returns what it could not keep.
fn write(
    scene: &Scene,
    name: &str,
    atlas: &Atlas,
    pages: &[BakedPage],
    output: &Path,
) -> anyhow::Result<Vec<String>> {
    let limits = Limits::default();
    let path = PathBuf::from(name);
    let exported = if has_extension(&path, &["gltf", "glb"]) {
        let bytes = std::fs::read(&path).with_context(|| format!("{name}: cannot be read"))?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let original = Original {
            name,
            bytes: &bytes,
            resolver: &FileResolver::new(folder, limits),
            limits,
        };
        export_bake(Some(original), scene, atlas, pages)?
    } else {
        export_bake(None, scene, atlas, pages)?
    };
    replace_file(output, |file| {
        std::io::Write::write_all(file, &exported.glb)
    })
    .context("cannot be written")?;
    Ok(exported.warnings)
}
