//! Built-in procedural scenes, each in a few lines of code.

pub mod shapes;

mod chamber;
mod cloud;
mod cornell;
mod fog_room;
mod glass_room;
mod ornaments;
mod room;
mod shapes_scene;
mod solid_teapot;
mod spheres;
mod station;
mod teapot;
mod textures;
mod window_room;

use crate::Scene;

/// A scene that comes with gpugi.
#[derive(Debug, Clone, Copy)]
pub struct BuiltinScene {
    /// The bare name that selects it.
    pub name: &'static str,
    /// One-line description.
    pub summary: &'static str,
    build: fn(u32) -> Scene,
}

/// All built-in scenes.
pub const SCENES: &[BuiltinScene] = &[
    BuiltinScene {
        name: "cornell",
        summary: "Cornell University's measured box: matt walls, two blocks, one area light",
        build: cornell::build,
    },
    BuiltinScene {
        name: "room",
        summary: "coloured room with a box and a mirror sphere, lit by a spot and a point light",
        build: room::build,
    },
    BuiltinScene {
        name: "glass-room",
        summary: "the room with a mirror sphere, teapot and ball of glass, whose caustics a spot that swings and a small lamp make",
        build: glass_room::build,
    },
    BuiltinScene {
        name: "teapot",
        summary: "Newell's teapot on a plane, lit by a spot and an area light",
        build: teapot::build,
    },
    BuiltinScene {
        name: "spheres",
        summary: "metal and dielectric spheres from matt to mirror under sky and sun",
        build: spheres::build,
    },
    BuiltinScene {
        name: "ornaments",
        summary: "rings and balls of gold, glass, matt and glossy stuff on a square of a town",
        build: ornaments::build,
    },
    BuiltinScene {
        name: "chamber",
        summary: "closed stone hall with columns, arches and stairs, lit through a gallery",
        build: chamber::build,
    },
    BuiltinScene {
        name: "shapes",
        summary: "one of each: shapes, kinds of light, reflection models, instances",
        build: shapes_scene::build,
    },
    BuiltinScene {
        name: "window-room",
        summary: "hotel room of walls without thickness, in centimetres, that sees sky and sun through one window",
        build: window_room::build,
    },
    BuiltinScene {
        name: "station",
        summary: "level of a game: stone hall with gallery and basin, courtyard behind an arch, much of which moves",
        build: station::build,
    },
    BuiltinScene {
        name: "cloud",
        summary: "a cloud over a plain, under sky and sun",
        build: cloud::build,
    },
    BuiltinScene {
        name: "fog-room",
        summary: "coloured room full of fog, with a spot's shaft of light and a mirror sphere",
        build: fog_room::build,
    },
];

/// The largest useful `detail`; larger values are clamped to it.
pub const DETAIL_MAX: u32 = 64;

/// The built-in scene called `name`. The triangle count of curved and lit surfaces grows roughly with the square of
/// `detail`, which is clamped to 1..=[`DETAIL_MAX`].
pub fn builtin(name: &str, detail: u32) -> Option<Scene> {
    SCENES
        .iter()
        .find(|scene| scene.name == name)
        .map(|scene| (scene.build)(detail.clamp(1, DETAIL_MAX)))
}
