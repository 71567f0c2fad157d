//! Scenes that come from no glTF file.

use std::sync::Arc;

use glam::{Affine2, Vec2, Vec3, Vec4, vec2, vec3};
use gpugi_scene::export::{BakedLight, BakedPage, export_bake, export_scene};
use gpugi_scene::{
    AlphaMode, Camera, Image, Lens, Light, LightKind, Limits, Material, MaterialModel, Mesh,
    Pixels, Projection, Scene, Texture, TextureRef, Volume, Wrap, builtin, import,
};

use crate::builder::{Files, png};
use crate::export::baking::{Baked, SIZE, assert_mapped, obscured, positions, shredded};

#[test]
fn built_in_scenes_keep_their_triangles_and_can_be_baked() {
    for builtin::BuiltinScene { name, .. } in builtin::SCENES {
        let scene = builtin::builtin(name, 1).unwrap();
        let written = Baked::new(&export_scene(&scene).unwrap().glb);
        assert!(positions(&scene) == positions(&written.scene), "{name}");
        assert_eq!(scene.lights.len(), written.scene.lights.len());
        assert_eq!(scene.cameras.len(), written.scene.cameras.len());
    }
}

#[test]
fn cornell_can_be_baked() {
    let scene = builtin::builtin("cornell", 1).unwrap();
    let atlas = shredded(&scene);
    let texels = vec![Vec3::splat(2.0); (SIZE * SIZE) as usize];
    let page = BakedPage {
        light: Some(BakedLight::Emissive(texels)),
        ..obscured()
    };
    let exported = export_bake(None, &scene, &atlas, &[page]).unwrap();
    assert_eq!(exported.warnings, [""; 0]);
    let baked = Baked::new(&exported.glb);
    assert_mapped(&scene, &atlas, &baked.scene, 0);
    let names = |scene: &Scene| -> Vec<String> {
        scene
            .instances
            .iter()
            .map(|instance| instance.name.to_string())
            .collect()
    };
    assert_eq!(names(&baked.scene), names(&scene));
    for instance in &baked.scene.instances {
        let material = &baked.scene.materials[instance.material];
        assert_eq!(material.emissive, Vec3::splat(2.0));
        assert!(material.emissive_texture.is_some());
    }
}

#[test]
fn other_formats_can_be_baked() {
    let obj = "mtllib m.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nvt 1 1\n\
        f 1/1 2/1 3/2\nusemtl blue\nf 3/1 4/1 1/2\n";
    let mtl = "newmtl red\nKd 1 0 0\nmap_Kd -s 2 3 1 t.png\nnewmtl blue\nKd 0 0 1\n";
    let files = Files(
        [
            ("m.mtl".to_owned(), mtl.as_bytes().to_vec()),
            ("t.png".to_owned(), png(1, 1, &[255, 0, 0, 255])),
        ]
        .into(),
    );
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 1 2 3\n1 0 0 4 5 6\n0 1 0 7 8 9\n3 0 1 2\n";
    for (name, text) in [("a.obj", obj), ("a.ply", ply)] {
        let scene = import(name, text.as_bytes(), &files, &Limits::default());
        let scene = scene.unwrap_or_else(|error| panic!("{error}"));
        assert!(
            scene
                .instances
                .iter()
                .all(|instance| instance.origin.is_none())
        );
        let atlas = shredded(&scene);
        let exported = export_bake(None, &scene, &atlas, &[obscured()]).unwrap();
        let baked = Baked::new(&exported.glb);
        assert_mapped(&scene, &atlas, &baked.scene, 1);
        let texture = |scene: &Scene| {
            let material = &scene.materials[scene.instances[0].material];
            material
                .base_color_texture
                .map(|texture| texture.uv_from_mesh)
        };
        assert_eq!(texture(&baked.scene), texture(&scene));
        assert_eq!(name == "a.obj", texture(&scene).is_some());
    }
}

/// A scene with everything that glTF can say.
fn everything() -> Scene {
    let mut scene = Scene::new("everything");
    scene.images.push(Arc::new(Image {
        name: "checks".to_owned(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8(vec![1, 2, 3, 4, 5, 6, 7, 8]),
    }));
    scene.textures.push(Texture {
        image: 0,
        wrap: [Wrap::MirroredRepeat, Wrap::ClampToEdge],
        nearest: true,
        has_levels: true,
    });
    let plain = TextureRef::new(0);
    let turned = TextureRef {
        uv_set: 1,
        uv_from_mesh: Affine2::from_scale_angle_translation(vec2(2.0, 3.0), 0.5, vec2(0.1, 0.2)),
        ..plain
    };
    scene.add_material(Material {
        name: "glass".to_owned(),
        base_color: Vec4::new(0.1, 0.2, 0.3, 0.4),
        base_color_texture: Some(plain),
        metallic: 0.25,
        roughness: 0.75,
        metallic_roughness_texture: Some(plain),
        normal_texture: Some(plain),
        normal_scale: 0.5,
        emissive: vec3(8.0, 4.0, 2.0),
        emissive_texture: Some(turned),
        ior: 1.25,
        specular: 0.5,
        specular_texture: Some(plain),
        specular_color: vec3(0.5, 1.0, 0.25),
        specular_color_texture: Some(plain),
        transmission: 0.5,
        transmission_texture: Some(plain),
        diffuse_transmission: 0.25,
        diffuse_transmission_texture: Some(plain),
        diffuse_transmission_color: vec3(1.0, 0.5, 0.25),
        diffuse_transmission_color_texture: Some(turned),
        volume: Some(Volume {
            attenuation_distance: 2.0,
            attenuation_color: vec3(0.5, 0.25, 1.0),
        }),
        alpha_mode: AlphaMode::Mask { cutoff: 0.25 },
        double_sided: true,
        ..Material::default()
    });
    let mesh = Mesh {
        name: "triangle".into(),
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, -1.0); 3],
        uvs: [vec![Vec2::ZERO; 3], vec![Vec2::ONE; 3]],
        colors: vec![Vec4::splat(0.5); 3],
        indices: vec![2, 0, 1],
        origin: glam::DVec3::ZERO,
        tree: None,
    };
    let mesh = scene.add_mesh(mesh);
    let place = glam::Mat4::from_scale_rotation_translation(
        vec3(1.0, -2.0, 3.0),
        glam::Quat::from_rotation_x(0.5),
        Vec3::ONE,
    );
    scene.add_instance("first", mesh, 0, place);
    scene
        .cameras
        .push(Camera::look_at("front", Vec3::Z, Vec3::ZERO, 1.0));
    scene.cameras.push(Camera {
        projection: Projection::Orthographic { height: 3.0 },
        lens: Lens::new(0.25, 1.5, 6).unwrap(),
        shutter: 0.125,
        ..Camera::look_at("plan", Vec3::Y, Vec3::ZERO, 1.0)
    });
    let spot = LightKind::Spot {
        inner_cone_angle: 0.25,
        outer_cone_angle: 0.5,
    };
    for kind in [LightKind::Point, LightKind::Directional, spot] {
        let light = Light::new("lamp", kind, vec3(8.0, 4.0, 2.0));
        scene.lights.push(Light {
            range: Some(9.0),
            radius: 0.125,
            ..light.aimed(Vec3::Y, Vec3::ZERO)
        });
    }
    scene
}

#[test]
fn what_gltf_can_say_comes_back() {
    let scene = everything();
    let exported = export_scene(&scene).unwrap();
    let back = Baked::new(&exported.glb).scene;
    assert_eq!(back.meshes, scene.meshes);
    assert_eq!(back.images, scene.images);
    assert_eq!(back.textures, scene.textures);
    assert_eq!(back.lights, scene.lights);
    assert_eq!(back.cameras, scene.cameras);
    assert_eq!(
        back.instances[0].world_from_mesh,
        scene.instances[0].world_from_mesh
    );
    let mut material = back.materials[0].clone();
    let turned = |material: &Material| material.emissive_texture.unwrap().uv_from_mesh;
    assert!(turned(&material).abs_diff_eq(turned(&scene.materials[0]), 1e-6));
    material.emissive_texture = scene.materials[0].emissive_texture;
    assert_eq!(material, scene.materials[0]);
}

/// The tutorial's models come back, and base colour times albedo is what it was, while other viewers see the colour.
#[test]
fn other_models_come_back() {
    let mut scene = everything();
    let kd = vec3(0.5, 0.25, 0.125);
    let phong = Material {
        model: MaterialModel::Phong {
            kd,
            ks: Vec3::splat(0.25),
            shininess: 20.0,
        },
        ..Material::default()
    };
    scene.materials[0] = phong;
    let back = Baked::new(&export_scene(&scene).unwrap().glb).scene;
    let material = &back.materials[0];
    let MaterialModel::Phong {
        kd: grey,
        ks,
        shininess,
    } = material.model
    else {
        panic!("{:?}", material.model);
    };
    assert_eq!((ks, shininess), (Vec3::splat(0.25), 20.0));
    assert_eq!(grey * material.base_color.truncate(), kd);
    assert_eq!(material.base_color.truncate(), kd / 0.5);

    let blinn = MaterialModel::Blinn {
        kd: Vec3::splat(0.5),
        ks: Vec3::splat(0.25),
        shininess: 20.0,
    };
    scene.materials[0].model = blinn;
    let back = Baked::new(&export_scene(&scene).unwrap().glb).scene;
    assert_eq!(
        back.materials[0].model,
        MaterialModel::Blinn {
            kd: Vec3::splat(0.5),
            ks: Vec3::splat(0.25),
            shininess: 20.0
        }
    );

    let conductor = MaterialModel::Conductor {
        n: Vec3::splat(0.5),
        k: Vec3::splat(3.0),
    };
    scene.materials[0] = Material {
        model: conductor,
        ..Material::default()
    };
    let back = Baked::new(&export_scene(&scene).unwrap().glb).scene;
    assert_eq!(back.materials[0].model, conductor);
    let reflectance = 9.25 / 11.25;
    assert!((back.materials[0].base_color.x - reflectance).abs() < 1e-6);
}
