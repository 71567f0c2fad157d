//! PLY import.

use glam::{DVec3, Vec2, Vec3, vec3};
use gpugi_scene::{ImportError, Limits, Mesh, Resolver, Scene, import};

use crate::random::Random;

struct NoFiles;

impl Resolver for NoFiles {
    fn read(&self, _: &str) -> Result<Vec<u8>, String> {
        Err("PLY files name no other files".into())
    }
}

fn read(bytes: &[u8]) -> Result<Scene, ImportError> {
    import("test.ply", bytes, &NoFiles, &Limits::default())
}

fn mesh(bytes: &[u8]) -> Mesh {
    Mesh::clone(&read(bytes).unwrap().meshes[0])
}

fn error(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

const PYRAMID: &str = "ply
format ascii 1.0
comment a pyramid with a square base
element vertex 5
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face 5
property uchar flags
property list uchar int vertex_indices
end_header
-1 0 1 255 0 0
1 0 1 255 0 0
1 0 -1 0 188 0
-1 0 -1 0 0 0
0 1.5 0 255 255 255
0 4 3 2 1 0
0 3 0 1 4
0 3 1 2 4
0 3 2 3 4
0 3 3 0 4
";

/// The pyramid in binary; `order` swaps a number's little-endian bytes or not.
fn binary_pyramid(format: &str, order: fn(&mut [u8])) -> Vec<u8> {
    let (header, body) = PYRAMID.split_once("end_header\n").unwrap();
    let mut bytes = header.replace("ascii", format).into_bytes();
    bytes.extend(b"end_header\n");
    let mut push = |number: &mut [u8]| {
        order(number);
        bytes.extend(&*number);
    };
    for (row, line) in body.lines().enumerate() {
        let words: Vec<&str> = line.split(' ').collect();
        for (column, word) in words.iter().enumerate() {
            match (row < 5, column) {
                (true, 0..3) => push(&mut word.parse::<f32>().unwrap().to_le_bytes()),
                (true, _) | (false, 0..2) => push(&mut [word.parse::<u8>().unwrap()]),
                (false, _) => push(&mut word.parse::<i32>().unwrap().to_le_bytes()),
            }
        }
    }
    bytes
}

#[test]
fn ascii_and_both_byte_orders_agree() {
    let ascii = mesh(PYRAMID.as_bytes());
    assert_eq!(ascii.indices.len(), 6 * 3);
    assert!(ascii.is_closed());
    assert_eq!(ascii.name, "test");
    // Every edge is sharper than the crease angle, so that each of the five faces has its own corners.
    assert_eq!(ascii.positions.len(), 4 + 4 * 3);
    let little = mesh(&binary_pyramid("binary_little_endian", |_| {}));
    let big = mesh(&binary_pyramid("binary_big_endian", |bytes| {
        bytes.reverse()
    }));
    assert_eq!(ascii, little);
    assert_eq!(ascii, big);
}

#[test]
fn colours_are_linearised() {
    let mesh = mesh(PYRAMID.as_bytes());
    let at = |position: Vec3| {
        let vertex = mesh.positions.iter().position(|&p| p == position).unwrap();
        mesh.colors[vertex]
    };
    assert_eq!(at(vec3(-1.0, 0.0, 1.0)).to_array(), [1.0, 0.0, 0.0, 1.0]);
    assert!((at(vec3(1.0, 0.0, -1.0)).y - 0.5029).abs() < 1e-3);
}

#[test]
fn normals_and_texture_coordinates_are_kept() {
    let file = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
        property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n\
        property float red\nproperty float green\nproperty float blue\nproperty float alpha\n\
        element face 1\nproperty list uint uint vertex_index\nend_header\n\
        0 0 0 0 0 2 0 0 .5 .25 2 .5\n1 0 0 0 0 1 1 0 .5 .25 2 .5\n0 1 0 0 0 0 0 1 .5 .25 2 .5\n3 0 1 2\n";
    let scene = read(file.as_bytes()).unwrap();
    let mesh = &scene.meshes[0];
    // The last one is zero.
    assert_eq!(mesh.normals, [Vec3::Z; 3]);
    assert_eq!(scene.warnings.len(), 1);
    assert!(scene.warnings[0].starts_with("element vertex: normals without"));
    assert_eq!(mesh.uvs[0], [Vec2::Y, Vec2::ONE, Vec2::ZERO]);
    assert_eq!(mesh.colors[0].to_array(), [0.5, 0.25, 2.0, 0.5]);
}

#[test]
fn errors_name_the_place() {
    let with = |from: &str, to: &str| error(PYRAMID.replacen(from, to, 1).as_bytes());
    for (message, wanted) in [
        (error(b""), "the file ends before the header"),
        (error(b"ply\n"), "the file ends before the header"),
        (
            error(b"solid cube\n"),
            "test.ply: line 1: a PLY file starts with",
        ),
        (with("format ascii 1.0\n", ""), "without a format line"),
        (
            with("ascii", "binary_middle_endian"),
            "line 2: unknown format",
        ),
        (
            with("vertex 5", "vertex 18446744073709551615"),
            "element vertex: 18446744073709551615 entries",
        ),
        (
            with("vertex 5", "vertex 100000000"),
            "element vertex: 100000000 entries take at least",
        ),
        (with("vertex 5", "vertex -5"), "line 4: \"-5\" is no count"),
        (
            with("float x", "quad x"),
            "line 5: \"property quad x\" is no property",
        ),
        (with("property float z\n", ""), "x, y and z are required"),
        (
            with("vertex_indices", "corners"),
            "vertex_indices or vertex_index is required",
        ),
        (
            with("element face", "element tristrips"),
            "triangle strips are not supported",
        ),
        (with("1.5", "nan"), "line 19: property y is not finite"),
        (with("1.5", "1e99"), "line 19: property y is not finite"),
        (with("1.5", "high"), "line 19: \"high\" is no number"),
        (
            with("3 3 0 4", "3 3 0 5"),
            "line 24: vertex index 5 is out of range: there are 5",
        ),
        (
            with("3 3 0 4", "3 3 0 -1"),
            "vertex index -1 is out of range",
        ),
        (with("3 3 0 4", "3 3 0"), "the file ends too early"),
        (
            with("3 3 0 4", "4000000000 3 0 4"),
            "a list of 4000000000 values",
        ),
        (with("face 5", "face 0"), "there are no triangles"),
    ] {
        assert!(message.contains(wanted), "{message:?} lacks {wanted:?}");
    }
    let mut binary = binary_pyramid("binary_little_endian", |_| {});
    binary.truncate(binary.len() - 1);
    assert!(error(&binary).contains("the file ends too early"));
    let small = Limits {
        scene_bytes: 400,
        ..Limits::default()
    };
    let refused = import("test.ply", PYRAMID.as_bytes(), &NoFiles, &small).unwrap_err();
    assert!(refused.reason.contains("exceed the limit of 400"));
}

#[test]
fn empty_entries_cost_nothing() {
    let file = PYRAMID.replace(
        "element vertex",
        "element nothing 199999999\nelement vertex",
    );
    assert_eq!(mesh(file.as_bytes()).indices.len(), 18);
}

#[test]
fn zero_area_triangles_survive() {
    let file = PYRAMID
        .replace("0 1.5 0", "0 0 0")
        .replace("3 0 1 4", "3 0 0 0");
    let mesh = mesh(file.as_bytes());
    assert!(
        mesh.normals
            .iter()
            .all(|normal| (normal.length() - 1.0).abs() < 1e-5)
    );
}

#[test]
fn damaged_files_never_panic() {
    let sources = [
        PYRAMID.as_bytes().to_vec(),
        binary_pyramid("binary_little_endian", |_| {}),
        binary_pyramid("binary_big_endian", |bytes| bytes.reverse()),
    ];
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let mut read_well = 0;
    for case in 0..900 {
        if let Ok(scene) = read(&random.damage(&sources[case % 3])) {
            read_well += 1;
            assert!(scene.meshes[0].check().is_ok());
        }
    }
    println!("{read_well} of 900 damaged files still made a mesh");
    for source in &sources {
        for length in 0..source.len() {
            let _ = read(&source[..length]);
        }
    }
}

#[test]
fn well_known_meshes() {
    let Some(folder) = std::env::var_os("GPUGI_ASSETS") else {
        println!("skipped: GPUGI_ASSETS does not name a folder with meshes/*.ply");
        return;
    };
    let folder = std::path::PathBuf::from(folder).join("meshes");
    for (file, triangles) in [
        ("bunny.ply", 69_451),
        ("dragon-48k.ply", 47_794),
        ("dragon-202k.ply", 202_520),
        ("teapot.ply", 2_256),
    ] {
        let start = std::time::Instant::now();
        let scene = gpugi_scene::import_file(&folder.join(file), &Limits::default()).unwrap();
        let seconds = start.elapsed().as_secs_f32();
        let mesh = &scene.meshes[0];
        println!(
            "{file}: {seconds:.2} s, {} vertices, closed {}",
            mesh.positions.len(),
            mesh.is_closed()
        );
        assert_eq!(mesh.indices.len() / 3, triangles, "{file}");
        assert!(
            mesh.normals
                .iter()
                .all(|normal| (normal.length() - 1.0).abs() < 1e-5)
        );
    }
}

#[test]
fn holes_of_faces_stay_open() {
    let window = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        -4 0 -4\n-4 0 4\n4 0 4\n4 0 -4\n-2 0 -2\n2 0 -2\n2 0 2\n-2 0 2\n10 0 1 2 3 0 4 5 6 7 4\n";
    let mesh = mesh(window.as_bytes());
    assert!((mesh.area() - 48.0).abs() < 1e-6, "{}", mesh.area());
    assert!(mesh.normals.iter().all(|normal| *normal == Vec3::Y));
}

/// Two triangles that share an edge, the first half as bright as the second.
fn two_colors(list: &str, faces: [&str; 2]) -> String {
    let [first, second] = faces;
    format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
            element face 2\n{list}end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n{first}\n{second}\n"
    )
}

#[test]
fn faces_have_colours() {
    let corners = "property list uchar int vertex_indices\n";
    let colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let after = two_colors(
        &format!("{corners}{colors}"),
        ["3 0 1 2 188 0 0", "3 0 2 3 255 0 0"],
    );
    let before = two_colors(
        &format!("{colors}{corners}"),
        ["188 0 0 3 0 1 2", "255 0 0 3 0 2 3"],
    );
    let scene = read(after.as_bytes()).unwrap();
    assert_eq!(scene.meshes, read(before.as_bytes()).unwrap().meshes);
    let mesh = &scene.meshes[0];
    assert_eq!((mesh.positions.len(), mesh.indices.len()), (6, 6));
    for (triangle, red) in mesh.indices.as_chunks::<3>().0.iter().zip([0.5029, 1.0]) {
        for vertex in triangle {
            let color = mesh.colors[*vertex as usize];
            assert!((color.x - red).abs() < 1e-3 && color.y == 0.0, "{color}");
        }
    }
    let material = &scene.materials[scene.instances[0].material];
    assert_eq!(material.base_color, glam::Vec4::ONE);
    let grey = two_colors(corners, ["3 0 1 2", "3 0 2 3"]);
    let scene = read(grey.as_bytes()).unwrap();
    assert_eq!(
        scene.materials[0].base_color.to_array(),
        [0.6, 0.6, 0.6, 1.0]
    );
}

#[test]
fn broken_normals_coordinates_and_colours_are_replaced() {
    let file = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n\
        property float red\nproperty float green\nproperty float blue\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 nan nan nan nan 0 0.5 nan 0.5\n1 0 0 0 inf 0 0.5 inf 0.5 0 0.5\n0 1 0 0 1 0 0.5 0.25 0.5 0 0.5\n3 0 1 2\n";
    let scene = read(file.as_bytes()).unwrap();
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Y]);
    assert_eq!(mesh.uvs[0], [Vec2::ZERO, Vec2::ZERO, Vec2::new(0.5, 0.75)]);
    let red: Vec<f32> = mesh.colors.iter().map(|color| color.x).collect();
    assert_eq!(red, [1.0, 0.5, 0.5]);
    assert_eq!(scene.warnings.len(), 3, "{:?}", scene.warnings);
}

#[test]
fn a_byte_order_mark_is_skipped() {
    let marked = format!("\u{feff}{PYRAMID}");
    assert_eq!(mesh(marked.as_bytes()), mesh(PYRAMID.as_bytes()));
}

/// 64-bit coordinates of a map lose nothing; 32-bit ones already have, and that is said.
#[test]
fn coordinates_of_a_map_are_exact_in_64_bits() {
    let near = read(PYRAMID.as_bytes()).unwrap();
    assert_eq!(near.origin, DVec3::ZERO);
    let at = DVec3::new(500_000.0, 0.0, -4_200_000.0);
    let far_pyramid = |kind: &str| {
        let (header, body) = PYRAMID.split_once("end_header\n").unwrap();
        let mut text = header.replace("float", kind) + "end_header\n";
        for (index, line) in body.lines().enumerate() {
            let mut words = line.split(' ');
            let mut moved = |by: f64| words.next().unwrap().parse::<f64>().unwrap() + by;
            if index < 5 {
                let [x, y, z] = at.to_array().map(&mut moved);
                text += &format!("{x} {y} {z} ");
            }
            text += &words.collect::<Vec<_>>().join(" ");
            text += "\n";
        }
        read(text.as_bytes()).unwrap()
    };
    let far = far_pyramid("double");
    assert_eq!(far.warnings, [""; 0]);
    for (a, b) in far.meshes[0]
        .positions
        .iter()
        .zip(&near.meshes[0].positions)
    {
        assert_eq!(far.in_file(*a), near.in_file(*b) + at);
    }
    let far = far_pyramid("float");
    assert_eq!(far.warnings.len(), 1);
    assert!(
        far.warnings[0].contains("steps of 50 cm"),
        "{:?}",
        far.warnings
    );
}
