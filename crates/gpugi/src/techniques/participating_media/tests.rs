//! The network against a direct solution, and pictures against what is known.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use glam::{DVec3, Mat4, UVec3, Vec3, uvec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{
    Camera, DensityGrid, Environment, Image, Light, LightKind, Material, Medium, PhaseFunction,
    Pixels, Scene,
};

use super::{INFO, ParticipatingMedia};
use crate::Renderer;
use crate::gpu::{Gpu, read_buffer};
use crate::testing::{Random, test_gpu};

/// A medium in a box of sides 2 m around the origin.
fn medium(extinction: f32, albedo: f32, g: f32) -> Medium {
    Medium {
        name: "fog".into(),
        world_from_box: Some(Mat4::from_scale(Vec3::splat(2.0))),
        extinction: Vec3::splat(extinction),
        albedo: Vec3::splat(albedo),
        phase: PhaseFunction::HenyeyGreenstein(g),
        emission: Vec3::ZERO,
        density: None,
        node: None,
    }
}

/// An environment of radiance 1 in all directions.
fn white() -> Environment {
    Environment {
        image: std::sync::Arc::new(Image {
            name: "white".into(),
            width: 4,
            height: 2,
            pixels: Pixels::Rgba32Float(vec![1.0; 32]),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

fn front() -> Camera {
    Camera::look_at("front", vec3(0.4, 0.3, 5.0), Vec3::ZERO, 0.35)
}

/// The mean of some samples of a picture, with final maps.
fn picture(gpu: &Gpu, scene: &Scene, techniques: &[&str], settings: &[(&str, &str)]) -> Vec<f32> {
    let mut renderer = renderer(gpu, scene, techniques, settings);
    render(&mut renderer, 4)
}

fn renderer(gpu: &Gpu, scene: &Scene, techniques: &[&str], settings: &[(&str, &str)]) -> Renderer {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [16, 16], &names).unwrap();
    for (name, value) in settings {
        renderer.set(INFO.name, name, value).unwrap();
    }
    renderer
}

/// Renders until maps are final, and then some samples.
fn render(renderer: &mut Renderer, samples: u32) -> Vec<f32> {
    let go_on = |_, _| ControlFlow::Continue(());
    renderer.converge(&front(), false, go_on).unwrap();
    renderer.restart();
    for _ in 0..samples {
        renderer
            .render_sample(&front(), samples, None, false)
            .unwrap();
    }
    let radiance = renderer.radiance().unwrap();
    assert!(radiance.iter().all(|value| value.is_finite()));
    radiance
}

/// Solves the equation of the network by elimination, in double precision: I = T I_q + w_p S_p + w_q S_q with
/// S = E + a W I is linear in all I[p, i]. The medium is grey, so that all channels have the same matrix.
fn solve(network: &Arrays) -> Vec<DVec3> {
    let directions = network.directions;
    let count = network.particles * directions;
    let mut rows = Vec::with_capacity(count);
    let mut right = Vec::with_capacity(count);
    for (index, &(q, depth)) in network.visible.iter().enumerate() {
        let i = index % directions;
        let (transmittance, absorbed) = ((-depth).exp(), -(-depth).exp_m1());
        let far = if depth > 1e-4 {
            (absorbed - depth * transmittance) / depth
        } else {
            depth / 2.0
        };
        let mut row = vec![0.0; count];
        let mut known = DVec3::ZERO;
        row[index] += 1.0;
        let far_index = if q < SURFACE {
            row[q as usize * directions + i] -= transmittance;
            q as usize * directions + i
        } else {
            if q > SURFACE {
                known += transmittance * network.sky[i];
            }
            index
        };
        for (weight, at) in [(absorbed - far, index), (far, far_index)] {
            known += weight * network.emitted[at];
            let first = at - i;
            for d in 0..directions {
                let phase = f64::from(network.phase[i * directions + d]);
                row[first + d] -= weight * network.albedo * phase;
            }
        }
        rows.push(row);
        right.push(known);
    }
    // The matrix is strictly diagonally dominant by rows: no pivot is needed.
    for pivot in 0..count {
        let (above, below) = rows.split_at_mut(pivot + 1);
        let row = &above[pivot];
        for (offset, other) in below.iter_mut().enumerate() {
            let factor = other[pivot] / row[pivot];
            if factor != 0.0 {
                let pairs = other[pivot..].iter_mut().zip(&row[pivot..]);
                pairs.for_each(|(a, b)| *a -= factor * b);
                let known = right[pivot];
                right[pivot + 1 + offset] -= factor * known;
            }
        }
    }
    for pivot in (0..count).rev() {
        let solved = rows[pivot][pivot + 1..].iter().zip(&right[pivot + 1..]);
        let sum: DVec3 = solved.map(|(&a, &b)| a * b).sum();
        right[pivot] = (right[pivot] - sum) / rows[pivot][pivot];
    }
    right
}

/// What a particle sees where it sees a surface; the sky is one more.
const SURFACE: u32 = u32::MAX - 1;

/// The arrays of a network on the host.
struct Arrays {
    particles: usize,
    directions: usize,
    albedo: f64,
    phase: Vec<f32>,
    visible: Vec<(u32, f64)>,
    emitted: Vec<DVec3>,
    sky: Vec<DVec3>,
    incoming: Vec<DVec3>,
}

impl Arrays {
    fn read(gpu: &Gpu, renderer: &mut Renderer, albedo: f32) -> Self {
        let mut read = None;
        let look = |technique: &mut ParticipatingMedia| {
            let network = &technique.lit.get().unwrap().as_ref().unwrap().network;
            let radiance = |buffer: &wgpu::Buffer| {
                let rows: Vec<[f32; 4]> = read_buffer(gpu, buffer, buffer.size()).unwrap();
                let rgb = |[r, g, b, _]: [f32; 4]| DVec3::new(r.into(), g.into(), b.into());
                rows.into_iter().map(rgb).collect::<Vec<_>>()
            };
            let rows: Vec<[u32; 4]> =
                read_buffer(gpu, &network.visible, network.visible.size()).unwrap();
            let depth = |[q, red, _, _]: [u32; 4]| (q, f64::from(f32::from_bits(red)));
            let visible = rows.into_iter().map(depth);
            let matrices = &network.phase_matrices;
            read = Some(Self {
                particles: network.values.particles as usize,
                directions: network.values.directions as usize,
                albedo: albedo.into(),
                phase: read_buffer(gpu, matrices, matrices.size()).unwrap(),
                visible: visible.collect(),
                emitted: radiance(&network.emitted),
                sky: radiance(&network.sky),
                incoming: radiance(network.latest()),
            });
        };
        renderer.change(look).unwrap();
        read.unwrap()
    }
}

#[test]
fn the_fixed_point_is_that_of_the_equation() {
    let Some(gpu) = test_gpu() else { return };
    for g in [0.0, 0.6] {
        let mut scene = Scene::new("fog");
        scene.media.push(medium(2.0, 0.9, g));
        scene.environment = Some(Environment::default_sky());
        let sun = Light::new("sun", LightKind::Directional, vec3(3.0, 2.0, 1.0));
        scene.lights = vec![sun.aimed(vec3(1.0, 2.0, 0.5), Vec3::ZERO)];
        let settings = [
            ("particles", "64"),
            ("directions", "32"),
            ("most-iterations", "256"),
            ("iterations", "32"),
        ];
        let mut renderer = renderer(&gpu, &scene, &[INFO.name], &settings);
        render(&mut renderer, 1);
        let found = Arrays::read(&gpu, &mut renderer, 0.9);
        // Most particles see others, and none sees itself.
        let others = found.visible.iter().filter(|(q, _)| *q < 64);
        assert!(others.count() > 32 * 64 / 2);
        let is_self = |(index, (q, _)): (usize, &(u32, f64))| *q as usize == index / 32;
        assert!(!found.visible.iter().enumerate().any(is_self));
        let solved = solve(&found);
        let largest = solved
            .iter()
            .map(|radiance| radiance.max_element())
            .fold(0.0, f64::max);
        for (solved, found) in solved.iter().zip(&found.incoming) {
            let error = (*solved - *found).abs().max_element() / largest;
            assert!(error < 1e-4, "g {g}: {found} instead of {solved}");
        }
        assert!(largest > 0.1, "{largest}");
    }
}

/// With windows so fine that a pixel is a ray, peeled layers are what rays meet; coarse ones are nearly that.
#[test]
fn peeled_links_are_those_that_rays_find() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("fog");
    scene.media.push(medium(2.0, 0.9, 0.0));
    let links = |visibility: &str, window: &str| {
        let settings = [
            ("particles", "200"),
            ("directions", "16"),
            ("visibility", visibility),
            ("window", window),
        ];
        let mut renderer = renderer(&gpu, &scene, &[INFO.name], &settings);
        render(&mut renderer, 1);
        Arrays::read(&gpu, &mut renderer, 0.9).visible
    };
    let rays = links("rays", "64");
    let same = |window: &str| {
        let peeled = links("peel", window);
        let mut same = 0;
        for (peeled, ray) in peeled.iter().zip(&rays) {
            assert!(peeled.0 == u32::MAX || peeled.0 < 200, "{}", peeled.0);
            if peeled.0 == ray.0 {
                assert!((peeled.1 - ray.1).abs() < 1e-4, "{peeled:?} {ray:?}");
                same += 1;
            }
        }
        f64::from(same) / rays.len() as f64
    };
    let [fine, coarse] = ["256", "16"].map(same);
    println!("{fine:.4} of the links, {coarse:.4} with coarse windows");
    assert!(fine > 0.97, "{fine}");
    assert!(coarse > 0.6 && coarse < fine, "{coarse}");
}

/// Radiance 1 from everywhere is radiance 1 through a medium that absorbs nothing.
#[test]
fn a_medium_without_absorption_vanishes_in_even_light() {
    let Some(gpu) = test_gpu() else { return };
    for g in [0.0, 0.7] {
        let mut scene = Scene::new("furnace");
        scene.media.push(medium(3.0, 1.0, g));
        scene.environment = Some(white());
        let settings = [
            ("particles", "256"),
            ("directions", "32"),
            ("iterations", "32"),
        ];
        let settings = [&settings[..], &[("most-iterations", "256")]].concat();
        for value in picture(&gpu, &scene, &[INFO.name], &settings) {
            assert!((value - 1.0).abs() < 2e-3, "g {g}: {value}");
        }
    }
}

/// T = exp(-tau d) dims what is behind, up to the surface: a wall of radiance 1, 0.5 m inside of the box.
#[test]
fn media_dim_what_is_behind() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("wall");
    scene.media.push(Medium {
        extinction: vec3(1.0, 0.5, 0.0),
        ..medium(1.0, 0.0, 0.0)
    });
    let wall = quad(vec3(-9.0, -9.0, -0.5), Vec3::X * 18.0, Vec3::Y * 18.0, 1);
    let mesh = scene.add_mesh(wall);
    let material = scene.add_material(Material {
        emissive: Vec3::ONE,
        ..Material::matt("wall", Vec3::ZERO)
    });
    scene.add_instance("wall", mesh, material, Mat4::IDENTITY);
    let found = picture(&gpu, &scene, &[INFO.name], &[("particles", "64")]);
    let camera = front();
    // The middle of the picture.
    let at = (8 * 16 + 8) * 3;
    let eye = camera.world_from_view.w_axis.truncate();
    let along = (-eye).normalize();
    let inside = 1.5 / along.z.abs();
    for (channel, extinction) in [1.0_f32, 0.5, 0.0].into_iter().enumerate() {
        let expected = (-extinction * inside).exp();
        let value = found[at + channel];
        assert!(
            (value - expected).abs() < 0.01 * expected,
            "{value}, not {expected}"
        );
    }
}

#[test]
fn a_medium_without_extinction_changes_no_pixel() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("clear");
    scene.environment = Some(Environment::default_sky());
    let mesh = scene.add_mesh(quad(
        vec3(-1.0, -0.5, 1.0),
        Vec3::X * 2.0,
        Vec3::Z * -2.0,
        1,
    ));
    let material = scene.add_material(Material::matt("floor", Vec3::splat(0.5)));
    scene.add_instance("floor", mesh, material, Mat4::IDENTITY);
    let techniques = ["image-based-lighting", INFO.name];
    let without = picture(&gpu, &scene, &techniques[..1], &[]);
    scene.media.push(medium(0.0, 0.9, 0.0));
    assert_eq!(without, picture(&gpu, &scene, &techniques, &[]));
    scene.media[0].extinction = Vec3::ONE;
    assert_ne!(without, picture(&gpu, &scene, &techniques, &[]));
}

#[test]
fn media_without_meaning_are_refused() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("wrong");
    scene.media.push(medium(-1.0, 0.9, 0.0));
    let names = [INFO.name.to_owned()];
    let refused = Renderer::new(&gpu, &scene, [8, 8], &names).unwrap_err();
    assert!(refused.to_string().contains("extinction"), "{refused}");
}

/// Light that moves spreads from the last solution to the one that a new renderer finds.
#[test]
fn moved_lights_lead_to_the_same_light() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("fog");
    scene.media.push(medium(2.0, 0.9, 0.3));
    let sun = Light::new("sun", LightKind::Directional, Vec3::ONE);
    scene.lights = vec![sun.clone().aimed(vec3(1.0, 2.0, 0.5), Vec3::ZERO)];
    let settings = [
        ("particles", "64"),
        ("directions", "32"),
        ("iterations", "8"),
    ];
    let mut moved = renderer(&gpu, &scene, &[INFO.name], &settings);
    let before = render(&mut moved, 1);
    scene.lights = vec![sun.aimed(vec3(-1.0, 0.5, 2.0), Vec3::ZERO)];
    moved.update(&scene).unwrap();
    let after = render(&mut moved, 1);
    let fresh = render(&mut renderer(&gpu, &scene, &[INFO.name], &settings), 1);
    let furthest = |a: &[f32], b: &[f32]| {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(furthest(&before, &fresh) > 0.01);
    assert!(furthest(&after, &fresh) < 1e-5);
}

/// A lamp where a particle is, the first one in the middle of the box, counts as one that is spread over its sphere.
#[test]
fn lamps_inside_of_particles_stay_bounded() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("lamp");
    scene.media.push(medium(2.0, 1.0, 0.0));
    scene.lights = vec![Light::new("lamp", LightKind::Point, Vec3::ONE)];
    let settings = [
        ("particles", "64"),
        ("directions", "8"),
        ("most-iterations", "0"),
    ];
    let mut renderer = renderer(&gpu, &scene, &[INFO.name], &settings);
    render(&mut renderer, 1);
    let found = Arrays::read(&gpu, &mut renderer, 1.0);
    // 64 spheres have the volume of 8 m^3.
    let radius = (8.0_f64 / 64.0 * 0.75 / PI).cbrt();
    let expected = 3.0 / (radius * radius) / (4.0 * PI);
    for value in &found.emitted[..8] {
        assert!((value.x - expected).abs() < 1e-3 * expected, "{value}");
    }
    assert!(found.emitted[8..].iter().all(|value| value.x < expected));
}

/// A mirror ball, and a layer of 2 m behind the camera that emits 0.25 W/(m^3 sr).
fn mirror(extinction: f32) -> Scene {
    let mut scene = Scene::new("mirror");
    scene.media.push(Medium {
        world_from_box: Some(
            Mat4::from_translation(Vec3::Z * 8.0) * Mat4::from_scale(vec3(40.0, 40.0, 2.0)),
        ),
        emission: Vec3::splat(0.25),
        ..medium(extinction, 0.0, 0.0)
    });
    let mesh = scene.add_mesh(sphere(0.5, 32));
    let mirror = Material {
        metallic: 1.0,
        roughness: 0.0,
        ..Material::matt("mirror", Vec3::ONE)
    };
    let mirror = scene.add_material(mirror);
    scene.add_instance("ball", mesh, mirror, Mat4::IDENTITY);
    scene
}

#[test]
fn mirrors_show_media() {
    let Some(gpu) = test_gpu() else { return };
    for mirrors in ["distance-impostor", "ray-tracing"] {
        let techniques = [INFO.name, mirrors];
        let found = picture(&gpu, &mirror(0.0), &techniques, &[("most-iterations", "0")]);
        let middle = found[(8 * 16 + 8) * 3];
        assert!((middle - 0.52).abs() < 0.05, "{mirrors}: {middle}");
    }
}

/// integral of e^(-tau s) L_e ds + e^(-tau d) L: light of a layer that absorbs, and of a sky of radiance 1 behind it.
#[test]
fn media_dim_what_mirrors_show() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = mirror(0.3);
    scene.environment = Some(white());
    let found = picture(&gpu, &scene, &[INFO.name, "ray-tracing"], &[]);
    let middle = found[(8 * 16 + 8) * 3];
    let transmittance = (-0.3_f32 * 2.0 * 1.03).exp();
    let expected = 0.25 / 0.3 * (1.0 - transmittance) + transmittance;
    assert!(
        (middle - expected).abs() < 0.02,
        "{middle} instead of {expected}"
    );
}

/// A sky of radiance 1 above and 0.2 below, interpolated in between.
fn gradient() -> Environment {
    let mut texels = vec![1.0; 16];
    texels.extend([0.2; 16]);
    Environment {
        image: std::sync::Arc::new(Image {
            name: "gradient".into(),
            width: 4,
            height: 2,
            pixels: Pixels::Rgba32Float(texels),
        }),
        ..white()
    }
}

/// A ball of fog, thinner outward.
fn ball(extinction: f32, albedo: f32, g: f32) -> Medium {
    let place = |index: u32| (index as f32 + 0.5) / 8.0 - 1.0;
    let density = |cell: u32| {
        let at = [cell % 16, cell / 16 % 16, cell / 256].map(place);
        (1.5 - 1.5 * Vec3::from_array(at).length()).clamp(0.0, 1.0)
    };
    let values = (0..4096).map(density).collect();
    Medium {
        density: Some(std::sync::Arc::new(DensityGrid {
            size: [16; 3],
            values,
        })),
        ..medium(extinction, albedo, g)
    }
}

/// A path tracer on the host, for one medium in the box of [`medium`] under [`gradient`] and directional lights: delta
/// tracking, and ratio tracking toward the lights.
struct Truth<'a> {
    scene: &'a Scene,
    most_scatterings: u32,
    random: Random,
}

impl Truth<'_> {
    fn density(&self, at: Vec3) -> f64 {
        let Some(grid) = &self.scene.media[0].density else {
            return 1.0;
        };
        let place = ((at / 2.0 + 0.5) * 16.0 - 0.5).clamp(Vec3::ZERO, Vec3::splat(15.0));
        let mut sum = 0.0;
        for corner in 0..8 {
            let offset = uvec3(corner & 1, corner >> 1 & 1, corner >> 2);
            let first = place.floor();
            let cell = (first.as_uvec3() + offset).min(uvec3(15, 15, 15));
            let weight = Vec3::select(offset.cmpeq(UVec3::ONE), place - first, 1.0 - place + first);
            let value = grid.values[(cell.x + 16 * (cell.y + 16 * cell.z)) as usize];
            sum += f64::from(weight.element_product() * value);
        }
        sum
    }

    /// Distances at which a ray enters the box and leaves it.
    fn span(origin: Vec3, direction: Vec3) -> Option<[f32; 2]> {
        let (a, b) = ((-1.0 - origin) / direction, (1.0 - origin) / direction);
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        (near < far).then_some([near, far])
    }

    /// The next place where the ray meets the medium, unless it leaves the box.
    fn next(&mut self, origin: Vec3, direction: Vec3) -> Option<Vec3> {
        let extinction = f64::from(self.scene.media[0].extinction.x);
        let [near, far] = Self::span(origin, direction)?;
        let mut t = f64::from(near);
        loop {
            t -= (1.0 - self.random.next()).ln() / extinction;
            if t > f64::from(far) {
                return None;
            }
            let at = origin + direction * t as f32;
            if self.random.next() < self.density(at) {
                return Some(at);
            }
        }
    }

    fn transmittance(&mut self, origin: Vec3, direction: Vec3) -> f64 {
        let extinction = f64::from(self.scene.media[0].extinction.x);
        let Some([near, far]) = Self::span(origin, direction) else {
            return 1.0;
        };
        let (mut t, mut product) = (f64::from(near), 1.0);
        loop {
            t -= (1.0 - self.random.next()).ln() / extinction;
            if t > f64::from(far) {
                return product;
            }
            product *= 1.0 - self.density(origin + direction * t as f32);
        }
    }

    fn radiance(&mut self, mut origin: Vec3, mut direction: Vec3) -> f64 {
        let medium = &self.scene.media[0];
        let PhaseFunction::HenyeyGreenstein(g) = medium.phase else {
            unreachable!()
        };
        let (g, albedo) = (f64::from(g), f64::from(medium.albedo.x));
        let phase =
            |cosine: f64| (1.0 - g * g) / (4.0 * PI) * (1.0 + g * g - 2.0 * g * cosine).powf(-1.5);
        let (mut sum, mut weight) = (0.0, 1.0);
        for scatterings in 0..=self.most_scatterings {
            let Some(at) = self.next(origin, direction) else {
                if self.scene.environment.is_some() {
                    let v = f64::from(direction.y).clamp(-1.0, 1.0).acos() / PI;
                    sum += weight * (1.0 - 0.8 * (2.0 * v - 0.5).clamp(0.0, 1.0));
                }
                return sum;
            };
            if scatterings == self.most_scatterings {
                return sum;
            }
            weight *= albedo;
            for light in &self.scene.lights {
                let to_light = -light.direction();
                let cosine = f64::from(direction.dot(to_light));
                let arriving = self.transmittance(at, to_light) * f64::from(light.intensity.x);
                sum += weight * phase(cosine) * arriving;
            }
            let u = self.random.next();
            let cosine = if g.abs() < 1e-3 {
                2.0 * u - 1.0
            } else {
                let part = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
                (1.0 + g * g - part * part) / (2.0 * g)
            };
            let (sine, turn) = (
                (1.0 - cosine * cosine).max(0.0).sqrt(),
                2.0 * PI * self.random.next(),
            );
            let (x, y) = direction.any_orthonormal_pair();
            let across = x * turn.cos() as f32 + y * turn.sin() as f32;
            direction = (direction * cosine as f32 + across * sine as f32).normalize();
            origin = at;
        }
        sum
    }

    /// The red channel of a picture.
    fn picture(&mut self, samples: u32) -> Vec<f64> {
        let camera = front();
        let eye = camera.world_from_view.w_axis.truncate();
        let half = (0.35_f32 / 2.0).tan();
        let pixel = |truth: &mut Self, index: u32| {
            let mut sum = 0.0;
            for _ in 0..samples {
                let [u, v] = [index % 16, index / 16].map(|at| at as f32);
                let x = ((u + truth.random.next() as f32) / 8.0 - 1.0) * half;
                let y = (1.0 - (v + truth.random.next() as f32) / 8.0) * half;
                let direction = camera.world_from_view.transform_vector3(vec3(x, y, -1.0));
                sum += truth.radiance(eye, direction.normalize());
            }
            sum / f64::from(samples)
        };
        (0..256).map(|index| pixel(self, index)).collect()
    }
}

/// Relative mean squared error of means over 4 x 4 pixels.
fn rel_mse_4(found: &[f32], truth: &[f64]) -> f64 {
    let block = |block: usize| {
        let pixels = (0..16).map(|at| (block / 4 * 4 + at / 4) * 16 + block % 4 * 4 + at % 4);
        let sums = pixels.map(|pixel| (f64::from(found[3 * pixel]), truth[pixel]));
        sums.fold((0.0, 0.0), |a, b| (a.0 + b.0 / 16.0, a.1 + b.1 / 16.0))
    };
    let errors = (0..16)
        .map(block)
        .map(|(a, b)| (a - b).powi(2) / (b * b + 0.01));
    errors.sum::<f64>() / 16.0
}

/// Pictures of a ball of fog, against path tracing: 4 mean free paths from its centre outward.
#[test]
fn light_scatters_as_paths_do() {
    let Some(gpu) = test_gpu() else { return };
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(3.0));
    let sun = sun.aimed(vec3(-1.0, 2.0, 1.5), Vec3::ZERO);
    // Found on a software adapter: 0.00048, 0.00019 and 0.00023.
    for (g, is_single, bound) in [(0.0, true, 0.001), (0.0, false, 5e-4), (0.6, false, 5e-4)] {
        let mut scene = Scene::new("ball");
        scene.media.push(ball(6.0, 0.9, g));
        scene.lights = vec![sun.clone()];
        if !is_single {
            scene.environment = Some(gradient());
        }
        let mut truth = Truth {
            scene: &scene,
            most_scatterings: if is_single { 1 } else { 1000 },
            random: Random(1),
        };
        let truth = truth.picture(400);
        let iterations = ("most-iterations", if is_single { "0" } else { "64" });
        for visibility in ["rays", "peel"] {
            let settings = [iterations, ("visibility", visibility)];
            let found = picture(&gpu, &scene, &[INFO.name], &settings);
            let error = rel_mse_4(&found, &truth);
            println!("g {g}, single {is_single}, {visibility}: {error:.1e}");
            assert!(
                error < bound,
                "g {g}, single {is_single}, {visibility}: {error}"
            );
        }
    }
}
