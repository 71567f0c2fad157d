//! The light table that next-event estimation samples.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use gpugi_scene::{AlphaMode, LightKind, Scene};

use super::alias;
use super::light_tree::{self, Bound};
use crate::gpu::{Gpu, GpuError};
use crate::light_paths::LightClass;
use crate::lights::gpu::cone;
use crate::scene::{Emitter, GpuScene};

/// `Light` of paths/light_table.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Light {
    pub position: [f32; 3],
    pub kind: u32,
    pub direction: [f32; 3],
    pub instance: u32,
    pub edge: [f32; 3],
    pub primitive: u32,
    pub emission: [f32; 3],
    pub probability: f32,
    pub threshold: f32,
    pub alias_row: u32,
    pub flags: u32,
    pub radius: f32,
    pub cone_scale: f32,
    pub cone_end: f32,
    pub inverse_range_squared: f32,
    pub leaf: u32,
}

const POINT: u32 = 0;
const SPOT: u32 = 1;
pub const DIRECTIONAL: u32 = 2;
pub const TRIANGLE: u32 = 3;
pub const SKY: u32 = 4;
const NONE: u32 = u32::MAX;
/// Words of `emitter_rows` before those of instances.
const HEADER: usize = 4;

const TWO_SIDED: u32 = 1;
const TEXTURED: u32 = 2;
/// The light tracer finds this triangle's paths LS.*[DV]E.
pub const LIGHT_TRACED: u32 = 4;

/// The lights of a scene, ready for upload.
#[derive(Debug)]
pub struct LightTable {
    /// The rows; empty if no selectable light emits.
    pub rows: Vec<Light>,
    /// `emitter_rows` of paths/light_tree.wesl, with the tree.
    pub emitter_rows: Vec<u32>,
    /// Probability of choosing the sky.
    pub sky_probability: f32,
}

impl LightTable {
    /// Builds the table from the lights of the given classes. `sky`: [`super::sky::Sky::luminance`].
    pub fn new(scene: &GpuScene, classes: &[LightClass], sky: f64) -> Self {
        let kept = scene.kept();
        let mut rows = Vec::new();
        // Powers of nearby lights (W), and irradiances of infinitely distant lights. The two have no common measure.
        let mut powers = Vec::new();
        let mut bounds = Vec::new();
        if classes.contains(&LightClass::Punctual) {
            for light in &scene.lights {
                rows.push(punctual_row(light));
                powers.push(punctual_power(light));
                bounds.push(punctual_bound(light));
            }
        }
        let mut emitter_rows = vec![NONE; HEADER + kept.instances.len()];
        if classes.contains(&LightClass::Area) {
            for emitter in &scene.emitters {
                let instance = emitter.instance as usize;
                // Only rays find out how much of an emitter with alpha exists, so rays must hit it; next-event
                // estimation skips it.
                let material = &kept.materials[kept.instances[instance].material];
                if material.alpha_mode != AlphaMode::Opaque {
                    continue;
                }
                if emitter_rows[HEADER + instance] == NONE {
                    let first = emitter_rows.len() - HEADER;
                    emitter_rows[HEADER + instance] = first as u32;
                    let mesh = &kept.meshes[kept.instances[instance].mesh];
                    emitter_rows.resize(emitter_rows.len() + mesh.indices.len() / 3, NONE);
                }
                let first = emitter_rows[HEADER + instance];
                emitter_rows[HEADER + (first + emitter.primitive) as usize] = rows.len() as u32;
                rows.push(triangle_row(kept, emitter));
                powers.push(emitter.power());
                let radiance = f64::from(emitter.luminance());
                bounds.push(Bound::of_triangle(
                    emitter.corners,
                    radiance,
                    emitter.two_sided,
                ));
            }
        }
        if classes.contains(&LightClass::Environment)
            && let Some(environment) = &scene.environment
        {
            rows.push(Light {
                kind: SKY,
                ..Zeroable::zeroed()
            });
            powers.push(sky * f64::from(environment.intensity) / 2.0);
        }
        let mut table = Self {
            rows,
            emitter_rows,
            sky_probability: 0.0,
        };
        table.choose(&powers);
        table.plant(&bounds);
        table
    }

    /// Adds the tree over the lights that are near, whose `bounds` are those of the first rows.
    fn plant(&mut self, bounds: &[Bound]) {
        let of_rows = self.rows.iter().zip(0..).zip(bounds);
        let near: Vec<_> = of_rows
            .filter(|((row, _), bound)| {
                !is_far(row) && row.probability > 0.0 && bound.intensity > 0.0
            })
            .map(|((_, index), bound)| (index, *bound))
            .collect();
        let far = self.rows.iter().filter(|row| is_far(row));
        let of_far: f32 = far.map(|row| row.probability).sum();
        let share = match (near.is_empty(), of_far > 0.0) {
            (true, _) => 0.0,
            (false, true) => 1.0 - of_far,
            (false, false) => 1.0,
        };
        let (nodes, leaves) = light_tree::build(&near);
        for row in &mut self.rows {
            row.leaf = NONE;
        }
        for (row, node) in leaves {
            self.rows[row as usize].leaf = node;
        }
        let rows = self.emitter_rows.len().next_multiple_of(4);
        self.emitter_rows.resize(rows, NONE);
        self.emitter_rows[..2].copy_from_slice(&[rows as u32 / 4, share.to_bits()]);
        self.emitter_rows.extend(nodes);
    }

    /// Fills in the alias table. If both nearby and infinitely distant lights exist, each group gets half of the
    /// probability.
    fn choose(&mut self, powers: &[f64]) {
        let total = |far: bool| -> f64 {
            let of_kind = self.rows.iter().zip(powers);
            of_kind
                .filter(|(row, _)| is_far(row) == far)
                .map(|(_, power)| power)
                .sum()
        };
        let totals = [total(false), total(true)];
        let weights: Vec<f64> = self
            .rows
            .iter()
            .zip(powers)
            .map(|(row, power)| power / totals[usize::from(is_far(row))].max(f64::MIN_POSITIVE))
            .collect();
        let entries = alias::table(&weights);
        if entries.is_empty() {
            self.rows.clear();
            self.emitter_rows.fill(NONE);
            return;
        }
        for (row, entry) in self.rows.iter_mut().zip(entries) {
            row.threshold = entry.threshold;
            row.alias_row = entry.alias;
            row.probability = entry.probability;
            if row.kind == SKY {
                self.sky_probability = entry.probability;
            }
        }
    }
}

/// Whether a light is infinitely far away.
fn is_far(row: &Light) -> bool {
    row.kind == DIRECTIONAL || row.kind == SKY
}

/// Luminance, at least 0.
pub fn luminance(color: Vec3) -> f64 {
    f64::from(gpugi_scene::image::luminance(color)).max(0.0)
}

fn punctual_row(light: &gpugi_scene::Light) -> Light {
    let (kind, cone) = match light.kind {
        LightKind::Point => (POINT, [0.0; 2]),
        LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        } => (SPOT, cone(inner_cone_angle, outer_cone_angle)),
        LightKind::Directional => (DIRECTIONAL, [0.0; 2]),
    };
    // Light of infinitely distant lights reaches everything.
    let range = light.range.filter(|_| kind != DIRECTIONAL);
    Light {
        position: light.position().to_array(),
        kind,
        direction: light.direction().to_array(),
        emission: light.intensity.to_array(),
        radius: light.radius,
        cone_scale: cone[0],
        cone_end: cone[1],
        inverse_range_squared: range.map_or(0.0, |range| 1.0 / (range * range)),
        ..Zeroable::zeroed()
    }
}

/// Power of a point or spot light (W), or irradiance of a directional light (W/m^2).
fn punctual_power(light: &gpugi_scene::Light) -> f64 {
    let solid_angle = match light.kind {
        LightKind::Point => 4.0 * std::f64::consts::PI,
        LightKind::Spot {
            outer_cone_angle, ..
        } => std::f64::consts::TAU * (1.0 - f64::from(outer_cone_angle.cos())),
        LightKind::Directional => 1.0,
    };
    luminance(light.intensity) * solid_angle
}

fn punctual_bound(light: &gpugi_scene::Light) -> Bound {
    let cone = match light.kind {
        LightKind::Spot {
            outer_cone_angle, ..
        } => Some((light.direction(), outer_cone_angle)),
        _ => None,
    };
    let intensity = luminance(light.intensity);
    Bound::of_point(light.position(), light.radius, intensity, cone)
}

fn triangle_row(scene: &Scene, emitter: &Emitter) -> Light {
    let instance = &scene.instances[emitter.instance as usize];
    let textured = scene.materials[instance.material]
        .emissive_texture
        .is_some();
    let [a, b, c] = emitter.corners;
    let flag = |set: bool, flag: u32| if set { flag } else { 0 };
    Light {
        position: a.to_array(),
        kind: TRIANGLE,
        direction: (b - a).to_array(),
        instance: emitter.instance,
        edge: (c - a).to_array(),
        primitive: emitter.primitive,
        emission: emitter.radiance.to_array(),
        flags: flag(emitter.two_sided, TWO_SIDED) | flag(textured, TEXTURED),
        ..Zeroable::zeroed()
    }
}

/// The lights that paths are led to, on the GPU.
#[derive(Debug)]
pub struct LightBuffers {
    rows: wgpu::Buffer,
    emitter_rows: wgpu::Buffer,
    sky: wgpu::Buffer,
}

impl LightBuffers {
    /// Those of a table, and the grid of the sky ([`super::Sky::upload`]).
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, table: &LightTable, sky: wgpu::Buffer) -> Result<Self, GpuError> {
        // A binding must hold at least one element, even if it is unused.
        let unlit = [bytemuck::Zeroable::zeroed()];
        let rows: &[Light] = match table.rows.is_empty() {
            true => &unlit,
            false => &table.rows,
        };
        Ok(Self {
            rows: gpu.storage("path-tracer.lights [bytes]", rows)?,
            emitter_rows: gpu.storage("path-tracer.emitters [bytes]", &table.emitter_rows)?,
            sky,
        })
    }

    /// Those of another table under the same sky.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn with_table(&self, gpu: &Gpu, table: &LightTable) -> Result<Self, GpuError> {
        Self::new(gpu, table, self.sky.clone())
    }

    /// The buffers with their names in the shaders.
    pub fn named(&self) -> [(&'static str, &wgpu::Buffer); 3] {
        [
            ("lights", &self.rows),
            ("emitter_rows", &self.emitter_rows),
            ("sky_grid", &self.sky),
        ]
    }
}
