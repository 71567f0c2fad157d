//! Tests transfer vectors and light against closed forms, and that progress may stop and continue anywhere.

mod clusters;
mod glossy;
mod harmonics;
mod wavelets;

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Environment, Image, Light, LightKind, Material, Mesh, Pixels, Scene};

use super::{RadianceTransfer, Saved};
use crate::capture::{CaptureKernels, Emission, View};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::scene::{Edit, GpuScene};
use crate::techniques::{Earlier, EarlierLight, Generated, Resume, Shared, Technique};
use crate::testing::{Point, read_points, settled, test_gpu};

/// An environment of `width` x `width / 2` texels with the radiance of each direction, rolled by some texels.
fn sky(width: u32, rolled: u32, radiance: impl Fn(Vec3) -> Vec3) -> Environment {
    let height = width / 2;
    let texel = |index: u32| {
        let column = (index % width + width - rolled) % width;
        let at = Vec2::new(column as f32 + 0.5, (index / width) as f32 + 0.5) / height as f32;
        let (phi, theta) = (PI * at.x - PI, PI * at.y);
        let direction = vec3(
            phi.sin() * theta.sin(),
            theta.cos(),
            -phi.cos() * theta.sin(),
        );
        radiance(direction).extend(1.0).to_array()
    };
    Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width,
            height,
            pixels: Pixels::Rgba32Float((0..width * height).flat_map(texel).collect()),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// A scene of white meshes under an environment.
fn scene_of(meshes: impl IntoIterator<Item = Mesh>, environment: Option<Environment>) -> Scene {
    let mut scene = Scene::new("scene");
    for mesh in meshes {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material::matt("white", Vec3::splat(0.8)));
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    }
    scene.environment = environment;
    scene
}

/// A scene on the GPU and the technique alone.
struct Solver {
    gpu: Gpu,
    scene: GpuScene,
    transfer: RadianceTransfer,
    emission: Emission,
    shared: Shared,
}

impl Solver {
    fn new(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> Self {
        let on_gpu = GpuScene::with_texels(gpu, scene).unwrap();
        let mut transfer = RadianceTransfer::default();
        let defaults = [("resolution", "32"), ("bounces", "1"), ("steps", "4096")];
        for (name, value) in defaults.iter().chain(settings) {
            transfer.settings_mut().set(name, value).unwrap();
        }
        transfer.plan(&on_gpu, &[], &[]);
        let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
        Self {
            emission: Emission::new(gpu, &on_gpu).unwrap(),
            shared: Shared::new(gpu, &on_gpu, &kernels).unwrap(),
            gpu: gpu.clone(),
            scene: on_gpu,
            transfer,
        }
    }

    /// One frame.
    fn frame(&mut self) -> Generated {
        self.try_frame().unwrap()
    }

    fn try_frame(&mut self) -> Result<Generated, GpuError> {
        self.scene.wait_for_atlas();
        let camera = Camera::look_at("", Vec3::ONE, Vec3::ZERO, 1.0);
        let view = View::new(&camera, [8, 8], Vec2::ZERO, 0, 0, 1.0);
        let mut frame = Frame::new(&self.gpu, false);
        self.scene.merge(&mut frame);
        let mut earlier = Earlier::unlimited(
            EarlierLight::new(&mut self.emission, &mut []),
            &mut self.shared,
        );
        let (transfer, scene) = (&mut self.transfer, &self.scene);
        let generated = settled(transfer.generate(&mut frame, scene, &view, &mut earlier))?;
        frame.submit()?;
        Ok(generated)
    }

    /// Frames until the texels are there: until then, progress is that of unwrapping them.
    fn with_atlas(mut self) -> Self {
        while self.transfer.texels.get().is_none() {
            self.frame();
        }
        self
    }

    /// Frames until the transfer vectors are final.
    fn solve(self) -> Self {
        let mut lit = self.with_atlas();
        while lit.frame().progress < 1.0 {}
        lit
    }

    /// The texels that have points, with their irradiance.
    fn texels(&self) -> Vec<(Point, Vec3)> {
        let made = self.transfer.texels.get().unwrap();
        let found = self.floats(&made.irradiance.target.radiance);
        self.with_points(found.into_iter().map(|[r, g, b, _]| vec3(r, g, b)))
    }

    /// The same without the filter that makes both sides of seams agree.
    fn unfiltered(&self) -> Vec<(Point, Vec3)> {
        let (light, vectors) = (self.light(), self.vectors());
        let half = |word: u32| half::f16::from_bits(word as u16).to_f32();
        let term = |(words, light): (&[u32], &Vec3)| {
            PI * *light * vec3(half(words[0]), half(words[0] >> 16), half(words[1]))
        };
        let functions = self.transfer.settings.terms() as usize;
        let texels = vectors.chunks(2 * functions);
        self.with_points(texels.map(|words| words.chunks(2).zip(&light).map(term).sum()))
    }

    /// The texels that have points, with a value each.
    fn with_points(&self, values: impl Iterator<Item = Vec3>) -> Vec<(Point, Vec3)> {
        let made = self.transfer.texels.get().unwrap();
        let points = made.places.capture().expect("texels").points();
        let points = points.flat_map(|points| read_points(&self.gpu, &self.scene, points));
        let texels = points.zip(values);
        texels
            .filter(|(point, _)| point.instance != u32::MAX)
            .collect()
    }

    /// Coefficients of the light.
    fn light(&self) -> Vec<Vec3> {
        let made = self.transfer.texels.get().unwrap();
        let light = self.floats(&made.light.coefficients);
        light
            .into_iter()
            .map(|[r, g, b, _]| vec3(r, g, b))
            .collect()
    }

    /// All transfer vectors, as they are stored.
    fn vectors(&self) -> Vec<u32> {
        let made = self.transfer.texels.get().unwrap();
        let vectors = made.transfer.vectors().expect("vectors");
        read_buffer(&self.gpu, vectors, vectors.size()).unwrap()
    }

    fn floats(&self, buffer: &wgpu::Buffer) -> Vec<[f32; 4]> {
        read_buffer(&self.gpu, buffer, buffer.size()).unwrap()
    }
}

/// The largest error of the texels' irradiance, relative to `scale`.
fn worst(texels: &[(Point, Vec3)], scale: f32, irradiance: impl Fn(&Point) -> Vec3) -> f32 {
    assert!(texels.len() > 100, "{} texels", texels.len());
    let errors = texels
        .iter()
        .map(|(point, found)| (*found - irradiance(point)).abs());
    errors.fold(0.0, |worst, error| f32::max(worst, error.max_element())) / scale
}

const A: Vec3 = Vec3::new(0.6, 0.48, -0.64);

/// Irradiance of a surface that sees the whole sky: each band of the light times pi, 2 pi / 3 and pi / 4 (Ramamoorthi
/// and Hanrahan 2001).
#[test]
fn constant_linear_and_quadratic_light_is_exact_on_a_sphere_and_a_plane() {
    let Some(gpu) = test_gpu() else { return };
    let band = |x: f32, linear: f32, quadratic: f32| {
        let two = 1.5 * x * x - 0.5;
        vec3(1.0, 1.0 + linear * x, 1.0 + quadratic * two)
    };
    let environment = sky(256, 0, |direction| band(direction.dot(A), 0.8, 0.9));
    let expected = |point: &Point| PI * band(point.normal.dot(A), 0.8 * 2.0 / 3.0, 0.9 / 4.0);
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    for (mesh, order) in [(sphere(1.0, 96), "6"), (plane.clone(), "6"), (plane, "8")] {
        let scene = scene_of([mesh], Some(environment.clone()));
        let solver = Solver::new(&gpu, &scene, &[("order", order)]).solve();
        let error = worst(&solver.unfiltered(), PI, expected);
        println!("order {order}: {error}");
        assert!(error < 0.006, "{error}");
    }
}

/// The same at vertices: points are the vertices of the meshes, in order.
#[test]
fn constant_linear_and_quadratic_light_is_exact_at_vertices() {
    let Some(gpu) = test_gpu() else { return };
    let band = |x: f32| 1.0 + 0.8 * x + 0.9 * (1.5 * x * x - 0.5);
    let environment = sky(256, 0, |direction| Vec3::splat(band(direction.dot(A))));
    let expected = |normal: &Vec3| {
        let x = normal.dot(A);
        PI * (1.0 + 0.8 * x * 2.0 / 3.0 + 0.9 * (1.5 * x * x - 0.5) / 4.0)
    };
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 4);
    for mesh in [sphere(1.0, 32), plane] {
        let normals = mesh.normals.clone();
        let scene = scene_of([mesh], Some(environment.clone()));
        let solver = Solver::new(&gpu, &scene, &[("at", "vertices")]).solve();
        let made = solver.transfer.texels.get().unwrap();
        let found = solver.floats(&made.irradiance.target.radiance);
        // At its poles, the sphere has vertices without a triangle.
        let pairs = normals.iter().zip(&found);
        let pairs: Vec<_> = pairs.filter(|(_, found)| found[3] == 1.0).collect();
        let errors = pairs
            .iter()
            .map(|(normal, found)| (found[0] - expected(normal)).abs());
        let worst = errors.fold(0.0, f32::max) / PI;
        println!("{worst} at {} of {} vertices", pairs.len(), normals.len());
        assert!(pairs.len() + 4 > normals.len() && worst < 0.006, "{worst}");
        assert_eq!(found[normals.len()][3], 0.0);
    }
}

/// A rectangle overhead takes away its form factor, one corner at a time: 1 / (2 pi) (X / a atan Y / a + Y / b atan X /
/// b), a = sqrt(1 + X^2), b = sqrt(1 + Y^2), X and Y in heights.
#[test]
fn a_rectangle_overhead_takes_away_its_form_factor() {
    let Some(gpu) = test_gpu() else { return };
    let height = 0.5;
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let roof = quad(vec3(-0.5, height, -0.75), Vec3::X, Vec3::Z * 1.5, 1);
    let scene = scene_of([floor, roof], Some(sky(16, 0, |_| Vec3::ONE)));
    let solver = Solver::new(&gpu, &scene, &[]).solve();
    let corner = |x: f32, y: f32| {
        let (a, b) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        (x / a * (y / a).atan() + y / b * (x / b).atan()) / (2.0 * PI)
    };
    let expected = |point: &Point| {
        if point.instance == 1 {
            // The roof faces down: it sees the floor's form factor less of the sky below.
            return Vec3::NAN;
        }
        let [x0, x1] = [-0.5, 0.5].map(|x| (x - point.position.x) / height);
        let [z0, z1] = [-0.75, 0.75].map(|z| (z - point.position.z) / height);
        let factor = corner(x1, z1) - corner(x0, z1) - corner(x1, z0) + corner(x0, z0);
        Vec3::splat(PI * (1.0 - factor))
    };
    // NaN is ignored by `f32::max`.
    let error = worst(&solver.texels(), PI, expected);
    println!("{error}");
    assert!(error < 0.008, "{error}");
}

/// Directional light E on a plane that faces it gives E times the sum of (2 l + 1) / 4 A_l / pi over the bands: 1,
/// 2 / 3, 1 / 4, 0, -1 / 24, 0.
#[test]
fn a_directional_light_is_the_sum_of_its_bands() {
    let Some(gpu) = test_gpu() else { return };
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let mut scene = scene_of([plane], None);
    let sun = Light::new("sun", LightKind::Directional, vec3(2.0, 1.0, 0.5));
    scene
        .lights
        .push(sun.aimed(Vec3::Y, Vec3::ZERO + Vec3::X * 1e-4));
    let with_sun = ("directional-lights", "true");
    let solver = Solver::new(&gpu, &scene, &[with_sun]).solve();
    let share = (1.0 + 3.0 * 2.0 / 3.0 + 5.0 / 4.0 - 9.0 / 24.0) / 4.0;
    let error = worst(&solver.texels(), 2.0, |_| vec3(2.0, 1.0, 0.5) * share);
    println!("{error}");
    assert!(error < 0.01, "{error}");
    // A lamp that is not directional would be left out: then none is added.
    let lamp = Light::new("lamp", LightKind::Point, Vec3::ONE);
    scene.lights.push(lamp);
    let solver = Solver::new(&gpu, &scene, &[with_sun]).solve();
    assert!(
        solver
            .texels()
            .iter()
            .all(|(_, found)| *found == Vec3::ZERO)
    );
}

/// Light that would ring to negative values does not with a window; its mean stays.
#[test]
fn windowed_light_is_negative_nowhere() {
    let Some(gpu) = test_gpu() else { return };
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let mut scene = scene_of([plane], Some(sky(16, 0, |_| Vec3::splat(0.05))));
    let sun = Light::new("sun", LightKind::Directional, Vec3::ONE);
    scene
        .lights
        .push(sun.aimed(vec3(0.3, 1.0, 0.5), Vec3::ZERO));
    let light = |window| {
        let settings = [
            ("directional-lights", "true"),
            ("window", window),
            ("rays", "64"),
        ];
        let light = Solver::new(&gpu, &scene, &settings).solve().light();
        let values = harmonics::series(&gpu, &light);
        let least = values
            .iter()
            .fold(f32::INFINITY, |least, value| least.min(value.x));
        (
            light[0].x,
            least,
            values.iter().fold(0.0_f32, |most, value| most.max(value.x)),
        )
    };
    let [(mean, least, most), (kept, damped, _)] = ["false", "true"].map(light);
    println!("{least} to {most}; damped {damped}");
    assert!(least < -0.1 * most);
    assert!(damped > -1e-3 * most, "{damped}");
    assert!((kept - mean).abs() < 1e-6, "{mean} {kept}");
}

/// Turning coefficients gives those of the turned image; turning back gives the first ones.
#[test]
fn turned_coefficients_are_those_of_the_turned_environment() {
    let Some(gpu) = test_gpu() else { return };
    let colors = |direction: Vec3| {
        let [x, y, z] = direction.to_array();
        vec3(
            1.0 + x * y,
            (4.0 * z).exp() / 20.0,
            1.0 + (3.0 * x - 2.0 * z).sin(),
        )
    };
    let plane = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let light = |rolled: u32, rotation: f32, intensity: f32| {
        let environment = Environment {
            rotation: glam::Quat::from_rotation_y(rotation),
            intensity,
            ..sky(128, rolled, colors)
        };
        let scene = scene_of([plane.clone()], Some(environment));
        let settings = [("order", "8"), ("rays", "1"), ("resolution", "16")];
        Solver::new(&gpu, &scene, &settings).solve().light()
    };
    let off = |light: &[Vec3], other: &[Vec3]| {
        let pairs = light.iter().zip(other);
        let pairs = pairs.map(|(texel, other)| (*texel - *other).abs().max_element());
        pairs.fold(0.0, f32::max)
    };
    let straight = light(0, 0.0, 1.0);
    // u grows as the angle about +Y falls.
    let angle = -std::f32::consts::TAU * 21.0 / 128.0;
    let error = off(&light(0, angle, 1.0), &light(21, 0.0, 1.0));
    let back = off(
        &light(21, -angle, 2.0),
        &straight
            .iter()
            .map(|texel| 2.0 * *texel)
            .collect::<Vec<_>>(),
    );
    let turned = off(&light(0, angle, 1.0), &straight);
    println!("{error} {back}; turning changes {turned}");
    assert!(error < 2e-3 && back < 4e-3, "{error} {back}");
    assert!(turned > 0.5, "{turned}");
}

/// A scene with several bounces.
fn corner() -> Scene {
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let wall = quad(vec3(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Y * 2.0, 1);
    scene_of(
        [floor, wall, sphere(0.4, 16)],
        Some(Environment::default_sky()),
    )
}

/// Other light needs no new transfer vectors, and gives what it gives from the beginning.
#[test]
fn other_light_lights_the_same_vectors() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("bounces", "2"), ("rays", "64")];
    let mut solver = Solver::new(&gpu, &corner(), &settings).solve();
    let vectors = solver.vectors();
    let before = solver.texels();
    let mut turned = corner();
    turned.environment.as_mut().unwrap().rotation = glam::Quat::from_rotation_y(1.0);
    let edit = Edit::Environment(turned.environment.clone().unwrap());
    solver.scene.edit(&gpu, &[edit]).unwrap();
    let generated = solver.frame();
    assert!(generated.progress >= 1.0, "{generated:?}");
    let after = solver.texels();
    let fresh = Solver::new(&gpu, &turned, &settings).solve();
    assert!(
        after
            .iter()
            .map(|texel| texel.1)
            .eq(fresh.texels().iter().map(|texel| texel.1))
    );
    assert!(
        !after
            .iter()
            .map(|texel| texel.1)
            .eq(before.iter().map(|texel| texel.1))
    );
    assert!(solver.vectors() == vectors);
    // Other materials do.
    let material = Box::new(Material::matt("grey", Vec3::splat(0.1)));
    solver
        .scene
        .edit(&gpu, &[Edit::Material { index: 0, material }])
        .unwrap();
    assert_eq!(solver.frame().progress, 1.0);
    assert!(solver.vectors() != vectors);
}

/// The same bits, however the texels are cut and whenever the work stopped.
#[test]
fn vectors_are_the_same_bits_however_they_are_made() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("bounces", "3"), ("rays", "64"), ("order", "3")];
    let whole = Solver::new(&gpu, &corner(), &settings).solve();
    let mut cut = Solver::new(&gpu, &corner(), &settings);
    cut.transfer.cut.most_texels = Some(32 * 5);
    assert!(whole.vectors() == cut.solve().vectors());
    // Steps of 256 texels: four tiles per bounce.
    let step_by_step = [&settings[..], &[("steps", "1")]].concat();
    let begun = || {
        let mut solver = Solver::new(&gpu, &corner(), &step_by_step);
        solver.transfer.cut.rays_of_step = 256 * 64;
        solver
    };
    let mut first = begun();
    assert!(first.transfer.save(&gpu).unwrap().is_none());
    first = first.with_atlas();
    for stop in [2, 4, 7] {
        let mut rest = begun().with_atlas();
        while first.frame().progress < stop as f32 / 12.0 - 1e-3 {}
        let saved = first.transfer.save(&gpu).unwrap().unwrap();
        assert_eq!(rest.transfer.resume(&gpu, &saved), Ok(true));
        let generated = rest.frame();
        assert!(generated.progress > stop as f32 / 12.0, "{generated:?}");
        assert!(
            rest.solve().vectors() == whole.vectors(),
            "from {stop} steps on"
        );
    }
}

#[test]
fn what_was_not_saved_for_it_is_refused() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [("bounces", "2"), ("rays", "64")];
    let mut solver = Solver::new(&gpu, &corner(), &settings).solve();
    let bytes = solver.transfer.save(&gpu).unwrap().unwrap();
    assert_eq!(solver.transfer.resume(&gpu, &bytes), Ok(true));
    let mut changed = |change: &dyn Fn(&mut super::transfer::Saved)| {
        let mut saved: Saved = postcard::from_bytes(&bytes).unwrap();
        change(&mut saved.transfer);
        let saved = postcard::to_allocvec(&saved).unwrap();
        solver.transfer.resume(&gpu, &saved)
    };
    assert!(changed(&|saved| saved.bounces = 3).is_err());
    assert!(changed(&|saved| saved.tiles = 1).is_err());
    assert!(changed(&|saved| saved.vectors.truncate(9)).is_err());
    assert!(changed(&|saved| saved.albedos.push(0)).is_err());
    assert!(changed(&|saved| saved.next.push(0)).is_err());
    assert!(changed(&|saved| saved.vectors[5] = 0x7c00_0000).is_err());
    assert!(
        solver
            .transfer
            .resume(&gpu, &bytes[..bytes.len() - 7])
            .is_err()
    );
}
