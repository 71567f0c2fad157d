//! One of each: shapes, light types, reflection models, and ways to place a mesh.

use glam::{Mat4, Vec3, vec3};

use super::shapes::{cone, cuboid, cylinder, hexahedron, quad, sphere, torus};
use super::textures::leaf;
use crate::{
    AlphaMode, Camera, Light, LightKind, Material, MaterialModel, Mesh, Scene, Texture, TextureRef,
    Wrap,
};

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("shapes");
    scene.cameras.push(Camera::look_at(
        "front",
        vec3(0.6, 2.6, 6.4),
        vec3(0.0, 0.5, -0.2),
        40.0_f32.to_radians(),
    ));
    let image = scene.images.len();
    scene.images.push(leaf("leaf", 64).into());
    let texture = scene.textures.len();
    scene.textures.push(Texture {
        image,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: true,
    });

    let mut place = |mesh: Mesh, material: Material, at: Mat4| {
        let name = mesh.name.clone();
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(material);
        scene.add_instance(&name, mesh, material, at);
        (mesh, material)
    };
    let named = |name: &str, mesh: Mesh| Mesh {
        name: name.into(),
        ..mesh
    };
    let at = |x: f32, y: f32, z: f32| Mat4::from_translation(vec3(x, y, z));

    let plane = quad(
        vec3(-5.0, 0.0, 4.0),
        Vec3::X * 10.0,
        Vec3::NEG_Z * 8.0,
        8 * detail,
    );
    let grey = Material::matt("grey", Vec3::splat(0.5));
    place(named("plane", plane), grey, Mat4::IDENTITY);

    let cube = cuboid(vec3(-0.4, 0.0, -0.4), vec3(0.4, 0.8, 0.4), 2 * detail);
    let red = Material::matt("red", vec3(0.6, 0.1, 0.08));
    let turned = at(-1.9, 0.0, -0.3) * Mat4::from_rotation_y(0.5);
    place(named("cube", cube), red, turned);

    let phong = Material {
        name: "phong".into(),
        model: MaterialModel::Phong {
            kd: vec3(0.1, 0.25, 0.5),
            ks: Vec3::splat(0.4),
            shininess: 60.0,
        },
        ..Material::default()
    };
    let ball = place(sphere(0.45, 16 * detail), phong, at(-0.7, 0.45, 0.3)).0;

    let plastic = Material {
        name: "plastic".into(),
        base_color: vec3(0.15, 0.45, 0.12).extend(1.0),
        roughness: 0.3,
        ..Material::default()
    };
    let pillar = cylinder(0.35, 1.1, 24 * detail);
    place(pillar, plastic, at(0.4, 0.0, -0.6));

    // Gold at 650, 550 and 450 nm.
    let gold = Material {
        name: "gold".into(),
        model: MaterialModel::Conductor {
            n: vec3(0.143, 0.375, 1.442),
            k: vec3(3.983, 2.386, 1.603),
        },
        roughness: 0.2,
        ..Material::metal("gold", Vec3::ONE, 0.2)
    };
    let ring = torus(0.42, 0.16, 12 * detail);
    place(ring, gold, at(0.65, 0.16, 0.9));

    let yellow = Material::matt("yellow", vec3(0.7, 0.55, 0.1));
    place(cone(0.45, 1.0, 24 * detail), yellow, at(1.35, 0.0, -0.2));

    // The holes of the leaf let light and view rays through.
    let leaf = quad(
        vec3(-0.5, 0.0, 0.0),
        Vec3::X,
        vec3(0.0, 1.0, -0.3),
        2 * detail,
    );
    let masked = Material {
        base_color_texture: Some(TextureRef::new(texture)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        ..Material::matt("leaf", Vec3::ONE)
    };
    place(named("leaf", leaf), masked, at(-0.9, 0.0, -1.3));

    // A wedge and its mirror image: two instances of one mesh.
    let base = [
        vec3(0.1, 0.0, 0.4),
        vec3(0.9, 0.0, 0.4),
        vec3(0.9, 0.0, -0.4),
        vec3(0.1, 0.0, -0.4),
    ];
    let top = base.map(|corner| vec3(corner.x, 0.2 + 0.5 * corner.x, corner.z));
    let wedge = hexahedron(base, top, 2 * detail);
    let violet = Material::matt("violet", vec3(0.4, 0.2, 0.5));
    let (wedge, violet) = place(named("wedge", wedge), violet, at(2.3, 0.0, -0.9));
    let lamp = quad(
        vec3(-0.3, 2.2, -0.9),
        Vec3::X * 0.6,
        Vec3::Z * 0.6,
        2 * detail,
    );
    let emitter = Material::emitter("lamp", vec3(8.0, 7.0, 5.5));
    place(named("lamp", lamp), emitter, Mat4::IDENTITY);
    let mirrored = at(2.3, 0.0, -0.9) * Mat4::from_scale(vec3(-1.0, 1.0, 1.0));
    scene.add_instance("wedge, mirrored", wedge, violet, mirrored);
    let stretched = at(-2.9, 0.351, -1.2) * Mat4::from_scale(vec3(1.3, 0.78, 1.0));
    scene.add_instance("sphere, stretched", ball, violet, stretched);

    let point = Light::new("point", LightKind::Point, vec3(2.0, 1.6, 1.2))
        .aimed(vec3(-2.4, 1.8, 1.4), Vec3::ZERO);
    let cone = LightKind::Spot {
        inner_cone_angle: 15.0_f32.to_radians(),
        outer_cone_angle: 25.0_f32.to_radians(),
    };
    let spot = Light::new("spot", cone, vec3(18.0, 18.0, 20.0))
        .aimed(vec3(2.5, 3.0, 2.5), vec3(0.6, 0.2, 0.0));
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(0.8))
        .aimed(vec3(-1.0, 3.0, 1.5), Vec3::ZERO);
    scene.lights = vec![point, spot, sun];
    scene
}
