//! `gpugi-fuzz FORMAT --seconds N`: damages files of a format, reads them, and keeps those that do harm.
//!
//! A case fails if it panics, ends the process, takes more than a second or more memory than its limits, or if what was
//! imported cannot be posed, given a hierarchy, unwrapped, exported and read back. A child process does the work; it
//! writes down each case before it tries it, so that the parent has the file whatever happens to the child.

mod allocator;
mod formats;
mod mutate;
mod random;
mod seeds;

use std::collections::HashSet;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};

use formats::{Format, Outcome};
use mutate::{Case, mutate};
use random::Random;

#[global_allocator]
static ALLOCATOR: allocator::Counting = allocator::Counting;

/// Longest time of a case, unless another is asked for (s of CPU time).
const LONGEST: f64 = 1.0;
/// After this the child gives up on a case (wall time, on a machine that may be busy).
const HANGS: Duration = Duration::from_secs(30);
/// Time to make a failing case smaller.
const MINIMIZING: Duration = Duration::from_secs(5);
/// Most cases from which new ones are made.
const CORPUS: usize = 2000;

const USAGE: &str =
    "usage: gpugi-fuzz FORMAT|all [--seconds N] [--seed N] [--longest SECONDS] [--failures FOLDER]
       gpugi-fuzz FORMAT --replay FILE_OR_FOLDER";

#[derive(Clone)]
struct Options {
    format: String,
    seconds: u64,
    seed: u64,
    /// CPU time that a case may take (s).
    longest: f64,
    failures: PathBuf,
    replay: Option<PathBuf>,
    /// Set in the child: where it writes down what it does.
    child: Option<PathBuf>,
}

impl Options {
    fn parse() -> anyhow::Result<Self> {
        let mut arguments = std::env::args().skip(1);
        let mut options = Self {
            format: arguments.next().context(USAGE)?,
            seconds: 10,
            seed: 1,
            longest: LONGEST,
            failures: "fuzz-failures".into(),
            replay: None,
            child: None,
        };
        while let Some(name) = arguments.next() {
            let value = arguments.next().context(USAGE)?;
            match name.as_str() {
                "--seconds" => options.seconds = value.parse()?,
                "--seed" => options.seed = value.parse()?,
                "--longest" => options.longest = value.parse()?,
                "--failures" => options.failures = value.into(),
                "--replay" => options.replay = Some(value.into()),
                "--child" => options.child = Some(value.into()),
                _ => bail!("{USAGE}"),
            }
        }
        Ok(options)
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("gpugi-fuzz: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// Whether no case failed.
fn run() -> anyhow::Result<bool> {
    let options = Options::parse()?;
    let chosen: Vec<&Format> = (formats::ALL.iter())
        .filter(|format| options.format == "all" || options.format == format.name)
        .collect();
    if chosen.is_empty() {
        let names: Vec<&str> = formats::ALL.iter().map(|format| format.name).collect();
        bail!(
            "there is no format {:?}; there are all, {}",
            options.format,
            names.join(", ")
        );
    }
    if let Some(path) = &options.replay {
        return replay(chosen[0], path);
    }
    if let Some(folder) = &options.child {
        return work(chosen[0], &options, folder);
    }
    let mut is_fine = true;
    for format in chosen {
        is_fine &= supervise(format, &options)?;
    }
    Ok(is_fine)
}

/// Starts children until the time is up, and keeps the case of each that dies.
fn supervise(format: &Format, options: &Options) -> anyhow::Result<bool> {
    let started = Instant::now();
    let folder =
        std::env::temp_dir().join(format!("gpugi-fuzz-{}-{}", format.name, std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let mut seed = options.seed;
    let mut cases = 0;
    let mut is_fine = true;
    loop {
        let left = options.seconds.saturating_sub(started.elapsed().as_secs());
        if left == 0 {
            break;
        }
        let status = Command::new(std::env::current_exe()?)
            .arg(format.name)
            .args(["--seconds", &left.to_string(), "--seed", &seed.to_string()])
            .args(["--longest", &options.longest.to_string()])
            .arg("--failures")
            .arg(&options.failures)
            .arg("--child")
            .arg(&folder)
            .status()?;
        let counted = std::fs::read_to_string(folder.join("cases")).unwrap_or_default();
        cases += counted.trim().parse::<u64>().unwrap_or(0);
        match status.code() {
            Some(0) => {}
            Some(1) => is_fine = false,
            _ => {
                is_fine = false;
                let case = Note::read(&folder.join("case"))?;
                let place = keep(&options.failures, format, &case)?;
                println!(
                    "{}: the process died ({status}): {}",
                    format.name,
                    place.display()
                );
                seed += 1000;
                continue;
            }
        }
        break;
    }
    std::fs::remove_dir_all(&folder).ok();
    let seconds = started.elapsed().as_secs();
    let verdict = if is_fine {
        "none failed"
    } else {
        "some failed"
    };
    println!("{}: {cases} cases in {seconds} s, {verdict}", format.name);
    Ok(is_fine)
}

/// Milliseconds since the start at which the running case began; 0 if none runs.
static BEGAN: AtomicU64 = AtomicU64::new(0);
/// The message and place of the last panic.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Tries cases for the given time. Whether none failed.
fn work(format: &Format, options: &Options, folder: &Path) -> anyhow::Result<bool> {
    let started = Instant::now();
    watch(started);
    let mut note = Note(File::create(folder.join("case"))?);
    let mut random = Random::new(options.seed);
    let mut corpus: Vec<Case> = (format.seeds)();
    let mut signatures = HashSet::new();
    let mut failures = HashSet::new();
    let mut cases = 0_u64;
    let seeds = corpus.len();
    while started.elapsed().as_secs() < options.seconds {
        let at = cases as usize;
        let case = if at < seeds {
            corpus[at].clone()
        } else {
            let parent = random.below(corpus.len());
            let donor = random.below(corpus.len());
            mutate(&mut random, &corpus[parent], &corpus[donor])
        };
        note.write(&case)?;
        BEGAN.store(started.elapsed().as_millis() as u64 + 1, Ordering::Relaxed);
        let outcome = attempt(format, &case, options.longest);
        BEGAN.store(0, Ordering::Relaxed);
        cases += 1;
        if cases.is_multiple_of(64) {
            std::fs::write(folder.join("cases"), cases.to_string())?;
        }
        if let Some(failure) = outcome.failure
            && failures.insert(failure.clone())
        {
            let small = minimized(format, case.clone(), &failure, options.longest);
            let place = keep(&options.failures, format, &small)?;
            println!("{}: {failure}: {}", format.name, place.display());
        } else if at >= seeds && signatures.insert(outcome.signature) {
            if corpus.len() == CORPUS {
                let at = seeds + random.below(CORPUS - seeds);
                corpus[at] = case;
            } else {
                corpus.push(case);
            }
        }
    }
    std::fs::write(folder.join("cases"), cases.to_string())?;
    Ok(failures.is_empty())
}

/// The running case, in one file that is never truncated: that would take longer than most cases.
struct Note(File);

impl Note {
    fn write(&mut self, case: &Case) -> anyhow::Result<()> {
        let mut bytes = Vec::new();
        for part in case
            .iter()
            .flat_map(|(name, bytes)| [name.as_bytes(), bytes])
        {
            bytes.extend((part.len() as u64).to_le_bytes());
            bytes.extend(part);
        }
        bytes.extend(u64::MAX.to_le_bytes());
        self.0.seek(SeekFrom::Start(0))?;
        Ok(self.0.write_all(&bytes)?)
    }

    fn read(path: &Path) -> anyhow::Result<Case> {
        let bytes = std::fs::read(path)?;
        let mut rest = &bytes[..];
        let mut parts = Vec::new();
        while let Some((length, after)) = rest.split_first_chunk() {
            let length = u64::from_le_bytes(*length);
            if length == u64::MAX {
                break;
            }
            let (part, after) = after
                .split_at_checked(length as usize)
                .context("a broken note")?;
            parts.push(part.to_vec());
            rest = after;
        }
        let files = parts.chunks_exact(2);
        Ok(files
            .map(|file| {
                (
                    String::from_utf8_lossy(&file[0]).into_owned(),
                    file[1].clone(),
                )
            })
            .collect())
    }
}

/// Ends the process if a case hangs.
fn watch(started: Instant) {
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(500));
            let began = BEGAN.load(Ordering::Relaxed);
            let now = started.elapsed().as_millis() as u64;
            if began != 0 && now.saturating_sub(began) > HANGS.as_millis() as u64 {
                eprintln!("a case hangs");
                std::process::exit(3);
            }
        }
    });
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut last) = PANIC.lock() {
            *last = panic.to_string().replace('\n', " ");
            // Where a panic aborts, nothing else says what it was.
            if cfg!(panic = "abort") {
                eprintln!("{last}");
            }
        }
    }));
}

/// Reads a case; a panic or too long a time is a failure.
fn attempt(format: &Format, case: &Case, longest: f64) -> Outcome {
    let before = cpu_time();
    let outcome = catch_unwind(AssertUnwindSafe(|| (format.run)(case)));
    let mut outcome = outcome.unwrap_or_else(|_| {
        let panic = PANIC.lock().map(|panic| panic.clone()).unwrap_or_default();
        Outcome {
            failure: Some(
                panic
                    .chars()
                    .filter(|character| !character.is_control())
                    .collect(),
            ),
            signature: String::new(),
        }
    });
    let took = cpu_time().saturating_sub(before);
    if took.as_secs_f64() > longest && outcome.failure.is_none() {
        outcome.failure = Some(format!("more than {longest} s ({})", outcome.signature));
    }
    outcome
}

/// CPU time of this thread where the system tells it, otherwise wall time: other programs must not fail a case.
fn cpu_time() -> Duration {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    let nanoseconds = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = nanoseconds.and_then(|text| text.split(' ').next()?.parse().ok());
    match nanoseconds {
        Some(nanoseconds) => Duration::from_nanos(nanoseconds),
        None => START.get_or_init(Instant::now).elapsed(),
    }
}

/// Leaves out parts of the files as long as the same failure remains.
fn minimized(format: &Format, mut case: Case, failure: &str, longest: f64) -> Case {
    let started = Instant::now();
    for file in 0..case.len() {
        let mut length = case[file].1.len().next_power_of_two();
        while length >= 1 {
            let mut at = 0;
            while at < case[file].1.len() {
                if started.elapsed() > MINIMIZING {
                    return case;
                }
                let mut smaller = case.clone();
                let end = (at + length).min(smaller[file].1.len());
                smaller[file].1.drain(at..end);
                if attempt(format, &smaller, longest).failure.as_deref() == Some(failure) {
                    case = smaller;
                } else {
                    at += length;
                }
            }
            length /= 2;
        }
    }
    case
}

/// Stores a case in a folder.
fn store(folder: &Path, case: &Case) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    for (name, bytes) in case {
        std::fs::write(folder.join(name), bytes)?;
    }
    // The first file is the one that is imported.
    std::fs::write(folder.join("first"), &case[0].0)?;
    Ok(())
}

fn load(path: &Path) -> anyhow::Result<Case> {
    let name = |path: &Path| {
        path.file_name()
            .map(|name| name.to_string_lossy().into_owned())
    };
    if path.is_file() {
        let bytes = std::fs::read(path)?;
        return Ok(vec![(name(path).context("no file name")?, bytes)]);
    }
    let first = std::fs::read_to_string(path.join("first")).context("the folder holds no case")?;
    let mut case = vec![(first.clone(), std::fs::read(path.join(&first))?)];
    for entry in std::fs::read_dir(path)? {
        let path = entry?.path();
        if let Some(name) = name(&path)
            && name != first
            && name != "first"
        {
            case.push((name, std::fs::read(path)?));
        }
    }
    Ok(case)
}

/// Stores a failing case under a name that its content decides.
fn keep(failures: &Path, format: &Format, case: &Case) -> anyhow::Result<PathBuf> {
    let mut hasher = blake3::Hasher::new();
    for (_, bytes) in case {
        hasher.update(bytes);
    }
    let hash = hasher.finalize().to_hex();
    let place = failures.join(format!("{}-{}", format.name, &hash[..12]));
    store(&place, case)?;
    Ok(place)
}

fn replay(format: &Format, path: &Path) -> anyhow::Result<bool> {
    let case = load(path)?;
    watch(Instant::now());
    let before = Instant::now();
    let Outcome { signature, failure } = attempt(format, &case, LONGEST);
    println!("{:.2} s: {signature}", before.elapsed().as_secs_f64());
    if let Some(failure) = &failure {
        println!("fails: {failure}");
    }
    Ok(failure.is_none())
}
