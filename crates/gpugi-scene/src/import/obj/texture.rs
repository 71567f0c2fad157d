//! Images to which an MTL file refers.

use std::collections::HashMap;

use glam::{Affine2, Vec2};

use crate::image::decode_color_within;
use crate::import::budget::Budget;
use crate::import::quoted;
use crate::{Image, Pixels, Resolver, Scene, Texture, TextureRef, Wrap};

/// A map statement: options and a file name.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// File name, with forward slashes.
    pub file: String,
    scale: Vec2,
    offset: Vec2,
    clamp: bool,
    /// `-bm`: strength of a normal or bump map.
    pub strength: f32,
}

impl Map {
    /// Parses the text after the keyword. Options that change the values of the image are ignored.
    pub fn parse(rest: &str) -> Self {
        let mut map = Self {
            file: String::new(),
            scale: Vec2::ONE,
            offset: Vec2::ZERO,
            clamp: false,
            strength: 1.0,
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
                    next();
                    next();
                }
                "-clamp" => map.clamp = next() == "on",
                "-bm" => map.strength = finite(next()).unwrap_or(1.0),
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
    fn uv_from_mesh(&self) -> Affine2 {
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
}

impl<'a> Textures<'a> {
    pub fn new(resolver: &'a dyn Resolver, budget: &'a Budget) -> Self {
        Self {
            resolver,
            budget,
            images: HashMap::new(),
            textures: HashMap::new(),
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

    fn image(&mut self, file: &str, scene: &mut Scene) -> Option<usize> {
        if let Some(&known) = self.images.get(file) {
            return known;
        }
        let decoded = self
            .resolver
            .read(file)
            .map_err(|reason| format!("{}: {reason}", quoted(file)))
            .and_then(|bytes| {
                self.budget.give(file, bytes.len());
                let limits = self.budget.image_limits();
                let image = decode_color_within(&quoted(file), &bytes, &limits)
                    .map_err(|error| error.to_string())?;
                self.budget.charge_image(image.byte_size())?;
                Ok(image)
            });
        let image = match decoded {
            Ok(image) => {
                scene.images.push(image.into());
                Some(scene.images.len() - 1)
            }
            Err(reason) => {
                let warning = format!("the texture is left out: {reason}");
                scene.warnings.push(warning);
                None
            }
        };
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
