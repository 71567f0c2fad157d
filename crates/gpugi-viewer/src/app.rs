//! The window, or the page: the session's picture, its controls, mouse and keyboard.

use std::path::Path;
use std::time::Duration;

use eframe::egui::{self, Color32, Key, Panel, PointerButton, Rect, ScrollArea, Sense, Ui};
use eframe::egui_wgpu::RenderState;
use glam::{Vec2, Vec3};
use gpugi::gpu::Gpu;
use gpugi::picture::Compared;
use gpugi::{LightingError, Readiness};
use gpugi_arguments::files::Files;
use gpugi_arguments::scene_argument::SceneArguments;
use web_time::Instant;

use crate::command::command;
use crate::gizmo::{self, Selected};
use crate::panels::{self, Action, Maps};
use crate::recording::Recording;
use crate::saving::{self, Saving, What};
use crate::session::{Pick, Session};
use crate::task::Task;
use crate::technique_set::TechniqueSet;
use crate::viewer::{Start, Viewer};

#[cfg(target_arch = "wasm32")]
mod address;
#[cfg(not(target_arch = "wasm32"))]
mod shaders;
mod walking;

/// The viewer's window, or page.
pub struct App {
    gpu: Gpu,
    render_state: RenderState,
    viewer: Viewer,
    texture: Option<(egui::TextureId, wgpu::TextureView)>,
    selected: Option<Selected>,
    maps: Maps,
    hands: walking::Hands,
    /// What was dropped on a page, which is being read.
    dropped: Option<Task<Result<Files, String>>>,
    saving: Option<Saving>,
    recording: Option<Recording>,
    #[cfg(not(target_arch = "wasm32"))]
    shaders: shaders::Shaders,
    #[cfg(target_arch = "wasm32")]
    address: address::Address,
    message: Option<Message>,
    last_view: Instant,
    last_frame: Instant,
    #[cfg(target_arch = "wasm32")]
    busy: crate::browser::Busy,
    /// Seconds per frame, smoothed.
    frame_seconds: f32,
    /// Time that the CPU takes for a frame (s), smoothed.
    cpu_seconds: f32,
}

/// What people are to know.
#[derive(Debug, Clone, PartialEq)]
struct Message {
    text: String,
    is_error: bool,
}

impl App {
    /// A window on the device of `render_state`, in which a scene is being opened.
    pub fn new(context: &egui::Context, render_state: &RenderState, start: Start) -> Self {
        let gpu = gpu_of(render_state);
        let for_hands = context.clone();
        let context = context.clone();
        let viewer = Viewer::new(&gpu, start, move || context.request_repaint());
        let hands = walking::Hands::new(&for_hands);
        Self::of(viewer, gpu, hands, render_state)
    }

    /// Another window, on another device, that shows what this one showed before its own was lost.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn renewed(mut self, context: &egui::Context, render_state: &RenderState) -> Self {
        let gpu = gpu_of(render_state);
        let hands = walking::Hands::new(context);
        let context = context.clone();
        self.viewer.renew(&gpu, move || context.request_repaint());
        let lost = self.gpu.check_lost();
        let mut app = Self::of(self.viewer, gpu, hands, render_state);
        if let Err(lost) = lost {
            app.complain(lost.to_string());
        }
        app
    }

    fn of(viewer: Viewer, gpu: Gpu, hands: walking::Hands, render_state: &RenderState) -> Self {
        Self {
            viewer,
            gpu,
            render_state: render_state.clone(),
            texture: None,
            selected: None,
            maps: Maps::default(),
            hands,
            dropped: None,
            saving: None,
            recording: None,
            #[cfg(not(target_arch = "wasm32"))]
            shaders: shaders::Shaders::default(),
            #[cfg(target_arch = "wasm32")]
            address: address::Address::default(),
            message: None,
            last_view: Instant::now(),
            last_frame: Instant::now(),
            #[cfg(target_arch = "wasm32")]
            busy: crate::browser::Busy::default(),
            frame_seconds: 0.0,
            cpu_seconds: 0.0,
        }
    }

    /// Shows what has been opened, and begins to open what was dropped on the window.
    fn follow_openings(&mut self, context: &egui::Context) {
        let files = context.input(|input| input.raw.dropped_files.clone());
        if !files.is_empty() {
            self.open_dropped(context, files);
        }
        let read = self.dropped.as_ref().and_then(Task::result);
        if let Some(read) = read {
            self.dropped = None;
            match read.unwrap_or_else(|| Err("nothing could be read".into())) {
                Ok(files) => {
                    if let Some(name) = files.main().map(str::to_owned) {
                        self.open_file(Path::new(&name), files);
                    }
                }
                Err(reason) => self.complain(reason),
            }
        }
        match self.viewer.take_opened() {
            Ok(false) => {}
            Ok(true) => {
                self.selected = None;
                self.maps.clear();
                if let Some(session) = self.viewer.session() {
                    let title = format!("{} - gpugi", session.loaded().arguments[0]);
                    context.send_viewport_cmd(egui::ViewportCommand::Title(title));
                }
            }
            Err(reason) => self.complain(reason),
        }
    }

    fn open_file(&mut self, file: &Path, files: Files) {
        self.message = None;
        if let Err(reason) = self.viewer.open_file(file, files) {
            self.complain(reason);
        }
    }

    /// Begins to open the file that was dropped last.
    #[cfg(not(target_arch = "wasm32"))]
    fn open_dropped(&mut self, _: &egui::Context, files: Vec<egui::DroppedFileHandle>) {
        if let Some(file) = files.last() {
            self.open_file(file.path(), Files::default());
        }
    }

    /// Begins to read what was dropped: a scene with the files that it refers to, or an image.
    #[cfg(target_arch = "wasm32")]
    fn open_dropped(&mut self, context: &egui::Context, files: Vec<egui::DroppedFileHandle>) {
        let subject = files[0].path().display().to_string();
        let context = context.clone();
        let done = move || context.request_repaint();
        let task = Task::start(&subject, done, move |stage| async move {
            stage.set("reading").await;
            crate::browser::read(&files).await
        });
        self.dropped = Some(task);
    }

    fn act(&mut self, context: &egui::Context, action: Action) -> Result<(), LightingError> {
        let Some(session) = self.viewer.session() else {
            return Ok(());
        };
        self.message = None;
        match action {
            Action::Open(name) => {
                self.viewer
                    .open(SceneArguments::of(&name), &TechniqueSet::default());
            }
            Action::ChangeSet(set) => self.viewer.change_set(set),
            Action::Set([owner, name, value]) => match session.effects.set(&owner, &name, &value) {
                Some(set) => set.map_err(|source| LightingError::Setting {
                    technique: owner,
                    source,
                })?,
                None => session.set(&owner, &name, &value)?,
            },
            Action::Edit(edit) => session.edit(&edit)?,
            Action::Pose(seconds) => session.pose(seconds)?,
            Action::Camera(index) => session.stand_at(index),
            Action::Walk(false) => session.fly(),
            Action::Walk(true) => {
                if let Err(reason) = session.walk(None) {
                    self.complain(reason);
                }
            }
            Action::Throw => {
                if let Err(reason) = self.viewer.throw() {
                    self.complain(reason);
                }
            }
            Action::Polish(finish) => self.viewer.polish(finish),
            Action::Complain(reason) => self.complain(reason),
            Action::LoseDevice => self.viewer.lose_device(),
            Action::CopyCommand => {
                let command = command(session, session.loaded().renderer.size());
                context.copy_text(command.clone());
                self.say(command);
            }
            Action::Record => match self.recording.take() {
                Some(recording) => {
                    let done = recording.end(session);
                    self.say(done);
                }
                None => match Recording::begin(session, Path::new(".")) {
                    Ok(recording) => self.recording = Some(recording),
                    Err(reason) => self.complain(reason),
                },
            },
            Action::Save(what) => {
                let context = context.clone();
                let done = move || context.request_repaint();
                match saving::save(session, what, done) {
                    Ok(saving) => self.saving = Some(saving),
                    Err(reason) => self.complain(reason),
                }
            }
        }
        Ok(())
    }

    /// Says that the picture is written.
    fn follow_saving(&mut self) {
        let saved = self.saving.as_ref().and_then(Task::result);
        if let Some(saved) = saved {
            self.saving = None;
            match saved.unwrap_or_else(|| Err("the picture could not be written".into())) {
                Ok(done) => self.say(done),
                Err(reason) => self.complain(reason),
            }
        }
    }

    /// What is on show, and what is being opened.
    pub fn viewer(&mut self) -> &mut Viewer {
        &mut self.viewer
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// What people are told, if it is about an error.
    pub fn error(&self) -> Option<&str> {
        let message = self.message.as_ref().filter(|message| message.is_error);
        message.map(|message| message.text.as_str())
    }

    /// Tells people about an error.
    pub fn complain(&mut self, text: String) {
        let is_error = true;
        // The terminal keeps what the window soon replaces.
        #[cfg(not(target_arch = "wasm32"))]
        eprintln!("gpugi: {text}");
        self.message = Some(Message { text, is_error });
    }

    fn say(&mut self, text: String) {
        self.message = Some(Message {
            text,
            is_error: false,
        });
    }

    /// What is going on: errors, progress, samples, frames per second.
    fn status(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some(dropped) = &self.dropped {
                repaint_soon(ui);
                ui.label(format!("{}: {}", dropped.subject, dropped.stage.get()));
            }
            if let Some(opening) = self.viewer.opening() {
                repaint_soon(ui);
                match opening.stage.with_progress() {
                    (stage, Some(progress)) => work(ui, stage, progress),
                    (stage, None) => {
                        ui.label(format!("{}: {stage}", opening.subject));
                    }
                }
                if ui.small_button("cancel").clicked() {
                    self.viewer.cancel();
                }
            }
            if let Some(session) = self.viewer.session() {
                match session.readiness() {
                    Readiness::Pending { what, progress } => work(ui, what, progress),
                    Readiness::Refining { progress } => work(ui, "maps", progress),
                    Readiness::Ready if session.loaded().set.is_path_tracer() => {
                        ui.label(panels::traced(session));
                    }
                    Readiness::Ready => match session.lit_share() {
                        Some(share) => work(ui, "pixels", share),
                        None => {
                            let samples = session.loaded().renderer.samples();
                            ui.label(format!("{samples} samples"));
                        }
                    },
                }
                if self.frame_seconds > 0.0 {
                    ui.label(format!("{:.0} frames/s", 1.0 / self.frame_seconds));
                }
            }
            if let Some(message) = &self.message {
                let color = if message.is_error {
                    Color32::LIGHT_RED
                } else {
                    ui.visuals().text_color()
                };
                if ui.small_button("x").clicked() {
                    self.message = None;
                } else {
                    ui.add(
                        egui::Label::new(egui::RichText::new(&message.text).color(color))
                            .truncate(),
                    );
                }
            }
        });
    }

    /// The session's next frame in a window of this size (pixels), if the GPU has done the last one.
    fn frame(&mut self, context: &egui::Context, window: [u32; 2]) {
        #[cfg(target_arch = "wasm32")]
        if self.busy.get() {
            return;
        }
        let is_disturbed = self.viewer.opening().is_some();
        let Some(session) = self.viewer.session() else {
            return;
        };
        session.is_disturbed = is_disturbed;
        let seconds = self.last_frame.elapsed().as_secs_f32();
        self.last_frame = Instant::now();
        let began = Instant::now();
        let shown = match &mut self.recording {
            Some(recording) => recording.frame(session, window),
            None => {
                let shown = session.frame(window, seconds);
                shown.map_err(|error| error.to_string())
            }
        };
        self.cpu_seconds += 0.1 * (began.elapsed().as_secs_f32() - self.cpu_seconds);
        match shown {
            Ok(shown) if shown.is_final && self.recording.is_none() => self.frame_seconds = 0.0,
            Ok(_) => {
                #[cfg(target_arch = "wasm32")]
                {
                    let context = context.clone();
                    let done = move || context.request_repaint();
                    self.busy.begin(&self.gpu, done);
                }
                #[cfg(not(target_arch = "wasm32"))]
                context.request_repaint();
                let part = if self.frame_seconds > 0.0 { 0.1 } else { 1.0 };
                self.frame_seconds += part * (seconds.min(1.0) - self.frame_seconds);
            }
            Err(text) => {
                if let Some(recording) = self.recording.take() {
                    recording.end(session);
                }
                self.complain(text);
            }
        }
    }

    /// The picture, and what mouse and keyboard do to it.
    fn view(&mut self, ui: &mut Ui) {
        let rect = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        let seconds = self.last_view.elapsed().as_secs_f32();
        self.last_view = Instant::now();
        let Some(session) = self.viewer.session() else {
            return;
        };
        self.hands.steer(session, seconds);
        if session.eye_height().is_some() {
            self.hands.walk(ui, &response, session);
        } else {
            self.hands.release(ui);
            steer(ui, &response, session, seconds);
        }
        if !self.hands.has_mouse() {
            click(ui, &response, session);
        }
        let pixels = (rect.size() * ui.ctx().pixels_per_point()).round();
        let window = [pixels.x, pixels.y].map(|side| (side as u32).max(1));
        self.frame(ui.ctx(), window);
        let Some(session) = self.viewer.session() else {
            return;
        };
        for (purpose, point) in session.picked() {
            match (purpose, point) {
                (Pick::Focus, Some(point)) => session.camera.focus(point.position),
                (Pick::Sharpen, Some(point)) => session.camera.sharpen(point.position),
                (Pick::Select, point) => {
                    self.selected = point.map(|point| Selected::Object(point.instance as usize));
                }
                (Pick::Focus | Pick::Sharpen, None) => {}
            }
            ui.ctx().request_repaint();
        }
        let Some(picture) = session.picture() else {
            return;
        };
        let texture = match &self.texture {
            Some((texture, view)) if *view == picture.view => *texture,
            before => {
                let mut renderer = self.render_state.renderer.write();
                if let Some((texture, _)) = before {
                    renderer.free_texture(texture);
                }
                let filter = wgpu::FilterMode::Linear;
                let texture =
                    renderer.register_native_texture(&self.gpu.device, &picture.view, filter);
                self.texture = Some((texture, picture.view.clone()));
                texture
            }
        };
        let whole = Rect::from_min_max(egui::Pos2::ZERO, egui::Pos2::new(1.0, 1.0));
        ui.painter().image(texture, rect, whole, Color32::WHITE);
        let is_beside = !session.loaded().set.is_path_tracer();
        if let (Some(Compared::Split(split)), true) = (&mut session.compared, is_beside) {
            divider(ui, rect, split);
        }
        let camera = session.camera.camera();
        let seen = (session.loaded().scene(), &camera);
        let edit = gizmo::show(ui, rect, seen, &mut self.selected);
        if let Some(Err(error)) = edit.map(|edit| session.edit(&edit)) {
            self.complain(error.to_string());
        }
    }
}

impl eframe::App for App {
    #[cfg(target_arch = "wasm32")]
    fn as_any_mut(&mut self) -> Option<&mut dyn std::any::Any> {
        Some(self)
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let context = ui.ctx().clone();
        self.show(ui, &context);
        if self.gpu.check_lost().is_err() {
            // The window closes, to open on another device; the page says what to do. Until then, egui must draw
            // nothing: on a lost device it panics.
            context.graphics_mut(std::mem::take);
            context.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }
}

impl App {
    /// All of the window.
    fn show(&mut self, ui: &mut Ui, context: &egui::Context) {
        if self.gpu.check_lost().is_err() {
            return;
        }
        self.follow_openings(context);
        self.follow_saving();
        #[cfg(not(target_arch = "wasm32"))]
        self.shaders.follow(context, &mut self.viewer);
        #[cfg(target_arch = "wasm32")]
        if let Some(session) = self.viewer.session() {
            self.address.follow(session, context);
        }
        let mut actions = Vec::new();
        let is_opening = self.viewer.opening().is_some();
        Panel::bottom("status").show(ui, |ui| self.status(ui));
        if let Some(session) = self.viewer.session() {
            Panel::left("controls").default_size(300.0).show(ui, |ui| {
                ScrollArea::vertical().show(ui, |ui| {
                    panels::scene(ui, session, &mut actions);
                    panels::picture(ui, session, self.recording.as_ref(), &mut actions);
                    // What is set while something is opened would be lost.
                    ui.add_enabled_ui(!is_opening, |ui| {
                        panels::techniques(ui, session, &mut actions);
                    });
                    panels::truth(ui, session);
                    let object = match self.selected {
                        Some(Selected::Object(index)) => Some(index),
                        _ => None,
                    };
                    panels::edits(ui, session.loaded().scene(), object, &mut actions);
                    panels::walking(ui, session, &mut actions);
                    panels::performance(ui, session, self.cpu_seconds);
                    self.maps.list(ui, session);
                    panels::keys(ui);
                });
            });
            self.maps.windows(context, session);
            keys(ui, session, &mut actions);
            self.hands.ask(ui, session, &mut actions);
        }
        for action in actions {
            if let Err(error) = self.act(context, action) {
                self.message = Some(Message {
                    text: error.to_string(),
                    is_error: true,
                });
            }
            context.request_repaint();
        }
        egui::CentralPanel::no_frame().show(ui, |ui| self.view(ui));
    }
}

/// gpugi on egui's device.
fn gpu_of(render_state: &RenderState) -> Gpu {
    Gpu::from_device(
        &render_state.adapter,
        render_state.device.clone(),
        render_state.queue.clone(),
    )
}

/// Shows soon how far something is. A spinner would draw the window as often as it can, and take the GPU from what is
/// waited for.
fn repaint_soon(ui: &Ui) {
    ui.ctx().request_repaint_after(Duration::from_millis(100));
}

/// How far work is that the picture waits for.
fn work(ui: &mut Ui, what: &str, progress: f32) {
    ui.label(what);
    let bar = egui::ProgressBar::new(progress).desired_width(100.0);
    ui.add(bar.text(format!("{:.0} %", 100.0 * progress)));
}

/// Keys that save what is seen and show the truth beside it. For tests, F12 loses the device.
fn keys(ui: &Ui, session: &mut Session, actions: &mut Vec<Action>) {
    if ui.ctx().egui_wants_keyboard_input() {
        return;
    }
    let is_pressed = |key| ui.input(|input| input.key_pressed(key));
    for (key, what) in [
        (Key::F2, What::View),
        (Key::F3, What::Picture),
        (Key::F4, What::Radiance),
    ] {
        if is_pressed(key) {
            actions.push(Action::Save(what));
        }
    }
    if is_pressed(Key::F12) && cfg!(all(debug_assertions, not(target_arch = "wasm32"))) {
        actions.push(Action::LoseDevice);
    }
    if is_pressed(Key::R) {
        session.reset_camera();
    }
    if is_pressed(Key::T) && !session.loaded().set.is_path_tracer() {
        session.compared = match session.compared {
            None => Some(Compared::Split(0.5)),
            Some(_) => None,
        };
    }
}

/// The line between the picture and the truth, to be dragged.
fn divider(ui: &Ui, rect: Rect, split: &mut f32) {
    let x = rect.left() + *split * rect.width();
    let grip = Rect::from_x_y_ranges(x - 5.0..=x + 5.0, rect.y_range());
    let response = ui.interact(grip, ui.scope_id().with("divider"), Sense::drag());
    let response = response.on_hover_cursor(egui::CursorIcon::ResizeHorizontal);
    if let Some(at) = response.interact_pointer_pos() {
        *split = ((at.x - rect.left()) / rect.width()).clamp(0.02, 0.98);
        ui.ctx().request_repaint();
    }
    ui.painter()
        .vline(x, rect.y_range(), egui::Stroke::new(2.0, Color32::WHITE));
}

/// Mouse, fingers and keyboard steer the camera.
fn steer(ui: &Ui, response: &egui::Response, session: &mut Session, seconds: f32) {
    let height = response.rect.height().max(1.0);
    let drag = response.drag_delta() / height;
    let drag = Vec2::new(drag.x, drag.y);
    let shift = ui.input(|input| input.modifiers.shift);
    let camera = &mut session.camera;
    // The first of two fingers is a pointer, too.
    if let Some(touch) = ui.input(egui::InputState::multi_touch) {
        let shift = touch.translation_delta / height;
        camera.pan(Vec2::new(shift.x, -shift.y));
    } else if drag != Vec2::ZERO {
        if response.dragged_by(PointerButton::Secondary) {
            let field = camera.field_of_view().unwrap_or(60.0).to_radians();
            camera.look(drag * field);
        } else if response.dragged_by(PointerButton::Middle) || shift {
            camera.pan(Vec2::new(drag.x, -drag.y));
        } else {
            camera.orbit(drag * std::f32::consts::PI);
        }
    }
    if response.hovered() {
        let (scroll, zoom) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let factor = (-scroll / 300.0).exp() / zoom;
        if factor != 1.0 {
            camera.zoom(factor);
        }
    }
    if !ui.ctx().egui_wants_keyboard_input() {
        let axis = |more: Key, less: Key| {
            ui.input(|input| {
                f32::from(u8::from(input.key_down(more)))
                    - f32::from(u8::from(input.key_down(less)))
            })
        };
        let way = Vec3::new(
            axis(Key::D, Key::A),
            axis(Key::E, Key::Q),
            axis(Key::W, Key::S),
        );
        if way != Vec3::ZERO {
            let speed = if shift { 4.0 } else { 1.0 };
            camera.fly(way * speed, seconds.min(0.1));
        }
        if ui.input(|input| input.key_pressed(Key::Space)) {
            session.clock.is_playing = !session.clock.is_playing;
        }
    }
}

/// What a click picks.
fn click(ui: &Ui, response: &egui::Response, session: &mut Session) {
    if let Some(at) = response.interact_pointer_pos() {
        let place = (at - response.rect.min) / response.rect.size();
        if response.double_clicked() {
            session.pick(Pick::Focus, [place.x, place.y]);
        } else if response.clicked() {
            let is_asked = ui.input(|input| input.modifiers.command) || session.is_focusing;
            session.is_focusing = false;
            let purpose = match is_asked && !session.camera.lens().is_pinhole() {
                true => Pick::Sharpen,
                false => Pick::Select,
            };
            session.pick(purpose, [place.x, place.y]);
        }
    }
}
