//! Scripts: what happens in which frame of a run without a window.

use std::path::PathBuf;

use glam::Vec2;
use gpugi_arguments::edits;
use gpugi_arguments::files::Files;
use gpugi_arguments::scene_argument::SceneArguments;
use gpugi_arguments::technique_names;

use crate::technique_set::TechniqueSet;
use crate::viewer::Viewer;

/// What happens.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// Turns the camera around its target (degrees).
    Orbit(Vec2),
    /// Shifts the view (heights of the picture).
    Pan(Vec2),
    /// Goes nearer or farther, by a factor.
    Zoom(f32),
    /// Goes back to where the camera stood.
    Reset,
    /// Opens a file or a built-in scene.
    Open(String),
    /// Lights the scene with these techniques.
    Techniques(Vec<String>),
    /// Changes a setting: technique, name, value.
    Set([String; 3]),
    /// Edits the scene, as `--edit` says it.
    Edit(String),
    /// Runs the animation, or stops it.
    Play(bool),
    /// Walks, or flies.
    Walk(bool),
    /// Walks right and forward from now on (parts of a walk's speed).
    Go(Vec2),
    /// Turns the view to the right and up (degrees).
    Look(Vec2),
    /// Jumps.
    Jump,
    /// Uses what is in the middle of the picture.
    Operate,
    /// Throws a ball.
    Throw,
    /// Loses the device.
    LoseDevice,
}

/// Steps with the frames before which they happen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Script(Vec<(u32, Step)>);

impl Script {
    /// Reads a script: a line per step, with the number of the frame, what happens, and its values. Empty lines and
    /// those that begin with `#` say nothing.
    ///
    /// # Errors
    /// A sentence with the number of the line.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut steps = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let step = parse_step(&words).ok_or_else(|| {
                format!(
                    "line {}: {line:?}: expected a frame and one of: {HELP}",
                    index + 1
                )
            })?;
            steps.push(step);
        }
        Ok(Self(steps))
    }

    /// What happens before a frame.
    pub fn steps(&self, frame: u32) -> impl Iterator<Item = &Step> {
        let all = self.0.iter();
        all.filter_map(move |(at, step)| (*at == frame).then_some(step))
    }
}

const HELP: &str = "orbit RIGHT UP (degrees), pan RIGHT UP (heights), zoom FACTOR, reset, open FILE|SCENE, \
    technique NAME,..., set TECHNIQUE.KEY=VALUE, edit WHAT.KEY=VALUE, play, pause, \
    walk, fly, go RIGHT FORWARD (at most 1), look RIGHT UP (degrees), jump, use, throw, lose-device";

fn parse_step(words: &[&str]) -> Option<(u32, Step)> {
    let (frame, rest) = words.split_first()?;
    let (&what, values) = rest.split_first()?;
    let number = |index: usize| {
        let value = values.get(index)?.parse::<f32>().ok()?;
        value.is_finite().then_some(value)
    };
    let pair = || Some(Vec2::new(number(0)?, number(1)?));
    let (count, step) = match what {
        "orbit" => (2, Step::Orbit(pair()?)),
        "pan" => (2, Step::Pan(pair()?)),
        "zoom" => (1, Step::Zoom(number(0).filter(|factor| *factor > 0.0)?)),
        "reset" => (0, Step::Reset),
        "open" => (1, Step::Open(values.first()?.to_string())),
        "technique" => {
            let names = values.first()?.split(',').map(str::to_owned);
            let names: Vec<String> = names.collect();
            (1, Step::Techniques(technique_names(&names)?))
        }
        "set" => {
            let (path, value) = values.first()?.split_once('=')?;
            let (technique, name) = path.split_once('.')?;
            (1, Step::Set([technique, name, value].map(str::to_owned)))
        }
        "edit" => (1, Step::Edit(values.first()?.to_string())),
        "play" => (0, Step::Play(true)),
        "pause" => (0, Step::Play(false)),
        "walk" => (0, Step::Walk(true)),
        "fly" => (0, Step::Walk(false)),
        "go" => (2, Step::Go(pair()?)),
        "look" => (2, Step::Look(pair()?)),
        "jump" => (0, Step::Jump),
        "use" => (0, Step::Operate),
        "throw" => (0, Step::Throw),
        "lose-device" => (0, Step::LoseDevice),
        _ => return None,
    };
    (values.len() == count).then_some((frame.parse().ok()?, step))
}

impl Step {
    /// Does it.
    ///
    /// # Errors
    /// Why it cannot be done.
    pub fn run(&self, viewer: &mut Viewer) -> Result<(), String> {
        if let Self::Open(name) = self {
            let file = PathBuf::from(name);
            if file.extension().is_some() {
                return viewer.open_file(&file, Files::default());
            }
            viewer.open(SceneArguments::of(name), &TechniqueSet::default());
            return Ok(());
        }
        if *self == Self::LoseDevice {
            viewer.lose_device();
            return Ok(());
        }
        if *self == Self::Throw {
            viewer.throw()?;
            // The ball leaves the hand before this frame, however long the upload takes. A page goes on meanwhile.
            #[cfg(not(target_arch = "wasm32"))]
            viewer.finish_opening()?;
            return Ok(());
        }
        let Some(session) = viewer.session() else {
            return Err("nothing is on show yet".into());
        };
        if let Self::Walk(true) = self {
            return session.walk(None);
        }
        if let Self::Techniques(names) = self {
            let set = TechniqueSet {
                names: Some(names.clone()),
                ..session.loaded().set.clone()
            };
            viewer.change_set(set);
            return Ok(());
        }
        let scene = session.loaded().scene();
        let done = match self {
            Self::Open(_) | Self::Techniques(_) | Self::Throw | Self::LoseDevice => Ok(()),
            Self::Walk(_) => {
                session.fly();
                Ok(())
            }
            Self::Go(way) => {
                session.intent.way = *way;
                Ok(())
            }
            Self::Look(degrees) => {
                session.camera.look(degrees.map(f32::to_radians));
                Ok(())
            }
            Self::Jump => {
                session.intent.jumps = true;
                Ok(())
            }
            Self::Operate => match session.operate() {
                true => Ok(()),
                false => return Err("there is nothing to use".into()),
            },
            Self::Orbit(degrees) => {
                session.camera.orbit(degrees.map(f32::to_radians));
                Ok(())
            }
            Self::Pan(heights) => {
                session.camera.pan(*heights);
                Ok(())
            }
            Self::Zoom(factor) => {
                session.camera.zoom(*factor);
                Ok(())
            }
            Self::Reset => {
                session.reset_camera();
                Ok(())
            }
            Self::Play(is_playing) => {
                session.clock.is_playing = *is_playing;
                Ok(())
            }
            Self::Set([technique, name, value]) => session.set(technique, name, value),
            Self::Edit(text) => {
                let edit = edits::edit_of(text, scene).map_err(|error| error.to_string())?;
                session.edit(&edit)
            }
        };
        done.map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_frames_and_steps() {
        let text = "# a walk\n0 play\n\n  3 orbit 10 -5\n3 go -0.5 1\n4 set shadow-map.taps=16\n5 edit light.1.position=0,2,-1\n";
        let Script(steps) = Script::parse(text).unwrap();
        let set = ["shadow-map", "taps", "16"].map(str::to_owned);
        assert_eq!(
            steps,
            [
                (0, Step::Play(true)),
                (3, Step::Orbit(Vec2::new(10.0, -5.0))),
                (3, Step::Go(Vec2::new(-0.5, 1.0))),
                (4, Step::Set(set)),
                (5, Step::Edit("light.1.position=0,2,-1".into())),
            ]
        );
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for wrong in [
            "jump",
            "1",
            "1 orbit 3",
            "1 orbit 3 nan",
            "1 zoom 0",
            "1 go",
            "1 walk 3",
            "1 play 3",
            "-1 play",
            "1 set taps=3",
            "1 edit",
        ] {
            let error = Script::parse(&format!("0 play\n{wrong}")).unwrap_err();
            assert!(error.starts_with("line 2:"), "{error}");
        }
    }
}
