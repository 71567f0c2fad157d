//! Walking, using and throwing in scenes of a few boxes, and in `station`.

use std::time::Instant;

use glam::{DQuat, DVec3, Mat4, Vec2, Vec3, vec3};
use gpugi_scene::animation::{Animation, Channel, Interpolation, Node, Property, Rig, Transform};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, join};
use gpugi_scene::{Bounds, Document, Edit, Material, Mesh, Scene};

use super::ball::{self, Ball, Finish};
use super::*;

/// Time of a frame (s).
const FRAME: f32 = 1.0 / 60.0;

fn block(low: [f32; 3], high: [f32; 3]) -> Mesh {
    cuboid(low.into(), high.into(), 1)
}

/// A floor of 20 m x 20 m, whose surface is at y = 0.
fn floor() -> Mesh {
    block([-10.0, -0.5, -10.0], [10.0, 0.0, 10.0])
}

fn scene_of(parts: impl IntoIterator<Item = Mesh>) -> Scene {
    let mut scene = Scene::new("boxes");
    let mesh = scene.add_mesh(join("boxes", parts));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("boxes", mesh, material, Mat4::IDENTITY);
    scene
}

/// Somebody who stands at `place` (x, z) and looks along -Z.
struct World {
    document: Document,
    game: Game,
    sight: Sight,
    seconds: f32,
}

impl World {
    fn new(scene: Scene, place: Vec2) -> Self {
        Self::at(scene, vec3(place.x, 2.0, place.y), Vec3::NEG_Z)
    }

    fn at(scene: Scene, eye: Vec3, forward: Vec3) -> Self {
        let document = Document::new(scene);
        let mut game = Game::new(&document, player::EYE).unwrap();
        let right = forward.cross(Vec3::Y).normalize();
        let sight = Sight {
            eye,
            forward,
            right,
        };
        assert!(game.walk(&document, sight, player::EYE).unwrap());
        Self {
            document,
            game,
            sight,
            seconds: 0.0,
        }
    }

    /// A frame, as the session has them.
    fn frame(&mut self, intent: Intent, seconds: f32) {
        self.seconds += seconds;
        self.game.drive(self.document.scene(), seconds);
        let scene = self.document.scene();
        let rig = self.game.rig(scene);
        let posed = rig.map_or_else(Vec::new, |rig| scene.posed_by(rig, self.seconds));
        self.document.edit(&posed);
        let edits = self
            .game
            .advance(&self.document, self.sight, intent, seconds)
            .unwrap();
        self.document.edit(&edits);
        self.sight.eye = self.player().eye();
    }

    /// Goes right and forward for `seconds`.
    fn go(&mut self, right: f32, forward: f32, seconds: f32) {
        let way = Vec2::new(right, forward);
        let intent = Intent {
            way,
            ..Intent::default()
        };
        for _ in 0..(seconds / FRAME).round() as u32 {
            self.frame(intent, FRAME);
        }
    }

    fn player(&self) -> &player::Player {
        self.game.player.as_ref().unwrap()
    }

    fn feet(&self) -> Vec3 {
        self.player().body().0
    }
}

fn assert_near(value: f32, expected: f32, tolerance: f32) {
    let difference = (value - expected).abs();
    assert!(difference <= tolerance, "{value} is not {expected}");
}

#[test]
fn a_wall_stops_and_lets_slide() {
    let wall = block([-10.0, 0.0, -3.1], [10.0, 3.0, -3.0]);
    let scene = scene_of([floor(), wall]);
    let mut world = World::new(scene.clone(), Vec2::ZERO);
    world.go(0.0, 1.0, 3.0);
    assert_near(world.feet().z, -2.75, 1e-3);
    // Along it at the speed that is left.
    world.go(0.6, 0.8, 2.0);
    assert_near(world.feet().z, -2.75, 1e-3);
    assert_near(world.feet().x, 2.0 * 0.6 * 2.2, 0.01);
    // Whoever stands does not tremble.
    world.go(0.0, 0.0, 0.1);
    let before = world.feet();
    world.go(0.0, 0.0, 1.0);
    assert_eq!(world.feet(), before);
    // In slow frames, running.
    let mut world = World::new(scene, Vec2::ZERO);
    let intent = Intent {
        way: Vec2::Y,
        runs: true,
        jumps: false,
    };
    for _ in 0..20 {
        world.frame(intent, 0.1);
    }
    assert_near(world.feet().z, -2.75, 1e-3);
}

#[test]
fn steps_are_climbed_unless_they_are_too_high() {
    for (height, is_climbed) in [(0.1, true), (0.4, true), (0.42, false), (1.0, false)] {
        let step = block([-10.0, 0.0, -5.0], [10.0, height, -2.0]);
        let mut world = World::new(scene_of([floor(), step]), Vec2::ZERO);
        world.go(0.0, 1.0, 1.6);
        let feet = world.feet();
        let expected = if is_climbed { height } else { 0.0 };
        assert_near(feet.y, expected, 1e-3);
        let way = if is_climbed { 1.6 * 2.2 } else { 1.75 };
        assert_near(feet.z, -way, 0.01);
        // And down again, without a flight.
        for _ in 0..90 {
            world.go(0.0, -1.0, FRAME);
            assert!(world.player().is_on_ground());
        }
        assert_near(world.feet().y, 0.0, 1e-3);
    }
}

#[test]
fn who_jumps_and_falls_lands() {
    let table = block([-2.0, 0.0, -2.0], [2.0, 1.5, 2.0]);
    let lamp = block([3.5, 2.2, -9.0], [5.0, 2.3, 9.0]);
    let mut world = World::new(scene_of([floor(), table, lamp]), Vec2::ZERO);
    assert_near(world.feet().y, 1.5, 1e-3);
    let jump = |world: &mut World| {
        let intent = Intent {
            jumps: true,
            ..Intent::default()
        };
        world.frame(intent, FRAME);
        let mut highest = world.feet().y;
        for _ in 0..80 {
            world.go(0.0, 0.0, FRAME);
            highest = highest.max(world.feet().y);
        }
        assert!(world.player().is_on_ground());
        highest
    };
    // v^2 / (2 g)
    assert_near(jump(&mut world), 1.5 + 3.7 * 3.7 / (2.0 * 9.81), 0.02);
    assert_near(world.feet().y, 1.5, 1e-3);
    // Off the table, which takes sqrt(2 h / g) = 0.55 s from the edge.
    world.go(1.0, 0.0, 1.1);
    assert!(!world.player().is_on_ground());
    world.go(1.0, 0.0, 0.7);
    assert!(world.player().is_on_ground());
    assert_near(world.feet().y, 0.0, 1e-3);
    // Below what hangs at 2.2 m, 0.4 m are left to jump.
    assert_near(world.feet().x, 3.96, 0.05);
    assert_near(jump(&mut world), 0.4, 0.01);
}

#[test]
fn who_falls_out_of_the_world_is_put_back() {
    let mut world = World::new(scene_of([floor()]), Vec2::new(0.0, -8.0));
    world.go(0.0, 1.0, 2.0);
    assert!(world.feet().y < -1.0);
    world.go(0.0, 0.0, 3.2);
    assert_eq!(world.feet().x, 0.0);
    assert_near(world.feet().y, 0.0, 1e-3);
    assert_near(world.feet().z, -8.0, 1e-3);
}

#[test]
fn ground_is_found_before_a_camera_that_stands_outside() {
    let scene = builtin("cornell", 1).unwrap();
    let eye = scene.cameras[0].world_from_view.w_axis.truncate();
    let bounds = scene.bounds();
    let world = World::at(scene, eye, Vec3::NEG_Z);
    let feet = world.feet();
    assert!(feet.cmpge(bounds.min - 0.01).all() && feet.cmple(bounds.max).all());
    assert_near(feet.y, 0.0, 0.01);
}

#[test]
fn eyes_are_as_high_as_the_scene_is_large() {
    for (name, height) in [("room", 1.7), ("cornell", 1.7), ("window-room", 170.0)] {
        assert_near(eye_height(&builtin(name, 1).unwrap()), height, 1e-3);
    }
    let small = scene_of([block([-0.1, 0.0, -0.1], [0.1, 0.1, 0.1])]);
    assert_near(eye_height(&small), 0.17, 1e-4);
    assert_eq!(eye_height(&Scene::default()), 1.7);
}

/// The way of a node's origin along an axis, as keys at whole seconds.
fn slide(axis: Vec3, ways: &[f32]) -> Rig {
    let times = (0..ways.len()).map(|second| second as f32);
    Rig {
        nodes: vec![Node {
            parent: None,
            rest: Transform::Parts {
                translation: DVec3::ZERO,
                rotation: DQuat::IDENTITY,
                scale: DVec3::ONE,
            },
            weights: Vec::new(),
        }],
        order: vec![0],
        animations: vec![Animation {
            name: "slide".to_owned(),
            duration: ways.len() as f32 - 1.0,
            channels: vec![Channel {
                node: 0,
                property: Property::Translation,
                interpolation: Interpolation::Linear,
                times: times.collect(),
                values: ways
                    .iter()
                    .flat_map(|way| (axis * *way).to_array())
                    .collect(),
            }],
        }],
        ..Rig::default()
    }
}

/// A floor, and a box that a node carries.
fn moving(part: Mesh, rig: Rig) -> Scene {
    let mut scene = scene_of([floor()]);
    let mesh = scene.add_mesh(part);
    let moved = scene.add_instance("moved", mesh, 0, Mat4::IDENTITY);
    scene.instances[moved].node = Some(0);
    scene.rig = Some(rig);
    scene.pose(0.0);
    scene
}

#[test]
fn a_lift_takes_along_who_stands_on_it() {
    let platform = block([-1.0, 0.0, -1.0], [1.0, 0.1, 1.0]);
    let way = vec3(0.5, 1.0, 0.0);
    let rig = slide(way, &[0.0, 1.0, 3.0, 3.0, 0.0]);
    let mut world = World::new(moving(platform, rig), Vec2::ZERO);
    for _ in 0..(4.0 / FRAME) as u32 {
        world.go(0.0, 0.0, FRAME);
        let place = world.document.scene().instances[1].world_from_mesh;
        let expected = place.transform_point3(Vec3::Y * 0.1);
        assert!(world.feet().distance(expected) < 0.01, "{}", world.feet());
        assert!(world.player().is_on_ground());
    }
    assert!(world.document.scene().instances[1].world_from_mesh.w_axis.y < 0.1);
}

#[test]
fn what_is_used_goes_to_its_other_end_and_back() {
    // Open for a second, closed for three.
    let leaf = block([-2.0, 0.0, -1.1], [0.5, 2.0, -1.0]);
    let rig = slide(Vec3::X, &[1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let mut world = World::new(moving(leaf, rig), Vec2::ZERO);
    let open = |world: &World| world.document.scene().instances[1].world_from_mesh.w_axis.x;
    assert!(!world.game.operate(&Scene::default(), world.sight, 0.0));
    world.go(0.0, 0.0, 3.0);
    assert_near(open(&world), 0.0, 1e-3);
    let use_it = |world: &mut World| {
        let (scene, sight) = (world.document.scene().clone(), world.sight);
        assert!(world.game.operate(&scene, sight, world.seconds));
    };
    // It opens at once, though its path has a second's pause, and stays open, whatever the clock says.
    use_it(&mut world);
    world.go(0.0, 0.0, 0.5);
    assert_near(open(&world), 0.5, 0.03);
    world.go(0.0, 0.0, 0.6);
    for _ in 0..10 {
        world.go(0.0, 0.0, 0.7);
        assert_near(open(&world), 1.0, 1e-3);
    }
    // Closed again, but turned back on the way.
    use_it(&mut world);
    world.go(0.0, 0.0, 0.5);
    assert_near(open(&world), 0.5, 0.03);
    use_it(&mut world);
    world.go(0.0, 0.0, 1.0);
    assert_near(open(&world), 1.0, 1e-3);
    use_it(&mut world);
    world.go(0.0, 0.0, 7.0);
    assert_near(open(&world), 0.0, 1e-3);
    // The door is out of reach.
    world.go(0.0, -1.0, 3.0);
    let scene = world.document.scene().clone();
    assert!(!world.game.operate(&scene, world.sight, 0.0));
}

/// A ball that falls onto the floor, from rest at a height of its lowest point (m).
fn dropped(scene: &Scene, height: f32) -> (solid::Solid, Ball) {
    let solid = solid::Solid::new(&Document::new(scene.clone()), 0..0).unwrap();
    let center = vec3(0.3, height + ball::RADIUS, 0.2);
    (solid, Ball::new(center, Vec3::ZERO, ball::RADIUS))
}

#[test]
fn a_ball_bounces_to_the_right_height_and_rests() {
    for seconds in [FRAME, 1.0 / 240.0, 0.07] {
        let (solid, mut ball) = dropped(&scene_of([floor()]), 1.5);
        let mut before = ball.velocity.y;
        let mut highest = Vec::new();
        let mut passed = 0.0;
        while !ball.is_at_rest() && passed < 20.0 {
            let was = ball.center.y;
            ball.advance(&solid, 1.0, seconds);
            passed += seconds;
            if before > 0.0 && ball.velocity.y <= 0.0 {
                highest.push(was.max(ball.center.y) - ball::RADIUS);
            }
            before = ball.velocity.y;
        }
        // The square of the restitution, each time; a slow frame may pass by the top.
        let slack = 0.02 + 9.81 * seconds * seconds / 2.0;
        assert_near(highest[0], 1.5 * 0.49, slack);
        assert_near(highest[1], 1.5 * 0.49 * 0.49, slack);
        assert!(
            ball.is_at_rest() && (2.0..8.0).contains(&passed),
            "{passed}"
        );
        assert_near(ball.center.y, ball::RADIUS, 1e-3);
        assert!(!ball.advance(&solid, 1.0, seconds));
    }
}

#[test]
fn a_ball_passes_no_wall_and_rolls_out() {
    let walls = [
        block([-3.001, 0.0, -3.0], [-3.0, 3.0, 3.0]),
        block([3.0, 0.0, -3.0], [3.001, 3.0, 3.0]),
        block([-3.0, 0.0, -3.001], [3.0, 3.0, -3.0]),
        block([-3.0, 0.0, 3.0], [3.0, 3.0, 3.001]),
        block([-3.0, 3.0, -3.0], [3.0, 3.001, 3.0]),
    ];
    let scene = scene_of(std::iter::once(floor()).chain(walls));
    for seconds in [FRAME, 0.1] {
        let (solid, mut ball) = dropped(&scene, 1.0);
        ball.velocity = vec3(300.0, 20.0, 37.0);
        let room = Bounds {
            min: vec3(-3.0, 0.0, -3.0),
            max: Vec3::splat(3.0),
        };
        let mut passed = 0.0;
        while !ball.is_at_rest() && passed < 60.0 {
            ball.advance(&solid, 1.0, seconds);
            passed += seconds;
            let near = ball.center.clamp(room.min, room.max);
            assert!(near.distance(ball.center) < 1e-3, "{} outside", ball.center);
        }
        assert!(ball.is_at_rest() && passed > 3.0, "{passed}");
    }
}

#[test]
fn balls_meet_and_are_kicked() {
    let at = |x: f32, velocity: f32| Ball::new(Vec3::X * x, Vec3::X * velocity, 0.15);
    let (mut a, mut b) = (at(0.0, 2.0), at(0.29, 0.0));
    assert!(ball::collide(&mut a, &mut b));
    assert_near(a.velocity.x + b.velocity.x, 2.0, 1e-5);
    assert_near(b.velocity.x - a.velocity.x, 0.7 * 2.0, 1e-5);
    assert!(!ball::collide(&mut a, &mut at(1.0, 0.0)));
    let mut ball = Ball::new(vec3(0.3, 0.15, 0.0), Vec3::ZERO, 0.15);
    kick(&mut ball, (Vec3::ZERO, 0.25, 1.8), Vec2::X * 2.0);
    assert_near(ball.center.x, 0.4, 1e-5);
    assert_near(ball.velocity.x, 2.0, 1e-5);
}

/// What the viewer does with the first throw, and with those to come.
#[test]
fn balls_are_thrown_into_the_scene_and_reused() {
    let wall = block([-10.0, 0.0, -6.1], [10.0, 3.0, -6.0]);
    let mut scene = scene_of([floor(), wall]);
    let center = vec3(0.0, 0.5, 0.0);
    let first = ball::add_to(&mut scene, Finish::Glass, center, 0.15);
    let balls = first..first + ball::COUNT;
    let mut world = World::new(scene, Vec2::X);
    world.game.renew(&world.document, balls.clone()).unwrap();
    for throw in 0..ball::COUNT + 1 {
        world.game.throw(world.sight);
        world.go(0.0, 0.0, 0.2);
        let place = world.document.scene().instances[first + throw % ball::COUNT].world_from_mesh;
        // Forward from the hand.
        assert_near(place.w_axis.z, -0.6 - 0.2 * 7.0, 0.05);
        assert_eq!(place.x_axis.x, 1.0);
    }
    world.go(0.0, 0.0, 20.0);
    // None rests in another, or moves on.
    let places: Vec<Vec3> = (world.document.scene().instances[balls].iter())
        .map(|ball| ball.world_from_mesh.w_axis.truncate())
        .collect();
    for (index, place) in places.iter().enumerate() {
        assert_near(place.y, 0.15, 0.01);
        let mut others = places[..index].iter();
        assert!(
            others.all(|other| other.distance(*place) > 0.29),
            "{places:?}"
        );
    }
    let revision = world.document.revision();
    world.go(0.0, 0.0, 0.5);
    let since = world.document.since(revision);
    assert_eq!(since, []);
}

/// What comes from strangers ends, and in time.
#[test]
fn strange_scenes_hold_nobody_up() {
    let started = Instant::now();
    let triangle = |corners: [Vec3; 3]| Mesh {
        positions: corners.to_vec(),
        normals: vec![Vec3::Y; 3],
        indices: vec![0, 2, 1],
        ..Mesh::default()
    };
    let large = [-1e30, 1e30].map(|x| vec3(x, 0.0, -1e30));
    let flat = triangle([Vec3::ZERO, Vec3::X, Vec3::X * 2.0]);
    let point = triangle([Vec3::ONE; 3]);
    let scenes = [
        Scene::default(),
        scene_of([Mesh::default()]),
        scene_of([triangle([Vec3::ZERO, Vec3::X * 5.0, Vec3::Z * 5.0])]),
        scene_of([triangle([large[0], large[1], Vec3::Z * 1e30])]),
        scene_of([flat, point.clone()]),
        // All of them are where somebody stands.
        scene_of(std::iter::once(floor()).chain((0..20_000).map(|_| point.clone()))),
    ];
    for (number, scene) in scenes.into_iter().enumerate() {
        let document = Document::new(scene);
        let mut game = Game::new(&document, player::EYE).unwrap();
        for eye in [Vec3::ONE, Vec3::splat(f32::NAN), Vec3::splat(3e38)] {
            let sight = Sight {
                eye,
                forward: Vec3::NEG_Z,
                right: Vec3::X,
            };
            let walks = game.walk(&document, sight, player::EYE).unwrap();
            assert_eq!(
                walks,
                eye == Vec3::ONE && [2, 5].contains(&number),
                "{number}"
            );
            let intent = Intent {
                way: Vec2::ONE,
                runs: true,
                jumps: true,
            };
            game.balls_at = 0..1;
            game.throw(sight);
            for seconds in [FRAME, 0.1, 0.0] {
                let edits = game.advance(&document, sight, intent, seconds).unwrap();
                let is_finite = |edit: &Edit| match edit {
                    Edit::Instance {
                        world_from_mesh, ..
                    } => world_from_mesh.is_finite(),
                    _ => false,
                };
                assert!(edits.iter().all(is_finite));
            }
            assert!(!game.operate(document.scene(), sight, f32::INFINITY));
            game.balls.clear();
        }
    }
    assert!(started.elapsed().as_secs() < 2, "{:?}", started.elapsed());
}

/// From where the first tour begins, forward through the hall, until something stops; then the door opens.
#[test]
fn station_is_walked() {
    let scene = builtin("station", 1).unwrap();
    let camera = scene.cameras.iter().find(|camera| camera.name == "hall");
    let world_from_view = camera.unwrap().world_from_view;
    let eye = world_from_view.w_axis.truncate();
    let mut world = World::at(scene, eye, -world_from_view.z_axis.truncate());
    for _ in 0..90 {
        let intent = Intent {
            way: Vec2::Y,
            ..Intent::default()
        };
        world.frame(intent, 0.1);
        let feet = world.feet();
        // In the hall (14 m x 9 m), on its floor or a step.
        assert!(feet.x.abs() < 6.8 && feet.z.abs() < 4.3, "{feet}");
        assert!((-0.01..0.6).contains(&feet.y), "{feet}");
    }
    assert!(world.feet().x < -2.0, "{}", world.feet());
    let door = (world.document.scene().instances.iter())
        .position(|instance| instance.name.as_str() == "door")
        .unwrap();
    let open = |world: &World| {
        world.document.scene().instances[door]
            .world_from_mesh
            .w_axis
            .x
    };
    // Before it, at a moment when it is closed.
    let (seconds, eye) = (7.0, vec3(2.6, 1.7, -3.5));
    world.sight.eye = eye;
    world.sight.forward = Vec3::NEG_Z;
    world.sight.right = Vec3::X;
    let scene = world.document.scene().clone();
    assert!(world.game.operate(&scene, world.sight, seconds));
    world.seconds = seconds;
    for _ in 0..40 {
        world.frame(Intent::default(), 0.1);
    }
    assert_near(open(&world), 1.08 * 0.53, 0.01);
}
