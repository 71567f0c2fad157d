//! The controls beside the picture. They show the session and say what is to be done.

mod edits;
mod lens;
mod maps;
mod performance;
mod settings;
mod walking;

use eframe::egui::{self, CollapsingHeader, ComboBox, DragValue, Slider, Ui};
use gpugi::picture::{Compared, Quantity};
use gpugi::scene::Edit;
use gpugi::techniques::Registry;
use gpugi_scene::builtin;

use crate::game::ball::Finish;
use crate::recording::Recording;
use crate::saving::What;
use crate::session::Session;
use crate::technique_set::{PATH_TRACER, Preset, TechniqueSet};

pub use edits::edits;
pub use maps::Maps;
pub use performance::performance;
pub use walking::walking;

/// What people asked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// To open a built-in scene.
    Open(String),
    /// To light the scene with other techniques.
    ChangeSet(TechniqueSet),
    /// To change a setting: technique or effect, name, value.
    Set([String; 3]),
    /// To edit the scene.
    Edit(Edit),
    /// To pose the scene (s).
    Pose(f32),
    /// To stand where a camera of the scene stands.
    Camera(usize),
    /// To copy the command line that renders what is seen.
    CopyCommand,
    /// To write what is seen.
    Save(What),
    /// To begin or to end a recording.
    Record,
    /// To walk, or to fly.
    Walk(bool),
    /// To throw a ball.
    Throw,
    /// To make the balls of something else.
    Polish(Finish),
    /// To say what is wrong.
    Complain(String),
    /// To lose the device, in tests.
    LoseDevice,
}

/// Scene, cameras and animation.
pub fn scene(ui: &mut Ui, session: &mut Session, actions: &mut Vec<Action>) {
    CollapsingHeader::new("Scene")
        .default_open(true)
        .show(ui, |ui| {
            let loaded = session.loaded();
            let name = loaded.arguments.first().cloned().unwrap_or_default();
            ComboBox::from_id_salt("scene")
                .width(ui.available_width())
                .selected_text(name.clone())
                .show_ui(ui, |ui| {
                    for scene in builtin::SCENES {
                        let label = ui.selectable_label(scene.name == name, scene.name);
                        if label.on_hover_text(scene.summary).clicked() {
                            actions.push(Action::Open(scene.name.to_owned()));
                        }
                    }
                });
            ui.weak("or drop a .glb, .gltf, .obj, .ply; an .exr or .hdr as environment; a view that was saved");
            for note in &loaded.notes {
                ui.weak(note);
            }
            let cameras = &loaded.scene().cameras;
            if !cameras.is_empty() {
                ui.horizontal_wrapped(|ui| {
                    for (index, camera) in cameras.iter().enumerate() {
                        let text = match camera.name.as_str() {
                            "" => format!("camera {index}"),
                            name => name.to_owned(),
                        };
                        let button = ui.small_button(text).on_hover_text("Stand there");
                        if button.clicked() {
                            actions.push(Action::Camera(index));
                        }
                    }
                });
            }
            let duration = loaded.scene().rig.as_ref().map_or(0.0, |rig| rig.duration());
            if duration > 0.0 {
                ui.horizontal(|ui| {
                    let clock = &mut session.clock;
                    let text = if clock.is_playing { "pause" } else { "play" };
                    if ui.button(text).clicked() {
                        clock.is_playing = !clock.is_playing;
                    }
                    let mut seconds = clock.seconds.rem_euclid(duration);
                    let slider = Slider::new(&mut seconds, 0.0..=duration).suffix(" s");
                    if ui.add(slider).changed() {
                        actions.push(Action::Pose(seconds));
                    }
                });
            }
        });
}

/// Effects, such as exposure and tone mapping, lens, resolution and what is done with the picture.
pub fn picture(
    ui: &mut Ui,
    session: &mut Session,
    recording: Option<&Recording>,
    actions: &mut Vec<Action>,
) {
    CollapsingHeader::new("Picture")
        .default_open(true)
        .show(ui, |ui| {
            CollapsingHeader::new("Effects").show(ui, |ui| {
                for (name, values) in session.effects.all() {
                    ui.label(name);
                    ui.indent(name, |ui| settings::settings(ui, name, values, actions));
                }
            });
            ui.horizontal(|ui| {
                ui.label("show");
                ComboBox::from_id_salt("quantity")
                    .selected_text(session.quantity.map_or("light", Quantity::name))
                    .show_ui(ui, |ui| {
                        ui.selectable_value(&mut session.quantity, None, "light");
                        for quantity in Quantity::ALL {
                            ui.selectable_value(&mut session.quantity, Some(quantity), quantity.name());
                        }
                    });
            });
            if let Some(mut degrees) = session.camera.field_of_view() {
                let slider = Slider::new(&mut degrees, 5.0..=120.0)
                    .clamping(egui::SliderClamping::Edits)
                    .text("field of view")
                    .suffix("°");
                if ui.add(slider).changed() {
                    session.camera.set_field_of_view(degrees);
                }
            }
            lens::lens(ui, session);
            let pace = &mut session.pace;
            ui.add(Slider::new(&mut pace.scale, 0.1..=2.0).text("resolution"))
                .on_hover_text("Pixels of the picture per pixel of the window, along a side");
            ui.horizontal(|ui| {
                ui.checkbox(&mut pace.is_adaptive, "fewer, for")
                    .on_hover_text(
                        "In motion, as few pixels as the rate takes. At rest all of them, over several frames if they take long",
                    );
                ui.add(
                    DragValue::new(&mut pace.target_rate)
                        .range(5..=240)
                        .suffix(" frames/s"),
                );
            });
            ui.horizontal(|ui| {
                ui.add(DragValue::new(&mut session.samples).range(1..=65_536));
                ui.label("samples per pixel at rest");
            });
            ui.horizontal_wrapped(|ui| {
                for (what, text, help) in [
                    (What::Picture, "save PNG", "What is seen"),
                    (What::Radiance, "save EXR", "Linear radiance"),
                    (What::View, "save view", "A file that opens this view again"),
                ] {
                    if ui.button(text).on_hover_text(help).clicked() {
                        actions.push(Action::Save(what));
                    }
                }
                let button = ui.button("copy as command");
                if button
                    .on_hover_text("The command line that renders this picture")
                    .clicked()
                {
                    actions.push(Action::CopyCommand);
                }
                // A page has no folder to write to.
                if cfg!(not(target_arch = "wasm32")) {
                    record(ui, recording, actions);
                }
            });
        });
}

/// Begins a recording, or ends the one that goes on.
fn record(ui: &mut Ui, recording: Option<&Recording>, actions: &mut Vec<Action>) {
    let text = match recording {
        Some(recording) => format!("stop after {} frames", recording.frames()),
        None => "record".to_owned(),
    };
    let help = "Writes a PNG every 60th of a second of the animation, each with all samples";
    if ui.button(text).on_hover_text(help).clicked() {
        actions.push(Action::Record);
    }
}

/// Techniques and their settings.
pub fn techniques(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    CollapsingHeader::new("Techniques")
        .default_open(true)
        .show(ui, |ui| {
            let loaded = session.loaded();
            ui.horizontal(|ui| {
                for (preset, text, help) in [
                    (
                        Preset::Live,
                        "for motion",
                        "What suits this scene while things move",
                    ),
                    (
                        Preset::Still,
                        "for a still",
                        "What `gpugi render` takes: maps take longer",
                    ),
                ] {
                    let is_chosen = loaded.set.names.is_none() && loaded.set.preset == preset;
                    if ui
                        .selectable_label(is_chosen, text)
                        .on_hover_text(help)
                        .clicked()
                        && !is_chosen
                    {
                        actions.push(Action::ChangeSet(TechniqueSet {
                            preset,
                            ..TechniqueSet::default()
                        }));
                    }
                }
            });
            path_tracer(ui, &loaded.set, actions);
            let in_use = session.technique_names();
            for registration in Registry::default().all() {
                let name = registration.info.name;
                let technique = session.technique(name);
                let mut is_on = technique.is_some();
                let id = ui.make_persistent_id(name);
                egui::collapsing_header::CollapsingState::load_with_default_open(
                    ui.ctx(),
                    id,
                    false,
                )
                .show_header(ui, |ui| {
                    let summary = format!(
                        "{}\n{}",
                        registration.info.summary, registration.info.source
                    );
                    if ui
                        .checkbox(&mut is_on, name)
                        .on_hover_text(summary)
                        .changed()
                    {
                        actions.push(Action::ChangeSet(loaded.set.toggled(&in_use, name)));
                    }
                })
                .body(|ui| {
                    let Some(technique) = technique else {
                        let paths: Vec<String> = registration.info.paths.iter().map(path).collect();
                        ui.weak(format!("off; can add {}", paths.join(", ")));
                        return;
                    };
                    let paths = loaded.renderer.light_paths_of(name);
                    let paths: Vec<String> = paths.iter().map(path).collect();
                    ui.weak(format!("adds {}", paths.join(", ")));
                    settings::settings(ui, name, technique.settings(), actions);
                });
            }
            for missing in loaded.renderer.left_out() {
                ui.weak(format!("not in this picture: {missing}"));
            }
        });
}

/// The path tracer in place of all techniques, and its settings.
fn path_tracer(ui: &mut Ui, set: &TechniqueSet, actions: &mut Vec<Action>) {
    let is_chosen = set.is_path_tracer();
    let label = ui.selectable_label(is_chosen, PATH_TRACER);
    let help = "All light, without any map: noise that goes while nothing moves";
    if label.on_hover_text(help).clicked() && !is_chosen {
        actions.push(Action::ChangeSet(set.path_tracer()));
    }
    if let (true, Ok(values)) = (is_chosen, set.path_tracer_settings()) {
        settings::settings(ui, PATH_TRACER, &values, actions);
    }
}

fn path(paths: &gpugi::light_paths::LightPaths) -> String {
    format!("{} ({})", paths.pattern, paths.class)
}

/// The path tracer beside the picture.
pub fn truth(ui: &mut Ui, session: &mut Session) {
    CollapsingHeader::new("Truth").show(ui, |ui| {
        if session.loaded().set.is_path_tracer() {
            ui.weak("the path tracer lights the whole picture");
            denoises(ui, session);
            ui.label(traced(session));
            return;
        }
        let split = match session.compared {
            Some(Compared::Split(split)) => split,
            _ => 0.5,
        };
        ui.horizontal(|ui| {
            let choices = [
                (None, "off"),
                (Some(Compared::Split(split)), "split"),
                (Some(Compared::Error), "error"),
                (Some(Compared::Leaks), "leaks"),
            ];
            for (choice, text) in choices {
                ui.selectable_value(&mut session.compared, choice, text);
            }
        });
        if session.compared.is_none() {
            ui.weak("the path tracer beside the picture");
            return;
        }
        match session.compared {
            Some(Compared::Error) => {
                ui.weak("part of rel-mse: 1e-4 black, 1e-3 blue, 1e-2 red, 1e-1 yellow, 1 white");
            }
            Some(Compared::Leaks) => {
                ui.weak("light that is too much, red, or missing, blue: full colour at all of it");
            }
            _ => {}
        }
        denoises(ui, session);
        ui.label(match session.reference() {
            Some(_) => traced(session),
            None => "the path tracer begins when nothing moves".to_owned(),
        });
    });
}

fn denoises(ui: &mut Ui, session: &mut Session) {
    let help = "Filter the noise out of what is seen. Saved pictures are not filtered";
    ui.checkbox(&mut session.denoises_truth, "denoise")
        .on_hover_text(help);
}

/// How far the path tracer is.
pub fn traced(session: &Session) -> String {
    let reference = session.reference();
    let samples = reference.map_or(0, |reference| reference.samples);
    let noise = reference.and_then(|reference| reference.noise);
    let noise = noise.map_or(String::new(), |noise| {
        format!(", estimated rel-mse {noise:.1e}")
    });
    format!("path tracer: {samples} samples{noise}")
}

/// What mouse and keyboard do.
pub fn keys(ui: &mut Ui) {
    CollapsingHeader::new("Mouse and keys").show(ui, |ui| {
        for (keys, help) in [
            ("drag", "orbit"),
            ("right drag", "look around"),
            ("middle or shift drag", "pan"),
            ("wheel, pinch", "nearer, farther"),
            ("two fingers", "pan"),
            ("W A S D, Q E", "fly; with shift faster"),
            ("click", "select an object, or a light's circle"),
            ("drag an arrow", "move what is selected"),
            ("drag a sun's circle", "turn a directional light"),
            ("double click", "turn there, and orbit around it"),
            ("Ctrl or Cmd click", "focus the lens there, if it is open"),
            ("R", "back to where the camera stood"),
            ("space", "play or pause the animation"),
            ("G", "walk, or fly again"),
            (
                "W A S D, space, E",
                "walking: walk, jump, use; with shift run",
            ),
            ("click, Esc", "walking: the mouse turns the view, or not"),
            ("B", "throw a ball"),
            (
                "gamepad",
                "sticks walk or fly, and look; A, B, X jump, throw, use",
            ),
            ("T", "the path tracer beside the picture, or not"),
            ("F2, F3, F4", "save the view, a PNG, an EXR"),
        ] {
            ui.horizontal(|ui| {
                ui.strong(keys);
                ui.label(help);
            });
        }
    });
}
