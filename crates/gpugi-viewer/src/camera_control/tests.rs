//! Cameras that are steered, and those that fly by themselves.

use gpugi_arguments::scene_argument;

use super::*;

fn bounds() -> Bounds {
    Bounds::of([Vec3::splat(-1.0), Vec3::ONE])
}

fn control() -> CameraControl {
    let camera = Camera::look_at("first", Vec3::new(1.0, 2.0, 5.0), Vec3::ZERO, 0.7);
    CameraControl::new(&camera, &bounds())
}

fn settle(control: &mut CameraControl) -> Camera {
    for _ in 0..200 {
        if !control.advance(0.016) {
            return control.camera();
        }
    }
    panic!("the camera never comes to rest");
}

fn eye(camera: &Camera) -> Vec3 {
    camera.world_from_view.w_axis.truncate()
}

#[test]
fn an_untouched_camera_is_the_scenes_own() {
    let mut control = control();
    assert!(!control.advance(1.0));
    assert_eq!(control.camera().name.as_str(), "first");
    let mut scene = Scene::default();
    scene.cameras.push(control.camera());
    assert_eq!(control.argument(&scene).as_deref(), Some("first"));
    let elsewhere = control.argument(&Scene::default()).unwrap();
    assert!(elsewhere.starts_with("eye=1,2,5;"), "{elsewhere}");
    // What it becomes when somebody steers stands at the same place.
    let before = control.camera();
    control.orbit(Vec2::ZERO);
    let after = control.camera();
    let difference = before.world_from_view - after.world_from_view;
    let largest = difference.to_cols_array().map(f32::abs);
    assert!(largest.iter().all(|entry| *entry < 1e-4), "{difference}");
}

#[test]
fn orbiting_keeps_the_distance_and_never_turns_over() {
    let mut control = control();
    let before = control.goal;
    control.orbit(Vec2::new(0.5, 9.0));
    let after = eye(&settle(&mut control));
    assert!((after.distance(before.target) - before.distance).abs() < 1e-3);
    // Straight down, up is horizontal.
    assert!(control.camera().world_from_view.y_axis.y > -1e-6);
}

/// Whether somebody who takes hold of the camera sees no jump.
#[track_caller]
#[test]
fn it_flies_with_a_camera_that_nobody_steers() {
    let at = |x: f32| Camera {
        node: Some(3),
        ..Camera::look_at("tour", Vec3::new(x, 2.0, 5.0), Vec3::ZERO, 0.7)
    };
    let mut control = CameraControl::new(&at(1.0), &bounds());
    let others = [
        Camera::look_at("other", Vec3::ONE, Vec3::ZERO, 0.7),
        at(2.0),
    ];
    control.follow(&others, &bounds());
    assert_eq!(control.camera(), at(2.0));
    control.orbit(Vec2::new(0.3, 0.0));
    let steered = settle(&mut control);
    assert_ne!(eye(&steered), eye(&at(2.0)));
    control.follow(&[at(4.0)], &bounds());
    assert_eq!(control.camera(), steered);
}

fn assert_no_jump(control: &CameraControl) {
    let before = control.camera();
    let mut touched = control.clone();
    touched.orbit(Vec2::ZERO);
    let after = touched.camera();
    let difference = before.world_from_view - after.world_from_view;
    let scale = eye(&before).length().max(1.0);
    let largest = difference.to_cols_array().map(|entry| entry.abs() / scale);
    assert!(largest.iter().all(|entry| *entry < 1e-5), "{difference}");
}

#[test]
fn a_camera_that_looks_straight_down_or_up_does_not_jump() {
    for (height, turn) in [(3.0, 0.0), (3.0, 2.0), (-3.0, -1.0)] {
        let mut camera = Camera::look_at("", Vec3::new(0.1, height, 0.2), Vec3::ZERO, 0.7);
        // Exactly vertical, and turned around that.
        camera.world_from_view = Mat4::from_translation(Vec3::new(0.1, height, 0.2))
            * Mat4::from_rotation_y(turn)
            * Mat4::from_rotation_x(-FRAC_PI_2 * f32::signum(height));
        let mut control = CameraControl::new(&camera, &bounds());
        assert_no_jump(&control);
        // A millimetre of orbiting turns it by that much.
        control.orbit(Vec2::new(0.001, 0.0));
        let turned = settle(&mut control).world_from_view.x_axis.truncate();
        let right = camera.world_from_view.x_axis.truncate();
        assert!(turned.angle_between(right) < 0.0015);
        // Its words stand for it.
        let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
        let words = control.argument(&scene).unwrap();
        let read = scene_argument::camera(&scene, Some(&words), 1.0).unwrap();
        let difference = read.world_from_view - control.camera().world_from_view;
        let largest = difference.to_cols_array().map(f32::abs);
        assert!(
            largest.iter().all(|entry| *entry < 1e-4),
            "{words}: {difference}"
        );
    }
}

#[test]
fn the_target_is_what_is_seen_in_the_middle() {
    // In a room, looking at the wall behind; near one of many objects; and far away.
    for (eye_z, seen_z) in [(0.5, 0.9), (1.01, 1.0), (400.0, 1.0), (3000.0, 1.0)] {
        let from = Vec3::new(0.0, 0.0, eye_z);
        let seen = Vec3::new(0.0, 0.0, seen_z);
        let camera = Camera::look_at("", from, seen, 0.7);
        let mut control = CameraControl::new(&camera, &bounds());
        assert!(control.wants_target());
        // The ray through a pixel is not quite the axis.
        control.take_target(Some(seen + Vec3::new(1e-4, 0.0, 0.0)));
        assert!(!control.wants_target());
        assert_eq!(control.camera(), camera);
        assert_no_jump(&control);
        let close = 1e-6 * eye_z.max(1.0);
        assert!(control.goal.target.distance(seen) < close, "{eye_z}");
        // Zooming goes there from where it is.
        let distance = control.goal.distance;
        control.zoom(0.9);
        assert!((control.goal.distance / distance - 0.9).abs() < 1e-4);
    }
}

#[test]
fn where_nothing_is_seen_the_target_is_as_far_as_the_middle_of_the_scene() {
    let from = Vec3::new(0.0, 0.0, 100.0);
    let camera = Camera::look_at("", from, Vec3::new(30.0, 0.0, 0.0), 0.7);
    let mut control = CameraControl::new(&camera, &bounds());
    control.take_target(None);
    assert!(!control.wants_target());
    let nearest = control.goal.target;
    let axis = (nearest - from).normalize();
    assert!(axis.dot(nearest).abs() < 1e-3, "{nearest}");
    // Who steers already keeps the target.
    let mut control = CameraControl::new(&camera, &bounds());
    control.orbit(Vec2::X);
    let before = control.goal;
    control.take_target(Some(Vec3::ZERO));
    assert_eq!(control.goal, before);
}

#[test]
fn words_are_read_as_the_same_camera_however_small_it_is() {
    let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
    for size in [1e-6, 0.001, 1.0, 4321.0] {
        let bounds = Bounds::of([Vec3::splat(-size), Vec3::splat(size)]);
        let from = size * Vec3::new(1.234_567, 2.1, 4.9);
        let camera = Camera::look_at("", from, size * Vec3::new(0.1, 0.2, 0.3), 0.7);
        let mut control = CameraControl::new(&camera, &bounds);
        for (aperture, focus, blades, shutter) in [
            (0.0, 1.0, 0, 0.0),
            (size * 0.012_345_67, size * 3.3, 7, 0.0),
            (size * 0.5, 1e-5, 0, 1.0 / 48.0),
            (0.0, 1.0, 0, 0.1),
        ] {
            let lens = Lens::new(aperture, focus, blades).unwrap();
            control.set_lens(lens);
            control.set_shutter(shutter);
            let words = control.argument(&scene).unwrap();
            let (read, target) = scene_argument::view(&scene, Some(&words), 1.0).unwrap();
            let again = CameraControl::new(&read, &bounds).around(target.unwrap());
            assert_eq!(again.argument(&scene).unwrap(), words);
            assert_eq!(eye(&read), from, "{words}");
            assert_eq!((read.lens, read.shutter), (lens, shutter), "{words}");
            assert_eq!(again.goal.target, control.goal.target, "{words}");
            assert_eq!(again.goal.opening, 0.7, "{words}");
            assert!(!again.wants_target());
            // A pinhole needs no words.
            assert_eq!(words.contains("aperture"), aperture > 0.0);
            assert_eq!(words.contains("focus"), aperture > 0.0);
            assert_eq!(words.contains("blades"), blades > 0);
            assert_eq!(words.contains("shutter"), shutter > 0.0);
        }
    }
}

#[test]
fn another_lens_keeps_a_camera_of_the_scene_where_it_is() {
    let mut scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
    let mut camera = control().camera();
    // Turned around its axis, as nobody can steer it.
    camera.world_from_view *= Mat4::from_rotation_z(0.3);
    camera.lens = Lens::new(0.02, 4.0, 6).unwrap();
    camera.shutter = 0.01;
    scene.cameras.push(camera.clone());
    for name in ["first", " a; b=1", "c=d", ""] {
        camera.name = name.into();
        scene.cameras.last_mut().unwrap().name = name.into();
        let mut control = CameraControl::new(&camera, &bounds());
        assert_eq!(control.argument(&scene).as_deref(), Some(name));
        for (lens, shutter) in [
            (Lens::new(0.03, 4.0, 6).unwrap(), 0.01),
            (Lens::new(0.02, 4.0, 0).unwrap(), 0.01),
            (Lens::PINHOLE, 0.01),
            (camera.lens, 0.0),
            (Lens::new(0.02, 2.5, 5).unwrap(), 0.02),
        ] {
            control.set_lens(lens);
            control.set_shutter(shutter);
            let expected = Camera {
                lens,
                shutter,
                ..camera.clone()
            };
            // The picture begins anew, once.
            assert!(control.advance(0.0));
            assert!(!control.advance(0.0));
            assert_eq!(control.camera(), expected);
            assert!(control.wants_target());
            let words = control.argument(&scene).unwrap();
            assert!(words.starts_with("from="), "{words}");
            let (read, target) = scene_argument::view(&scene, Some(&words), 1.0).unwrap();
            assert_eq!((read, target), (expected, None), "{words}");
            let again = CameraControl::new(&control.camera(), &bounds());
            assert_eq!(again.argument(&scene).unwrap(), words);
        }
        control.set_lens(camera.lens);
        control.set_shutter(camera.shutter);
        assert_eq!(control.argument(&scene).as_deref(), Some(name));
    }
    // What was steered keeps its lens.
    let mut control = CameraControl::new(&camera, &bounds());
    control.orbit(Vec2::X);
    control.set_shutter(0.02);
    let steered = settle(&mut control);
    assert_eq!((steered.lens, steered.shutter), (camera.lens, 0.02));
    let words = control.argument(&scene).unwrap();
    let end = ";aperture=0.02;focus=4;blades=6;shutter=0.02";
    assert!(words.ends_with(end), "{words}");
}

#[test]
fn a_field_of_view_that_was_put_on_a_camera_of_the_scene_stays_in_words() {
    let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
    let words = format!("from={};fov=20", scene.cameras[0].name);
    let (camera, _) = scene_argument::view(&scene, Some(&words), 1.0).unwrap();
    let control = CameraControl::new(&camera, &scene.bounds());
    assert_eq!(control.argument(&scene), Some(words));
}

#[test]
fn a_lens_opens_with_a_sharp_target_and_opens_again_as_it_was() {
    let mut control = control();
    control.set_aperture(0.1);
    let distance = control.goal.distance;
    assert_eq!(control.lens(), Lens::new(0.1, distance, 0).unwrap());
    // A point beside the axis is as far as the foot of its perpendicular.
    let camera = control.camera();
    let point = camera
        .world_from_view
        .transform_point3(Vec3::new(0.7, 0.2, -2.0));
    control.sharpen(point);
    assert!((control.lens().focus - 2.0).abs() < 1e-5);
    control.set_lens(Lens {
        blades: 5,
        ..control.lens()
    });
    let open = control.lens();
    control.set_aperture(0.0);
    assert_eq!(control.lens(), Lens::PINHOLE);
    control.sharpen(Vec3::ZERO);
    assert_eq!(control.lens(), Lens::PINHOLE);
    control.set_aperture(0.1);
    assert_eq!(control.lens(), open);
    // Behind the camera, and what no lens is.
    let behind = camera.world_from_view.transform_point3(Vec3::Z);
    control.sharpen(behind);
    control.sharpen(Vec3::NAN);
    control.set_aperture(f32::NAN);
    control.set_shutter(-1.0);
    assert_eq!((control.lens(), control.shutter()), (open, 0.0));
}

#[test]
fn looking_around_keeps_the_eye_and_zooming_the_direction() {
    let mut control = control();
    let before = control.goal.eye();
    control.look(Vec2::new(0.4, 0.1));
    assert!(eye(&settle(&mut control)).distance(before) < 1e-3);
    let (target, distance) = (control.goal.target, control.goal.distance);
    control.zoom(0.5);
    settle(&mut control);
    assert_eq!(control.goal.target, target);
    assert!((control.goal.distance - distance / 2.0).abs() < 1e-4);
}

#[test]
fn what_is_dragged_follows_the_pointer() {
    let mut control = control();
    settle(&mut control);
    let point = control.goal.target;
    control.pan(Vec2::new(0.25, 0.0));
    let camera = settle(&mut control);
    let seen = camera.world_from_view.inverse().transform_point3(point);
    // A quarter of the picture's height, at the target's distance.
    let height = 2.0 * -seen.z * (0.35_f32).tan();
    assert!((seen.x / height - 0.25).abs() < 1e-3, "{seen}");
}

#[test]
fn focus_puts_a_point_in_the_middle_from_the_same_place() {
    let mut control = control();
    let from = control.goal.eye();
    let point = Vec3::new(-0.5, 0.2, -0.7);
    control.focus(point);
    let camera = settle(&mut control);
    assert!(eye(&camera).distance(from) < 1e-3);
    let seen = camera.world_from_view.inverse().transform_point3(point);
    assert!(seen.x.abs() < 1e-3 && seen.y.abs() < 1e-3 && seen.z < 0.0);
    assert!(control.goal.target.distance(point) < 1e-3);
    // Nothing to look at, or no point at all.
    let before = control.goal;
    control.focus(from);
    control.focus(Vec3::NAN);
    assert_eq!(control.goal, before);
}

#[test]
fn flying_moves_eye_and_target_alike() {
    let mut control = control();
    let before = control.goal;
    control.fly(Vec3::Z, 1.0);
    let way = control.goal.eye() - before.eye();
    assert!((way.length() - bounds().diagonal() / 4.0).abs() < 1e-4);
    assert!(way.normalize().dot(-before.backward()) > 0.999);
    assert!((control.goal.distance - before.distance).abs() < 1e-6);
}
