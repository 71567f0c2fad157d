//! Bump maps and displacement of OBJ files.

use std::collections::HashMap;

use glam::{Vec2, Vec3, vec3};
use gpugi_scene::{Limits, Material, Mesh, Pixels, Scene, import};
use image::{ImageBuffer, ImageFormat, Luma, Pixel, Rgb};

use crate::obj::Files;
use crate::random::Random;

/// A PNG file.
fn png<P: Pixel<Subpixel = S> + image::PixelWithColorType, S>(
    [width, height]: [u32; 2],
    texel: impl Fn(u32, u32) -> P,
) -> Vec<u8>
where
    [S]: image::EncodableLayout,
{
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = ImageBuffer::from_fn(width, height, texel);
    image.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A PNG file of 16 bits, of a function of texture coordinates with v upward.
fn heights(size: u32, height: impl Fn(Vec2) -> f32) -> Vec<u8> {
    let side = size as f32;
    png([size; 2], |x, y| {
        let uv = Vec2::new(x as f32 + 0.5, side - y as f32 - 0.5) / side;
        Luma([(height(uv) * 65535.0).round() as u16])
    })
}

/// A square from (0, 0, 0) to (1, 1, 0) that faces +Z; u grows along x and v along y.
const SQUARE: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
    usemtl a\nf 1/1 2/2 3/3 4/4\n";

fn read_within(limits: &Limits, obj: &str, library: &str, image: Vec<u8>) -> Scene {
    let files = Files::default().with("a.mtl", library).with("a.png", image);
    import("a.obj", obj.as_bytes(), &files, limits).unwrap_or_else(|error| panic!("{error}"))
}

fn read(obj: &str, statements: &str, image: Vec<u8>) -> Scene {
    let library = format!("newmtl a\n{statements}\n");
    read_within(&Limits::default(), obj, &library, image)
}

fn material(scene: &Scene) -> &Material {
    &scene.materials[scene.instances[0].material]
}

fn texels(scene: &Scene) -> &[[u8; 4]] {
    let texture = material(scene)
        .normal_texture
        .expect("a normal map")
        .texture;
    let Pixels::Rgba8(texels) = &scene.images[scene.textures[texture].image].pixels else {
        panic!()
    };
    texels.as_chunks().0
}

/// The slope (u, v upward) that the renderer makes of a texel of the normal map.
fn slope(scene: &Scene, texel: usize) -> Vec2 {
    let [x, y, z, _] = texels(scene)[texel].map(|value| f32::from(value) / 127.5 - 1.0);
    -Vec2::new(x, y) * material(scene).normal_scale / z
}

#[track_caller]
fn assert_close(found: Vec2, wanted: Vec2, steepest: f32) {
    // Eight bits hold a slope to about half a 127th of the steepest one.
    let tolerance = 1.2 * steepest / 127.0;
    assert!(
        found.abs_diff_eq(wanted, tolerance),
        "{found}, not {wanted}"
    );
}

const STEP: f32 = 10.0 / 255.0;

#[test]
fn bump_maps_slope_by_their_heights() {
    let along =
        |step: fn(u32, u32) -> u32| png([16; 2], move |x, y| Luma([(step(x, y) * 10) as u8]));
    let middle = 7 * 16 + 7;
    for keyword in ["bump", "map_bump", "map_Bump"] {
        let scene = read(
            SQUARE,
            &format!("{keyword} -clamp on -bm 3 a.png"),
            along(|x, _| x),
        );
        assert_eq!(scene.warnings, [""; 0]);
        assert_close(
            slope(&scene, middle),
            Vec2::new(3.0 * STEP, 0.0),
            3.0 * STEP,
        );
        assert!(!scene.meshes[0].tangents.is_empty());
    }
    // Rows run downward, slopes upward; -mm multiplies, too.
    let scene = read(SQUARE, "bump -clamp on -mm 5 2 a.png", along(|_, y| y));
    assert_close(
        slope(&scene, middle),
        Vec2::new(0.0, -2.0 * STEP),
        2.0 * STEP,
    );
    let mirrored = read(
        SQUARE,
        "bump -clamp on -s -1 -1 1 -bm -1 a.png",
        along(|x, y| (x + y) / 2),
    );
    let half = STEP / 2.0;
    assert_close(slope(&mirrored, middle), Vec2::new(half, -half), half * 1.5);
}

#[test]
fn bump_maps_repeat_or_end() {
    let ramp = || png([16; 2], |x, _| Luma([(x * 10) as u8]));
    let scene = read(SQUARE, "bump a.png", ramp());
    let steepest = 14.0 * STEP / 2.0;
    assert_close(slope(&scene, 16), Vec2::new(-steepest, 0.0), steepest);
    assert_close(slope(&scene, 17), Vec2::new(STEP, 0.0), steepest);
    let scene = read(SQUARE, "bump -clamp on a.png", ramp());
    assert_close(slope(&scene, 16), Vec2::new(STEP / 2.0, 0.0), STEP);
}

#[test]
fn heights_of_16_bits_are_exact() {
    let ramp = png([256, 1], |x, _| Luma([(x * 20) as u16]));
    let scene = read(SQUARE, "bump -clamp on -bm 100 a.png", ramp);
    let step = 100.0 * 20.0 / 65535.0;
    assert_close(slope(&scene, 100), Vec2::new(step, 0.0), step);
}

#[test]
fn normal_maps_under_bump_are_kept() {
    let normal = |x: u32, y: u32| {
        let slope = Vec2::new((x as f32).sin(), (y as f32).cos()) * 0.5;
        let normal = (-slope).extend(1.0).normalize() * 0.5 + 0.5;
        Rgb(normal.to_array().map(|value| (value * 255.0).round() as u8))
    };
    let scene = read(
        SQUARE,
        "map_Bump -bm 0.5 a.png\nmap_Kd a.png",
        png([32; 2], normal),
    );
    assert_eq!(material(&scene).normal_scale, 0.5);
    assert_eq!(texels(&scene)[33][..3], normal(1, 1).0);
    assert_eq!(scene.images.len(), 1, "it is decoded once");
    let flat = read(
        SQUARE,
        "bump a.png",
        png([2; 2], |_, _| Rgb([128, 128, 255_u8])),
    );
    assert_eq!(texels(&flat)[0], [128, 128, 255, 255]);
    // Neither grey, of which (201, 201, 201) would be a unit vector, nor a coloured picture.
    let grey = png([32; 2], |x, _| Luma([200 + (x % 3) as u8]));
    let brown = png([32; 2], |x, _| Rgb([120, 90, 60 + (x % 3) as u8]));
    for image in [grey, brown] {
        let scene = read(SQUARE, "bump a.png", image);
        assert!(texels(&scene)[0] != texels(&scene)[1]);
        assert!(material(&scene).normal_scale < 0.05);
    }
    let level = read(SQUARE, "bump a.png", png([4; 2], |_, _| Luma([201_u8])));
    assert_eq!(material(&level).normal_texture, None);
    // `norm` comes first.
    let scene = read(
        SQUARE,
        "bump a.png\nnorm -bm 2 a.png",
        png([4; 2], |x, _| Luma([x as u8])),
    );
    assert_eq!(material(&scene).normal_scale, 2.0);
}

#[test]
fn planes_are_displaced_by_a_height_function() {
    let ramp = heights(32, |uv| uv.x);
    let scene = read(SQUARE, "map_disp -clamp on -mm 0.5 2 -bm 0.25 a.png", ramp);
    let mesh = &scene.meshes[0];
    // About one vertex per texel.
    let vertices = mesh.positions.len();
    assert!((32 * 32 / 2..3 * 32 * 32).contains(&vertices), "{vertices}");
    let inside = |at: f32| (0.5 / 32.0..=1.0 - 0.5 / 32.0).contains(&at);
    for position in mesh.positions.iter().filter(|at| inside(at.x)) {
        let wanted = 0.25 * (0.5 + 2.0 * position.x);
        assert!((position.z - wanted).abs() < 1e-4, "{position}");
    }
    assert!(mesh.tangents.is_empty());

    let wave = |uv: Vec2| {
        let [u, v] = (uv * std::f32::consts::TAU).to_array();
        0.5 + 0.25 * u.sin() + 0.25 * v.cos()
    };
    let scene = read(SQUARE, "disp -bm 0.1 a.png", heights(64, wave));
    let mesh = &scene.meshes[0];
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let at = position.truncate();
        assert!((position.z - 0.1 * wave(at)).abs() < 1e-4, "{position}");
        let [u, v] = (at * std::f32::consts::TAU).to_array();
        let slope = Vec2::new(u.cos(), -v.sin()) * 0.025 * std::f32::consts::TAU;
        let wanted = (-slope).extend(1.0).normalize();
        let rim = at.min(Vec2::ONE - at).min_element() < 0.02;
        let tolerance = if rim { 0.02 } else { 0.004 };
        assert!(
            normal.abs_diff_eq(wanted, tolerance),
            "{at} {normal} {wanted}"
        );
    }
}

/// A cube from -1 to 1, each face with the whole image; `material` names that of each face.
fn cube(material: impl Fn(usize) -> &'static str) -> String {
    let mut obj = "mtllib a.mtl\n".to_owned();
    for corner in 0..8 {
        let side = |axis: usize| (corner >> axis & 1) * 2 - 1;
        obj += &format!("v {} {} {}\n", side(0), side(1), side(2));
    }
    obj += "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
    let faces = [
        [1, 3, 4, 2],
        [5, 6, 8, 7],
        [1, 2, 6, 5],
        [3, 7, 8, 4],
        [1, 5, 7, 3],
        [2, 4, 8, 6],
    ];
    for (at, [a, b, c, d]) in faces.into_iter().enumerate() {
        obj += &format!("usemtl {}\nf {a}/1 {b}/2 {c}/3 {d}/4\n", material(at));
    }
    obj
}

/// All meshes of a scene as one.
fn joined(scene: &Scene) -> Mesh {
    let mut all = Mesh::default();
    for mesh in &scene.meshes {
        let first = all.positions.len() as u32;
        all.positions.extend(&mesh.positions);
        all.normals.extend(&mesh.normals);
        all.indices
            .extend(mesh.indices.iter().map(|index| index + first));
    }
    all
}

fn noise(size: u32) -> Vec<u8> {
    png([size; 2], |x, y| {
        Luma([((x * 7919 + y * 104_729) % 251) as u8])
    })
}

#[test]
fn closed_surfaces_stay_closed() {
    let both = "newmtl a\ndisp -bm 0.3 a.png\nnewmtl b\nKd 1 0 0\ndisp -s 2 1 1 -bm -0.2 a.png\n";
    let limits = Limits::default();
    for obj in [cube(|_| "a"), cube(|face| ["a", "b"][face % 2])] {
        let scene = read_within(&limits, &obj, both, noise(20));
        let mesh = joined(&scene);
        assert!(
            mesh.indices.len() > 6 * 6 * 20 * 20,
            "{}",
            mesh.indices.len()
        );
        assert!(mesh.is_closed());
        assert!(mesh.normals.iter().all(|normal| normal.is_normalized()));
        let longest = mesh
            .positions
            .iter()
            .map(|at| at.length())
            .fold(0.0, f32::max);
        assert!(longest > 1.8, "{longest}");
    }
    // Where the limit cuts, too.
    let limits = Limits {
        displaced_triangles: 700,
        ..limits
    };
    let scene = read_within(&limits, &cube(|face| ["a", "b"][face % 2]), both, noise(20));
    let mesh = joined(&scene);
    assert!(mesh.is_closed());
    assert!(
        (200..=2100).contains(&mesh.indices.len()),
        "{}",
        mesh.indices.len()
    );
}

#[test]
fn seams_move_by_their_mean() {
    let library = "newmtl a\ndisp -bm 0.3 a.png\nnewmtl b\ndisp -bm 0.6 a.png\n";
    let obj = cube(|face| if face == 5 { "a" } else { "b" });
    let white = png([2; 2], |_, _| Luma([255_u8]));
    let scene = read_within(&Limits::default(), &obj, library, white);
    let has = |wanted: Vec3| {
        let is_near = |at: &Vec3| at.abs_diff_eq(wanted, 1e-5);
        let found = scene
            .meshes
            .iter()
            .any(|mesh| mesh.positions.iter().any(is_near));
        assert!(found, "{wanted}: {:?}", scene.meshes[0].positions);
    };
    has(vec3(1.3, 0.0, 0.0));
    has(vec3(-1.6, 0.0, 0.0));
    // An edge and a corner of one material, and of both.
    has(vec3(-1.0, 1.0, 0.0) + vec3(-1.0, 1.0, 0.0).normalize() * 0.6);
    has(Vec3::splat(-1.0) - Vec3::ONE.normalize() * 0.6);
    has(vec3(1.0, 1.0, 0.0) + vec3(1.0, 1.0, 0.0).normalize() * 0.45);
    has(Vec3::ONE + Vec3::ONE.normalize() * 0.5);
}

#[test]
fn a_smooth_sphere_stays_closed_and_smooth() {
    // Points of a sphere, from a cube of 4 x 4 squares a side; a seam of texture coordinates at each of its edges.
    let mut obj = "mtllib a.mtl\nusemtl a\n".to_owned();
    let mut number = HashMap::new();
    let (mut vertices, mut faces) = (String::new(), String::new());
    for side in 0..6 {
        for (x, y) in (0..4).flat_map(|y| (0..4).map(move |x| (x, y))) {
            faces += "f";
            for [x, y] in [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]] {
                let (axis, sign) = (side / 2, 2 * (side % 2) as i32 - 1);
                let mut at = [0; 3];
                at[axis] = 2 * sign;
                at[(axis + 1) % 3] = (x - 2) * sign;
                at[(axis + 2) % 3] = y - 2;
                let next = number.len() + 1;
                let vertex = *number.entry(at).or_insert_with(|| {
                    let [x, y, z] = Vec3::from(at.map(|at| at as f32)).normalize().to_array();
                    vertices += &format!("v {x} {y} {z}\nvn {x} {y} {z}\n");
                    next
                });
                faces += &format!(" {vertex}/{}/{vertex}", y * 5 + x + 1);
            }
            faces += "\n";
        }
    }
    obj += &vertices;
    for (x, y) in (0..5).flat_map(|y| (0..5).map(move |x| (x, y))) {
        obj += &format!("vt {} {}\n", x as f32 / 4.0, y as f32 / 4.0);
    }
    obj += &faces;
    let rough = read(&obj, "disp -bm 0.1 a.png", noise(24));
    assert!(rough.meshes[0].is_closed());
    // Moved by the same everywhere, it keeps its shading: corners of the sphere are 0.25 farther out.
    let white = png([24; 2], |_, _| Luma([255_u8]));
    let moved = read(&obj, "disp -bm 0.25 a.png", white);
    let mesh = &moved.meshes[0];
    assert!(mesh.is_closed() && mesh.positions.len() > 6 * 16 * 16);
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        assert!(
            position.length() > 1.15 && position.length() < 1.2501,
            "{position}"
        );
        assert!(
            normal.dot(position.normalize()) > 0.995,
            "{position} {normal}"
        );
    }
}

#[test]
fn what_is_not_displaced_stays_joined() {
    let library = "newmtl a\ndisp -bm 0.3 -mm 1 1 a.png\nnewmtl b\nKd 1 0 0\n";
    let obj = cube(|face| if face == 5 { "a" } else { "b" });
    let scene = read_within(&Limits::default(), &obj, library, noise(16));
    let [still, moved] = &scene.meshes[..] else {
        panic!()
    };
    assert_eq!(still.indices.len(), 5 * 6);
    assert!(moved.positions.len() > 16 * 16 / 2);
    for at in &moved.positions {
        let is_rim = at.y.abs().max(at.z.abs()) == 1.0;
        assert_eq!(at.x == 1.0, is_rim, "{at}");
        assert!(is_rim || at.x >= 1.3, "{at}");
    }
}

#[test]
fn relief_does_not_count_twice() {
    let image = || noise(8);
    let scene = read(SQUARE, "disp -bm 0.1 a.png\nbump a.png", image());
    assert_eq!(material(&scene).normal_texture, None);
    assert!(scene.meshes[0].positions.len() > 32);
    // Unless nothing is displaced.
    let limits = Limits {
        displaced_triangles: 0,
        ..Limits::default()
    };
    let library = "newmtl a\ndisp -bm 0.1 a.png\nbump a.png\n";
    let scene = read_within(&limits, SQUARE, library, image());
    assert!(material(&scene).normal_texture.is_some());
    assert!(scene.warnings[0].contains("--limits displacement=N allows it"));
    let positions = &scene.meshes[0].positions;
    assert!(positions.iter().all(|at| at.z == 0.0));
}

#[test]
fn hostile_reliefs_are_bounded() {
    let warned = |scene: &Scene, wanted: &str| {
        let warnings = &scene.warnings;
        assert!(
            warnings.iter().any(|warning| warning.contains(wanted)),
            "{warnings:?}"
        );
    };
    for number in ["nan", "inf", "1e39", "x"] {
        for keyword in ["bump", "disp"] {
            let scene = read(SQUARE, &format!("{keyword} -bm {number} a.png"), noise(4));
            warned(&scene, "that are not finite are ignored");
            let scene = read(SQUARE, &format!("{keyword} -mm {number} 1 a.png"), noise(4));
            warned(&scene, "that are not finite are ignored");
        }
    }
    for options in [
        "-bm 1e30",
        "-bm -1e30",
        "-mm 1e38 1 -bm 1e30",
        "-mm 0 3e38 -bm 100",
    ] {
        let scene = read(SQUARE, &format!("disp {options} a.png"), noise(4));
        warned(&scene, "is not displaced");
        assert_eq!(scene.meshes[0].positions.len(), 4);
    }
    let scene = read(SQUARE, "bump -bm 1e30 a.png", noise(4));
    warned(&scene, "has 1000, the most");
    assert_eq!(material(&scene).normal_scale, 1000.0);

    // The limit, and what memory allows.
    let mut limits = Limits {
        displaced_triangles: 1000,
        ..Limits::default()
    };
    let library = "newmtl a\ndisp -bm 0.1 a.png\n";
    for (options, tiling) in [
        ("", 1),
        ("-s 1e30 1e30 1", 1),
        ("-s 3e38 1e-38 1 -o 3e38 0 0", 3),
    ] {
        let library = format!("newmtl a\ndisp -bm 0.1 {options} a.png\n");
        let scene = read_within(&limits, SQUARE, &library, noise(64));
        let count = scene.meshes[0].indices.len() / 3;
        assert!(
            tiling == 3 || (250..=1000).contains(&count),
            "{options}: {count}"
        );
        assert!(count <= 1000, "{options}: {count}");
        warned(&scene, "--limits displacement=N raises that");
    }
    limits.displaced_triangles = u64::MAX;
    limits.scene_bytes = 200_000;
    let scene = read_within(&limits, SQUARE, library, noise(64));
    warned(&scene, "--limits scene=BYTES raises that");
    assert!(scene.meshes[0].byte_size() < 200_000);

    // A header that claims 60,000 texels a side; no image; no texture coordinates.
    let mut huge = noise(4);
    huge[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    for image in [huge, b"no picture".to_vec()] {
        let scene = read(SQUARE, "bump a.png\ndisp a.png", image);
        warned(&scene, "the texture is left out");
        assert_eq!(material(&scene).normal_texture, None);
        assert_eq!(scene.meshes[0].positions.len(), 4);
    }
    let bare = SQUARE.replace("f 1/1 2/2 3/3 4/4", "f 1 2 3 4");
    warned(
        &read(&bare, "disp a.png", noise(4)),
        "it has no texture coordinates",
    );
}

#[test]
fn damaged_reliefs_never_panic() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let limits = Limits {
        displaced_triangles: 500,
        ..Limits::default()
    };
    let obj = cube(|face| ["a", "b", "c"][face % 3]);
    let library = "newmtl a\nbump -bm 0.5 a.png\ndisp -mm 0.1 0.2 -bm 0.1 a.png\n\
        newmtl b\ndisp -s 2 2 2 -o 0.5 -clamp on a.png\nnewmtl c\nmap_Bump -clamp on a.png\n";
    for case in 0..150 {
        let [mut scene, mut materials] = [obj.as_bytes(), library.as_bytes()].map(<[u8]>::to_vec);
        let mut image = noise(5);
        for part in [&mut scene, &mut materials, &mut image] {
            if random.below(2) == 0 {
                *part = random.damage(part);
            }
        }
        let files = Files::default()
            .with("a.mtl", materials)
            .with("a.png", image);
        if let Ok(scene) = import("a.obj", &scene, &files, &limits) {
            for mesh in &scene.meshes {
                assert!(mesh.check().is_ok(), "{case}");
                assert!(mesh.indices.len() <= 3 * 500, "{case}");
            }
        }
    }
}
