//! What the tests of the command share.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The command, not yet run.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gpugi"));
    command.args(arguments);
    command
}

/// Runs the command.
pub fn gpugi(arguments: &[&str]) -> Output {
    command(arguments).output().expect("the binary runs")
}

/// An empty folder of a test's own.
pub fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&folder).ok();
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    folder
}

/// A channel of an EXR file with layers, such as `Depth.Z`.
pub fn channel(path: &Path, name: &str) -> Vec<f32> {
    let image = exr::prelude::read_first_flat_layer_from_file(path).expect("an EXR file");
    let name = format!("ViewLayer.{name}");
    let mut channels = image.layer_data.channel_data.list.iter();
    let found = channels.find(|channel| channel.name.to_string() == name);
    let found = found.unwrap_or_else(|| panic!("no channel {name}"));
    found.sample_data.values_as_f32().collect()
}

/// Whether `GPUGI_SKIP_GPU=1` asks to leave out what needs an adapter.
pub fn skip_gpu() -> bool {
    std::env::var("GPUGI_SKIP_GPU").is_ok_and(|value| value == "1")
}
