//! The path tracer compared with what light must do: closed forms, quadratures, sums over parts, and another way to
//! compute the same light.
//!
//! A tolerance is trusted only where the measured noise is well below it: see [`Estimate::check`].

mod against_shadow_map;
mod furnace;
mod glass;
mod hostile;
mod lights;
mod paths;
mod progress;
mod sky;
mod translucent;

use std::sync::Arc;

use std::ops::ControlFlow;

use glam::{DVec3, Vec3};
use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Progress, Settings};
use gpugi_scene::{Camera, Environment, Image, Mesh, Pixels, Projection, Scene};

/// Pictures with different seeds, whose spread gives the error of their mean.
const BATCHES: u32 = 8;

/// Independent pictures of the same view.
struct Batches {
    size: [u32; 2],
    pictures: Vec<Vec<f32>>,
}

/// A mean and its standard error, per channel.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    value: DVec3,
    error: DVec3,
}

impl Batches {
    /// The mean over some pixels (x, y).
    fn over(&self, wanted: impl Fn(u32, u32) -> bool) -> Estimate {
        let chosen: Vec<usize> = (0..self.size[1])
            .flat_map(|y| (0..self.size[0]).map(move |x| (x, y)))
            .filter(|&(x, y)| wanted(x, y))
            .map(|(x, y)| (y * self.size[0] + x) as usize)
            .collect();
        assert!(!chosen.is_empty(), "no pixel was chosen");
        let means: Vec<DVec3> = self
            .pictures
            .iter()
            .map(|picture| {
                let pixel = |&at: &usize| Vec3::from_slice(&picture[at * 3..at * 3 + 3]).as_dvec3();
                chosen.iter().map(pixel).sum::<DVec3>() / chosen.len() as f64
            })
            .collect();
        let count = means.len() as f64;
        let value = means.iter().sum::<DVec3>() / count;
        let squares: DVec3 = means.iter().map(|mean| (mean - value).powf(2.0)).sum();
        let variance = squares / (count * (count - 1.0));
        Estimate {
            value,
            error: DVec3::from_array(variance.to_array().map(f64::sqrt)),
        }
    }

    /// The mean over the whole picture.
    fn mean(&self) -> Estimate {
        self.over(|_, _| true)
    }

    /// The mean of each pixel over the batches.
    fn pixels(&self) -> Vec<DVec3> {
        let [width, height] = self.size;
        (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|at| self.over(|x, y| (x, y) == at).value)
            .collect()
    }
}

impl Estimate {
    /// Asserts that the value is within `tolerance` of `expected`, and that the standard error is at most a quarter of
    /// the tolerance, so that the check neither passes nor fails by chance.
    fn check(&self, what: &str, expected: DVec3, tolerance: f64) {
        println!("{what}: {self:?}, expected {expected}");
        assert!(
            4.0 * self.error.max_element() <= tolerance,
            "{what}: the error {} is too large to tell {tolerance}",
            self.error
        );
        let off = (self.value - expected).abs().max_element();
        assert!(
            off <= tolerance,
            "{what}: {} is off {expected} by {off}, more than {tolerance}",
            self.value
        );
    }
}

fn go_on(_: &Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Settings with a bound on the vertices and without Russian roulette: less noise.
fn bounces(max_bounces: u32) -> Settings {
    Settings {
        max_bounces,
        roulette_after: max_bounces + 1,
        ..Settings::default()
    }
}

fn tracer(gpu: &Gpu, scene: &Scene, size: [u32; 2], settings: &Settings) -> PathTracer {
    PathTracer::new(gpu, scene, size, settings).expect("a path tracer")
}

/// A picture with `seed`; checks that every value is finite.
fn picture(tracer: &mut PathTracer, camera: &Camera, samples: u32, seed: u32) -> Vec<f32> {
    tracer.restart(seed).expect("a restart");
    let progress = tracer
        .render(camera, samples, &mut go_on)
        .expect("a picture");
    assert_eq!((progress.samples, progress.fraction), (samples, 1.0));
    let radiance = tracer.radiance().expect("radiance");
    assert!(
        radiance
            .iter()
            .all(|value| value.is_finite() && *value >= 0.0),
        "a radiance is negative or not finite"
    );
    radiance
}

/// [`BATCHES`] pictures of `samples` samples per pixel.
fn trace(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    size: [u32; 2],
    samples: u32,
    settings: &Settings,
) -> Batches {
    let mut tracer = tracer(gpu, scene, size, settings);
    Batches {
        size,
        pictures: (0..BATCHES)
            .map(|seed| picture(&mut tracer, camera, samples, seed + 1))
            .collect(),
    }
}

/// A parallel view of `height` (m) around `target`, seen from `direction`.
fn parallel(target: Vec3, direction: Vec3, height: f32) -> Camera {
    Camera {
        projection: Projection::Orthographic { height },
        ..Camera::look_at(
            "parallel",
            target + direction.normalize() * 4.0,
            target,
            1.0,
        )
    }
}

/// An environment of linear texels, rows from the top.
fn environment(width: u32, texels: &[Vec3]) -> Environment {
    Environment {
        image: Arc::new(Image {
            name: "environment".to_owned(),
            width,
            height: texels.len() as u32 / width,
            pixels: Pixels::Rgba32Float(
                texels
                    .iter()
                    .flat_map(|texel| texel.extend(1.0).to_array())
                    .collect(),
            ),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// Uniform radiance 1.
fn white() -> Environment {
    environment(1, &[Vec3::ONE])
}

/// A mesh of flat triangles without shared vertices, so that its normals are those of its surface.
fn faceted(mesh: &Mesh) -> Mesh {
    let mut flat = mesh.with_vertices(&mesh.indices, (0..mesh.indices.len() as u32).collect());
    for (corners, normals) in flat
        .positions
        .chunks_exact(3)
        .zip(flat.normals.chunks_exact_mut(3))
    {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        normals.fill(normal.normalize_or(Vec3::Y));
    }
    flat
}

/// A mesh that faces inward.
fn inward(mut mesh: Mesh) -> Mesh {
    for triangle in mesh.indices.chunks_exact_mut(3) {
        triangle.swap(1, 2);
    }
    for normal in &mut mesh.normals {
        *normal = -*normal;
    }
    mesh
}

/// Exact reflectance of a dielectric for unpolarised light, from the angles of Snell's law; `eta` is the index behind
/// the surface over that in front.
fn fresnel(eta: f64, incidence: f64) -> f64 {
    if incidence < 1e-9 {
        return ((eta - 1.0) / (eta + 1.0)).powi(2);
    }
    let sine = incidence.sin() / eta;
    if sine >= 1.0 {
        return 1.0;
    }
    let refracted = sine.asin();
    let (difference, sum) = (incidence - refracted, incidence + refracted);
    let rs = difference.sin() / sum.sin();
    let rp = difference.tan() / sum.tan();
    (rs * rs + rp * rp) / 2.0
}
