//! What is seen, in words: the command line that renders it, the address of the page that shows it, and a file that
//! opens it.

use gpugi_arguments::NO_TECHNIQUE;
use gpugi_scene::Scene;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use serde_json::Value;

use crate::arguments::{REPEATED, SCENE};
use crate::session::Session;
use crate::technique_set::PATH_TRACER;
use crate::viewer::Look;

/// What addresses hold as it is.
const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC
    .remove(b'-')
    .remove(b'_')
    .remove(b'.')
    .remove(b',')
    .remove(b':')
    .remove(b';')
    .remove(b'=')
    .remove(b'/')
    .remove(b'*');

/// `gpugi render` with the arguments for the picture that the session shows, in a window of `size` pixels.
pub fn command(session: &Session, size: [u32; 2]) -> String {
    let mut words: Vec<String> = vec!["./gpugi".into(), "render".into()];
    words.extend(session.loaded().arguments.iter().cloned());
    let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    option("size", format!("{}x{}", size[0], size[1]));
    for (name, value) in options(session) {
        option(name, value);
    }
    option("samples", session.samples.to_string());
    words.extend(["-o".into(), "picture.png".into()]);
    let quoted: Vec<String> = words.iter().map(|word| quoted(word)).collect();
    quoted.join(" ")
}

/// A view file, which opens what the session shows: JSON, an object with the scene and the options of `gpugi view`
/// ([`crate::arguments::of_view_file`]). Options that may be repeated have a list.
pub fn view_file(session: &Session) -> String {
    let mut view = serde_json::Map::new();
    for (name, value) in seen(session) {
        if REPEATED.contains(&name.as_str()) {
            let list = view.entry(name).or_insert_with(|| Value::Array(Vec::new()));
            if let Value::Array(list) = list {
                list.push(value.into());
            }
        } else {
            view.insert(name, value.into());
        }
    }
    format!("{:#}\n", Value::Object(view))
}

/// What follows `#` in the address of a page that shows what the session shows ([`crate::arguments::of_address`]).
pub fn address(session: &Session) -> String {
    let part = |(name, value): (String, String)| {
        format!("{name}={}", utf8_percent_encode(&value, ESCAPED))
    };
    let parts: Vec<String> = seen(session).into_iter().map(part).collect();
    parts.join("&")
}

/// The scene and the options of `gpugi view` that show what the session shows.
fn seen(session: &Session) -> Vec<(String, String)> {
    let words = &session.loaded().arguments;
    let mut seen = vec![(SCENE.to_owned(), words[0].clone())];
    for option in words[1..].chunks_exact(2) {
        let name = option[0].trim_start_matches('-');
        seen.push((name.to_owned(), option[1].clone()));
    }
    let options = options(session).into_iter();
    seen.extend(options.map(|(name, value)| (name.to_owned(), value)));
    if session.samples != session.loaded().set.default_samples() {
        seen.push(("samples".into(), session.samples.to_string()));
    }
    if session.pace.target_rate != Look::default().frame_rate {
        seen.push(("frame-rate".into(), session.pace.target_rate.to_string()));
    }
    seen
}

/// The options that tell the session's picture from that of its scene alone.
fn options(session: &Session) -> Vec<(&'static str, String)> {
    let loaded = session.loaded();
    let edits = session.edits().into_iter();
    let mut options: Vec<_> = edits.map(|edit| ("edit", edit)).collect();
    if session.clock.seconds != 0.0 {
        options.push(("time", session.clock.seconds.to_string()));
    }
    if let Some(camera) = session.camera.argument(loaded.scene()) {
        let is_default = |scene: &Scene| {
            let first = scene.cameras.first();
            first.is_none_or(|first| first.name.as_str() == camera)
        };
        if !is_default(loaded.scene()) || camera.contains('=') {
            options.push(("camera", camera));
        }
    }
    options.push(("exposure", session.effects.exposure.value.to_string()));
    options.push(("tone-map", session.effects.tone_map.operator.to_string()));
    let names = match &session.technique_names()[..] {
        [] => NO_TECHNIQUE.to_owned(),
        names => names.join(","),
    };
    options.push(("technique", names));
    for technique in loaded.renderer.techniques() {
        let values = technique.settings().to_json();
        for field in technique.settings().fields() {
            let value = &values[&field.name];
            if *value != field.default {
                let name = technique.info().name;
                let text = value
                    .as_str()
                    .map_or_else(|| value.to_string(), str::to_owned);
                options.push(("set", format!("{name}.{}={text}", field.name)));
            }
        }
    }
    if loaded.set.is_path_tracer() {
        let settings = loaded.set.settings.get(PATH_TRACER).into_iter().flatten();
        let settings = settings.map(|(name, value)| format!("{PATH_TRACER}.{name}={value}"));
        options.extend(settings.map(|setting| ("set", setting)));
    }
    options
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let is_plain =
        |character: char| character.is_ascii_alphanumeric() || "-_./,=:@+".contains(character);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_special_characters_are_quoted() {
        assert_eq!(quoted("--size"), "--size");
        assert_eq!(quoted("eye=1,2,3;fov=35"), "'eye=1,2,3;fov=35'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
