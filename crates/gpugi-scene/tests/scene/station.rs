//! The built-in scene `station`: what moves does so, comes back, and is where it can be.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Bounds, Instance, Scene};

/// Time after which everything is where it was (s).
const LOOP: f32 = 20.0;

static AT_REST: LazyLock<Scene> = LazyLock::new(|| builtin("station", 1).unwrap());

fn station(time: f32) -> Scene {
    let mut scene = AT_REST.clone();
    scene.pose(time);
    scene
}

/// Corners of an instance's triangles in world space (m).
fn triangles<'a>(scene: &'a Scene, instance: &'a Instance) -> impl Iterator<Item = [Vec3; 3]> + 'a {
    let mesh = &scene.meshes[instance.mesh];
    let place = |index: u32| {
        instance
            .world_from_mesh
            .transform_point3(mesh.positions[index as usize])
    };
    mesh.indices
        .as_chunks::<3>()
        .0
        .iter()
        .map(move |corners| corners.map(place))
}

/// By the name of everything that can move: the place of one of its points, and the matrix of what has one.
fn places(scene: &Scene) -> BTreeMap<String, Vec<f32>> {
    let matrix = |matrix: &Mat4| matrix.to_cols_array().to_vec();
    let instances = scene.instances.iter().map(|instance| {
        let point = scene.meshes[instance.mesh].positions
            [40.min(scene.meshes[instance.mesh].positions.len() - 1)];
        let mut place = matrix(&instance.world_from_mesh);
        place.extend(instance.world_from_mesh.transform_point3(point).to_array());
        (instance.name.to_string(), place)
    });
    let lights = scene.lights.iter().map(|light| {
        (
            format!("light {}", light.name),
            matrix(&light.world_from_light),
        )
    });
    let cameras = scene.cameras.iter().map(|camera| {
        (
            format!("camera {}", camera.name),
            matrix(&camera.world_from_view),
        )
    });
    let media = scene.media.iter().map(|medium| {
        (
            format!("medium {}", medium.name),
            matrix(&medium.world_from_box.unwrap()),
        )
    });
    instances
        .chain(lights)
        .chain(cameras)
        .chain(media)
        .collect()
}

fn difference(a: &[f32], b: &[f32]) -> f32 {
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn size_is_that_of_a_level() {
    let statistics = AT_REST.statistics();
    println!("{statistics:?}");
    assert!((30_000..=100_000).contains(&statistics.triangles));
    assert!(statistics.instances <= 120);
    assert!(AT_REST.lights.len() <= 4);
    assert_eq!(AT_REST.rig.as_ref().unwrap().duration(), LOOP);
    let sources =
        std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/src/builtin/station")).unwrap();
    let bytes: u64 = sources
        .map(|file| file.unwrap().metadata().unwrap().len())
        .sum();
    assert!(bytes < 300_000, "{bytes}");
}

#[test]
fn glass_is_closed() {
    for instance in &AT_REST.instances {
        if AT_REST.materials[instance.material].volume.is_some() {
            assert!(
                AT_REST.meshes[instance.mesh].is_closed(),
                "{}",
                instance.name
            );
        }
    }
}

#[test]
fn what_moves_has_moved_and_comes_back() {
    let [start, later, before_end, end] =
        [0.0, 4.7, LOOP - 0.001, LOOP].map(|time| places(&station(time)));
    assert_eq!(start, end);
    for (name, place) in &start {
        let jump = difference(place, &before_end[name]);
        assert!(jump < 0.02, "{name} jumps by {jump}");
        assert!(later[name].iter().all(|value| value.is_finite()), "{name}");
    }
    let moving = [
        "lift",
        "door",
        "lamp",
        "light lamp",
        "fan",
        "robot",
        "gallery robot",
        "ball",
        "turntable",
        "vase",
        "fish",
        "water",
        "leaves 1",
        "leaves 2",
        "leaves 3",
        "light sun",
        "medium cloud",
        "medium smoke",
        "camera hall",
        "camera gallery",
        "camera basin",
        "camera courtyard",
    ];
    for name in moving {
        let way = difference(&start[name], &later[name]);
        assert!(way > 0.002, "{name} moved by {way}");
    }
    for name in ["walls", "statue", "camera view", "medium fog"] {
        assert_eq!(start[name], later[name], "{name}");
    }
}

/// Distance of `point` from a triangle (m): Ericson, "Real-Time Collision Detection", 5.1.5.
fn distance(point: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
    let normal = (b - a).cross(c - a).normalize();
    let edges = [(a, b), (b, c), (c, a)];
    let is_over = edges
        .iter()
        .all(|(from, to)| (to - from).cross(point - from).dot(normal) >= 0.0);
    if is_over {
        return (point - a).dot(normal).abs();
    }
    let to_edge = |(from, to): (Vec3, Vec3)| {
        let along = (to - from).dot(point - from) / (to - from).length_squared();
        point.distance(from.lerp(to, along.clamp(0.0, 1.0)))
    };
    edges.map(to_edge).into_iter().fold(f32::INFINITY, f32::min)
}

#[test]
fn tours_keep_clear_of_what_stands_still() {
    const CLEAR: f32 = 0.3;
    let still: Vec<_> = AT_REST
        .instances
        .iter()
        .filter(|instance| instance.node.is_none())
        .collect();
    let near = Vec3::splat(CLEAR);
    for camera in &AT_REST.cameras {
        for step in 0..40 {
            let time = LOOP * step as f32 / 40.0;
            let eye = AT_REST
                .camera_at(camera, time)
                .world_from_view
                .w_axis
                .truncate();
            for instance in &still {
                let is_near = |corners: &[Vec3; 3]| {
                    let bounds = corners.iter().fold(Bounds::EMPTY, |bounds, corner| {
                        bounds.union(Bounds {
                            min: corner - near,
                            max: corner + near,
                        })
                    });
                    eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all()
                };
                let closest = triangles(&AT_REST, instance)
                    .filter(is_near)
                    .map(|corners| distance(eye, corners))
                    .fold(f32::INFINITY, f32::min);
                assert!(
                    closest >= CLEAR,
                    "{} at {time} s: {closest} m from {}",
                    camera.name,
                    instance.name
                );
            }
        }
    }
}

#[test]
fn tours_meet_no_robot() {
    let robots = ["robot", "gallery robot"];
    let is_robot = |instance: &&Instance| robots.iter().any(|robot| instance.name == *robot);
    let nodes: Vec<usize> = (AT_REST.instances.iter().filter(is_robot))
        .map(|robot| robot.node.unwrap())
        .collect();
    let rig = AT_REST.rig.as_ref().unwrap();
    for step in 0..200 {
        let time = LOOP * step as f32 / 200.0;
        let pose = rig.pose(time);
        for camera in &AT_REST.cameras {
            let eye = AT_REST.camera_at(camera, time).world_from_view.w_axis;
            for node in &nodes {
                let hips = pose.file_from_node[*node].w_axis.as_vec4();
                let way = hips.distance(eye);
                assert!(way > 1.2, "{} at {time} s: {way} m", camera.name);
            }
        }
    }
}

#[test]
fn feet_stay_on_the_floor_and_do_not_slide() {
    let rig = AT_REST.rig.as_ref().unwrap();
    for (name, floor) in [("robot", 0.0), ("gallery robot", 3.2)] {
        let index = AT_REST
            .instances
            .iter()
            .position(|instance| instance.name == name)
            .unwrap();
        let deformer = rig
            .deformers
            .iter()
            .find(|deformer| deformer.instance == index)
            .unwrap();
        let skin = &rig.skins[deformer.skin.as_ref().unwrap().0];
        // The joints of the feet are the last two.
        let feet = |time: f32| {
            let pose = rig.pose(time);
            [11, 12].map(|joint| {
                pose.file_from_node[skin.joints[joint]]
                    .w_axis
                    .truncate()
                    .as_vec3()
            })
        };
        let mut lowest = f32::INFINITY;
        for step in 0..200 {
            let time = LOOP * step as f32 / 200.0;
            let (now, soon) = (feet(time), feet(time + 0.02));
            let speed = |foot: usize| now[foot].with_y(0.0).distance(soon[foot].with_y(0.0)) / 0.02;
            // One foot stands at any time; it may turn a little between keys.
            let slower = speed(0).min(speed(1));
            assert!(slower < 0.15, "{name} slides at {slower} m/s at {time} s");
            let low = now[0].y.min(now[1].y) - floor;
            assert!(
                (0.06..0.11).contains(&low),
                "{name}: ankle at {low} m at {time} s"
            );
        }
        for time in [0.0, 0.37, 3.1, 7.77, 12.4] {
            let scene = station(time);
            let instance = &scene.instances[index];
            let heights = triangles(&scene, instance).flatten().map(|corner| corner.y);
            lowest = lowest.min(heights.fold(f32::INFINITY, f32::min));
        }
        assert!(
            (floor - 0.04..floor + 0.02).contains(&lowest),
            "{name}: {lowest}"
        );
    }
}
