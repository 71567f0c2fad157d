//! `gpugi bake`: which surfaces are baked, on which side, and into how many pages.

use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::Arc;

use crate::common::{folder, gpugi, skip_gpu};
use glam::{Mat4, Vec3, Vec3Swizzles};
use gpugi_scene::export::export_scene;
use gpugi_scene::{Light, LightKind, Limits, Material, Mesh, Pixels, Scene};

const SMALL: [&str; 4] = ["--atlas-size", "64", "--samples", "1"];

fn write(folder: &Path, name: &str, scene: &Scene) -> String {
    let path = folder.join(name);
    std::fs::write(&path, export_scene(scene).expect("a file").glb).expect("written");
    path.display().to_string()
}

/// Bakes, and says what the command said.
fn bake(scene: &str, output: &Path, options: &[&str]) -> (Output, String) {
    let output = output.display().to_string();
    let baked = gpugi(&[&["bake", scene, "-o", &output][..], &SMALL, options].concat());
    let message = String::from_utf8_lossy(&baked.stderr).into_owned();
    (baked, message)
}

/// A triangle under a lamp.
fn triangle(material: Material) -> Scene {
    let mut scene = Scene::new("triangle");
    let mesh = scene.add_mesh(Mesh {
        positions: vec![Vec3::ZERO, Vec3::Z, Vec3::X],
        normals: vec![Vec3::Y; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    });
    let material = scene.add_material(material);
    scene.add_instance("triangle", mesh, material, Mat4::IDENTITY);
    let lamp = Light::new("lamp", LightKind::Point, Vec3::ONE);
    scene.lights.push(lamp.aimed(Vec3::Y, Vec3::ZERO));
    scene
}

/// Without a diffuse surface there is nothing to bake, which is no error.
#[test]
fn metal_and_lamps_keep_their_materials() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-metal");
    let metal = write(
        &folder,
        "metal.glb",
        &triangle(Material::metal("gold", Vec3::ONE, 0.5)),
    );
    let lamp = write(
        &folder,
        "lamp.glb",
        &triangle(Material::emitter("lamp", Vec3::ONE)),
    );
    let nothing = write(&folder, "nothing.glb", &Scene::new("nothing"));
    let output = folder.join("baked.glb");
    for (scene, mode, said, has_texture) in [
        (
            &metal,
            "unlit",
            "nothing is baked: all surfaces keep their materials",
            false,
        ),
        (
            &metal,
            "emissive",
            "nothing is baked: all surfaces keep their materials",
            false,
        ),
        (&metal, "lightmap", "", true),
        (&lamp, "emissive", "what emits light", false),
        (&nothing, "unlit", "the scene has no surfaces", false),
    ] {
        let options = ["--bake-mode", mode, "--include", "direct"];
        let (baked, message) = bake(scene, &output, &options);
        assert!(baked.status.success(), "{scene} {mode}: {message}");
        assert!(message.contains(said), "{scene} {mode}: {message}");
        let glb = std::fs::read(&output).expect("a file");
        let has = |part: &str| String::from_utf8_lossy(&glb).contains(part);
        assert_eq!(has("\"images\""), has_texture, "{scene} {mode}");
        assert!(!has("KHR_materials_unlit"), "{scene} {mode}");
    }
}

/// A box of 2 x 2 x 2 m around the origin, double-sided.
fn box_of(is_inward: bool) -> Scene {
    let mut mesh = Mesh::default();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        for normal in [axis, -axis] {
            let across = normal.yzx();
            let first = mesh.positions.len() as u32;
            for [u, v] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                let position = normal + across * u + normal.cross(across) * v;
                mesh.positions.push(position);
                mesh.normals.push(if is_inward { -normal } else { normal });
            }
            let corners = if is_inward {
                [0, 2, 1, 0, 3, 2]
            } else {
                [0, 1, 2, 0, 2, 3]
            };
            mesh.indices.extend(corners.map(|corner| first + corner));
        }
    }
    assert!(mesh.is_closed());
    let mut scene = Scene::new("box");
    let mesh = scene.add_mesh(Arc::new(mesh));
    let matt = Material::matt("matt", Vec3::splat(0.5));
    let material = scene.add_material(Material {
        double_sided: true,
        ..matt
    });
    scene.add_instance("box", mesh, material, Mat4::IDENTITY);
    scene
}

/// The greatest irradiance in the texels of a bake.
fn most_irradiance(folder: &Path, name: &str, scene: &Scene) -> f32 {
    let file = write(folder, &format!("{name}.glb"), scene);
    let output: PathBuf = folder.join(format!("{name}-baked.glb"));
    let options = ["--bake-mode", "lightmap", "--include", "direct"];
    let (baked, message) = bake(&file, &output, &options);
    assert!(baked.status.success(), "{name}: {message}");
    let lightmap = folder.join(format!("{name}-baked-0.exr"));
    let lightmap = gpugi_scene::import_environment(&lightmap, &Limits::default());
    let Pixels::Rgba32Float(texels) = &lightmap.expect("an image").image.pixels else {
        panic!("an .exr holds floats");
    };
    texels.chunks(4).fold(0.0, |most, texel| texel[0].max(most))
}

/// However a box is wound, its texels hold the light of the side that light reaches.
#[test]
fn texels_lie_on_the_side_that_is_lit() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-sides");
    for is_inward in [false, true] {
        let mut solid = box_of(is_inward);
        let sun = Light::new("sun", LightKind::Directional, Vec3::splat(3.0));
        solid.lights.push(sun.aimed(Vec3::Y, Vec3::ZERO));
        let name = format!("solid-{is_inward}");
        let irradiance = most_irradiance(&folder, &name, &solid);
        assert!((irradiance - 3.0).abs() < 0.03, "{name}: {irradiance}");

        // The middles of the walls are 1 m away.
        let mut room = box_of(is_inward);
        let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(2.0));
        room.lights.push(lamp);
        let name = format!("room-{is_inward}");
        let irradiance = most_irradiance(&folder, &name, &room);
        assert!((irradiance - 2.0).abs() < 0.05, "{name}: {irradiance}");
    }
}

/// Triangles that do not touch, each a chart of its own, as `objects` objects.
fn confetti(folder: &Path, objects: usize, triangles: usize) -> String {
    let mut text = String::new();
    for object in 0..objects {
        text += &format!("o object{object}\n");
        for triangle in 0..triangles {
            let (x, y) = (2 * triangle, 2 * object);
            text += &format!(
                "v {x} {y} 0\nv {} {y} 0\nv {x} {} 0\nf -3 -2 -1\n",
                x + 1,
                y + 1
            );
        }
    }
    let path = folder.join(format!("confetti-{objects}.obj"));
    std::fs::write(&path, text).expect("written");
    path.display().to_string()
}

/// No density makes gutters smaller.
#[test]
fn pages_that_gutters_overfill_are_told_apart_from_too_dense_texels() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-gutters");
    let output = folder.join("baked.glb");
    let options = [
        "--technique",
        "obscurances",
        "--set",
        "obscurances.directions=1",
    ];
    let one = confetti(&folder, 1, 300);
    let (refused, message) = bake(&one, &output, &options);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(
        message.contains("take larger pages (--atlas-size)"),
        "{message}"
    );
    let dense = [&options[..], &["--texel-density", "40"]].concat();
    let (refused, message) = bake(&one, &output, &dense);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(
        message.contains("fewer texels per metre, or larger pages"),
        "{message}"
    );
    let many = confetti(&folder, 300, 1);
    let (baked, message) = bake(&many, &output, &options);
    assert!(baked.status.success(), "{message}");
    assert!(
        message.contains("a larger --atlas-size or a smaller --gutter"),
        "{message}"
    );
    let said = String::from_utf8_lossy(&baked.stdout).into_owned();
    assert!(said.contains("pages of 64x64 texels"), "{said}");
}
