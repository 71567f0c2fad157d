//! The maps that techniques keep: a small picture of each, and windows with whole ones.

use std::collections::BTreeMap;
use std::time::Duration;

use eframe::egui::{
    self, CollapsingHeader, Color32, ColorImage, ComboBox, Context, DragValue, Image,
    TextureHandle, TextureOptions, Ui, Vec2,
};
use gpugi::gpu::Gpu;
use gpugi::techniques::{Map, MapRead};
use web_time::Instant;

use crate::session::Session;

/// Most texels along a side of a small picture, and of a large one.
const SMALL: u32 = 40;
const LARGE: u32 = 1024;
/// Larger maps have no small picture: reading them would be seen as a pause (bytes).
const MOST_SMALL_BYTES: u64 = 64 << 20;
/// Time after which a picture is read again.
const REFRESH: Duration = Duration::from_secs(1);

/// Which numbers of a texel are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Channel {
    All,
    One(usize),
}

/// Values of a texel that are shown as black and as white.
type Range = [f32; 2];

/// A map's texels on the host.
#[derive(Debug)]
struct Texels {
    size: [u32; 2],
    values: Vec<f32>,
}

/// Pictures of maps.
#[derive(Default)]
pub struct Maps {
    small: BTreeMap<String, TextureHandle>,
    reading: Option<(String, MapRead)>,
    windows: Vec<Window>,
}

/// A window with a map.
struct Window {
    name: String,
    layer: u32,
    level: u32,
    channel: Channel,
    /// `None`: what suits the texels.
    range: Option<Range>,
    read: Option<MapRead>,
    texels: Option<Texels>,
    picture: Option<TextureHandle>,
    since: Instant,
}

impl Maps {
    /// Forgets all pictures: another scene is on show.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The list of all maps; a click on one opens its window.
    pub fn list(&mut self, ui: &mut Ui, session: &Session) {
        CollapsingHeader::new("Maps").show(ui, |ui| {
            let maps = session.loaded().renderer.maps();
            if maps.is_empty() {
                ui.weak("no technique keeps any");
            }
            self.read_next(ui.ctx(), session.gpu(), &maps);
            for map in &maps {
                ui.horizontal(|ui| {
                    let side = Vec2::splat(SMALL as f32);
                    let clicked = match self.small.get(&map.name) {
                        Some(picture) => {
                            let image = Image::new(picture).fit_to_exact_size(side);
                            ui.add(egui::Button::image(image)).clicked()
                        }
                        None => ui.add_sized(side, egui::Button::new("")).clicked(),
                    };
                    let bytes = map.bytes() as f64 / f64::from(1 << 20);
                    let text = format!("{}\n{bytes:.1} MiB", map.name);
                    if ui.link(text).clicked() || clicked {
                        self.open(&map.name);
                    }
                });
            }
        });
    }

    /// The windows.
    pub fn windows(&mut self, context: &Context, session: &Session) {
        let maps = session.loaded().renderer.maps();
        self.windows.retain_mut(|window| {
            let map = maps.iter().find(|map| map.name == window.name);
            let mut is_open = map.is_some();
            if let Some(map) = map {
                egui::Window::new(&window.name)
                    .open(&mut is_open)
                    .default_pos([340.0, 20.0])
                    .default_size([360.0, 420.0])
                    .show(context, |ui| window.show(ui, session.gpu(), map));
            }
            is_open
        });
    }

    fn open(&mut self, name: &str) {
        if self.windows.iter().all(|window| window.name != name) {
            self.windows.push(Window {
                name: name.to_owned(),
                layer: 0,
                level: 0,
                channel: Channel::All,
                range: None,
                read: None,
                texels: None,
                picture: None,
                since: Instant::now(),
            });
        }
    }

    /// Small pictures are made one after the other.
    fn read_next(&mut self, context: &Context, gpu: &Gpu, maps: &[Map]) {
        if let Some((name, read)) = &self.reading {
            context.request_repaint_after(Duration::from_millis(50));
            let Some(values) = read.get() else { return };
            let size = read.size;
            let values = values.unwrap_or_default();
            let texels = Texels { size, values };
            let image = texels.image(SMALL, Channel::All, texels.range());
            let picture = context.load_texture(name, image, TextureOptions::LINEAR);
            self.small.insert(name.clone(), picture);
            self.reading = None;
        }
        let is_missing =
            |map: &&Map| !self.small.contains_key(&map.name) && map.bytes() <= MOST_SMALL_BYTES;
        if let Some(map) = maps.iter().find(is_missing) {
            let read = map.begin_read(gpu, 0, 0);
            self.reading = read.ok().map(|read| (map.name.clone(), read));
            context.request_repaint();
        }
    }
}

impl Window {
    fn show(&mut self, ui: &mut Ui, gpu: &Gpu, map: &Map) {
        let (mut is_other, mut is_changed) = (false, false);
        ui.horizontal(|ui| {
            if map.layers() > 1 {
                let layer = DragValue::new(&mut self.layer).range(0..=map.layers() - 1);
                is_other |= ui.add(layer.prefix("layer ")).changed();
            }
            if map.levels() > 1 {
                let level = DragValue::new(&mut self.level).range(0..=map.levels() - 1);
                is_other |= ui.add(level.prefix("mip ")).changed();
            }
            let channels = [
                (Channel::All, "RGB"),
                (Channel::One(0), "R"),
                (Channel::One(1), "G"),
                (Channel::One(2), "B"),
            ];
            let chosen = channels
                .iter()
                .find(|(channel, _)| *channel == self.channel);
            ComboBox::from_id_salt("channel")
                .width(50.0)
                .selected_text(chosen.map_or("", |(_, text)| text))
                .show_ui(ui, |ui| {
                    for (channel, text) in channels {
                        let chosen = ui.selectable_value(&mut self.channel, channel, text);
                        is_changed |= chosen.changed();
                    }
                });
        });
        self.layer = self.layer.min(map.layers() - 1);
        self.level = self.level.min(map.levels() - 1);
        let found = self.texels.as_ref().map_or([0.0, 1.0], Texels::range);
        ui.horizontal(|ui| {
            let mut is_automatic = self.range.is_none();
            let mut range = self.range.unwrap_or(found);
            let mut changed = ui.checkbox(&mut is_automatic, "auto").changed();
            let speed = f64::from((range[1] - range[0]).abs().max(1e-6)) * 0.01;
            for (value, prefix) in range.iter_mut().zip(["black ", "white "]) {
                let drag = DragValue::new(value).speed(speed).prefix(prefix);
                changed |= ui.add_enabled(!is_automatic, drag).changed();
            }
            if changed {
                self.range = (!is_automatic).then_some(range);
                is_changed = true;
            }
        });
        is_changed |= self.follow(gpu, map, is_other);
        ui.ctx().request_repaint_after(Duration::from_millis(100));
        let Some(texels) = &self.texels else {
            ui.label("reading");
            return;
        };
        if is_changed || self.picture.is_none() {
            let range = self.range.unwrap_or_else(|| texels.range());
            let image = texels.image(LARGE, self.channel, range);
            let options = TextureOptions::NEAREST;
            self.picture = Some(ui.ctx().load_texture(&self.name, image, options));
        }
        let [width, height] = texels.size;
        ui.label(format!(
            "{width} x {height} texels, smallest to largest {:.4} to {:.4}",
            found[0], found[1]
        ));
        if let Some(picture) = &self.picture {
            ui.add(Image::new(picture).shrink_to_fit());
        }
    }

    /// Reads the texels from time to time, and at once if it is those of another layer. Returns whether there are new
    /// ones.
    fn follow(&mut self, gpu: &Gpu, map: &Map, is_other: bool) -> bool {
        let is_due = self.texels.is_none() || self.since.elapsed() > REFRESH;
        if is_other || (self.read.is_none() && is_due) {
            self.read = map.begin_read(gpu, self.layer, self.level).ok();
            self.since = Instant::now();
        }
        let Some(read) = &self.read else { return false };
        let Some(values) = read.get() else {
            return false;
        };
        let (size, values) = (read.size, values.unwrap_or_default());
        self.texels = Some(Texels { size, values });
        self.read = None;
        true
    }
}

impl Texels {
    /// The smallest and, but for a hundredth of them, the largest number.
    fn range(&self) -> Range {
        let finite = self
            .values
            .iter()
            .copied()
            .filter(|value| value.is_finite());
        // As many as matter to a picture.
        let step = (self.values.len() / (1 << 16)).max(1);
        let mut some: Vec<f32> = finite.step_by(step).collect();
        some.sort_unstable_by(f32::total_cmp);
        match some.as_slice() {
            [] => [0.0, 1.0],
            [first, ..] => {
                let last = some[(some.len() - 1) * 99 / 100].max(some[some.len() / 2]);
                [
                    first.min(0.0),
                    if last > *first { last } else { first + 1.0 },
                ]
            }
        }
    }

    /// A picture of at most `most` texels along a side.
    fn image(&self, most: u32, channel: Channel, [black, white]: Range) -> ColorImage {
        let [width, height] = self.size;
        let step = width.max(height).div_ceil(most).max(1);
        let [columns, rows] = [width.div_ceil(step), height.div_ceil(step)];
        let shown = |value: f32| {
            let part = (value - black) / (white - black);
            let linear = if part.is_nan() {
                0.0
            } else {
                part.clamp(0.0, 1.0)
            };
            egui::ecolor::gamma_u8_from_linear_f32(linear)
        };
        let texel = |index: u32| {
            let (x, y) = (index % columns * step, index / columns * step);
            let first = 3 * (y as usize * width as usize + x as usize);
            let Some(&[r, g, b]) = self
                .values
                .get(first..first + 3)
                .and_then(|rgb| rgb.first_chunk())
            else {
                return Color32::BLACK;
            };
            match channel {
                Channel::All => Color32::from_rgb(shown(r), shown(g), shown(b)),
                Channel::One(index) => Color32::from_gray(shown([r, g, b][index])),
            }
        };
        let pixels = (0..columns * rows).map(texel).collect();
        ColorImage::new([columns as usize, rows as usize], pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_shows_every_so_many_texels_within_the_range() {
        let grey = |value: f32| [value; 3];
        let values: Vec<f32> = (0..8).flat_map(|index| grey(index as f32)).collect();
        let texels = Texels {
            size: [4, 2],
            values,
        };
        assert_eq!(texels.range(), [0.0, 7.0]);
        let image = texels.image(2, Channel::All, [0.0, 2.0]);
        assert_eq!(image.size, [2, 1]);
        assert_eq!(image.pixels, [Color32::BLACK, Color32::WHITE]);
        let one = texels.image(4, Channel::One(1), [0.0, 7.0]);
        assert_eq!((one.size, one.pixels[7]), ([4, 2], Color32::WHITE));
        let none = Texels {
            size: [2, 2],
            values: vec![f32::NAN; 12],
        };
        assert_eq!(
            none.image(2, Channel::All, none.range()).pixels,
            [Color32::BLACK; 4]
        );
    }
}
