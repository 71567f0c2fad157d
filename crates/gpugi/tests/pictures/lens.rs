//! What is out of focus, and what moves while the shutter is open, against closed forms: of the path tracer, and of still
//! pictures by techniques.

use std::ops::ControlFlow;

use glam::{DMat4, Mat4, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Settings};
use gpugi::{Motion, Renderer, Techniques};
use gpugi_scene::animation::{Animation, Channel, Interpolation, Node, Property, Rig, Transform};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Lens, Light, LightKind, Material, Projection, Scene};

use crate::common::{gpu, place};

const SIDE: u32 = 32;
const STEPS: u32 = 8;

/// Red radiance of each pixel, by the path tracer.
fn traced(gpu: &Gpu, scene: &Scene, camera: &Camera, samples: u32) -> Vec<f64> {
    let settings = Settings {
        max_bounces: 0,
        ..Settings::default()
    };
    let mut tracer = PathTracer::new(gpu, scene, [SIDE; 2], &settings).expect("a path tracer");
    let motion = Motion::seen_by(camera, scene, 0.0);
    tracer.set_motion(motion).expect("a motion");
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    tracer.render(camera, samples, go_on).expect("a picture");
    red(&tracer.radiance().expect("radiance"))
}

/// The same by a renderer without techniques, which shows what shines.
fn rendered(gpu: &Gpu, scene: &Scene, camera: &Camera, samples: u32) -> Vec<f64> {
    let none = Techniques::Named(Vec::new());
    let mut renderer = Renderer::new(gpu, scene, [SIDE; 2], none).expect("a renderer");
    let motion = Motion::seen_by(camera, scene, 0.0);
    renderer.set_motion(motion, STEPS).expect("a motion");
    for _ in 0..samples {
        let sample = renderer.render_sample(camera, samples, None, false);
        sample.expect("a sample");
    }
    red(&renderer.radiance().expect("radiance"))
}

fn red(radiance: &[f32]) -> Vec<f64> {
    radiance
        .chunks_exact(3)
        .map(|rgb| f64::from(rgb[0]))
        .collect()
}

/// A square that shines with radiance 1, around a point of the axis of a camera in the origin that looks along -Z.
fn shining(side: f32, distance: f32) -> Scene {
    let mut scene = Scene::new("square");
    let corner = vec3(-side / 2.0, -side / 2.0, -distance);
    let mesh = quad(corner, Vec3::X * side, Vec3::Y * side, 1);
    place(&mut scene, mesh, Material::emitter("shining", Vec3::ONE));
    scene
}

/// The image of a small square is the aperture, as large as a |1 - f / z| on the plane of focus, convolved with the square.
#[test]
fn a_small_light_out_of_focus_is_an_image_of_the_aperture() {
    let Some(gpu) = gpu() else { return };
    for (blades, distance) in [(0, 4.0), (6, 4.0), (5, 4.0 / 3.0)] {
        let (focus, aperture) = (2.0, 0.5);
        let side = 0.08 * distance;
        let mut camera = Camera::look_at("", Vec3::ZERO, Vec3::NEG_Z, 2.0 * 0.25_f32.atan());
        camera.lens = Lens::new(aperture, focus, blades).expect("a lens");
        // Both on the plane of focus, in pixels.
        let pixels = SIDE as f32 / (2.0 * focus * 0.25);
        let radius = aperture * (1.0 - focus / distance).abs() * pixels;
        let square = side * focus / distance * pixels;
        let of_image = Lens::new(radius, 1.0, blades).expect("a lens");
        let area = f64::from(of_image.area());
        let light = f64::from(square * square);
        // Mean squares of the distances to the middle add up.
        let spread = |side: f32| f64::from(side * side) / 6.0;
        let of_aperture = match blades {
            0 => f64::from(radius * radius) / 2.0,
            _ => {
                let corners = std::f64::consts::TAU / f64::from(blades);
                f64::from(radius * radius) * (2.0 + corners.cos()) / 6.0
            }
        };
        let moment = of_aperture + spread(square) + spread(1.0);
        let scene = shining(side, distance);
        let mut pictures = vec![("path tracer", traced(&gpu, &scene, &camera, 1024))];
        if blades == 6 {
            pictures.push(("renderer", rendered(&gpu, &scene, &camera, 1024)));
        }
        for (name, picture) in pictures {
            let sum: f64 = picture.iter().sum();
            let square_from_middle = |index: usize| {
                let at = |index: usize| index as f64 + 0.5 - f64::from(SIDE) / 2.0;
                at(index % SIDE as usize).powi(2) + at(index / SIDE as usize).powi(2)
            };
            let squares = picture.iter().enumerate();
            let squares: f64 = squares
                .map(|(index, value)| value * square_from_middle(index))
                .sum();
            let mut wrong = vec![("light", sum, light), ("spread", squares / sum, moment)];
            // All pixels of the other see through the same points of the lens: the middle would need four times as many.
            if name == "path tracer" {
                let middle = (SIDE / 2) as usize;
                let row = |row: usize| &picture[row * SIDE as usize..][middle - 2..middle + 2];
                let inside: f64 = (middle - 2..middle + 2).flat_map(row).sum();
                wrong.push(("middle", inside / 16.0, light / area));
            }
            wrong.retain(|(_, value, expected)| (value / expected - 1.0).abs() > 0.01);
            assert!(wrong.is_empty(), "{name}, {blades} blades: {wrong:?}");
        }
    }
}

/// What lies in the plane of focus is where a pinhole sees it.
#[test]
fn what_is_in_focus_is_sharp() {
    let Some(gpu) = gpu() else { return };
    let mut camera = Camera::look_at("", Vec3::ZERO, Vec3::NEG_Z, 2.0 * 0.25_f32.atan());
    camera.lens = Lens::new(0.5, 2.0, 0).expect("a lens");
    for projection in [camera.projection, Projection::Orthographic { height: 1.0 }] {
        camera.projection = projection;
        let scene = shining(0.5, 2.0);
        for picture in [
            traced(&gpu, &scene, &camera, 16),
            rendered(&gpu, &scene, &camera, 16),
        ] {
            let quarter = SIDE as usize / 4;
            for (index, value) in picture.iter().enumerate() {
                let [x, y] = [index % SIDE as usize, index / SIDE as usize];
                let is_inside = |at: usize| (quarter..3 * quarter).contains(&at);
                let expected = f64::from(u8::from(is_inside(x) && is_inside(y)));
                assert_eq!(*value, expected, "pixel {x}, {y}");
            }
        }
    }
}

/// A scene whose first instance flies from `from` to `to` within a second.
fn flying(mut scene: Scene, from: Vec3, to: Vec3) -> Scene {
    scene.instances[0].node = Some(0);
    scene.instances[0].world_from_mesh = Mat4::from_translation(from);
    scene.rig = Some(Rig {
        nodes: vec![Node {
            parent: None,
            rest: Transform::Matrix(DMat4::IDENTITY),
            weights: Vec::new(),
        }],
        order: vec![0],
        animations: vec![Animation {
            name: "flight".to_owned(),
            duration: 1.0,
            channels: vec![Channel {
                node: 0,
                property: Property::Translation,
                interpolation: Interpolation::Linear,
                times: vec![0.0, 1.0],
                values: [from.to_array(), to.to_array()].concat(),
            }],
        }],
        ..Rig::default()
    });
    scene
}

/// A ball of radius r that crosses the picture in one shutter at the speed v covers what lies y beside its way for
/// 2 sqrt(r^2 - y^2) / v.
#[test]
fn a_ball_that_crosses_the_picture_covers_it_for_its_chords() {
    let Some(gpu) = gpu() else { return };
    let (radius, reach) = (0.75, 3.0);
    let mut scene = Scene::new("ball");
    place(
        &mut scene,
        sphere(radius, 48),
        Material::emitter("ball", Vec3::ONE),
    );
    let scene = flying(scene, Vec3::X * -reach, Vec3::X * reach);
    let camera = Camera {
        projection: Projection::Orthographic { height: 4.0 },
        shutter: 0.999_999,
        ..Camera::look_at("", Vec3::Z * 3.0, Vec3::ZERO, 1.0)
    };
    let pixel = 4.0 / f64::from(SIDE);
    // Mean over the pixel's height of the time for which it is covered.
    let covered = |row: u32| {
        let steps = 64;
        let chord = |step: u32| {
            let y = (f64::from(row) + (f64::from(step) + 0.5) / f64::from(steps)) * pixel - 2.0;
            let half = f64::from(radius).powi(2) - y * y;
            2.0 * half.max(0.0).sqrt() / (2.0 * f64::from(reach))
        };
        (0..steps).map(chord).sum::<f64>() / f64::from(steps)
    };
    let most = covered(SIDE / 2);
    for (name, picture) in [
        ("path tracer", traced(&gpu, &scene, &camera, 256)),
        ("renderer", rendered(&gpu, &scene, &camera, 256)),
    ] {
        for row in 0..SIDE {
            let pixels = &picture[(row * SIDE) as usize..][..SIDE as usize];
            let mean = pixels.iter().sum::<f64>() / f64::from(SIDE);
            let expected = covered(row);
            assert!(
                (mean - expected).abs() < 0.01 * most,
                "{name}, row {row}: {mean}, not {expected}"
            );
        }
    }
}

/// A square flies over a floor at a third of the shutter's time, then it rests: so does its shadow. The last of the three samples
/// of a step shows it at rest, but not the step's maps, which show the middle. Before and after, the scene is as it was.
#[test]
fn shadows_follow_what_comes_to_rest() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("shadow");
    let square = quad(vec3(-0.5, 1.0, 0.5), Vec3::X, Vec3::NEG_Z, 1);
    let square = place(
        &mut scene,
        square,
        Material::matt("square", Vec3::splat(0.5)),
    );
    let floor = quad(vec3(-4.0, 0.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 1);
    place(&mut scene, floor, Material::matt("floor", Vec3::splat(0.5)));
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(3.0));
    // The shadow lies 2 m beside what casts it, where the camera sees it.
    scene
        .lights
        .push(sun.aimed(vec3(-2.0, 1.0, 0.0), Vec3::ZERO));
    let mut scene = flying(scene, Vec3::X * -3.0, Vec3::X * -1.0);
    let flight = &mut scene.rig.as_mut().expect("a rig").animations[0].channels[0];
    flight.times = vec![0.0, 0.315, 0.33, 1.0];
    flight.values = [&flight.values[..3]; 2]
        .concat()
        .into_iter()
        .chain(flight.values[3..].repeat(2))
        .collect();
    assert_eq!(square, 0);
    let camera = Camera {
        projection: Projection::Orthographic { height: 4.0 },
        shutter: 0.999_999,
        ..Camera::look_at("", vec3(0.0, 5.0, 0.0), Vec3::ZERO, 1.0)
    };
    let techniques = Techniques::Named(vec!["shadow-map".to_owned()]);
    let mut renderer = Renderer::new(&gpu, &scene, [SIDE; 2], techniques).expect("a renderer");
    let picture = |renderer: &mut Renderer, camera: &Camera, samples: u32| {
        renderer.restart();
        for _ in 0..samples {
            let sample = renderer.render_sample(camera, samples, None, false);
            sample.expect("a sample");
        }
        red(&renderer.radiance().expect("radiance"))
    };
    let moment = Camera {
        shutter: 0.0,
        ..camera.clone()
    };
    let before = picture(&mut renderer, &moment, 1);
    let motion = Motion::seen_by(&camera, &scene, 0.0);
    renderer.set_motion(motion, STEPS).expect("a motion");
    let blurred = picture(&mut renderer, &camera, 24);
    // Of the eight steps, five show the square at rest, and its shadow around x = 1.
    let at = |picture: &[f64], x: f32| {
        let across = camera.world_from_view.x_axis.x * x;
        let column = ((across + 2.0) / 4.0 * SIDE as f32) as usize;
        picture[SIDE as usize * SIDE as usize / 2 + column]
    };
    let lit = at(&before, 1.0);
    let part = at(&blurred, 1.0) / lit;
    assert!(lit > 0.1 && (part - 0.375).abs() < 0.05, "{part} of {lit}");
    // A single moment, and a camera without a shutter, see the scene as it was.
    assert_eq!(picture(&mut renderer, &camera, 1), before);
    assert_eq!(picture(&mut renderer, &moment, 1), before);
}
