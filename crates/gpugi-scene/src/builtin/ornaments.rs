//! Rings around balls in a town square, one pair of each material: gold, glass, matt, glossy. Little occludes the
//! surroundings, so an environment map alone renders them almost correctly.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat4, Vec2, Vec3, vec2, vec3};

use super::shapes::{sphere, torus};
use crate::{Camera, Environment, Image, Material, MaterialModel, Pixels, Scene, Volume};

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("ornaments");
    scene.cameras.push(Camera::look_at(
        "front",
        vec3(0.0, 0.5, 6.6),
        Vec3::ZERO,
        24.0_f32.to_radians(),
    ));
    let ring = scene.add_mesh(torus(0.62, 0.13, 24 * detail));
    let ball = scene.add_mesh(sphere(0.4, 24 * detail));
    for (step, material) in [gold(), glass(), matt(), glossy()].into_iter().enumerate() {
        let name = material.name.clone();
        let material = scene.add_material(material);
        let place = Mat4::from_translation(vec3(1.65 * (step as f32 - 1.5), 0.0, 0.0));
        // Upright, and turned a little so that the ring does not hide itself.
        let upright = Mat4::from_rotation_y(0.5) * Mat4::from_rotation_x(FRAC_PI_2 - 0.15);
        scene.add_instance(&format!("{name} ring"), ring, material, place * upright);
        scene.add_instance(&format!("{name} ball"), ball, material, place);
    }
    scene.environment = Some(Environment {
        image: square().into(),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    scene
}

/// Refractive index and extinction at 650, 550 and 450 nm (Johnson and Christy 1972).
fn gold() -> Material {
    Material {
        name: "gold".into(),
        model: MaterialModel::Conductor {
            n: vec3(0.16, 0.42, 1.50),
            k: vec3(3.47, 2.35, 1.88),
        },
        roughness: 0.0,
        ..Material::default()
    }
}

fn glass() -> Material {
    Material {
        name: "glass".into(),
        transmission: 1.0,
        roughness: 0.0,
        ior: 1.5,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

fn matt() -> Material {
    Material::matt("matt", vec3(0.75, 0.72, 0.68))
}

fn glossy() -> Material {
    Material {
        name: "glossy".into(),
        model: MaterialModel::Phong {
            kd: vec3(0.12, 0.2, 0.35),
            ks: Vec3::splat(0.5),
            shininess: 60.0,
        },
        ..Material::default()
    }
}

/// The surroundings seen from eye height: tiles, houses with windows, and the default sky with its sun.
fn square() -> Image {
    const WIDTH: u32 = 1024;
    const HEIGHT: u32 = 512;
    let sky = Environment::default_sky().image;
    let Pixels::Rgba32Float(of_sky) = &sky.pixels else {
        unreachable!("the default sky is made of floats")
    };
    let mut texels = Vec::with_capacity((WIDTH * HEIGHT * 4) as usize);
    for y in 0..HEIGHT {
        let theta = PI * (y as f32 + 0.5) / HEIGHT as f32;
        for x in 0..WIDTH {
            let turn = (x as f32 + 0.5) / WIDTH as f32;
            let tangent = 1.0 / theta.tan();
            let color = if let Some(color) = house(turn, tangent) {
                color
            } else if tangent < 0.0 {
                let (sine, cosine) = (TAU * turn).sin_cos();
                tile(vec2(sine, cosine) * (EYE / -tangent))
            } else {
                let column = (turn * sky.width as f32) as u32;
                let row = y * sky.height / HEIGHT;
                let first = ((row * sky.width + column) * 4) as usize;
                Vec3::from_slice(&of_sky[first..])
            };
            texels.extend([color.x, color.y, color.z, 1.0]);
        }
    }
    Image {
        name: "square".into(),
        width: WIDTH,
        height: HEIGHT,
        pixels: Pixels::Rgba32Float(texels),
    }
}

/// Eye height above the ground and distance of the houses (m), and the number of houses in a full circle.
const EYE: f32 = 1.7;
const DISTANCE: f32 = 30.0;
const HOUSES: f32 = 24.0;

/// The colour of a house at a fraction `turn` of a full circle and at a tangent of the elevation; `None` beside and
/// above it.
fn house(turn: f32, tangent: f32) -> Option<Vec3> {
    let number = (turn * HOUSES).floor();
    let across = turn * HOUSES - number;
    // A pseudo-random value between 0 and 1 for each house.
    let chance = |salt: f32| {
        ((number + salt) * 12.9898)
            .sin()
            .mul_add(43758.547, 0.0)
            .rem_euclid(1.0)
    };
    let height = tangent * DISTANCE + EYE;
    // Every fourth house is missing, so that the square is open.
    if height < 0.0 || height > 6.0 + 7.0 * chance(0.0) || number as i32 % 4 == 3 {
        return None;
    }
    let plaster = vec3(0.5, 0.42, 0.34).lerp(vec3(0.62, 0.35, 0.25), chance(1.0));
    // Three windows per floor; floors are 3 m high.
    let window = vec2((across * 3.0).fract(), (height / 3.0).fract());
    let is_window = (window - 0.5).abs().cmplt(vec2(0.2, 0.25)).all();
    Some(if is_window {
        vec3(0.06, 0.07, 0.09)
    } else {
        plaster
    })
}

/// Light and dark tiles of 1.5 m, fading to grey with distance.
fn tile(at: Vec2) -> Vec3 {
    let cell = (at / 1.5).floor();
    let is_light = (cell.x + cell.y).rem_euclid(2.0) < 1.0;
    let contrast = (1.0 - at.length() / DISTANCE).max(0.0);
    Vec3::splat(0.3) + vec3(1.0, 0.96, 0.9) * (contrast * if is_light { 0.2 } else { -0.2 })
}
