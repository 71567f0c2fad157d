//! A level of a game: a hall of stone and steel with a gallery, and a courtyard behind its arch. It shows what moves and
//! what light does, in a place that could exist. All of it loops in [`LOOP`].
//!
//! The hall is 14 m long (x), 9 m wide (z) and 7.1 m high. Its floor is at y = 0, and its centre is the origin. The arch is
//! in the west (-x), the windows are in the south (+z), and the gallery is in the north.

mod air;
mod basin;
mod courtyard;
mod fittings;
mod hall;
mod machines;
mod motion;
mod palette;
mod robots;
mod stage;
mod tours;
mod walk;

use glam::{Vec2, vec2};

use crate::{Environment, Scene};
use stage::Stage;

/// Time after which everything is where it was (s).
const LOOP: f32 = 20.0;
/// Half the length and width of the hall, and the thickness of its walls (m).
const HALF: Vec2 = vec2(7.0, 4.5);
const WALL: f32 = 0.4;
/// Height at which the vault starts, and of its crown (m).
const EAVES: f32 = 5.2;
const CROWN: f32 = 7.1;
/// The gallery: height of its floor, z of its edge, x of its end at the lift (m).
const GALLERY: f32 = 3.2;
const EDGE: f32 = -2.3;
const LANDING: f32 = -4.8;

pub(super) fn build(detail: u32) -> Scene {
    // More would not be seen.
    let mut stage = Stage::new("station", detail.min(8));
    tours::add(&mut stage);
    hall::add(&mut stage);
    fittings::add(&mut stage);
    basin::add(&mut stage);
    courtyard::add(&mut stage);
    machines::add(&mut stage);
    robots::add(&mut stage);
    air::add(&mut stage);
    stage.scene.environment = Some(Environment {
        intensity: 1.7,
        ..Environment::clear_sky()
    });
    stage.finish()
}
