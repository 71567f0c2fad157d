//! Exports the environment's maps for other programs: cube maps in KTX2's axes, and a description of their numbers.
//! docs/techniques/environment-map.md, "Export".

use std::sync::Arc;

use gpugi_scene::image::HalfTexture;
use gpugi_scene::{Environment, Image, Scene};
use half::f16;
use serde::Serialize;

use super::Settings;
use crate::gpu::{Frame, Gpu, GpuError, TextureAspect, read_buffer, read_texture};
use crate::prefiltered::{Environments, level_roughness, phong_exponent};
use crate::scene::GpuScene;

/// The maps of one environment, without rotation and intensity.
#[derive(Debug, Clone, PartialEq)]
pub struct Baked {
    /// Radiance, a cube map with all levels [W/sr/m^2].
    pub radiance: HalfTexture,
    /// Irradiance as a function of the normal, a cube map of one level [W/m^2].
    pub irradiance: HalfTexture,
    /// Mean radiance over GGX lobes, a cube map; [`Description::glossy_levels`] lists the lobe of each level
    /// [W/sr/m^2].
    pub ggx: HalfTexture,
    /// Mean radiance over Phong lobes, likewise [W/sr/m^2].
    pub phong: HalfTexture,
    /// Over n.v (across) and roughness (down), with 0 and 1 at the centres of the outermost texels: the factors A and B
    /// of f0 and f90 that make up GGX's albedo, and the albedo of a white Phong lobe.
    pub albedo: HalfTexture,
    /// Description of the maps.
    pub description: Description,
}

/// What a program needs to know to use the maps, as written to irradiance-sh.json.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Description {
    /// Axes of the coefficients, and how the cube maps' directions relate to them.
    pub axes: &'static str,
    /// The functions Y_i of the unit direction (x, y, z).
    pub basis: [&'static str; 9],
    /// L_i = integral of L Y_i over the sphere: red, green and blue [W/m^2].
    pub radiance_coefficients: [[f32; 3]; 9],
    /// Factors by which the clamped cosine multiplies the coefficients.
    pub cosine_factors: [f32; 9],
    /// The formula for irradiance.
    pub irradiance: &'static str,
    /// Whether the Phong maps hold means over cos^(n + 1), with the surface's cosine, or over cos^n.
    pub phong_cosine: bool,
    /// Levels of the glossy maps, finest first.
    pub glossy_levels: Vec<GlossyLevel>,
}

/// The lobe that one level of the glossy maps holds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GlossyLevel {
    /// Width and height of a face (texels).
    pub side: u32,
    /// Roughness of the GGX lobe; alpha is its square.
    pub roughness: f32,
    /// Exponent n of the Phong lobe; `None` for an ideal mirror.
    pub phong_exponent: Option<f32>,
}

const AXES: &str = "Right-handed, +Y up; the centre of the equirectangular image lies toward -Z, the right of it toward +X. \
    The cube maps are in KTX2's left-handed axes: what arrives from (x, y, z) is found at (x, y, -z).";

/// Y_i of [`Description::basis`], as in shared/spherical_harmonics.wesl.
pub(crate) const BASIS: [&str; 9] = [
    "0.28209479",
    "0.48860251 y",
    "0.48860251 z",
    "0.48860251 x",
    "1.09254843 x y",
    "1.09254843 y z",
    "0.31539157 (3 z z - 1)",
    "1.09254843 x z",
    "0.54627421 (x x - y y)",
];

/// pi, 2 pi / 3, pi / 4, as in shared/spherical_harmonics.wesl.
pub(crate) const COSINE_FACTORS: [f32; 9] = {
    use std::f32::consts::{FRAC_PI_4, PI};
    const ONE: f32 = 2.0 * PI / 3.0;
    const TWO: f32 = FRAC_PI_4;
    [PI, ONE, ONE, ONE, TWO, TWO, TWO, TWO, TWO]
};

/// [`Description::irradiance`].
pub(crate) const IRRADIANCE: &str =
    "E(n) = sum over i of cosine_factors[i] radiance_coefficients[i] Y_i(n) [W/m^2]";

/// Generates the maps of an equirectangular image and reads them back.
///
/// # Errors
/// [`GpuError`].
pub fn bake(gpu: &Gpu, image: &Arc<Image>, settings: &Settings) -> Result<Baked, GpuError> {
    let mut scene = Scene::new(&image.name);
    scene.environment = Some(Environment {
        image: image.clone(),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    let scene = GpuScene::new(gpu, &scene)?;
    let (mut environments, wanted) = (Environments::default(), settings.wanted());
    let mut frame = Frame::new(gpu, false);
    environments.fill(&mut frame, &scene, wanted, |_| true)?;
    frame.submit()?;
    let maps = environments.of(gpu, &scene, wanted)?;

    // The maps are in units of the texels on the GPU. What is too bright for half floats is clamped.
    let factor = scene.environment_factor();
    let coefficients: Vec<[f32; 4]> = read_buffer(gpu, &maps.harmonics, 9 * 16)?;
    let [ggx, phong] = &maps.glossy;
    let levels = ggx.mip_level_count();
    let glossy_levels = (0..levels).map(|level| {
        let roughness = level_roughness(level, levels);
        GlossyLevel {
            side: ggx.width() >> level,
            roughness,
            phong_exponent: (level > 0).then(|| phong_exponent(roughness)),
        }
    });
    Ok(Baked {
        radiance: cube(gpu, &maps.radiance, factor)?,
        irradiance: cube(gpu, &maps.irradiance, factor)?,
        ggx: cube(gpu, ggx, factor)?,
        phong: cube(gpu, phong, factor)?,
        albedo: HalfTexture {
            size: [maps.albedo.width(), maps.albedo.height()],
            depth: 1,
            faces: 1,
            levels: vec![read_texture(gpu, &maps.albedo, TextureAspect::All, 0, 0)?],
        },
        description: Description {
            axes: AXES,
            basis: BASIS,
            radiance_coefficients: std::array::from_fn(|i| {
                let [red, green, blue, _] = coefficients[i];
                [red, green, blue].map(|value| value * factor)
            }),
            cosine_factors: COSINE_FACTORS,
            irradiance: IRRADIANCE,
            phong_cosine: settings.phong_cosine,
            glossy_levels: glossy_levels.collect(),
        },
    })
}

/// Reads all levels of a cube map, and converts it from gpugi's right-handed axes to KTX2's left-handed ones, z -> -z:
/// the faces of Z swap places, those of Y are flipped vertically, and all others are mirrored. Each face then shows the
/// surroundings as seen from inside the cube, not mirrored.
fn cube(gpu: &Gpu, texture: &wgpu::Texture, factor: f32) -> Result<HalfTexture, GpuError> {
    let mut levels = Vec::new();
    for level in 0..texture.mip_level_count() {
        let side = (texture.width() >> level) as usize;
        let mut texels = Vec::with_capacity(6 * side * side);
        for face in [0, 1, 2, 3, 5, 4] {
            let mut read: Vec<[f16; 4]> =
                read_texture(gpu, texture, TextureAspect::All, face, level)?;
            for value in read.iter_mut().flat_map(|texel| &mut texel[..3]) {
                *value = f16::from_f32((value.to_f32() * factor).min(f16::MAX.to_f32()));
            }
            let rows = read.chunks_exact(side);
            if matches!(face, 2 | 3) {
                texels.extend(rows.rev().flatten());
            } else {
                texels.extend(rows.flat_map(|row| row.iter().rev()));
            }
        }
        levels.push(texels);
    }
    Ok(HalfTexture {
        size: [texture.width(), texture.height()],
        depth: 1,
        faces: 6,
        levels,
    })
}
