//! Encodes baked texels as PNG textures.

use glam::Vec3;
use image::codecs::hdr::HdrEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, Rgb};
use serde_json::json;

use super::json::object;
use super::output::Output;
use super::parts::Parts;
use crate::atlas::Atlas;
use crate::export::{BakedLight, BakedPage, ExportError, LightmapQuantity};
use crate::image::srgb_from_linear;

/// Hubs' extension for textures of floating point.
const RGBE: &str = "MOZ_texture_rgbe";

/// How a texture stores values between 0 and 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    /// By the sRGB curve, which puts the precision where the eye notices differences.
    Srgb,
    Linear,
    LinearAndHdr,
}

/// The texture indices of a page.
pub struct PageTextures {
    pub obscurance: Option<usize>,
    pub colored_obscurance: Option<usize>,
    pub light: Option<LightTexture>,
    /// The extras of materials that say where the texels are, for what is stored for these.
    pub stored: Option<&'static str>,
}

/// The texture for a [`BakedLight`].
pub enum LightTexture {
    Unlit {
        texture: usize,
    },
    /// A texel of 1 stands for a radiance equal to the instance's scale [W/sr/m^2].
    Emissive {
        texture: usize,
    },
    /// A texel of 1 stands for as much of the quantity as the instance's scale says [W/m^2].
    Lightmap {
        texture: usize,
        quantity: LightmapQuantity,
        /// As in [`BakedLight::Lightmap`].
        file: String,
    },
}

/// Adds the textures of all `pages`. Also returns, per instance of `atlas`, the value that a texel of 1 stands for if
/// the light is scaled, and 1 otherwise.
pub fn add_pages(
    output: &mut Output,
    atlas: &Atlas,
    pages: &[BakedPage],
    stored: Option<&'static str>,
) -> Result<(Vec<PageTextures>, Vec<f32>), ExportError> {
    let is_empty = |page: &BakedPage| *page == BakedPage::default();
    let sampler = if pages.iter().all(is_empty) {
        0
    } else {
        // Clamp to edge, and no mip levels, because they would mix charts.
        output.json.push(
            "samplers",
            json!({ "magFilter": 9729, "minFilter": 9729, "wrapS": 33_071, "wrapT": 33_071 }),
        )?
    };
    let pages = pages.iter().enumerate();
    let mut writer = Writer {
        output,
        sampler,
        size: atlas.size,
        place: String::new(),
        page: 0,
        atlas,
        stored,
        scales: vec![1.0; atlas.instances.len()],
    };
    let pages = pages.map(|(number, page)| {
        writer.page = number;
        writer.place = format!("pages[{number}]");
        writer.page(page)
    });
    let pages = pages.collect::<Result<_, _>>()?;
    Ok((pages, writer.scales))
}

struct Writer<'a> {
    output: &'a mut Output,
    sampler: usize,
    size: u32,
    place: String,
    page: usize,
    atlas: &'a Atlas,
    stored: Option<&'static str>,
    /// Per instance.
    scales: Vec<f32>,
}

impl Writer<'_> {
    fn page(&mut self, page: &BakedPage) -> Result<PageTextures, ExportError> {
        let obscurance = match &page.obscurance {
            Some(texels) => Some(self.obscurance(texels)?),
            None => None,
        };
        let colored_obscurance = match &page.colored_obscurance {
            Some(texels) => Some(self.colored_obscurance(texels)?),
            None => None,
        };
        let light = match &page.light {
            None => None,
            Some(BakedLight::Unlit(texels)) => Some(LightTexture::Unlit {
                texture: self.unlit(texels)?,
            }),
            Some(BakedLight::Emissive(radiance)) => Some(LightTexture::Emissive {
                texture: self.scaled("radiance", radiance, Encoding::Srgb)?,
            }),
            Some(BakedLight::Lightmap {
                texels,
                quantity,
                with_hdr,
                file,
            }) => {
                let encoding = match with_hdr {
                    true => Encoding::LinearAndHdr,
                    false => Encoding::Linear,
                };
                Some(LightTexture::Lightmap {
                    texture: self.scaled("lightmap", texels, encoding)?,
                    quantity: *quantity,
                    file: file.clone(),
                })
            }
        };
        Ok(PageTextures {
            obscurance,
            colored_obscurance,
            light,
            stored: self.stored,
        })
    }

    fn obscurance(&mut self, texels: &[f32]) -> Result<usize, ExportError> {
        self.check("obscurance", texels.len())?;
        let bytes: Vec<u8> = texels.iter().copied().map(byte).collect();
        self.png("obscurance", &bytes, ExtendedColorType::L8)
    }

    fn colored_obscurance(&mut self, texels: &[Vec3]) -> Result<usize, ExportError> {
        self.check("coloured obscurance", texels.len())?;
        let bytes: Vec<u8> = texels.iter().flat_map(|t| t.to_array().map(byte)).collect();
        self.png("coloured obscurance", &bytes, ExtendedColorType::Rgb8)
    }

    fn unlit(&mut self, texels: &[[u8; 4]]) -> Result<usize, ExportError> {
        self.check("unlit radiance", texels.len())?;
        if texels.iter().any(|texel| texel[3] < 255) {
            return self.png(
                "unlit radiance",
                texels.as_flattened(),
                ExtendedColorType::Rgba8,
            );
        }
        let opaque: Vec<u8> = texels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
        self.png("unlit radiance", &opaque, ExtendedColorType::Rgb8)
    }

    /// Encodes values divided by a scale per instance, so that dim instances do not lose precision to bright ones
    /// elsewhere. Dithering spreads the rounding error over neighbouring texels, so that dim light beside a bright spot
    /// shows no bands.
    fn scaled(
        &mut self,
        what: &str,
        values: &[Vec3],
        encoding: Encoding,
    ) -> Result<usize, ExportError> {
        self.check(what, values.len())?;
        let finite = |value: &Vec3| {
            if value.is_finite() {
                *value
            } else {
                Vec3::ZERO
            }
        };
        let mut parts = Parts::new(self.atlas, self.page as u32);
        let mut scales = vec![0.0_f32; parts.count];
        for (value, part) in values.iter().zip(&parts.of_texels) {
            if let Some(scale) = scales.get_mut(*part as usize) {
                *scale = scale.max(finite(value).max_element());
            }
        }
        scales
            .iter_mut()
            .for_each(|scale| *scale = step_above(*scale));
        for &(instance, part) in &parts.of_instances {
            self.scales[instance] = scales[part];
        }
        parts.spread();
        let texels = values.iter().zip(&parts.of_texels).map(|(value, part)| {
            let scale = scales.get(*part as usize).copied().unwrap_or(0.0);
            let scale = if scale > 0.0 { scale } else { 1.0 };
            (finite(value) / scale).clamp(Vec3::ZERO, Vec3::ONE)
        });
        let texels: Vec<Vec3> = texels.collect();
        let encode = |value: f32| match encoding {
            Encoding::Srgb => srgb_from_linear(value),
            Encoding::Linear | Encoding::LinearAndHdr => value,
        };
        let bytes: Vec<u8> = texels
            .iter()
            .enumerate()
            .flat_map(|(texel, value)| {
                let offset = dither(texel as u32 % self.size, texel as u32 / self.size);
                value
                    .to_array()
                    .map(|value| dithered(encode(value), offset))
            })
            .collect();
        let texture = self.png(what, &bytes, ExtendedColorType::Rgb8)?;
        if encoding == Encoding::LinearAndHdr {
            self.hdr(what, texture, &texels)?;
        }
        Ok(texture)
    }

    /// Adds the same texels in floating point to a texture, for programs that read MOZ_texture_rgbe.
    fn hdr(&mut self, what: &str, texture: usize, texels: &[Vec3]) -> Result<(), ExportError> {
        let texels: Vec<_> = texels.iter().map(|texel| Rgb(texel.to_array())).collect();
        let mut hdr = Vec::new();
        HdrEncoder::new(&mut hdr)
            .encode(&texels, self.size as usize, self.size as usize)
            .map_err(|reason| ExportError::new(&self.place, reason))?;
        let name = format!("baked {what} {}", self.page);
        let image = self.output.image(&name, &hdr, "image/vnd.radiance")?;
        let texture = self.output.json.at("textures", texture)?;
        object(texture, "extensions").insert(RGBE.to_owned(), json!({ "source": image }));
        self.output.json.uses(RGBE)
    }

    fn check(&self, what: &str, texels: usize) -> Result<(), ExportError> {
        let size = u64::from(self.size);
        if size == 0 || size * size != texels as u64 {
            return Err(ExportError::new(
                &self.place,
                format!("{texels} texels of {what} for {size} x {size}"),
            ));
        }
        Ok(())
    }

    fn png(
        &mut self,
        what: &str,
        bytes: &[u8],
        kind: ExtendedColorType,
    ) -> Result<usize, ExportError> {
        let png = png(self.size, self.size, bytes, kind)
            .map_err(|reason| ExportError::new(&self.place, reason))?;
        let name = format!("baked {what} {}", self.page);
        self.output.texture(&name, &png, self.sampler)
    }
}

/// Encodes a PNG file.
pub fn png(
    width: u32,
    height: u32,
    bytes: &[u8],
    kind: ExtendedColorType,
) -> Result<Vec<u8>, String> {
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(bytes, width, height, kind)
        .map_err(|error| error.to_string())?;
    Ok(png)
}

/// The smallest power of the fourth root of 2 that is not below `value`; 0 for 0. Rounding lets instances of similar
/// brightness share materials.
fn step_above(value: f32) -> f32 {
    if value > 0.0 {
        let step = ((value.log2() * 4.0).ceil() / 4.0).exp2();
        step.clamp(f32::MIN_POSITIVE, f32::MAX)
    } else {
        0.0
    }
}

/// 0..1 in 8 bits; NaN becomes 0.
fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Interleaved gradient noise (Jimenez 2014), 0 to 1: distributed as evenly over small neighbourhoods as over the whole
/// image.
fn dither(x: u32, y: u32) -> f32 {
    let at = 0.067_110_56 * x as f32 + 0.005_837_15 * y as f32;
    (52.982_918 * at.fract()).fract()
}

/// Converts an encoded value to 8 bits, rounded up or down depending on `offset`; exact values are kept.
fn dithered(encoded: f32, offset: f32) -> u8 {
    (encoded * 255.0 + 0.01 + 0.98 * offset)
        .floor()
        .clamp(0.0, 255.0) as u8
}
