//! The materials that exported files describe to other viewers.

use glam::{Vec3, Vec4, vec2, vec3};
use gpugi_scene::Pixels;
use gpugi_scene::export::{BakedLight, BakedPage, LightmapQuantity};
use serde_json::{Value, json};

use crate::builder::{File, Files, png};
use crate::export::baking::{Baked, SIZE, atlas, bake, obscured, shredded, try_bake, whole};

const TEXELS: usize = (SIZE * SIZE) as usize;

fn light(light: BakedLight) -> BakedPage {
    BakedPage {
        light: Some(light),
        ..BakedPage::default()
    }
}

/// A triangle whose material uses every feature.
fn colourful() -> File {
    let mut file = File::with_material(json!({
        "name": "all",
        "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.6, 0.7, 0.8], "baseColorTexture": { "index": 0 },
            "metallicRoughnessTexture": { "index": 0 }, "extras": "surface",
        },
        "normalTexture": { "index": 0 }, "occlusionTexture": { "index": 0, "strength": 0.5 },
        "emissiveTexture": { "index": 0 }, "emissiveFactor": [1.0, 1.0, 1.0],
        "extensions": {
            "KHR_materials_clearcoat": { "clearcoatFactor": 1.0 }, "KHR_materials_ior": { "ior": 1.8 },
            "VENDOR_sound": { "squeaks": true },
        },
        "extras": { "gpugi": { "phong": { "kd": [0.5, 0.5, 0.5], "ks": [0.1, 0.1, 0.1], "shininess": 9 } }, "mine": 1 },
    }));
    file.json["extensionsUsed"] = json!([
        "KHR_materials_clearcoat",
        "KHR_materials_ior",
        "VENDOR_sound"
    ]);
    let view = file.view(&png(1, 1, &[255; 4]));
    file.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    file.push("textures", json!({ "source": 0 }));
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    file.attribute("TEXCOORD_0", uvs);
    let colors = file.floats("VEC4", &[0.5; 12]);
    file.attribute("COLOR_0", colors);
    file
}

fn baked(file: &File, page: BakedPage) -> Baked {
    let scene = file.import();
    bake(file, &scene, &shredded(&scene), page)
}

/// The texels of the image that `texture` shows, as stored.
fn texels(baked: &Baked, texture: &Value) -> (image::ColorType, Vec<u8>) {
    let texture = &baked.json["textures"][texture["index"].as_u64().unwrap() as usize];
    let image = &baked.json["images"][texture["source"].as_u64().unwrap() as usize];
    let sampler = &baked.json["samplers"][texture["sampler"].as_u64().unwrap() as usize];
    assert_eq!(sampler["wrapS"], 33_071);
    assert_eq!(image["mimeType"], "image/png");
    let image = image::load_from_memory(baked.view(&image["bufferView"])).unwrap();
    assert_eq!((image.width(), image.height()), (SIZE, SIZE));
    (image.color(), image.into_bytes())
}

#[test]
fn obscurance_occludes() {
    let file = colourful();
    let baked = baked(&file, obscured());
    let material = &baked.json["materials"][0];
    let mut expected = file.json["materials"][0].clone();
    expected["occlusionTexture"] = json!({ "index": 1, "texCoord": 1 });
    assert_eq!(material.to_string(), expected.to_string());
    let (color, texels) = texels(&baked, &material["occlusionTexture"]);
    assert_eq!(color, image::ColorType::L8);
    assert_eq!(texels, [128; TEXELS]);
}

#[test]
fn coloured_obscurance_is_named_in_extras() {
    let file = colourful();
    let page = BakedPage {
        colored_obscurance: Some(vec![vec3(1.0, 0.0, 0.5); TEXELS]),
        ..BakedPage::default()
    };
    let baked = baked(&file, page);
    let material = &baked.json["materials"][0];
    let named = &material["extras"]["gpugi"]["coloredObscurance"];
    assert_eq!(named["texCoord"], 1);
    assert_eq!(texels(&baked, named).1, [255, 0, 128].repeat(TEXELS));
    let mut others = material.clone();
    let own = others["extras"]["gpugi"].as_object_mut().unwrap();
    own.shift_remove("coloredObscurance");
    assert_eq!(others, file.json["materials"][0]);
}

#[test]
fn unlit_shows_the_radiance_and_nothing_else() {
    let file = colourful();
    let baked = baked(
        &file,
        light(BakedLight::Unlit(vec![[1, 2, 3, 200]; TEXELS])),
    );
    let expected = json!({
        "name": "all", "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 1, "texCoord": 0 }, "extras": "surface",
            "metallicFactor": 0.0, "roughnessFactor": 1.0,
        },
        "extensions": { "VENDOR_sound": { "squeaks": true }, "KHR_materials_unlit": {} },
        "extras": { "mine": 1 },
    });
    assert_eq!(baked.json["materials"][0], expected);
    let used = baked.json["extensionsUsed"].as_array().unwrap();
    assert_eq!(used.last(), Some(&json!("KHR_materials_unlit")));
    let texture = &expected["pbrMetallicRoughness"]["baseColorTexture"];
    assert_eq!(texels(&baked, texture).1, [1, 2, 3, 200].repeat(TEXELS));
    // Viewers would multiply by vertex colours.
    let attributes = baked.json["meshes"][0]["primitives"][0]["attributes"]
        .as_object()
        .unwrap();
    assert!(!attributes.contains_key("COLOR_0"));
    assert!(attributes.contains_key("_COLOR_0"));
    // gpugi sees it, too.
    let material = &baked.scene.materials[0];
    assert_eq!(
        (material.base_color, material.emissive),
        (Vec4::W, Vec3::ONE)
    );
    assert_eq!(material.emissive_texture.unwrap().uv_set, 0);
    assert_eq!(baked.scene.warnings.len(), 2);
}

#[test]
fn emissive_emits_the_radiance_and_reflects_nothing() {
    let file = colourful();
    let mut radiance = vec![Vec3::splat(0.5); TEXELS];
    radiance[0] = vec3(8.0, 2.0, 0.0);
    radiance[1] = vec3(8.0, 2.0, f32::NAN);
    let baked = baked(&file, light(BakedLight::Emissive(radiance)));
    let material = &baked.json["materials"][0];
    let expected = json!({
        "name": "all", "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
        "pbrMetallicRoughness": {
            // The cut-out stays as fine as it was.
            "baseColorFactor": [0.0, 0.0, 0.0, 0.8], "baseColorTexture": { "index": 0 },
            "extras": "surface", "metallicFactor": 0.0, "roughnessFactor": 1.0,
        },
        "emissiveTexture": { "index": 1, "texCoord": 1 }, "emissiveFactor": [1.0, 1.0, 1.0],
        "extensions": {
            "VENDOR_sound": { "squeaks": true }, "KHR_materials_specular": { "specularFactor": 0.0 },
            "KHR_materials_emissive_strength": { "emissiveStrength": 8.0 },
        },
        "extras": { "mine": 1 },
    });
    assert_eq!(*material, expected);
    let (_, texels) = texels(&baked, &material["emissiveTexture"]);
    // A NaN is black; 2/8 is 137 in sRGB, 1/16 is 71; both are dithered.
    let near = |found: &[u8], expected: &[u8]| {
        let pairs = found.iter().zip(expected);
        assert!(pairs.clone().all(|(a, b)| a.abs_diff(*b) < 2), "{found:?}");
        assert_eq!(found.len(), expected.len());
    };
    near(&texels[..9], &[255, 137, 0, 0, 0, 0, 71, 71, 71]);
    assert_eq!((texels[0], texels[2], texels[3]), (255, 0, 0));

    // gpugi sees the same light in it.
    let material = &baked.scene.materials[0];
    assert_eq!(material.emissive, Vec3::splat(8.0));
    assert_eq!((material.metallic, material.specular), (0.0, 0.0));
    assert_eq!(material.base_color.truncate(), Vec3::ZERO);
    let texture = material.emissive_texture.unwrap();
    assert_eq!(texture.uv_set, 1);
    let image = &baked.scene.images[baked.scene.textures[texture.texture].image];
    let Pixels::Rgba8(pixels) = &image.pixels else {
        panic!("a PNG has 8 bits");
    };
    near(&pixels[..4], &[255, 137, 0, 255]);
}

#[test]
fn dim_emission_needs_no_extension() {
    let file = File::with_material(json!({}));
    let page = light(BakedLight::Emissive(vec![Vec3::splat(0.25); TEXELS]));
    let material = baked(&file, page).json["materials"][0].clone();
    assert_eq!(material["emissiveFactor"], json!([0.25, 0.25, 0.25]));
    assert_eq!(material["extensions"].as_object().unwrap().len(), 1);
    assert_eq!(
        material["pbrMetallicRoughness"].get("baseColorTexture"),
        None
    );
}

#[test]
fn a_lightmap_is_that_of_moz_lightmap() {
    let mut file = File::with_material(json!({ "extras": "a string" }));
    file.attribute("POSITION", 0);
    for (quantity, name, with_hdr) in [
        (LightmapQuantity::Irradiance, "irradiance", false),
        (LightmapQuantity::IrradianceOverPi, "irradiance / pi", true),
    ] {
        let baked = baked(
            &file,
            light(BakedLight::Lightmap {
                texels: vec![vec3(4.0, 1.0, 0.0); TEXELS],
                quantity,
                with_hdr,
                file: "baked.0.exr".to_owned(),
            }),
        );
        let material = &baked.json["materials"][0];
        let expected = json!({
            "extras": { "original": "a string", "gpugi": { "lightmap": {
                "file": "baked.0.exr", "texCoord": 1, "quantity": name,
            } } },
            "extensions": { "MOZ_lightmap": { "index": 0, "texCoord": 1, "intensity": 4.0 } },
        });
        assert_eq!(*material, expected);
        // Hubs reads no other set, and glTF has no second set without a first one.
        let attributes = &baked.json["meshes"][0]["primitives"][0]["attributes"];
        assert_eq!(attributes["TEXCOORD_0"], attributes["TEXCOORD_1"]);
        let used = baked.json["extensionsUsed"].as_array().unwrap();
        assert!(used.contains(&json!("MOZ_lightmap")));
        let texels = texels(&baked, &material["extensions"]["MOZ_lightmap"]).1;
        assert!(texels[0] == 255 && texels[2] == 0, "{:?}", &texels[..3]);
        // A quarter of the scale is 63.75 without a curve: the mean of all texels, which are dithered.
        let greens = texels.iter().skip(1).step_by(3);
        let mean = greens.map(|green| f64::from(*green)).sum::<f64>() / TEXELS as f64;
        assert!((mean - 63.75).abs() < 0.2, "{mean}");
        let hdr = &baked.json["textures"][0]["extensions"]["MOZ_texture_rgbe"]["source"];
        assert_eq!(hdr.is_number(), with_hdr);
        if let Some(image) = hdr.as_u64() {
            let image = &baked.json["images"][image as usize];
            assert_eq!(image["mimeType"], "image/vnd.radiance");
            let image = image::load_from_memory(baked.view(&image["bufferView"])).unwrap();
            let texel = image.into_rgb32f().get_pixel(1, 1).0;
            assert_eq!(texel, [1.0, 0.25, 0.0]);
        }
    }
}

/// Some programs read no second set, and nothing reads the file's own any more.
#[test]
fn unlit_bakes_use_the_first_set() {
    let file = colourful();
    let baked = baked(
        &file,
        light(BakedLight::Unlit(vec![[1, 2, 3, 255]; TEXELS])),
    );
    let primitive = &baked.json["meshes"][0]["primitives"][0];
    let attributes = primitive["attributes"].as_object().unwrap();
    let of_file = |number: &str| baked.elements(&attributes[number], 8).len();
    assert_eq!(of_file("TEXCOORD_0"), of_file("TEXCOORD_1"));
    let scene = file.import();
    let atlas = shredded(&scene);
    let corners = &atlas.instances[0].as_ref().unwrap().corners;
    let mesh = &baked.scene.meshes[0];
    for (corner, &vertex) in corners.iter().zip(&mesh.indices) {
        assert_eq!(mesh.uvs[0][vertex as usize], *corner);
    }
}

/// The set of lightmaps holds those of the bake, and what the file had there is read elsewhere.
#[test]
fn a_second_set_of_the_file_makes_room() {
    let mut file = File::with_material(json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "texCoord": 1 } },
        "emissiveTexture": {
            "index": 0, "extensions": { "KHR_texture_transform": { "texCoord": 1 } },
        },
        "normalTexture": { "index": 0 },
    }));
    file.json["extensionsUsed"] = json!(["KHR_texture_transform"]);
    let view = file.view(&png(1, 1, &[255; 4]));
    file.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    file.push("textures", json!({ "source": 0 }));
    let sets = [
        [0.0, 0.0, 1.0, 0.0, 0.0, 1.0],
        [0.5, 0.0, 0.5, 1.0, 0.0, 0.5],
    ];
    for (number, set) in sets.iter().enumerate() {
        let uvs = file.floats("VEC2", set);
        file.attribute(&format!("TEXCOORD_{number}"), uvs);
    }
    let scene = file.import();
    let (bytes, files) = (file.glb(), Files::default());
    let exported = try_bake(&bytes, &files, &scene, &shredded(&scene), obscured()).unwrap();
    assert!(
        exported.warnings[0].contains("TEXCOORD_2"),
        "{:?}",
        exported.warnings
    );
    let baked = Baked::new(&exported.glb);
    let expected = json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "texCoord": 2 } },
        "emissiveTexture": {
            "index": 0, "extensions": { "KHR_texture_transform": { "texCoord": 2 } },
        },
        "normalTexture": { "index": 0 },
        "occlusionTexture": { "index": 1, "texCoord": 1 },
    });
    assert_eq!(baked.json["materials"][0], expected);
    let attributes = &baked.json["meshes"][0]["primitives"][0]["attributes"];
    let moved = baked.elements(&attributes["TEXCOORD_2"], 8).concat();
    let moved: &[f32] = bytemuck::cast_slice(&moved);
    assert_eq!(&moved[..6], sets[1]);
}

#[test]
fn primitives_without_a_material_get_one() {
    let file = File::triangle();
    let baked = baked(&file, obscured());
    assert_eq!(
        baked.json["materials"],
        json!([{ "occlusionTexture": { "index": 0, "texCoord": 1 } }])
    );
    assert_eq!(baked.json["meshes"][0]["primitives"][0]["material"], 0);
    // glTF's default material, not gpugi's.
    assert_eq!(baked.scene.materials[0].metallic, 1.0);
}

#[test]
fn a_material_on_two_pages_becomes_two() {
    let mut file = File::with_material(json!({ "name": "both" }));
    file.push("meshes", file.json["meshes"][0].clone());
    file.push("nodes", json!({ "mesh": 1 }));
    let scene = file.import();
    let mut atlas = whole(&scene);
    atlas.pages = 2;
    atlas.instances[1].as_mut().unwrap().page = 1;
    let pages = [
        obscured(),
        light(BakedLight::Unlit(vec![[9, 9, 9, 255]; TEXELS])),
    ];
    let original = gpugi_scene::export::Original {
        name: "test.glb",
        bytes: &file.glb(),
        resolver: &crate::builder::Files::default(),
        limits: gpugi_scene::Limits::default(),
    };
    let exported = gpugi_scene::export::export_bake(Some(original), &scene, &atlas, &pages);
    let baked = Baked::new(&exported.unwrap().glb);
    let material = |mesh: usize| {
        let material = &baked.json["meshes"][mesh]["primitives"][0]["material"];
        &baked.json["materials"][material.as_u64().unwrap() as usize]
    };
    assert!(material(0).get("occlusionTexture").is_some());
    assert!(material(0).get("extensions").is_none());
    assert!(
        material(1)["extensions"]
            .get("KHR_materials_unlit")
            .is_some()
    );
    assert_eq!(material(1)["name"], "both");
}

/// A page of two instances, the first a thousand times as bright as the second: they must not share one scale, which
/// would leave the second only a few bits.
#[test]
fn an_instance_is_as_exact_as_its_own_brightness_allows() {
    const SIDE: u32 = 32;
    const DIM: Vec3 = vec3(0.0023, 0.0017, 0.0011);
    let mut file = File::with_material(json!({ "name": "both" }));
    file.push(
        "nodes",
        json!({ "mesh": 0, "translation": [2.0, 0.0, 0.0] }),
    );
    let scene = file.import();
    // Two texels of gutter lie between them and continue both.
    let mut atlas = atlas(&scene, |instance, vertex| {
        let left = if instance == 0 { 0.0 } else { 17.0 };
        let corner = [vec2(0.0, 0.0), vec2(15.0, 0.0), vec2(0.0, 32.0)][vertex as usize];
        (vec2(left, 0.0) + corner) / SIDE as f32
    });
    atlas.size = SIDE;
    let texels = (0..SIDE * SIDE).map(|texel| if texel % SIDE < 16 { DIM * 1000.0 } else { DIM });
    let texels: Vec<Vec3> = texels.collect();
    let lightmap = BakedLight::Lightmap {
        texels: texels.clone(),
        quantity: LightmapQuantity::Irradiance,
        with_hdr: false,
        file: String::new(),
    };
    for page in [BakedLight::Emissive(texels), lightmap] {
        let is_lightmap = matches!(page, BakedLight::Lightmap { .. });
        let baked = bake(&file, &scene, &atlas, light(page));
        for (number, expected) in [(0, DIM * 1000.0), (1, DIM)] {
            let instance = &baked.scene.instances[number];
            let json = &baked.json["materials"][instance.material];
            let (texture, scale) = if is_lightmap {
                let map = &json["extensions"]["MOZ_lightmap"];
                (map, map["intensity"].as_f64().unwrap() as f32)
            } else {
                let material = &baked.scene.materials[instance.material];
                (&json["emissiveTexture"], material.emissive.x)
            };
            let texture = &baked.json["textures"][texture["index"].as_u64().unwrap() as usize];
            let image = &baked.json["images"][texture["source"].as_u64().unwrap() as usize];
            let image = image::load_from_memory(baked.view(&image["bufferView"])).unwrap();
            // The texels that the instance's triangle reads.
            let (image, left) = (image.into_rgb8(), if number == 0 { 0 } else { 16 });
            let mut sum = Vec3::ZERO;
            for (x, y) in (left..left + 8).flat_map(|x| (0..16).map(move |y| (x, y))) {
                // None of these texels is dark.
                let linear = |channel: u8| match is_lightmap {
                    true => f32::from(channel) / 255.0,
                    false => ((f32::from(channel) / 255.0 + 0.055) / 1.055).powf(2.4),
                };
                let found = Vec3::from(image.get_pixel(x, y).0.map(linear)) * scale;
                let error = (found - expected).abs() / expected;
                assert!(error.max_element() < 0.03, "instance {number}: {error}");
                sum += found;
            }
            let error = (sum / 128.0 - expected).abs() / expected;
            assert!(error.max_element() < 0.005, "instance {number}: {error}");
        }
    }
}
