//! Ways to light a scene.

use std::ops::ControlFlow;

use glam::Vec3;
use gpugi::bake::{Bake, LightBake, LightOptions};
use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Settings};
use gpugi::techniques::Registry;
use gpugi::{Purpose, Renderer, default_set};
use gpugi_scene::{Atlas, AtlasOptions, Bounds, Scene};

use super::relations::Changed;
use crate::common::samples_of;

/// Width and height of pictures (pixels), and of the parts of which means are compared.
const SIZE: u32 = 16;
const PART: u32 = SIZE / 4;
/// Samples per pixel of the techniques and of the path tracer, and per texel.
const SAMPLES: u32 = 64;
const PATHS: u32 = 256;
/// Where mirrors throw light, which comes in few photons.
const PATHS_WITH_PHOTONS: u32 = 512;
const TEXEL_SAMPLES: u32 = 2;
/// Side of the bake's atlas (texels).
const ATLAS: u32 = 64;

/// Settings that make pictures in a fraction of a second, where the technique is in use: its name, the setting, the
/// value.
const QUICK: [[&str; 3]; 19] = [
    ["shadow-map", "resolution", "256"],
    ["shadow-map", "area-samples", "48"],
    ["shadow-map", "area-resolution", "64"],
    ["shadow-map", "area-taps", "1"],
    ["image-based-lighting", "samples", "48"],
    ["image-based-lighting", "resolution", "128"],
    ["radiosity", "resolution", "96"],
    ["radiosity", "iterations", "16"],
    ["radiosity", "steps", "16"],
    ["final-gather", "resolution", "16"],
    ["final-gather", "bounces", "6"],
    ["final-gather", "faces-per-frame", "512"],
    ["caustics", "resolution", "64"],
    ["caustics", "cube-resolution", "32"],
    ["caustics", "shape-resolution", "32"],
    ["caustics", "frames", "4"],
    ["distance-impostor", "resolution", "32"],
    ["distance-impostor", "shape-resolution", "32"],
    ["distance-impostor", "cubes", "3"],
];

/// Mean radiance, of all and of parts; `None` for parts that are too small.
pub struct Light {
    pub whole: Vec3,
    pub parts: Vec<Option<Vec3>>,
}

/// A way to light one scene and what becomes of it.
pub trait Way {
    fn light(&mut self, changed: &Changed, seed: u32) -> Light;
}

type Make = fn(&Gpu, &Scene) -> Box<dyn Way>;

pub const WAYS: [(&str, Make); 4] = [
    ("still", |gpu, scene| {
        Box::new(Picture::new(gpu, scene, Purpose::StillPicture))
    }),
    ("live", |gpu, scene| {
        Box::new(Picture::new(gpu, scene, Purpose::LiveView))
    }),
    ("traced", |gpu, scene| Box::new(Traced::new(gpu, scene))),
    ("baked", |gpu, _| Box::new(Baked { gpu: gpu.clone() })),
];

fn is_anew() -> bool {
    std::env::var_os("METAMORPHIC_ANEW").is_some()
}

/// Means of a picture and of its parts.
fn means(radiance: &[f32], is_mirrored: bool) -> Light {
    let side = SIZE / PART;
    let mut parts = vec![Vec3::ZERO; (side * side) as usize];
    for (index, color) in (0..).zip(radiance.chunks_exact(3)) {
        let (x, y) = (index % SIZE, index / SIZE);
        let x = if is_mirrored { SIZE - 1 - x } else { x };
        parts[(y / PART * side + x / PART) as usize] += Vec3::from_slice(color);
    }
    let pixels = (SIZE * SIZE) as f32;
    Light {
        whole: parts.iter().sum::<Vec3>() / pixels,
        parts: (parts.iter())
            .map(|sum| Some(sum / (PART * PART) as f32))
            .collect(),
    }
}

/// The default set of a purpose.
struct Picture {
    gpu: Gpu,
    purpose: Purpose,
    renderer: Renderer,
}

impl Picture {
    fn new(gpu: &Gpu, scene: &Scene, purpose: Purpose) -> Self {
        let renderer = Renderer::new(gpu, scene, [SIZE; 2], purpose);
        let mut renderer = renderer.expect("a renderer");
        let uses = |technique: &str, renderer: &Renderer| {
            let mut techniques = renderer.techniques().iter();
            techniques.any(|known| known.info().name == technique)
        };
        for [technique, name, value] in QUICK {
            if uses(technique, &renderer) {
                renderer.set(technique, name, value).expect("a setting");
            }
        }
        Self {
            gpu: gpu.clone(),
            purpose,
            renderer,
        }
    }
}

impl Way for Picture {
    fn light(&mut self, changed: &Changed, seed: u32) -> Light {
        if is_anew() {
            *self = Self::new(&self.gpu, &changed.scene, self.purpose);
        }
        let renderer = &mut self.renderer;
        renderer.update(&changed.scene).expect("an update");
        renderer.set_seed(seed);
        let camera = &changed.scene.cameras[0];
        let ready = renderer.converge(camera, false, |_, _| ControlFlow::Continue(()));
        ready.expect("maps");
        let samples = samples_of(renderer, SAMPLES);
        for _ in 0..samples {
            let sample = renderer.render_sample(camera, samples, None, false);
            sample.expect("a sample");
        }
        means(&renderer.radiance().expect("radiance"), changed.is_mirrored)
    }
}

/// The path tracer.
struct Traced {
    gpu: Gpu,
    tracer: PathTracer,
}

impl Traced {
    fn new(gpu: &Gpu, scene: &Scene) -> Self {
        let tracer = PathTracer::new(gpu, scene, [SIZE; 2], &Settings::default());
        Self {
            gpu: gpu.clone(),
            tracer: tracer.expect("a path tracer"),
        }
    }
}

impl Way for Traced {
    fn light(&mut self, changed: &Changed, seed: u32) -> Light {
        let scene = &changed.scene;
        if is_anew() || !self.tracer.update(scene).expect("an update") {
            *self = Self::new(&self.gpu, scene);
        }
        self.tracer.restart(seed).expect("a start");
        let go_on = &mut |_: &_| ControlFlow::Continue(());
        let throws =
            |object: &gpugi_scene::Instance| scene.materials[object.material].roughness == 0.0;
        let paths = match scene.instances.iter().any(throws) {
            true => PATHS_WITH_PHOTONS,
            false => PATHS,
        };
        let traced = self.tracer.render(&scene.cameras[0], paths, go_on);
        traced.expect("samples");
        let radiance = self.tracer.radiance().expect("radiance");
        means(&radiance, changed.is_mirrored)
    }
}

/// The default set of a bake, in an atlas of one page.
struct Baked {
    gpu: Gpu,
}

impl Way for Baked {
    fn light(&mut self, changed: &Changed, seed: u32) -> Light {
        let scene = &changed.scene;
        let options = AtlasOptions {
            size: ATLAS,
            gutter: 1,
            ..AtlasOptions::default()
        };
        let atlas = Atlas::new(scene, &options).expect("an atlas");
        let set = default_set(
            scene,
            &self.gpu.adapter,
            Purpose::Bake,
            &Registry::default(),
        );
        let options = LightOptions {
            samples: TEXEL_SAMPLES,
            seed,
            ..LightOptions::default()
        };
        let bake = LightBake::new(&self.gpu, scene, &atlas, &set.names(), &options);
        let mut bake = bake.expect("a bake");
        for choice in &set.choices {
            for (name, value) in &choice.settings {
                bake.set(choice.technique, name, value).expect("a setting");
            }
            for [_, name, value] in QUICK
                .iter()
                .filter(|setting| setting[0] == choice.technique)
            {
                bake.set(choice.technique, name, value).expect("a setting");
            }
        }
        while bake.step().expect("a step").is_some() {}
        surfaces(changed, &atlas, &bake.finish().pages)
    }
}

/// Means over all surfaces that were in the scene before and do not emit, and over those in the octants of its bounds.
fn surfaces(changed: &Changed, atlas: &Atlas, pages: &[Vec<Vec3>]) -> Light {
    /// Points per side of a parallelogram, of which a triangle is a half.
    const POINTS: u32 = 12;
    /// The smallest part of the area of which a mean is compared.
    const LEAST: f32 = 0.02;
    let scene = &changed.scene;
    let mut points = Vec::new();
    let instances = scene.instances.iter().zip(&atlas.instances);
    for (instance, uvs) in instances.take(changed.first_added) {
        let emits = scene.materials[instance.material].emissive != Vec3::ZERO;
        let Some(uvs) = uvs.as_ref().filter(|_| !emits) else {
            continue;
        };
        let page = &pages[uvs.page as usize];
        let mesh = &scene.meshes[instance.mesh];
        let before_from_mesh = changed.before_from_world * instance.world_from_mesh;
        let triangles = mesh.indices.as_chunks::<3>().0.iter();
        for (triangle, uvs) in triangles.zip(uvs.corners.as_chunks::<3>().0) {
            let [a, b, c] = triangle
                .map(|index| before_from_mesh.transform_point3(mesh.positions[index as usize]));
            let area = (b - a).cross(c - a).length();
            for index in 0..POINTS * POINTS {
                let [u, v] = [index % POINTS, index / POINTS]
                    .map(|step| (step as f32 + 0.5) / POINTS as f32);
                let [u, v] = if u + v > 1.0 {
                    [1.0 - u, 1.0 - v]
                } else {
                    [u, v]
                };
                let uv = uvs[0] + (uvs[1] - uvs[0]) * u + (uvs[2] - uvs[0]) * v;
                let [x, y] = (uv * atlas.size as f32)
                    .to_array()
                    .map(|at| (at as usize).min(atlas.size as usize - 1));
                let light = page[y * atlas.size as usize + x];
                points.push((a + (b - a) * u + (c - a) * v, area, light));
            }
        }
    }
    let bounds = Bounds::of(points.iter().map(|(position, ..)| *position));
    // Not in the middle, where edges of symmetric things are.
    let middle = bounds.min.lerp(bounds.max, 0.47);
    let mut sums = [(Vec3::ZERO, 0.0); 8];
    for (position, area, light) in points {
        let octant = position.cmpgt(middle).bitmask() as usize;
        sums[octant].0 += light * area;
        sums[octant].1 += area;
    }
    let [light, area] = [
        sums.iter().map(|(light, _)| *light).sum::<Vec3>(),
        Vec3::splat(sums.iter().map(|(_, area)| area).sum()),
    ];
    let parts = sums
        .iter()
        .map(|&(light, of_part)| (of_part > LEAST * area.x).then(|| light / of_part));
    Light {
        whole: light / area,
        parts: parts.collect(),
    }
}
