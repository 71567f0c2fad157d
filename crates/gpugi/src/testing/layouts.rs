//! Checks that every Rust struct shared with a shader has the shader's layout: names and offsets of all fields, and the
//! size. The test finds the structs in the sources: they are `#[repr(C)]`, and their doc comment says which struct they
//! mirror (`View` of capture/view.wesl).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use regex::Regex;

use crate::gpu::{Shader, all_shaders};

/// Shaders read structs of this module word by word; scene/tests.rs tests them.
const READ_BY_WORDS: &str = "scene/tables.wesl";

/// This struct gives the words of the shader's struct other meanings.
const REINTERPRETED: &str = "Record";

/// A Rust struct, as its source declares it.
#[derive(Debug)]
struct Declared {
    name: String,
    file: PathBuf,
    /// The mirrored struct, and its module below `src`.
    mirrored: String,
    module: PathBuf,
    size: u32,
    /// Names and offsets (bytes).
    fields: Vec<(String, u32)>,
}

/// Names and types of the fields of every Rust struct, by its name.
type Bodies = BTreeMap<String, Vec<(String, String)>>;

/// Appends the fields of a struct that begins at byte `base`, with the fields of nested structs in their place; returns
/// its size.
fn lay_out(
    bodies: &Bodies,
    body: &[(String, String)],
    base: u32,
    fields: &mut Vec<(String, u32)>,
) -> u32 {
    let mut size = 0;
    for (field, ty) in body {
        size += if let Some(inner) = bodies.get(ty) {
            lay_out(bodies, inner, base + size, fields)
        } else {
            fields.push((field.clone(), base + size));
            size_of(ty).unwrap_or_else(|| panic!("{field}: {ty}"))
        };
    }
    size
}

/// Size of a plain type: 32-bit numbers and arrays of them.
fn size_of(ty: &str) -> Option<u32> {
    let ty = ty.trim();
    match ty {
        "f32" | "u32" | "i32" => Some(4),
        _ => {
            let (element, count) = ty.strip_prefix('[')?.strip_suffix(']')?.rsplit_once(';')?;
            Some(size_of(element)? * count.trim().parse::<u32>().ok()?)
        }
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_test = name.contains("test");
        if path.is_dir() && !is_test {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") && !is_test {
            files.push(path);
        }
    }
}

fn declared() -> Vec<Declared> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    collect(&root, &mut files);
    files.sort();
    let structs = Regex::new(
        r"(?m)((?:^ *///.*\n)*)((?:^ *#\[.*\].*\n)*)^ *(?:pub(?:\([A-Za-z0-9_]+\))? )?struct ([A-Za-z0-9_]+) \{\n((?:.*\n)*?)^ *\}",
    )
    .unwrap();
    let mirrors = Regex::new(r"`([A-Za-z0-9_]+)` of `?([A-Za-z0-9_/]+\.wesl)").unwrap();
    let field =
        Regex::new(r"(?m)^ *(?:pub(?:\([A-Za-z0-9_]+\))? )?([A-Za-z0-9_]+): (.*),$").unwrap();
    let mut all: Vec<(Declared, Vec<(String, String)>)> = Vec::new();
    let mut bodies = Bodies::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        for found in structs.captures_iter(&text) {
            let (doc, attributes, name, body) = (&found[1], &found[2], &found[3], &found[4]);
            if !(attributes.contains("repr(C)") && attributes.contains("Pod")) {
                continue;
            }
            let of_struct = field.captures_iter(body);
            let of_struct: Vec<(String, String)> = of_struct
                .map(|field| (field[1].to_owned(), field[2].to_owned()))
                .collect();
            bodies.insert(name.to_owned(), of_struct.clone());
            let doc = doc.replace("\n", " ").replace("///", "");
            let Some(mirrored) = mirrors.captures(&doc) else {
                panic!(
                    "{}: which shader's struct does {name} mirror?",
                    file.display()
                );
            };
            if &mirrored[2] == READ_BY_WORDS || name == REINTERPRETED {
                continue;
            }
            // Paths without a folder are relative to the file's folder.
            let below_source = root.join(&mirrored[2]);
            let module = if below_source.exists() {
                below_source
            } else {
                file.with_file_name(&mirrored[2])
            };
            assert!(
                module.exists(),
                "{}: {name}: there is no {}",
                file.display(),
                module.display()
            );
            let one = Declared {
                name: name.to_owned(),
                file: file.clone(),
                mirrored: mirrored[1].to_owned(),
                module: module.strip_prefix(&root).unwrap().with_extension(""),
                size: 0,
                fields: Vec::new(),
            };
            all.push((one, of_struct));
        }
    }
    for (declared, body) in &mut all {
        declared.size = lay_out(&bodies, body, 0, &mut declared.fields);
    }
    all.into_iter().map(|(declared, _)| declared).collect()
}

impl Declared {
    /// The struct's name in a linked shader: its own name in its own module, otherwise the module's path and then the
    /// name.
    fn linked_in(&self, shader: &Shader) -> String {
        let parts: Vec<String> = self
            .module
            .components()
            .map(|part| part.as_os_str().to_string_lossy().into())
            .collect();
        if shader.name == parts.join(".") {
            return self.mirrored.clone();
        }
        let mangled = parts.iter().map(|part| match part.matches('_').count() {
            0 => part.clone(),
            count => format!("_{count}{part}"),
        });
        let mangled: Vec<String> = mangled.collect();
        format!("package_{}_{}", mangled.join("_"), self.mirrored)
    }
}

fn flatten(module: &naga::Module, ty: &naga::Type, base: u32, fields: &mut Vec<(String, u32)>) {
    let naga::TypeInner::Struct { members, .. } = &ty.inner else {
        return;
    };
    for member in members {
        let inner = &module.types[member.ty];
        if matches!(inner.inner, naga::TypeInner::Struct { .. }) {
            flatten(module, inner, base + member.offset, fields);
        } else {
            fields.push((
                member.name.clone().unwrap_or_default(),
                base + member.offset,
            ));
        }
    }
}

#[test]
fn every_struct_shared_with_a_shader_has_one_layout() {
    let declared = declared();
    assert!(declared.len() > 30, "{} structs", declared.len());
    let mut found = vec![0; declared.len()];
    for &(name, source) in all_shaders() {
        let shader = Shader {
            name,
            source: source.into(),
        };
        let module = shader.parse().unwrap();
        for (index, declared) in declared.iter().enumerate() {
            let linked = declared.linked_in(&shader);
            let mut types = module.types.iter().map(|(_, ty)| ty);
            let Some(ty) = types.find(|ty| ty.name.as_deref() == Some(&linked)) else {
                continue;
            };
            let naga::TypeInner::Struct { span, members } = &ty.inner else {
                panic!("{linked} is no struct");
            };
            let mut fields = Vec::new();
            flatten(&module, ty, 0, &mut fields);
            // A runtime-sized array after the fields exists only in the shader.
            let is_open = members.last().is_some_and(|last| {
                let ty = &module.types[last.ty].inner;
                matches!(
                    ty,
                    naga::TypeInner::Array {
                        size: naga::ArraySize::Dynamic,
                        ..
                    }
                )
            });
            if is_open {
                fields.pop();
            }
            let context = format!("{} ({}) in {name}", declared.name, declared.file.display());
            // Padding may be explicit on one side only.
            let named = |fields: &[(String, u32)]| -> Vec<(String, u32)> {
                let named = fields
                    .iter()
                    .filter(|(name, _)| !name.starts_with("padding"));
                named.cloned().collect()
            };
            assert_eq!(named(&fields), named(&declared.fields), "{context}");
            assert!(
                is_open || *span == declared.size,
                "{context}: {span} bytes, not {}",
                declared.size
            );
            found[index] += 1;
        }
    }
    for (declared, found) in declared.iter().zip(found) {
        assert!(
            found > 0,
            "no shader has {} of {}",
            declared.mirrored,
            declared.module.display()
        );
    }
}
