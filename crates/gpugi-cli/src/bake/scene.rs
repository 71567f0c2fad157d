//! `gpugi bake` for scenes: bakes light into the texels of an atlas, and writes a .glb that shows it.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use glam::Vec3;
use gpugi::bake::{Bake, Leaks, LightBake, LightOptions, ObscuranceBake, Quantity, Stage};
use gpugi::capture::atlas::LeakReport;
use gpugi::gpu::Gpu;
use gpugi::picture::{self, Effects};
use gpugi::settings::SettingSet;
use gpugi::techniques::Role;
use gpugi::techniques::obscurances::{self, ObscurancePage};
use gpugi_arguments::split_settings;
use gpugi_scene::export::{
    BakedLight, BakedPage, Changes, ExportError, Exported, LightmapQuantity, Original, export_bake,
};
use gpugi_scene::image::{replace_file, save_exr, save_png};
use gpugi_scene::{Atlas, Scene, read_file};

use super::has_extension;
use super::lights::{self, Lights};
use super::options::{Lobes, Mode, Reader, SceneOptions};
use super::work::{Work, begin};
use crate::output::make_folder;
use crate::progress::Progress;
use crate::render::{print_notes, usage};
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, interrupt};

/// Samples per texel, and where paths find the light unasked.
const SAMPLES: u32 = 16;
const TRACED_SAMPLES: u32 = 128;

/// A scene to bake.
pub struct Subject<'a> {
    /// The scene.
    pub scene: Scene,
    /// What loading it had to say.
    pub notes: Vec<String>,
    /// What it was loaded with; `None` if it is as no file has it.
    pub source: Option<&'a SceneArguments>,
    /// The file of the program that runs: another program does not go on with what it has begun.
    pub program: PathBuf,
}

/// What to bake: techniques, `--set` options, and the rest.
pub type Order<'a> = (&'a [String], &'a [String], &'a SceneOptions);

/// A bake that is done.
pub struct Baked {
    /// Number of pages, and their width and height (texels).
    pub pages: [u32; 2],
    /// What is to be known of it, one sentence each.
    pub notes: Vec<String>,
    /// Duration of each part, in words.
    pub times: Vec<String>,
}

/// Bakes and writes the file, completely or not at all.
pub fn run(
    common: &Common,
    arguments: &SceneArguments,
    output: &Path,
    order: Order<'_>,
) -> anyhow::Result<()> {
    let started = Instant::now();
    check(output, order)?;
    let (scene, notes) = scene_argument::load(arguments)?;
    let gpu = Gpu::open(&common.adapter)?;
    interrupt::catch();
    let subject = Subject {
        scene,
        notes,
        source: Some(arguments),
        program: std::env::current_exe()?,
    };
    let baked = bake(&gpu, subject, output, order, Progress::new(common.quiet))?;
    print_notes(common, &baked.notes);
    if !common.quiet {
        let [pages, size] = baked.pages;
        println!(
            "{}: {} of {size}x{size} texels, {:.2} s on {} ({})",
            output.display(),
            match pages {
                1 => "1 page".to_owned(),
                pages => format!("{pages} pages"),
            },
            started.elapsed().as_secs_f64(),
            gpu.adapter.name,
            baked.times.join(", ")
        );
    }
    Ok(())
}

/// Refuses what makes no sense, before anything is loaded.
pub(super) fn check(output: &Path, (techniques, _, options): Order<'_>) -> anyhow::Result<()> {
    if !has_extension(output, &["glb"]) {
        return Err(Usage(format!(
            "-o {}: scenes are baked into .glb files",
            output.display()
        ))
        .into());
    }
    crate::output::check_folders([output])?;
    if (options.bake_mode, options.lobes) == (Mode::Lightmap, Lobes::All) {
        let message = "--lobes all: a lightmap holds what arrives, not what is reflected";
        return Err(Usage(message.into()).into());
    }
    if options.bake_mode != Mode::Lightmap && options.lightmap_for != Reader::Three {
        let message = "--lightmap-for: needs --bake-mode lightmap";
        return Err(Usage(message.into()).into());
    }
    if options.lightmap_for == Reader::Babylon {
        let message = "--lightmap-for babylon: Babylon.js expects reflected light in lightmaps; \
                       use --bake-mode emissive";
        return Err(Usage(message.into()).into());
    }
    if options.denoise && options.samples == Some(1) {
        let message = "--denoise: one sample does not tell its noise";
        return Err(Usage(message.into()).into());
    }
    Ok(lights::check(techniques)?)
}

/// Refuses a filter where there is no noise.
pub(super) fn check_denoise(options: &SceneOptions, lights: &Lights) -> anyhow::Result<()> {
    let is_noisy = |name: &String| lights::noisy().contains(&&**name);
    if options.denoise && !lights.names.iter().any(is_noisy) {
        let noisy = lights::noisy().join(", ");
        let message = format!("--denoise: filters the noise of {noisy}, which is not baked");
        return Err(Usage(message).into());
    }
    Ok(())
}

/// Bakes a scene and writes the file, completely or not at all.
pub fn bake<'a>(
    gpu: &'a Gpu,
    subject: Subject<'_>,
    output: &Path,
    order: Order<'_>,
    progress: Progress<'a>,
) -> anyhow::Result<Baked> {
    check(output, order)?;
    let (techniques, settings, options) = order;
    let (effects, settings) = (options.display).effects(Effects::default(), settings)?;
    let Subject {
        scene: original,
        mut notes,
        source,
        program,
    } = subject;
    let (scene, turned) = original.with_lit_fronts();
    let lights = Lights::new(gpu, &scene, techniques, &options.include, &settings);
    check_denoise(options, &lights)?;
    let mut work = begin(
        progress,
        gpu,
        [output, &program],
        &scene,
        (techniques, &settings, options),
    )?;
    let mut atlas = work.done.atlas.clone();
    notes.extend(too_thin(atlas.slivers(&scene)));
    if !lights.names.is_empty() {
        leave_out(&scene, &mut atlas, options.bake_mode, options.lobes);
    }
    if atlas.sides().next().is_none() {
        atlas.pages = 0;
        notes.push(nothing_to_bake(&scene, options).to_owned());
    }
    let is_factor = |name: &str| lights::role_of(name) == Some(Role::Factor);
    let technique_of = |setting: &str| setting.split('.').next().unwrap_or_default().to_owned();
    let (of_factor, of_light): (Vec<&String>, Vec<&String>) = settings
        .iter()
        .partition(|setting| is_factor(&technique_of(setting)));
    let mut leaks = None;
    let mut pages = vec![BakedPage::default(); atlas.pages as usize];
    if techniques.iter().any(|name| is_factor(name)) {
        let (found, of_factor) = factor(&scene, &atlas, &of_factor, &mut work)?;
        leaks = Some(of_factor);
        for (page, found) in pages.iter_mut().zip(found) {
            page.obscurance = Some(found.obscurance);
            page.colored_obscurance = found.colored;
        }
    } else if let Some(setting) = of_factor.first() {
        let technique = technique_of(setting);
        return Err(Usage(format!("--set {setting}: {technique} is not in use")).into());
    }
    if !lights.names.is_empty() {
        let of_light: Vec<String> = of_light.into_iter().cloned().collect();
        let mut bake = light_bake(gpu, &scene, &atlas, &lights, &of_light, options)?;
        notes.extend(notes_of(&bake, options));
        work.timed("setup");
        light(&mut bake, &mut work)?;
        if let Some(folder) = &options.dump_maps {
            crate::output::dump_maps(gpu, &bake.lighting().maps(), folder)?;
        }
        let lit = bake.finish();
        leaks = Some(lit.leaks);
        let light = light_of_pages(
            gpu,
            (&scene, &atlas),
            lit.pages,
            (options, &effects),
            output,
        )?;
        for (page, light) in pages.iter_mut().zip(light) {
            page.light = Some(light);
        }
    }
    if let Some(leaks) = leaks {
        notes.extend(moved(&leaks.report));
        if let Some(folder) = &options.dump_maps {
            dump_leaks(&leaks, atlas.size, folder)?;
        }
    }
    let changes = options.changes(Some(&lights));
    notes.extend(dropped(&changes, &scene).map(str::to_owned));
    let warnings = write(source, output, |file| {
        export_bake(file, &original, &atlas.clone().turned(&turned), &pages)?.changed(&changes)
    })?;
    notes.extend(warnings);
    work.timed("writing");
    work.forget();
    let mut of_work = work.progress.notes();
    of_work.extend(notes);
    Ok(Baked {
        pages: [atlas.pages, atlas.size],
        notes: of_work,
        times: work.times,
    })
}

/// The bake of the light of an atlas, before its first step.
pub(super) fn light_bake(
    gpu: &Gpu,
    scene: &Scene,
    atlas: &Atlas,
    lights: &Lights,
    settings: &[String],
    options: &SceneOptions,
) -> anyhow::Result<LightBake> {
    let light_options = LightOptions {
        quantity: match (options.bake_mode, options.lobes) {
            (Mode::Lightmap, _) => Quantity::Irradiance,
            (_, Lobes::Diffuse) => Quantity::Diffuse,
            (_, Lobes::All) => Quantity::All,
        },
        samples: options.samples.unwrap_or(match lights.is_traced {
            true => TRACED_SAMPLES,
            false => SAMPLES,
        }),
        seed: options.seed,
        denoises: options.denoise || lights.is_traced,
        memory: u64::from(options.memory) << 20,
        ..LightOptions::default()
    };
    let bake = LightBake::new(gpu, scene, atlas, &lights.names, &light_options);
    let mut bake = bake.map_err(usage)?;
    for [technique, key, value] in split_settings(settings)? {
        bake.set(technique, key, value).map_err(usage)?;
    }
    if lights.only_indirect {
        bake.leave_out(&lights::direct());
    }
    Ok(bake)
}

/// What is to be known of a bake of light.
pub(super) fn notes_of(bake: &LightBake, options: &SceneOptions) -> Vec<String> {
    let mut notes = Vec::new();
    if bake.tiles() > 1 {
        let (tiles, memory) = (bake.tiles(), options.memory);
        notes.push(format!("lit in {tiles} tiles of {memory} MiB"));
    }
    let left_out = bake.lighting().left_out(bake.scene());
    if !left_out.is_empty() {
        notes.push(format!("not in this bake: {}", left_out.join("; ")));
    }
    notes
}

/// Pages of light as files store them; those of lightmaps are also written beside the output.
pub(super) fn light_of_pages(
    gpu: &Gpu,
    (scene, atlas): (&Scene, &Atlas),
    pages: Vec<Vec<Vec3>>,
    (options, effects): (&SceneOptions, &Effects),
    output: &Path,
) -> anyhow::Result<Vec<BakedLight>> {
    match options.bake_mode {
        Mode::Unlit => {
            let alpha = gpugi::capture::atlas::alpha(gpu, scene, atlas)?;
            unlit(gpu, &pages, alpha.as_deref(), effects)
        }
        Mode::Emissive => Ok(pages.into_iter().map(BakedLight::Emissive).collect()),
        Mode::Lightmap => lightmaps(pages, atlas.size, output, options.lightmap_for),
    }
}

/// Removes the instances that keep their materials from an atlas.
pub(super) fn leave_out(scene: &Scene, atlas: &mut Atlas, mode: Mode, lobes: Lobes) {
    for (instance, place) in scene.instances.iter().zip(&mut atlas.instances) {
        let material = &scene.materials[instance.material];
        let shines = material.emissive != Vec3::ZERO;
        let keeps = match mode {
            // In 8 bits, a lamp's own emission would leave few steps for the light on it. So emitters keep their
            // material.
            Mode::Emissive if shines => true,
            // Mirrors and glass would bake to black.
            Mode::Unlit | Mode::Emissive => {
                lobes == Lobes::Diffuse && !shines && !material.has_diffuse()
            }
            Mode::Lightmap => false,
        };
        if keeps {
            *place = None;
        }
    }
}

/// Why no surface is baked.
pub(super) fn nothing_to_bake(scene: &Scene, options: &SceneOptions) -> &'static str {
    if scene.bounds().is_empty() {
        return "there is nothing to bake: the scene has no surfaces";
    }
    match (options.bake_mode, options.lobes) {
        (Mode::Emissive, Lobes::All) => {
            "nothing is baked: all surfaces emit light, and such keep their materials"
        }
        (Mode::Emissive, Lobes::Diffuse) => {
            "nothing is baked: all surfaces keep their materials, as metal, glass and what emits light do (--lobes all bakes metal and glass)"
        }
        (Mode::Unlit, Lobes::Diffuse) => {
            "nothing is baked: all surfaces keep their materials, as metal and glass do (--lobes all bakes them)"
        }
        (Mode::Unlit, Lobes::All) | (Mode::Lightmap, _) => {
            "there is nothing to bake: no surface has an area"
        }
    }
}

/// Writes images of texels inside geometry to `leaks-PAGE.png`: grey good, green moved out, red invalid.
fn dump_leaks(leaks: &Leaks, size: u32, folder: &Path) -> anyhow::Result<()> {
    make_folder(folder)?;
    for (number, map) in leaks.maps.iter().enumerate() {
        let path = folder.join(format!("leaks-{number}.png"));
        save_png(&path, size, size, map.as_flattened())
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

/// A note on lights that the file of a scene does not have.
pub(super) fn dropped(changes: &Changes, scene: &Scene) -> Option<&'static str> {
    (changes.drops_lights && !scene.lights.is_empty()).then_some(
        "the lights are dropped, because their light is baked; --drop-baked-lights=false keeps them",
    )
}

/// A note on triangles without texels of their own.
pub fn too_thin(slivers: usize) -> Option<String> {
    (slivers > 0).then(|| {
        format!(
            "{slivers} triangles are too thin for texels of their own: they show their neighbours' light, or none"
        )
    })
}

/// A note on what happened to texels inside geometry.
pub(super) fn moved(leaks: &LeakReport) -> Option<String> {
    let all = leaks.moved + leaks.invalid;
    (all > 0).then(|| {
        format!(
            "{all} texels lay inside something: {} were moved out, {} took their neighbours' light",
            leaks.moved, leaks.invalid
        )
    })
}

/// Display values, all pages at one exposure. `alpha` is that of all texels; 1 if not given.
fn unlit(
    gpu: &Gpu,
    pages: &[Vec<Vec3>],
    alpha: Option<&[f32]>,
    effects: &Effects,
) -> anyhow::Result<Vec<BakedLight>> {
    let mut floats: Vec<f32> = pages.iter().flatten().flat_map(Vec3::to_array).collect();
    // About as wide as high: one page below the other could be too high for a texture. Black is not exposed for.
    let texels = floats.len() / 3;
    let width = (texels as f64).sqrt().ceil() as usize;
    let height = texels.div_ceil(width.max(1));
    floats.resize(3 * width * height, 0.0);
    let size = [width, height].map(|side| side as u32);
    let mut pixels = picture::developed(gpu, size, &floats, effects)?;
    let (pixels, _) = pixels.as_chunks_mut::<4>();
    for (pixel, alpha) in pixels.iter_mut().zip(alpha.into_iter().flatten()) {
        pixel[3] = (alpha * 255.0).round() as u8;
    }
    let mut pixels = pixels.iter().copied();
    let of_page = |page: &Vec<Vec3>| BakedLight::Unlit(pixels.by_ref().take(page.len()).collect());
    Ok(pages.iter().map(of_page).collect())
}

/// Converts pages of irradiance over pi to what a program reads, and also writes them beside the output.
fn lightmaps(
    pages: Vec<Vec<Vec3>>,
    size: u32,
    output: &Path,
    reader: Reader,
) -> anyhow::Result<Vec<BakedLight>> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let (quantity, factor) = match reader {
        Reader::Three => (LightmapQuantity::Irradiance, std::f32::consts::PI),
        _ => (LightmapQuantity::IrradianceOverPi, 1.0),
    };
    let lightmap = |(number, page): (usize, Vec<Vec3>)| {
        let texels: Vec<Vec3> = page.into_iter().map(|texel| texel * factor).collect();
        let file = format!("{stem}-{number}.exr");
        let floats = bytemuck::cast_slice(&texels);
        save_exr(&output.with_file_name(&file), size, size, floats).context("cannot be written")?;
        Ok(BakedLight::Lightmap {
            texels,
            quantity,
            with_hdr: reader == Reader::Hubs,
            file,
        })
    };
    pages.into_iter().enumerate().map(lightmap).collect()
}

/// Bakes obscurances.
fn factor(
    scene: &Scene,
    atlas: &Atlas,
    options: &[&String],
    work: &mut Work<'_>,
) -> anyhow::Result<(Vec<ObscurancePage>, Leaks)> {
    let mut settings = obscurances::Settings::default();
    for option in options {
        for [technique, key, value] in split_settings(std::slice::from_ref(*option))? {
            settings
                .set(key, value)
                .map_err(|error| Usage(format!("--set {technique}.{error}")))?;
        }
    }
    let mut bake = ObscuranceBake::new(work.gpu, scene, atlas, &settings, u32::MAX)?;
    work.timed("setup");
    if let Some(saved) = work.done.obscurances.take() {
        bake.resume(&saved)?;
        work.done.obscurances = Some(saved);
    }
    while let Some(at) = bake.step()? {
        work.progress
            .show(f64::from(at.done), obscurances::INFO.name);
        work.after_step(|checkpoint| {
            checkpoint.obscurances = Some(bake.save()?);
            Ok(())
        })?;
    }
    work.timed(obscurances::INFO.name);
    // Save the result, so that a bake that is stopped later need not repeat this.
    work.done.obscurances = Some(bake.save()?);
    Ok((bake.pages()?, bake.leaks()?))
}

/// Lights all texels.
fn light(bake: &mut LightBake, work: &mut Work<'_>) -> anyhow::Result<()> {
    if let Some(saved) = work.done.light.take() {
        bake.resume(saved)?;
    }
    while let Some(at) = bake.step()? {
        let what = match at.stage {
            Stage::Maps => "maps",
            Stage::Samples => "texels",
        };
        work.progress.show(f64::from(at.done), what);
        work.after_step(|checkpoint| {
            checkpoint.light = Some(bake.save()?);
            Ok(())
        })?;
        if at.stage != bake.stage() {
            work.timed(what);
        }
    }
    work.timed("texels");
    work.progress.finish();
    Ok(())
}

/// Writes what `export` makes of the original file, if there is one; returns warnings about what could not be preserved.
pub fn write(
    source: Option<&SceneArguments>,
    output: &Path,
    export: impl FnOnce(Option<Original>) -> Result<Exported, ExportError>,
) -> anyhow::Result<Vec<String>> {
    let is_gltf =
        |source: &&SceneArguments| has_extension(Path::new(&source.scene), &["gltf", "glb"]);
    let exported = match source.filter(is_gltf) {
        Some(source) => {
            let name = &source.scene;
            let limits = source.limits()?;
            let bytes = read_file(Path::new(name), &limits)?;
            export(Some(Original {
                name,
                bytes: &bytes,
                resolver: &source.resolver()?,
                limits,
            }))?
        }
        None => export(None)?,
    };
    replace_file(output, |file| {
        std::io::Write::write_all(file, &exported.glb)
    })
    .context("cannot be written")?;
    Ok(exported.warnings)
}

#[cfg(test)]
mod tests {
    use gpugi_scene::AtlasOptions;

    use super::*;

    #[test]
    fn lamps_mirrors_and_glass_keep_their_materials() {
        let scene = gpugi_scene::builtin::builtin("glass-room", 1).expect("a scene");
        let whole = Atlas::new(&scene, &AtlasOptions::default()).expect("an atlas");
        let left_out = |mode, lobes| {
            let mut atlas = whole.clone();
            leave_out(&scene, &mut atlas, mode, lobes);
            let places = scene.instances.iter().zip(&atlas.instances);
            let out = places.filter(|(_, place)| place.is_none());
            out.map(|(instance, _)| instance.name.clone())
                .collect::<Vec<_>>()
        };
        let [unlit, emissive] =
            [Mode::Unlit, Mode::Emissive].map(|mode| left_out(mode, Lobes::Diffuse));
        println!("{unlit:?} {emissive:?}");
        assert!(unlit.iter().any(|name| name.contains("teapot")) && unlit.len() >= 3);
        assert!(unlit.len() < emissive.len() && emissive.len() < scene.instances.len());
        assert!(left_out(Mode::Unlit, Lobes::All).is_empty());
        assert!(left_out(Mode::Lightmap, Lobes::Diffuse).is_empty());
    }

    #[test]
    fn files_keep_what_programs_need() {
        let changes = |words: &[&str], names: &[&str], only_indirect| {
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            let options = SceneOptions::of_words(&words).expect("options");
            options.changes(Some(&Lights {
                names: names.iter().map(|name| (*name).to_owned()).collect(),
                only_indirect,
                is_traced: false,
            }))
        };
        let all = ["caustics", "path-tracing"];
        let lightmap = ["--bake-mode", "lightmap"];
        let of_unlit = changes(&[], &all, false);
        assert!(of_unlit.prunes && !of_unlit.drops_lights);
        let of_lightmap = changes(&lightmap, &all, false);
        assert!(!of_lightmap.prunes && of_lightmap.drops_lights);
        // The lights are not baked, or only what they shine on first.
        assert!(!changes(&lightmap, &["radiosity"], false).drops_lights);
        assert!(!changes(&lightmap, &["shadow-map", "radiosity"], true).drops_lights);
        // Materials stay, with obscurance.
        assert!(!changes(&[], &[], false).prunes);
        let asked = [
            "--prune=false",
            "--drop-baked-lights",
            "--light-units=photometric",
        ];
        let asked = changes(&asked, &all, false);
        assert!(!asked.prunes && asked.drops_lights && asked.photometric);
    }

    #[test]
    fn pages_have_one_exposure() {
        if std::env::var("GPUGI_SKIP_GPU").is_ok_and(|value| value == "1") {
            return;
        }
        let gpu = Gpu::open(&gpugi::gpu::AdapterChoice::Best).expect("a GPU");
        let pages = [[1.0, 1.0], [1.0, 100.0]].map(|page| page.map(Vec3::splat).to_vec());
        let alpha = [1.0, 1.0, 0.0, 1.0];
        let lit = unlit(&gpu, &pages, Some(&alpha), &Effects::default()).expect("pages");
        let pixels = lit.iter().map(|page| match page {
            BakedLight::Unlit(pixels) => pixels,
            _ => panic!("display pixels"),
        });
        let [one, other] = pixels.collect::<Vec<_>>()[..] else {
            panic!("two pages");
        };
        assert_eq!([one.len(), other.len()], [2, 2]);
        // Equal except for dither.
        assert!(one[0][0].abs_diff(other[0][0]) <= 1, "{one:?} {other:?}");
        assert!(other[1][0] > one[0][0] + 50, "{one:?} {other:?}");
        assert_eq!([one[1][3], other[0][3]], [255, 0]);
    }
}
