//! Materials and their extensions.

use glam::{Vec2, Vec3, Vec4};
use gpugi_scene::{AlphaMode, Material, MaterialModel, Pixels, TextureRef, Volume, Wrap};
use serde_json::{Value, json};

use crate::builder::{File, png};

/// The material that `source` becomes.
#[track_caller]
fn material(source: Value) -> Material {
    File::with_material(source).import().materials.remove(0)
}

/// A file with one texture of one orange texel with alpha 51.
fn textured(source: Value) -> File {
    let mut file = File::with_material(source);
    let view = file.view(&png(1, 1, &[255, 128, 0, 51]));
    file.push("images", json!({ "bufferView": view }));
    file.push("textures", json!({ "source": 0 }));
    file
}

#[test]
fn a_primitive_without_material_gets_gltfs_default() {
    let scene = File::triangle().import();
    let material = &scene.materials[scene.instances[0].material];
    assert_eq!((material.metallic, material.roughness), (1.0, 1.0));
    assert_eq!(material.base_color, Vec4::ONE);
}

#[test]
fn factors() {
    let material = material(json!({
        "name": "paint",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.25,
        },
        "emissiveFactor": [1.0, 0.5, 0.0],
        "doubleSided": true,
    }));
    assert_eq!(material.name, "paint");
    assert_eq!(material.base_color, Vec4::new(0.1, 0.2, 0.3, 0.4));
    assert_eq!((material.metallic, material.roughness), (0.5, 0.25));
    assert_eq!(material.emissive, Vec3::new(1.0, 0.5, 0.0));
    assert!(material.double_sided);
    assert_eq!(material.alpha_mode, AlphaMode::Opaque);
}

#[test]
fn missing_factors_are_one() {
    let material = material(json!({}));
    assert_eq!((material.metallic, material.roughness), (1.0, 1.0));
    assert_eq!(material.ior, 1.5);
    assert!(!material.double_sided);
}

#[test]
fn alpha_modes() {
    let mode = |source| material(source).alpha_mode;
    assert_eq!(mode(json!({ "alphaMode": "BLEND" })), AlphaMode::Blend);
    assert_eq!(
        mode(json!({ "alphaMode": "MASK" })),
        AlphaMode::Mask { cutoff: 0.5 }
    );
    let cut = json!({ "alphaMode": "MASK", "alphaCutoff": 0.25 });
    assert_eq!(mode(cut), AlphaMode::Mask { cutoff: 0.25 });
    File::with_material(json!({ "alphaMode": "GLOW" }))
        .assert_error("materials[0].alphaMode", "GLOW");
}

#[test]
fn emissive_strength_multiplies() {
    let material = material(json!({
        "emissiveFactor": [1.0, 0.5, 0.25],
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 8.0 } },
    }));
    assert_eq!(material.emissive, Vec3::new(8.0, 4.0, 2.0));
}

#[test]
fn index_of_refraction() {
    let with_ior = |ior: f32| json!({ "extensions": { "KHR_materials_ior": { "ior": ior } } });
    assert_eq!(material(with_ior(1.33)).ior, 1.33);
    assert_eq!(material(with_ior(0.0)).ior, 0.0);
    File::with_material(with_ior(0.5)).assert_error(
        "materials[0].extensions.KHR_materials_ior.ior",
        "at least 1",
    );
}

#[test]
fn specular() {
    let material = textured(json!({ "extensions": { "KHR_materials_specular": {
        "specularFactor": 0.5,
        "specularTexture": { "index": 0 },
        "specularColorFactor": [2.0, 0.5, 1.0],
        "specularColorTexture": { "index": 0, "texCoord": 1 },
    } } }))
    .import()
    .materials
    .remove(0);
    assert_eq!(material.specular, 0.5);
    assert_eq!(material.specular_color, Vec3::new(2.0, 0.5, 1.0));
    assert_eq!(material.specular_texture, Some(TextureRef::new(0)));
    assert_eq!(material.specular_color_texture.unwrap().uv_set, 1);
}

#[test]
fn transmission_and_volume() {
    let source = |thickness: f32| {
        json!({ "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 0.75 },
            "KHR_materials_volume": {
                "thicknessFactor": thickness, "attenuationDistance": 2.0, "attenuationColor": [0.5, 0.6, 0.7],
            },
        } })
    };
    let solid = material(source(1.0));
    assert_eq!(solid.transmission, 0.75);
    let volume = Volume {
        attenuation_distance: 2.0,
        attenuation_color: Vec3::new(0.5, 0.6, 0.7),
    };
    assert_eq!(solid.volume, Some(volume));
    assert_eq!(
        material(source(0.0)).volume,
        None,
        "thickness 0 is a thin wall"
    );
    let clear = json!({ "extensions": { "KHR_materials_volume": { "thicknessFactor": 1.0 } } });
    assert_eq!(
        material(clear).volume.unwrap().attenuation_distance,
        f32::INFINITY
    );
}

#[test]
fn diffuse_transmission() {
    let material = textured(
        json!({ "extensions": { "KHR_materials_diffuse_transmission": {
        "diffuseTransmissionFactor": 0.25,
        "diffuseTransmissionTexture": { "index": 0 },
        "diffuseTransmissionColorFactor": [1.0, 0.5, 0.25],
        "diffuseTransmissionColorTexture": { "index": 0, "texCoord": 1 },
    } } }),
    )
    .import()
    .materials
    .remove(0);
    assert_eq!(material.diffuse_transmission, 0.25);
    assert_eq!(
        material.diffuse_transmission_color,
        Vec3::new(1.0, 0.5, 0.25)
    );
    assert_eq!(
        material.diffuse_transmission_texture,
        Some(TextureRef::new(0))
    );
    let colors = material.diffuse_transmission_color_texture.unwrap();
    assert_eq!(colors.uv_set, 1);
    assert!(material.has_two_sides() && !material.double_sided);
}

#[test]
fn texture_slots() {
    let mut file = textured(json!({
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 1 },
        },
        "normalTexture": { "index": 2, "scale": 0.5 },
        "emissiveTexture": { "index": 3 },
        "extensions": { "KHR_materials_transmission": { "transmissionTexture": { "index": 4 } } },
    }));
    for _ in 0..4 {
        file.push("textures", json!({ "source": 0 }));
    }
    let scene = file.import();
    let material = &scene.materials[0];
    let slots = [
        material.base_color_texture,
        material.metallic_roughness_texture,
        material.normal_texture,
        material.emissive_texture,
        material.transmission_texture,
    ];
    let mut textures = slots.map(|slot| slot.unwrap().texture);
    textures.sort_unstable();
    assert_eq!(textures, [0, 1, 2, 3, 4], "five textures");
    assert_eq!(scene.images.len(), 1, "share an image");
    assert_eq!(material.normal_scale, 0.5);
}

#[test]
fn samplers() {
    let mut file = textured(json!({ "emissiveTexture": { "index": 0 } }));
    file.json["textures"][0]["sampler"] = json!(0);
    file.push(
        "samplers",
        json!({ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728 }),
    );
    let texture = &file.import().textures[0];
    assert_eq!(texture.wrap, [Wrap::ClampToEdge, Wrap::MirroredRepeat]);
    assert!(texture.nearest && texture.has_levels);
    file.json["samplers"][0] = json!({});
    let texture = &file.import().textures[0];
    assert_eq!(texture.wrap, [Wrap::Repeat; 2]);
    assert!(!texture.nearest && texture.has_levels);
    for (filter, has_levels) in [(9728, false), (9729, false), (9984, true), (9987, true)] {
        file.json["samplers"][0] = json!({ "minFilter": filter });
        assert_eq!(file.import().textures[0].has_levels, has_levels);
    }
}

#[test]
fn texture_transform() {
    // The extension's own example: the lower left quadrant of the image, turned clockwise by 90 degrees.
    let file = textured(
        json!({ "emissiveTexture": { "index": 0, "extensions": { "KHR_texture_transform": {
        "offset": [0, 1], "rotation": std::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5], "texCoord": 1,
    } } } }),
    );
    let texture = file.import().materials[0].emissive_texture.unwrap();
    assert_eq!(texture.uv_set, 1);
    for (from, to) in [
        (Vec2::ZERO, Vec2::new(0.0, 1.0)),
        (Vec2::X, Vec2::new(0.0, 0.5)),
        (Vec2::Y, Vec2::new(0.5, 1.0)),
    ] {
        let found = texture.uv_from_mesh.transform_point2(from);
        assert!(found.abs_diff_eq(to, 1e-6), "{from} to {found}, not {to}");
    }
}

/// A triangle with four UV sets, in which all of set n is (n, n + 0.5).
fn four_uv_sets(source: Value) -> File {
    let mut file = textured(source);
    for set in 0..4 {
        let uvs = file.floats("VEC2", &[set as f32, set as f32 + 0.5].repeat(3));
        file.attribute(&format!("TEXCOORD_{set}"), uvs);
    }
    file
}

#[test]
fn any_two_uv_sets_are_read() {
    for [base, emissive] in [
        [0, 1],
        [1, 0],
        [0, 2],
        [2, 0],
        [1, 2],
        [3, 2],
        [2, 2],
        [1, 1],
    ] {
        let file = four_uv_sets(json!({
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "texCoord": base } },
            "emissiveTexture": { "index": 0, "texCoord": emissive },
            // Nobody reads it.
            "occlusionTexture": { "index": 0, "texCoord": 3 },
        }));
        let scene = file.import();
        assert_eq!(scene.warnings, [""; 0]);
        let material = &scene.materials[0];
        let read =
            |texture: Option<TextureRef>| scene.meshes[0].uvs[texture.unwrap().uv_set as usize][0];
        let set = |set: i32| Vec2::new(set as f32, set as f32 + 0.5);
        assert_eq!(read(material.base_color_texture), set(base));
        assert_eq!(read(material.emissive_texture), set(emissive));
        if base.max(emissive) < 2 {
            assert_eq!(
                scene.meshes[0].uvs.each_ref().map(|uvs| uvs[0]),
                [set(0), set(1)]
            );
        } else if base == emissive {
            // The second set stays what atlases look for.
            assert_eq!(scene.meshes[0].uvs[1][0], set(1));
        }
    }
}

#[test]
fn primitives_that_share_attributes_have_the_sets_of_their_materials() {
    let texture = |set: u32| json!({ "emissiveTexture": { "index": 0, "texCoord": set } });
    let mut file = four_uv_sets(texture(0));
    file.push("materials", texture(3));
    let mut second = file.primitive().clone();
    second["material"] = json!(1);
    let primitives = &mut file.json["meshes"][0]["primitives"];
    primitives.as_array_mut().unwrap().push(second);
    let scene = file.import();
    let first = |instance: usize| scene.meshes[scene.instances[instance].mesh].uvs[0][0].x;
    assert_eq!((first(0), first(1)), (0.0, 3.0));
}

#[test]
fn of_three_uv_sets_the_least_important_is_left_out_with_a_warning() {
    let file = four_uv_sets(json!({
        "pbrMetallicRoughness": {
            "metallicRoughnessTexture": { "index": 0, "texCoord": 0 },
            "baseColorTexture": { "index": 0, "texCoord": 2 },
        },
        "emissiveTexture": { "index": 0, "texCoord": 3 },
    }));
    let scene = file.import();
    let material = &scene.materials[0];
    assert_eq!(material.metallic_roughness_texture, None);
    assert_eq!(
        scene.meshes[0].uvs.each_ref().map(|uvs| uvs[0].x),
        [2.0, 3.0]
    );
    assert_eq!(material.base_color_texture.unwrap().uv_set, 0);
    assert_eq!(material.emissive_texture.unwrap().uv_set, 1);
    let [warning] = &scene.warnings[..] else {
        panic!("{:?}", scene.warnings)
    };
    assert!(warning.contains("metallicRoughnessTexture") && warning.contains("TEXCOORD_0"));
}

#[test]
fn unlit_surfaces_emit_their_colour_and_reflect_nothing() {
    let source = |alpha_mode: &str| {
        json!({
            "alphaMode": alpha_mode,
            "pbrMetallicRoughness": { "baseColorFactor": [0.2, 0.4, 0.6, 0.5], "baseColorTexture": { "index": 0 } },
            "emissiveFactor": [1.0, 1.0, 1.0], "emissiveTexture": { "index": 0 },
            "normalTexture": { "index": 0 },
            "extensions": { "KHR_materials_unlit": {}, "KHR_materials_transmission": { "transmissionFactor": 1.0 } },
        })
    };
    let mut file = textured(source("OPAQUE"));
    file.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let scene = file.import();
    assert_eq!(scene.warnings, [""; 0]);
    let texture = Some(TextureRef::new(0));
    let unlit = Material {
        name: "material 0".to_owned(),
        base_color: Vec4::new(0.0, 0.0, 0.0, 0.5),
        specular: 0.0,
        emissive: Vec3::new(0.2, 0.4, 0.6),
        emissive_texture: texture,
        ..Material::default()
    };
    assert_eq!(scene.materials[0], unlit);
    // Alpha is still the base colour's.
    let blended = textured(source("BLEND")).import().materials.remove(0);
    let alpha_mode = AlphaMode::Blend;
    assert_eq!(
        blended,
        Material {
            alpha_mode,
            base_color_texture: texture,
            ..unlit
        }
    );
    let mut file = textured(source("OPAQUE"));
    let colors = file.floats("VEC4", &[0.5; 12]);
    file.attribute("COLOR_0", colors);
    assert!(file.import().warnings[0].contains("vertex colours"));
}

#[test]
fn specular_glossiness_becomes_a_tinted_dielectric() {
    let file = textured(
        json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [0.1, 0.2, 0.3, 0.5],
        "specularFactor": [0.4, 0.5, 0.6],
        "glossinessFactor": 0.75,
    } } }),
    );
    let material = file.import().materials.remove(0);
    assert_eq!(material.base_color, Vec4::new(0.1, 0.2, 0.3, 0.5));
    assert_eq!(
        (material.ior, material.metallic, material.roughness),
        (0.0, 0.0, 0.25)
    );
    assert_eq!(material.specular_color, Vec3::new(0.4, 0.5, 0.6));
    assert_eq!(material.specular, 1.0);
}

#[test]
fn glossiness_textures_become_roughness_textures() {
    let file = textured(
        json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": {
        "glossinessFactor": 0.5,
        "diffuseTexture": { "index": 0 },
        "specularGlossinessTexture": { "index": 0, "texCoord": 1 },
    } } }),
    );
    let scene = file.import();
    let material = &scene.materials[0];
    assert_eq!(material.base_color_texture, Some(TextureRef::new(0)));
    let specular = material.specular_color_texture.unwrap();
    assert_eq!((specular.texture, specular.uv_set), (0, 1));
    let roughness = material.metallic_roughness_texture.unwrap();
    assert_eq!((roughness.uv_set, material.roughness), (1, 1.0));
    let image = &scene.images[scene.textures[roughness.texture].image];
    let Pixels::Rgba8(texels) = &image.pixels else {
        panic!("8 bits");
    };
    // 255 - 0.5 * 51 = 229.5, rounded.
    assert_eq!(texels[1], 230);
}

#[test]
fn phong() {
    let phong = |kd: f32, ks: f32, shininess: f32| {
        json!({ "extras": { "gpugi": { "phong": {
            "kd": [kd, 0.1, 0.2], "ks": [ks, 0.3, 0.4], "shininess": shininess,
        } } } })
    };
    let model = MaterialModel::Phong {
        kd: Vec3::new(0.5, 0.1, 0.2),
        ks: Vec3::new(0.5, 0.3, 0.4),
        shininess: 60.0,
    };
    assert_eq!(material(phong(0.5, 0.5, 60.0)).model, model);
    let mut blinn = phong(0.5, 0.5, 60.0);
    let own = blinn["extras"]["gpugi"].as_object_mut().unwrap();
    let parameters = own.remove("phong").unwrap();
    own.insert("blinn".into(), parameters.clone());
    let model = MaterialModel::Blinn {
        kd: Vec3::new(0.5, 0.1, 0.2),
        ks: Vec3::new(0.5, 0.3, 0.4),
        shininess: 60.0,
    };
    assert_eq!(material(blinn.clone()).model, model);
    let place = "materials[0].extras.gpugi";
    blinn["extras"]["gpugi"]["phong"] = parameters;
    File::with_material(blinn).assert_error(place, "one of phong, blinn and conductor");
    File::with_material(phong(0.5, 0.6, 60.0)).assert_error(place, "at most 1");
    File::with_material(phong(-0.5, 0.6, 60.0)).assert_error(place, "negative");
    File::with_material(phong(0.5, 0.5, -1.0)).assert_error(place, "shininess");
    File::with_material(json!({ "extras": { "gpugi": { "phong": { "kd": 1 } } } }))
        .assert_error(place, "");
}

#[test]
fn conductor() {
    let conductor = |n: f32| json!({ "extras": { "gpugi": { "conductor": { "n": [n, 0.4, 1.4], "k": [3.9, 2.4, 1.6] } } } });
    let model = MaterialModel::Conductor {
        n: Vec3::new(0.2, 0.4, 1.4),
        k: Vec3::new(3.9, 2.4, 1.6),
    };
    assert_eq!(material(conductor(0.2)).model, model);
    File::with_material(conductor(0.0))
        .assert_error("materials[0].extras.gpugi", "n must be positive");
}

#[test]
fn other_extras_are_left_alone() {
    for extras in [
        json!("text"),
        json!({ "gpugi": {} }),
        json!([1]),
        json!({ "other": 1 }),
    ] {
        let model = material(json!({ "extras": extras })).model;
        assert_eq!(model, MaterialModel::MetallicRoughness);
    }
}

#[test]
fn factors_outside_their_range_are_clamped_with_a_warning() {
    let file = File::with_material(json!({ "pbrMetallicRoughness": { "metallicFactor": 1.5 } }));
    let scene = file.import();
    assert_eq!(scene.materials[0].metallic, 1.0);
    assert!(
        scene.warnings[0].contains("metallicFactor 1.5"),
        "{:?}",
        scene.warnings
    );
}
