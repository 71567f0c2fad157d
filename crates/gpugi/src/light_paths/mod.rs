//! The light that a technique adds: a light class and a pattern over Heckbert's path symbols ("Adaptive radiosity
//! textures for bidirectional ray tracing", 1990).
//!
//! The symbols are L light, D diffuse lobe, G glossy lobe, S ideal lobe, V scattering in a medium, E eye. A pattern is a
//! regular expression over them, such as `LS+[DG]E`, with `.`, classes (`[DG]`, `[^S]`), groups, `|`, `*`, `+`, `?` and counts up to 32 (`{2}`,
//! `{2,}`, `{2,4}`). It must match the whole path.

mod automaton;
mod pattern;
#[cfg(test)]
mod tests;

pub use automaton::PathAutomaton;
pub use pattern::PatternError;

use automaton::{joint, shortest_path};
use std::borrow::Cow;

/// Emitters and the sky seen directly by the eye. This light belongs to the frame, whatever the techniques.
pub const SEEN_DIRECTLY: &str = "LE";

/// All light paths.
const ALL: &str = "L.*E";

/// A light class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LightClass {
    /// Point, spot and directional lights.
    Punctual,
    /// Emissive triangles and media.
    Area,
    /// The environment.
    Environment,
}

impl LightClass {
    /// All light classes.
    pub const ALL: [Self; 3] = [Self::Punctual, Self::Area, Self::Environment];
}

impl std::fmt::Display for LightClass {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            Self::Punctual => "punctual",
            Self::Area => "area",
            Self::Environment => "environment",
        })
    }
}

/// Light paths that a technique adds.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct LightPaths {
    /// The class of the lights where the paths begin.
    pub class: LightClass,
    /// The pattern of the paths, such as `L[DG]E`.
    pub pattern: Cow<'static, str>,
}

impl LightPaths {
    /// The paths of a pattern that is known at compile time.
    pub const fn new(class: LightClass, pattern: &'static str) -> Self {
        Self {
            class,
            pattern: Cow::Borrowed(pattern),
        }
    }

    /// These paths, with `bounces` such as `S{1,2}` between the light and their first surface.
    pub fn after(&self, bounces: &str) -> Self {
        let rest = self.pattern.strip_prefix('L').unwrap_or(&self.pattern);
        Self {
            class: self.class,
            pattern: Cow::Owned(format!("L{bounces}{rest}")),
        }
    }

    /// These paths, continued over further `bounces` such as `S{1,2}` before they reach the eye.
    pub fn continued(&self, bounces: &str) -> Self {
        let before = self.pattern.strip_suffix('E').unwrap_or(&self.pattern);
        Self {
            class: self.class,
            pattern: Cow::Owned(format!("{before}{bounces}E")),
        }
    }
}

/// Light that comes from the environment or an area light straight to the eye.
pub(crate) const SEEN_LIGHTS: [LightPaths; 2] = [
    LightPaths::new(LightClass::Environment, SEEN_DIRECTLY),
    LightPaths::new(LightClass::Area, SEEN_DIRECTLY),
];

/// The paths `before` as objects show them that have smooth lobes, rough ones or both, over 1 to `most` bounces.
pub(crate) fn shown(
    before: &[LightPaths],
    [smooth, rough]: [bool; 2],
    most: u32,
) -> impl Iterator<Item = LightPaths> {
    let lobes = match (smooth, rough) {
        (true, true) => "[GS]",
        (false, _) => "G",
        (true, false) => "S",
    };
    let bounces = format!("{lobes}{{1,{most}}}");
    before.iter().map(move |paths| paths.continued(&bounces))
}

/// The paths that a path tracer keeps. The default is all paths from a light to the eye.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PathFilter {
    pattern: String,
    automaton: PathAutomaton,
    light_automaton: PathAutomaton,
}

impl PathFilter {
    /// Compiles a pattern into a filter, for both orders of reading, so that a pattern that is too complex in one of
    /// them is refused in every scene.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn new(pattern: &str) -> Result<Self, PatternError> {
        Ok(Self {
            automaton: PathAutomaton::compile(pattern)?,
            light_automaton: PathAutomaton::compile_from_light(pattern)?,
            pattern: pattern.to_owned(),
        })
    }

    /// The original pattern.
    pub fn pattern(&self) -> &str {
        &self.pattern
    }

    /// The compiled pattern.
    pub fn automaton(&self) -> &PathAutomaton {
        &self.automaton
    }

    /// The compiled pattern, read from the light to the eye.
    pub(crate) fn light_automaton(&self) -> &PathAutomaton {
        &self.light_automaton
    }

    /// Whether the filter keeps a path of which the light's automaton has read one end, and the eye's the other: for each
    /// state of the former, and each of the latter.
    pub(crate) fn joint(&self) -> Vec<bool> {
        joint(&self.light_automaton, &self.automaton)
    }
}

impl Default for PathFilter {
    fn default() -> Self {
        Self::new(ALL).expect("a pattern")
    }
}

impl std::str::FromStr for PathFilter {
    type Err = PatternError;

    fn from_str(pattern: &str) -> Result<Self, PatternError> {
        Self::new(pattern)
    }
}

/// A shortest path that both sets contain, with its light class.
///
/// # Panics
/// If a pattern is invalid. Techniques declare their patterns as constants, which a test compiles.
pub fn overlap(a: &[LightPaths], b: &[LightPaths]) -> Option<(LightClass, String)> {
    LightClass::ALL
        .into_iter()
        .filter_map(|class| {
            let first = automata(a, class);
            let both: Vec<_> = first.iter().cloned().chain(automata(b, class)).collect();
            let path = shortest_path(&both, |accepted| {
                let (a, b) = accepted.split_at(first.len());
                a.contains(&true) && b.contains(&true)
            })?;
            Some((class, path))
        })
        .min_by_key(|(_, path)| path.len())
}

/// The largest n for which the paths `LSDE`, `LSSDE`, ... with up to n ideal surfaces are all in a set: 0 if it has no
/// caustics of lights of `class`.
///
/// # Panics
/// See [`overlap`].
pub fn caustic_depth(covered: &[LightPaths], class: LightClass) -> u32 {
    let is_covered = |surfaces: &u32| {
        let light = LightPaths::new(class, "LE");
        overlap(covered, &[light.continued(&format!("S{{{surfaces}}}D"))]).is_some()
    };
    (1..=pattern::MAX_COUNT)
        .take_while(is_covered)
        .last()
        .unwrap_or(0)
}

/// Describes the light that a set of techniques leaves out, for the light classes that a scene has and for the `lobes`
/// of its surfaces and media, some of `DGSV`. Each entry is a few words for human readers.
///
/// # Panics
/// See [`overlap`].
pub fn left_out(covered: &[LightPaths], present: &[LightClass], lobes: &str) -> Vec<String> {
    let mut missing = Vec::new();
    if lobes.is_empty() {
        return missing;
    }
    for &class in present {
        let shortest_missing = |pattern: &str| {
            let mut all = vec![compiled(pattern)];
            all.extend(automata(covered, class));
            shortest_path(&all, |accepted| {
                accepted[0] && !accepted[1..].contains(&true)
            })
        };
        let direct = lobes.chars().map(|lobe| format!("L{lobe}E"));
        let direct: Vec<String> = direct.filter_map(|path| shortest_missing(&path)).collect();
        if !direct.is_empty() {
            missing.push(format!("{} ({class})", direct.join(", ")));
        }
        if let Some(path) = shortest_missing(&format!("L[{lobes}]{{2,}}E")) {
            missing.push(format!("indirect light, such as {path} ({class})"));
        }
    }
    missing
}

/// Kinds of light in words, each with its shortest path.
const WORDS: [(&str, &str); 9] = [
    ("LDE", "direct light on diffuse surfaces"),
    ("LGE", "highlights of lights on glossy surfaces"),
    ("LSE", "lights seen in mirrors and through glass"),
    ("LDDE", "light reflected between diffuse surfaces"),
    ("LSDE", "caustics"),
    ("LDGE", "lit surroundings seen in gloss"),
    ("LDSE", "lit surroundings seen in mirrors and through glass"),
    ("LVE", "light scattered once by media"),
    ("LVVE", "light scattered repeatedly by media"),
];

/// Describes light paths in words for human readers, with the light classes of each kind of light among `present`:
/// `caustics (area)`.
///
/// # Panics
/// See [`overlap`].
pub fn in_words(paths: &[LightPaths], present: &[LightClass]) -> Vec<String> {
    let words = WORDS.iter().filter_map(|&(path, words)| {
        let is_added =
            |class: &&LightClass| overlap(paths, &[LightPaths::new(**class, path)]).is_some();
        let classes: Vec<String> = present
            .iter()
            .filter(is_added)
            .map(LightClass::to_string)
            .collect();
        (!classes.is_empty()).then(|| format!("{words} ({})", classes.join(", ")))
    });
    words.collect()
}

/// The whole light of a scene with these light classes, as one part.
pub fn all_light(present: &[LightClass]) -> Part {
    Part {
        classes: present.to_vec(),
        pattern: ALL.to_owned(),
    }
}

/// A part of an image's light: light classes whose paths match one pattern.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Part {
    /// The classes of the lights where the paths begin.
    pub classes: Vec<LightClass>,
    /// The pattern of the paths, the same for each class.
    pub pattern: String,
}

/// The smallest set of parts that makes up an image of the `covered` paths and directly seen light, for the light
/// classes that a scene has.
///
/// # Panics
/// See [`overlap`].
pub fn parts(covered: &[LightPaths], present: &[LightClass]) -> Vec<Part> {
    let mut parts: Vec<(PathAutomaton, Part)> = Vec::new();
    for &class in present {
        let mut patterns = vec![SEEN_DIRECTLY];
        for paths in covered.iter().filter(|paths| paths.class == class) {
            if !patterns.contains(&&*paths.pattern) {
                patterns.push(&paths.pattern);
            }
        }
        let pattern = patterns.join("|");
        let automaton = compiled(&pattern);
        let means_the_same = |other: &PathAutomaton| {
            let both = [automaton.clone(), other.clone()];
            shortest_path(&both, |accepted| accepted[0] != accepted[1]).is_none()
        };
        match parts.iter_mut().find(|(other, _)| means_the_same(other)) {
            Some((_, part)) => part.classes.push(class),
            None => {
                let classes = vec![class];
                parts.push((automaton, Part { classes, pattern }));
            }
        }
    }
    parts.into_iter().map(|(_, part)| part).collect()
}

/// The compiled patterns of one light class in a set.
fn automata(set: &[LightPaths], class: LightClass) -> Vec<PathAutomaton> {
    set.iter()
        .filter(|paths| paths.class == class)
        .map(|paths| compiled(&paths.pattern))
        .collect()
}

fn compiled(pattern: &str) -> PathAutomaton {
    PathAutomaton::compile(pattern).unwrap_or_else(|error| panic!("{pattern}: {error}"))
}
