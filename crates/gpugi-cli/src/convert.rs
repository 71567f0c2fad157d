//! `gpugi convert`: writes a scene as one .glb for other programs.

use std::path::{Path, PathBuf};

use gpugi_arguments::Usage;
use gpugi_scene::export::{Changes, Original, export_original, export_scene};

use crate::Common;
use crate::bake::{LightUnits, has_extension, write};
use crate::render::print_notes;
use crate::scene_argument::{self, SceneArguments};

/// Options of `gpugi convert`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// File to write (.glb)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Keep what nothing shows, such as images that no material uses
    #[arg(long)]
    keep_unused: bool,
    /// Decode geometry that meshoptimizer or Draco has compressed, for programs without their decoders
    #[arg(long)]
    decompress: bool,
    /// Leave the lights out
    #[arg(long)]
    drop_lights: bool,
    /// Units of the lights: 1 W/sr as 1 cd, as gpugi reads it, or as 683 cd, as Blender does
    #[arg(long, value_name = "UNITS", default_value = "radiometric")]
    light_units: LightUnits,
}

/// Converts.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { scene, output, .. } = arguments;
    if !has_extension(output, &["glb"]) {
        let message = format!(
            "-o {}: scenes are converted into .glb files",
            output.display()
        );
        return Err(Usage(message).into());
    }
    crate::output::check_folders([output.as_path()])?;
    let changes = Changes {
        drops_lights: arguments.drop_lights,
        photometric: arguments.light_units == LightUnits::Photometric,
        unpacks: arguments.decompress,
        prunes: !arguments.keep_unused,
    };
    // A glTF file stays what it is; with other options, or of another format, the scene is written.
    let is_file = SceneArguments {
        files_from: scene.files_from.clone(),
        limits: scene.limits.clone(),
        ..SceneArguments::of(&scene.scene)
    } == *scene;
    let is_gltf = has_extension(Path::new(&scene.scene), &["gltf", "glb"]);
    let (loaded, mut notes) = match is_file && is_gltf {
        true => (None, Vec::new()),
        false => {
            let (loaded, notes) = scene_argument::load(scene)?;
            (Some(loaded), notes)
        }
    };
    let source = loaded.is_none().then_some(scene);
    notes.extend(write(source, output, |original: Option<Original>| {
        let exported = match (&original, &loaded) {
            (Some(original), _) => export_original(original)?,
            (None, Some(loaded)) => export_scene(loaded)?,
            (None, None) => unreachable!("a file that is not loaded is an original"),
        };
        exported.changed(&changes)
    })?);
    print_notes(common, &notes);
    if !common.quiet {
        let bytes = std::fs::metadata(output)?.len();
        println!("{}: {:.1} KiB", output.display(), bytes as f64 / 1024.0);
    }
    Ok(())
}
