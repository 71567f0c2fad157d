//! Controls for the settings of a technique or an effect, made from their one statement.

use eframe::egui::{self, ComboBox, DragValue, Slider, TextEdit, Ui};
use gpugi::settings::{Field, Kind, SettingSet};

use super::Action;

/// A control per setting of the technique or effect `name`; a value other than the default has a button that resets it.
pub fn settings(ui: &mut Ui, name: &str, settings: &dyn SettingSet, actions: &mut Vec<Action>) {
    let values = settings.to_json();
    egui::Grid::new(name).num_columns(3).show(ui, |ui| {
        for field in settings.fields() {
            let mut help = field.help.clone();
            if !field.values().is_empty() {
                help = format!("{help}\n{}", field.values());
            }
            ui.label(&field.name).on_hover_text(help);
            let value = &values[&field.name];
            let mut changed = control(ui, name, field, value);
            let is_default = is_same(value, &field.default);
            let reset = egui::Button::new("reset").small();
            if ui.add_enabled(!is_default, reset).clicked() {
                changed = Some(text_of(&field.default));
            }
            ui.end_row();
            if let Some(value) = changed {
                let setting = [name.to_owned(), field.name.clone(), value];
                actions.push(Action::Set(setting));
            }
        }
    });
}

/// Numbers may be whole in one place and not in the other.
fn is_same(a: &serde_json::Value, b: &serde_json::Value) -> bool {
    a == b || a.as_f64().zip(b.as_f64()).is_some_and(|(a, b)| a == b)
}

fn text_of(value: &serde_json::Value) -> String {
    value
        .as_str()
        .map_or_else(|| value.to_string(), str::to_owned)
}

/// Returns the new value, if people changed it.
fn control(ui: &mut Ui, owner: &str, field: &Field, value: &serde_json::Value) -> Option<String> {
    match field.kind {
        Kind::Flag => {
            let mut is_on = value.as_bool().unwrap_or_default();
            let changed = ui.checkbox(&mut is_on, "").changed();
            changed.then(|| is_on.to_string())
        }
        Kind::Choice(words) => {
            let current = value.as_str().unwrap_or_default();
            let mut chosen = None;
            ComboBox::from_id_salt((owner, &field.name))
                .selected_text(current)
                .show_ui(ui, |ui| {
                    for &word in words {
                        if ui.selectable_label(word == current, word).clicked() && word != current {
                            chosen = Some(word.to_owned());
                        }
                    }
                });
            chosen
        }
        Kind::Text => {
            let id = ui.make_persistent_id((owner, &field.name, "text"));
            let current = text_of(value);
            let mut text = ui
                .data_mut(|data| data.get_temp::<String>(id))
                .unwrap_or_else(|| current.clone());
            let edit = ui.add(TextEdit::singleline(&mut text).desired_width(110.0));
            if edit.has_focus() {
                ui.data_mut(|data| data.insert_temp(id, text));
                return None;
            }
            ui.data_mut(|data| data.remove::<String>(id));
            (edit.lost_focus() && text != current).then_some(text)
        }
        Kind::NumberOr(word) => {
            let text = text_of(value);
            let mut is_word = text == word;
            let current = text.parse().unwrap_or_default();
            ui.horizontal(|ui| {
                let is_toggled = ui.checkbox(&mut is_word, word).changed();
                let changed = ui.add_enabled_ui(!is_word, |ui| number(ui, field, current));
                match (is_toggled, is_word) {
                    (true, true) => Some(word.to_owned()),
                    (true, false) => Some(current.to_string()),
                    (false, _) => changed.inner,
                }
            })
            .inner
        }
        Kind::Integer | Kind::Number => number(ui, field, value.as_f64().unwrap_or_default()),
    }
}

fn number(ui: &mut Ui, field: &Field, current: f64) -> Option<String> {
    let is_whole = field.kind == Kind::Integer;
    let suffix = if field.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", field.unit)
    };
    let mut value = current;
    let changed = match field.range {
        Some((low, high)) if field.is_power_of_two => {
            let mut exponent = current.max(1.0).log2();
            let slider = Slider::new(&mut exponent, low.max(1.0).log2()..=high.log2())
                .integer()
                .custom_formatter(|exponent, _| format!("{}", exponent.exp2()))
                .custom_parser(|text| text.trim().parse().ok().map(f64::log2))
                .suffix(suffix);
            let changed = ui.add(slider).changed();
            value = exponent.round().exp2();
            changed
        }
        Some((low, high)) => {
            let is_wide = high > 100.0 * low.abs().max(1.0);
            let mut slider = Slider::new(&mut value, low..=high)
                .logarithmic(is_wide)
                .suffix(suffix);
            if is_whole {
                slider = slider.integer();
            }
            ui.add(slider).changed()
        }
        None => {
            let drag = DragValue::new(&mut value).suffix(suffix);
            let drag = match is_whole {
                true => drag.range(0..=u32::MAX),
                false => drag.speed(0.02),
            };
            ui.add(drag).changed()
        }
    };
    if !changed {
        return None;
    }
    Some(if is_whole {
        format!("{}", value.round())
    } else {
        // As the struct holds it: a float of 32 bits would show digits that nobody chose.
        format!("{}", value as f32)
    })
}
