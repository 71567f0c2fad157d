//! Materials of the station, and the patterns of their textures.

use glam::{Vec2, Vec3, vec2, vec3};

use super::motion::eased;
use super::stage::Finish;
use crate::builtin::textures::{Spot, image, lattice, noise, pointed_leaf, relief, turbulence};
use crate::{AlphaMode, Image, Material, Scene, Texture, TextureRef, Volume, Wrap};

/// The materials of the scene.
pub struct Palette {
    pub stone: Finish,
    pub trim: Finish,
    pub brick: Finish,
    pub plates: Finish,
    pub paving: Finish,
    pub plaster: Finish,
    pub tiles: Finish,
    pub wood: Finish,
    pub rust: Finish,
    pub steel: Finish,
    pub brushed: Finish,
    pub paint: Finish,
    pub shell: Finish,
    pub marble: Finish,
    pub mirror: Finish,
    pub glass: Finish,
    pub jade: Finish,
    pub water: Finish,
    pub screen: Finish,
    pub glow: Finish,
    pub leaf: Finish,
}

impl Palette {
    pub fn new(scene: &mut Scene) -> Self {
        let plain = |scene: &mut Scene, material: Material| Finish {
            material: scene.add_material(material),
            tile: None,
        };
        Self {
            stone: textured(scene, "stone", 512, 3.0, stone),
            trim: plain(scene, painted("trim", vec3(0.52, 0.47, 0.4), 0.8)),
            brick: textured(scene, "brick", 256, 1.0, brick),
            plates: textured(scene, "floor plates", 512, 2.4, plates),
            paving: textured(scene, "paving", 256, 2.0, paving),
            plaster: textured(scene, "plaster", 256, 4.0, plaster),
            tiles: textured(scene, "tiles", 256, 1.2, tiles),
            wood: textured(scene, "wood", 256, 0.9, wood),
            rust: textured(scene, "rust", 256, 1.5, rust),
            steel: plain(scene, painted("dark steel", vec3(0.075, 0.08, 0.09), 0.55)),
            brushed: plain(
                scene,
                Material::metal("brushed steel", vec3(0.62, 0.6, 0.57), 0.42),
            ),
            paint: plain(scene, painted("paint", vec3(0.62, 0.2, 0.05), 0.6)),
            shell: plain(scene, painted("shell", Vec3::ONE, 0.5)),
            marble: plain(scene, Material::matt("statue", vec3(0.8, 0.77, 0.72))),
            mirror: plain(scene, Material::metal("mirror", Vec3::splat(0.94), 0.0)),
            glass: plain(scene, solid("glass", 1.5, 0.3, vec3(0.72, 0.9, 0.86))),
            jade: plain(scene, solid("fish glass", 1.5, 0.12, vec3(0.95, 0.5, 0.22))),
            water: plain(scene, solid("water", 1.33, 1.5, vec3(0.55, 0.82, 0.84))),
            screen: screen(scene),
            glow: plain(scene, Material::emitter("glow", vec3(14.0, 9.5, 5.0))),
            leaf: foliage(scene),
        }
    }
}

fn painted(name: &str, color: Vec3, roughness: f32) -> Material {
    Material {
        name: name.to_owned(),
        base_color: color.extend(1.0),
        roughness,
        ..Material::default()
    }
}

/// Clear stuff that transmits `color` of the light over `distance` (m).
fn solid(name: &str, ior: f32, distance: f32, color: Vec3) -> Material {
    Material {
        transmission: 1.0,
        ior,
        volume: Some(Volume {
            attenuation_distance: distance,
            attenuation_color: color,
        }),
        ..painted(name, Vec3::ONE, 0.0)
    }
}

fn texture(scene: &mut Scene, image: Image) -> Option<TextureRef> {
    scene.images.push(image.into());
    scene.textures.push(Texture {
        image: scene.images.len() - 1,
        wrap: [Wrap::Repeat; 2],
        nearest: false,
        has_levels: true,
    });
    Some(TextureRef::new(scene.textures.len() - 1))
}

/// A material with relief whose tile measures `side` (m).
fn textured(
    scene: &mut Scene,
    name: &str,
    size: u32,
    side: f32,
    spot: impl Fn(Vec2) -> Spot,
) -> Finish {
    let images = relief(name, size, spot);
    let material = Material {
        base_color_texture: texture(scene, images.base_color),
        normal_texture: texture(scene, images.normals),
        metallic_roughness_texture: texture(scene, images.metallic_roughness),
        metallic: 1.0,
        ..painted(name, Vec3::ONE, 1.0)
    };
    Finish {
        material: scene.add_material(material),
        tile: Some(side),
    }
}

/// Lines of light text on a dark blue screen.
fn screen(scene: &mut Scene) -> Finish {
    let image = image("screen", 128, |uv| {
        let cell = (uv * vec2(48.0, 24.0)).floor();
        let line = (cell.y as u32 % 24) * 7;
        let is_text = cell.y % 2.0 == 1.0
            && cell.x > 2.0
            && cell.x < 10.0 + 34.0 * lattice(line, 5)
            && lattice(cell.x as u32 + line * 61, 3) > 0.3;
        let color = if is_text {
            vec3(0.75, 1.0, 0.9)
        } else {
            vec3(0.08, 0.3, 0.38)
        };
        (color, 1.0)
    });
    let material = Material {
        emissive_texture: texture(scene, image),
        ..Material::emitter("screen", Vec3::splat(5.0))
    };
    Finish {
        material: scene.add_material(material),
        tile: None,
    }
}

fn foliage(scene: &mut Scene) -> Finish {
    let material = Material {
        base_color_texture: texture(scene, pointed_leaf("leaf", 64)),
        // Below the mean of a leaf's alpha, so that coarse levels of the texture do not lose it.
        alpha_mode: AlphaMode::Mask { cutoff: 0.3 },
        double_sided: true,
        ..Material::matt("leaf", Vec3::ONE)
    };
    Finish {
        material: scene.add_material(material),
        tile: None,
    }
}

/// Bricks in running bond: the number of a point's brick, and its distance from the joint in bricks' heights.
fn bond(uv: Vec2, columns: u32, rows: u32, shift: f32) -> (u32, f32) {
    let row = (uv.y * rows as f32).floor();
    let across = uv.x * columns as f32 + shift * (row % 2.0);
    let column = across.floor();
    let inside = vec2(across - column, uv.y * rows as f32 - row);
    let aspect = vec2(rows as f32 / columns as f32, 1.0);
    let to_edge = (inside.min(1.0 - inside) * aspect).min_element();
    (column as u32 % columns + row as u32 * columns, to_edge)
}

fn matt(color: Vec3, height: f32, roughness: f32) -> Spot {
    Spot {
        color,
        height,
        roughness,
        metallic: 0.0,
    }
}

/// Blocks of warm limestone, 1 m x 0.5 m.
fn stone(uv: Vec2) -> Spot {
    let (number, to_edge) = bond(uv, 3, 6, 0.5);
    let face = eased(to_edge, 0.01, 0.06);
    let (own, grain) = (lattice(number, 11), turbulence(uv));
    let color = vec3(0.74, 0.67, 0.56).lerp(vec3(0.66, 0.62, 0.57), own) * (0.72 + 0.4 * grain);
    let joint = vec3(0.5, 0.46, 0.4);
    matt(joint.lerp(color, face), 0.004 * face + 0.004 * grain, 0.9)
}

fn brick(uv: Vec2) -> Spot {
    let (number, to_edge) = bond(uv, 4, 12, 0.5);
    let face = eased(to_edge, 0.06, 0.16);
    let (own, grain) = (lattice(number, 13), turbulence(uv));
    let clay = vec3(0.62, 0.33, 0.23).lerp(vec3(0.5, 0.3, 0.25), own) * (0.7 + 0.5 * grain);
    let mortar = vec3(0.6, 0.57, 0.52) * (0.8 + 0.2 * grain);
    matt(mortar.lerp(clay, face), 0.008 * face + 0.004 * grain, 0.92)
}

/// Slabs of dark stone, polished by feet, each framed by a strip of steel with rivets.
fn plates(uv: Vec2) -> Spot {
    let (number, to_edge) = bond(uv, 2, 2, 0.0);
    let (own, grain) = (lattice(number, 17), turbulence(uv));
    let inside = (uv * 2.0).fract();
    let from_rivet = (inside.min(1.0 - inside) - 0.055).length();
    let rivet = 1.0 - eased(from_rivet, 0.012, 0.02);
    let slab = eased(to_edge, 0.1, 0.11);
    let gap = 1.0 - eased(to_edge, 0.004, 0.012);
    let stone = (vec3(0.43, 0.4, 0.37) + 0.06 * own) * (0.7 + 0.5 * grain);
    let steel = vec3(0.36, 0.34, 0.32) * (0.75 + 0.4 * grain);
    let color = steel.lerp(stone, slab) * (1.0 - 0.7 * gap);
    Spot {
        color,
        height: 0.0012 * rivet - 0.003 * gap - 0.0015 * slab + 0.0008 * grain,
        roughness: 0.5 + 0.3 * grain,
        metallic: 0.0,
    }
}

fn paving(uv: Vec2) -> Spot {
    let (number, to_edge) = bond(uv, 4, 6, 0.5);
    let face = eased(to_edge, 0.01, 0.09);
    let (own, grain) = (lattice(number, 19), turbulence(uv));
    let slab = (vec3(0.56, 0.53, 0.48) + 0.1 * (own - 0.5)) * (0.7 + 0.45 * grain);
    let moss = vec3(0.34, 0.36, 0.24);
    matt(moss.lerp(slab, face), 0.006 * face + 0.004 * grain, 0.9)
}

fn plaster(uv: Vec2) -> Spot {
    let grain = turbulence(uv);
    let stain = eased(noise(uv, [3, 5]), 0.55, 0.9);
    let color = vec3(0.8, 0.77, 0.7) * (0.85 + 0.2 * grain) * (1.0 - 0.15 * stain);
    matt(color, 0.003 * grain, 0.95)
}

/// Small glazed tiles, 10 cm wide.
fn tiles(uv: Vec2) -> Spot {
    let (number, to_edge) = bond(uv, 12, 12, 0.0);
    let face = eased(to_edge, 0.03, 0.1);
    let glaze = vec3(0.25, 0.6, 0.62).lerp(vec3(0.5, 0.74, 0.72), lattice(number, 23));
    let grout = vec3(0.72, 0.7, 0.64);
    matt(grout.lerp(glaze, face), 0.002 * face, 0.7)
}

/// Six planks along u.
fn wood(uv: Vec2) -> Spot {
    let plank = (uv.y * 6.0).floor();
    let across = uv.y * 6.0 - plank;
    let face = eased(across.min(1.0 - across), 0.01, 0.06);
    let grain = 0.6 * noise(uv, [3, 60]) + 0.4 * noise(uv, [6, 128]);
    let own = lattice(plank as u32, 29);
    let color = vec3(0.5, 0.33, 0.19).lerp(vec3(0.4, 0.25, 0.14), own) * (0.65 + 0.5 * grain);
    matt(
        color * (0.4 + 0.6 * face),
        0.004 * face + 0.002 * grain,
        0.7,
    )
}

/// Green paint that flakes off rusty iron.
fn rust(uv: Vec2) -> Spot {
    let grain = turbulence(uv);
    let bare = eased(0.6 * grain + 0.5 * noise(uv, [5, 5]), 0.5, 0.58);
    let paint = vec3(0.24, 0.36, 0.33) * (0.85 + 0.3 * grain);
    let iron = vec3(0.46, 0.24, 0.12) * (0.5 + 0.9 * noise(uv, [24, 24]));
    matt(
        paint.lerp(iron, bare),
        0.003 * (1.0 - bare) + 0.003 * grain,
        0.5 + 0.4 * bare,
    )
}
