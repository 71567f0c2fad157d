//! Built-in scenes: everything that a technique may rely on.

use glam::{Mat3, Mat4, Vec3, vec3};
use gpugi_scene::builtin::{SCENES, builtin, shapes};
use gpugi_scene::{Mesh, Scene};

/// Checks the mesh, its unit normals, and that every triangle has an area and faces where its normals point.
fn check_mesh(mesh: &Mesh) {
    let name = &mesh.name;
    mesh.check()
        .unwrap_or_else(|reason| panic!("{name}: {reason}"));
    assert!(!mesh.indices.is_empty(), "{name} has no triangles");
    for normal in &mesh.normals {
        assert!((normal.length() - 1.0).abs() < 1e-4, "{name}: {normal}");
    }
    for (number, triangle) in mesh.indices.chunks(3).enumerate() {
        let [a, b, c] = [0, 1, 2].map(|i| mesh.positions[triangle[i] as usize]);
        let front = (b - a).cross(c - a);
        assert!(
            front.length() > 0.0,
            "{name}: triangle {number} has no area"
        );
        for &vertex in triangle {
            let agreement = front.normalize().dot(mesh.normals[vertex as usize]);
            assert!(
                agreement > 0.2,
                "{name}: triangle {number}, vertex {vertex}: {agreement}"
            );
        }
    }
}

fn scene(name: &str) -> Scene {
    builtin(name, 1).expect("the scene exists")
}

/// World-space middle and front direction of an instance's triangles.
fn faces<'a>(scene: &'a Scene, name: &str) -> impl Iterator<Item = (Vec3, Vec3)> + 'a {
    let instance = scene
        .instances
        .iter()
        .find(|instance| instance.name == name)
        .unwrap();
    let mesh = &scene.meshes[instance.mesh];
    mesh.indices.chunks(3).map(move |triangle| {
        let [a, b, c] = [0, 1, 2].map(|i| {
            instance
                .world_from_mesh
                .transform_point3(mesh.positions[triangle[i] as usize])
        });
        ((a + b + c) / 3.0, (b - a).cross(c - a).normalize())
    })
}

#[test]
fn every_scene_is_complete() {
    for entry in SCENES {
        let scene = scene(entry.name);
        assert_eq!(scene.name, entry.name);
        assert!(!entry.summary.is_empty());
        let bounds = scene.bounds();
        assert!(bounds.min.is_finite() && bounds.max.is_finite() && !bounds.is_empty());
        assert!(!scene.cameras.is_empty(), "{} has no camera", entry.name);
        assert!(scene.has_light(), "{} is dark", entry.name);
        assert!(scene.warnings.is_empty());
        scene.meshes.iter().for_each(|mesh| check_mesh(mesh));
        for instance in &scene.instances {
            assert!(
                instance.mesh < scene.meshes.len() && instance.material < scene.materials.len()
            );
            assert!(instance.world_from_mesh.is_finite());
        }
        for texture in &scene.textures {
            assert!(texture.image < scene.images.len());
        }
        for medium in &scene.media {
            assert_eq!(medium.check(), Ok(()));
        }
        for image in &scene.images {
            assert_eq!(image.byte_size(), (image.width * image.height * 4) as usize);
        }
        println!("{}: {:?}", entry.name, scene.statistics());
    }
}

#[test]
fn detail_scales_the_number_of_triangles_and_is_bounded() {
    let triangles = |name: &str, detail| builtin(name, detail).unwrap().statistics().triangles;
    for entry in SCENES {
        let growth = triangles(entry.name, 4) as f64 / triangles(entry.name, 2) as f64;
        assert!((2.0..5.0).contains(&growth), "{}: {growth}", entry.name);
        assert_eq!(triangles(entry.name, 0), triangles(entry.name, 1));
    }
    assert_eq!(triangles("cornell", 64), triangles("cornell", u32::MAX));
    assert!(builtin("no such scene", 1).is_none());
}

#[test]
fn cornell_box_looks_as_it_always_does() {
    let scene = scene("cornell");
    let camera = &scene.cameras[0];
    let view_from_world = camera.world_from_view.inverse();
    let inside = vec3(0.0, 2.7, -2.8);
    for wall in [
        "floor",
        "ceiling",
        "back wall",
        "left wall",
        "right wall",
        "light",
    ] {
        for (middle, front) in faces(&scene, wall) {
            assert!(front.dot(inside - middle) > 0.0, "{wall} faces outward");
        }
    }
    for (_, front) in faces(&scene, "light") {
        assert!(front.y < -0.999);
    }
    let side = |name: &str| {
        let (middle, _) = faces(&scene, name).next().unwrap();
        let instance = scene
            .instances
            .iter()
            .find(|instance| instance.name == name)
            .unwrap();
        let color = scene.materials[instance.material].base_color;
        (view_from_world.transform_point3(middle).x, color)
    };
    let (left, red) = side("left wall");
    let (right, green) = side("right wall");
    assert!(left < -2.5 && red.x > 0.6 && red.y < 0.1);
    assert!(right > 2.5 && green.y > 0.4 && green.x < 0.2);
    // The tall block stands behind and to the left of the short one.
    let middle = |name: &str| {
        let mesh = scene.meshes.iter().find(|mesh| mesh.name == name).unwrap();
        assert!(mesh.is_closed() && volume(mesh) > 0.0, "{name}");
        view_from_world.transform_point3(mesh.bounds().center())
    };
    assert!(middle("tall block").x < 0.0 && middle("short block").x > 0.0);
    assert!(middle("tall block").z < middle("short block").z);
    let bounds = scene.bounds();
    assert!((bounds.max.y - 5.488).abs() < 1e-4 && (bounds.min.z + 5.592).abs() < 1e-4);
}

#[test]
fn room_walls_face_the_camera_inside() {
    let scene = scene("room");
    let eye = scene.cameras[0].world_from_view.w_axis.truncate();
    for wall in [
        "floor",
        "ceiling",
        "back wall",
        "front wall",
        "left wall",
        "right wall",
    ] {
        for (middle, front) in faces(&scene, wall) {
            assert!(front.dot(eye - middle) > 0.0, "{wall} faces outward");
        }
    }
}

#[test]
fn solids_are_closed_and_face_outward() {
    let base = [
        vec3(0.0, 0.0, 1.0),
        vec3(1.0, 0.0, 1.0),
        vec3(1.3, 0.0, 0.0),
        vec3(0.0, 0.0, 0.0),
    ];
    let solids = [
        shapes::cuboid(vec3(-1.0, -2.0, -3.0), vec3(1.0, 2.0, 3.0), 3),
        shapes::hexahedron(base, base.map(|corner| corner + Vec3::Y), 5),
        shapes::sphere(0.7, 9),
        shapes::cylinder(0.5, 2.0, 17),
        shapes::cone(0.5, 2.0, 17),
        shapes::torus(1.0, 0.3, 11),
    ];
    for solid in &solids {
        check_mesh(solid);
        assert!(solid.is_closed(), "{}", solid.name);
        assert!(volume(solid) > 0.0, "{}", solid.name);
    }
    // A finely cut sphere has nearly the ball's volume, and a scaled one keeps unit normals.
    let ball = shapes::sphere(1.0, 64);
    assert!((volume(&ball) / 4.18879 - 1.0).abs() < 0.005);
    let matrix = Mat4::from_scale(vec3(1.0, 3.0, 0.5)) * Mat4::from_rotation_x(0.3);
    let stretched = shapes::transformed(ball, &matrix);
    check_mesh(&stretched);
    assert!((volume(&stretched) / (4.18879 * 1.5) - 1.0).abs() < 0.005);
}

/// The volume inside a closed mesh; positive when it faces outward.
fn volume(mesh: &Mesh) -> f32 {
    let corner = |index: &u32| mesh.positions[*index as usize];
    mesh.indices
        .chunks(3)
        .map(|t| Mat3::from_cols(corner(&t[0]), corner(&t[1]), corner(&t[2])).determinant() / 6.0)
        .sum()
}

/// The edges that only one triangle has, after welding, as pairs of positions.
fn open_edges(mesh: &Mesh) -> Vec<[Vec3; 2]> {
    let welded = mesh.weld_positions();
    let mut edges = std::collections::HashMap::new();
    for triangle in mesh.indices.chunks(3) {
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            let key = (welded[a as usize], welded[b as usize]);
            let earlier = edges.insert(key, [a, b]);
            assert!(earlier.is_none(), "two triangles share a directed edge");
        }
    }
    let is_open = |&(&(a, b), _): &(&(u32, u32), _)| !edges.contains_key(&(b, a));
    let ends = edges.iter().filter(is_open).map(|(_, ends)| *ends);
    ends.map(|ends| ends.map(|vertex| mesh.positions[vertex as usize]))
        .collect()
}

#[test]
fn teapot_is_newells() {
    let scene = builtin("teapot", 2).unwrap();
    let mesh = scene
        .meshes
        .iter()
        .find(|mesh| mesh.name == "teapot")
        .unwrap();
    assert_eq!(mesh.indices.len() / 3, 32 * 12 * 12 * 2 - 8 * 12);
    // Newell's units are 0.1 m: the handle reaches -3, the spout 3.5 units, the knob is 3.15 high.
    let bounds = mesh.bounds();
    assert!(
        (bounds.min - vec3(-0.3, 0.0, -0.2)).abs().max_element() < 0.002,
        "{bounds:?}"
    );
    assert!(
        (bounds.max - vec3(0.342, 0.315, 0.2)).abs().max_element() < 0.003,
        "{bounds:?}"
    );
    // Open only where Newell left it open: lid and rim, ends of the handle and of the spout.
    let near = |value: f32, wanted: f32| (value - wanted).abs() < 1e-5;
    for edge in open_edges(mesh) {
        for p in edge {
            let radius = p.x.hypot(p.z);
            let rim =
                near(p.y, 0.24) && (near(radius, 0.14) || near(radius, 0.13) || radius < 0.1408);
            let spout = near(p.x, 0.17) || (near(p.y, 0.24) && p.x > 0.279);
            let handle = p.x < -0.149 && p.x > -0.201 && p.z.abs() < 0.0301;
            assert!(rim || spout || handle, "a hole at {p}");
        }
    }
    // The outermost vertices face outward.
    for direction in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z, Vec3::NEG_Z] {
        let along = |vertex: &usize| mesh.positions[*vertex].dot(direction);
        let farthest = (0..mesh.positions.len()).max_by(|a, b| along(a).total_cmp(&along(b)));
        assert!(
            mesh.normals[farthest.unwrap()].dot(direction) > 0.5,
            "{direction}"
        );
    }
    // Nearly closed, so that its signed volume is near that of the pot's body.
    let volume = volume(mesh);
    assert!((0.02..0.03).contains(&volume), "{volume}");
}

#[test]
fn glass_is_closed() {
    for detail in [1, 2, 5] {
        let scene = builtin("glass-room", detail).unwrap();
        for name in ["teapot", "ball"] {
            let instance = scene
                .instances
                .iter()
                .find(|instance| instance.name == name);
            let mesh = &scene.meshes[instance.unwrap().mesh];
            check_mesh(mesh);
            assert!(mesh.is_closed(), "{name}");
            assert!(scene.materials[instance.unwrap().material].volume.is_some());
        }
        let solid = scene
            .meshes
            .iter()
            .find(|mesh| mesh.name == "solid teapot")
            .unwrap();
        // The volume of body, lid and knob as solids of revolution, plus a little for handle and spout. No part counts
        // twice, as it would if solids overlapped.
        let volume = volume(solid);
        println!("{volume}");
        assert!((0.024..0.028).contains(&volume), "{volume}");
    }
}

#[test]
fn the_spot_of_the_glass_room_swings_about_where_it_was() {
    let mut scene = scene("glass-room");
    let aim = |scene: &Scene| (scene.lights[0].position(), scene.lights[0].direction());
    let (place, still) = aim(&scene);
    for (time, expected_degrees) in [(0.0, 0.0), (2.0, 12.0), (4.0, 0.0), (6.0, -12.0)] {
        scene.pose(time);
        let (at, direction) = aim(&scene);
        assert!(at.distance(place) < 1e-5);
        assert!((direction.y - still.y).abs() < 1e-5);
        let angle = glam::vec2(still.x, -still.z).angle_to(glam::vec2(direction.x, -direction.z));
        assert!(
            (angle.to_degrees() - expected_degrees).abs() < 0.1,
            "{time} s: {}",
            angle.to_degrees()
        );
    }
}

#[test]
fn chamber_is_closed_and_of_moderate_size() {
    let scene = scene("chamber");
    let triangles = scene.statistics().triangles;
    assert!((3000..=4000).contains(&triangles), "{triangles}");
    let shell = ["floor", "walls"].map(|name| {
        let mesh = scene.meshes.iter().find(|mesh| mesh.name == name);
        Mesh::clone(mesh.unwrap())
    });
    let middle = vec3(0.0, 4.5, 0.0);
    for name in ["floor", "walls"] {
        for (at, front) in faces(&scene, name) {
            assert!(front.dot(middle - at) > 0.0, "{name} faces outward");
        }
    }
    assert!((volume(&shapes::join("shell", shell)) + 12.0 * 16.0 * 9.0).abs() < 0.1);
    for name in ["column", "balustrade", "gallery", "lamp"] {
        let mesh = scene.meshes.iter().find(|mesh| mesh.name == name).unwrap();
        assert!(mesh.is_closed() && volume(mesh) > 0.0, "{name}");
    }
    assert_eq!(scene.images.len(), 2);
}

#[test]
fn shapes_scene_has_one_of_each() {
    let scene = scene("shapes");
    let statistics = scene.statistics();
    assert_eq!(
        (
            statistics.point_lights,
            statistics.spot_lights,
            statistics.directional_lights
        ),
        (1, 1, 1)
    );
    assert!(statistics.emissive_triangles > 0 && statistics.alpha_materials == 1);
    assert!(scene.instances.len() >= scene.meshes.len() + 2);
    assert!(
        scene
            .instances
            .iter()
            .any(|instance| instance.world_from_mesh.determinant() < 0.0)
    );
    for (_, front) in faces(&scene, "lamp") {
        assert!(front.y < -0.999, "the lamp shines down");
    }
}

#[test]
fn emitters_face_what_they_light() {
    let scene = scene("teapot");
    for (middle, front) in faces(&scene, "panel") {
        assert!(front.dot(vec3(0.0, 0.15, 0.0) - middle) > 0.0);
    }
    let glass_room = self::scene("glass-room");
    for (middle, front) in faces(&glass_room, "lamp") {
        assert!(front.dot((vec3(0.0, 0.0, 0.2) - middle).normalize()) > 0.99);
    }
}
