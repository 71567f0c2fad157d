//! Walls without thickness, and what comes through.

use glam::{Vec3, vec3};
use gpugi::capture::{Output, Probe};

use super::thin_walls::{a_room_with_a_wall, two_rooms};
use super::{at_probes, facing};
use crate::common::gpu;

/// Points on the floor, on the far walls and on the wall between, of the side `side`.
fn points(side: f32) -> Vec<Probe> {
    let mut points = Vec::new();
    for z in [-0.8, -0.3, 0.1, 0.6] {
        for x in [0.1, 0.4, 1.0, 1.7] {
            points.push(facing(vec3(side * x, 0.001, z), Vec3::Y));
        }
        for y in [0.2, 0.9, 1.8] {
            points.push(facing(vec3(side * 1.999, y, z), Vec3::X * -side));
            points.push(facing(vec3(side * 0.011, y, z), Vec3::X * side));
        }
    }
    points
}

fn mean(of: &[Vec3]) -> f32 {
    of.iter().map(|irradiance| irradiance.x).sum::<f32>() / of.len() as f32
}

#[test]
fn a_thin_wall_lets_no_light_through() {
    let Some(gpu) = gpu() else { return };
    let names = ["shadow-map", "final-gather"];
    let all = [points(-1.0), points(1.0)].concat();
    for (what, scene) in [
        ("a gap of 2 cm", two_rooms(0.02)),
        ("no thickness", a_room_with_a_wall()),
    ] {
        let direct = at_probes(&gpu, &scene, &names[..1], &[], &all, Output::Irradiance);
        // An odd number of points along x puts some into the wall.
        for density in ["density=1", "density=1.2", "density=2"] {
            let leak = |visibility: &str| {
                let settings = [density, "resolution=32", visibility];
                let found = at_probes(&gpu, &scene, &names, &settings, &all, Output::Irradiance);
                let indirect: Vec<Vec3> = found.iter().zip(&direct).map(|(a, b)| *a - *b).collect();
                let (lit, dark) = indirect.split_at(indirect.len() / 2);
                let brightest = dark
                    .iter()
                    .map(|irradiance| irradiance.x)
                    .fold(0.0, f32::max);
                (mean(dark) / mean(lit), brightest / mean(lit))
            };
            let (without, _) = leak("visibility=none");
            let (with, worst) = leak("visibility=distance");
            println!("{what}, {density}: {with:.4}, at worst {worst:.4}; untested {without:.4}");
            assert!(with < 0.002, "{what}, {density}: {with}");
            // Points in the wall see neither room.
            let leaks = density != "density=1.2";
            assert_eq!(without > 0.02, leaks, "{what}, {density}: {without}");
        }
    }
}
