//! Names of objects, and lists of them in options: comma-separated, with `*` as a wildcard for any characters.

use std::borrow::Borrow;
use std::fmt::{Debug, Display, Formatter};
use std::ops::Deref;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A name. Copies share its text, because a file may give one long name to very many objects.
#[derive(Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Name(Arc<str>);

impl Name {
    /// The text.
    pub fn as_str(&self) -> &str {
        self
    }

    /// The longest name of which copies are made (bytes).
    pub(crate) const LONGEST: usize = 256;

    /// Its beginning, for files in which each object has a copy.
    pub(crate) fn beginning(&self) -> &str {
        &self[..self.floor_char_boundary(Self::LONGEST)]
    }

    /// The name of a part of what has this name. Long names are shared by all parts, without the suffix.
    pub(crate) fn with(&self, suffix: &str) -> Self {
        if self.len() + suffix.len() > Self::LONGEST {
            self.clone()
        } else {
            format!("{self}{suffix}").into()
        }
    }
}

impl Default for Name {
    fn default() -> Self {
        Self("".into())
    }
}

impl Deref for Name {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl Borrow<str> for Name {
    fn borrow(&self) -> &str {
        self
    }
}

impl From<&str> for Name {
    fn from(name: &str) -> Self {
        Self(name.into())
    }
}

impl From<String> for Name {
    fn from(name: String) -> Self {
        Self(name.into())
    }
}

impl PartialEq<str> for Name {
    fn eq(&self, other: &str) -> bool {
        **self == *other
    }
}

impl PartialEq<&str> for Name {
    fn eq(&self, other: &&str) -> bool {
        **self == **other
    }
}

impl Debug for Name {
    fn fmt(&self, formatter: &mut Formatter) -> std::fmt::Result {
        Debug::fmt(&**self, formatter)
    }
}

impl Display for Name {
    fn fmt(&self, formatter: &mut Formatter) -> std::fmt::Result {
        Display::fmt(&**self, formatter)
    }
}

impl Serialize for Name {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self)
    }
}

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(Self::from)
    }
}

/// A list contains a name that does not exist.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no object of the scene is called {name:?}; there are: {known}")]
pub struct UnknownObject {
    /// The name or pattern in question.
    pub name: String,
    /// The names that exist, abbreviated if there are many.
    pub known: String,
}

/// Whether `list` names `name`. A list holds comma-separated names in which `*` stands for any characters.
pub fn is_named_by(name: &str, list: &str) -> bool {
    patterns(list).any(|pattern| matches(pattern, name))
}

/// Checks that each name in `list` matches at least one name in `known`.
///
/// # Errors
/// [`UnknownObject`]: the first name that matches none.
pub fn check_names<'a>(
    list: &str,
    known: impl Iterator<Item = &'a str> + Clone,
) -> Result<(), UnknownObject> {
    let is_unknown = |pattern: &&str| !known.clone().any(|name| matches(pattern, name));
    match patterns(list).find(is_unknown) {
        None => Ok(()),
        Some(unknown) => Err(UnknownObject {
            name: unknown.to_owned(),
            known: enumerate(known),
        }),
    }
}

/// The known names, sorted; if there are many, only the first few and a count of the others.
fn enumerate<'a>(known: impl Iterator<Item = &'a str>) -> String {
    const MOST: usize = 12;
    let mut known: Vec<&str> = known.collect();
    known.sort_unstable();
    known.dedup();
    let more = known.len().saturating_sub(MOST);
    known.truncate(MOST);
    let mut list = known.join(", ");
    if more > 0 {
        list += &format!(" and {more} more");
    }
    list
}

fn patterns(list: &str) -> impl Iterator<Item = &str> {
    list.split(',')
        .map(str::trim)
        .filter(|pattern| !pattern.is_empty())
}

/// Whether `pattern`, in which `*` stands for any characters, matches the whole of `name`.
fn matches(pattern: &str, name: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else {
        return pattern == name;
    };
    let Some(mut name) = name.strip_prefix(start) else {
        return false;
    };
    let mut parts: Vec<&str> = rest.split('*').collect();
    let end = parts.pop().unwrap_or("");
    for part in parts {
        // The first match is as good as any, because a `*` follows.
        match name.find(part) {
            Some(at) => name = &name[at + part.len()..],
            None => return false,
        }
    }
    name.ends_with(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_stands_for_any_characters() {
        for (pattern, name, expected) in [
            ("ball", "ball", true),
            ("ball", "balls", false),
            ("ball*", "balls", true),
            ("*all", "ball", true),
            ("b*l", "ball", true),
            ("b*l*", "ball of glass", true),
            ("b*x", "ball", false),
            ("*a*a*", "ball", false),
            ("*", "", true),
            ("", "ball", false),
            ("ball*ball", "ball", false),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} against {name}");
        }
    }

    #[test]
    fn lists_name_what_any_of_their_names_describes() {
        for (list, name, expected) in [
            ("box, ball*", "balls", true),
            ("box, ball*", "box", true),
            ("box, ball*", "boxes", false),
            ("box,", "", false),
            ("", "", false),
        ] {
            assert_eq!(is_named_by(name, list), expected, "{list} against {name}");
        }
    }

    #[test]
    fn unknown_names_are_said_with_those_there_are() {
        let known = || ["box", "ball", "ball"].into_iter();
        assert_eq!(check_names("ball, b*x,", known()), Ok(()));
        let unknown = check_names("ball, sphere, cube", known()).unwrap_err();
        assert_eq!(
            unknown.to_string(),
            "no object of the scene is called \"sphere\"; there are: ball, box"
        );
        let many: Vec<String> = (10..40).map(|number| format!("thing {number}")).collect();
        let unknown = check_names("x", many.iter().map(String::as_str)).unwrap_err();
        assert!(unknown.known.ends_with("thing 21 and 18 more"), "{unknown}");
    }
}
