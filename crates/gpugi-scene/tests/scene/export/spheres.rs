//! `extras.gpugi.sphere`.

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, sphere};
use gpugi_scene::export::{BakedLight, BakedPage, LightmapQuantity, export_bake, export_scene};
use gpugi_scene::{Material, Scene};
use serde_json::{Value, json};

use crate::builder::File;
use crate::export::baking::{Baked, SIZE, obscured, shredded, whole};

/// A ball that is a sphere, one that is not, with the same mesh.
fn balls() -> Scene {
    let mut scene = Scene::new("balls");
    let mesh = scene.add_mesh(sphere(0.5, 16));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    let at = Mat4::from_scale(vec3(1.0, 2.0, -1.0));
    scene.add_instance("exact", mesh, material, at);
    scene.add_instance("mesh", mesh, material, Mat4::IDENTITY);
    scene.instances[0].is_sphere = true;
    scene
}

fn file_of(scene: &Scene) -> File {
    let Baked {
        mut json, binary, ..
    } = Baked::new(&export_scene(scene).unwrap().glb);
    // Tests add to it.
    json.as_object_mut().unwrap().remove("buffers");
    File { json, binary }
}

/// The file of `balls`.
fn written() -> File {
    file_of(&balls())
}

fn are_spheres(scene: &Scene) -> Vec<bool> {
    let instances = scene.instances.iter();
    instances.map(|instance| instance.is_sphere).collect()
}

#[test]
fn spheres_are_written_and_read() {
    let file = written();
    assert_eq!(file.json["nodes"][1]["extras"], Value::Null);
    let read = file.import();
    assert_eq!(are_spheres(&read), [true, false]);
    assert_eq!(read.spheres(), balls().spheres());
}

/// Light that is kept beside a material leaves spheres what they are. Baked into emission, it makes triangles of them.
#[test]
fn baked_spheres_stay_spheres_unless_they_emit() {
    let scene = balls();
    let texels = (SIZE * SIZE) as usize;
    let lit = |light| BakedPage {
        light: Some(light),
        ..BakedPage::default()
    };
    let light = vec![Vec3::ONE; texels];
    for (page, is_sphere) in [
        (obscured(), true),
        (
            lit(BakedLight::Lightmap {
                texels: light.clone(),
                quantity: LightmapQuantity::Irradiance,
                with_hdr: false,
                file: "light.exr".to_owned(),
            }),
            true,
        ),
        (lit(BakedLight::Emissive(light)), false),
        (lit(BakedLight::Unlit(vec![[200; 4]; texels])), false),
    ] {
        let exported = export_bake(None, &scene, &shredded(&scene), &[page]).unwrap();
        let baked = Baked::new(&exported.glb);
        assert_eq!(are_spheres(&baked.scene), [is_sphere, false]);
        assert_eq!(baked.json["nodes"][0].get("extras").is_some(), is_sphere);
    }
}

/// A node that places many balls makes spheres of all, also after a bake, which replaces it by one node per ball.
#[test]
fn instanced_nodes_are_spheres() {
    let mut file = written();
    let places = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 3.0, 0.0]);
    let attributes = json!({ "TRANSLATION": places });
    let used = file.json["extensionsUsed"].as_array_mut().unwrap();
    used.push(json!("EXT_mesh_gpu_instancing"));
    file.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    let scene = file.import();
    let baked = crate::export::baking::bake(&file, &scene, &whole(&scene), obscured());
    for scene in [&scene, &baked.scene] {
        // Their order does not matter.
        let mut found = are_spheres(scene);
        found.sort_unstable();
        assert_eq!(found, [false, true, true]);
    }
}

#[test]
fn what_can_be_no_sphere_is_refused() {
    let sphere = "nodes[0].extras.gpugi.sphere";
    let mut file = written();
    file.json["nodes"][0]["extras"]["gpugi"]["sphere"] = json!("yes");
    file.assert_error("nodes[0].extras.gpugi", "expected a boolean");
    file.json["nodes"][0]["extras"]["gpugi"] = json!({ "shpere": true });
    file.assert_error("nodes[0].extras.gpugi", "unknown field `shpere`");
    file.json["nodes"][0]["extras"]["gpugi"] = json!({ "sphere": false });
    assert_eq!(are_spheres(&file.import()), [false, false]);

    let mut file = written();
    file.json["materials"][0]["emissiveFactor"] = json!([0.0, 0.1, 0.0]);
    file.assert_error(sphere, "must not emit light");
    let mut file = written();
    file.json["materials"][0]["alphaMode"] = json!("BLEND");
    file.assert_error(sphere, "must be opaque");

    let mut file = written();
    file.json["nodes"][0]
        .as_object_mut()
        .unwrap()
        .remove("mesh");
    file.assert_error(sphere, "has no mesh");
    let mut file = written();
    let positions = file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].clone();
    file.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": positions }]);
    file.assert_error(sphere, "must not bend");

    let mut scene = balls();
    scene.meshes[0] = cuboid(Vec3::NEG_ONE, Vec3::ONE, 1).into();
    // Only a file can say of a cube that it is a sphere.
    scene.instances[0].is_sphere = false;
    let mut file = file_of(&scene);
    file.json["nodes"][0]["extras"] = json!({ "gpugi": { "sphere": true } });
    file.assert_error(sphere, "must be a closed ball");
}
