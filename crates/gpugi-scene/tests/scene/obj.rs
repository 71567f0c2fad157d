//! OBJ + MTL import.

use std::collections::HashMap;

use glam::{DVec3, Vec2, Vec3, vec3, vec4};
use gpugi_scene::{
    AlphaMode, ImportError, Limits, Material, MaterialModel, Pixels, Resolver, Scene, import,
};

use crate::random::Random;

/// Files by name.
#[derive(Default)]
pub struct Files(HashMap<&'static str, Vec<u8>>);

impl Files {
    pub fn with(mut self, name: &'static str, bytes: impl Into<Vec<u8>>) -> Self {
        self.0.insert(name, bytes.into());
        self
    }
}

impl Resolver for Files {
    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        self.0
            .get(uri)
            .cloned()
            .ok_or_else(|| "no such file".into())
    }
}

fn read(obj: impl AsRef<[u8]>, files: &Files) -> Result<Scene, ImportError> {
    import("test.obj", obj.as_ref(), files, &Limits::default())
}

/// A scene of one triangle whose material has the given statements.
fn material(statements: &str, files: Files) -> (Material, Scene) {
    let obj = "mtllib test.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    let files = files.with("test.mtl", format!("newmtl a\n{statements}\n"));
    let scene = read(obj, &files).unwrap();
    (scene.materials[scene.instances[0].material].clone(), scene)
}

/// A PNG file of one row.
fn png(texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_raw(texels.len() as u32, 1, texels.concat())
        .unwrap()
        .write_to(&mut bytes, image::ImageFormat::Png)
        .unwrap();
    bytes.into_inner()
}

const HOUSE: &str = "# a cube with a pyramid on it
mtllib house.mtl
o walls
v -1 0 1
v 1 0 1
v 1 0 -1
v -1 0 -1
v -1 2 1
v 1 2 1
v 1 2 -1
v -1 2 -1
v 0 3.5 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl Brick #7
s off
f 1/1/1 2/2/1 6/3/1 5/4/1 # front
f 2 3 \\
  7 6
f 3 4 8 7
f 4 1 5 8
f 4 3 2 1
o roof
usemtl tiles
f -5 -4 -1
f -4 -3 -1
f -3 -2 -1
f -2 -5 -1
l 1 2
";

const LIBRARY: &str = "# two materials
newmtl Brick #7
Kd 0.6 0.2 0.1
d 1
illum 1
newmtl tiles
Kd 0.5 0.3 0.3
Ks 0.4 0.4 0.4
Ns 50
map_Kd -s 2 3 1 -o 0.25 0.5 my tiles.png
";

fn house() -> Files {
    let texels = [[255, 0, 0, 255], [0, 255, 0, 255]];
    Files::default()
        .with("house.mtl", LIBRARY)
        .with("my tiles.png", png(&texels))
}

#[test]
fn groups_and_materials_become_instances() {
    let scene = read(HOUSE, &house()).unwrap();
    assert_eq!(scene.warnings, ["OBJ statement \"l\" is not supported"]);
    let names: Vec<&str> = scene
        .instances
        .iter()
        .map(|instance| instance.name.as_str())
        .collect();
    assert_eq!(names, ["walls (Brick #7)", "roof (tiles)"]);
    let [walls, roof] = &scene.meshes[..] else {
        panic!()
    };
    assert_eq!((walls.indices.len(), roof.indices.len()), (30, 12));
    assert!(!walls.is_closed(), "the roof is a mesh of its own");
    assert_eq!(walls.uvs[0].len(), walls.positions.len());
    assert!(roof.uvs[0].is_empty());
    // The crease angle keeps every face flat.
    for mesh in [walls, roof] {
        assert!(mesh.check().is_ok());
        for triangle in mesh.indices.chunks(3) {
            let [a, b, c] = [0, 1, 2].map(|i| mesh.positions[triangle[i] as usize]);
            let face = (b - a).cross(c - a).normalize();
            assert!(mesh.normals[triangle[0] as usize].dot(face) > 0.9999);
        }
    }
    let [brick, tiles] = [0, 1].map(|i| &scene.materials[scene.instances[i].material]);
    assert_eq!(
        *brick,
        Material {
            name: "Brick #7".into(),
            ..Material::matt("", vec3(0.6, 0.2, 0.1))
        }
    );
    let MaterialModel::Phong { kd, ks, shininess } = tiles.model else {
        panic!("{tiles:?}")
    };
    assert_eq!(
        (kd, ks, shininess),
        (vec3(0.5, 0.3, 0.3), Vec3::splat(0.4), 50.0)
    );
    // (u, v upward) -> (2 u + 0.25, 3 v + 0.5)
    let uv_from_mesh = tiles.base_color_texture.unwrap().uv_from_mesh;
    let moved = uv_from_mesh.transform_point2(Vec2::new(0.5, 1.0 - 0.1));
    assert!(
        moved.abs_diff_eq(Vec2::new(1.25, 1.0 - 0.8), 1e-6),
        "{moved}"
    );
}

#[test]
fn given_normals_and_coordinates_are_kept() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.75\nvn 0 0 3\nvn 0 1 0\nf 1/1/1 2/1/2 3/1/-1\n";
    let scene = read(obj, &Files::default()).unwrap();
    assert_eq!(scene.meshes[0].normals, [Vec3::Z, Vec3::Y, Vec3::Y]);
    assert_eq!(scene.meshes[0].uvs[0], [Vec2::new(0.25, 0.25); 3]);
    assert_eq!(scene.materials[0].name, "default");
    assert!(scene.warnings.is_empty());
}

#[test]
fn phong_never_makes_light() {
    let (material, scene) = material("Kd 0.8 0.8 0.8\nKs 0.8 0.1 0.1", Files::default());
    let MaterialModel::Phong { kd, ks, .. } = material.model else {
        panic!()
    };
    assert!(((kd + ks).max_element() - 1.0).abs() < 1e-6);
    assert!((kd.x / ks.x - 1.0).abs() < 1e-6 && (kd.y / ks.y - 8.0).abs() < 1e-4);
    assert!(scene.warnings[0].contains("Kd + Ks is 1.6"));
}

#[test]
fn other_statements() {
    let none = Files::default;
    assert_eq!(
        material("Kd 1 1 1\nKs 1 1 1\nillum 1", none()).0.model,
        MaterialModel::MetallicRoughness
    );
    let (lamp, _) = material("Kd 0 0 0\nKe 5 4 3", none());
    assert_eq!(lamp.emissive, vec3(5.0, 4.0, 3.0));
    for statement in ["d 0.25", "Tr 0.75", "d 0.25\nTr 0.5"] {
        let (glass, _) = material(statement, none());
        assert_eq!(
            (glass.base_color, glass.alpha_mode),
            (vec4(0.6, 0.6, 0.6, 0.25), AlphaMode::Blend)
        );
    }
    let (metal, _) = material("Kd 0.9 0.6 0.2\nKs 1 1 1\nPr 0.3\nPm 1\nNi 1.4", none());
    assert_eq!(
        (metal.roughness, metal.metallic, metal.ior),
        (0.3, 1.0, 1.4)
    );
    let (_, scene) = material("map_Ks shine.png\nrefl mirror.png", none());
    assert!(scene.warnings[0].contains("test.mtl: MTL statement \"map_Ks\""));
    assert!(scene.warnings[1].contains("refl"));
}

#[test]
fn textures_are_decoded_once_and_alpha_is_merged() {
    let color = png(&[[10, 20, 30, 255], [40, 50, 60, 255]]);
    let coverage = png(&[
        [255, 255, 255, 255],
        [90, 90, 90, 255],
        [0, 0, 0, 255],
        [0, 0, 0, 255],
    ]);
    let files = || {
        Files::default()
            .with("a/color.png", color.clone())
            .with("alpha.png", coverage.clone())
    };
    let (leaf, scene) = material("map_Kd a\\color.png\nmap_d -clamp on alpha.png", files());
    assert_eq!(leaf.alpha_mode, AlphaMode::Blend);
    assert_eq!(leaf.base_color, vec4(1.0, 1.0, 1.0, 1.0));
    let image = scene.textures[leaf.base_color_texture.unwrap().texture].image;
    assert_eq!(
        scene.images[image].pixels,
        Pixels::Rgba8(vec![10, 20, 30, 255, 40, 50, 60, 0])
    );

    let (both, scene) = material(
        "map_Kd a/color.png\nmap_Ke a/color.png\nnorm -bm 0.5 alpha.png",
        files(),
    );
    assert_eq!((scene.images.len(), scene.textures.len()), (2, 2));
    assert_eq!(both.emissive, Vec3::ONE);
    assert_eq!(both.normal_scale, 0.5);
    assert_eq!(scene.meshes[0].tangents.len(), 3);
}

#[test]
fn what_is_missing_is_a_warning() {
    let scene = read(HOUSE, &Files::default()).unwrap();
    assert!(
        scene
            .warnings
            .iter()
            .any(|warning| warning == "material library house.mtl: no such file")
    );
    assert!(
        scene
            .warnings
            .iter()
            .any(|warning| warning.contains("\"tiles\" is in no library"))
    );
    assert_eq!(scene.materials.len(), 1);
    let (grey, scene) = material("map_Kd nowhere.png", Files::default());
    assert_eq!(grey.base_color_texture, None);
    assert!(scene.warnings[0].contains("nowhere.png: no such file"));
    let (_, scene) = material(
        "map_Kd bad.png",
        Files::default().with("bad.png", *b"no picture"),
    );
    assert!(scene.warnings[0].contains("bad.png"));
}

#[test]
fn errors_name_the_line() {
    let error = |obj: &str| read(obj, &Files::default()).unwrap_err().to_string();
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (obj, wanted) in [
        (String::new(), "test.obj: whole file: there are no faces"),
        ("v 1 2".into(), "test.obj: line 1: 2 numbers where 3 belong"),
        ("v 1 2 nan".into(), "line 1: \"nan\" is no finite number"),
        ("v 1 2 1e39".into(), "line 1: \"1e39\" is no finite number"),
        ("\nvn 1 x 1".into(), "line 2: \"x\" is no finite number"),
        ("vt".into(), "line 1: 0 numbers where 1 belong"),
        (
            format!("{triangle}f 1 2 4"),
            "line 4: vertex 4 does not exist: there are 3 so far",
        ),
        (format!("{triangle}f 1 2 0"), "vertex 0 does not exist"),
        (format!("{triangle}f 1 2 -4"), "vertex -4 does not exist"),
        (
            format!("{triangle}f 1 2 -9223372036854775808"),
            "does not exist",
        ),
        (
            format!("{triangle}f 1/1 2 3"),
            "texture coordinate 1 does not exist: there are 0",
        ),
        (format!("{triangle}f 1//1 2 3"), "normal 1 does not exist"),
        (format!("{triangle}f / 2 3"), "\"/\" names no vertex"),
        (
            format!("{triangle}f 1 2 three"),
            "\"three\" is no face corner",
        ),
        (
            format!("{triangle}f 1 \\\n2"),
            "line 4: a face with 2 corners",
        ),
    ] {
        let message = error(&obj);
        assert!(message.contains(wanted), "{message:?} lacks {wanted:?}");
    }
    let library = Files::default().with("house.mtl", "newmtl a\nKd 1 nan 1\n");
    let message = read(HOUSE, &library).unwrap_err().to_string();
    assert_eq!(message, "house.mtl: line 2: \"nan\" is no finite number");
    let small = Limits {
        scene_bytes: 2000,
        ..Limits::default()
    };
    let refused = import("test.obj", HOUSE.as_bytes(), &house(), &small).unwrap_err();
    assert!(refused.place.starts_with("line ") && refused.reason.contains("--limits scene"));
}

#[test]
fn huge_polygons_and_flat_triangles_survive() {
    let mut obj = String::new();
    let corners = 100_000;
    for i in 0..corners {
        let angle = i as f32 / corners as f32 * std::f32::consts::TAU;
        obj += &format!("v {} {} 0\n", angle.cos(), angle.sin());
    }
    obj += "f";
    (1..=corners).for_each(|i| obj += &format!(" {i}"));
    obj += "\nf 1 1 1\nf 1 2 2\n";
    let scene = read(obj, &Files::default()).unwrap();
    assert_eq!(scene.meshes[0].indices.len(), 3 * (corners - 2 + 2));
    assert!(
        scene.meshes[0]
            .normals
            .iter()
            .all(|normal| normal.is_normalized())
    );
}

#[test]
fn damaged_files_never_panic() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut read_well = 0;
    let mut check = |obj: &[u8], files: &Files| {
        if let Ok(scene) = read(obj, files) {
            read_well += 1;
            assert!(scene.meshes.iter().all(|mesh| mesh.check().is_ok()));
        }
    };
    for case in 0..900 {
        match case % 3 {
            0 | 1 => check(&random.damage(HOUSE.as_bytes()), &house()),
            _ => {
                let library = random.damage(LIBRARY.as_bytes());
                check(HOUSE.as_bytes(), &house().with("house.mtl", library));
            }
        }
    }
    for length in 0..HOUSE.len() {
        check(&HOUSE.as_bytes()[..length], &house());
    }
    println!("{read_well} damaged files still made a scene");
}

/// A square of 8 x 8 with a hole of 4 x 4, which a bridge joins to the edge: by vertices 1 and 5 twice, and by vertices
/// at equal positions.
const WINDOWS: [&str; 2] = [
    "v -4 0 -4\nv -4 0 4\nv 4 0 4\nv 4 0 -4\nv -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\n\
        f 1 2 3 4 1 5 6 7 8 5\n",
    "v -4 0 -4\nv -4 0 4\nv 4 0 4\nv 4 0 -4\nv -4 0 -4\nv -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nv -2 0 -2\n\
        f 1 2 3 4 5 6 7 8 9 10\n",
];

#[test]
fn holes_of_faces_stay_open() {
    for window in WINDOWS {
        let scene = read(window, &Files::default()).unwrap();
        let mesh = &scene.meshes[0];
        assert!((mesh.area() - 48.0).abs() < 1e-6, "{}", mesh.area());
        assert!(mesh.normals.iter().all(|normal| *normal == Vec3::Y));
    }
}

#[test]
fn concave_faces_of_very_many_corners_are_noted() {
    let star = |corners: usize, inner: f64| {
        let vertices = (0..corners).map(|i| {
            let angle = i as f64 / corners as f64 * std::f64::consts::TAU;
            let radius = if i % 2 == 0 { 1.0 } else { inner };
            format!("v {} {} 0\n", angle.cos() * radius, angle.sin() * radius)
        });
        let face: String = (1..=corners).map(|i| format!(" {i}")).collect();
        let file = vertices.collect::<String>() + "f" + &face + "\n";
        read(file, &Files::default()).unwrap().warnings
    };
    assert!(star(300, 0.5).is_empty());
    assert!(star(302, 1.0).is_empty());
    let notes = star(302, 0.5);
    assert!(
        notes[0].starts_with("f: concave faces with more than 300"),
        "{notes:?}"
    );
}

#[test]
fn colours_of_vertices_are_srgb() {
    let face = "f 1 2 3\n";
    let colored = |colors: [&str; 3]| {
        let vertex = |(place, color): (&str, &str)| format!("v {place} {color}\n");
        let places = ["0 0 0", "1 0 0", "0 1 0"].into_iter().zip(colors);
        let file = places.map(vertex).collect::<String>() + face;
        read(file, &Files::default()).unwrap()
    };
    let red = |scene: &Scene| {
        let colors = scene.meshes[0].colors.iter();
        colors.map(|color| color.x).collect::<Vec<f32>>()
    };
    let close = |found: Vec<f32>, wanted: [f32; 3]| {
        let differences = found.iter().zip(wanted).map(|(a, b)| (a - b).abs());
        assert!(
            differences.fold(0.0, f32::max) < 1e-3 && found.len() == 3,
            "{found:?}"
        );
    };
    // 188 of 255 is half of the light.
    let scene = colored(["0.73725 0 0", "0 1 0", "1 0 1"]);
    close(red(&scene), [0.503, 0.0, 1.0]);
    let material = &scene.materials[scene.instances[0].material];
    assert_eq!(material.base_color, vec4(1.0, 1.0, 1.0, 1.0));
    close(
        red(&colored(["188 0 0", "0 255 0", "255 0 255"])),
        [0.503, 0.0, 1.0],
    );
    // Without a colour, or with one that is no number, white.
    let scene = colored(["", "0 0 0", ""]);
    close(red(&scene), [1.0, 0.0, 1.0]);
    let scene = colored(["nan 0 0", "0 0 0", "inf 0 0"]);
    close(red(&scene), [1.0, 0.0, 1.0]);
    assert_eq!(scene.warnings.len(), 1);
    assert!(
        scene.warnings[0].starts_with("v: vertex colours that"),
        "{:?}",
        scene.warnings
    );
    let scene = colored(["", "", ""]);
    assert!(scene.meshes[0].colors.is_empty());
    assert_eq!(scene.materials[0].base_color, vec4(0.6, 0.6, 0.6, 1.0));
    // A fourth number is a weight.
    assert!(colored(["1", "1", "1"]).meshes[0].colors.is_empty());
}

#[test]
fn broken_normals_and_coordinates_are_replaced() {
    let file = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt nan nan\nvt 0.5 inf\nvt 0.5 0.25\n\
        vn nan 0 0\nvn 0 0 0\nvn 0 2 0\nf 1/1/1 2/2/2 3/3/3\n";
    let scene = read(file, &Files::default()).unwrap();
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Y]);
    assert_eq!(mesh.uvs[0], [Vec2::ZERO, Vec2::ZERO, Vec2::new(0.5, 0.75)]);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    assert!(
        scene.warnings[0]
            .ends_with("normals without a direction become those of the faces (2 of them)")
    );
    assert!(
        scene.warnings[1].ends_with("texture coordinates that are not finite become 0 (2 of them)")
    );
}

#[test]
fn byte_order_marks() {
    let library = "\u{feff}newmtl a\nKd 0.25 0.5 0.75\n";
    let file = "\u{feff}mtllib a.mtl\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nusemtl a\r\nf 1 2 3\r\n";
    let scene = read(file, &Files::default().with("a.mtl", library)).unwrap();
    assert_eq!(scene.materials[0].base_color, vec4(0.25, 0.5, 0.75, 1.0));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let wide = |text: &str| -> Vec<u8> { text.encode_utf16().flat_map(u16::to_be_bytes).collect() };
    for text in [wide(file), wide(&file[3..])] {
        let error = read(text, &Files::default()).unwrap_err().to_string();
        assert_eq!(
            error,
            "test.obj: whole file: this is UTF-16 text; save it as UTF-8"
        );
    }
    let scene = read(file, &Files::default().with("a.mtl", wide(library))).unwrap();
    assert!(
        scene.warnings[0].contains("a.mtl: this is UTF-16 text"),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn coordinates_of_a_map_are_exact() {
    let at = DVec3::new(500_000.0, 100.0, -4_200_000.0);
    let square = |at: DVec3| {
        let corners = [[0.001, 0.0], [1.0, 0.0], [1.0, 1.003], [0.0, 1.0]];
        let line = |[x, z]: [f64; 2]| format!("v {} {} {}\n", at.x + x, at.y, at.z + z);
        let text = corners.map(line).concat() + "f 4 3 2 1\n";
        read(text, &Files::default()).unwrap()
    };
    let (near, far) = (square(DVec3::ZERO), square(at));
    assert_eq!(near.origin, DVec3::ZERO);
    assert_eq!(far.warnings, [""; 0]);
    assert_eq!(far.meshes[0].indices, near.meshes[0].indices);
    for (a, b) in far.meshes[0]
        .positions
        .iter()
        .zip(&near.meshes[0].positions)
    {
        assert!(
            far.in_file(*a).abs_diff_eq(near.in_file(*b) + at, 1e-7),
            "{a} {b}"
        );
    }
}
