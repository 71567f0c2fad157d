//! Procedural images: sRGB with alpha, tileable.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3, vec2, vec3};

use crate::{Image, Pixels};

/// An image of `size` x `size` texels; `color` returns sRGB and alpha in 0..=1 for texture coordinates.
pub(super) fn image(name: &str, size: u32, color: impl Fn(Vec2) -> (Vec3, f32)) -> Image {
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

/// A point of a surface with relief.
pub(super) struct Spot {
    /// sRGB, 0..=1.
    pub color: Vec3,
    /// Height above the tile, as a fraction of its side.
    pub height: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
}

/// Base colour, normals, and metallic with roughness, as a glTF material reads them.
pub(super) struct Relief {
    pub base_color: Image,
    pub normals: Image,
    pub metallic_roughness: Image,
}

/// The images of `size` x `size` texels of a surface that tiles.
pub(super) fn relief(name: &str, size: u32, spot: impl Fn(Vec2) -> Spot) -> Relief {
    let spots: Vec<Spot> = (0..size * size)
        .map(|index| spot((vec2((index % size) as f32, (index / size) as f32) + 0.5) / size as f32))
        .collect();
    let at = |uv: Vec2, right: u32, down: u32| {
        let texel = (uv * size as f32).as_uvec2();
        let (x, y) = ((texel.x + right) % size, (texel.y + down) % size);
        &spots[(y * size + x) as usize]
    };
    // Differences over two texels, relative to the same length.
    let slope = |a: &Spot, b: &Spot| (b.height - a.height) * size as f32 / 2.0;
    let back = size - 1;
    Relief {
        base_color: image(name, size, |uv| (at(uv, 0, 0).color, 1.0)),
        normals: image(&format!("{name} normals"), size, |uv| {
            let right = slope(at(uv, back, 0), at(uv, 1, 0));
            let down = slope(at(uv, 0, back), at(uv, 0, 1));
            (vec3(-right, down, 1.0).normalize() * 0.5 + 0.5, 1.0)
        }),
        metallic_roughness: image(&format!("{name} roughness"), size, |uv| {
            let spot = at(uv, 0, 0);
            (vec3(0.0, spot.roughness, spot.metallic), 1.0)
        }),
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

/// A pointed leaf with veins; the rest is a hole.
pub(super) fn pointed_leaf(name: &str, size: u32) -> Image {
    image(name, size, |uv| {
        let from_rib = (uv.x - 0.5).abs();
        let half_width = 0.36 * (uv.y * TAU / 2.0).sin().max(0.0).powf(0.8);
        let is_stem = from_rib < 0.025 && uv.y > 0.5;
        let vein = ((uv.y - 0.8 * from_rib) * 8.0).fract();
        let is_vein = is_stem || from_rib < 0.015 || vein < 0.12;
        let green = vec3(0.36, 0.5, 0.15) * (0.75 + 0.4 * turbulence(uv));
        let color = if is_vein { green * 1.25 } else { green };
        let is_there = from_rib < half_width || is_stem;
        (color, if is_there { 1.0 } else { 0.0 })
    })
}

/// A tileable sum of noise octaves, in 0..=1.
pub(super) fn turbulence(uv: Vec2) -> f32 {
    (0..5)
        .map(|i| noise(uv, [4 << i; 2]) / (2 << i) as f32)
        .sum()
}

/// Random values on a grid of `periods` cells along u and v, smoothly interpolated.
pub(super) fn noise(uv: Vec2, periods: [u32; 2]) -> f32 {
    let [columns, rows] = periods;
    let scaled = uv * vec2(columns as f32, rows as f32);
    let cell = scaled.floor();
    let t = scaled - cell;
    let t = t * t * (3.0 - 2.0 * t);
    let value = |dx: u32, dy: u32| {
        let (x, y) = ((cell.x as u32 + dx) % columns, (cell.y as u32 + dy) % rows);
        lattice(x + y * columns, columns)
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    mix(
        mix(value(0, 0), value(1, 0), t.x),
        mix(value(0, 1), value(1, 1), t.x),
        t.y,
    )
}

/// A pseudo-random number in 0..1 for each pair of arguments, by an integer hash (Wellons' lowbias32).
pub(super) fn lattice(index: u32, seed: u32) -> f32 {
    let mut hash = index ^ seed.wrapping_mul(0x9E37_79B9);
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x7FEB_352D);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x846C_A68B);
    (hash ^ (hash >> 16)) as f32 / u32::MAX as f32
}
