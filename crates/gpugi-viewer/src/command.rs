//! What is seen, in words: the command line that renders it, the address of the page that shows it, and a file that
//! opens it.

use gpugi::picture::Effects;
use gpugi::settings::{Field, SettingSet};
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
    for (name, value) in options(session, &STILL_EFFECTS) {
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
    let options = options(session, &Effects::NAMES).into_iter();
    seen.extend(options.map(|(name, value)| (name.to_owned(), value)));
    if session.samples != session.loaded().set.default_samples() {
        seen.push(("samples".into(), session.samples.to_string()));
    }
    if session.pace.target_rate != Look::default().frame_rate {
        seen.push(("frame-rate".into(), session.pace.target_rate.to_string()));
    }
    if let Some(height) = session.eye_height() {
        seen.push(("walk".into(), height.to_string()));
    }
    seen
}

/// Effects of a still picture: it has no frame before it.
const STILL_EFFECTS: [&str; 6] = [
    "glow", "flare", "vignette", "exposure", "tone-map", "encode",
];

/// What `--set` takes to make the effects with these names those of the session, where no shorter option does.
fn effects(session: &Session, names: &[&str]) -> Vec<String> {
    let shorter = ["exposure.value=", "tone-map.operator="];
    let (at_first, now) = (Effects::of_live_view(), session.effects.all());
    let changed = at_first.all().into_iter().zip(now);
    let changed = changed.filter(|((name, _), _)| names.contains(name));
    changed
        .flat_map(|((name, before), (_, now))| {
            let before = before.to_json();
            set(name, now, |field| before[&field.name].clone())
        })
        .filter(|setting| !shorter.iter().any(|option| setting.starts_with(option)))
        .collect()
}

/// What `--set` takes to give `settings`, of a technique or an effect, their values, where these are not those of `before`.
fn set(owner: &str, settings: &dyn SettingSet, before: impl Fn(&Field) -> Value) -> Vec<String> {
    let values = settings.to_json();
    let fields = settings.fields().iter();
    let changed = fields.filter(|field| values[&field.name] != before(field));
    changed
        .map(|field| {
            let value = &values[&field.name];
            let text = value
                .as_str()
                .map_or_else(|| value.to_string(), str::to_owned);
            format!("{owner}.{}={text}", field.name)
        })
        .collect()
}

/// The options that tell the session's picture from that of its scene alone, with the effects of these names.
fn options(session: &Session, names_of_effects: &[&str]) -> Vec<(&'static str, String)> {
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
    let effects = effects(session, names_of_effects).into_iter();
    options.extend(effects.map(|setting| ("set", setting)));
    let names = match &session.technique_names()[..] {
        [] => NO_TECHNIQUE.to_owned(),
        names => names.join(","),
    };
    options.push(("technique", names));
    for technique in loaded.renderer.techniques() {
        let defaults = |field: &Field| field.default.clone();
        let set = set(technique.info().name, technique.settings(), defaults);
        options.extend(set.into_iter().map(|setting| ("set", setting)));
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
