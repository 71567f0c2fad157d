//! `gpugi measure --equal-time`.

mod chart;

use std::path::Path;

use gpugi::gpu::Gpu;
use gpugi::light_paths::{LightClass, all_light};
use gpugi::measure::{
    LiveInTime, MeasureError, Moves, Options, StillInTime, Subject, live_in_time,
    path_traced_in_time, stills_in_time, trace, trace_live,
};
use gpugi::picture::Effects;
use gpugi::{Purpose, Renderer, Techniques};

use serde::Serialize;

use crate::Usage;
use crate::output::write_json;
use crate::render::{Chosen, is_path_tracer};

/// Sets that are compared unless some are named.
const SETS: [&str; 3] = ["default", "path-tracing", "path-tracer"];

/// Pictures that are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Pictures {
    /// Still pictures
    Still,
    /// Frames in motion
    Live,
}

/// What is compared, and for how long.
pub(super) struct Comparison<'a> {
    /// Times (ms), ascending.
    budgets: Vec<f64>,
    sets: Vec<Set>,
    /// `None`: all.
    pictures: Option<Pictures>,
    gpu: &'a Gpu,
    subject: Subject<'a>,
    /// The scene's name or file.
    scene: &'a str,
    effects: &'a Effects,
    options: &'a Options,
}

/// Techniques with settings, or the path tracer.
struct Set {
    /// As it was given.
    name: String,
    /// Empty: the default set for the purpose.
    techniques: Vec<String>,
    settings: Vec<String>,
    is_path_tracer: bool,
}

/// A set's pictures in time.
#[derive(Serialize)]
struct Row<T> {
    set: String,
    points: Vec<T>,
}

/// What was found.
#[derive(Serialize, Default)]
pub(super) struct Compared {
    /// The largest of the references.
    reference_rel_mse: f64,
    still: Vec<Row<StillInTime>>,
    live: Vec<Row<LiveInTime>>,
    /// What is to be known about it, one sentence each.
    pub notes: Vec<String>,
}

/// The content of `--json`.
#[derive(Serialize)]
struct Report<'a> {
    scene: &'a str,
    size: [u32; 2],
    adapter: &'a str,
    driver: &'a str,
    budgets_ms: &'a [f64],
    #[serde(flatten)]
    compared: &'a Compared,
}

impl Compared {
    /// Takes notice of notes, each once, and of a reference.
    fn follow(&mut self, notes: &[String], rel_mse: f64) {
        for note in notes {
            if !self.notes.contains(note) {
                self.notes.push(note.clone());
            }
        }
        self.reference_rel_mse = self.reference_rel_mse.max(rel_mse);
    }
}

impl<'a> Comparison<'a> {
    /// What `--equal-time` and `--techniques` ask for.
    pub fn new(
        gpu: &'a Gpu,
        (scene, subject): (&'a str, Subject<'a>),
        (effects, options): (&'a Effects, &'a Options),
        (times, sets): (&[f64], &[String]),
        pictures: Option<Pictures>,
    ) -> anyhow::Result<Self> {
        let mut budgets = times.to_vec();
        if let Some(time) = times.iter().find(|time| !(**time > 0.0 && **time <= 1e7)) {
            return Err(Usage(format!(
                "--equal-time {time}: milliseconds above 0, up to 10,000,000, are needed"
            ))
            .into());
        }
        budgets.sort_by(f64::total_cmp);
        budgets.dedup();
        let sets = match sets {
            [] => SETS.map(str::to_owned).to_vec(),
            sets => sets.to_vec(),
        };
        Ok(Self {
            budgets,
            sets: sets
                .iter()
                .map(|set| Set::parse(set))
                .collect::<anyhow::Result<_>>()?,
            pictures,
            gpu,
            subject,
            scene,
            effects,
            options,
        })
    }

    /// Measures still pictures and live frames.
    pub fn run(&self, report: gpugi::measure::Report<'_>) -> anyhow::Result<Compared> {
        // It has the classes of light that the scene has.
        let nothing = Renderer::new(self.gpu, self.subject.scene, [1, 1], Techniques::NONE)?;
        let classes = nothing.light_classes();
        let wants = |pictures| self.pictures.is_none_or(|wanted| wanted == pictures);
        // What is refused is refused before anything is traced.
        let rendered = self.sets.iter().filter(|set| !set.is_path_tracer);
        for set in rendered {
            self.chosen(set, Purpose::StillPicture)?;
        }
        let mut compared = Compared::default();
        if wants(Pictures::Still) {
            self.still(&classes, &mut compared, report)?;
        }
        if wants(Pictures::Live) && !self.gpu.has_timestamps {
            let note = "no frames in motion: this adapter cannot time passes";
            compared.notes.push(note.to_owned());
        } else if wants(Pictures::Live) {
            self.live(&classes, &mut compared, report)?;
        }
        Ok(compared)
    }

    /// Still pictures of all sets.
    fn still(
        &self,
        classes: &[LightClass],
        compared: &mut Compared,
        report: gpugi::measure::Report<'_>,
    ) -> anyhow::Result<()> {
        let (subject, options) = (&self.subject, self.options);
        let truth = trace(self.gpu, subject, &[all_light(classes)], options, report)?;
        compared.follow(&truth.notes, truth.rel_mse());
        let of_time = (&truth, &self.budgets[..]);
        for set in &self.sets {
            let name = set.name.clone();
            if set.is_path_tracer {
                let [plain, denoised] =
                    path_traced_in_time(self.gpu, subject, of_time, options, report)?;
                let filtered = format!("{name}, denoised");
                compared.still.push(Row::new(name, plain));
                compared.still.push(Row::new(filtered, denoised));
                continue;
            }
            let points = self.of_set(set, Purpose::StillPicture, compared, |renderer| {
                stills_in_time(self.gpu, subject.camera, renderer, of_time, options, report)
            })?;
            compared.still.push(Row::new(name, points));
        }
        Ok(())
    }

    /// Frames in motion of all sets but the path tracer.
    fn live(
        &self,
        classes: &[LightClass],
        compared: &mut Compared,
        report: gpugi::measure::Report<'_>,
    ) -> anyhow::Result<()> {
        let truth = trace_live(
            self.gpu,
            &self.subject,
            (&Moves::Camera, 0.0),
            classes,
            self.options,
            report,
        )?;
        compared.follow(&truth.notes, truth.rel_mse);
        let seen = (self.subject.scene, self.subject.camera);
        for set in self.sets.iter().filter(|set| !set.is_path_tracer) {
            let of_time = (&truth, &self.budgets[..]);
            let points = self.of_set(set, Purpose::LiveView, compared, |renderer| {
                live_in_time(seen, renderer, self.effects, of_time, self.options, report)
            })?;
            compared.live.push(Row::new(set.name.clone(), points));
        }
        Ok(())
    }

    fn chosen(&self, set: &Set, purpose: Purpose) -> anyhow::Result<Chosen> {
        let Subject { scene, size, .. } = self.subject;
        let settings = &set.settings;
        Chosen::new(self.gpu, scene, size, purpose, &set.techniques, settings)
    }

    /// What `measure` finds of a set's renderer, or of that of a set without atlas where the scene cannot be unwrapped.
    fn of_set<T>(
        &self,
        set: &Set,
        purpose: Purpose,
        compared: &mut Compared,
        mut measure: impl FnMut(&mut Renderer) -> Result<T, MeasureError>,
    ) -> anyhow::Result<T> {
        let mut chosen = self.chosen(set, purpose)?;
        let measured = loop {
            match measure(&mut chosen.renderer) {
                Err(MeasureError::Render(error)) => chosen.without_atlas(error)?,
                measured => break measured?,
            }
        };
        let notes = chosen.notes().into_iter();
        compared.follow(
            &notes
                .map(|note| format!("{}: {note}", set.name))
                .collect::<Vec<_>>(),
            0.0,
        );
        Ok(measured)
    }

    /// Writes the requested files.
    pub fn write(
        &self,
        compared: &Compared,
        [json, svg]: [Option<&Path>; 2],
    ) -> anyhow::Result<()> {
        let report = Report {
            scene: self.scene,
            size: self.subject.size,
            adapter: &self.gpu.adapter.name,
            driver: &self.gpu.adapter.driver,
            budgets_ms: &self.budgets,
            compared,
        };
        if let Some(path) = json {
            write_json(path, &report)?;
        }
        match svg {
            Some(path) => chart::write(path, &report),
            None => Ok(()),
        }
    }

    /// Prints the tables.
    pub fn print(&self, compared: &Compared) {
        let [width, height] = self.subject.size;
        println!(
            "{}: HDR-FLIP against all light, {width}x{height}, on {} ({})",
            self.scene, self.gpu.adapter.name, self.gpu.adapter.driver
        );
        println!(
            "reference: estimated rel-mse {:.2e}",
            compared.reference_rel_mse
        );
        let title = "still picture, from stale maps on (samples)";
        self.print_table(title, &compared.still, |point| {
            format!("{:.3} ({})", point.flip, point.samples)
        });
        let title = "frame in motion (part of the pixels per side)";
        self.print_table(title, &compared.live, |point| match point.size[0] {
            all if all == width => format!("{:.3}", point.moving),
            few => format!(
                "{:.3} ({:.2})",
                point.moving,
                f64::from(few) / f64::from(width)
            ),
        });
    }

    fn print_table<T: InTime>(&self, title: &str, rows: &[Row<T>], cell: impl Fn(&T) -> String) {
        if rows.is_empty() {
            return;
        }
        let titles = self.budgets.iter().map(|budget| format!("{budget} ms"));
        let head: Vec<String> = [title.to_owned()].into_iter().chain(titles).collect();
        println!("\n| {} |\n|{}", head.join(" | "), "---|".repeat(head.len()));
        for row in rows {
            let of = |budget: &f64| {
                let point = row.points.iter().find(|point| point.budget() == *budget);
                point.map_or_else(|| "-".to_owned(), &cell)
            };
            let cells: Vec<String> = self.budgets.iter().map(of).collect();
            println!("| {} | {} |", row.set, cells.join(" | "));
        }
    }
}

/// A measurement for which there was some time.
trait InTime {
    /// That time (ms).
    fn budget(&self) -> f64;
}

impl InTime for StillInTime {
    fn budget(&self) -> f64 {
        self.budget
    }
}

impl InTime for LiveInTime {
    fn budget(&self) -> f64 {
        self.budget
    }
}

impl<T> Row<T> {
    fn new(set: String, points: Vec<Option<T>>) -> Self {
        Self {
            set,
            points: points.into_iter().flatten().collect(),
        }
    }
}

impl Set {
    /// Reads a set: `default`, `path-tracer`, or techniques with settings such as `path-tracing.bounces=4`, separated by
    /// commas.
    fn parse(text: &str) -> anyhow::Result<Self> {
        let words = text
            .split(',')
            .map(str::trim)
            .filter(|word| !word.is_empty());
        let (settings, mut techniques): (Vec<String>, Vec<String>) = words
            .map(str::to_owned)
            .partition(|word| word.contains('='));
        if techniques.is_empty() {
            let message = format!(
                "--techniques {text:?}: a set names techniques, default or path-tracer; sets are separated by semicolons"
            );
            return Err(Usage(message).into());
        }
        let is_path_tracer = is_path_tracer(&techniques)?;
        if is_path_tracer && !settings.is_empty() {
            let message =
                format!("--techniques {text:?}: path-tracer has its default settings here");
            return Err(Usage(message).into());
        }
        if is_path_tracer || techniques == ["default"] {
            techniques.clear();
        }
        Ok(Self {
            name: text.trim().to_owned(),
            techniques,
            settings,
            is_path_tracer,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_techniques_with_settings() {
        let set = Set::parse(" shadow-map, path-tracing.bounces=4 ,path-tracing").unwrap();
        assert_eq!(set.techniques, ["shadow-map", "path-tracing"]);
        assert_eq!(set.settings, ["path-tracing.bounces=4"]);
        assert!(!set.is_path_tracer);
        assert!(Set::parse("default").unwrap().techniques.is_empty());
        assert!(Set::parse("path-tracer").unwrap().is_path_tracer);
        for wrong in [
            "",
            " , ",
            "a.b=1",
            "path-tracer,shadow-map",
            "path-tracer,path-tracer.samples=2",
        ] {
            assert!(Set::parse(wrong).is_err(), "{wrong:?}");
        }
    }
}
