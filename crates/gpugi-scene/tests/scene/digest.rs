//! The hash of a scene: every field that a picture depends on changes it, and nothing else does.

use std::sync::Arc;

use glam::{Affine2, DVec3, Mat4, Vec2, Vec3, Vec4};
use gpugi_scene::{
    AlphaMode, Camera, Environment, Image, Lens, Light, LightKind, Material, MaterialModel, Mesh,
    Pixels, Projection, Scene, Texture, TextureRef, Volume, Wrap,
};

/// A scene in which everything is present.
fn scene() -> Scene {
    let mut scene = Scene::new("all");
    let mesh = scene.add_mesh(Mesh {
        name: "triangle".into(),
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 3],
        uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::Y], vec![Vec2::ONE; 3]],
        colors: vec![Vec4::ONE; 3],
        indices: vec![0, 1, 2],
        origin: DVec3::ZERO,
        tree: None,
    });
    let texture = Some(TextureRef::new(0));
    let material = scene.add_material(Material {
        base_color_texture: texture,
        metallic_roughness_texture: texture,
        normal_texture: texture,
        emissive_texture: texture,
        specular_texture: texture,
        specular_color_texture: texture,
        transmission_texture: texture,
        diffuse_transmission_texture: texture,
        diffuse_transmission_color_texture: texture,
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: Vec3::ONE,
        }),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        ..Material::default()
    });
    scene.add_material(Material::default());
    scene.add_instance("one", mesh, material, Mat4::IDENTITY);
    scene.textures = vec![
        Texture {
            image: 0,
            wrap: [Wrap::Repeat; 2],
            nearest: false,
            has_levels: true,
        };
        2
    ];
    let image = Image {
        name: "image".into(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8(vec![7; 8]),
    };
    scene.images = [&image; 2].map(|image| Arc::new(image.clone())).into();
    let spot = LightKind::Spot {
        inner_cone_angle: 0.1,
        outer_cone_angle: 0.2,
    };
    scene.lights.push(Light {
        range: Some(3.0),
        ..Light::new("spot", spot, Vec3::ONE)
    });
    scene.environment = Some(Environment {
        image: Arc::new(Image {
            pixels: Pixels::Rgba32Float(vec![0.5; 8]),
            ..image
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    scene
        .cameras
        .push(Camera::look_at("eye", Vec3::Z, Vec3::ZERO, 1.0));
    scene
}

/// A change, and what it is called.
type Change = (&'static str, fn(&mut Scene));

fn reference(material: &mut Material) -> &mut TextureRef {
    material.base_color_texture.as_mut().expect("a texture")
}

fn sky(scene: &mut Scene) -> &mut Environment {
    scene.environment.as_mut().expect("an environment")
}

fn mesh(scene: &mut Scene) -> &mut Mesh {
    Arc::make_mut(&mut scene.meshes[0])
}

fn image(scene: &mut Scene) -> &mut Image {
    Arc::make_mut(&mut scene.images[0])
}

fn texels(scene: &mut Scene) -> &mut Image {
    Arc::make_mut(&mut sky(scene).image)
}

const MATTERS: &[Change] = &[
    ("origin", |s| s.origin.x = 1000.0),
    ("position", |s| mesh(s).positions[2].y = 1.5),
    ("normal", |s| mesh(s).normals[0].x = 0.1),
    ("tangent", |s| mesh(s).tangents[0].w = -1.0),
    ("no tangents", |s| mesh(s).tangents.clear()),
    ("uv", |s| mesh(s).uvs[0][1].x = 0.5),
    ("second uv", |s| mesh(s).uvs[1][1].x = 0.5),
    ("uv sets exchanged", |s| mesh(s).uvs.swap(0, 1)),
    ("color", |s| mesh(s).colors[0].x = 0.5),
    ("index", |s| mesh(s).indices.swap(0, 1)),
    ("another mesh", |s| s.meshes.push(Mesh::default().into())),
    ("instance mesh", |s| s.instances[0].mesh = 1),
    ("instance material", |s| s.instances[0].material = 1),
    ("instance place", |s| {
        s.instances[0].world_from_mesh.w_axis.x = 1.0
    }),
    ("another instance", |s| {
        s.instances.push(s.instances[0].clone())
    }),
    ("conductor", |s| {
        s.materials[0].model = MaterialModel::Conductor {
            n: Vec3::ONE,
            k: Vec3::ONE,
        }
    }),
    ("phong", |s| {
        s.materials[0].model = MaterialModel::Phong {
            kd: Vec3::ONE,
            ks: Vec3::ONE,
            shininess: 1.0,
        }
    }),
    ("blinn", |s| {
        s.materials[0].model = MaterialModel::Blinn {
            kd: Vec3::ONE,
            ks: Vec3::ONE,
            shininess: 1.0,
        }
    }),
    ("shinier phong", |s| {
        s.materials[0].model = MaterialModel::Phong {
            kd: Vec3::ONE,
            ks: Vec3::ONE,
            shininess: 2.0,
        }
    }),
    ("base color", |s| s.materials[0].base_color.x = 0.5),
    ("base color texture", |s| {
        s.materials[0].base_color_texture = None
    }),
    ("metallic", |s| s.materials[0].metallic = 0.5),
    ("roughness", |s| s.materials[0].roughness = 0.5),
    ("metallic exchanged with specular", |s| {
        s.materials[0].metallic = 1.0;
        s.materials[0].specular = 0.0;
    }),
    ("metallic roughness texture", |s| {
        s.materials[0].metallic_roughness_texture = None
    }),
    ("normal texture", |s| s.materials[0].normal_texture = None),
    ("normal scale", |s| s.materials[0].normal_scale = 0.5),
    ("emissive", |s| s.materials[0].emissive.x = 0.5),
    ("emissive texture", |s| {
        s.materials[0].emissive_texture = None
    }),
    ("ior", |s| s.materials[0].ior = 1.4),
    ("specular", |s| s.materials[0].specular = 0.5),
    ("specular texture", |s| {
        s.materials[0].specular_texture = None
    }),
    ("specular color", |s| s.materials[0].specular_color.x = 0.5),
    ("specular color texture", |s| {
        s.materials[0].specular_color_texture = None
    }),
    ("transmission", |s| s.materials[0].transmission = 0.5),
    ("transmission texture", |s| {
        s.materials[0].transmission_texture = None
    }),
    ("diffuse transmission", |s| {
        s.materials[0].diffuse_transmission = 0.5
    }),
    ("diffuse transmission texture", |s| {
        s.materials[0].diffuse_transmission_texture = None
    }),
    ("diffuse transmission color", |s| {
        s.materials[0].diffuse_transmission_color.y = 0.5
    }),
    ("diffuse transmission color texture", |s| {
        s.materials[0].diffuse_transmission_color_texture = None
    }),
    ("no volume", |s| s.materials[0].volume = None),
    ("attenuation distance", |s| {
        s.materials[0].volume = Some(Volume {
            attenuation_distance: 2.0,
            attenuation_color: Vec3::ONE,
        })
    }),
    ("attenuation color", |s| {
        s.materials[0].volume = Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: Vec3::X,
        })
    }),
    ("opaque", |s| s.materials[0].alpha_mode = AlphaMode::Opaque),
    ("blend", |s| s.materials[0].alpha_mode = AlphaMode::Blend),
    ("cutoff", |s| {
        s.materials[0].alpha_mode = AlphaMode::Mask { cutoff: 0.6 }
    }),
    ("double sided", |s| s.materials[0].double_sided = true),
    ("texture", |s| reference(&mut s.materials[0]).texture = 1),
    ("uv set", |s| reference(&mut s.materials[0]).uv_set = 1),
    ("uv transform", |s| {
        reference(&mut s.materials[0]).uv_from_mesh = Affine2::from_scale(Vec2::splat(2.0))
    }),
    ("texture image", |s| s.textures[0].image = 1),
    ("wrap u", |s| s.textures[0].wrap[0] = Wrap::ClampToEdge),
    ("wrap v", |s| s.textures[0].wrap[1] = Wrap::ClampToEdge),
    ("mirrored", |s| s.textures[0].wrap[0] = Wrap::MirroredRepeat),
    ("nearest", |s| s.textures[0].nearest = true),
    ("levels", |s| s.textures[0].has_levels = false),
    ("texel", |s| image(s).pixels = Pixels::Rgba8(vec![8; 8])),
    ("float texels", |s| {
        image(s).pixels = Pixels::Rgba32Float(vec![7.0; 8])
    }),
    ("image shape", |s| {
        image(s).width = 1;
        image(s).height = 2;
    }),
    ("point light", |s| s.lights[0].kind = LightKind::Point),
    ("directional light", |s| {
        s.lights[0].kind = LightKind::Directional
    }),
    ("inner cone", |s| {
        s.lights[0].kind = LightKind::Spot {
            inner_cone_angle: 0.15,
            outer_cone_angle: 0.2,
        }
    }),
    ("outer cone", |s| {
        s.lights[0].kind = LightKind::Spot {
            inner_cone_angle: 0.1,
            outer_cone_angle: 0.3,
        }
    }),
    ("intensity", |s| s.lights[0].intensity.z = 2.0),
    ("no range", |s| s.lights[0].range = None),
    ("range", |s| s.lights[0].range = Some(4.0)),
    ("radius", |s| s.lights[0].radius = 0.1),
    ("light place", |s| {
        s.lights[0].world_from_light.w_axis.x = 1.0
    }),
    ("no light", |s| s.lights.clear()),
    ("sky texel", |s| {
        texels(s).pixels = Pixels::Rgba32Float(vec![0.6; 8])
    }),
    ("sky rotation", |s| {
        sky(s).rotation = glam::Quat::from_rotation_y(1.0)
    }),
    ("sky intensity", |s| sky(s).intensity = 2.0),
    ("no sky", |s| s.environment = None),
];

const DOES_NOT: &[Change] = &[
    ("scene name", |s| s.name = "other".into()),
    ("mesh name", |s| mesh(s).name = "other".into()),
    ("instance name", |s| s.instances[0].name = "other".into()),
    ("material name", |s| s.materials[0].name = "other".into()),
    ("image name", |s| image(s).name = "other".into()),
    ("sky name", |s| texels(s).name = "other".into()),
    ("light name", |s| s.lights[0].name = "other".into()),
    ("camera", |s| s.cameras.clear()),
    ("warning", |s| s.warnings.push("other".into())),
    ("trees", Scene::build_trees),
    ("node", |s| s.instances[0].node = Some(3)),
];

#[test]
fn every_value_that_matters_changes_the_digest() {
    let mut digests = vec![("nothing", scene().digest())];
    for (what, change) in MATTERS {
        let mut changed = scene();
        change(&mut changed);
        let digest = changed.digest();
        if let Some((other, _)) = digests.iter().find(|(_, other)| *other == digest) {
            panic!("{what} has the digest of {other}");
        }
        digests.push((what, digest));
    }
}

#[test]
fn names_and_what_follows_from_the_rest_do_not() {
    for (what, change) in DOES_NOT {
        let mut changed = scene();
        change(&mut changed);
        assert_eq!(changed.digest(), scene().digest(), "{what}");
    }
}

#[test]
fn a_camera_is_where_it_is_and_how_it_projects() {
    let camera = scene().cameras[0].clone();
    let renamed = Camera {
        name: "other".into(),
        ..camera.clone()
    };
    assert_eq!(renamed.digest(), camera.digest());
    let changes: [fn(&mut Camera); 7] = [
        |_| {},
        |camera| camera.world_from_view.w_axis.x = 1.0,
        |camera| camera.projection = Projection::Perspective { vertical_fov: 1.5 },
        |camera| camera.projection = Projection::Orthographic { height: 1.0 },
        |camera| camera.lens = Lens::new(0.1, 2.0, 0).unwrap(),
        |camera| camera.lens = Lens::new(0.1, 2.0, 6).unwrap(),
        |camera| camera.shutter = 0.02,
    ];
    let digests = changes.map(|change| {
        let mut changed = camera.clone();
        change(&mut changed);
        changed.digest()
    });
    for (index, digest) in digests.iter().enumerate() {
        assert!(!digests[..index].contains(digest), "change {index}");
    }
}
