//! `gpugi render --explain`: which techniques were chosen and why, what each adds and what it costs.

use std::collections::BTreeMap;

use gpugi::Renderer;
use gpugi::default_set::DefaultSet;
use gpugi::gpu::{Gpu, Timing};
use gpugi::light_paths::in_words;
use gpugi::reference::Progress;
use gpugi::techniques::Map;

/// GPU milliseconds of a picture's passes. Empty if they were not timed.
#[derive(Debug, Default)]
pub struct Costs {
    /// By technique, or by the first part of a pass's name for passes that techniques share: for all maps, and for all
    /// samples.
    passes: BTreeMap<String, [f64; 2]>,
    samples: u32,
}

impl Costs {
    /// Adds the passes of a frame in which maps converge.
    pub fn add_to_maps(&mut self, passes: &[Timing]) {
        self.add(passes, 0);
    }

    /// Adds the passes of a sample.
    pub fn add_sample(&mut self, passes: &[Timing]) {
        self.samples += 1;
        self.add(passes, 1);
    }

    fn add(&mut self, passes: &[Timing], kind: usize) {
        for timing in passes {
            let group = timing.pass.split('.').next().unwrap_or_default();
            self.passes.entry(group.to_owned()).or_default()[kind] += timing.milliseconds;
        }
    }

    /// The cost of a group of passes in words.
    fn of(&self, group: &str) -> String {
        let [maps, samples] = self.passes.get(group).copied().unwrap_or_default();
        let sample = samples / f64::from(self.samples.max(1));
        format!("{maps:.1} ms for maps, {sample:.1} ms per sample")
    }
}

/// Prints why the path tracer made a picture for which nobody named it.
pub fn explain_path_tracer(
    gpu: &Gpu,
    done: &Progress,
    [noise, enough]: [f64; 2],
    is_denoised: bool,
) {
    println!(
        "path-tracer on {} ({}): on discrete GPUs, and for fog in software, it has less error than the techniques in the same time
  {} of {} samples per pixel; estimated rel-mse {noise:.1e}{}
  {}
  --technique default: the techniques that suit the scene",
        gpu.adapter.name,
        gpu.adapter.driver,
        done.samples,
        done.of,
        match enough > 0.0 {
            true => format!(", {enough:.0e} ends it"),
            false => String::new(),
        },
        match is_denoised {
            true => "then filtered: non-local means of light without albedo, guided by normals, albedos and depths",
            false => "not filtered: --denoise",
        }
    );
}

/// Prints it.
pub fn explain(
    gpu: &Gpu,
    renderer: &Renderer,
    set: Option<&DefaultSet>,
    left_out: &[String],
    costs: &Costs,
    maps_seconds: f64,
) {
    println!(
        "techniques on {} ({}):",
        gpu.adapter.name, gpu.adapter.driver
    );
    let classes = renderer.light_classes();
    let inspections: BTreeMap<_, _> = renderer.inspect().collect();
    for technique in renderer.techniques() {
        let name = technique.info().name;
        let choice = set.and_then(|set| set.choices.iter().find(|choice| choice.technique == name));
        println!("{name}");
        match choice {
            Some(choice) => {
                println!("  chosen: {}", choice.reason);
                let settings = choice.settings.iter();
                let settings: Vec<String> = settings
                    .map(|(key, value)| format!("{key}={value}"))
                    .collect();
                if !settings.is_empty() {
                    println!(
                        "  settings for this scene and adapter: {}",
                        settings.join(" ")
                    );
                }
            }
            None => println!("  named on the command line"),
        }
        let adds = in_words(renderer.light_paths_of(name), &classes);
        println!(
            "  adds: {}",
            if adds.is_empty() {
                "nothing".into()
            } else {
                adds.join("; ")
            }
        );
        let caveat = technique.info().caveat;
        if !caveat.is_empty() {
            println!("  mind: {caveat}");
        }
        let bytes = inspections.get(name).map_or(0, |inspection| {
            inspection.maps.iter().map(Map::bytes).sum::<u64>() + inspection.work_bytes
        });
        println!(
            "  costs: {}, {:.1} MiB",
            costs.of(name),
            bytes as f64 / f64::from(1 << 20)
        );
    }
    let is_technique = |group: &str| inspections.contains_key(group);
    for group in costs.passes.keys().filter(|group| !is_technique(group)) {
        println!("shared passes {group}: {}", costs.of(group));
    }
    if costs.passes.is_empty() {
        println!("this adapter cannot time passes");
    }
    println!(
        "maps were final after {maps_seconds:.2} s, in which shaders are compiled and atlases unwrapped, too"
    );
    if left_out.is_empty() {
        println!("no kind of light of the scene is left out");
    } else {
        println!("not in this picture: {}", left_out.join("; "));
    }
    for note in set.iter().flat_map(|set| &set.notes) {
        println!("  {note}");
    }
}
