//! A columned stone hall like the one in figures 66 to 68 of the tutorial: a nave between two arcades that carry
//! galleries, and stairs to a dais at the far end. A spot in the left gallery shines through the balustrade; two lamps
//! glow.
//!
//! The nave is 6.2 m wide; the hall measures 12 x 16 m and is 9 m high. It is closed, with the camera inside.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat4, Vec2, Vec3, vec2, vec3};

use super::shapes::{
    ProfilePoint, Vertex, arc_profile, cuboid, grid, join, quad, revolution, sharp_profile, sphere,
};
use super::textures::{marble, tiles};
use crate::{Camera, Image, Light, LightKind, Material, Mesh, Scene, Texture, TextureRef, Wrap};

/// Half the width and length of the hall, and its height (m).
const HALF: Vec2 = vec2(6.0, 8.0);
const HEIGHT: f32 = 9.0;
/// Distance of the column axes from the centre of the hall, and half the thickness of the wall above them (m).
const ARCADE: f32 = 3.5;
const HALF_THICKNESS: f32 = 0.4;
/// Distance between columns, and the radius of the arches between them (m).
const BAY: f32 = 4.0;
const ARCH_RADIUS: f32 = 1.5;
/// Heights at which the arches start and of the gallery's floor (m).
const SPRINGING: f32 = 4.0;
const GALLERY: f32 = 6.3;

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("chamber");
    scene.cameras.push(Camera::look_at(
        "nave",
        vec3(0.6, 1.7, 7.4),
        vec3(-0.3, 2.9, -2.0),
        68.0_f32.to_radians(),
    ));
    let marble = textured(&mut scene, "marble", marble);
    let tiles = textured(&mut scene, "tiles", tiles);
    let plaster = scene.add_material(Material::matt("plaster", vec3(0.55, 0.52, 0.46)));
    let glow = scene.add_material(Material::emitter("lamp", vec3(30.0, 22.0, 12.0)));

    let mut place = |name: &str, mesh: Mesh, material: usize, at: &[Mat4]| {
        let mesh = scene.add_mesh(Mesh {
            name: name.into(),
            ..mesh
        });
        for &at in at {
            scene.add_instance(name, mesh, material, at);
        }
    };
    let here = [Mat4::IDENTITY];
    // The two sides of the nave are the same mesh, rotated by half a turn.
    let sides = [Mat4::IDENTITY, Mat4::from_rotation_y(PI)];

    place("floor", floor(detail), tiles, &here);
    place("walls", walls(detail), plaster, &here);
    let columns: Vec<Mat4> = [-1.0, 1.0]
        .into_iter()
        .flat_map(|side| [-1.0, 0.0, 1.0].map(|i| vec3(side * ARCADE, 0.0, i * BAY)))
        .map(Mat4::from_translation)
        .collect();
    place("column", column(detail), marble, &columns);
    place("arcade", arcade(detail), plaster, &sides);
    place("gallery", gallery(detail), plaster, &sides);
    place("balustrade", balustrade(), marble, &sides);
    place("stairs", stairs(detail), marble, &here);
    let lamps = [vec3(0.0, 2.6, -7.2), vec3(4.8, 2.8, 2.0)].map(Mat4::from_translation);
    place("lamp", sphere(0.22, 4 * detail), glow, &lamps);

    let cone = LightKind::Spot {
        inner_cone_angle: 20.0_f32.to_radians(),
        outer_cone_angle: 32.0_f32.to_radians(),
    };
    let mut spot = Light::new("gallery spot", cone, vec3(620.0, 580.0, 500.0))
        .aimed(vec3(-4.4, 8.6, 3.0), vec3(1.8, 0.0, -2.0));
    spot.radius = 0.1;
    scene.lights = vec![spot];
    scene
}

/// A matt material with a generated texture of 256 x 256 texels.
fn textured(scene: &mut Scene, name: &str, make: fn(&str, u32) -> Image) -> usize {
    scene.images.push(make(name, 256).into());
    scene.textures.push(Texture {
        image: scene.images.len() - 1,
        wrap: [Wrap::Repeat; 2],
        nearest: false,
        has_levels: true,
    });
    let texture = TextureRef::new(scene.textures.len() - 1);
    scene.add_material(Material {
        base_color_texture: Some(texture),
        ..Material::matt(name, Vec3::ONE)
    })
}

/// `mesh` with its texture coordinates multiplied by `times`, so that a texture repeats.
fn repeated(mut mesh: Mesh, times: Vec2) -> Mesh {
    for uv in &mut mesh.uvs[0] {
        *uv *= times;
    }
    mesh
}

fn floor(detail: u32) -> Mesh {
    let (x, z) = (Vec3::X * 2.0 * HALF.x, Vec3::NEG_Z * 2.0 * HALF.y);
    let floor = quad(vec3(-HALF.x, 0.0, HALF.y), x, z, 8 * detail);
    repeated(floor, vec2(3.0, 4.0))
}

/// Ceiling and four walls, facing inward.
fn walls(detail: u32) -> Mesh {
    let (x, y, z) = (
        Vec3::X * 2.0 * HALF.x,
        Vec3::Y * HEIGHT,
        Vec3::Z * 2.0 * HALF.y,
    );
    let corner = |sx: f32, y: f32, sz: f32| vec3(sx * HALF.x, y, sz * HALF.y);
    let walls = [
        (corner(-1.0, HEIGHT, -1.0), x, z),
        (corner(-1.0, 0.0, -1.0), x, y),
        (corner(1.0, 0.0, 1.0), -x, y),
        (corner(-1.0, 0.0, 1.0), -z, y),
        (corner(1.0, 0.0, -1.0), z, y),
    ];
    let quads = walls.map(|(corner, right, up)| quad(corner, right, up, 6 * detail));
    join("walls", quads)
}

/// A column at the origin: plinth, shaft with rounded base and capital, abacus.
fn column(detail: u32) -> Mesh {
    let top = SPRINGING - 0.2;
    let capital = arc_profile(vec2(0.3, top), 0.2, 0.0, -PI / 3.0, 2 * detail);
    let base = arc_profile(vec2(0.42, 0.45), 0.15, FRAC_PI_2, -FRAC_PI_2, 3 * detail);
    let below_capital = capital[capital.len() - 1].position;
    let neck = vec2(0.36, below_capital.y);
    let above_base = base[0].position;
    let mut profile = sharp_profile(&[vec2(0.0, top), capital[0].position]);
    profile.extend(capital);
    profile.extend(sharp_profile(&[below_capital, neck]));
    profile.extend(shaft(neck, above_base, 2 * detail));
    profile.extend(&base);
    let below_base = base[base.len() - 1].position;
    profile.extend(sharp_profile(&[below_base, vec2(0.0, below_base.y)]));
    let turned = repeated(revolution(&profile, 10 * detail), vec2(1.0, 2.0));
    let half = |half: f32, y: f32| vec3(half, y, half);
    let plinth = cuboid(half(-0.6, 0.0), half(0.6, 0.3), 1);
    let abacus = cuboid(half(-0.5, top), half(0.5, SPRINGING), 1);
    join("column", [plinth, turned, abacus])
}

/// A straight part of a profile in `steps` segments.
fn shaft(from: Vec2, to: Vec2, steps: u32) -> impl Iterator<Item = ProfilePoint> {
    let normal = (to - from).perp().normalize();
    (0..=steps).map(move |step| ProfilePoint {
        position: from.lerp(to, step as f32 / steps as f32),
        normal,
    })
}

/// The arches of the right side: four bays, with pilasters at the end walls.
fn arcade(detail: u32) -> Mesh {
    let bays = (0..4).map(|i| arch((i as f32 - 1.5) * BAY, detail));
    let pilasters = [-HALF.y, HALF.y - 0.5].map(|z| {
        cuboid(
            vec3(ARCADE - 0.5, 0.0, z),
            vec3(ARCADE + 0.5, SPRINGING, z + 0.5),
            1,
        )
    });
    join("arcade", bays.chain(pilasters))
}

/// One bay of the wall up to the gallery, with a round arch in it: both faces and the inside of the arch. Columns and
/// the gallery hide the remaining sides.
fn arch(middle: f32, detail: u32) -> Mesh {
    // A multiple of four places vertices at the corners of the wall.
    let segments = 12 * detail;
    let direction = |step: u32| Vec2::from_angle(PI * step as f32 / segments as f32);
    // x: along the arcade from the centre of the bay; y: above the springing.
    let at = |p: Vec2, x: f32| vec3(x, SPRINGING + p.y, middle + p.x);
    let uv_of = |p: Vec2| vec2(p.x, -p.y) / BAY;
    let face = |side: f32| {
        grid(segments, detail, move |column, row| {
            // Seen from the right side (+X), +Z points left.
            let step = if side > 0.0 {
                column
            } else {
                segments - column
            };
            let direction = direction(step);
            let outer = direction * (BAY / 2.0) / direction.abs().max_element();
            let p = outer.lerp(direction * ARCH_RADIUS, row as f32 / detail as f32);
            Vertex {
                position: at(p, ARCADE + side * HALF_THICKNESS),
                normal: Vec3::X * side,
                uv: uv_of(p),
            }
        })
    };
    let inside = grid(segments, detail, |column, row| {
        let direction = direction(column);
        let along = row as f32 / detail as f32;
        Vertex {
            position: at(
                direction * ARCH_RADIUS,
                ARCADE + HALF_THICKNESS * (1.0 - 2.0 * along),
            ),
            normal: vec3(0.0, -direction.y, -direction.x),
            uv: vec2(column as f32 / segments as f32 * 3.0, along),
        }
    });
    join("arch", [face(-1.0), face(1.0), inside])
}

/// The right gallery's floor, from the nave's side to the outer wall.
fn gallery(detail: u32) -> Mesh {
    cuboid(
        vec3(
            ARCADE - HALF_THICKNESS - 0.1,
            SPRINGING + BAY / 2.0,
            -HALF.y,
        ),
        vec3(HALF.x, GALLERY, HALF.y),
        4 * detail,
    )
}

/// Posts and rail on the nave side of the right gallery.
fn balustrade() -> Mesh {
    let post = |i: i32| {
        let z = i as f32 * 0.8;
        let foot = vec3(ARCADE - 0.1, GALLERY, z - 0.1);
        cuboid(foot, foot + vec3(0.2, 0.9, 0.2), 1)
    };
    let rail = cuboid(
        vec3(ARCADE - 0.18, GALLERY + 0.9, -HALF.y),
        vec3(ARCADE + 0.18, GALLERY + 1.05, HALF.y),
        1,
    );
    join("balustrade", (-9..=9).map(post).chain([rail]))
}

/// Steps that lead up to a dais at the far end of the nave.
fn stairs(detail: u32) -> Mesh {
    let steps = (0..5).map(|i| {
        let (depth, height) = (3.2 - 0.35 * i as f32, 0.18 * (i + 1) as f32);
        // Each step rests on the one below.
        cuboid(
            vec3(-2.4, height - 0.18, -HALF.y),
            vec3(2.4, height, -HALF.y + depth),
            detail,
        )
    });
    join("stairs", steps)
}
