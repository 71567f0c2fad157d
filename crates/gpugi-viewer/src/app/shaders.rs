//! Shaders under development: what changes on the disk is shown, and what is wrong with it over the last good picture.

use eframe::egui::{self, Align2, ScrollArea};

use crate::shader_watch::ShaderWatch;
use crate::viewer::Viewer;

/// The shaders of a window.
#[derive(Debug, Default)]
pub struct Shaders {
    /// None before the first frame; then what watches, if anything does.
    watch: Option<Option<ShaderWatch>>,
    wrong: Option<String>,
}

impl Shaders {
    /// Shows the scene with shaders that have changed, once nothing else is being opened.
    pub fn follow(&mut self, context: &egui::Context, viewer: &mut Viewer) {
        let watch = self.watch.get_or_insert_with(|| {
            let context = context.clone();
            ShaderWatch::start(move || context.request_repaint())
        });
        let is_opening = viewer.opening().is_some();
        let watch = watch.as_ref().filter(|_| !is_opening);
        match watch.and_then(ShaderWatch::latest) {
            None => {}
            Some(Ok(shaders)) => {
                self.wrong = None;
                viewer.gpu().replace_shaders(shaders);
                if let Some(session) = viewer.session() {
                    let set = session.loaded().set.clone();
                    viewer.change_set(set);
                }
            }
            Some(Err(wrong)) => self.wrong = Some(wrong),
        }
        if let Some(wrong) = &self.wrong {
            let window = egui::Window::new("a shader is wrong").default_width(640.0);
            let window = window.anchor(Align2::RIGHT_TOP, [-8.0, 8.0]);
            window.show(context, |ui| {
                ScrollArea::both().show(ui, |ui| {
                    let text = egui::RichText::new(wrong).monospace();
                    ui.add(egui::Label::new(text).extend());
                });
            });
        }
    }
}
