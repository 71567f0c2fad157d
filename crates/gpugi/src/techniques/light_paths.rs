//! Which light a technique adds: a class of lights and a pattern over Heckbert's path symbols.
//!
//! L light, D diffuse lobe, G glossy lobe, S ideal lobe, E eye. A pattern is a sequence of symbols, `.`, or classes such as `[DG]`, each
//! with an optional `+` or `*`.

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct LightPaths {
    /// Where they begin.
    pub class: LightClass,
    /// Which they are, such as `L[DG]E`.
    pub pattern: &'static str,
}

/// Whether `pattern` describes the whole of `path`.
pub fn matches(pattern: &str, path: &str) -> bool {
    let Some((symbols, repeat, rest)) = first_element(pattern) else {
        return path.is_empty();
    };
    let fits = |symbol: char| symbols.contains('.') || symbols.contains(symbol);
    let step = path
        .chars()
        .next()
        .filter(|&symbol| fits(symbol))
        .map(|symbol| &path[symbol.len_utf8()..]);
    match repeat {
        None => step.is_some_and(|after| matches(rest, after)),
        Some('*') => matches(rest, path) || step.is_some_and(|after| matches(pattern, after)),
        // One or more: one, then the rest or more of the same.
        Some(_) => step.is_some_and(|after| matches(rest, after) || matches(pattern, after)),
    }
}

/// Splits a pattern after its first element: the symbols it allows, its repetition, the rest.
fn first_element(pattern: &str) -> Option<(&str, Option<char>, &str)> {
    let first = pattern.chars().next()?;
    let (symbols, rest) = if first == '[' {
        let end = pattern.find(']')?;
        (&pattern[1..end], &pattern[end + 1..])
    } else {
        pattern.split_at(first.len_utf8())
    };
    match rest.chars().next() {
        Some(repeat @ ('+' | '*')) => Some((symbols, Some(repeat), &rest[1..])),
        _ => Some((symbols, None, rest)),
    }
}

/// Every path with at most `bounces` bounces.
fn paths(bounces: usize) -> Vec<String> {
    let mut middles = vec![String::new()];
    let mut longest = vec![String::new()];
    for _ in 0..bounces {
        longest = longest
            .iter()
            .flat_map(|path| ['D', 'G', 'S'].map(|symbol| format!("{path}{symbol}")))
            .collect();
        middles.extend(longest.iter().cloned());
    }
    middles
        .into_iter()
        .map(|middle| format!("L{middle}E"))
        .collect()
}

/// A path that both sets contain, up to four bounces.
pub fn overlap(a: &[LightPaths], b: &[LightPaths]) -> Option<(LightClass, String)> {
    paths(4).into_iter().find_map(|path| {
        let covers = |set: &[LightPaths], class| {
            set.iter()
                .any(|one| one.class == class && matches(one.pattern, &path))
        };
        let class = LightClass::ALL
            .into_iter()
            .find(|&class| covers(a, class) && covers(b, class))?;
        Some((class, path.clone()))
    })
}

/// What a set of techniques leaves out, for the classes of light that a scene has: a few words each, for people.
pub fn left_out(covered: &[LightPaths], present: &[LightClass]) -> Vec<String> {
    let mut missing = Vec::new();
    for &class in present {
        let is_covered = |path: &str| {
            path == "LE"
                || covered
                    .iter()
                    .any(|one| one.class == class && matches(one.pattern, path))
        };
        let absent: Vec<String> = paths(1)
            .into_iter()
            .filter(|path| !is_covered(path))
            .collect();
        if !absent.is_empty() {
            missing.push(format!("{} ({class})", absent.join(", ")));
        }
        if paths(2)
            .iter()
            .filter(|path| path.len() == 4)
            .any(|path| !is_covered(path))
        {
            missing.push(format!("indirect light, L[DGS][DGS]+E ({class})"));
        }
    }
    missing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_describe_whole_paths() {
        for (pattern, path, expected) in [
            ("L[DG]E", "LDE", true),
            ("L[DG]E", "LGE", true),
            ("L[DG]E", "LSE", false),
            ("L[DG]E", "LDDE", false),
            ("LDD+E", "LDE", false),
            ("LDD+E", "LDDDE", true),
            ("LS+[DG]E", "LSSDE", true),
            ("L.*SE", "LSE", true),
            ("L.*SE", "LDGSE", true),
            ("L.*SE", "LSDE", false),
        ] {
            assert_eq!(matches(pattern, path), expected, "{pattern} on {path}");
        }
    }

    #[test]
    fn overlapping_sets_are_found_by_class() {
        let set = |class, pattern| [LightPaths { class, pattern }];
        let direct = set(LightClass::Punctual, "L[DG]E");
        assert_eq!(
            overlap(&direct, &set(LightClass::Punctual, "L.E")),
            Some((LightClass::Punctual, "LDE".to_owned()))
        );
        assert_eq!(overlap(&direct, &set(LightClass::Area, "L.E")), None);
        assert_eq!(overlap(&direct, &set(LightClass::Punctual, "LDD+E")), None);
    }

    #[test]
    fn what_is_left_out_is_named() {
        let direct = [LightPaths {
            class: LightClass::Area,
            pattern: "L[DG]E",
        }];
        assert_eq!(
            left_out(&direct, &[LightClass::Area]),
            ["LSE (area)", "indirect light, L[DGS][DGS]+E (area)"]
        );
    }
}
