//! What is changed of a whole file for the programs that read it.

use glam::Vec3;
use gpugi_scene::Limits;
use gpugi_scene::builtin::builtin;
use gpugi_scene::export::{
    BakedLight, BakedPage, Changes, Exported, Original, export_original, export_scene,
};
use serde_json::{Value, json};

use crate::builder::{File, Files, png};
use crate::export::baking::{
    Baked, SIZE, assert_mapped, atlas, keep, obscured, read, shredded, try_bake, whole,
};

const TEXELS: usize = (SIZE * SIZE) as usize;
const PRUNES: Changes = Changes {
    drops_lights: false,
    photometric: false,
    unpacks: false,
    prunes: true,
};

/// A file of two textured triangles, of which the first is baked unlit, with things that nobody needs.
fn file() -> File {
    let mut file = File::with_material(json!({
        "name": "first", "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 } },
    }));
    for shade in [10, 20, 30] {
        let view = file.view(&png(1, 1, &[shade, shade, shade, 255]));
        let image =
            json!({ "bufferView": view, "mimeType": "image/png", "name": shade.to_string() });
        let image = file.push("images", image);
        file.push("textures", json!({ "source": image, "sampler": 0 }));
    }
    file.push("samplers", json!({ "wrapS": 33_071 }));
    file.push("samplers", json!({ "wrapS": 10_497 }));
    file.push(
        "materials",
        json!({ "name": "second", "pbrMetallicRoughness": { "baseColorTexture": { "index": 2 } } }),
    );
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    file.attribute("TEXCOORD_0", uvs);
    let tangents = file.floats("VEC4", &[1.0, 0.0, 0.0, 1.0].repeat(3));
    file.attribute("TANGENT", tangents);
    let second = file.push("meshes", file.json["meshes"][0].clone());
    file.json["meshes"][second]["primitives"][0]["material"] = json!(1);
    file.push("meshes", file.json["meshes"][0].clone());
    file.push("nodes", json!({ "mesh": second }));
    file.json["extensionsUsed"] = json!(["KHR_materials_ior", "KHR_mesh_quantization"]);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    file
}

fn baked(file: &File, changes: &Changes) -> Exported {
    let scene = file.import();
    let mut atlas = shredded(&scene);
    atlas.instances[1] = None;
    let page = BakedPage {
        light: Some(BakedLight::Unlit(vec![[1, 2, 3, 255]; TEXELS])),
        ..BakedPage::default()
    };
    let exported = try_bake(&file.glb(), &Files::default(), &scene, &atlas, page).unwrap();
    exported.changed(changes).unwrap()
}

fn length(baked: &Baked, list: &str) -> usize {
    baked.json[list].as_array().map_or(0, Vec::len)
}

#[test]
fn pruned_files_hold_what_is_shown_and_nothing_else() {
    let file = file();
    let whole = baked(&file, &Changes::default());
    let pruned = baked(&file, &PRUNES);
    keep(&pruned.glb);
    assert!(pruned.glb.len() < whole.glb.len());
    let [whole, pruned] = [whole, pruned].map(|exported| Baked::new(&exported.glb));
    // The mesh that no node places, the image of the material that was replaced, and one that nobody ever needed.
    assert_eq!(
        [length(&whole, "meshes"), length(&pruned, "meshes")],
        [3, 2]
    );
    assert_eq!(
        [length(&whole, "images"), length(&pruned, "images")],
        [4, 2]
    );
    assert_eq!(
        [length(&whole, "samplers"), length(&pruned, "samplers")],
        [3, 2]
    );
    let attributes = |mesh: usize| {
        let attributes = &pruned.json["meshes"][mesh]["primitives"][0]["attributes"];
        attributes
            .as_object()
            .unwrap()
            .keys()
            .cloned()
            .collect::<Vec<_>>()
    };
    assert_eq!(attributes(0), ["POSITION", "TEXCOORD_0"]);
    assert_eq!(attributes(1), ["POSITION", "TEXCOORD_0"]);
    let used = &pruned.json["extensionsUsed"];
    assert_eq!(
        *used,
        json!(["KHR_mesh_quantization", "KHR_materials_unlit"])
    );
    // Both files show the same.
    let seen = |baked: &Baked| {
        let of_instance = |number: usize| {
            let instance = &baked.scene.instances[number];
            let (mesh, material) = (
                &baked.scene.meshes[instance.mesh],
                &baked.scene.materials[instance.material],
            );
            let texture = material.emissive_texture.or(material.base_color_texture);
            let texture = &baked.scene.textures[texture.unwrap().texture];
            let image = baked.scene.images[texture.image].pixels.clone();
            (mesh.positions.clone(), mesh.uvs[0].clone(), image)
        };
        [of_instance(0), of_instance(1)]
    };
    assert!(seen(&whole) == seen(&pruned));
    assert_eq!(pruned.scene.warnings, Vec::<String>::new());
}

#[test]
fn files_with_unknown_extensions_stay_whole() {
    let mut file = file();
    file.json["nodes"][0]["extensions"] = json!({ "VENDOR_decals": { "material": 1 } });
    file.json["extensionsUsed"] = json!(["VENDOR_decals"]);
    let [whole, pruned] = [Changes::default(), PRUNES].map(|changes| baked(&file, &changes));
    assert!(pruned.glb == whole.glb);
    let last = pruned.warnings.last().unwrap();
    assert!(last.contains("not pruned: VENDOR_decals"), "{last}");
}

#[test]
fn lights_whose_light_is_baked_can_go() {
    let scene = builtin("room", 1).unwrap();
    let changed = |changes: &Changes| {
        let exported = export_scene(&scene).unwrap();
        exported.changed(changes).unwrap()
    };
    let without = changed(&Changes {
        drops_lights: true,
        ..Changes::default()
    });
    keep(&without.glb);
    let json = Baked::new(&without.glb).json;
    assert!(!json.to_string().contains("KHR_lights_punctual"));
    assert!(read(&without.glb).unwrap().lights.is_empty());
    let [one, other] = [false, true].map(|photometric| {
        let changed = changed(&Changes {
            photometric,
            ..Changes::default()
        });
        let lights = read(&changed.glb).unwrap().lights;
        lights
            .iter()
            .map(|light| light.intensity)
            .collect::<Vec<Vec3>>()
    });
    assert_eq!(one.len(), 2);
    for (watts, lumens) in one.iter().zip(&other) {
        assert!((*lumens / *watts - 683.0).abs().max_element() < 0.01);
    }
}

/// What a file shows when its compressed geometry is decoded, in files that keep all materials.
fn decoded(file: &File) -> Baked {
    let scene = file.import();
    let mut atlas = shredded(&scene);
    atlas.instances.fill(None);
    let nothing = BakedPage::default();
    let exported = try_bake(&file.glb(), &Files::default(), &scene, &atlas, nothing).unwrap();
    let changes = Changes {
        unpacks: true,
        ..PRUNES
    };
    let decoded = exported.changed(&changes).unwrap();
    keep(&decoded.glb);
    let decoded = Baked::new(&decoded.glb);
    assert_eq!(length(&decoded, "buffers"), 1);
    decoded
}

#[cfg(feature = "meshopt")]
#[test]
fn geometry_of_meshoptimizer_can_be_decoded() {
    let file = crate::gltf::meshopt::packed();
    let decoded = decoded(&file);
    assert!(!decoded.json.to_string().contains("meshopt"));
    assert_eq!(
        decoded.scene.meshes[0].positions,
        file.import().meshes[0].positions
    );
}

#[test]
fn geometry_of_draco_can_be_decoded() {
    let file = crate::gltf::draco::packed(1);
    let scene = file.import();
    let decoded = decoded(&file);
    assert!(!decoded.json.to_string().contains("draco"));
    assert!(decoded.scene.meshes[0].positions == scene.meshes[0].positions);
    assert!(decoded.scene.meshes[0].indices == scene.meshes[0].indices);
    assert!(decoded.scene.meshes[0].colors == scene.meshes[0].colors);
    // A bake writes what it changes uncompressed, whether vertices are split or not.
    for atlas in [shredded(&scene), whole(&scene)] {
        let page = BakedPage {
            light: Some(BakedLight::Emissive(vec![Vec3::ONE; TEXELS])),
            ..BakedPage::default()
        };
        let bytes = file.glb();
        let exported = try_bake(&bytes, &Files::default(), &scene, &atlas, page).unwrap();
        keep(&exported.glb);
        let baked = Baked::new(&exported.glb);
        assert_mapped(&scene, &atlas, &baked.scene, 0);
        let primitive = &baked.json["meshes"][0]["primitives"][0];
        assert!(primitive.get("extensions").is_none(), "{primitive}");
        assert!(baked.json.get("extensionsRequired").is_none());
    }
    // Coordinates that the compressed data already has serve as a second set.
    let own = |_, vertex: u32| scene.meshes[0].uvs[0][vertex as usize];
    let atlas = atlas(&scene, own);
    let exported = try_bake(&file.glb(), &Files::default(), &scene, &atlas, obscured()).unwrap();
    let baked = Baked::new(&exported.glb);
    assert_mapped(&scene, &atlas, &baked.scene, 1);
    assert!(!baked.json.to_string().contains("draco"));
}

/// An index beyond a list stays beyond what is left of it.
#[test]
fn wrong_indices_become_no_right_ones() {
    let mut file = file();
    file.json["textures"][2]["source"] = json!(77);
    let changed = baked(&file, &PRUNES);
    // Without a copy for the validator, which would find the index.
    let length = u32::from_le_bytes(*changed.glb[12..].first_chunk().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&changed.glb[20..20 + length]).unwrap();
    let textures = json["textures"].as_array().unwrap();
    let images = json["images"].as_array().unwrap().len() as u64;
    let beyond = |texture: &&Value| texture["source"].as_u64().unwrap() >= images;
    assert_eq!(textures.iter().filter(beyond).count(), 1, "{json}");
}

/// Compressed attributes are those of the primitive, and nothing is left out of what a material needs.
#[test]
fn attributes_are_left_out_everywhere_or_nowhere() {
    let pruned = |file: &File| {
        let original = Original {
            name: "a.glb",
            bytes: &file.glb(),
            resolver: &Files::default(),
            limits: Limits::default(),
        };
        let exported = export_original(&original)
            .unwrap()
            .changed(&PRUNES)
            .unwrap();
        keep(&exported.glb);
        let baked = Baked::new(&exported.glb);
        baked.json["meshes"][0]["primitives"][0].clone()
    };
    let primitive = pruned(&crate::gltf::draco::packed(1));
    let packed = &primitive["extensions"]["KHR_draco_mesh_compression"]["attributes"];
    let names = |list: &Value| {
        list.as_object()
            .unwrap()
            .keys()
            .cloned()
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&primitive["attributes"]), ["POSITION", "COLOR_0"]);
    assert_eq!(names(packed), ["POSITION", "COLOR_0"]);

    // What bends a surface by its coordinates alone stays, and so does what anisotropy needs.
    let mut file = file();
    let uvs = file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"].clone();
    file.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "TEXCOORD_0": uvs }]);
    file.json["materials"][0] = json!({ "name": "plain" });
    let before = file.json["meshes"][0]["primitives"][0]["attributes"].clone();
    assert_eq!(
        pruned(&file)["attributes"].as_object().unwrap().len(),
        3,
        "{before}"
    );
    file.primitive()
        .as_object_mut()
        .unwrap()
        .shift_remove("targets");
    assert_eq!(names(&pruned(&file)["attributes"]), ["POSITION"]);
    let anisotropy = json!({ "KHR_materials_anisotropy": { "anisotropyStrength": 0.5 } });
    file.json["materials"][0]["extensions"] = anisotropy;
    file.json["extensionsRequired"] = json!([]);
    file.json["extensionsUsed"] = json!(["KHR_materials_anisotropy"]);
    assert_eq!(pruned(&file)["attributes"].as_object().unwrap().len(), 3);
    // Lightmaps without a set are in the second one.
    let second = file.json["accessors"].as_array().unwrap().len() - 1;
    let uvs = file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"].clone();
    file.attribute("TEXCOORD_1", uvs.as_u64().unwrap() as usize);
    file.json["materials"][0]["extensions"] = json!({ "MOZ_lightmap": { "index": 0 } });
    file.json["extensionsUsed"] = json!(["MOZ_lightmap"]);
    let kept = pruned(&file);
    assert!(
        kept["attributes"].get("TEXCOORD_1").is_some(),
        "{second}: {kept}"
    );
}

/// What an earlier bake stored is no part of what a later one shows.
#[test]
fn an_unlit_bake_of_a_lightmap_has_no_lightmap() {
    let mut file = File::with_material(json!({
        "extensions": { "MOZ_lightmap": { "index": 0, "texCoord": 1 } },
        "extras": { "gpugi": { "lightmap": { "file": "light.exr" } } },
    }));
    let view = file.view(&png(1, 1, &[255; 4]));
    file.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    file.push("textures", json!({ "source": 0 }));
    file.json["extensionsUsed"] = json!(["MOZ_lightmap"]);
    let scene = file.import();
    let page = BakedPage {
        light: Some(BakedLight::Unlit(vec![[1, 2, 3, 255]; TEXELS])),
        ..BakedPage::default()
    };
    let bytes = file.glb();
    let exported = try_bake(&bytes, &Files::default(), &scene, &shredded(&scene), page).unwrap();
    let json = Baked::new(&exported.changed(&PRUNES).unwrap().glb).json;
    assert!(
        !json.to_string().to_lowercase().contains("lightmap"),
        "{json}"
    );
    assert_eq!(json["images"].as_array().unwrap().len(), 1);
}
