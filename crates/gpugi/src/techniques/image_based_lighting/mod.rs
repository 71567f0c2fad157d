//! Image-based lighting: the environment as directional lights with shadows (tutorial section 3.2.3).
//!
//! Draws N directions in proportion to the power of the environment's texels, stratified; each is a parallel light with a depth
//! map that covers the scene, gathered by the same pass as shadow-map's lights.

use glam::{Mat3, Vec3};
use gpugi_scene::{Environment, Pixels};
use serde::{Deserialize, Serialize};

use super::shadow_map::lights::{LightList, low_discrepancy};
use super::shadow_map::shadows::Shadows;
use super::{Field, Info, Map, SettingError, Technique, settings, shadow_map};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::scene::{GpuScene, Versions};

/// What image-based lighting says of itself.
pub const INFO: Info = Info {
    name: "image-based-lighting",
    summary: "direct light of the environment with shadows",
    source: "tutorial section 3.2.3; Agarwal et al. 2003",
    paths: &[LightPaths {
        class: LightClass::Environment,
        pattern: "L[DG]E",
    }],
};

/// Settings of image-based lighting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Directions.
    pub samples: u32,
    /// Side of each direction's depth map (texels).
    pub resolution: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 128,
            resolution: 512,
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "samples",
        summary: "directions drawn from the environment",
        range: Some((1.0, 2048.0)),
    },
    Field {
        name: "resolution",
        summary: "side of a direction's depth map [texels]",
        range: Some((16.0, 4096.0)),
    },
];

/// Image-based lighting.
#[derive(Debug)]
pub struct ImageBasedLighting {
    settings: Settings,
    shadows: Shadows,
    made: Option<(Versions, Settings)>,
}

impl ImageBasedLighting {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            settings: Settings::default(),
            shadows: Shadows::new(gpu, scene)?,
            made: None,
        })
    }
}

/// A direction of an environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionSample {
    /// Unit direction toward the light, world space.
    pub toward: Vec3,
    /// Irradiance on a facing surface [W/m^2].
    pub irradiance: Vec3,
}

/// Draws `count` directions in proportion to luminance times solid angle. Each carries the same share of that power, in its texel's colour, so
/// that the sum of irradiances estimates the integral of the radiance over the sphere without bias.
pub fn sample_directions(environment: &Environment, count: u32) -> Vec<DirectionSample> {
    let (width, height) = (
        environment.image.width as usize,
        environment.image.height as usize,
    );
    let texel = |index: usize| match &environment.image.pixels {
        Pixels::Rgba32Float(data) => Vec3::from_slice(&data[index * 4..]),
        Pixels::Rgba8(data) => {
            Vec3::from_array([0, 1, 2].map(|channel| f32::from(data[index * 4 + channel]) / 255.0))
        }
    };
    let luminance = |color: Vec3| color.dot(Vec3::new(0.2126, 0.7152, 0.0722)).max(0.0);
    // Rows by their power, texels by theirs within the row.
    let step = std::f64::consts::PI / height as f64;
    let solid_angle = |row: usize| {
        std::f64::consts::TAU / width as f64
            * ((row as f64 * step).cos() - ((row + 1) as f64 * step).cos())
    };
    let row_power: Vec<f64> = (0..height)
        .map(|row| {
            let sum: f64 = (0..width)
                .map(|x| f64::from(luminance(texel(row * width + x))))
                .sum();
            sum * solid_angle(row)
        })
        .collect();
    let total: f64 = row_power.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let rotation = Mat3::from_rotation_y(environment.rotation);
    let mut before = 0.0;
    let mut row = 0;
    (0..count)
        .map(|index| {
            let at = (f64::from(index) + 0.5) / f64::from(count) * total;
            while row + 1 < height && before + row_power[row] <= at {
                before += row_power[row];
                row += 1;
            }
            let uniform = low_discrepancy(index);
            let row_total = row_power[row] / solid_angle(row);
            let mut left = f64::from(uniform.x) * row_total;
            let mut x = 0;
            while x + 1 < width {
                let power = f64::from(luminance(texel(row * width + x)));
                if left < power {
                    break;
                }
                left -= power;
                x += 1;
            }
            let radiance = texel(row * width + x);
            let phi = std::f32::consts::TAU * ((x as f32 + 0.5) / width as f32 - 0.5);
            let theta = (row as f32 + uniform.y) * step as f32;
            let local = Vec3::new(
                phi.sin() * theta.sin(),
                theta.cos(),
                -phi.cos() * theta.sin(),
            );
            let share = (total / f64::from(count)) as f32 / luminance(radiance).max(1e-20);
            DirectionSample {
                toward: (rotation * local).normalize(),
                irradiance: radiance * share * environment.intensity,
            }
        })
        .collect()
}

impl Technique for ImageBasedLighting {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        settings::set(&mut self.settings, FIELDS, name, value)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
    ) -> Result<(), GpuError> {
        let made = (scene.versions, self.settings.clone());
        if self.made.as_ref() == Some(&made) {
            return Ok(());
        }
        let mut list = LightList::default();
        if let Some(environment) = &scene.environment {
            for sample in sample_directions(environment, self.settings.samples) {
                list.add_direction(
                    -sample.toward,
                    sample.irradiance,
                    0.0,
                    self.settings.resolution,
                    &scene.bounds,
                );
            }
        }
        let gather = shadow_map::gpu::GatherSettings {
            // Many directions smooth the shadow together: few comparisons each, turned from pixel to pixel.
            taps: 4,
            // A direction's texels are coarse: see DepthViewSpec::second_depth.
            second_depth: 0,
            ..shadow_map::Settings::default().gather()
        };
        self.shadows.generate(
            frame,
            scene,
            "image-based-lighting.generate",
            &list.samples,
            list.views,
            &gather,
        )?;
        self.made = Some(made);
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        self.shadows
            .gather(frame, scene, "image-based-lighting.gather", points, target)
    }

    fn maps(&self) -> Vec<Map> {
        let atlas = self.shadows.atlas();
        atlas
            .map(|atlas| Map {
                name: "image-based-lighting.atlas".into(),
                texture: atlas.texture.clone(),
            })
            .into_iter()
            .collect()
    }
}
