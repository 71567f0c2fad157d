//! Small glTF files made in code.

use std::collections::HashMap;

use gpugi_scene::{ImportError, Limits, Resolver, Scene, import};
use serde_json::{Map, Value, json};

/// glTF's number for 32-bit floats.
pub const FLOAT: u32 = 5126;
/// glTF's number for unsigned 16-bit integers.
pub const U16: u32 = 5123;

/// Files in memory.
#[derive(Default)]
pub struct Files(pub HashMap<String, Vec<u8>>);

impl Resolver for Files {
    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        self.0.get(uri).cloned().ok_or("no such file".to_owned())
    }
}

/// A glTF file under construction, with one buffer.
#[derive(Clone)]
pub struct File {
    pub json: Value,
    pub binary: Vec<u8>,
}

impl File {
    /// No nodes, no meshes.
    pub fn empty() -> Self {
        Self {
            json: json!({ "asset": { "version": "2.0" } }),
            binary: Vec::new(),
        }
    }

    /// One node with a triangle in the z = 0 plane that faces +Z, without normals.
    pub fn triangle() -> Self {
        let mut file = Self::empty();
        let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        file.json["accessors"][positions]["min"] = json!([0.0, 0.0, 0.0]);
        file.json["accessors"][positions]["max"] = json!([1.0, 1.0, 0.0]);
        file.push(
            "meshes",
            json!({ "primitives": [{ "attributes": { "POSITION": positions } }] }),
        );
        file.push("nodes", json!({ "mesh": 0 }));
        file
    }

    /// The triangle with one material.
    pub fn with_material(material: Value) -> Self {
        let mut file = Self::triangle();
        file.push("materials", material);
        file.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        file
    }

    /// Appends to a list of the root; returns the index.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json.as_object_mut().unwrap().entry(list);
        let list = list.or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    /// Appends bytes to the buffer; returns the index of their view.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let offset = self.binary.len();
        self.binary.extend(bytes);
        self.push(
            "bufferViews",
            json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }),
        )
    }

    /// Adds an accessor over `bytes`; returns its index.
    pub fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }),
        )
    }

    /// Adds a float accessor; returns its index.
    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => 1,
        };
        self.accessor(
            kind,
            FLOAT,
            values.len() / width,
            bytemuck::cast_slice(values),
        )
    }

    /// Adds an accessor of 16-bit indices; returns its index.
    pub fn indices(&mut self, values: &[u16]) -> usize {
        self.accessor("SCALAR", U16, values.len(), bytemuck::cast_slice(values))
    }

    /// Adds an attribute to the first primitive.
    pub fn attribute(&mut self, name: &str, accessor: usize) {
        self.primitive()["attributes"][name] = json!(accessor);
    }

    /// The first primitive.
    pub fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn finished(&self, uri: Option<String>) -> String {
        let mut json = self.json.clone();
        if json.get("buffers").is_none() {
            let mut buffer = Map::new();
            buffer.insert("byteLength".to_owned(), json!(self.binary.len()));
            if let Some(uri) = uri {
                buffer.insert("uri".to_owned(), json!(uri));
            }
            json["buffers"] = json!([buffer]);
        }
        json.to_string()
    }

    /// As a .glb.
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.finished(None).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut binary = self.binary.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let mut bytes = b"glTF".to_vec();
        let number = |value: usize| (value as u32).to_le_bytes();
        bytes.extend(number(2));
        bytes.extend(number(28 + json.len() + binary.len()));
        bytes.extend(number(json.len()));
        bytes.extend(b"JSON");
        bytes.extend(&json);
        bytes.extend(number(binary.len()));
        bytes.extend(b"BIN\0");
        bytes.extend(&binary);
        bytes
    }

    /// As a .gltf that names its buffer.
    pub fn gltf(&self, uri: &str) -> Vec<u8> {
        self.finished(Some(uri.to_owned())).into_bytes()
    }

    /// As a .gltf that holds its buffer.
    pub fn gltf_with_data(&self) -> Vec<u8> {
        use base64::Engine;
        let data = base64::engine::general_purpose::STANDARD.encode(&self.binary);
        self.gltf(&format!("data:application/octet-stream;base64,{data}"))
    }

    /// Imports it as a .glb.
    pub fn try_import(&self) -> Result<Scene, ImportError> {
        import(
            "test.glb",
            &self.glb(),
            &Files::default(),
            &Limits::default(),
        )
    }

    /// Imports it, which must work.
    #[track_caller]
    pub fn import(&self) -> Scene {
        self.try_import().unwrap_or_else(|error| panic!("{error}"))
    }

    /// Imports it, which must work, with one note that says how many values at `place` are replaced.
    #[track_caller]
    pub fn import_with_replaced(&self, place: &str, count: usize) -> Scene {
        let scene = self.import_with_note(&format!("{place}: "));
        let end = format!("({count} of them)");
        assert!(scene.warnings[0].ends_with(&end), "{:?}", scene.warnings);
        scene
    }

    /// Imports it, which must work, with one note that begins with `note`.
    #[track_caller]
    pub fn import_with_note(&self, note: &str) -> Scene {
        let scene = self.import();
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
        assert!(scene.warnings[0].starts_with(note), "{:?}", scene.warnings);
        scene
    }

    /// Imports it, which must fail at `place` for a reason that contains `reason`.
    #[track_caller]
    pub fn assert_error(&self, place: &str, reason: &str) {
        let error = self.try_import().expect_err("the file is wrong");
        assert_eq!(error.file, "test.glb");
        assert_eq!(error.place, place, "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
}

/// A PNG of RGBA texels.
pub fn png(width: u32, height: u32, rgba: &[u8]) -> Vec<u8> {
    use image::ImageEncoder;
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(rgba, width, height, image::ExtendedColorType::Rgba8)
        .unwrap();
    bytes
}
