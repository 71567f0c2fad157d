//! Helpers shared by the tests that render.

#![allow(dead_code)] // Each test program uses only a part.

mod time;

use std::hash::{BuildHasher, RandomState};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::OnceLock;

use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::light_paths::Part;
use gpugi::measure::{Cache, Measured, Options, Progress, Quality, Subject, Truth, measure, trace};
use gpugi::techniques::Registry;
use gpugi::{Purpose, Renderer, default_set};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::image::metrics::{self, Metric};
use gpugi_scene::{Camera, Light, Material, Mesh, Projection, Scene};

/// The best adapter, on a device that all tests of the program share. Returns `None`, so that the test passes without
/// testing, only if `GPUGI_SKIP_GPU=1`, or without time.
pub fn gpu() -> Option<Gpu> {
    static SHARED: OnceLock<Option<Gpu>> = OnceLock::new();
    if !time::there_is_time() {
        return None;
    }
    SHARED.get_or_init(open).clone()
}

/// As [`gpu`], on a device of its own.
pub fn own_gpu() -> Option<Gpu> {
    time::there_is_time().then(open).flatten()
}

fn open() -> Option<Gpu> {
    if std::env::var_os("GPUGI_SKIP_GPU").is_some_and(|value| value == "1") {
        eprintln!("skipped: GPUGI_SKIP_GPU=1");
        return None;
    }
    match Gpu::open(&AdapterChoice::Best) {
        Ok(gpu) => Some(gpu),
        Err(error) => panic!("{error} GPUGI_SKIP_GPU=1 skips the tests that need one."),
    }
}

/// Adds an instance of one mesh with one material.
pub fn place(scene: &mut Scene, mesh: Mesh, material: Material) -> usize {
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance("", mesh, material, Mat4::IDENTITY)
}

/// A mesh that faces inward.
pub fn inside_out(mut mesh: Mesh) -> Mesh {
    for triangle in mesh.indices.chunks_exact_mut(3) {
        triangle.swap(1, 2);
    }
    for normal in &mut mesh.normals {
        *normal = -*normal;
    }
    mesh.tangents.clear();
    mesh
}

/// An empty room of 2 x 1.5 x 3 m whose surfaces emit and reflect the same everywhere.
pub fn shining_room(emission: f32, albedo: Vec3) -> Scene {
    let mut scene = Scene::new("room");
    let room = inside_out(cuboid(vec3(-1.0, 0.0, -1.5), vec3(1.0, 1.5, 1.5), 1));
    let material = Material {
        emissive: Vec3::splat(emission),
        ..Material::matt("shining", albedo)
    };
    place(&mut scene, room, material);
    scene
}

/// A matt horizontal square of albedo 0.5 with sides of `2 half` (m) at height 0.
pub fn floor(half: f32) -> Scene {
    let mut scene = Scene::new("floor");
    let mesh = quad(
        Vec3::new(-half, 0.0, half),
        Vec3::X * 2.0 * half,
        Vec3::NEG_Z * 2.0 * half,
        1,
    );
    place(&mut scene, mesh, Material::matt("grey", Vec3::splat(0.5)));
    scene
}

/// A camera that looks straight down on a square of `side` (m) around the origin, from a height of `eye` (m).
pub fn from_above(side: f32, eye: f32) -> Camera {
    Camera {
        projection: Projection::Orthographic { height: side },
        ..Camera::look_at("above", Vec3::Y * eye, Vec3::ZERO, 1.0)
    }
}

/// The scene with one more light.
pub fn lit_by(mut scene: Scene, light: Light) -> Scene {
    scene.lights.push(light);
    scene
}

/// A surface point and its radiance.
#[derive(Debug, Clone, Copy)]
pub struct Lit {
    pub position: Vec3,
    pub normal: Vec3,
    pub instance: u32,
    pub radiance: Vec3,
}

/// A picture, and its surface points where there is a surface.
#[derive(Debug)]
pub struct Picture {
    pub radiance: Vec<f32>,
    pub points: Vec<Option<Lit>>,
}

impl Picture {
    /// The points that exist.
    pub fn lit(&self) -> impl Iterator<Item = &Lit> {
        self.points.iter().flatten()
    }
}

/// The techniques of a live view that add direct light, and what mirrors and glass make of it, where no paths are traced.
pub fn direct(gpu: &Gpu, scene: &Scene) -> Vec<String> {
    let registry = Registry::default();
    let mut adapter = gpu.adapter.clone();
    adapter.device_type = wgpu::DeviceType::IntegratedGpu;
    let mut names = default_set(scene, &adapter, Purpose::LiveView, &registry).names();
    names.retain(|name| name != "final-gather");
    names
}

/// As many samples of a renderer's picture as make its light: more where paths are traced, whose noise live views filter.
pub fn samples_of(renderer: &Renderer, samples: u32) -> u32 {
    let mut techniques = renderer.techniques().iter();
    match techniques.any(|technique| technique.info().is_noisy) {
        true => 32 * samples,
        false => samples,
    }
}

/// A renderer of direct light with settings in the form `technique.name=value`.
pub fn renderer(gpu: &Gpu, scene: &Scene, size: u32, settings: &[&str]) -> Renderer {
    let names = direct(gpu, scene);
    let mut renderer = Renderer::new(gpu, scene, [size, size], &names).expect("a renderer");
    for setting in settings {
        let (name, value) = setting.split_once('=').expect("technique.name=value");
        let (technique, name) = name.split_once('.').expect("technique.name=value");
        renderer.set(technique, name, value).expect("a setting");
    }
    renderer
}

/// A renderer of some techniques, with settings `name=value` of one of them.
pub fn renderer_of(
    gpu: &Gpu,
    scene: &Scene,
    techniques: &[&str],
    size: u32,
    of: &str,
    settings: &[&str],
) -> Renderer {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [size, size], &names).expect("a renderer");
    for setting in settings {
        let (name, value) = setting.split_once('=').expect("name=value");
        renderer.set(of, name, value).expect("a setting");
    }
    renderer
}

/// A picture of some samples beside one of the path tracer.
pub fn measured(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    renderer: &mut Renderer,
    samples: [u32; 2],
) -> Measured {
    measured_by(gpu, scene, camera, renderer, options(samples))
}

/// Options of a measurement, with the samples of the picture and of the path tracer.
pub fn options([samples, reference]: [u32; 2]) -> Options {
    Options {
        samples,
        reference: Quality {
            samples: reference,
            noise: 0.0,
        },
        ..Options::default()
    }
}

/// A picture beside one of the path tracer, which is kept: see [`kept`].
pub fn measured_by(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    renderer: &mut Renderer,
    options: Options,
) -> Measured {
    let options = kept(options);
    let found = measure(gpu, scene, camera, renderer, &options, &mut go_on);
    let found = found.expect("a measurement");
    let subject = Subject {
        scene,
        camera,
        size: found.size,
    };
    check(gpu, &subject, &found.truth, options);
    found
}

/// The path tracer's picture of a part of the light, which is kept: see [`kept`].
pub fn traced(gpu: &Gpu, subject: &Subject, part: Part, samples: u32) -> Truth {
    let options = kept(options([1, samples]));
    let truth = trace(gpu, subject, &[part], &options, &mut go_on).expect("a reference");
    check(gpu, subject, &truth, options);
    truth
}

/// Options by which the path tracer's pictures are kept in `tests/references`. What is missing is traced and kept.
///
/// With `GPUGI_REFERENCES=check`, as in continuous integration, a missing one fails the test, and a random fiftieth is
/// traced again and must be what is kept.
fn kept(options: Options) -> Options {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/references");
    Options {
        cache: Some(Cache::pinned(folder)),
        ..options
    }
}

/// Checks what was kept, if that is asked for. The same adapter takes the same paths, but for those that another processor
/// rounds otherwise; another adapter is held to the noise of both.
fn check(gpu: &Gpu, subject: &Subject, kept: &Truth, options: Options) {
    if std::env::var_os("GPUGI_REFERENCES").is_none_or(|value| value != "check") {
        return;
    }
    assert!(
        kept.is_cached(),
        "a reference is missing; make all of them with: ./gpugi test --references"
    );
    if !RandomState::new().hash_one(()).is_multiple_of(50) {
        return;
    }
    let options = Options {
        cache: None,
        ..options
    };
    let parts: Vec<_> = kept
        .parts
        .iter()
        .map(|traced| traced.part.clone())
        .collect();
    let again = trace(gpu, subject, &parts, &options, &mut go_on).expect("a reference");
    let [width, height] = subject.size;
    let [again, stored] = [&again, kept].map(|truth| {
        let picture = metrics::Picture::of_radiance(width, height, truth.radiance.clone());
        picture.expect("a picture")
    });
    let difference = metrics::compare(Metric::RelMse, &again, &stored).expect("rel-mse");
    let mut adapters = kept.parts.iter().map(|traced| &traced.adapter);
    let noises = match adapters.all(|adapter| *adapter == gpu.adapter.name) {
        true => 1.0,
        false => 3.0,
    };
    assert!(
        difference.value <= noises * kept.rel_mse() + 1e-9,
        "the path tracer differs from what is kept by a rel-mse of {}; if it should, make all references anew with: \
         ./gpugi test --references",
        difference.value
    );
}

fn go_on(_: &Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Relative mean squared error against the path tracer, without the path tracer's own error.
pub fn rel_mse(found: &Measured) -> f64 {
    found.value(Metric::RelMse).expect("a value") - found.truth.rel_mse()
}

/// One sample through pixel centres.
pub fn picture(renderer: &mut Renderer, camera: &Camera) -> Picture {
    renderer.restart();
    renderer
        .render_sample(camera, 1, None, false)
        .expect("a picture");
    let radiance = renderer.radiance().expect("radiance");
    let points = renderer.surface_points().expect("points");
    let points = points
        .into_iter()
        .zip(radiance.chunks_exact(3))
        .map(|(point, color)| {
            point.map(|point| Lit {
                position: point.position,
                normal: point.normal,
                instance: point.instance,
                radiance: Vec3::from_slice(color),
            })
        })
        .collect();
    assert!(
        radiance.iter().all(|value| value.is_finite()),
        "a radiance is not finite"
    );
    Picture { radiance, points }
}

/// Renders a scene once.
pub fn render(gpu: &Gpu, scene: &Scene, camera: &Camera, size: u32, settings: &[&str]) -> Picture {
    picture(&mut renderer(gpu, scene, size, settings), camera)
}

/// Whether a segment intersects an axis-aligned box.
pub fn meets(from: Vec3, to: Vec3, min: Vec3, max: Vec3) -> bool {
    let inverse = (to - from).recip();
    let (a, b) = ((min - from) * inverse, (max - from) * inverse);
    let (near, far) = (
        a.min(b).max_element().max(0.0),
        a.max(b).min_element().min(1.0),
    );
    near < far
}
