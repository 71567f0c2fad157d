//! Which light a technique adds: a class of lights and a pattern over Heckbert's path symbols ("Adaptive radiosity textures for
//! bidirectional ray tracing", 1990).
//!
//! L light, D diffuse lobe, G glossy lobe, S ideal lobe, E eye. A pattern is a regular expression over them, such as `LS+[DG]E`,
//! with `.`, classes (`[DG]`, `[^S]`), groups, `|`, `*`, `+`, `?` and counts up to 32 (`{2}`, `{2,}`, `{2,4}`); it describes whole
//! paths.

mod automaton;
mod pattern;
#[cfg(test)]
mod tests;

pub use automaton::PathAutomaton;
pub use pattern::PatternError;

use automaton::shortest_path;
use std::borrow::Cow;

/// What emitters and the sky send straight to the eye: belongs to the frame, whatever the techniques.
pub const SEEN_DIRECTLY: &str = "LE";

/// A class of lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LightClass {
    /// Point, spot and directional lights.
    Punctual,
    /// Emissive triangles.
    Area,
    /// The environment.
    Environment,
}

impl LightClass {
    /// All classes.
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

/// Paths of light that a technique adds.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct LightPaths {
    /// Where they begin.
    pub class: LightClass,
    /// Which they are, such as `L[DG]E`.
    pub pattern: Cow<'static, str>,
}

impl LightPaths {
    /// The paths of a pattern that is known when the program is made.
    pub const fn new(class: LightClass, pattern: &'static str) -> Self {
        Self {
            class,
            pattern: Cow::Borrowed(pattern),
        }
    }

    /// These paths on their way over `bounces` more before they come to the eye, such as `S{1,2}`.
    pub fn continued(&self, bounces: &str) -> Self {
        let before = self.pattern.strip_suffix('E').unwrap_or(&self.pattern);
        Self {
            class: self.class,
            pattern: Cow::Owned(format!("{before}{bounces}E")),
        }
    }
}

/// The paths that a path tracer keeps: all from a light to the eye, unless another pattern is given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PathFilter {
    pattern: String,
    automaton: PathAutomaton,
}

impl PathFilter {
    /// The filter of a pattern.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn new(pattern: &str) -> Result<Self, PatternError> {
        Ok(Self {
            automaton: PathAutomaton::compile(pattern)?,
            pattern: pattern.to_owned(),
        })
    }

    /// The pattern as it was given.
    pub fn pattern(&self) -> &str {
        &self.pattern
    }

    /// The pattern compiled.
    pub fn automaton(&self) -> &PathAutomaton {
        &self.automaton
    }
}

impl Default for PathFilter {
    fn default() -> Self {
        Self::new("L.*E").expect("a pattern")
    }
}

impl std::str::FromStr for PathFilter {
    type Err = PatternError;

    fn from_str(pattern: &str) -> Result<Self, PatternError> {
        Self::new(pattern)
    }
}

/// A shortest path that both sets contain.
///
/// # Panics
/// When a pattern is none: techniques declare theirs as constants, which a test compiles.
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

/// The shortest path in a set that no path from the eye finds: from light without extent to a mirror or glass, which sends a ray past it.
///
/// # Panics
/// As [`overlap`].
pub fn never_found(covered: &[LightPaths]) -> Option<String> {
    let punctual = LightPaths::new(LightClass::Punctual, "LS[DGS]*E");
    overlap(covered, &[punctual]).map(|(_, path)| path)
}

/// What a set of techniques leaves out, for the classes of light that a scene has: a few words each, for people.
///
/// # Panics
/// As [`overlap`].
pub fn left_out(covered: &[LightPaths], present: &[LightClass]) -> Vec<String> {
    let mut missing = Vec::new();
    for &class in present {
        let is_missing = |pattern: &str| {
            let mut all = vec![compiled(pattern)];
            all.extend(automata(covered, class));
            shortest_path(&all, |accepted| {
                accepted[0] && !accepted[1..].contains(&true)
            })
            .is_some()
        };
        let direct: Vec<_> = ["LDE", "LGE", "LSE"]
            .into_iter()
            .filter(|path| is_missing(path))
            .collect();
        if !direct.is_empty() {
            missing.push(format!("{} ({class})", direct.join(", ")));
        }
        if is_missing("L[DGS][DGS]+E") {
            missing.push(format!("indirect light, L[DGS][DGS]+E ({class})"));
        }
    }
    missing
}

/// A part of a picture's light: classes of lights whose paths match one pattern.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Part {
    /// Where the paths begin.
    pub classes: Vec<LightClass>,
    /// Which they are: for each class the same.
    pub pattern: String,
}

/// The fewest parts that make up a picture with the paths in `covered` and what is seen directly, of the classes of light that a scene has.
///
/// # Panics
/// As [`overlap`].
pub fn parts(covered: &[LightPaths], present: &[LightClass]) -> Vec<Part> {
    let mut parts: Vec<(PathAutomaton, Part)> = Vec::new();
    for &class in present {
        let mut patterns = vec![SEEN_DIRECTLY];
        for one in covered.iter().filter(|one| one.class == class) {
            if !patterns.contains(&&*one.pattern) {
                patterns.push(&one.pattern);
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

/// The patterns of one class in a set, compiled.
fn automata(set: &[LightPaths], class: LightClass) -> Vec<PathAutomaton> {
    set.iter()
        .filter(|one| one.class == class)
        .map(|one| compiled(&one.pattern))
        .collect()
}

fn compiled(pattern: &str) -> PathAutomaton {
    PathAutomaton::compile(pattern).unwrap_or_else(|error| panic!("{pattern}: {error}"))
}
