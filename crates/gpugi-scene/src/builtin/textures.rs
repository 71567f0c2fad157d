//! Procedural images: sRGB with alpha, tileable.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3, vec2, vec3};

use crate::{Image, Pixels};

/// An image of `size` x `size` texels; `color` returns sRGB and alpha in 0..=1 for texture coordinates.
fn image(name: &str, size: u32, color: impl Fn(Vec2) -> (Vec3, f32)) -> Image {
    let texels = (0..size * size).flat_map(|index| {
        let uv = (vec2((index % size) as f32, (index / size) as f32) + 0.5) / size as f32;
        let (rgb, alpha) = color(uv);
        rgb.extend(alpha)
            .to_array()
            .map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8)
    });
    Image {
        name: name.to_owned(),
        width: size,
        height: size,
        pixels: Pixels::Rgba8(texels.collect()),
    }
}

/// White marble with grey veins.
pub fn marble(name: &str, size: u32) -> Image {
    image(name, size, |uv| {
        let cloud = turbulence(uv);
        // Integer numbers of waves tile.
        let wave = ((uv.x * 2.0 + uv.y + 1.6 * cloud) * TAU).sin();
        let vein = (1.0 - wave.abs()).powi(6);
        let stone = vec3(0.86, 0.83, 0.78) * (0.86 + 0.2 * cloud);
        (stone.lerp(vec3(0.45, 0.42, 0.42), vein * 0.7), 1.0)
    })
}

/// Four by four stone tiles in two colours, with dark joints.
pub fn tiles(name: &str, size: u32) -> Image {
    image(name, size, |uv| {
        let scaled = uv * 4.0;
        let cell = scaled.floor();
        let to_edge = (scaled - cell).min(cell + 1.0 - scaled).min_element();
        if to_edge < 0.03 {
            return (vec3(0.28, 0.26, 0.24), 1.0);
        }
        let is_light = (cell.x + cell.y) % 2.0 == 0.0;
        let stone = if is_light {
            vec3(0.78, 0.72, 0.62)
        } else {
            vec3(0.5, 0.33, 0.25)
        };
        let own = lattice(cell.x as u32 + 4 * cell.y as u32, 7);
        (stone * (0.8 + 0.15 * own + 0.12 * turbulence(uv)), 1.0)
    })
}

/// A checkered leaf: green cells, every other one a hole.
pub fn leaf(name: &str, size: u32) -> Image {
    image(name, size, |uv| {
        let cell = (uv * 8.0).floor();
        let is_there = (cell.x + cell.y) % 2.0 == 0.0;
        let green = vec3(0.3, 0.6, 0.2) * (0.7 + 0.3 * uv.y);
        (green, if is_there { 1.0 } else { 0.0 })
    })
}

/// A tileable sum of noise octaves, in 0..=1.
fn turbulence(uv: Vec2) -> f32 {
    (0..5).map(|i| noise(uv, 4 << i) / (2 << i) as f32).sum()
}

/// Random values on a grid of `period` x `period` cells, smoothly interpolated.
fn noise(uv: Vec2, period: u32) -> f32 {
    let scaled = uv * period as f32;
    let cell = scaled.floor();
    let t = scaled - cell;
    let t = t * t * (3.0 - 2.0 * t);
    let value = |dx: u32, dy: u32| {
        let (x, y) = ((cell.x as u32 + dx) % period, (cell.y as u32 + dy) % period);
        lattice(x + y * period, period)
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    mix(
        mix(value(0, 0), value(1, 0), t.x),
        mix(value(0, 1), value(1, 1), t.x),
        t.y,
    )
}

/// A pseudo-random number in 0..1 for each pair of arguments, by an integer hash (Wellons' lowbias32).
fn lattice(index: u32, seed: u32) -> f32 {
    let mut hash = index ^ seed.wrapping_mul(0x9E37_79B9);
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x7FEB_352D);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x846C_A68B);
    (hash ^ (hash >> 16)) as f32 / u32::MAX as f32
}
