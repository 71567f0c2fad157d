//! Images to which an MTL file refers.

use std::collections::HashMap;
use std::rc::Rc;

use glam::{Affine2, Vec2};

use crate::image::{Heights, decode_color_within, decode_heights_within, holds_normals};
use crate::import::budget::{Budget, ImageLimits};
use crate::import::quoted;
use crate::{Image, ImportError, Pixels, Resolver, Scene, Texture, TextureRef, Wrap};

/// A map statement: options and a file name.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// File name, with forward slashes.
    pub file: String,
    scale: Vec2,
    offset: Vec2,
    /// The border goes on outside; otherwise the image repeats.
    pub clamp: bool,
    /// `-bm`: strength of a normal or height map.
    pub strength: f32,
    /// `-mm`: what is added to the values of a height map.
    pub base: f32,
    /// `-mm`: what multiplies them before.
    pub gain: f32,
    /// Whether `-bm` or `-mm` has a value that is no finite number, which is ignored.
    pub is_broken: bool,
}

impl Map {
    /// Parses the text after the keyword. Options that change the values of the image are ignored, but for those of
    /// height maps.
    pub fn parse(rest: &str) -> Self {
        let mut map = Self {
            file: String::new(),
            scale: Vec2::ONE,
            offset: Vec2::ZERO,
            clamp: false,
            strength: 1.0,
            base: 0.0,
            gain: 1.0,
            is_broken: false,
        };
        let mut rest = rest.trim();
        while let Some((option, after)) = rest.split_once(char::is_whitespace) {
            let mut values = after.trim_start();
            let mut next = || {
                let (word, after) = values
                    .split_once(char::is_whitespace)
                    .unwrap_or((values, ""));
                values = after.trim_start();
                word
            };
            match option {
                "-blendu" | "-blendv" | "-cc" | "-texres" | "-imfchan" | "-type" | "-boost" => {
                    next();
                }
                "-mm" => {
                    let [base, gain] = [finite(next()), finite(next())];
                    map.is_broken |= base.is_none() || gain.is_none();
                    map.base = base.unwrap_or(map.base);
                    map.gain = gain.unwrap_or(map.gain);
                }
                "-clamp" => map.clamp = next() == "on",
                "-bm" => {
                    let strength = finite(next());
                    map.is_broken |= strength.is_none();
                    map.strength = strength.unwrap_or(1.0);
                }
                "-o" | "-s" | "-t" => {
                    let target = match option {
                        "-o" => &mut map.offset,
                        "-s" => &mut map.scale,
                        _ => &mut Vec2::ZERO.clone(),
                    };
                    // One to three numbers, followed by the file name.
                    for axis in 0..3 {
                        let (word, after) = values
                            .split_once(char::is_whitespace)
                            .unwrap_or((values, ""));
                        let Some(value) = finite(word) else { break };
                        if axis < 2 {
                            target[axis] = value;
                        }
                        values = after.trim_start();
                    }
                }
                _ => break,
            }
            rest = values;
        }
        map.file = rest.trim().replace('\\', "/");
        map
    }

    /// Converts texture coordinates with v downward; MTL scales and offsets those with v upward.
    pub fn uv_from_mesh(&self) -> Affine2 {
        let offset = Vec2::new(self.offset.x, 1.0 - self.scale.y - self.offset.y);
        Affine2::from_scale_angle_translation(self.scale, 0.0, offset)
    }
}

fn finite(word: &str) -> Option<f32> {
    word.parse().ok().filter(|value: &f32| value.is_finite())
}

/// Decodes each image once, and warns once about each image that cannot be used.
pub struct Textures<'a> {
    resolver: &'a dyn Resolver,
    budget: &'a Budget,
    images: HashMap<String, Option<usize>>,
    textures: HashMap<(usize, bool), usize>,
    /// Height maps, as [`Heights::into_levels`] makes them.
    heights: HashMap<String, Option<Rc<Vec<Heights>>>>,
    /// Whether files hold normals.
    normals: HashMap<String, bool>,
    normal_maps: HashMap<NormalMapKey, Option<NormalMap>>,
}

/// What decides a normal map that is made of heights: the file, whether its border goes on, and its mirrored axes.
type NormalMapKey = (String, bool, [bool; 2]);
/// Its image, and its steepest slope (heights per texel).
type NormalMap = (usize, f32);

impl<'a> Textures<'a> {
    pub fn new(resolver: &'a dyn Resolver, budget: &'a Budget) -> Self {
        Self {
            resolver,
            budget,
            images: HashMap::new(),
            textures: HashMap::new(),
            heights: HashMap::new(),
            normals: HashMap::new(),
            normal_maps: HashMap::new(),
        }
    }

    /// The texture that `map` refers to; `None`, with a warning, if it cannot be read.
    pub fn texture(&mut self, map: &Map, scene: &mut Scene) -> Option<TextureRef> {
        let image = self.image(&map.file, scene)?;
        Some(self.place(map, image, scene))
    }

    /// Combines `color` with the coverage in `alpha`: the alpha channel of `alpha` if that is not 1 everywhere,
    /// otherwise the mean of its RGB. Without `color`, the colour is white.
    pub fn with_alpha(
        &mut self,
        color: Option<&Map>,
        alpha: &Map,
        scene: &mut Scene,
    ) -> Option<TextureRef> {
        let alpha_image = self.image(&alpha.file, scene)?;
        let color_image = color.and_then(|color| self.image(&color.file, scene));
        let name = format!(
            "{} with the alpha of {}",
            color.map_or("white", |color| color.file.as_str()),
            alpha.file
        );
        let map = color.unwrap_or(alpha);
        if let Some(&Some(image)) = self.images.get(&name) {
            return Some(self.place(map, image, scene));
        }
        let coverage = &scene.images[alpha_image];
        let base = color_image.map_or(coverage, |image| &scene.images[image]);
        if let Err(reason) = self.budget.charge_image(base.byte_size()) {
            scene.warnings.push(format!("{}: {reason}", quoted(&name)));
            return None;
        }
        let combined = combine(&name, base, color_image.is_some(), coverage)?;
        scene.images.push(combined.into());
        let image = scene.images.len() - 1;
        self.images.insert(name, Some(image));
        Some(self.place(map, image, scene))
    }

    /// The normal map that a `bump` statement stands for, and its scale. Images that hold normals are used as they are.
    /// Of others, white lies `-bm` texels above black.
    pub fn bump(&mut self, map: &Map, scene: &mut Scene) -> Option<(TextureRef, f32)> {
        if self.holds_normals(&map.file, scene) {
            return Some((self.texture(map, scene)?, map.strength));
        }
        let mirrored = [map.scale.x < 0.0, map.scale.y < 0.0];
        let key = (map.file.clone(), map.clamp, mirrored);
        let made = match self.normal_maps.get(&key) {
            Some(&known) => known,
            None => {
                let made = self.normal_map(map, mirrored, scene);
                self.normal_maps.insert(key, made);
                made
            }
        };
        let (image, steepest) = made?;
        let scale = map.strength * map.gain * steepest;
        Some((self.place(map, image, scene), scale))
    }

    /// Whether an image, if it can be decoded, holds normals.
    fn holds_normals(&mut self, file: &str, scene: &Scene) -> bool {
        if let Some(&known) = self.normals.get(file) {
            return known;
        }
        let holds = match self.images.get(file) {
            Some(&known) => known.is_some_and(|image| holds_normals(&scene.images[image])),
            // What cannot be decoded is left to the decoder of heights, which reads more formats.
            None => {
                let decoded = self.decode(file, decode_color_within);
                decoded.is_ok_and(|image| holds_normals(&image))
            }
        };
        self.normals.insert(file.to_owned(), holds);
        holds
    }

    fn normal_map(&self, map: &Map, mirrored: [bool; 2], scene: &mut Scene) -> Option<NormalMap> {
        let made = self
            .decode(&map.file, decode_heights_within)
            .and_then(|heights| {
                self.budget.charge_image(heights.byte_size())?;
                let name = format!("normals of {}", map.file);
                Ok(heights.normal_map(name, map.clamp, mirrored))
            });
        let (image, steepest) = left_out(made, scene)??;
        scene.images.push(image.into());
        Some((scene.images.len() - 1, steepest))
    }

    /// The heights of a `disp` statement; `None`, with a warning, if they cannot be read.
    pub fn heights(&mut self, file: &str, scene: &mut Scene) -> Option<Rc<Vec<Heights>>> {
        if let Some(known) = self.heights.get(file) {
            return known.clone();
        }
        let decoded = self
            .decode(file, decode_heights_within)
            .and_then(|heights| {
                // All levels take a third more than the first, or as much again if it is narrow.
                self.budget.charge_image(2 * heights.byte_size())?;
                Ok(Rc::new(heights.into_levels()))
            });
        let heights = left_out(decoded, scene);
        self.heights.insert(file.to_owned(), heights.clone());
        heights
    }

    /// Reads and decodes a file.
    fn decode<T>(
        &self,
        file: &str,
        decode: impl FnOnce(&str, &[u8], &ImageLimits) -> Result<T, ImportError>,
    ) -> Result<T, String> {
        let bytes = self.resolver.read(file);
        let bytes = bytes.map_err(|reason| format!("{}: {reason}", quoted(file)))?;
        self.budget.give(file, bytes.len());
        let limits = self.budget.image_limits();
        decode(&quoted(file), &bytes, &limits).map_err(|error| error.to_string())
    }

    fn image(&mut self, file: &str, scene: &mut Scene) -> Option<usize> {
        if let Some(&known) = self.images.get(file) {
            return known;
        }
        let decoded = self.decode(file, decode_color_within).and_then(|image| {
            self.budget.charge_image(image.byte_size())?;
            Ok(image)
        });
        let image = left_out(decoded, scene).map(|image| {
            scene.images.push(image.into());
            scene.images.len() - 1
        });
        self.images.insert(file.to_owned(), image);
        image
    }

    fn place(&mut self, map: &Map, image: usize, scene: &mut Scene) -> TextureRef {
        let texture = *self.textures.entry((image, map.clamp)).or_insert_with(|| {
            let wrap = if map.clamp {
                Wrap::ClampToEdge
            } else {
                Wrap::Repeat
            };
            scene.textures.push(Texture {
                image,
                wrap: [wrap; 2],
                nearest: false,
                has_levels: true,
            });
            scene.textures.len() - 1
        });
        TextureRef {
            uv_from_mesh: map.uv_from_mesh(),
            ..TextureRef::new(texture)
        }
    }
}

/// What was read; otherwise the reason becomes a warning.
fn left_out<T>(read: Result<T, String>, scene: &mut Scene) -> Option<T> {
    read.map_err(|reason| {
        let warning = format!("the texture is left out: {reason}");
        scene.warnings.push(warning);
    })
    .ok()
}

/// An image of the size of `base`, with its colours or white. Alpha comes from the nearest texel of `coverage`.
fn combine(name: &str, base: &Image, colored: bool, coverage: &Image) -> Option<Image> {
    let (Pixels::Rgba8(colors), Pixels::Rgba8(alphas)) = (&base.pixels, &coverage.pixels) else {
        return None;
    };
    let alphas = alphas.as_chunks::<4>().0;
    let has_own_alpha = alphas.iter().any(|&[.., alpha]| alpha != 255);
    let nearest = |at: u32, size: u32, other: u32| {
        (u64::from(at) * u64::from(other) / u64::from(size)) as usize
    };
    let mut pixels = Vec::with_capacity(colors.len());
    for (index, &[r, g, b, _]) in colors.as_chunks::<4>().0.iter().enumerate() {
        let (x, y) = (index as u32 % base.width, index as u32 / base.width);
        let row = nearest(y, base.height, coverage.height) * coverage.width as usize;
        let [red, green, blue, own] = alphas[row + nearest(x, base.width, coverage.width)];
        let mean = (u16::from(red) + u16::from(green) + u16::from(blue)) / 3;
        let alpha = if has_own_alpha { own } else { mean as u8 };
        let color = if colored { [r, g, b] } else { [255; 3] };
        pixels.extend(color);
        pixels.push(alpha);
    }
    Some(Image {
        name: name.to_owned(),
        width: base.width,
        height: base.height,
        pixels: Pixels::Rgba8(pixels),
    })
}
