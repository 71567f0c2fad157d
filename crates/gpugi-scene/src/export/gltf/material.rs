//! Materials that display baked results.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde_json::{Value, json};

use super::json::{Json, Object, index, object, remove_empty};
use super::output::Output;
use super::primitive::PageSet;
use super::textures::{LightTexture, PageTextures};
use crate::export::ExportError;
use crate::import::gltf::document::DRACO;

const UNLIT: &str = "KHR_materials_unlit";
const STRENGTH: &str = "KHR_materials_emissive_strength";
const SPECULAR: &str = "KHR_materials_specular";
const VARIANTS: &str = "KHR_materials_variants";
/// Hubs' extension for lightmaps, which three.js reads, too.
const LIGHTMAP: &str = "MOZ_lightmap";

/// What a baked material depends on besides the original.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Use {
    pub page: u32,
    /// UV set that maps to the page.
    pub uv_set: PageSet,
    /// The value that a texel of 1 stands for, as the bits of a float.
    pub scale: u32,
}

/// A mesh index and the index of one of its primitives.
type Primitive = (usize, usize);

/// What the materials of baked primitives must show.
pub type Uses = HashMap<Primitive, Use>;

/// Groups of primitives that get the same material, derived from the same original or from glTF's default.
type Changes = BTreeMap<(Option<usize>, Use), Vec<Primitive>>;

/// The set for a page's coordinates. 0 if nothing that stays in the material reads coordinates: some programs read no other
/// set. Otherwise 1, where most programs look for those of lightmaps. `None`, for the first free set, beside variants, whose
/// materials read the file's own sets.
pub fn wanted_set(
    file: &mut Json,
    (mesh, number): Primitive,
    light: &Option<LightTexture>,
) -> Result<Option<u32>, ExportError> {
    let primitive = file.primitive(mesh, number)?;
    let has_variants = primitive
        .get("extensions")
        .is_some_and(|extensions| extensions.get(VARIANTS).is_some());
    if has_variants {
        return Ok(None);
    }
    let material = index(primitive, "material");
    let is_first = match light {
        Some(LightTexture::Unlit { .. }) => true,
        Some(LightTexture::Emissive { .. }) => match material {
            Some(material) => coverage(file.at("materials", material)?).1.is_none(),
            None => true,
        },
        _ => false,
    };
    Ok(Some(u32::from(!is_first)))
}

/// Assigns materials to the baked primitives. A material without other users is changed in place; otherwise baked
/// primitives share copies.
pub fn assign(
    output: &mut Output,
    baked: &Uses,
    pages: &[PageTextures],
    warnings: &mut Vec<String>,
) -> Result<(), ExportError> {
    let mut changes = Changes::new();
    let mut users: BTreeMap<usize, BTreeSet<Option<Use>>> = BTreeMap::new();
    for (mesh, json) in output.json.list("meshes").iter().enumerate() {
        let primitives = json.get("primitives").and_then(Value::as_array);
        for (number, json) in primitives.into_iter().flatten().enumerate() {
            let wanted = baked.get(&(mesh, number)).copied();
            let material = json
                .as_object()
                .and_then(|primitive| index(primitive, "material"));
            if let Some(material) = material {
                users.entry(material).or_default().insert(wanted);
            }
            let mappings = &json["extensions"][VARIANTS]["mappings"];
            for mapping in mappings.as_array().into_iter().flatten() {
                if let Some(other) = mapping
                    .as_object()
                    .and_then(|mapping| index(mapping, "material"))
                {
                    users.entry(other).or_default().insert(None);
                }
            }
            if let Some(wanted) = wanted {
                let primitives = changes.entry((material, wanted)).or_default();
                primitives.push((mesh, number));
                if mappings.is_array() {
                    warnings.push(format!(
                        "meshes[{mesh}].primitives[{number}]: its variants do not show what was baked"
                    ));
                }
            }
        }
    }
    for ((original, wanted), primitives) in changes {
        let page = &pages[wanted.page as usize];
        let material = match original {
            Some(original) if users[&original].len() == 1 => {
                let mut json = std::mem::take(output.json.at("materials", original)?);
                show(&mut json, page, wanted, &mut output.json)?;
                *output.json.at("materials", original)? = json;
                original
            }
            _ => {
                let mut json = match original {
                    Some(original) => output.json.copy("materials", original)?,
                    None => Object::new(),
                };
                show(&mut json, page, wanted, &mut output.json)?;
                output.json.push("materials", Value::Object(json))?
            }
        };
        let is_unlit = matches!(page.light, Some(LightTexture::Unlit { .. }));
        for (mesh, number) in primitives {
            let primitive = output.json.primitive(mesh, number)?;
            primitive.insert("material".to_owned(), material.into());
            if is_unlit {
                hide_vertex_colors(primitive);
            }
        }
    }
    Ok(())
}

/// Unlit materials multiply by vertex colours, but the bake already includes those. Renaming them to
/// application-specific attributes keeps them without the multiplication.
fn hide_vertex_colors(primitive: &mut Object) {
    fn hide(attributes: Option<&mut Value>) {
        if let Some(attributes) = attributes.and_then(Value::as_object_mut) {
            let all = std::mem::take(attributes);
            *attributes = all
                .into_iter()
                .map(|(name, accessor)| match name.strip_prefix("COLOR_") {
                    Some(set) => (format!("_COLOR_{set}"), accessor),
                    None => (name, accessor),
                })
                .collect();
        }
    }
    hide(primitive.get_mut("attributes"));
    let packed = primitive.get_mut("extensions");
    hide(packed.and_then(|extensions| extensions.get_mut(DRACO)?.get_mut("attributes")));
    let targets = primitive.get_mut("targets").and_then(Value::as_array_mut);
    targets
        .into_iter()
        .flatten()
        .for_each(|target| hide(Some(target)));
}

/// Changes `material` so that it displays `page`.
fn show(
    material: &mut Object,
    page: &PageTextures,
    wanted: Use,
    file: &mut Json,
) -> Result<(), ExportError> {
    let (uv_set, scale) = (wanted.uv_set.set, f32::from_bits(wanted.scale));
    if let Some(other) = wanted.uv_set.swapped {
        swap_sets(material, "", [uv_set, other]);
    }
    let reference = |texture: usize| json!({ "index": texture, "texCoord": uv_set });
    match &page.light {
        None => {}
        Some(LightTexture::Unlit { texture }) => {
            strip(material);
            let surface = object(material, "pbrMetallicRoughness");
            surface.shift_remove("baseColorFactor");
            surface.insert("baseColorTexture".to_owned(), reference(*texture));
            object(material, "extensions").insert(UNLIT.to_owned(), json!({}));
            file.uses(UNLIT)?;
        }
        Some(LightTexture::Emissive { texture }) => {
            let (alpha, alpha_texture) = coverage(material);
            strip(material);
            // Black, hence without diffuse reflection. The only other lobe is specular, which a factor of 0 disables
            // entirely.
            let surface = object(material, "pbrMetallicRoughness");
            surface.insert(
                "baseColorFactor".to_owned(),
                json!([0.0, 0.0, 0.0, alpha.unwrap_or(json!(1.0))]),
            );
            surface.shift_remove("baseColorTexture");
            if let Some(texture) = alpha_texture {
                surface.insert("baseColorTexture".to_owned(), texture);
            }
            material.insert("emissiveTexture".to_owned(), reference(*texture));
            // Viewers without the strength extension get at most a factor of 1.
            material.insert(
                "emissiveFactor".to_owned(),
                json!([scale.min(1.0), scale.min(1.0), scale.min(1.0)]),
            );
            let extensions = object(material, "extensions");
            extensions.insert(SPECULAR.to_owned(), json!({ "specularFactor": 0.0 }));
            file.uses(SPECULAR)?;
            if scale > 1.0 {
                extensions.insert(STRENGTH.to_owned(), json!({ "emissiveStrength": scale }));
                file.uses(STRENGTH)?;
            }
        }
        Some(LightTexture::Lightmap {
            texture,
            quantity,
            file: beside,
        }) => {
            let lightmap = json!({ "index": texture, "texCoord": uv_set, "intensity": scale });
            object(material, "extensions").insert(LIGHTMAP.to_owned(), lightmap);
            file.uses(LIGHTMAP)?;
            let own = json!({ "file": beside, "texCoord": uv_set, "quantity": quantity.name() });
            own_extras(material).insert("lightmap".to_owned(), own);
        }
    }
    if let Some(name) = page.stored {
        let place = json!({ "page": wanted.page, "texCoord": uv_set });
        own_extras(material).insert(name.to_owned(), place);
    }
    if let Some(texture) = page.obscurance {
        material.insert("occlusionTexture".to_owned(), reference(texture));
    }
    if let Some(texture) = page.colored_obscurance {
        let texture = json!({ "index": texture, "texCoord": uv_set, "transfer": "linear" });
        own_extras(material).insert("coloredObscurance".to_owned(), texture);
    }
    Ok(())
}

/// The set of coordinates that an object of a material reads, if it is a texture, or a transform with a set of its own.
/// `name`: that of the member which holds it.
pub fn set_read(object: &Object, name: &str) -> Option<u64> {
    let is_texture = object.get("index").is_some_and(Value::is_u64);
    match object.get("texCoord") {
        Some(set) => set.as_u64(),
        None => is_texture.then_some(u64::from(name == LIGHTMAP)),
    }
}

/// Lets what a material reads by one set of coordinates read the other, and the reverse. `holder`: the name of the member
/// which holds it.
fn swap_sets(material: &mut Object, holder: &str, [one, other]: [u32; 2]) {
    let swapped = |set: u64| match set {
        set if set == u64::from(one) => Some(other),
        set if set == u64::from(other) => Some(one),
        _ => None,
    };
    let set = set_read(material, holder);
    if let Some(set) = set.and_then(swapped) {
        material.insert("texCoord".to_owned(), set.into());
    }
    for (name, value) in material.iter_mut() {
        let value = match name.as_str() {
            "extras" => value.get_mut("gpugi"),
            _ => Some(value),
        };
        if let Some(Value::Object(value)) = value {
            swap_sets(value, name, [one, other]);
        }
    }
}

/// `extras.gpugi`. Extras that are not an object move to `extras.original`.
pub fn own_extras(material: &mut Object) -> &mut Object {
    let extras = material.get_mut("extras");
    if let Some(extras) = extras.filter(|extras| !extras.is_object() && !extras.is_null()) {
        *extras = json!({ "original": extras.take() });
    }
    object(object(material, "extras"), "gpugi")
}

/// Removes everything that reflects, transmits or emits light. Name, alpha mode, sidedness, extras and whatever is
/// unrelated to light stay.
fn strip(material: &mut Object) {
    for member in [
        "normalTexture",
        "occlusionTexture",
        "emissiveTexture",
        "emissiveFactor",
    ] {
        material.shift_remove(member);
    }
    let surface = object(material, "pbrMetallicRoughness");
    surface.shift_remove("metallicRoughnessTexture");
    surface.insert("metallicFactor".to_owned(), json!(0.0));
    surface.insert("roughnessFactor".to_owned(), json!(1.0));
    if let Some(extensions) = material
        .get_mut("extensions")
        .and_then(Value::as_object_mut)
    {
        extensions.retain(|name, _| !name.starts_with("KHR_materials_") && name != LIGHTMAP);
    }
    remove_empty(material, "extensions");
    if let Some(extras) = material.get_mut("extras").and_then(Value::as_object_mut) {
        if let Some(own) = extras.get_mut("gpugi").and_then(Value::as_object_mut) {
            own.shift_remove("phong");
            own.shift_remove("blinn");
            own.shift_remove("conductor");
            own.shift_remove("lightmap");
        }
        remove_empty(extras, "gpugi");
        remove_empty(material, "extras");
    }
}

/// The alpha value of a material that uses alpha, and the texture that multiplies it.
fn coverage(material: &Object) -> (Option<Value>, Option<Value>) {
    let mode = material.get("alphaMode").and_then(Value::as_str);
    if matches!(mode, None | Some("OPAQUE")) {
        return (None, None);
    }
    let extensions = material.get("extensions");
    let (surface, factor, texture) = match extensions
        .and_then(|extensions| extensions.get("KHR_materials_pbrSpecularGlossiness"))
    {
        Some(surface) => (Some(surface), "diffuseFactor", "diffuseTexture"),
        None => (
            material.get("pbrMetallicRoughness"),
            "baseColorFactor",
            "baseColorTexture",
        ),
    };
    let member = |name: &str| surface.and_then(|surface| surface.get(name));
    let alpha = member(factor).and_then(|factor| factor.get(3));
    (alpha.cloned(), member(texture).cloned())
}
