//! Times and memory.

use std::collections::BTreeMap;

use eframe::egui::{CollapsingHeader, Color32, Grid, Rect, Sense, Ui, ecolor::Hsva, pos2, vec2};
use gpugi::techniques::Map;

use crate::session::Session;

/// Height of the graph (points).
const HEIGHT: f32 = 80.0;

/// Memory, the times of passes as a list and a graph, and the time that the CPU takes for a frame (s).
pub fn performance(ui: &mut Ui, session: &mut Session, cpu_seconds: f32) {
    let header = CollapsingHeader::new("Performance").show(ui, |ui| {
        let renderer = &session.loaded().renderer;
        let [width, height] = renderer.size();
        ui.label(format!(
            "{width} x {height} pixels on {}",
            session.gpu().adapter.name
        ));
        let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        Grid::new("memory")
            .striped(true)
            .num_columns(2)
            .show(ui, |ui| {
                let mut row = |name: &str, bytes: u64| {
                    ui.label(name);
                    ui.label(format!("{:.1} MiB", mebibytes(bytes)));
                    ui.end_row();
                };
                row("scene", renderer.scene().bytes);
                row("picture", renderer.picture_bytes());
                row("maps", renderer.maps().iter().map(Map::bytes).sum());
                row("to make maps", renderer.work_bytes());
            });
        ui.strong(format!("{:.2} ms of the CPU per frame", 1e3 * cpu_seconds));
        if !session.gpu().has_timestamps {
            ui.weak("this GPU tells no times of passes");
            return;
        }
        let times = session.pass_times.longest_first();
        if times.is_empty() {
            return;
        }
        let sum: f64 = times.iter().map(|(_, milliseconds)| milliseconds).sum();
        ui.strong(format!("{sum:.2} ms of the GPU per frame"));
        graph(ui, session.pass_times.history().iter());
        Grid::new("passes")
            .striped(true)
            .num_columns(2)
            .show(ui, |ui| {
                for (pass, milliseconds) in times {
                    ui.colored_label(color(pass), pass);
                    ui.label(format!("{milliseconds:.3} ms"));
                    ui.end_row();
                }
            });
    });
    session.is_timed = header.body_returned.is_some();
}

/// A bar per frame, in which each pass has its time and its colour.
fn graph<'a>(
    ui: &mut Ui,
    frames: impl ExactSizeIterator<Item = &'a BTreeMap<String, f64>> + Clone,
) {
    let most = frames.clone().map(|frame| frame.values().sum());
    let most = most.fold(1e-3, f64::max);
    let (_, rect) = ui.allocate_space(vec2(ui.available_width(), HEIGHT));
    let response = ui.interact(rect, ui.scope_id().with("graph"), Sense::hover());
    response.on_hover_text(format!("GPU times of the last frames, up to {most:.2} ms"));
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
    let width = rect.width() / frames.len().max(1) as f32;
    for (place, frame) in frames.enumerate() {
        let left = rect.left() + place as f32 * width;
        let mut bottom = rect.bottom();
        for (pass, milliseconds) in frame {
            let top = bottom - (milliseconds / most) as f32 * rect.height();
            let bar = Rect::from_min_max(pos2(left, top), pos2(left + width, bottom));
            painter.rect_filled(bar, 0.0, color(pass));
            bottom = top;
        }
    }
}

/// The colour of a pass, by its name, so that it stays the same whatever other passes there are.
fn color(pass: &str) -> Color32 {
    let hash = pass.bytes().fold(0_u32, |hash, byte| {
        hash.wrapping_mul(31).wrapping_add(byte.into())
    });
    let hue = hash as f32 * 0.618_034;
    Hsva::new(hue.fract(), 0.6, 0.9, 1.0).into()
}
