//! Edits, switches and opens at random for as long as it is told, and prints how much memory the process holds:
//! `cargo run --release -p gpugi-viewer --example soak -- 600 1` (seconds, seed).

use std::time::{Duration, Instant};

use glam::Vec2;
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi_arguments::edits::edit_of;
use gpugi_arguments::scene_argument::SceneArguments;
use gpugi_viewer::technique_set::TechniqueSet;
use gpugi_viewer::viewer::{Look, Start, Viewer};

const SIZE: [u32; 2] = [96, 64];
const FRAME: Duration = Duration::from_millis(10);
const SCENES: [&str; 4] = ["room", "cornell", "glass-room", "fog-room"];
const SETS: [&[&str]; 4] = [
    &["shadow-map"],
    &["shadow-map", "caustics", "distance-impostor"],
    &["shadow-map", "radiosity"],
    &["shadow-map", "final-gather", "ray-tracing"],
];

/// xorshift64*: the same steps for the same seed.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % bound.max(1)
    }

    fn part(&mut self) -> f32 {
        self.below(1 << 16) as f32 / 65_536.0
    }
}

fn main() -> Result<(), String> {
    let number = |index: usize, default: u64| {
        let argument = std::env::args().nth(index);
        argument.map_or(Ok(default), |text| {
            text.parse::<u64>().map_err(|error| error.to_string())
        })
    };
    let (seconds, seed) = (number(1, 600)?, number(2, 1)?);
    let gpu = Gpu::open(&AdapterChoice::Best).map_err(|error| error.to_string())?;
    let start = Start {
        scene: SceneArguments::of(SCENES[0]),
        set: TechniqueSet::default(),
        look: Look::default(),
    };
    let mut viewer = Viewer::new(&gpu, start, || {});
    viewer.finish_opening()?;
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let began = Instant::now();
    let (mut steps, mut frames, mut refused, mut minutes) = (0_u64, 0_u64, 0_u64, 0);
    while began.elapsed().as_secs() < seconds {
        steps += 1;
        if let Err(reason) = step(&mut viewer, &mut random) {
            refused += 1;
            eprintln!("step {steps}: {reason}");
        }
        for _ in 0..1 + random.below(8) {
            frames += 1;
            // As a window does, which waits for the screen.
            std::thread::sleep(FRAME);
            viewer.take_opened()?;
            let session = viewer.session().ok_or("nothing is on show")?;
            let shown = session.frame(SIZE, 1.0 / 30.0);
            shown.map_err(|error| error.to_string())?;
            gpu.wait().map_err(|error| error.to_string())?;
        }
        gpu.check().map_err(|error| error.to_string())?;
        if began.elapsed().as_secs() >= 60 * minutes {
            println!(
                "{minutes} min: {steps} steps, {refused} refused, {frames} frames, {} MiB",
                resident_mebibytes()
            );
            minutes += 1;
        }
    }
    println!(
        "end: {steps} steps, {refused} refused, {frames} frames, {} MiB",
        resident_mebibytes()
    );
    Ok(())
}

fn step(viewer: &mut Viewer, random: &mut Random) -> Result<(), String> {
    let what = random.below(16);
    if what == 0 {
        let scene = SceneArguments::of(SCENES[random.below(SCENES.len())]);
        viewer.open(scene, &TechniqueSet::default());
        return Ok(());
    }
    if what == 1 {
        let set = SETS[random.below(SETS.len())];
        viewer.change_set(TechniqueSet {
            names: Some(set.iter().map(|&name| name.to_owned()).collect()),
            ..TechniqueSet::default()
        });
        return Ok(());
    }
    let session = viewer.session().ok_or("nothing is on show")?;
    let scene = session.loaded().scene();
    let text = match what {
        2..5 => {
            let turn = Vec2::new(random.part() - 0.5, random.part() - 0.5);
            session.camera.orbit(turn);
            return Ok(());
        }
        5 => {
            session.clock.is_playing = !session.clock.is_playing;
            return Ok(());
        }
        6 => {
            session.reset_camera();
            return Ok(());
        }
        7..10 if !scene.lights.is_empty() => {
            let [x, y, z] = [
                random.part() - 0.5,
                1.0 + random.part(),
                random.part() - 0.5,
            ];
            let index = random.below(scene.lights.len());
            format!("light.{index}.position={x},{y},{z}")
        }
        7..13 => {
            let index = random.below(scene.instances.len());
            let place = scene.instances[index].world_from_mesh.w_axis;
            let x = place.x + 0.2 * (random.part() - 0.5);
            format!("object.{index}.position={x},{},{}", place.y, place.z)
        }
        _ => {
            let index = random.below(scene.materials.len());
            format!("material.{index}.roughness={}", random.part())
        }
    };
    let edit = edit_of(&text, scene).map_err(|error| error.to_string())?;
    session.edit(&edit).map_err(|error| error.to_string())
}

/// Memory of the process, as Linux tells it; 0 elsewhere.
fn resident_mebibytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kibibytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kibibytes.unwrap_or(0) >> 10
}
