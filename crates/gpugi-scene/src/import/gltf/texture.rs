//! Textures and images. An image is decoded when the first material requests it.

use std::collections::HashMap;

use glam::{Affine2, Vec2};

use super::document::Document;
use super::schema::TextureInfo;
use super::uri;
use crate::image::{claimed_bytes, decode_color_within};
use crate::import::quoted;
use crate::{Image, ImportError, Pixels, Resolver, Scene, Texture, TextureRef, Wrap};

/// Extensions that name images in formats which gpugi decodes.
const OTHER_FORMATS: [&str; 2] = ["KHR_texture_basisu", "EXT_texture_webp"];

/// Indices of the decoded images and textures in the scene, by glTF index.
pub struct Textures<'a> {
    document: &'a Document<'a>,
    resolver: &'a dyn Resolver,
    /// `None` for those that are left out, with one warning each.
    textures: HashMap<usize, Option<usize>>,
    images: HashMap<usize, Option<usize>>,
    /// Roughness textures derived from glossiness, by glTF texture and the bits of the glossiness factor.
    roughness: HashMap<(usize, u32), usize>,
    /// The UV sets of the file that fill the slots of [`crate::Mesh::uvs`] for the material being read.
    pub uv_sets: [u32; 2],
}

impl<'a> Textures<'a> {
    pub fn new(document: &'a Document<'a>, resolver: &'a dyn Resolver) -> Self {
        Self {
            document,
            resolver,
            textures: HashMap::new(),
            images: HashMap::new(),
            roughness: HashMap::new(),
            uv_sets: [0, 1],
        }
    }

    /// The texture to which a material's `info` at `place` refers. `None`, with a warning, if no slot holds its UV
    /// set, or if it cannot be read.
    pub fn read(
        &mut self,
        info: Option<&TextureInfo>,
        place: &str,
        scene: &mut Scene,
    ) -> Option<TextureRef> {
        let info = info?;
        let transform = info.extensions.transform.as_ref();
        let set = info.uv_set();
        let Some(slot) = self.uv_sets.iter().position(|&other| other == set) else {
            let [first, second] = self.uv_sets;
            self.document.warn(
                place,
                format!(
                    "a material reads two UV sets, here TEXCOORD_{first} and TEXCOORD_{second}: the texture, with TEXCOORD_{set}, is left out"
                ),
            );
            return None;
        };
        let uv_from_mesh = transform.map_or(Affine2::IDENTITY, |transform| {
            // glTF rotates counter-clockwise with v pointing down, which is clockwise for glam.
            Affine2::from_scale_angle_translation(
                Vec2::from(transform.scale),
                -transform.rotation,
                Vec2::from(transform.offset),
            )
        });
        Some(TextureRef {
            texture: self.texture(info.index, place, scene)?,
            uv_set: slot as u32,
            uv_from_mesh,
        })
    }

    /// A texture whose G is roughness: 1 - `glossiness` times the alpha of a specular-glossiness texture.
    pub fn roughness(
        &mut self,
        info: &TextureInfo,
        like: TextureRef,
        glossiness: f32,
        scene: &mut Scene,
    ) -> Result<TextureRef, ImportError> {
        let key = (info.index, glossiness.to_bits());
        if let Some(&texture) = self.roughness.get(&key) {
            return Ok(TextureRef { texture, ..like });
        }
        let source = &scene.images[scene.textures[like.texture].image];
        let Pixels::Rgba8(texels) = &source.pixels else {
            return Ok(like);
        };
        let charged = self.document.budget.charge_image(texels.len());
        charged.map_err(|reason| {
            let place = format!("textures[{}]", info.index);
            let reason = format!("the roughness that its glossiness becomes: {reason}");
            self.document.error(place, reason)
        })?;
        let (texels, _) = texels.as_chunks::<4>();
        let pixels = texels.iter().flat_map(|&[.., alpha]| {
            let roughness = 255.0 - glossiness * f32::from(alpha);
            [255, roughness.round() as u8, 255, 255]
        });
        let image = Image {
            name: format!("{} (roughness)", source.name),
            width: source.width,
            height: source.height,
            pixels: Pixels::Rgba8(pixels.collect()),
        };
        let texture = Texture {
            image: scene.images.len(),
            ..scene.textures[like.texture]
        };
        scene.images.push(image.into());
        scene.textures.push(texture);
        let texture = scene.textures.len() - 1;
        self.roughness.insert(key, texture);
        Ok(TextureRef { texture, ..like })
    }

    fn texture(&mut self, index: usize, place: &str, scene: &mut Scene) -> Option<usize> {
        if let Some(&known) = self.textures.get(&index) {
            return known;
        }
        let texture = self.read_texture(index, place, scene);
        let texture = texture.unwrap_or_else(|error| self.leave_out(&error));
        let added = texture.map(|texture| {
            scene.textures.push(texture);
            scene.textures.len() - 1
        });
        self.textures.insert(index, added);
        added
    }

    fn leave_out<T>(&self, error: &ImportError) -> Option<T> {
        let what = format!("{}: the texture is left out", error.reason);
        self.document.warn(&error.place, what);
        None
    }

    /// `None` if its image is left out.
    fn read_texture(
        &mut self,
        index: usize,
        place: &str,
        scene: &mut Scene,
    ) -> Result<Option<Texture>, ImportError> {
        let document = self.document;
        let root = &document.root;
        let texture = document.get(&root.textures, "texture", index, place)?;
        let place = format!("textures[{index}]");
        // Files that have a PNG or JPEG besides have it for programs that do not decode the other one, and it is as good.
        let other = OTHER_FORMATS.iter().find_map(|name| {
            let source = texture.extensions.get(*name)?.get("source")?.as_u64()?;
            usize::try_from(source).ok()
        });
        let Some(source) = texture.source.or(other) else {
            let formats: Vec<&str> = texture.extensions.keys().map(String::as_str).collect();
            return Err(document.error(
                place,
                if formats.is_empty() {
                    "the texture names no image".to_owned()
                } else {
                    format!(
                        "the texture has no PNG or JPEG to fall back on, and gpugi does not decode {}",
                        quoted(&formats.join(", "))
                    )
                },
            ));
        };
        let sampler = match texture.sampler {
            Some(sampler) => Some(document.get(&root.samplers, "sampler", sampler, &place)?),
            None => None,
        };
        let wrap = |mode: Option<u32>| match mode {
            None | Some(10_497) => Ok(Wrap::Repeat),
            Some(33_648) => Ok(Wrap::MirroredRepeat),
            Some(33_071) => Ok(Wrap::ClampToEdge),
            Some(other) => Err(document.error(
                format!("{place}.sampler"),
                format!("{other} is no wrapping mode"),
            )),
        };
        let Some(image) = self.image(source, &place, scene) else {
            return Ok(None);
        };
        Ok(Some(Texture {
            wrap: [
                wrap(sampler.and_then(|sampler| sampler.wrap_s))?,
                wrap(sampler.and_then(|sampler| sampler.wrap_t))?,
            ],
            nearest: sampler.is_some_and(|sampler| sampler.mag_filter == Some(9728)),
            // NEAREST and LINEAR do not use mip levels.
            has_levels: !sampler
                .is_some_and(|sampler| matches!(sampler.min_filter, Some(9728 | 9729))),
            image,
        }))
    }

    fn image(&mut self, index: usize, place: &str, scene: &mut Scene) -> Option<usize> {
        if let Some(&known) = self.images.get(&index) {
            return known;
        }
        let image = self.read_image(index, place).map(Some);
        let image = image.unwrap_or_else(|error| self.leave_out(&error));
        let added = image.map(|image| {
            scene.images.push(image.into());
            scene.images.len() - 1
        });
        self.images.insert(index, added);
        added
    }

    fn read_image(&self, index: usize, place: &str) -> Result<Image, ImportError> {
        let document = self.document;
        let image = document.get(&document.root.images, "image", index, place)?;
        let place = format!("images[{index}]");
        let read;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                read = uri::read(uri, self.resolver)
                    .map_err(|reason| document.error(format!("{place}.uri"), reason))?;
                &read
            }
            (None, Some(view)) => document.view(view, &format!("{place}.bufferView"))?.0,
            (None, None) => {
                return Err(document.error(place, "the image has neither uri nor bufferView"));
            }
        };
        let label = match (&image.name, &image.uri) {
            (Some(name), _) => name.clone(),
            (None, Some(uri)) if !uri.starts_with("data:") => uri.clone(),
            _ => format!("image {index}"),
        };
        if let Some(uri) = &image.uri {
            document.given(uri, bytes.len());
        }
        let label = quoted(&label);
        let limits = document.budget.image_limits();
        let left = limits.check_bytes(1);
        left.map_err(|reason| document.error(&place, reason))?;
        let decoded = decode_color_within(&label, bytes, &limits).map_err(|error| {
            // It took as long as one that is whole; a file may name many.
            let claimed = claimed_bytes(bytes).max(bytes.len() as u64);
            document.budget.charge_broken_image(claimed);
            document.error(
                &place,
                format!("\"{label}\": {}: {}", error.place, error.reason),
            )
        })?;
        let charged = document.budget.charge_image(decoded.byte_size());
        charged.map_err(|reason| document.error(&place, reason))?;
        Ok(decoded)
    }
}
