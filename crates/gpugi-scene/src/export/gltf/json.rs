//! The JSON of a file as values, so that content unknown to gpugi stays in place.

use serde_json::{Map, Value, json};

use crate::export::ExportError;

/// A JSON object.
pub type Object = Map<String, Value>;

/// Limit on the total size of copied objects (bytes): in a hostile file, many short references to a long object would
/// multiply it.
const MOST_COPIED: usize = 512 << 20;

/// The root of a file.
#[derive(Clone)]
pub struct Json {
    root: Object,
    /// Total size of all copies so far (bytes).
    copied: usize,
}

impl Json {
    /// A file without content.
    pub fn new() -> Self {
        let mut root = Object::new();
        let generator = concat!("gpugi ", env!("CARGO_PKG_VERSION"));
        let asset = json!({ "version": "2.0", "generator": generator });
        root.insert("asset".to_owned(), asset);
        Self { root, copied: 0 }
    }

    /// Parses the root object from `json`.
    pub fn parse(json: &[u8]) -> Result<Self, ExportError> {
        let root = serde_json::from_slice(json);
        root.map(|root| Self { root, copied: 0 })
            .map_err(|error| ExportError::new("JSON", error))
    }

    /// The root object.
    pub fn root(&mut self) -> &mut Object {
        &mut self.root
    }

    /// Serializes the file.
    pub fn text(&self) -> Result<Vec<u8>, ExportError> {
        serde_json::to_vec(&self.root).map_err(|error| ExportError::new("JSON", error))
    }

    /// A list of the root; empty if there is none.
    pub fn list(&self, list: &str) -> &[Value] {
        let list = self.root.get(list).and_then(Value::as_array);
        list.map_or(&[], Vec::as_slice)
    }

    /// Appends `value` to a list of the root; returns its index.
    pub fn push(&mut self, list: &str, value: Value) -> Result<usize, ExportError> {
        let values = array(&mut self.root, list)?;
        values.push(value);
        Ok(values.len() - 1)
    }

    /// The object at `index` in a list of the root.
    pub fn at(&mut self, list: &str, index: usize) -> Result<&mut Object, ExportError> {
        let value = self.root.get_mut(list).and_then(|list| list.get_mut(index));
        value
            .and_then(Value::as_object_mut)
            .ok_or_else(|| ExportError::new(format!("{list}[{index}]"), "this is no JSON object"))
    }

    /// A copy of the object at `index` in a list of the root.
    pub fn copy(&mut self, list: &str, index: usize) -> Result<Object, ExportError> {
        let object = self.at(list, index)?;
        let length = serde_json::to_vec(object).map_or(usize::MAX, |text| text.len());
        self.charge(length, || format!("{list}[{index}]"))?;
        Ok(self.at(list, index)?.clone())
    }

    /// Deducts `length` bytes from the budget for copies, before a copy is made.
    pub fn charge(
        &mut self,
        length: usize,
        place: impl FnOnce() -> String,
    ) -> Result<(), ExportError> {
        let copied = self.copied.saturating_add(length);
        if copied > MOST_COPIED {
            return Err(ExportError::new(
                place(),
                "it is too large to be copied for everybody who shares it",
            ));
        }
        self.copied = copied;
        Ok(())
    }

    /// A primitive of a mesh.
    pub fn primitive(&mut self, mesh: usize, primitive: usize) -> Result<&mut Object, ExportError> {
        let primitives = self.at("meshes", mesh)?.get_mut("primitives");
        primitives
            .and_then(|primitives| primitives.get_mut(primitive)?.as_object_mut())
            .ok_or_else(|| {
                ExportError::new(
                    format!("meshes[{mesh}].primitives[{primitive}]"),
                    "this is no JSON object",
                )
            })
    }

    /// Records that the file uses an extension.
    pub fn uses(&mut self, extension: &str) -> Result<(), ExportError> {
        let used = array(&mut self.root, "extensionsUsed")?;
        if !used.iter().any(|used| used == extension) {
            used.push(extension.into());
        }
        Ok(())
    }

    /// Records that the file no longer uses an extension.
    pub fn no_longer_uses(&mut self, extension: &str) {
        for list in ["extensionsUsed", "extensionsRequired"] {
            let names = self.root.get_mut(list).and_then(Value::as_array_mut);
            let is_empty = names.is_some_and(|names| {
                names.retain(|name| name != extension);
                names.is_empty()
            });
            if is_empty {
                self.root.shift_remove(list);
            }
        }
    }
}

/// The list `key` of `parent`, created if missing.
pub fn array<'a>(parent: &'a mut Object, key: &str) -> Result<&'a mut Vec<Value>, ExportError> {
    let value = parent.entry(key).or_insert_with(|| json!([]));
    value
        .as_array_mut()
        .ok_or_else(|| ExportError::new(key, "this is no JSON array"))
}

/// The object `key` of `parent`, created if missing; a value that is not an object is replaced.
pub fn object<'a>(parent: &'a mut Object, key: &str) -> &'a mut Object {
    let value = parent.entry(key).or_insert_with(|| json!({}));
    if !value.is_object() {
        *value = json!({});
    }
    match value {
        Value::Object(object) => object,
        _ => unreachable!("it has just been made an object"),
    }
}

/// Removes the object `key` of `parent` if it is empty.
pub fn remove_empty(parent: &mut Object, key: &str) {
    let is_empty = |value: &Value| value.as_object().is_some_and(Object::is_empty);
    if parent.get(key).is_some_and(is_empty) {
        parent.shift_remove(key);
    }
}

/// The value of `key` in `parent`, if it is an index.
pub fn index(parent: &Object, key: &str) -> Option<usize> {
    usize::try_from(parent.get(key)?.as_u64()?).ok()
}
