//! Memory: what a file multiplies is charged, what many share is not copied, and honest files fit.

use gpugi_scene::{Limits, import};
use serde_json::json;

use crate::untrusted::files::{Nothing, refused, triangle};

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
        .set("file=3, side=5,images=2KiB,scene=7 MiB,expansion=9,displacement=10")
        .unwrap();
    let expected = Limits {
        file_bytes: 3,
        image_side: 5,
        image_bytes: 2048,
        scene_bytes: 7 << 20,
        expansion: 9,
        displaced_triangles: 10,
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
    // Nine million places without bytes of their own.
    let instancing = triangle(|document| {
        let places = json!({ "componentType": 5126, "count": 9_000_000, "type": "VEC3" });
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
}

/// Names of 100,000 bytes that thousands of things have: each is there once, so that a small limit is enough.
#[test]
fn long_names_of_many_things_are_shared() {
    let long = "x".repeat(100_000);
    let limits = Limits {
        scene_bytes: 32 << 20,
        ..Limits::default()
    };
    let mut groups = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\ng {long}\n");
    for part in 0..3000 {
        groups += &format!("usemtl {part}\nf 1 2 3\n");
    }
    let of_meshes = triangle(|document| {
        document["nodes"] = json!(vec![json!({ "mesh": 0 }); 3000]);
        document["meshes"][0]["name"] = json!(long);
    });
    let of_primitives = triangle(|document| {
        let primitive = document["meshes"][0]["primitives"][0].clone();
        document["meshes"][0]["primitives"] = json!(vec![primitive; 3000]);
        document["meshes"][0]["name"] = json!(long);
    });
    for (name, bytes) in [
        ("a.obj", groups.as_bytes()),
        ("a.gltf", &of_meshes),
        ("b.gltf", &of_primitives),
    ] {
        let scene = import(name, bytes, &Nothing, &limits);
        let scene = scene.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(scene.instances.len(), 3000, "{name}");
        let of_instances = scene.instances.iter().map(|instance| &instance.name);
        let names = of_instances.chain(scene.meshes.iter().map(|mesh| &mesh.name));
        let mut places: Vec<_> = names.map(|name| name.as_ptr()).collect();
        places.sort_unstable();
        places.dedup();
        assert!(places.len() <= 2, "{name}: {} copies", places.len());
    }
    let carriers = triangle(|document| {
        let node = json!({ "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } });
        document["nodes"] = json!(vec![node; 3000]);
        let lens = json!({ "yfov": 1, "znear": 1 });
        document["cameras"] = json!([{ "name": long, "type": "perspective", "perspective": lens }]);
        document["extensions"] =
            json!({ "KHR_lights_punctual": { "lights": [{ "name": long, "type": "point" }] } });
    });
    let scene = import("a.gltf", &carriers, &Nothing, &limits).unwrap();
    let lights = scene.lights.windows(2);
    assert!(
        lights
            .into_iter()
            .all(|pair| pair[0].name.as_ptr() == pair[1].name.as_ptr())
    );
    let cameras = scene.cameras.windows(2);
    assert!(
        cameras
            .into_iter()
            .all(|pair| pair[0].name.as_ptr() == pair[1].name.as_ptr())
    );
    assert_eq!((scene.lights.len(), scene.cameras.len()), (3000, 3000));
}

/// Names that many share are as before if they are short.
#[test]
fn parts_have_names_of_their_own() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\ng wall\nf 1 2 3\n";
    let scene = import("a.obj", text.as_bytes(), &Nothing, &Limits::default()).unwrap();
    let names: Vec<&str> = scene
        .instances
        .iter()
        .map(|instance| instance.name.as_str())
        .collect();
    assert_eq!(names, ["red", "wall (red)"]);
    let two = triangle(|document| {
        let primitive = document["meshes"][0]["primitives"][0].clone();
        document["meshes"][0]["primitives"] = json!([primitive, primitive]);
        document["meshes"][0]["name"] = json!("wall");
    });
    let scene = import("a.gltf", &two, &Nothing, &Limits::default()).unwrap();
    let names: Vec<&str> = scene.meshes.iter().map(|mesh| mesh.name.as_str()).collect();
    assert_eq!(names, ["wall 0", "wall 1"]);
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
