//! Rays in flight: the picture depends neither on their memory nor on the order in which they are listed. All tracers
//! find the same hits, and cones enclose their rays.

use glam::{DVec3, Mat4, Vec3, Vec4, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Environment, Material, Mesh, Scene, Volume};

use super::{INFO, RayTracing, gpu};
use crate::Renderer;
use crate::gpu::{Frame, Gpu, Kernel, read_buffer};
use crate::shader;
use crate::testing::test_gpu;

/// A renderer of this technique alone.
fn renderer(gpu: &Gpu, scene: &Scene, size: [u32; 2], settings: &[(&str, &str)]) -> Renderer {
    let names = [INFO.name.to_owned()];
    let mut renderer = Renderer::new(gpu, scene, size, &names).unwrap();
    for (name, value) in settings {
        renderer.set(INFO.name, name, value).unwrap();
    }
    renderer
}

/// Glass that lets this much light through per metre.
fn glass(attenuation_color: Vec3) -> Material {
    Material {
        transmission: 1.0,
        roughness: 0.0,
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color,
        }),
        ..Material::default()
    }
}

/// The mean of four samples of a glass ball before a sky, with at most `most_rays` rays in flight.
fn ball(gpu: &Gpu, most_rays: Option<u64>, split: &str) -> Vec<f32> {
    let mut scene = Scene::new("ball");
    let mesh = scene.add_mesh(sphere(0.5, 32));
    let material = scene.add_material(glass(vec3(0.5, 0.9, 0.7)));
    scene.add_instance("ball", mesh, material, Mat4::IDENTITY);
    scene.environment = Some(Environment::default_sky());
    // No multiple of a tile's side.
    let mut renderer = renderer(gpu, &scene, [90, 61], &[("split", split)]);
    let changed = renderer.change(|technique: &mut RayTracing| technique.most_rays = most_rays);
    changed.unwrap();
    let camera = Camera::look_at("", Vec3::new(0.3, 0.2, 1.4), Vec3::ZERO, 0.9);
    for _ in 0..4 {
        renderer.render_sample(&camera, 4, None, false).unwrap();
    }
    renderer.radiance().unwrap()
}

#[test]
fn chunks_make_the_same_picture() {
    let Some(gpu) = test_gpu() else { return };
    for split in ["0", "2"] {
        let whole = ball(&gpu, None, split);
        assert!(whole.iter().any(|&value| value > 0.01));
        assert_eq!(whole, ball(&gpu, None, split), "split {split}");
        assert_eq!(whole, ball(&gpu, Some(2048), split), "split {split}");
    }
}

/// Pseudo-random numbers from -1 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::from_array([(); 3].map(|()| self.next()))
    }
}

/// Random triangles around the origin, every fourth as thin as a thread.
fn soup(triangles: u32) -> Mesh {
    let mut random = Random(1);
    let mut positions = Vec::new();
    for triangle in 0..triangles {
        let at = random.vector().normalize_or(Vec3::X) * (2.0 + random.next());
        let (along, across) = (0.3 * random.vector(), 0.3 * random.vector());
        let width = if triangle % 4 == 0 { 1e-5 } else { 1.0 };
        positions.extend([at, at + along, at + along * 0.5 + across * width]);
    }
    let count = positions.len() as u32;
    Mesh {
        normals: vec![Vec3::Y; positions.len()],
        indices: (0..count).collect(),
        positions,
        ..Mesh::default()
    }
}

/// What shows a soup.
#[derive(Clone, Copy)]
enum Shown {
    FlatMirror,
    MirrorBall,
    GlassBall,
}

/// A mirror or glass in a soup, of which `copies` lie at the same place; the first of several is a mirror itself.
fn scene(shown: Shown, triangles: u32, copies: u32) -> Scene {
    let mut scene = Scene::new("soup");
    let mesh = scene.add_mesh(match shown {
        Shown::FlatMirror => quad(vec3(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y, 1),
        Shown::MirrorBall | Shown::GlassBall => sphere(0.5, 48),
    });
    let material = match shown {
        Shown::GlassBall => glass(Vec3::ONE),
        _ => Material::metal("mirror", Vec3::splat(0.9), 0.0),
    };
    let material = scene.add_material(material);
    scene.add_instance("mirror", mesh, material, Mat4::IDENTITY);
    let mesh = scene.add_mesh(soup(triangles));
    let lit = scene.add_material(Material {
        double_sided: true,
        ..Material::emitter("lit", Vec3::ONE)
    });
    let shining = scene.add_material(Material {
        double_sided: true,
        ..Material::metal("shining", Vec3::splat(0.8), 0.0)
    });
    let turned = Mat4::from_rotation_y(0.4) * Mat4::from_scale(vec3(1.0, 1.3, 0.9));
    for copy in 0..copies {
        let material = if copy == 0 && copies > 1 {
            shining
        } else {
            lit
        };
        scene.add_instance("soup", mesh, material, turned);
    }
    scene.environment = Some(Environment::default_sky());
    scene
}

/// Instance, primitive and bits of the distance of the latest hits, slot by slot, after one sample.
fn hits(gpu: &Gpu, scene: &Scene, tracer: &str) -> Vec<[u32; 4]> {
    let mut renderer = renderer(
        gpu,
        scene,
        [48, 48],
        &[("tracer", tracer), ("bounces", "2")],
    );
    let camera = Camera::look_at("", Vec3::Z * 1.2, Vec3::ZERO, 0.9);
    renderer.render_sample(&camera, 1, None, false).unwrap();
    let mut found = Vec::new();
    let look = |technique: &mut RayTracing| {
        let passes = technique.passes.get().unwrap();
        let in_flight = passes.in_flight.as_ref().unwrap();
        let rows: Vec<[u32; 4]> = read_buffer(gpu, &in_flight.rays, in_flight.rays.size()).unwrap();
        let capacity = in_flight.capacity as usize;
        let header = size_of::<gpu::Header>() / 16;
        found = rows[header + 4 * capacity..header + 6 * capacity].to_vec();
    };
    renderer.change(look).unwrap();
    found
}

fn assert_tracers_agree(gpu: &Gpu, scene: &Scene) {
    let expected = hits(gpu, scene, "bvh");
    let hit = |found: &&[u32; 4]| found[1] != u32::MAX && found[0] != 0;
    let some = expected[..expected.len() / 2].iter().filter(hit);
    assert!(some.count() > 300);
    for tracer in ["engine", "cones"] {
        let found = hits(gpu, scene, tracer);
        // Hardware compiles the same arithmetic otherwise in other kernels: distances differ in their last bits, and so
        // does what is nearer of two.
        let is_software = gpu.adapter.is_software();
        let rounding = if is_software { 0.0 } else { 1e-4 };
        let is_as_far = |a: &[u32; 4], b: &[u32; 4]| {
            let [a, b] = [a[0], b[0]].map(f32::from_bits);
            (a - b).abs() <= rounding * b.abs()
        };
        let pairs = found.iter().zip(&expected);
        let wrong = pairs.filter(|(a, b)| a != b && (is_software || !is_as_far(a, b)));
        assert_eq!(wrong.count(), 0, "{tracer}: of {}", expected.len());
    }
}

/// Also where two triangles are equally far, and where the triangles take several passes.
#[test]
fn all_tracers_find_the_same_hits() {
    let Some(gpu) = test_gpu() else { return };
    for shown in [Shown::MirrorBall, Shown::FlatMirror, Shown::GlassBall] {
        assert_tracers_agree(&gpu, &scene(shown, 6_000, 3));
    }
}

/// Spheres among triangles, two at the same place.
#[test]
fn all_tracers_find_the_same_spheres() {
    let Some(gpu) = test_gpu() else { return };
    for shown in [Shown::MirrorBall, Shown::GlassBall] {
        let mut scene = scene(shown, 6_000, 2);
        scene.instances[0].is_sphere = true;
        let shining = scene.instances[1].material;
        let ball = scene.instances[0].mesh;
        for index in 0..40_u32 {
            let angle = (index / 2) as f32;
            let at = vec3(angle.cos(), 0.3 * (angle * 3.0).sin(), angle.sin());
            let sides = vec3(0.3, 0.2, -0.4);
            let place = Mat4::from_translation(at * 1.3) * Mat4::from_scale(sides);
            let instance = scene.add_instance("sphere", ball, shining, place);
            scene.instances[instance].is_sphere = true;
        }
        assert_tracers_agree(&gpu, &scene);
    }
}

/// `Cone` of cone.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Cone {
    apex: [f32; 3],
    radius: f32,
    axis: [f32; 3],
    cosine: f32,
}

/// The cones around tiles of 256 rays: origin and direction, or none.
fn cones(gpu: &Gpu, rays: &[Option<[Vec3; 2]>]) -> Vec<Cone> {
    let given = rays.iter().flat_map(|ray| match ray {
        Some([origin, direction]) => [origin.extend(1.0), direction.extend(0.0)],
        None => [Vec4::ZERO; 2],
    });
    let given: Vec<[f32; 4]> = given.map(|row| row.to_array()).collect();
    let given = gpu.storage("rays", &given).unwrap();
    let tiles = rays.len() / 256;
    let size = (tiles * size_of::<Cone>()) as u64;
    let cones = gpu
        .buffer("cones", size, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let kernel = Kernel::new(gpu, &shader!("testing.cones"), "main", None).unwrap();
    let resources = [
        ("given", given.as_entire_binding()),
        ("cones", cones.as_entire_binding()),
    ];
    let group = kernel.bind(gpu, 0, &resources).unwrap();
    let mut frame = Frame::new(gpu, false);
    frame.compute("cones", |pass| {
        kernel.dispatch(pass, &[(0, &group)], [rays.len() as u32, 1, 1]);
    });
    frame.submit().unwrap();
    read_buffer(gpu, &cones, size).unwrap()
}

#[test]
fn cones_enclose_their_rays() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(7);
    let mut rays = Vec::new();
    for tile in 0..64 {
        let (centre, toward) = (random.vector() * 10.0, random.vector());
        let (spread, angle) = (random.next().abs(), random.next().abs());
        for lane in 0..256 {
            let near = [
                centre + spread * random.vector(),
                toward + angle * random.vector(),
            ];
            rays.push(match tile % 8 {
                // Anywhere; coherent; all the same; two opposite directions.
                0 => Some([random.vector() * 100.0, random.vector()]),
                1 | 2 => Some(near),
                3 => Some([centre, toward]),
                4 => Some([centre, if lane % 2 == 0 { toward } else { -toward }]),
                // Some do not exist; some are no rays; none exists.
                5 => (lane % 3 == 0).then_some(near),
                6 => Some(match lane % 5 {
                    0 => [Vec3::NAN, toward],
                    1 => [centre, Vec3::ZERO],
                    2 => [centre, Vec3::splat(f32::INFINITY)],
                    3 => [centre, vec3(f32::NAN, 1.0, 0.0)],
                    _ => near,
                }),
                _ => None,
            });
        }
    }
    let found = cones(&gpu, &rays);
    assert_eq!(found.len(), 64);
    for (tile, (cone, rays)) in found.iter().zip(rays.chunks_exact(256)).enumerate() {
        let (apex, axis) = (
            Vec3::from(cone.apex).as_dvec3(),
            Vec3::from(cone.axis).as_dvec3(),
        );
        assert!((axis.length() - 1.0).abs() < 1e-6, "tile {tile}: {cone:?}");
        let is_ray = |[origin, direction]: &[Vec3; 2]| {
            origin.is_finite() && direction.is_finite() && *direction != Vec3::ZERO
        };
        let rays: Vec<_> = rays.iter().flatten().filter(|ray| is_ray(ray)).collect();
        assert_eq!(rays.is_empty(), cone.radius < 0.0, "tile {tile}: {cone:?}");
        for [origin, direction] in rays {
            let direction: DVec3 = direction.as_dvec3().normalize();
            assert!(
                direction.dot(axis) >= f64::from(cone.cosine),
                "tile {tile}: {cone:?}"
            );
            let away = origin.as_dvec3().distance(apex);
            assert!(away <= f64::from(cone.radius), "tile {tile}: {cone:?}");
        }
        // Identical rays have a narrow cone.
        if tile % 8 == 3 {
            assert!(
                cone.cosine > 0.9999 && cone.radius < 1e-3,
                "tile {tile}: {cone:?}"
            );
        }
    }
}

/// The share of tests against triangles that cones spare (percent).
fn culled(gpu: &Gpu, shown: Shown, triangles: u32, bounces: &str) -> f64 {
    let scene = scene(shown, triangles, 1);
    let settings = [("tracer", "cones"), ("bounces", bounces)];
    let mut renderer = renderer(gpu, &scene, [128, 128], &settings);
    let camera = Camera::look_at("", Vec3::Z * 1.2, Vec3::ZERO, 0.9);
    renderer.render_sample(&camera, 1, None, false).unwrap();
    figures(&mut renderer, ["culled by cones"])[0]
}

/// The figures of these names, about the samples since the last question.
fn figures<const N: usize>(renderer: &mut Renderer, names: [&str; N]) -> [f64; N] {
    let all = renderer.figures().unwrap();
    names.map(|name| {
        let name = format!("{}.{name}", INFO.name);
        all.iter().find(|figure| figure.name == name).unwrap().value
    })
}

/// Neighbours in glass are reflected or refracted by chance: one cone around both would exclude little.
#[test]
fn cones_tell_reflected_rays_from_refracted_ones() {
    let Some(gpu) = test_gpu() else { return };
    let share = culled(&gpu, Shown::GlassBall, 1_000, "1");
    assert!(share > 75.0, "{share} %");
}

/// Each pixel of a mirror that fills the picture has one ray, in chunks as well, and none goes on from the sky.
#[test]
fn rays_are_counted() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("mirror");
    let mesh = scene.add_mesh(quad(
        vec3(-5.0, -5.0, 0.0),
        Vec3::X * 10.0,
        Vec3::Y * 10.0,
        1,
    ));
    let material = scene.add_material(Material::metal("mirror", Vec3::ONE, 0.0));
    scene.add_instance("mirror", mesh, material, Mat4::IDENTITY);
    scene.environment = Some(Environment::default_sky());
    let settings = [("bounces", "2"), ("tracer", "cones")];
    let mut renderer = renderer(&gpu, &scene, [64, 48], &settings);
    let few = renderer.change(|technique: &mut RayTracing| technique.most_rays = Some(1024));
    few.unwrap();
    let camera = Camera::look_at("", Vec3::Z, Vec3::ZERO, 0.9);
    for _ in 0..2 {
        renderer.render_sample(&camera, 1, None, false).unwrap();
        let names = [
            "rays",
            "rays of generation 1",
            "bytes of generation 1",
            "rays of generation 2",
        ];
        let expected = [3072.0, 3072.0, 3072.0 * 208.0, 0.0];
        assert_eq!(figures(&mut renderer, names), expected);
    }
}

/// `cargo test -p gpugi --lib culling -- --ignored --nocapture` prints the table of docs/techniques/ray-tracing.md.
#[test]
#[ignore = "prints a table"]
fn culling_rates() {
    let Some(gpu) = test_gpu() else { return };
    println!("| rays from | triangles | 1 generation | 4 generations |\n|---|---|---|---|");
    let all = [
        ("a flat mirror", Shown::FlatMirror),
        ("a mirror ball", Shown::MirrorBall),
        ("a glass ball", Shown::GlassBall),
    ];
    for (name, shown) in all {
        for triangles in [100, 1_000, 10_000] {
            let [one, four] = ["1", "4"].map(|bounces| culled(&gpu, shown, triangles, bounces));
            println!("| {name} | {triangles} | {one:.1} % | {four:.1} % |");
        }
    }
}
