//! Files in memory: a page has no file system, and opens what people drop on it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use gpugi_scene::Resolver;
use serde::{Deserialize, Serialize};

/// Files by name. They lie in one folder: what refers to them may name other folders, too.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Files(BTreeMap<String, Arc<File>>);

#[derive(Debug, Serialize, Deserialize)]
struct File(#[serde(with = "gpugi_scene::plain")] Vec<u8>);

impl Files {
    /// The content of a file.
    pub fn get(&self, name: &str) -> Option<&[u8]> {
        self.0.get(name).map(|file| &file.0[..])
    }

    /// Adds a file.
    pub fn insert(&mut self, name: String, bytes: Vec<u8>) {
        self.0.insert(name, Arc::new(File(bytes)));
    }

    /// What is to be opened: a view file, which names its scene, or else a scene, or else an image.
    pub fn main(&self) -> Option<&str> {
        let first = |extensions: &[&str]| self.0.keys().find(|name| is_one_of(name, extensions));
        let named = first(&["json"]).or_else(|| first(&["gltf", "glb", "obj", "ply"]));
        named.or_else(|| self.0.keys().next()).map(String::as_str)
    }
}

/// Whether a file's extension is one of `extensions`.
fn is_one_of(file: &str, extensions: &[&str]) -> bool {
    let extension = Path::new(file).extension();
    let extension = extension.unwrap_or_default().to_string_lossy();
    extensions
        .iter()
        .any(|known| extension.eq_ignore_ascii_case(known))
}

impl Resolver for Files {
    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        let name = uri.rsplit('/').next().unwrap_or(uri);
        let bytes = self.get(name).map(<[u8]>::to_vec);
        bytes.ok_or_else(|| "it was not dropped together with the scene".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_argument::{SceneArguments, load_among};

    /// A triangle that refers to its positions.
    const TRIANGLE: &str = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"uri":"data/positions.bin","byteLength":36}]}"#;

    #[test]
    fn a_view_file_goes_before_its_scene_and_that_before_images() {
        let mut files = Files::default();
        for name in ["a.hdr", "b.GLB", "c.JSON"] {
            files.insert(name.into(), Vec::new());
        }
        assert_eq!(files.main(), Some("c.JSON"));
        files.0.remove("c.JSON");
        assert_eq!(files.main(), Some("b.GLB"));
        files.0.remove("b.GLB");
        assert_eq!(files.main(), Some("a.hdr"));
    }

    #[test]
    fn a_scene_and_what_it_refers_to_are_found_by_name() {
        let mut files = Files::default();
        files.insert("a.hdr".into(), b"an image".to_vec());
        files.insert("triangle.gltf".into(), TRIANGLE.as_bytes().to_vec());
        assert_eq!(files.main(), Some("triangle.gltf"));
        let arguments = SceneArguments::of("triangle.gltf");
        let error = load_among(&arguments, &files).unwrap_err();
        assert!(format!("{error:#}").contains("not dropped"), "{error:#}");
        let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let positions = corners.iter().flat_map(|value| value.to_le_bytes());
        files.insert("positions.bin".into(), positions.collect());
        let (scene, notes) = load_among(&arguments, &files).unwrap();
        assert_eq!(scene.instances.len(), 1);
        let is_lit = notes.iter().any(|note| note.contains("default sky"));
        assert!(is_lit, "{notes:?}");
        // Broken images say so by their name.
        let lit = SceneArguments {
            environment: Some("a.hdr".into()),
            ..arguments
        };
        let error = load_among(&lit, &files).unwrap_err();
        assert!(format!("{error:#}").contains("a.hdr"), "{error:#}");
    }
}
