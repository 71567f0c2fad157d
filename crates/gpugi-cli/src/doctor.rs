//! `gpugi doctor`: shows what this machine can do, and how to get what it lacks.

use gpugi::gpu::{AdapterSummary, list_adapters};

/// Describes an adapter in one line.
pub fn adapter_line(adapter: &AdapterSummary) -> String {
    format!(
        "{} ({:?}, {:?}, {})",
        adapter.name, adapter.device_type, adapter.backend, adapter.driver
    )
}

/// Prints adapters with their limits and features, what is missing, and how to get it.
pub fn run() -> anyhow::Result<()> {
    let adapters = list_adapters();
    let mut usable = 0;
    for adapter in &adapters {
        println!("{}", adapter_line(adapter));
        let limits = &adapter.limits;
        println!(
            "  storage buffer {} MiB, texture side {}, {} storage buffers and {} textures a stage",
            limits.max_storage_buffer_binding_size >> 20,
            limits.max_texture_dimension_2d,
            limits.max_storage_buffers_per_shader_stage,
            limits.max_sampled_textures_per_shader_stage,
        );
        let timestamps = adapter.has_timestamps();
        println!(
            "  pass timing {}",
            if timestamps {
                "available"
            } else {
                "missing: `gpugi bench` reports wall time only"
            }
        );
        let missing = adapter.missing();
        if missing.is_empty() {
            println!("  gpugi runs on it");
            usable += 1;
        }
        for line in missing {
            println!("  missing: {line}");
        }
    }
    if usable > 0 {
        return Ok(());
    }
    if cfg!(target_os = "linux") {
        println!(
            "No Vulkan adapter. Install your GPU's driver, or the software one:\n  \
             Debian, Ubuntu: sudo apt-get install mesa-vulkan-drivers libvulkan1\n  \
             Fedora: sudo dnf install mesa-vulkan-drivers vulkan-loader\n  \
             Arch: sudo pacman -S vulkan-swrast vulkan-icd-loader"
        );
    } else {
        println!("No GPU adapter. Install the driver of your GPU.");
    }
    anyhow::bail!("no adapter on which gpugi runs")
}
