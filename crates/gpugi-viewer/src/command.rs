//! The command line that renders what is seen.

use gpugi_scene::Scene;

use crate::session::Session;

/// `gpugi render` with the arguments for the picture that the session shows, in a window of `size` pixels.
pub fn command(session: &Session, size: [u32; 2]) -> String {
    let loaded = session.loaded();
    let mut words: Vec<String> = vec!["./gpugi".into(), "render".into()];
    words.extend(loaded.arguments.iter().cloned());
    let mut option = |name: &str, value: String| words.extend([name.to_owned(), value]);
    if session.clock.seconds != 0.0 {
        option("--time", session.clock.seconds.to_string());
    }
    option("--size", format!("{}x{}", size[0], size[1]));
    if let Some(camera) = session.camera.argument() {
        let is_default = |scene: &Scene| {
            let first = scene.cameras.first();
            first.is_none_or(|first| first.name.as_str() == camera)
        };
        if !is_default(&loaded.scene) || camera.contains('=') {
            option("--camera", camera);
        }
    }
    option("--exposure", session.display.exposure.to_string());
    option("--tone-map", session.display.tone_map.to_string());
    option("--technique", session.technique_names().join(","));
    for technique in loaded.renderer.techniques() {
        let values = technique.settings().to_json();
        for field in technique.settings().fields() {
            let value = &values[&field.name];
            if *value != field.default {
                let name = technique.info().name;
                let text = value
                    .as_str()
                    .map_or_else(|| value.to_string(), str::to_owned);
                option("--set", format!("{name}.{}={text}", field.name));
            }
        }
    }
    option("--samples", session.samples.to_string());
    option("-o", "picture.png".into());
    let quoted: Vec<String> = words.iter().map(|word| quoted(word)).collect();
    quoted.join(" ")
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
