//! Watches the sources of shaders, in debug builds: when one changes, all are linked anew, and the scene is shown with
//! them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, SystemTime};

use gpugi::gpu::{Shader, all_shaders, shader_linker};

/// Time between two looks at the sources.
const INTERVAL: Duration = Duration::from_millis(300);

/// All shaders, or what is wrong with one.
pub type Linked = Result<Vec<Shader>, String>;

/// A thread that watches.
#[derive(Debug)]
pub struct ShaderWatch(Receiver<Linked>);

impl ShaderWatch {
    /// Watches gpugi's own sources, in debug builds whose sources are still there. `wake` is called when there is
    /// something new.
    pub fn start(wake: impl Fn() + Send + 'static) -> Option<Self> {
        let (linker, folder) = shader_linker()?;
        let sources = folder.join("src");
        let is_there = linker.is_file() && sources.is_dir();
        is_there.then(|| Self::of(sources, move || link(linker, folder), wake))
    }

    /// Watches any folder and those in it. `link` is called when something has changed there.
    fn of(
        folder: PathBuf,
        link: impl Fn() -> Linked + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let (sender, linked) = channel();
        let mut seen = sources(&folder);
        thread::spawn(move || {
            let mut is_wanted = true;
            while is_wanted {
                thread::sleep(INTERVAL);
                let now = sources(&folder);
                if now != seen {
                    seen = now;
                    is_wanted = sender.send(link()).is_ok();
                    wake();
                }
            }
        });
        Self(linked)
    }

    /// What was linked last, if it is new.
    pub fn latest(&self) -> Option<Linked> {
        self.0.try_iter().last()
    }
}

/// All WESL sources in a folder and those in it, with the times of their last changes.
fn sources(folder: &Path) -> Vec<(PathBuf, Option<SystemTime>)> {
    let mut all = Vec::new();
    // What cannot be read now may be about to be replaced.
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            all.extend(sources(&path));
        } else if path
            .extension()
            .is_some_and(|extension| extension == "wesl")
        {
            let changed = entry.metadata().and_then(|about| about.modified());
            all.push((path, changed.ok()));
        }
    }
    all.sort();
    all
}

/// Links all shaders as they are on the disk.
fn link(linker: &Path, folder: &Path) -> Linked {
    let out = std::env::temp_dir().join(format!("gpugi-shaders-{}", std::process::id()));
    let linked = std::fs::create_dir_all(&out)
        .and_then(|()| {
            let mut linker = Command::new(linker);
            linker.current_dir(folder).env("OUT_DIR", &out).output()
        })
        .map_err(|error| format!("the shaders cannot be linked: {error}"))
        .and_then(|done| {
            let words = String::from_utf8_lossy(&done.stderr);
            let words = without_colors(&words);
            done.status.success().then_some(()).ok_or(words)
        })
        .and_then(|()| read(&out));
    // In a folder for such files, it may also stay.
    let _ = std::fs::remove_dir_all(&out);
    linked
}

/// The text without the escape sequences by which it has colours in a terminal.
fn without_colors(text: &str) -> String {
    let mut parts = text.split("\x1b[");
    let first = parts.next().unwrap_or_default().to_owned();
    let plain = parts.map(|part| part.split_once('m').map_or(part, |(_, plain)| plain));
    first + &plain.collect::<String>()
}

/// The linked shaders in `folder`, if GPUs will take them. Those that were built are missing where the source is gone.
fn read(folder: &Path) -> Linked {
    let mut shaders = Vec::new();
    for &(name, _) in all_shaders() {
        let source = std::fs::read_to_string(folder.join(format!("{name}.wgsl")));
        let Ok(source) = source else { continue };
        let source = source.into();
        let shader = Shader { name, source };
        shader.validate().map_err(|error| error.to_string())?;
        shaders.push(shader);
    }
    Ok(shaders)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_that_changes_is_noticed() {
        let folder = std::env::temp_dir().join(format!("gpugi-watch-{}", std::process::id()));
        let inner = folder.join("inner");
        std::fs::create_dir_all(&inner).unwrap();
        std::fs::write(inner.join("old.wesl"), "").unwrap();
        let (woken, wakes) = channel();
        let link = || Err("linked".to_owned());
        let watch = ShaderWatch::of(folder.clone(), link, move || woken.send(()).unwrap());
        assert_eq!(watch.latest().map(drop), None);
        std::fs::write(inner.join("note.txt"), "no shader").unwrap();
        assert!(wakes.recv_timeout(3 * INTERVAL).is_err());
        std::fs::write(inner.join("new.wesl"), "").unwrap();
        wakes.recv().unwrap();
        assert_eq!(watch.latest().unwrap().unwrap_err(), "linked");
        std::fs::remove_file(inner.join("old.wesl")).unwrap();
        wakes.recv().unwrap();
        assert!(watch.latest().is_some() && watch.latest().is_none());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// Copies the sources in a folder and those in it.
    fn copy(from: &Path, to: &Path) {
        for (path, _) in sources(from) {
            let copy = to.join(path.strip_prefix(from).unwrap());
            std::fs::create_dir_all(copy.parent().unwrap()).unwrap();
            std::fs::copy(path, copy).unwrap();
        }
    }

    #[test]
    fn sources_are_linked_as_they_are_by_now() {
        let Some((linker, folder)) = shader_linker() else {
            return;
        };
        let edited = std::env::temp_dir().join(format!("gpugi-edited-{}", std::process::id()));
        copy(&folder.join("src"), &edited.join("src"));
        let source = edited.join("src/picture/present.wesl");
        let text = std::fs::read_to_string(&source).unwrap();
        std::fs::write(&source, format!("{text}\nconst UNDER_DEVELOPMENT = 1.5;\n")).unwrap();
        let shaders = link(linker, &edited).unwrap();
        assert_eq!(shaders.len(), all_shaders().len());
        for shader in shaders {
            let is_edited = shader.source.contains("UNDER_DEVELOPMENT");
            assert_eq!(is_edited, shader.name == "picture.present");
        }
        for (wrong, said) in [
            ("fn f( {", "present"),
            ("fn f() -> u32 { return 1.5; }", "1.5"),
        ] {
            std::fs::write(&source, format!("{text}\n{wrong}\n")).unwrap();
            let reason = link(linker, &edited).map(|shaders| shaders.len());
            let reason = reason.unwrap_err();
            assert!(reason.contains(said), "{wrong}: {reason}");
            assert!(!reason.contains('\x1b'), "{reason:?}");
        }
        assert!(link(Path::new("no-such-linker"), folder).is_err());
        std::fs::remove_dir_all(&edited).unwrap();
    }
}
