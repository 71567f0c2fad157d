//! Mouse, keys and gamepad of somebody who walks, and a gamepad's flight.

use eframe::egui::{self, Event, Key, Rect, Response, Ui, ViewportCommand, viewport::CursorGrab};
use glam::{Vec2, Vec3};

use crate::game::Intent;
use crate::gamepad::{Gamepad, Pad};
use crate::panels::Action;
use crate::session::Session;

/// What the view turns by for a count of a captured mouse (rad), and in a second of a gamepad's stick (rad/s).
const PER_COUNT: f32 = 0.0025;
const PER_SECOND: f32 = 2.5;
/// Part of a stick's way beyond which somebody runs.
const RUNS: f32 = 0.95;

/// What people have in their hands.
#[derive(Debug, Default)]
pub struct Hands {
    gamepad: Gamepad,
    before: Pad,
    /// Whether the mouse is the window's, hidden, so that its motion turns the view.
    is_captured: bool,
}

impl Hands {
    /// Listens to a gamepad, which wakes the window.
    pub fn new(context: &egui::Context) -> Self {
        let context = context.clone();
        Self {
            gamepad: Gamepad::new(move || context.request_repaint()),
            ..Self::default()
        }
    }

    /// What keys and buttons ask for, walking or not.
    pub fn ask(&mut self, ui: &Ui, session: &mut Session, actions: &mut Vec<Action>) {
        let has_keys = !ui.ctx().egui_wants_keyboard_input();
        let is_pressed = |key| has_keys && is_pressed(ui, key);
        let pad = self.gamepad.state();
        let is_walking = session.eye_height().is_some();
        let [jumps, throws, uses] = pad.unwrap_or_default().pressed(&self.before);
        if is_pressed(Key::G) {
            actions.push(Action::Walk(!is_walking));
        }
        if is_pressed(Key::B) || throws {
            actions.push(Action::Throw);
        }
        if is_walking {
            session.intent.jumps |= is_pressed(Key::Space) || jumps;
            if is_pressed(Key::E) || uses {
                session.operate();
            }
        }
        self.before = pad.unwrap_or_default();
        let is_held = pad.is_some_and(|pad| pad.left != Vec2::ZERO || pad.right != Vec2::ZERO);
        if is_held {
            ui.ctx().request_repaint();
        } else if pad.is_some() && cfg!(target_arch = "wasm32") {
            // A browser has to be asked.
            let soon = std::time::Duration::from_millis(30);
            ui.ctx().request_repaint_after(soon);
        }
    }

    /// A gamepad turns the view, and flies where nobody walks.
    pub fn steer(&self, session: &mut Session, seconds: f32) {
        let Pad { left, right, .. } = self.before;
        if right != Vec2::ZERO {
            session.camera.look(right * (PER_SECOND * seconds.min(0.1)));
        }
        if left != Vec2::ZERO && session.eye_height().is_none() {
            session
                .camera
                .fly(Vec3::new(left.x, 0.0, left.y), seconds.min(0.1));
        }
    }

    /// Mouse and keys of somebody who walks.
    pub fn walk(&mut self, ui: &Ui, response: &Response, session: &mut Session) {
        let has_keys = !ui.ctx().egui_wants_keyboard_input();
        let is_down = |key| has_keys && ui.input(|input| input.key_down(key));
        let axis = |more: Key, less: Key| {
            f32::from(u8::from(is_down(more))) - f32::from(u8::from(is_down(less)))
        };
        let keys = Vec2::new(axis(Key::D, Key::A), axis(Key::W, Key::S));
        let stick = self.before.left;
        session.intent = Intent {
            way: (keys + stick).clamp_length_max(1.0),
            runs: ui.input(|input| input.modifiers.shift) || stick.length() > RUNS,
            jumps: session.intent.jumps,
        };
        let is_free = ui.input(|input| input.key_pressed(Key::Escape) || !input.focused);
        if self.is_captured && is_free {
            self.release(ui);
        } else if response.clicked() && cfg!(not(target_arch = "wasm32")) {
            self.capture(ui);
        }
        if self.is_captured {
            let motion = ui.input(|input| input.pointer.motion()).unwrap_or_default();
            if motion != egui::Vec2::ZERO {
                session
                    .camera
                    .look(Vec2::new(motion.x, -motion.y) * PER_COUNT);
            }
            hold(ui, response.rect);
        } else {
            let drag = response.drag_delta() / response.rect.height().max(1.0);
            if drag != egui::Vec2::ZERO {
                let field = session.camera.field_of_view().unwrap_or(60.0).to_radians();
                // As with a captured mouse, only faster, so that a drag turns around.
                session
                    .camera
                    .look(Vec2::new(drag.x, -drag.y) * (2.0 * field));
            }
        }
    }

    /// Whether the mouse turns the view, and picks nothing.
    pub fn has_mouse(&self) -> bool {
        self.is_captured
    }

    fn capture(&mut self, ui: &Ui) {
        self.is_captured = true;
        // The one or the other, as the system has it.
        for grab in [CursorGrab::Confined, CursorGrab::Locked] {
            ui.ctx()
                .send_viewport_cmd(ViewportCommand::CursorGrab(grab));
        }
        ui.ctx()
            .send_viewport_cmd(ViewportCommand::CursorVisible(false));
    }

    /// Gives the mouse back.
    pub fn release(&mut self, ui: &Ui) {
        if std::mem::take(&mut self.is_captured) {
            let context = ui.ctx();
            context.send_viewport_cmd(ViewportCommand::CursorGrab(CursorGrab::None));
            context.send_viewport_cmd(ViewportCommand::CursorVisible(true));
        }
    }
}

/// Whether a key has gone down. A key that is held throws one ball, not a stream of them.
fn is_pressed(ui: &Ui, wanted: Key) -> bool {
    let goes_down = |event: &Event| {
        let &Event::Key {
            key,
            pressed,
            repeat,
            ..
        } = event
        else {
            return false;
        };
        key == wanted && pressed && !repeat
    };
    ui.input(|input| input.events.iter().any(goes_down))
}

/// Keeps a hidden mouse away from the controls, where a click would do something that nobody sees.
fn hold(ui: &Ui, rect: Rect) {
    let is_astray = ui.input(|input| {
        let at = input.pointer.latest_pos();
        at.is_some_and(|at| !rect.shrink(rect.height() / 4.0).contains(at))
    });
    if is_astray {
        let command = ViewportCommand::CursorPosition(rect.center());
        ui.ctx().send_viewport_cmd(command);
    }
}
