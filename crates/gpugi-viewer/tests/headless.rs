//! The viewer's loop without a window: its pictures are those of the library, whatever happened before.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

use gpugi::gpu::{AdapterChoice, Gpu, Shader, all_shaders};
use gpugi::picture::{Compared, developed};
use gpugi::reference::{PathTracer, Progress, Settings};
use gpugi::scene::Edit;
use gpugi::{Readiness, Renderer};
use gpugi_arguments::files::Files;
use gpugi_arguments::scene_argument::{self, SceneArguments};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::{decode_color, save_exr};
use gpugi_scene::{Camera, Limits, Pixels, Scene};
use gpugi_viewer::arguments::of_view_file;
use gpugi_viewer::command::{address, command, view_file};
use gpugi_viewer::headless::{self, Frames};
use gpugi_viewer::pace::Purpose;
use gpugi_viewer::recording::{Recording, STEP_SECONDS};
use gpugi_viewer::script::Script;
use gpugi_viewer::session::{Pick, Session};
use gpugi_viewer::technique_set::TechniqueSet;
use gpugi_viewer::viewer::{Look, Start, Viewer};

const SIZE: [u32; 2] = [48, 32];
const SHORT: Frames = Frames {
    count: 6,
    size: SIZE,
    samples: None,
    are_timed: false,
};
const SAMPLES: u32 = 4;

/// The best adapter. `None` only if GPUGI_SKIP_GPU=1 allows it.
fn open() -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::Best) {
        Ok(gpu) => Some(gpu),
        Err(_) if std::env::var_os("GPUGI_SKIP_GPU").is_some_and(|value| value == "1") => None,
        Err(error) => panic!("{error}"),
    }
}

fn start(scene: &str, techniques: &[&str]) -> Start {
    let names = techniques.iter().map(|&name| name.to_owned()).collect();
    Start {
        scene: SceneArguments::of(scene),
        set: TechniqueSet {
            names: Some(names),
            ..TechniqueSet::default()
        },
        look: Look::default(),
    }
}

/// What the viewer shows after a script.
fn shown(gpu: &Gpu, start: Start, script: &str) -> (Viewer, Vec<f32>) {
    let script = Script::parse(script).unwrap();
    let frames = Frames {
        samples: Some(SAMPLES),
        are_timed: true,
        ..SHORT
    };
    let (mut viewer, times) = headless::run(gpu, start, frames, &script, None).unwrap();
    assert_eq!((times.frames_ms.len(), times.work.len()), (6, 6));
    assert!(times.slowest_ms >= times.median_ms);
    let session = viewer.session().unwrap();
    let radiance = session.loaded().renderer.radiance().unwrap();
    (viewer, radiance)
}

/// What `gpugi render` shows.
fn rendered(gpu: &Gpu, scene: &Scene, techniques: &[&str]) -> Vec<f32> {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, SIZE, &names).unwrap();
    let camera = &scene.cameras[0];
    let go_on = |_, _| ControlFlow::Continue(());
    renderer.converge(camera, false, go_on).unwrap();
    for _ in 0..SAMPLES {
        renderer
            .render_sample(camera, SAMPLES, None, false)
            .unwrap();
    }
    renderer.radiance().unwrap()
}

/// Mean of (a - b)^2 / (b^2 + 0.01).
fn rel_mse(a: &[f32], b: &[f32]) -> f32 {
    let squares = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2) / (b * b + 0.01));
    squares.sum::<f32>() / b.len() as f32
}

fn assert_same(shown: &[f32], expected: &[f32]) {
    let error = rel_mse(shown, expected);
    assert!(error < 1e-4, "rel-mse {error}");
}

#[test]
fn a_picture_at_rest_is_that_of_render() {
    let Some(gpu) = open() else { return };
    let scene = builtin("room", 1).unwrap();
    let script = "0 orbit 20 10\n2 zoom 0.7\n4 reset";
    let (_, picture) = shown(&gpu, start("room", &["shadow-map"]), script);
    assert_same(&picture, &rendered(&gpu, &scene, &["shadow-map"]));
}

#[test]
fn edits_and_other_techniques_show_what_they_would_from_the_start() {
    let Some(gpu) = open() else { return };
    let mut scene = builtin("room", 1).unwrap();
    scene.lights[0].world_from_light.w_axis.x += 0.4;
    let place = scene.lights[0].position();
    let script = format!(
        "5 technique shadow-map\n5 edit light.0.position={},{},{}",
        place.x, place.y, place.z
    );
    let (mut viewer, picture) = shown(&gpu, start("room", &[]), &script);
    assert_eq!(viewer.session().unwrap().technique_names(), ["shadow-map"]);
    let expected = rendered(&gpu, &scene, &["shadow-map"]);
    assert_same(&picture, &expected);
    // The edit came while the techniques were on their way. Without it, it is another picture.
    let unmoved = rendered(&gpu, &builtin("room", 1).unwrap(), &["shadow-map"]);
    assert!(rel_mse(&unmoved, &expected) > 1e-3);
}

#[test]
fn what_cannot_be_opened_leaves_what_was_there() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    let broken = std::env::temp_dir().join(format!("gpugi-viewer-{}.glb", std::process::id()));
    std::fs::write(&broken, b"glTF is not what this is").unwrap();
    for file in [&broken, Path::new("there-is-no-such.glb")] {
        viewer.open_file(file, Files::default()).unwrap();
        let reason = viewer.finish_opening().unwrap_err();
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        assert!(reason.contains(&name), "{reason}");
    }
    std::fs::remove_file(&broken).unwrap();
    let mut files = Files::default();
    files.insert("no.json".into(), b"{\"samples\": 0}".to_vec());
    let reason = viewer.open_file(Path::new("no.json"), files).unwrap_err();
    assert!(
        reason.starts_with("no.json: ") && reason.contains("samples"),
        "{reason}"
    );
    // Both add the light of the environment.
    let overlapping = ["image-based-lighting", "radiance-transfer"].map(str::to_owned);
    viewer.change_set(TechniqueSet {
        names: Some(overlapping.to_vec()),
        ..TechniqueSet::default()
    });
    let reason = viewer.finish_opening().unwrap_err();
    assert!(
        reason.contains("image-based-lighting and radiance-transfer both add"),
        "{reason}"
    );
    let session = viewer.session().unwrap();
    assert_eq!(session.loaded().arguments, ["room"]);
    assert_eq!(session.technique_names(), ["shadow-map"]);
    assert!(
        !session.frame(SIZE, 0.0).unwrap().is_new,
        "the picture is still complete"
    );
    assert!(session.set("shadow-map", "taps", "many").is_err());
}

#[test]
fn an_environment_that_is_dropped_lights_the_edited_scene() {
    let Some(gpu) = open() else { return };
    let script = "3 edit light.0.position=0.1,1.5,0.2";
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), script);
    let sky = std::env::temp_dir().join(format!("gpugi-viewer-{}.exr", std::process::id()));
    save_exr(&sky, 4, 2, &[0.5; 4 * 2 * 3]).unwrap();
    viewer.open_file(&sky, Files::default()).unwrap();
    viewer.finish_opening().unwrap();
    std::fs::remove_file(&sky).unwrap();
    let session = viewer.session().unwrap();
    let scene = session.loaded().scene();
    assert_eq!(scene.environment.as_ref().unwrap().image.width, 4);
    assert_eq!(scene.lights[0].position().to_array(), [0.1, 1.5, 0.2]);
    let command = command(session, SIZE);
    assert!(command.contains("--environment"), "{command}");
    assert!(session.frame(SIZE, 0.0).is_ok());
}

#[test]
fn a_saved_view_opens_with_its_edits() {
    let Some(gpu) = open() else { return };
    let script = "0 set shadow-map.taps=4\n1 orbit 20 10\n2 edit light.0.position=0.1,1.5,0.2\n\
        3 edit object.0.position=0.3,0,0.1\n3 edit light.0.position=0.2,1.4,0.1";
    let (mut viewer, picture) = shown(&gpu, start("room", &["shadow-map"]), script);
    let session = viewer.session().unwrap();
    // The tone map of this picture has no use for it.
    session.effects.tone_map.white_point = 3.0;
    let saved = view_file(session);
    assert_eq!(saved.matches("light.0.position").count(), 1, "{saved}");
    assert!(saved.contains("shadow-map.taps=4"), "{saved}");
    let opened = of_view_file(saved.as_bytes()).unwrap();
    assert_eq!(opened.look.effects, session.effects);
    let (mut viewer, again) = shown(&gpu, opened.clone(), "");
    assert_same(&again, &picture);
    // To the last digit, with what the camera orbits around.
    assert_eq!(view_file(viewer.session().unwrap()), saved);
    let edits = viewer.session().unwrap().edits();
    assert_eq!(
        edits,
        [
            "object.0.position=0.3,0,0.1",
            "light.0.position=0.2,1.4,0.1"
        ]
    );
    let (_, unedited) = shown(
        &gpu,
        Start {
            scene: SceneArguments::of("room"),
            ..opened
        },
        "",
    );
    assert!(rel_mse(&unedited, &picture) > 1e-3);
}

#[test]
fn a_lost_device_is_made_anew_once() {
    let Some(gpu) = open() else { return };
    let start = start("room", &["shadow-map"]);
    let steps = "0 set shadow-map.taps=4\n1 orbit 20 10\n2 edit light.0.position=0.1,1.5,0.2";
    let (mut viewer, picture) = shown(&gpu, start.clone(), steps);
    // The edit finds the device lost.
    let script = steps.replace("2 edit", "2 lose-device\n2 edit");
    let (mut renewed, again) = shown(&gpu, start.clone(), &script);
    assert!(gpu.check_lost().is_err() && renewed.gpu().check_lost().is_ok());
    assert_same(&again, &picture);
    assert_eq!(
        view_file(renewed.session().unwrap()),
        view_file(viewer.session().unwrap())
    );
    let script = Script::parse("1 lose-device\n3 lose-device").unwrap();
    let gpu = open().unwrap();
    let twice = headless::run(&gpu, start, SHORT, &script, None);
    let reason = twice.err().unwrap();
    assert!(reason.contains("the GPU was lost"), "{reason}");
}

#[test]
fn a_recording_has_complete_frames_at_fixed_times() {
    let Some(gpu) = open() else { return };
    // The loss of the device costs no time of the animation.
    let script = "0 play\n1 edit light.0.position=0.1,1.5,0.2\n2 lose-device";
    let script = Script::parse(script).unwrap();
    let mut taken = Vec::new();
    let mut recorder = |frame: u32, session: &Session| {
        let renderer = &session.loaded().renderer;
        taken.push((frame, session.clock.seconds, renderer.samples()));
        if frame == 1 {
            let mut scene = builtin("glass-room", 1).unwrap();
            scene.pose(session.clock.seconds);
            scene.lights.clone_from(&session.loaded().scene().lights);
            let expected = rendered(&gpu, &scene, &["shadow-map"]);
            assert_same(&renderer.radiance().unwrap(), &expected);
        }
        Ok(())
    };
    let start = start("glass-room", &["shadow-map"]);
    let frames = Frames {
        count: 3,
        samples: Some(SAMPLES),
        ..SHORT
    };
    headless::run(&gpu, start, frames, &script, Some(&mut recorder)).unwrap();
    let step = 1.0 / 60.0;
    let expected = [
        (0, step, SAMPLES),
        (1, 2.0 * step, SAMPLES),
        (2, 3.0 * step, SAMPLES),
    ];
    for (taken, expected) in taken.iter().zip(expected) {
        assert_eq!((taken.0, taken.2), (expected.0, expected.2));
        assert!((taken.1 - expected.1).abs() < 1e-6, "{taken:?}");
    }
    assert_eq!(taken.len(), 3);
}

#[test]
fn a_window_records_complete_frames_at_fixed_times() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("glass-room", &["shadow-map"]), "");
    let session = viewer.session().unwrap();
    let folder = std::env::temp_dir().join(format!("gpugi-viewer-{}", std::process::id()));
    (session.clock.is_playing, session.pace.is_adaptive) = (true, true);
    let mut recording = Recording::begin(session, &folder).unwrap();
    let mut times = Vec::new();
    let mut waited = 0;
    while recording.frames() < 3 {
        waited += 1;
        assert!(waited < 20_000, "{} frames", recording.frames());
        times.push(session.clock.seconds);
        recording.frame(session, SIZE).unwrap();
        gpu.wait().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(recording.end(session).contains("3 frames"));
    assert!(!session.is_held && session.pace.is_adaptive);
    times.dedup();
    let step = 1.0 / 60.0;
    for (frame, seconds) in times.iter().take(3).enumerate() {
        assert!((seconds - frame as f32 * step).abs() < 1e-6, "{times:?}");
        let mut scene = builtin("glass-room", 1).unwrap();
        scene.pose(*seconds);
        let expected = rendered(&gpu, &scene, &["shadow-map"]);
        let expected = developed(&gpu, SIZE, &expected, &session.effects).unwrap();
        let file = folder.join(format!("gpugi-frames-1/{frame:04}.png"));
        let bytes = std::fs::read(&file).unwrap();
        let found = decode_color("frame", &bytes, &Limits::default()).unwrap();
        assert_eq!([found.width, found.height], SIZE);
        let Pixels::Rgba8(found) = found.pixels else {
            panic!("8 bits per channel");
        };
        let pairs = found.iter().zip(&expected);
        let most = pairs.map(|(a, b)| a.abs_diff(*b)).max();
        assert!(most <= Some(2), "{most:?}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Frames of a recording are 1/60 s apart, however long each takes and however many samples it has. In between, a window
/// at rest goes on until the exposure has adapted.
#[test]
fn exposure_adapts_by_the_time_of_a_recording() {
    let Some(gpu) = open() else { return };
    let mut viewer = Viewer::new(&gpu, start("room", &["shadow-map"]), || {});
    viewer.finish_opening().unwrap();
    let session = viewer.session().unwrap();
    session.samples = 2;
    session.pace.is_adaptive = false;
    session.effects.exposure.adaptation = 1.0;
    let exposure = |session: &Session| session.loaded().renderer.exposure_value().unwrap();
    frames_until(session, |session| session.is_complete());
    let before = exposure(session);
    let mut light = session.loaded().scene().lights[0].clone();
    light.intensity *= 8.0;
    session.is_held = false;
    session.edit(&Edit::Light { index: 0, light }).unwrap();
    let mut adapted = Vec::new();
    for _ in 0..8 {
        session.frame(SIZE, STEP_SECONDS).unwrap();
        session.is_held = true;
        frames_until(session, |session| session.is_complete());
        session.is_held = false;
        adapted.push(exposure(session));
    }
    frames_until(session, |session| session.is_complete());
    // Fifty times the time that the eye takes.
    for _ in 0..(5.0 / STEP_SECONDS) as u32 {
        session.frame(SIZE, STEP_SECONDS).unwrap();
    }
    let after = exposure(session);
    assert!(before - after > 1.0, "{before} to {after}");
    println!("{before} {after} {adapted:?}");
    for (step, found) in adapted.into_iter().enumerate() {
        let left = (-(step as f32 + 1.0) * STEP_SECONDS / 0.1).exp();
        let expected = after + (before - after) * left;
        assert!(
            (found - expected).abs() < 0.05,
            "{step}: {found}, not {expected}"
        );
    }
}

#[test]
fn an_opening_that_is_cancelled_changes_nothing() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    viewer.open(SceneArguments::of("cornell"), &TechniqueSet::default());
    viewer.cancel();
    assert!(viewer.opening().is_none());
    viewer.finish_opening().unwrap();
    assert_eq!(viewer.session().unwrap().loaded().arguments, ["room"]);
}

/// What is opened is shown when there is light to see: shaders are compiled, atlases laid out, maps begun. Until then, the
/// picture before follows the camera.
#[test]
fn the_picture_goes_on_until_there_is_light_in_the_next() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    let names = ["shadow-map", "radiosity", "distance-impostor"];
    let mut set = TechniqueSet {
        names: Some(names.map(str::to_owned).into()),
        ..TechniqueSet::default()
    };
    set.set("radiosity", "resolution", "64");
    viewer.change_set(set);
    let mut pictures = BTreeMap::new();
    while !viewer.take_opened().unwrap() {
        let stage = viewer.opening().map(|opening| opening.stage.get());
        let session = viewer.session().unwrap();
        session.camera.orbit(glam::Vec2::new(0.01, 0.0));
        let shown = session.frame(SIZE, 0.02).unwrap();
        assert!(shown.is_new, "it stood still: {stage:?}");
        *pictures.entry(stage).or_insert(0) += 1;
        session.gpu().wait().unwrap();
    }
    println!("{pictures:?}");
    assert!(pictures.contains_key(&Some("compiling shaders")));
    let session = viewer.session().unwrap();
    assert_eq!(session.technique_names(), names);
    assert!(session.frame(SIZE, 0.02).unwrap().is_new);
    frames_until(session, |session| session.is_complete());
}

/// A picture that gets all its samples while it still has few pixels is not the last.
#[test]
fn a_picture_gets_all_its_pixels_at_rest() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    let session = viewer.session().unwrap();
    session.samples = 1;
    session.pace.is_adaptive = true;
    // Two slow frames light fewer pixels, two more have fewer; and one may have been slow in earnest before.
    for _ in 0..5 {
        session.pace.measure(10.0, 0, 1 << 20, Purpose::Moving);
    }
    session.camera.orbit(glam::Vec2::new(0.1, 0.0));
    let mut sizes = Vec::new();
    loop {
        // Times that say nothing about pixels.
        let shown = session.frame_after(SIZE, 0.01, 1.0 / 60.0).unwrap();
        session.gpu().wait().unwrap();
        let size = session.loaded().renderer.size();
        assert!(size == SIZE || !session.is_complete(), "{size:?}");
        sizes.push(size);
        assert!(sizes.len() < 1000);
        if shown.is_final {
            break;
        }
    }
    assert!(sizes[0][0] < SIZE[0] / 4, "{sizes:?}");
    assert_eq!(sizes.last(), Some(&SIZE));
}

/// Where pixels take long, a picture at rest has few first, then strips with all of them, then samples. Input never waits
/// for more than a strip. It takes two seconds, because it opens a scene.
#[test]
fn a_slow_picture_gets_its_pixels_strip_by_strip() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    let session = viewer.session().unwrap();
    session.samples = 2;
    session.pace.is_adaptive = true;
    session.camera.orbit(glam::Vec2::new(0.1, 0.0));
    let window = [128, 96];
    // A third of the pixels takes the time that input may wait.
    let slow = |points: u32| 0.2 * points as f32 / 4096.0;
    let mut frames: Vec<([u32; 2], Option<f32>, u32)> = Vec::new();
    loop {
        let took = slow(session.loaded().renderer.lit_points());
        session.frame_after(window, 0.05, took).unwrap();
        session.gpu().wait().unwrap();
        let renderer = &session.loaded().renderer;
        if session.lit_share().is_some() {
            assert!(renderer.lit_points() <= 4096);
            assert_eq!(session.picture().unwrap().size, window);
        }
        frames.push((renderer.size(), session.lit_share(), renderer.samples()));
        assert!(frames.len() < 1000, "{frames:?}");
        if session.is_complete() {
            break;
        }
    }
    frames.dedup();
    // Before the first times are known, it has all of them.
    let few = frames.iter().rposition(|(size, ..)| *size != window);
    let first = few.unwrap() + 1;
    let [width, height] = frames[first - 1].0;
    assert!((3500..=4096).contains(&(width * height)), "{frames:?}");
    let parts: Vec<f32> = frames[first..].iter().filter_map(|frame| frame.1).collect();
    assert_eq!(parts, [1.0 / 3.0, 2.0 / 3.0], "{frames:?}");
    assert_eq!(frames.last().unwrap(), &(window, None, 2));
    // In motion, it has fewer again, at once.
    session.camera.orbit(glam::Vec2::new(0.1, 0.0));
    session.frame_after(window, 0.05, 0.05).unwrap();
    assert_eq!(session.loaded().renderer.progress(), 0.0);
    assert_eq!(session.lit_share(), None);
}

/// At rest, maps that are far from final are made in frames of their own, most of which show no other picture.
#[test]
fn maps_are_refined_without_pictures_at_rest() {
    let Some(gpu) = open() else { return };
    let mut start = start("cornell", &["shadow-map", "radiosity"]);
    for (name, value) in [("resolution", "64"), ("iterations", "24")] {
        start.set.set("radiosity", name, value);
    }
    let mut viewer = Viewer::new(&gpu, start, || {});
    viewer.finish_opening().unwrap();
    let session = viewer.session().unwrap();
    let mut frames = Vec::new();
    while !session.is_complete() {
        assert!(frames.len() < 10_000, "it never comes");
        let shown = session.frame_after(SIZE, 0.05, 0.02).unwrap();
        session.gpu().wait().unwrap();
        frames.push((
            shown.is_new,
            matches!(session.readiness(), Readiness::Ready),
        ));
        if !session.readiness().is_usable() {
            // Shaders are compiled on other threads.
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
    let [refining, pictures] = [true, false].map(|all| {
        let frames = frames.iter().skip_while(|(is_new, _)| !is_new);
        let refining = frames.take_while(|(_, is_ready)| !is_ready);
        refining.filter(|(is_new, _)| all || *is_new).count()
    });
    println!("{pictures} pictures in {refining} frames");
    assert!(pictures > 1 && pictures * 2 < refining);
}

#[test]
fn a_camera_orbits_around_what_it_shows_in_the_middle() {
    let Some(gpu) = open() else { return };
    let start = start("room", &["shadow-map"]);
    let (mut viewer, _) = shown(&gpu, start, "0 orbit 0 0");
    let session = viewer.session().unwrap();
    let points = session.loaded().renderer.surface_points().unwrap();
    let middle = (SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) as usize;
    let seen = points[middle].as_ref().unwrap().position;
    let words = session
        .camera
        .argument(&gpugi_scene::Scene::default())
        .unwrap();
    let scene = session.loaded().scene();
    let (_, target) = scene_argument::view(scene, Some(&words), 1.0).unwrap();
    let eye = session.camera.camera().world_from_view.w_axis.truncate();
    // Within a pixel, along its diagonal.
    let off = target.unwrap().distance(seen) / eye.distance(seen);
    assert!(off < 0.05, "{off}");
}

/// Frames at rest until `done`.
fn frames_until(session: &mut Session, done: impl Fn(&mut Session) -> bool) {
    for _ in 0..10_000 {
        session.frame(SIZE, 0.1).unwrap();
        session.gpu().wait().unwrap();
        if done(session) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    panic!("it never comes");
}

#[test]
fn the_truth_arrives_beside_the_picture_and_goes_when_the_camera_moves() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("cornell", &["shadow-map"]), "");
    let session = viewer.session().unwrap();
    let alone = session.loaded().renderer.pixels().unwrap();
    session.truth_samples = 4;
    session.compared = Some(Compared::Split(0.5));
    frames_until(session, |session| {
        session
            .reference()
            .is_some_and(|reference| reference.samples == 4)
    });
    frames_until(session, |session| {
        session.frame(SIZE, 0.1).unwrap().is_final
    });
    let split = session.loaded().renderer.pixels().unwrap();
    assert_ne!(split, alone);
    session.camera.zoom(0.5);
    session.frame(SIZE, 0.02).unwrap();
    assert!(session.reference().is_none());
    session.compared = None;
    session.reset_camera();
    frames_until(session, |session| {
        session.loaded().renderer.samples() == SAMPLES
    });
    session.frame(SIZE, 0.1).unwrap();
    assert_eq!(session.loaded().renderer.pixels().unwrap(), alone);
}

/// What `gpugi render --technique path-tracer` renders.
fn path_traced(gpu: &Gpu, scene: &Scene, camera: &Camera, settings: &Settings) -> Vec<f32> {
    let mut tracer = PathTracer::new(gpu, scene, SIZE, settings).unwrap();
    let go_on = &mut |_: &Progress| ControlFlow::Continue(());
    tracer.render(camera, SAMPLES, go_on).unwrap();
    tracer.radiance().unwrap()
}

#[test]
fn the_path_tracer_alone_shows_what_it_renders() {
    let Some(gpu) = open() else { return };
    let start = start("cornell", &["path-tracer"]);
    let (mut viewer, _) = shown(
        &gpu,
        start,
        "0 set path-tracer.max-bounces=3\n1 orbit 20 10",
    );
    let session = viewer.session().unwrap();
    assert!(session.is_complete());
    assert_eq!(session.reference().unwrap().samples, SAMPLES);
    let scene = builtin("cornell", 1).unwrap();
    let settings = Settings {
        max_bounces: 3,
        ..Settings::default()
    };
    let expected = path_traced(&gpu, &scene, &session.camera.camera(), &settings);
    let found = |session: &Session| {
        let radiance = session.begin_radiance().unwrap();
        session.gpu().wait().unwrap();
        pollster::block_on(radiance).unwrap()
    };
    assert_eq!(found(session), expected);
    let pixels = session.loaded().renderer.pixels().unwrap();
    // What is shown is filtered.
    let mut tracer = PathTracer::new(&gpu, &scene, SIZE, &settings).unwrap();
    tracer.keep_features().unwrap();
    let go_on = &mut |_: &Progress| ControlFlow::Continue(());
    let camera = session.camera.camera();
    tracer.render(&camera, SAMPLES, go_on).unwrap();
    let denoised = tracer.denoised().unwrap();
    let displayed = developed(&gpu, SIZE, &denoised, &session.effects).unwrap();
    assert!(pixels == displayed, "the filtered picture");
    let words = command(session, SIZE);
    assert!(
        words.contains("--technique path-tracer --set path-tracer.max-bounces=3 --samples 4"),
        "{words}"
    );
    let saved = view_file(session);
    let opened = of_view_file(saved.as_bytes()).unwrap();
    assert!(opened.set.is_path_tracer(), "{saved}");
    // In motion, there are new pictures, too.
    let mut last = pixels;
    let mut pictures = 0;
    for _ in 0..100 {
        session.camera.orbit([0.05, 0.0].into());
        session.frame(SIZE, 0.02).unwrap();
        session.gpu().wait().unwrap();
        let pixels = session.loaded().renderer.pixels().unwrap();
        pictures += u32::from(pixels != last);
        last = pixels;
    }
    assert!(pictures > 5, "{pictures}");
    assert_eq!(session.loaded().renderer.samples(), 1, "for clicks");
    // Where its pictures take long, they have fewer pixels in motion, and all of them at rest.
    session.pace.is_adaptive = true;
    let slow = |session: &mut Session| {
        session.camera.orbit([0.05, 0.0].into());
        session.frame(SIZE, 0.3).unwrap();
        session.gpu().wait().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(2));
        session.picture().unwrap().size[0] < SIZE[0] / 2
    };
    let is_smaller = (0..5000).any(|_| slow(session));
    assert!(is_smaller, "all pixels in motion");
    frames_until(session, |session| session.is_complete());
    assert_eq!(session.picture().unwrap().size, SIZE);
    let expected = path_traced(&gpu, &scene, &session.camera.camera(), &settings);
    assert_eq!(found(session), expected);
    let set = session.loaded().set.toggled(&["path-tracer"], "shadow-map");
    viewer.change_set(set);
    viewer.finish_opening().unwrap();
    let session = viewer.session().unwrap();
    assert_eq!(session.technique_names(), ["shadow-map"]);
    frames_until(session, |session| session.loaded().renderer.samples() > 1);
    assert!(session.set("path-tracer", "paths", "L(").is_err());
}

#[test]
fn a_click_finds_the_object_under_it() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    let session = viewer.session().unwrap();
    session.pick(Pick::Select, [0.5, 0.5]);
    session.gpu().wait().unwrap();
    let picked = session.picked();
    let points = session.loaded().renderer.surface_points().unwrap();
    let middle = (SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) as usize;
    let expected = points[middle].as_ref().unwrap().instance;
    assert_eq!(picked.len(), 1);
    assert_eq!(picked[0].1.as_ref().unwrap().instance, expected);
    assert!(session.picked().is_empty());
}

#[test]
fn a_click_focuses_the_lens_and_begins_the_picture_anew() {
    let Some(gpu) = open() else { return };
    let (mut viewer, _) = shown(&gpu, start("room", &["shadow-map"]), "");
    let session = viewer.session().unwrap();
    let before = session.camera.camera();
    session.camera.set_aperture(0.02);
    session.pick(Pick::Sharpen, [0.25, 0.75]);
    session.gpu().wait().unwrap();
    let picked = session.picked();
    let [(Pick::Sharpen, Some(point))] = &picked[..] else {
        panic!("{picked:?}");
    };
    session.camera.sharpen(point.position);
    let seen = before.world_from_view.inverse();
    let depth = -seen.transform_point3(point.position).z;
    let focus = session.camera.lens().focus;
    assert!((focus / depth - 1.0).abs() < 1e-5, "{focus} {depth}");
    // Each begins another picture, at rest, too. Shaders of the effects may have to be compiled first.
    for shutter in [0.0, 0.02] {
        session.camera.set_shutter(shutter);
        assert!(session.loaded().renderer.samples() >= SAMPLES);
        session.frame(SIZE, 0.02).unwrap();
        assert!(session.loaded().renderer.samples() <= 1);
        frames_until(session, |session| session.is_complete());
    }
    // Whatever opens the view again holds lens and shutter.
    let camera = session.camera.camera();
    assert_eq!(camera.world_from_view, before.world_from_view);
    let words = session.camera.argument(session.loaded().scene()).unwrap();
    let read = scene_argument::camera(session.loaded().scene(), Some(&words), 1.0).unwrap();
    assert_eq!(read, camera);
    assert!(command(session, SIZE).contains(&words));
    assert!(address(session).contains(&format!("camera={words}")));
    assert!(view_file(session).contains(&words));
}

/// The picture at rest, lit with other shaders in place of those that were built.
fn lit_with(viewer: &mut Viewer, shaders: Vec<Shader>) -> Result<Vec<f32>, String> {
    viewer.gpu().replace_shaders(shaders);
    let set = viewer.session().unwrap().loaded().set.clone();
    viewer.change_set(set);
    viewer.finish_opening()?;
    let session = viewer.session().unwrap();
    frames_until(session, |session| {
        session.loaded().renderer.samples() >= SAMPLES
    });
    Ok(session.loaded().renderer.radiance().unwrap())
}

#[test]
fn shaders_under_development_light_the_next_picture() {
    let Some(gpu) = open() else { return };
    let (mut viewer, built) = shown(&gpu, start("room", &["shadow-map"]), "");
    let name = "techniques.shadow_map.gather";
    let (_, source) = all_shaders()
        .iter()
        .find(|(shader, _)| *shader == name)
        .unwrap();
    let with = |light: &str| {
        assert!(source.contains("vec4f(sum, 0.0)"));
        let source = source.replace("vec4f(sum, 0.0)", light).into();
        vec![Shader { name, source }]
    };
    let brighter = lit_with(&mut viewer, with("vec4f(2.0 * sum, 0.0)")).unwrap();
    let sum = |picture: &[f32]| picture.iter().sum::<f32>();
    // Lamps that are seen stay as they are.
    assert!((1.5..=2.001).contains(&(sum(&brighter) / sum(&built))));
    let reason = lit_with(&mut viewer, with("vec4f(2.0 * tsum, 0.0)")).unwrap_err();
    assert!(reason.contains("tsum") && reason.contains(name), "{reason}");
    let session = viewer.session().unwrap();
    let left = session.loaded().renderer.radiance().unwrap();
    assert_same(&left, &brighter);
    assert_same(&lit_with(&mut viewer, Vec::new()).unwrap(), &built);
}

/// A ball is thrown, and what is shown is the scene with the ball where it is by then. The other balls wait.
#[test]
fn a_ball_that_was_thrown_is_part_of_the_picture() {
    let Some(gpu) = open() else { return };
    let script = Script::parse("0 walk\n1 look 0 -10\n2 throw").unwrap();
    let frames = Frames {
        count: 40,
        samples: Some(SAMPLES),
        ..SHORT
    };
    let begun = start("room", &["shadow-map"]);
    let (mut viewer, _) = headless::run(&gpu, begun, frames, &script, None).unwrap();
    let session = viewer.session().unwrap();
    assert_eq!(session.eye_height(), Some(1.7));
    assert!(session.edits().is_empty());
    assert!(address(session).contains("walk=1.7"));
    let scene = session.loaded().scene().clone();
    let balls = session.balls();
    assert_eq!(balls.len(), 3);
    let center = scene.instances[balls.start].world_from_mesh.w_axis;
    // More than 0.6 s of flight: it has reached the far half of the room.
    assert!(center.z < 0.0 && center.y > 0.14, "{center}");
    let sizes = scene.instances[balls]
        .iter()
        .map(|ball| ball.world_from_mesh.x_axis.x);
    assert_eq!(sizes.collect::<Vec<f32>>(), [1.0, 1e-5, 1e-5]);
    let shown = session.loaded().renderer.radiance().unwrap();
    let mut renderer = Renderer::new(&gpu, &scene, SIZE, &["shadow-map".to_owned()]).unwrap();
    let camera = session.camera.camera();
    let go_on = |_, _| ControlFlow::Continue(());
    renderer.converge(&camera, false, go_on).unwrap();
    for _ in 0..SAMPLES {
        renderer
            .render_sample(&camera, SAMPLES, None, false)
            .unwrap();
    }
    assert_same(&shown, &renderer.radiance().unwrap());
}
