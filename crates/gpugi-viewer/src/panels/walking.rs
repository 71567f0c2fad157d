//! Walking and balls.

use eframe::egui::{CollapsingHeader, Slider, Ui};

use super::Action;
use crate::game::ball::Finish;
use crate::game::player::EYE;
use crate::session::Session;

/// Whether somebody walks, and how tall; what balls are made of, and one to throw.
pub fn walking(ui: &mut Ui, session: &mut Session, actions: &mut Vec<Action>) {
    CollapsingHeader::new("Walk and balls").show(ui, |ui| controls(ui, session, actions));
}

fn controls(ui: &mut Ui, session: &mut Session, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        let height = session.eye_height();
        let mut walks = height.is_some();
        let help =
            "On the ground, among walls (key G). W A S D walk, space jumps, E uses what moves";
        if ui
            .checkbox(&mut walks, "walk")
            .on_hover_text(help)
            .changed()
        {
            actions.push(Action::Walk(walks));
        }
        if let Some(mut height) = height {
            let slider = Slider::new(&mut height, 1e-3 * EYE..=1e3 * EYE).logarithmic(true);
            let slider = ui.add(slider.text("eye").suffix(" m"));
            let help = "Height of the eye above the ground: it says how large the scene is";
            if slider.on_hover_text(help).changed()
                && let Err(reason) = session.walk(Some(height))
            {
                actions.push(Action::Complain(reason));
            }
        }
    });
    ui.horizontal(|ui| {
        let help =
            "Throws a ball (key B), the first of three after the scene is uploaded with them";
        if ui.button("throw a ball").on_hover_text(help).clicked() {
            actions.push(Action::Throw);
        }
        for finish in Finish::ALL {
            let label = ui.selectable_label(session.finish == finish, finish.name());
            if label.clicked() && session.finish != finish {
                actions.push(Action::Polish(finish));
            }
        }
    });
}
