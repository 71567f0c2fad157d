//! The camera's lens and shutter.

use eframe::egui::{CollapsingHeader, ComboBox, Slider, SliderClamping, Ui};

use crate::session::Session;

/// Blades that are offered; 0 is round.
const BLADES: [u32; 6] = [0, 5, 6, 7, 8, 9];
/// Longest time that is offered (s).
const LONGEST_SHUTTER: f32 = 0.1;

/// Aperture, focus, blades and shutter.
pub fn lens(ui: &mut Ui, session: &mut Session) {
    CollapsingHeader::new("Lens and shutter").show(ui, |ui| controls(ui, session));
}

fn controls(ui: &mut Ui, session: &mut Session) {
    let camera = &mut session.camera;
    let mut aperture = camera.lens().aperture;
    let largest = camera.largest_aperture();
    let slider = slider(&mut aperture, 0.0..=largest, 1e-3 * largest);
    let help =
        "Radius of the lens: the larger, the less is sharp. 0: a pinhole, which sees all sharply";
    let slider = ui.add(slider.text("aperture").suffix(" m"));
    if slider.on_hover_text(help).changed() {
        camera.set_aperture(aperture);
    }
    let before = camera.lens();
    let mut after = before;
    if before.is_pinhole() {
        session.is_focusing = false;
    } else {
        let [least, most] = camera.focus_range();
        let slider = self::slider(&mut after.focus, least..=most, least);
        let help = "How far away, along the camera's axis, things are sharp";
        ui.add(slider.text("focus").suffix(" m"))
            .on_hover_text(help);
        ui.horizontal(|ui| {
            ui.toggle_value(&mut session.is_focusing, "focus with a click")
                .on_hover_text(
                    "What you click next is sharp; so is what you click with Ctrl or Cmd",
                );
            ComboBox::from_id_salt("blades")
                .selected_text(blades_in_words(before.blades))
                .show_ui(ui, |ui| {
                    for count in BLADES {
                        ui.selectable_value(&mut after.blades, count, blades_in_words(count));
                    }
                })
                .response
                .on_hover_text(
                    "What bright points become where they are not sharp: discs, or polygons",
                );
        });
    }
    if after != before {
        camera.set_lens(after);
    }
    let mut shutter = camera.shutter();
    let slider = self::slider(&mut shutter, 0.0..=LONGEST_SHUTTER, 1e-3);
    let help = "Time for which the shutter is open: what moves meanwhile is blurred. 0: one moment";
    let slider = ui.add(slider.text("shutter").suffix(" s"));
    if slider.on_hover_text(help).changed() {
        camera.set_shutter(shutter);
    }
}

/// A slider by factors, whose first step from 0 is `step`. A value beyond it stays until it is dragged.
fn slider(value: &mut f32, range: std::ops::RangeInclusive<f32>, step: f32) -> Slider<'_> {
    Slider::new(value, range)
        .logarithmic(true)
        .smallest_positive(f64::from(step))
        .clamping(SliderClamping::Edits)
}

fn blades_in_words(blades: u32) -> String {
    match blades {
        0 => "round".to_owned(),
        blades => format!("{blades} blades"),
    }
}
