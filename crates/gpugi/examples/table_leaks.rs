//! Prints how much light final-gather lets leak where the path tracer has none: a table for
//! docs/techniques/final-gather.md. Arguments, if any, are settings of final-gather, as in `resolution=64`.
//!
//! From a few places in a scene, pictures in six directions show its surfaces. Every pixel stands for the area that it
//! sees, and its radiance for the power per area that the surface reflects. What leaks is the integral over the area of
//! what final-gather adds in excess of the path tracer's light on the same paths; what lacks is the opposite. Both are
//! given as shares of the path tracer's integral. Noise of the reference counts as both.

use std::error::Error;
use std::f32::consts::FRAC_PI_2;
use std::ops::ControlFlow;

use glam::{Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::light_paths::parts;
use gpugi::measure::{Options, Quality, Subject, trace};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Camera, Scene};

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/techniques/final_gather/thin_walls.rs"]
mod thin_walls;

const OF: &str = "final-gather";
/// Side of a picture (pixels).
const SIDE: u32 = 12;
/// Samples per pixel of the techniques, and of the path tracer.
const SAMPLES: u32 = 8;
const REFERENCE_SAMPLES: u32 = 2048;
/// Pixels that see a surface at a smaller cosine than this stand for no more area.
const LEAST_COSINE: f32 = 0.05;
/// A place is dark if it has less than this share of the mean light.
const DARK: f64 = 1e-3;

const DIRECTIONS: [Vec3; 6] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::Z,
    Vec3::NEG_Z,
];

/// A pixel: the area that it sees (m^2), and the mean of its radiance over the channels.
struct Seen {
    area: f64,
    truth: f64,
    found: [f64; VISIBILITY.len()],
}

const VISIBILITY: [&str; 2] = ["none", "distance"];

/// Where pictures are taken from: at two corners of a box in the middle of the scene, and where its cameras are, if that
/// is inside.
fn eyes(scene: &Scene) -> Vec<Vec3> {
    let bounds = scene.bounds();
    let (center, extent) = (bounds.center(), bounds.max - bounds.min);
    let cameras = scene.cameras.iter();
    let cameras = cameras.map(|camera| camera.world_from_view.w_axis.truncate());
    let is_inside = |eye: &Vec3| (*eye - center).abs().cmplt(0.49 * extent).all();
    [vec3(0.31, 0.2, 0.23), vec3(-0.29, 0.27, -0.31)]
        .into_iter()
        .map(|offset| center + offset * extent)
        .chain(cameras.filter(is_inside))
        .collect()
}

/// Mean over the channels of each pixel.
fn means(radiance: &[f32]) -> impl Iterator<Item = f64> {
    let pixels = radiance.chunks_exact(3);
    pixels.map(|rgb| f64::from(rgb.iter().sum::<f32>()) / 3.0)
}

fn pictures(gpu: &Gpu, scene: &Scene, settings: &[String]) -> Result<Vec<Seen>, Box<dyn Error>> {
    let names = ["shadow-map", OF].map(str::to_owned);
    let mut direct = Renderer::new(gpu, scene, [SIDE; 2], &names[..1])?;
    let mut renderers = Vec::new();
    for visibility in VISIBILITY {
        let mut renderer = Renderer::new(gpu, scene, [SIDE; 2], &names)?;
        renderer.set(OF, "visibility", visibility)?;
        for setting in settings {
            let (name, value) = setting.split_once('=').ok_or("expected name=value")?;
            renderer.set(OF, name, value)?;
        }
        renderers.push(renderer);
    }
    let classes = direct.light_classes();
    let own = parts(renderers[0].light_paths_of(OF), &classes);
    let emitted = parts(&[], &classes);
    let options = Options {
        samples: SAMPLES,
        reference: Quality {
            samples: REFERENCE_SAMPLES,
            noise: 0.0,
        },
        ..Options::default()
    };
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    let mut all = Vec::new();
    for eye in eyes(scene) {
        for direction in DIRECTIONS {
            let camera = Camera::look_at("", eye, eye + direction, FRAC_PI_2);
            let camera = &camera;
            let picture = |renderer: &mut Renderer| -> Result<Vec<f32>, Box<dyn Error>> {
                renderer.restart();
                for _ in 0..SAMPLES {
                    renderer.render_sample(camera, SAMPLES, None, false)?;
                }
                Ok(renderer.radiance()?)
            };
            let without = picture(&mut direct)?;
            let with = [picture(&mut renderers[0])?, picture(&mut renderers[1])?];
            let subject = Subject {
                scene,
                camera,
                size: [SIDE; 2],
            };
            let truth = trace(gpu, &subject, &own, &options, go_on)?.radiance;
            let points = direct.surface_points()?;
            // The reference also has what emitters and the sky send straight to the eye.
            let emitted = trace(gpu, &subject, &emitted, &options, go_on)?.radiance;
            let truth: Vec<f64> = means(&truth)
                .zip(means(&emitted))
                .map(|(all, emitted)| all - emitted)
                .collect();
            let found = with.each_ref().map(|with| -> Vec<f64> {
                means(with)
                    .zip(means(&without))
                    .map(|(a, b)| a - b)
                    .collect()
            });
            for (index, point) in points.iter().enumerate() {
                let Some(point) = point else { continue };
                let way = point.position - eye;
                let cosine = way.normalize().dot(point.normal).abs().max(LEAST_COSINE);
                // A pixel's solid angle is proportional to the cube of the cosine at the eye.
                let at_eye = way.normalize().dot(direction);
                all.push(Seen {
                    area: f64::from(at_eye.powi(3) * way.length_squared() / cosine),
                    truth: truth[index],
                    found: found.each_ref().map(|found| found[index]),
                });
            }
        }
    }
    Ok(all)
}

/// A share, in percent; adding zero turns -0 into 0.
fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share + 0.0)
}

fn row(gpu: &Gpu, name: &str, scene: &Scene, settings: &[String]) -> Result<(), Box<dyn Error>> {
    let seen = pictures(gpu, scene, settings)?;
    let area: f64 = seen.iter().map(|pixel| pixel.area).sum();
    let all: f64 = seen.iter().map(|pixel| pixel.area * pixel.truth).sum();
    let is_dark = |pixel: &&Seen| pixel.truth < DARK * all / area;
    let dark_area: f64 = seen.iter().filter(is_dark).map(|pixel| pixel.area).sum();
    let mut columns = vec![percent(dark_area / area)];
    for way in 0..VISIBILITY.len() {
        let off = |pixel: &Seen| pixel.area * (pixel.found[way] - pixel.truth);
        let dark: f64 = seen.iter().filter(is_dark).map(off).sum();
        let excess: f64 = seen.iter().map(|pixel| off(pixel).max(0.0)).sum();
        let lack: f64 = seen.iter().map(|pixel| (-off(pixel)).max(0.0)).sum();
        columns.extend([dark, excess, lack].map(|power| percent(power / all)));
    }
    println!("| {name} | {} |", columns.join(" | "));
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let settings: Vec<String> = std::env::args().skip(1).collect();
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let heads = VISIBILITY.map(|visibility| format!("`{visibility}`: in the dark | excess | lack"));
    println!("| scene | dark area | {} |", heads.join(" | "));
    println!("|---|---|{}", "---|".repeat(3 * VISIBILITY.len()));
    row(
        &gpu,
        "rooms, 2 cm of wall between",
        &thin_walls::two_rooms(0.02),
        &settings,
    )?;
    let scene = thin_walls::a_room_with_a_wall();
    row(&gpu, "room, wall without thickness", &scene, &settings)?;
    for name in ["cornell", "chamber", "window-room", "room"] {
        let scene = builtin(name, 1).ok_or("no such scene")?;
        row(&gpu, name, &scene, &settings)?;
    }
    Ok(())
}
