//! Fog that shows the light of the windows, smoke above a vent, and a cloud over the courtyard.

use std::f32::consts::TAU;
use std::sync::Arc;

use glam::{Quat, Vec3, vec3};

use super::stage::Stage;
use super::{HALF, LOOP};
use crate::builtin::cloud::{cumulus, fractal_noise};
use crate::{DensityGrid, Medium, PhaseFunction};

/// Middle of the vent in the floor (m).
pub const VENT: Vec3 = vec3(-4.9, 0.0, -1.5);

pub fn add(stage: &mut Stage) {
    let motion = &mut stage.motion;
    let fog = motion.scaled(
        None,
        vec3(0.0, 2.55, 1.75),
        vec3(2.0 * HALF.x - 0.1, 5.0, 5.4),
    );
    let smoke = motion.scaled(None, VENT + Vec3::Y * 1.25, vec3(1.1, 2.4, 1.1));
    motion.turn(smoke, (LOOP, 40), |phase| {
        Quat::from_rotation_y(-phase * TAU)
    });
    motion.slide(smoke, (LOOP, 40), |phase| {
        VENT + Vec3::Y * (1.25 + 0.12 * (2.0 * phase * TAU).sin())
    });
    let above = vec3(-22.0, 8.5, 0.0);
    let cloud = motion.scaled(None, above, vec3(10.0, 3.6, 8.0));
    motion.slide(cloud, (LOOP, 40), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        above + vec3(1.5 * sine, 0.0, 3.0 * cosine)
    });
    let medium = |name: &str, node: usize, extinction: f32, g: f32| Medium {
        name: name.into(),
        world_from_box: Some(glam::Mat4::IDENTITY),
        extinction: Vec3::splat(extinction),
        albedo: Vec3::splat(0.94),
        phase: PhaseFunction::HenyeyGreenstein(g),
        emission: Vec3::ZERO,
        density: None,
        node: Some(node),
    };
    stage.scene.media = vec![
        medium("fog", fog, 0.012, 0.4),
        Medium {
            density: Some(Arc::new(plume())),
            ..medium("smoke", smoke, 5.0, 0.3)
        },
        Medium {
            density: Some(Arc::new(cumulus())),
            ..medium("cloud", cloud, 4.0, 0.6)
        },
    ];
}

/// Smoke that widens and thins as it rises.
fn plume() -> DensityGrid {
    let size = [16, 32, 16];
    let mut values = Vec::new();
    let [columns, rows, layers] = size;
    for z in 0..layers {
        for y in 0..rows {
            for x in 0..columns {
                let place = |index: u32, count: u32| (index as f32 + 0.5) / count as f32;
                let point = vec3(place(x, columns), place(y, rows), place(z, layers));
                let height = point.y;
                let sway = 0.1 * height * vec3((6.0 * height).sin(), 0.0, (5.0 * height).cos());
                let from_axis = (point - sway - vec3(0.5, height, 0.5)).length();
                let width = 0.12 + 0.28 * height;
                let body = (1.0 - from_axis / width).max(0.0);
                let wisps = 2.4 * fractal_noise(vec3(5.0, 7.0, 5.0) * point) - 0.7;
                let fade = (1.0 - height).min(1.0) * (8.0 * height).min(1.0);
                values.push((body * wisps * fade).clamp(0.0, 1.0));
            }
        }
    }
    DensityGrid { size, values }
}
