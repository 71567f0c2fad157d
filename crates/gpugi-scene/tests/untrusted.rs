//! Files that claim much, lead elsewhere or hold nonsense: a clear error, or a scene, soon and within the limits.

use std::cell::RefCell;
use std::io::Cursor;
use std::path::Path;
use std::time::{Duration, Instant};

use glam::{Mat4, Vec3, Vec4};
use gpugi_scene::export::export_scene;
use gpugi_scene::image::{decode_color, decode_radiance};
use gpugi_scene::material::Volume;
use gpugi_scene::{
    AlphaMode, Atlas, AtlasOptions, FileResolver, ImportError, Limits, Material, MaterialModel,
    Mesh, Resolver, Scene, import, import_file, import_file_within,
};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{GrayImage, ImageFormat, Luma, Rgb, Rgb32FImage, RgbImage};
use serde_json::json;

mod random;
use random::Random;

/// No other files.
struct Nothing;

impl Resolver for Nothing {
    fn read(&self, _uri: &str) -> Result<Vec<u8>, String> {
        Err("no such file".to_owned())
    }
}

/// Runs what must be over soon.
#[track_caller]
fn soon<T>(work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    let took = start.elapsed();
    assert!(took < Duration::from_secs(2), "{took:?}");
    result
}

fn refused(name: &str, bytes: &[u8]) -> ImportError {
    let read = soon(|| import(name, bytes, &Nothing, &Limits::default()));
    match read {
        Ok(_) => panic!("the file asks for too much"),
        Err(error) => error,
    }
}

/// A triangle whose document `change` changes.
fn triangle(change: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
    let mut document = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{
            "byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",
        }],
    });
    change(&mut document);
    document.to_string().into_bytes()
}

fn radiance_file() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let image = Rgb32FImage::from_fn(70, 3, |x, y| Rgb([x as f32, y as f32, 0.5]));
    image.write_to(&mut bytes, ImageFormat::OpenExr).unwrap();
    bytes.into_inner()
}

/// The offset of the value of an attribute of an OpenEXR file.
fn attribute(exr: &[u8], name: &str) -> usize {
    let name = format!("{name}\0");
    let at = exr
        .windows(name.len())
        .position(|window| window == name.as_bytes())
        .unwrap()
        + name.len();
    let kind = exr[at..].iter().position(|&byte| byte == 0).unwrap();
    at + kind + 1 + 4
}

fn exr_error(change: impl FnOnce(&mut Vec<u8>)) -> ImportError {
    let mut bytes = radiance_file();
    change(&mut bytes);
    soon(|| decode_radiance("a.exr", &bytes, &Limits::default())).expect_err("the file is damaged")
}

#[test]
fn exr_sizes_are_checked_before_they_are_believed() {
    let image = decode_radiance("a.exr", &radiance_file(), &Limits::default()).unwrap();
    assert_eq!((image.width, image.height), (70, 3));
    let window = |name: &'static str, right: i32| {
        move |bytes: &mut Vec<u8>| {
            let at = attribute(bytes, name) + 8;
            bytes[at..at + 4].copy_from_slice(&right.to_le_bytes());
        }
    };
    for (right, reason) in [
        (i32::MAX, "no rectangle"),
        (-7, "no rectangle"),
        (1 << 20, "limit of 16384"),
    ] {
        let error = exr_error(window("dataWindow", right));
        assert_eq!(error.place, "attribute dataWindow", "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
    assert!(
        exr_error(window("displayWindow", 1 << 20))
            .reason
            .contains("limit of 16384")
    );
    let lines = |bytes: &mut Vec<u8>| {
        let at = attribute(bytes, "dataWindow") + 12;
        bytes[at..at + 4].copy_from_slice(&16_000_i32.to_le_bytes());
    };
    assert_eq!(exr_error(lines).place, "table of chunks");
    // The first of two tiles follows the table.
    let table = |bytes: &[u8]| {
        let starts = |at: &usize| bytes[*at..*at + 8] == (*at as u64 + 16).to_le_bytes();
        (0..bytes.len() - 8).find(starts).unwrap()
    };
    for wrong in [0, 1 << 40, u64::MAX] {
        let error = exr_error(|bytes| {
            let at = table(bytes);
            bytes[at..at + 8].copy_from_slice(&u64::to_le_bytes(wrong));
        });
        assert_eq!(error.place, "chunk 0", "{error}");
    }
    let error = exr_error(|bytes| {
        let at = table(bytes);
        let first: [u8; 8] = bytes[at..at + 8].try_into().unwrap();
        bytes[at + 8..at + 16].copy_from_slice(&first);
    });
    assert!(error.reason.contains("same place"), "{error}");
    let error = exr_error(|bytes| {
        let at = attribute(bytes, "compression");
        bytes[at] = 77;
    });
    assert_eq!(error.place, "attribute compression");
    let error = exr_error(|bytes| {
        let at = attribute(bytes, "channels") - 4;
        bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    });
    assert_eq!(error.place, "attribute channels");
}

#[test]
fn pictures_that_claim_more_than_their_bytes_can_hold() {
    let encoded = |format| {
        let mut bytes = Cursor::new(Vec::new());
        RgbImage::new(8, 8).write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let mut jpeg = encoded(ImageFormat::Jpeg);
    let frame = jpeg
        .windows(2)
        .position(|marker| marker == [0xff, 0xc0])
        .unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
    for decode in [decode_color, decode_radiance] {
        let error = soon(|| decode("a.jpg", &jpeg, &Limits::default())).unwrap_err();
        assert!(error.reason.contains("--limits expansion"), "{error}");
    }
    let mut png = encoded(ImageFormat::Png);
    png[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    for decode in [decode_color, decode_radiance] {
        soon(|| decode("a.png", &png, &Limits::default())).unwrap_err();
    }
    let mut scans = encoded(ImageFormat::Jpeg);
    let end = scans.len() - 2;
    scans.splice(end..end, [0xff, 0xda].repeat(200));
    let error = decode_color("a.jpg", &scans, &Limits::default()).unwrap_err();
    assert!(error.reason.contains("201 scans"), "{error}");
    let mut raised = Limits::default();
    raised.set("expansion=10000000, images=1KiB").unwrap();
    let error = decode_color("a.jpg", &jpeg, &raised).unwrap_err();
    assert!(error.reason.contains("--limits images"), "{error}");
}

/// What a segment holds, and what follows the picture, are no scans.
#[test]
fn pictures_with_others_inside_and_behind() {
    let mut jpeg = Cursor::new(Vec::new());
    let picture = RgbImage::from_pixel(8, 8, Rgb([200, 20, 20]));
    picture.write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
    let plain = jpeg.into_inner();
    let scans = [0xff, 0xda].repeat(500);
    let length = u16::to_be_bytes(scans.len() as u16 + 2);
    let segment = [&[0xff, 0xe5], &length[..], &scans].concat();
    let comment = [&[0xff, 0xfe], &length[..], &scans].concat();
    let decode = |bytes: &[u8]| decode_color("a.jpg", bytes, &Limits::default());
    let expected = decode(&plain).unwrap();
    let with = |start: &[u8]| [&plain[..2], start, &plain[2..], &scans].concat();
    for bytes in [with(&[]), with(&segment), with(&comment)] {
        assert_eq!(decode(&bytes).unwrap(), expected);
    }
    // A segment hides no scans of the picture itself.
    let end = plain.len() - 2;
    for hidden in [&segment, &comment] {
        let bytes = [&plain[..end], hidden, &plain[end..]].concat();
        let error = decode(&bytes).unwrap_err();
        assert!(error.reason.contains("501 scans"), "{error}");
    }
}

/// Masks of one colour, of the largest size: the first is honest, and more of them exceed what the file may expand to.
#[test]
fn large_flat_images() {
    let mut mask = Cursor::new(Vec::new());
    let texels = GrayImage::from_pixel(16_384, 16_384, Luma([255]));
    let (best, filter) = (CompressionType::Best, FilterType::NoFilter);
    let encoder = PngEncoder::new_with_quality(&mut mask, best, filter);
    texels.write_with_encoder(encoder).unwrap();
    let mask = mask.into_inner();
    assert!(mask.len() < 1 << 20);
    struct Masks(Vec<u8>);
    impl Resolver for Masks {
        fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
            Ok(match uri {
                "a.mtl" => b"newmtl a\nmap_Kd 1.png\nmap_Ke 2.png\n".to_vec(),
                _ => self.0.clone(),
            })
        }
    }
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
    let scene = import("a.obj", text.as_bytes(), &Masks(mask), &Limits::default()).unwrap();
    assert_eq!(scene.images.len(), 1);
    let warning = &scene.warnings[0];
    assert!(warning.contains("--limits expansion=N"), "{warning}");
}

/// Squares of a grid, and triangles.
const GRID: usize = 200;
const GRID_TRIANGLES: usize = 2 * GRID * GRID;

/// A grid without normals, as OBJ and as PLY.
fn grid(height: impl Fn(usize, usize) -> f32) -> [String; 2] {
    let mut obj = String::new();
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {GRID_TRIANGLES}\nproperty list uchar int vertex_indices\nend_header\n",
        (GRID + 1) * (GRID + 1)
    );
    for (x, y) in (0..=GRID).flat_map(|y| (0..=GRID).map(move |x| (x, y))) {
        let vertex = format!("{x} {y} {}\n", height(x, y));
        obj += &format!("v {vertex}");
        ply += &vertex;
    }
    for (x, y) in (0..GRID).flat_map(|y| (0..GRID).map(move |x| (x, y))) {
        let corner = |dx: usize, dy: usize| (y + dy) * (GRID + 1) + x + dx;
        let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]].map(|face| face.map(|at: usize| corners[at])) {
            obj += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
            ply += &format!("3 {a} {b} {c}\n");
        }
    }
    [obj, ply]
}

/// In as much memory for each triangle as 28 million have at the default limits.
#[test]
fn large_meshes_without_normals() {
    let limits = Limits {
        scene_bytes: GRID_TRIANGLES as u64 * Limits::default().scene_bytes / 28_000_000,
        ..Limits::default()
    };
    let smooth = grid(|x, y| (x as f32 * 0.1).sin() + (y as f32 * 0.1).cos());
    // Where all edges are sharp, each corner becomes a vertex, which takes more.
    let sharp = grid(|x, y| ((x * x + y * y * 7) % 5) as f32 * 100.0);
    for (name, smooth, sharp) in [
        ("a.obj", &smooth[0], &sharp[0]),
        ("a.ply", &smooth[1], &sharp[1]),
    ] {
        let scene = import(name, smooth.as_bytes(), &Nothing, &limits);
        let scene = scene.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(scene.meshes[0].indices.len(), 3 * GRID_TRIANGLES);
        assert_eq!(scene.meshes[0].normals.len(), (GRID + 1) * (GRID + 1));
        let error = import(name, sharp.as_bytes(), &Nothing, &limits)
            .err()
            .unwrap();
        assert!(error.reason.contains("--limits scene=BYTES"), "{error}");
        import(name, sharp.as_bytes(), &Nothing, &Limits::default()).unwrap();
    }
}

#[test]
fn limits_are_set_by_text() {
    let mut limits = Limits::default();
    limits
        .set("file=3, side=5,images=2KiB,scene=7 MiB,expansion=9")
        .unwrap();
    let expected = Limits {
        file_bytes: 3,
        image_side: 5,
        image_bytes: 2048,
        scene_bytes: 7 << 20,
        expansion: 9,
    };
    assert_eq!(limits, expected);
    for wrong in [
        "files=3",
        "side",
        "side=5000000000",
        "scene=-1",
        "scene=1TiB",
        "scene=99999999999GiB",
    ] {
        let error = limits.set(wrong).unwrap_err();
        assert!(
            error.contains(wrong) && error.contains("file, side"),
            "{error}"
        );
    }
}

#[test]
fn short_files_that_multiply_are_refused() {
    // Ten million places without bytes of their own.
    let instancing = triangle(|document| {
        let places = json!({ "componentType": 5126, "count": 10_000_000, "type": "VEC3" });
        document["accessors"].as_array_mut().unwrap().push(places);
        document["nodes"][0]["extensions"] =
            json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 1 } } });
    });
    let error = refused("a.gltf", &instancing);
    assert!(error.reason.contains("--limits expansion"), "{error}");
    let large = triangle(|document| {
        document["accessors"][0] =
            json!({ "componentType": 5126, "count": 30_000_000, "type": "VEC3" });
    });
    assert!(
        refused("a.gltf", &large)
            .reason
            .contains("--limits expansion")
    );
    // Long names of many parts.
    let mut groups = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\ng {}\n", "x".repeat(100_000));
    for part in 0..3000 {
        groups += &format!("usemtl {part}\nf 1 2 3\n");
    }
    assert!(
        refused("a.obj", groups.as_bytes())
            .reason
            .contains("--limits expansion")
    );
    let named = triangle(|document| {
        document["nodes"] = json!(vec![json!({ "mesh": 0 }); 8000]);
        document["meshes"][0]["name"] = json!("x".repeat(100_000));
    });
    assert!(
        refused("a.gltf", &named)
            .reason
            .contains("--limits expansion")
    );
}

/// Every copy that a skin or a morph target makes counts.
#[test]
fn copies_of_what_bends_are_charged() {
    let targets = triangle(|document| {
        document["meshes"][0]["primitives"][0]["targets"] =
            json!(vec![json!({ "POSITION": 0 }); 200]);
        document["nodes"] = json!(vec![json!({ "mesh": 0 }); 200]);
    });
    // 200 x 200 targets of three vertices, and as much as any file may take.
    let bytes = 200 * 200 * (3 * 12 + 72);
    let limits = |scene_bytes| Limits {
        scene_bytes,
        ..Limits::default()
    };
    let error = import("a.gltf", &targets, &Nothing, &limits(bytes)).unwrap_err();
    assert!(error.reason.contains("--limits scene"), "{error}");
    import("a.gltf", &targets, &Nothing, &limits(4 * bytes)).unwrap();
}

#[test]
fn line_continuations_take_linear_time() {
    let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf".to_owned();
    text += &"\\\n".repeat(300_000);
    text += " 1 2 3\n";
    let scene = soon(|| import("a.obj", text.as_bytes(), &Nothing, &Limits::default())).unwrap();
    assert_eq!(scene.meshes[0].indices, [0, 1, 2]);
}

#[test]
fn a_material_library_is_read_once() {
    struct Library(RefCell<usize>);
    impl Resolver for Library {
        fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
            if uri != "a.mtl" {
                return Err("no such file".into());
            }
            *self.0.borrow_mut() += 1;
            Ok(b"newmtl red\nKd 1 0 0\n".to_vec())
        }
    }
    let library = Library(RefCell::new(0));
    let lines = "mtllib a.mtl\nmtllib a.mtl a.mtl\n".repeat(100);
    let text = format!("{lines}v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n");
    let scene = import("a.obj", text.as_bytes(), &library, &Limits::default()).unwrap();
    assert_eq!((library.0.into_inner(), scene.materials.len()), (1, 1));
}

/// One triangle with a material.
fn shown(material: Material) -> Scene {
    let mut scene = Scene::new("one");
    let mesh = scene.add_mesh(Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    });
    let material = scene.add_material(material);
    scene.add_instance("one", mesh, material, Mat4::IDENTITY);
    scene
}

/// What an exported material reflects is what it reflected, for random materials of every model.
#[test]
fn exported_materials_read_back() {
    let mut random = Random(11);
    let mut part = move || random.below(1001) as f32 / 1000.0;
    for case in 0..3000 {
        let mut color = || Vec3::new(part(), part(), part());
        let (kd, tint, n, k) = (color(), color(), color(), color());
        let ks = color() * (Vec3::ONE - kd);
        let emissive = color() * if case % 2 == 0 { 10.0 } else { 0.0 };
        let mut material = Material {
            name: "one".into(),
            model: match case % 3 {
                0 => MaterialModel::MetallicRoughness,
                1 => MaterialModel::Phong {
                    kd: if case % 5 == 0 {
                        Vec3::new(kd.x, 0.0, 0.0)
                    } else {
                        kd
                    },
                    ks: if case % 7 == 0 { Vec3::ONE - kd } else { ks },
                    shininess: 300.0 * part(),
                },
                _ => MaterialModel::Conductor {
                    n: n + 0.01,
                    k: k * 5.0,
                },
            },
            base_color: tint.extend(1.0),
            metallic: part(),
            roughness: part(),
            emissive,
            double_sided: case % 4 == 0,
            ..Material::default()
        };
        if case % 3 == 0 {
            material.ior = 1.0 + part();
            material.specular = part();
            material.transmission = part();
            material.volume = Some(Volume {
                attenuation_distance: 0.1 + part(),
                attenuation_color: kd,
            });
            material.alpha_mode = AlphaMode::Mask { cutoff: part() };
        }
        let file = export_scene(&shown(material.clone())).unwrap();
        let read = import("a.glb", &file.glb, &Nothing, &Limits::default());
        let read = read.unwrap_or_else(|error| panic!("{error}: {material:?}"));
        assert_eq!(read.warnings, Vec::<String>::new(), "{material:?}");
        let found = &read.materials[0];
        let close =
            |a: Vec3, b: Vec3| (a - b).abs().max_element() <= 2e-6 * (1.0 + a.max_element());
        match (material.model, found.model) {
            (
                MaterialModel::Phong { kd, ks, shininess },
                MaterialModel::Phong {
                    kd: found_kd,
                    ks: found_ks,
                    shininess: found_shininess,
                },
            ) => {
                let albedo = |color: Vec4, kd: Vec3| color.truncate() * kd;
                let [a, b] = [
                    albedo(material.base_color, kd),
                    albedo(found.base_color, found_kd),
                ];
                assert!(close(a, b) && ks == found_ks, "{material:?} {found:?}");
                assert_eq!(shininess, found_shininess);
            }
            (MaterialModel::Conductor { .. }, _) => assert_eq!(material.model, found.model),
            _ => {
                assert_eq!(material.model, found.model);
                assert_eq!(material.base_color, found.base_color);
                assert_eq!(material.metallic, found.metallic);
            }
        }
        assert!(
            close(material.emissive, found.emissive),
            "{material:?} {found:?}"
        );
        assert_eq!(
            (
                material.roughness,
                material.ior,
                material.specular,
                material.transmission
            ),
            (
                found.roughness,
                found.ior,
                found.specular,
                found.transmission
            )
        );
        assert_eq!(
            (material.alpha_mode, material.volume),
            (found.alpha_mode, found.volume)
        );
    }
}

#[test]
fn meshes_of_slivers_alone_are_not_in_the_atlas() {
    let needle = |height: f32| Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, height, 0.0)],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let mut scene = shown(Material::default());
    for height in [1e-4, 1e-5, 1e-6, 1e-7, 1e-9, 1e-20] {
        let mesh = scene.add_mesh(needle(height));
        scene.add_instance("needle", mesh, 0, Mat4::IDENTITY);
    }
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    let placed: Vec<bool> = atlas.instances.iter().map(Option::is_some).collect();
    assert_eq!(placed, [true, true, false, false, false, false, false]);
    scene.instances.drain(..2);
    let alone = Atlas::new(&scene, &options).unwrap();
    assert!(alone.instances.iter().all(Option::is_none));
}

#[test]
fn messages_say_where_and_quote_little() {
    let at = |change: fn(&mut serde_json::Value)| {
        import("a.gltf", &triangle(change), &Nothing, &Limits::default()).unwrap_err()
    };
    let error = at(|document| document["nodes"][0]["mesh"] = json!(-1));
    assert_eq!(error.place, "nodes[0].mesh", "{error}");
    let error = at(|document| document["buffers"][0]["byteLength"] = json!("x".repeat(10_000)));
    assert_eq!(error.place, "buffers[0].byteLength");
    assert!(error.reason.len() < 250, "{error}");
    let long = "y".repeat(5000);
    let error = at(|document| document["accessors"][0]["type"] = json!("y".repeat(5000)));
    assert!(
        !error.reason.contains(&long) && error.reason.contains("yyy..."),
        "{error}"
    );
    let mut file = b"glTF\x02\0\0\0\x20\0\0\0\x04\0\0\0".to_vec();
    file.extend(b"N\":4    more bytes");
    let error = import("a.glb", &file, &Nothing, &Limits::default()).unwrap_err();
    assert!(error.reason.contains(r#""N\":4""#), "{error}");
}

#[test]
fn warnings_do_not_flood() {
    let flat = json!({ "mesh": 0, "scale": [0, 0, 0] });
    let file = triangle(|document| document["nodes"] = json!(vec![flat; 5000]));
    let scene = import("a.gltf", &file, &Nothing, &Limits::default()).unwrap();
    assert_eq!(scene.warnings.len(), 101);
    assert_eq!(scene.warnings[100], "and 4900 more warnings");
}

/// A folder with a scene, a file beside it, one below it, one outside, and a symbolic link to that one.
fn house() -> std::path::PathBuf {
    let root =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("untrusted-{}", std::process::id()));
    std::fs::remove_dir_all(&root).ok();
    std::fs::create_dir_all(root.join("house/below")).unwrap();
    std::fs::create_dir_all(root.join("beside")).unwrap();
    for place in [
        "secret.bin",
        "house/a.bin",
        "house/below/b.bin",
        "beside/c.bin",
    ] {
        std::fs::write(root.join(place), [0; 36]).unwrap();
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../secret.bin", root.join("house/link.bin")).unwrap();
        std::os::unix::fs::symlink("..", root.join("house/up")).unwrap();
        std::os::unix::fs::symlink("a.bin", root.join("house/inside.bin")).unwrap();
    }
    root
}

#[test]
fn files_refer_to_nothing_outside_their_folder() {
    let root = house();
    let folder = root.join("house");
    let read = |uri: &str| {
        let scene = triangle(|document| document["buffers"][0]["uri"] = json!(uri));
        std::fs::write(folder.join("a.gltf"), scene).unwrap();
        import_file(&folder.join("a.gltf"), &Limits::default())
    };
    for uri in [
        "a.bin",
        "./a.bin",
        "below/b.bin",
        "below/../a.bin",
        "%61.bin",
        "../house/a.bin",
    ] {
        read(uri).unwrap_or_else(|error| panic!("{error}"));
    }
    let absolute = root.join("secret.bin").display().to_string();
    let addressed = format!("file://{absolute}");
    let mut hostile = vec![
        "../secret.bin",
        "%2e%2e/secret.bin",
        "..%2Fsecret.bin",
        "below/../../secret.bin",
        "./.././secret.bin",
        "../missing.bin",
        "/etc/passwd",
        "//host/share",
        "C:/secret.bin",
        "c:secret.bin",
        "file:a.bin",
        "FILE:/etc/passwd",
        "https://example.org/a.bin",
        &absolute,
        &addressed,
    ];
    if cfg!(unix) {
        read("inside.bin").unwrap();
        hostile.extend(["link.bin", "up/secret.bin"]);
    }
    for uri in hostile {
        let error = read(uri).expect_err(uri);
        assert_eq!(error.place, "buffers[0].uri", "{uri}: {error}");
        let is_below = uri.starts_with(['.', '%', 'b', 'l', 'u']);
        let says_why = if is_below {
            error.reason.contains("--files-from FOLDER allows it")
        } else if uri.contains("://") {
            error.reason.contains("addresses are not read")
        } else {
            error.reason.contains("absolute paths are not read")
        };
        assert!(says_why, "{uri}: {error}");
    }
    // Of every format that refers to files.
    let resolver = FileResolver::new(&folder, Limits::default());
    let text = "mtllib ../secret.bin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let scene = import("a.obj", text.as_bytes(), &resolver, &Limits::default()).unwrap();
    assert!(
        scene.warnings[0].contains("outside the folder"),
        "{:?}",
        scene.warnings
    );
    // Another folder may be allowed, above or beside the scene's own, with all below it and nothing else.
    let within = |allowed: &Path, uri: &str| {
        FileResolver::within(&folder, allowed, Limits::default()).read(uri)
    };
    within(&root, "a.bin").unwrap();
    within(&root, "../secret.bin").unwrap();
    within(&root, "below/../../beside/c.bin").unwrap();
    within(&root.join("beside"), "a.bin").unwrap();
    within(&root.join("beside"), "../beside/c.bin").unwrap();
    if cfg!(unix) {
        within(&root, "link.bin").unwrap();
        let error = within(&root.join("beside"), "link.bin").unwrap_err();
        assert!(error.contains("symbolic link leads outside"), "{error}");
    }
    for uri in [
        "../secret.bin",
        "../missing.bin",
        "../../secret.bin",
        "../besides/c.bin",
    ] {
        let error = within(&root.join("beside"), uri).unwrap_err();
        assert!(error.contains("--files-from FOLDER allows it"), "{error}");
    }
    for uri in [&absolute, "C:/tex/a.png"] {
        let error = within(&root, uri).unwrap_err();
        assert!(error.contains("absolute paths are not read"), "{error}");
    }
    std::fs::copy(folder.join("a.bin"), root.join("a.bin")).unwrap();
    let scene = triangle(|document| document["buffers"][0]["uri"] = json!("../a.bin"));
    std::fs::write(folder.join("a.gltf"), scene).unwrap();
    let limits = Limits::default();
    import_file(&folder.join("a.gltf"), &limits).unwrap_err();
    import_file_within(&folder.join("a.gltf"), &root, &limits).unwrap();
    // A folder that vanishes is an error.
    std::fs::remove_dir_all(&root).unwrap();
    assert!(resolver.read("a.bin").is_err());
}
