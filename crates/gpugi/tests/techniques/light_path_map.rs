//! light-path-map compared with the path tracer, under lights that move; techniques and settings that it refuses.

use std::ops::ControlFlow;
use std::path::Path;

use crate::common::{gpu, renderer_of, traced};
use glam::{Vec3, vec3};
use gpugi::bake::{Bake, PaneBake};
use gpugi::gpu::Gpu;
use gpugi::light_paths::{LightClass, LightPaths, Part, overlap};
use gpugi::measure::Subject;
use gpugi::scene::Edit;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::export::export_panes;
use gpugi_scene::{
    Atlas, AtlasOptions, Camera, FileResolver, Light, LightKind, LightPathPanes, Limits, Material,
    Scene, import,
};

const SIZE: u32 = 40;
const SAMPLES: u32 = 16;

/// Direct light, and direct light with what light-path-map adds: their difference is the indirect light alone.
struct Indirect {
    direct: Renderer,
    both: Renderer,
    camera: Camera,
}

impl Indirect {
    fn new(gpu: &Gpu, scene: &Scene, settings: &[&str]) -> Self {
        let of = |techniques: &[&str], settings: &[&str]| {
            renderer_of(gpu, scene, techniques, SIZE, "light-path-map", settings)
        };
        Self {
            direct: of(&["shadow-map"], &[]),
            both: of(&["shadow-map", "light-path-map"], settings),
            camera: scene.cameras[0].clone(),
        }
    }

    /// Indirect light, three floats per pixel, after the first light has changed.
    fn picture(&mut self, light: &Light, samples: u32) -> Vec<f32> {
        let camera = &self.camera;
        let [without, with] = [&mut self.direct, &mut self.both].map(|renderer| {
            let (index, light) = (0, light.clone());
            renderer
                .edit(&[Edit::Light { index, light }])
                .expect("a light");
            let go_on = |_, _| ControlFlow::Continue(());
            renderer.converge(camera, false, go_on).expect("maps");
            renderer.restart();
            for _ in 0..samples {
                let sample = renderer.render_sample(camera, samples, None, false);
                sample.expect("a sample");
            }
            renderer.radiance().expect("radiance")
        });
        with.iter()
            .zip(without)
            .map(|(with, without)| with - without)
            .collect()
    }
}

/// The Cornell box under a bright point instead of its lamp.
fn cornell() -> Scene {
    let mut scene = builtin("cornell", 1).expect("a scene");
    for material in &mut scene.materials {
        *material = Material {
            emissive: Vec3::ZERO,
            ..material.clone()
        };
    }
    scene
        .lights
        .push(Light::new("", LightKind::Point, Vec3::splat(40.0)));
    scene
}

/// The scene's first light at some places along its way.
fn along(scene: &Scene, places: &[Vec3], target: Vec3) -> Vec<Light> {
    let light = scene.lights[0].clone();
    let moved = |&place| light.clone().aimed(place, target);
    places.iter().map(moved).collect()
}

/// Relative mean squared error of indirect light against the path tracer, without the path tracer's own.
fn error(gpu: &Gpu, scene: &Scene, light: &Light, found: &[f32]) -> f64 {
    let mut scene = scene.clone();
    scene.lights[0] = light.clone();
    let part = Part {
        classes: vec![LightClass::Punctual],
        pattern: "LDD+E".into(),
    };
    let subject = Subject {
        scene: &scene,
        camera: &scene.cameras[0].clone(),
        size: [SIZE; 2],
    };
    let truth = traced(gpu, &subject, part, 256);
    let pairs = found.iter().zip(&truth.radiance);
    let squares = pairs.map(|(&found, &truth)| {
        let (found, truth) = (f64::from(found), f64::from(truth));
        (found - truth).powi(2) / (truth * truth + 0.01)
    });
    squares.sum::<f64>() / found.len() as f64 - truth.rel_mse()
}

/// What a narrow spot lights is smaller than the distance between walks: light samples find how bright it is.
#[test]
fn light_samples_find_narrow_spots() {
    let Some(gpu) = gpu() else { return };
    let mut scene = cornell();
    let cone = LightKind::Spot {
        inner_cone_angle: 0.1,
        outer_cone_angle: 0.12,
    };
    scene.lights[0] = Light::new("", cone, Vec3::splat(400.0));
    let places = [0.0, 0.2, 0.4, 0.6].map(|x| vec3(x, 4.0, -1.0));
    let [few, many] = ["light-samples=1", "light-samples=16"].map(|samples| {
        let settings = ["resolution=32", "entries=256", "steps=64", samples];
        let mut indirect = Indirect::new(&gpu, &scene, &settings);
        let errors = places.map(|place| {
            let light = scene.lights[0].clone().aimed(place, place - Vec3::Y);
            error(&gpu, &scene, &light, &indirect.picture(&light, 4))
        });
        errors.iter().sum::<f64>() / errors.len() as f64
    });
    println!("rel-mse {few:.1e}, with light samples {many:.1e}");
    assert!(many < 0.5 * few, "{many} {few}");
}

/// One set of panes, and a light that moves.
#[test]
fn indirect_light_of_a_moving_light_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let (box_, room) = (cornell(), builtin("room", 1).expect("a scene"));
    let in_box = [
        vec3(0.0, 4.2, -2.8),
        vec3(2.0, 3.5, -1.5),
        vec3(-1.5, 2.0, -1.2),
    ];
    let in_room = [vec3(1.3, 2.8, 1.3), vec3(-1.0, 1.5, 1.2)];
    for (name, scene, places, target) in [
        ("cornell", &box_, &in_box[..], Vec3::ZERO),
        ("room", &room, &in_room[..], vec3(-0.1, 0.2, -0.5)),
    ] {
        let settings = ["resolution=64", "steps=64"];
        let mut indirect = Indirect::new(&gpu, scene, &settings);
        let lights = along(scene, places, target);
        for (panes, bound) in [("0", 0.003), ("32", 0.015)] {
            let set = indirect.both.set("light-path-map", "panes", panes);
            set.expect("a setting");
            let errors: Vec<f64> = lights
                .iter()
                .map(|light| error(&gpu, scene, light, &indirect.picture(light, SAMPLES)))
                .collect();
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            println!("{name}, panes={panes}: rel-mse {mean:.1e} of {errors:?}");
            assert!(mean < bound, "{name}, panes={panes}: {mean}");
            assert!(
                errors.iter().all(|&error| error < 2.0 * bound),
                "{errors:?}"
            );
        }
    }
}

/// A light that moves in steps of 2 cm changes no pixel's indirect light by more than 2 % of the brightest, although
/// other panes become the brightest.
#[test]
fn nothing_pops_while_a_light_moves() {
    let Some(gpu) = gpu() else { return };
    let scene = cornell();
    let settings = [
        "resolution=32",
        "entries=1024",
        "clusters=64",
        "panes=8",
        "steps=64",
    ];
    let mut indirect = Indirect::new(&gpu, &scene, &settings);
    let places: Vec<Vec3> = (0..40)
        .map(|step| vec3(-0.4 + 0.02 * step as f32, 3.5, -1.5))
        .collect();
    let pictures: Vec<Vec<f32>> = along(&scene, &places, Vec3::ZERO)
        .iter()
        .map(|light| indirect.picture(light, 1))
        .collect();
    let largest = |values: &mut dyn Iterator<Item = f32>| values.fold(0.0, f32::max);
    let white = largest(&mut pictures.iter().flatten().copied());
    let steps = pictures.windows(2).map(|two| {
        let pairs = two[0].iter().zip(&two[1]);
        largest(&mut pairs.map(|(before, after)| (after - before).abs())) / white
    });
    let step = largest(&mut steps.collect::<Vec<_>>().into_iter());
    println!("{step} of white");
    assert!(white > 0.1 && step < 0.02, "{white} {step}");
}

/// Settings of panes that are soon made.
const FEW: [(&str, &str); 4] = [
    ("entries", "256"),
    ("clusters", "8"),
    ("depth", "3"),
    ("steps", "8"),
];

fn pane_bake<'a>(gpu: &Gpu, scene: &'a Scene) -> PaneBake<'a> {
    let options = AtlasOptions {
        size: 32,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(scene, &options).expect("an atlas");
    let mut bake = PaneBake::new(gpu, scene, atlas).expect("a bake");
    for (name, value) in FEW {
        bake.set(name, value).expect("a setting");
    }
    bake
}

/// Takes the steps that are left, and returns their number and the result.
fn finished(mut bake: PaneBake) -> (usize, LightPathPanes) {
    let mut steps = 0;
    while bake.step().expect("a step").is_some() {
        steps += 1;
    }
    assert!(bake.is_complete());
    (steps, bake.finish().expect("panes"))
}

/// Panes that a file brings light it as new ones, whatever the settings, and are made anew when the scene is another.
#[test]
fn stored_panes_light_as_new_ones() {
    let Some(gpu) = gpu() else { return };
    let scene = cornell();
    let (steps, panes) = finished(pane_bake(&gpu, &scene));
    assert!(steps > 1);
    let mut stopped = pane_bake(&gpu, &scene);
    stopped.step().expect("a step");
    let mut resumed = pane_bake(&gpu, &scene);
    resumed.resume(stopped.save().expect("a state"));
    assert!(stopped.finish().is_err());
    let (_, again) = finished(resumed);
    assert!(again == panes);
    assert!(pane_bake(&gpu, &scene).set("left-out", "0.1").is_err());

    let glb = export_panes(None, &scene, &panes).expect("a file").glb;
    let nothing = FileResolver::new(Path::new(""), Limits::default());
    let mut read = import("panes.glb", &glb, &nothing, &Limits::default()).expect("a scene");
    assert!(read.panes.is_some());
    read.cameras = scene.cameras.clone();
    let light = scene.lights[0].clone();
    let lit = |scene: &Scene, settings: &[&str]| {
        let mut indirect = Indirect::new(&gpu, scene, settings);
        let picture = indirect.picture(&light, 4);
        (picture, indirect.both.warnings())
    };
    let new: Vec<String> = FEW
        .iter()
        .map(|(name, value)| format!("{name}={value}"))
        .collect();
    let new: Vec<&str> = new.iter().map(String::as_str).collect();
    let (expected, _) = lit(&scene, &[&new[..], &["resolution=32"]].concat());
    // Settings that give another picture.
    let others = ["entries=16", "clusters=2", "resolution=16"];
    let (stored, warnings) = lit(&read, &others);
    assert!(warnings.is_empty(), "{warnings:?}");
    let (other, _) = lit(&read, &[&others[..], &["stored=false"]].concat());
    let apart = |picture: &[f32]| {
        let squares = picture.iter().zip(&expected).map(|(a, b)| (a - b).powi(2));
        let scale: f32 = expected.iter().map(|value| value * value).sum();
        squares.sum::<f32>() / scale
    };
    println!("stored {:.1e}, other {:.1e}", apart(&stored), apart(&other));
    assert!(apart(&stored) < 1e-6 && apart(&other) > 1e-3);

    read.materials[0].base_color *= 0.5;
    let (_, warnings) = lit(&read, &others);
    let is_said = warnings
        .iter()
        .any(|warning| warning.contains("other materials"));
    assert!(is_said, "{warnings:?}");
}

#[test]
fn light_is_not_added_twice() {
    let Some(gpu) = gpu() else { return };
    let scene = cornell();
    let made = |others: &[&str]| {
        let names = [others, &["light-path-map"]].concat();
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        Renderer::new(&gpu, &scene, [8, 8], &names)
    };
    match made(&["shadow-map", "radiosity"]).map(|_| ()) {
        Err(LightingError::Overlap { path, .. }) => assert_eq!(path, "LDDE"),
        other => panic!("{other:?}"),
    }
    // It reflects what others add, and nothing else.
    assert!(
        made(&[])
            .expect("a renderer")
            .light_paths_of("light-path-map")
            .is_empty()
    );
    let mut renderer = made(&["shadow-map"]).expect("a renderer");
    let adds = |renderer: &Renderer, class, path| {
        let one = LightPaths::new(class, path);
        overlap(renderer.light_paths_of("light-path-map"), &[one]).is_some()
    };
    assert!(adds(&renderer, LightClass::Punctual, "LDDDDE"));
    assert!(!adds(&renderer, LightClass::Punctual, "LDE"));
    assert!(!adds(&renderer, LightClass::Environment, "LDDE"));
    renderer
        .set("light-path-map", "depth", "1")
        .expect("a setting");
    assert!(adds(&renderer, LightClass::Punctual, "LDDDDE"));
    assert!(!adds(&renderer, LightClass::Punctual, "LDDDDDE"));
    let glass = builtin("glass-room", 1).expect("a built-in scene");
    let names = ["shadow-map", "caustics", "light-path-map"].map(str::to_owned);
    let renderer = Renderer::new(&gpu, &glass, [8, 8], &names).expect("a renderer");
    let any_class = |path| {
        LightClass::ALL
            .iter()
            .any(|&class| adds(&renderer, class, path))
    };
    assert!(any_class("LSDDE") && !any_class("LSDE"));
}

#[test]
fn what_does_not_fit_is_refused() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = renderer_of(
        &gpu,
        &cornell(),
        &["shadow-map", "light-path-map"],
        8,
        "light-path-map",
        &[],
    );
    for (name, value) in [
        ("entries", "0"),
        ("clusters", "0"),
        ("clusters", "2000"),
        ("walks", "0"),
        ("depth", "33"),
    ] {
        let refused = renderer.set("light-path-map", name, value);
        assert!(
            matches!(refused, Err(LightingError::Setting { .. })),
            "{name}"
        );
    }
    let set = renderer.set("light-path-map", "resolution", "8192");
    set.expect("a setting");
    let camera = Camera::look_at("", vec3(0.0, 2.7, 8.0), Vec3::Y, 0.7);
    let refused = renderer.render_sample(&camera, 1, None, false).map(|_| ());
    let message = refused.expect_err("an atlas of 16 GiB").to_string();
    assert!(message.contains("lower the resolution"), "{message}");
}
