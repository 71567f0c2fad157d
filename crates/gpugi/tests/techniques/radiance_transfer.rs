//! radiance-transfer compared with the path tracer and with radiosity; sets that would add light twice.

use std::f32::consts::PI;
use std::sync::Arc;

use crate::common::{gpu, measured, picture, place, rel_mse, renderer_of};
use glam::{Mat4, Vec3, vec3};
use gpugi::bake::{Bake, TransferBake};
use gpugi::gpu::Gpu;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::image::metrics::Metric;
use gpugi_scene::transfer::geometry;
use gpugi_scene::{
    Atlas, AtlasOptions, Camera, Environment, Image, Material, MaterialModel, Pixels, Scene,
    TransferVectors,
};

/// An environment with the radiance of each direction.
fn sky(radiance: impl Fn(Vec3) -> Vec3) -> Environment {
    let (width, height) = (64, 32);
    let texel = |index: u32| {
        let phi = PI * (((index % width) as f32 + 0.5) / 16.0 / 2.0 - 1.0);
        let theta = PI * ((index / width) as f32 + 0.5) / 32.0;
        let d = vec3(
            phi.sin() * theta.sin(),
            theta.cos(),
            -phi.cos() * theta.sin(),
        );
        radiance(d).extend(1.0).to_array()
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

/// A smooth sky: spherical harmonics of order 6 hold nearly all of it.
fn smooth_sky() -> Environment {
    let radiance = |d: Vec3| {
        let sun = (4.0 * (d.dot(vec3(0.6, 0.64, 0.48)) - 1.0)).exp();
        vec3(0.3, 0.4, 0.6) * (1.2 + d.y) + vec3(4.0, 3.5, 2.5) * sun
    };
    Environment {
        rotation: glam::Quat::from_rotation_y(0.7),
        ..sky(radiance)
    }
}

/// A room of 2 x 1.5 x 2 m without a ceiling and a block in it, under the smooth sky.
fn open_room() -> Scene {
    let mut scene = Scene::new("open room");
    let [x, y, z] = [Vec3::X * 2.0, Vec3::Y * 1.5, Vec3::Z * 2.0];
    let low = vec3(-1.0, 0.0, -1.0);
    for (mesh, color) in [
        (quad(low + z, x, -z, 1), vec3(0.7, 0.7, 0.7)),
        (quad(low, x, y, 1), vec3(0.6, 0.6, 0.7)),
        (quad(low + x + z, -x, y, 1), vec3(0.7, 0.7, 0.6)),
        (quad(low + z, -z, y, 1), vec3(0.8, 0.2, 0.1)),
        (quad(low + x, z, y, 1), vec3(0.1, 0.6, 0.2)),
        (
            cuboid(vec3(-0.5, 0.0, -0.4), vec3(0.1, 0.6, 0.2), 1),
            vec3(0.8, 0.8, 0.8),
        ),
    ] {
        place(&mut scene, mesh, Material::matt("wall", color));
    }
    scene.environment = Some(smooth_sky());
    scene
}

fn camera() -> Camera {
    Camera::look_at("", vec3(0.6, 1.9, 1.6), vec3(-0.1, 0.4, -0.3), 0.8)
}

fn renderer(gpu: &Gpu, techniques: &[&str], settings: &[&str]) -> Renderer {
    let settings = [&["resolution=64", "rays=256", "steps=64"], settings].concat();
    let scene = open_room();
    renderer_of(gpu, &scene, techniques, 32, "radiance-transfer", &settings)
}

#[test]
fn a_room_under_a_smooth_sky_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    for bounces in ["bounces=1", "bounces=4"] {
        let mut renderer = renderer(&gpu, &["radiance-transfer"], &[bounces]);
        let found = measured(&gpu, &open_room(), &camera(), &mut renderer, [8, 512]);
        let sum = |of: &[f32]| of.iter().map(|&value| f64::from(value)).sum::<f64>();
        let ratio = sum(&found.radiance) / sum(&found.truth.radiance);
        let of_blocks = found.value(Metric::RelMse4).expect("a value");
        let error = rel_mse(&found);
        println!(
            "{bounces}: rel-mse {error:.1e}, of blocks {of_blocks:.1e}, {ratio:.4} of the light"
        );
        assert!(
            error < 0.003 && of_blocks < 0.001,
            "{bounces}: {error} {of_blocks}"
        );
        assert!((ratio - 1.0).abs() < 0.01, "{bounces}: {ratio}");
    }
}

/// A block on a floor under a sky with a small sun.
fn sunlit_block() -> Scene {
    let mut scene = Scene::new("sunlit block");
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let block = cuboid(vec3(-0.4, 0.0, -0.4), vec3(0.1, 0.5, 0.1), 1);
    for mesh in [floor, block] {
        place(&mut scene, mesh, Material::matt("wall", Vec3::splat(0.7)));
    }
    scene.environment = Some(Environment::default_sky());
    scene
}

/// A hundred wavelets hold the shadow of the sun, which 36 harmonics blur.
#[test]
fn a_sunlit_block_is_the_path_tracers_in_wavelets() {
    let Some(gpu) = gpu() else { return };
    let scene = sunlit_block();
    let errors = ["basis=harmonics", "basis=haar"].map(|basis| {
        let settings = [basis, "resolution=64", "rays=1024", "steps=64"];
        let names = ["radiance-transfer"];
        let mut renderer = renderer_of(&gpu, &scene, &names, 32, "radiance-transfer", &settings);
        let found = measured(&gpu, &scene, &camera(), &mut renderer, [8, 512]);
        println!("{basis}: rel-mse {:.1e}", rel_mse(&found));
        rel_mse(&found)
    });
    let [harmonics, wavelets] = errors;
    assert!(wavelets < 0.01 && 2.0 * wavelets < harmonics, "{errors:?}");
}

/// The teapot of a material, on a matt plane under the smooth sky.
fn glossy_teapot(material: Material) -> Scene {
    let mut scene = builtin("teapot", 1).expect("a teapot");
    scene.remove("panel,spot").expect("its lights");
    scene.materials[0] = Material {
        double_sided: true,
        ..material
    };
    scene.environment = Some(smooth_sky());
    scene
}

/// Phong's lobe of exponent 20, GGX of roughness 0.4 on a metal and on a dielectric.
fn glossy_materials() -> [Material; 3] {
    let red = vec3(0.55, 0.16, 0.08);
    [
        Material {
            model: MaterialModel::Phong {
                kd: 0.5 * red,
                ks: Vec3::splat(0.5),
                shininess: 20.0,
            },
            ..Material::default()
        },
        Material::metal("metal", vec3(0.95, 0.78, 0.45), 0.4),
        Material {
            base_color: red.extend(1.0),
            roughness: 0.4,
            ..Material::default()
        },
    ]
}

#[test]
fn a_glossy_teapot_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let bounces = ["bounces=1", "bounces=2", "bounces=1"];
    for (material, bounces) in glossy_materials().into_iter().zip(bounces) {
        let scene = glossy_teapot(material);
        let settings = [
            bounces,
            "glossy=teapot",
            "resolution=128",
            "rays=128",
            "steps=4096",
        ];
        let names = ["radiance-transfer"];
        let mut renderer = renderer_of(&gpu, &scene, &names, 48, names[0], &settings);
        let found = measured(&gpu, &scene, &scene.cameras[0], &mut renderer, [4, 256]);
        let sum = |of: &[f32]| of.iter().sum::<f32>();
        let ratio = sum(&found.radiance) / sum(&found.truth.radiance);
        let error = rel_mse(&found);
        println!("{bounces}: rel-mse {error:.1e}, {ratio:.4} of the light");
        assert!(error < 0.02, "{bounces}: {error}");
        assert!((ratio - 1.0).abs() < 0.03, "{bounces}: {ratio}");
        let warnings = renderer.warnings();
        assert!(
            warnings
                .iter()
                .any(|warning| warning.contains("glossy texels take")),
            "{warnings:?}"
        );
    }
}

/// A lobe times the cosine: of the normal, the direction toward the eye, and that of the light.
type Lobe = fn(Vec3, Vec3, Vec3) -> f32;

/// Phong's of exponent 20: (n + 2) / (2 pi) cos^n about the mirror direction.
fn phong_lobe(normal: Vec3, toward_eye: Vec3, toward_light: Vec3) -> f32 {
    let mirrored = (-toward_eye).reflect(normal);
    let cosine = mirrored.dot(toward_light).max(0.0);
    22.0 / (2.0 * PI) * cosine.powi(20) * normal.dot(toward_light)
}

/// GGX of roughness 0.4 without Fresnel's factor: D G2 / (4 n.v), G2 height-correlated (Heitz 2014, equation 99).
fn ggx_lobe(normal: Vec3, toward_eye: Vec3, toward_light: Vec3) -> f32 {
    let squared = 0.16_f32.powi(2);
    let half = (toward_eye + toward_light).normalize();
    let d = 1.0 + (squared - 1.0) * normal.dot(half).powi(2);
    let (v, l) = (normal.dot(toward_eye), normal.dot(toward_light));
    let of = |a: f32, b: f32| a * (b * b * (1.0 - squared) + squared).sqrt();
    squared / (PI * d * d) * 0.5 / (of(l, v) + of(v, l)) * l
}

/// A ball that reflects by its glossy lobe alone, under light of bands 0 and 4: each of its pixels is the integral of
/// lobe and light. Without edges and diffuse light, width, axis and scale of the lobe decide the error.
#[test]
fn a_glossy_ball_is_the_integral_of_its_lobe() {
    let Some(gpu) = gpu() else { return };
    let axis = vec3(0.36, 0.48, 0.8);
    let radiance = |d: Vec3| {
        let x2 = d.dot(axis).powi(2);
        1.0 + 0.9 * (35.0 * x2 * x2 - 30.0 * x2 + 3.0) / 8.0
    };
    let phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::ZERO,
            ks: Vec3::ONE,
            shininess: 20.0,
        },
        ..Material::default()
    };
    let white_metal = Material::metal("metal", Vec3::ONE, 0.4);
    let cells = (0..32 * 64).map(|cell| {
        let z = (cell / 64) as f32 / 16.0 - 1.0 + 1.0 / 32.0;
        let phi = 2.0 * PI * (cell % 64) as f32 / 64.0;
        let across = (1.0 - z * z).sqrt();
        vec3(across * phi.cos(), across * phi.sin(), z)
    });
    let directions: Vec<(Vec3, f32)> = cells.map(|d| (d, radiance(d))).collect();
    let eye = vec3(0.5, 0.8, 3.5);
    let camera = Camera::look_at("", eye, Vec3::ZERO, 0.6);
    let lobes: [(Material, Lobe, f32); 2] =
        [(phong, phong_lobe, 0.03), (white_metal, ggx_lobe, 0.03)];
    for (material, lobe, bound) in lobes {
        let mut scene = Scene::new("ball");
        let ball = place(&mut scene, sphere(1.0, 24), material);
        scene.instances[ball].name = "ball".into();
        scene.environment = Some(sky(|d| Vec3::splat(radiance(d))));
        let settings = ["at=vertices", "glossy=ball", "rays=256", "steps=4096"];
        let names = ["radiance-transfer"];
        let mut renderer = renderer_of(&gpu, &scene, &names, 24, names[0], &settings);
        let (mut errors, mut squares, mut pixels) = (0.0, 0.0, 0);
        for lit in picture(&mut renderer, &camera).lit() {
            let toward_eye = (eye - lit.position).normalize();
            if lit.normal.dot(toward_eye) < 0.4 {
                continue;
            }
            let seen = directions.iter().filter(|(d, _)| d.dot(lit.normal) > 0.0);
            let terms = seen.map(|&(d, light)| light * lobe(lit.normal, toward_eye, d));
            let expected = terms.sum::<f32>() * 4.0 * PI / directions.len() as f32;
            errors += (lit.radiance.x - expected).powi(2);
            squares += expected.powi(2);
            pixels += 1;
        }
        let error = (errors / squares).sqrt();
        println!("{error} of the light at {pixels} pixels");
        assert!(pixels > 100 && error < bound, "{error} at {pixels} pixels");
    }
}

/// Glossy objects are those of the list that have a glossy lobe; their paths exclude other techniques'.
#[test]
fn glossy_objects_are_chosen() {
    let Some(gpu) = gpu() else { return };
    let [phong, ..] = glossy_materials();
    let scene = glossy_teapot(phong);
    let names = ["radiance-transfer"];
    let mut renderer = renderer_of(&gpu, &scene, &names, 16, names[0], &["bounces=2"]);
    let left_out = renderer.left_out().join("; ");
    assert!(left_out.contains("LGE"), "{left_out}");
    for (list, is_added) in [("plane", false), ("tea*", true), ("plane,teapot", true)] {
        let set = renderer.set(names[0], "glossy", list);
        set.expect("an object's name");
        let left_out = renderer.left_out().join("; ");
        assert_eq!(!left_out.contains("LGE"), is_added, "{list}: {left_out}");
    }
    let unknown = renderer.set(names[0], "glossy", "kettle");
    assert!(unknown.is_err());
}

/// A ball above a floor of 32 x 32 cells, under the smooth sky.
fn ball_on_floor(material: Material) -> Scene {
    let mut scene = Scene::new("ball on floor");
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 32);
    place(
        &mut scene,
        floor,
        Material::matt("floor", vec3(0.7, 0.5, 0.3)),
    );
    let ball = place(&mut scene, sphere(0.35, 32), material);
    scene.instances[ball].name = "ball".into();
    scene.instances[ball].world_from_mesh = Mat4::from_translation(vec3(0.1, 0.45, 0.0));
    scene.environment = Some(smooth_sky());
    scene
}

/// What fine meshes keep at vertices is what an atlas keeps, with reflected light and glossy lobes.
#[test]
fn fine_meshes_are_lit_at_vertices() {
    let Some(gpu) = gpu() else { return };
    let [phong, ..] = glossy_materials();
    let scene = ball_on_floor(phong);
    let found = ["at=texels", "at=vertices"].map(|at| {
        let settings = [
            at,
            "glossy=ball",
            "bounces=3",
            "resolution=96",
            "rays=256",
            "steps=4096",
        ];
        let names = ["radiance-transfer"];
        let mut renderer = renderer_of(&gpu, &scene, &names, 48, names[0], &settings);
        let found = measured(&gpu, &scene, &camera(), &mut renderer, [4, 512]);
        println!("{at}: rel-mse {:.1e}", rel_mse(&found));
        found
    });
    let [texels, vertices] = &found;
    let between = error(&vertices.radiance, &texels.radiance);
    println!("between them {between:.1e}");
    assert!(rel_mse(vertices) < 0.01, "{}", rel_mse(vertices));
    assert!(between < 0.005, "{between}");
}

/// A floor of two triangles shows the shadow of a block above it once its edges are bisected.
#[test]
fn coarse_meshes_are_subdivided() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("block above a floor");
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let block = cuboid(vec3(-0.4, 0.15, -0.4), vec3(0.3, 0.4, 0.3), 1);
    for mesh in [floor, block] {
        place(&mut scene, mesh, Material::matt("wall", Vec3::splat(0.7)));
    }
    scene.environment = Some(smooth_sky());
    let names = ["radiance-transfer"];
    let errors = ["subdivide=0", "subdivide=0.12"].map(|subdivide| {
        let settings = ["at=vertices", subdivide, "rays=256", "steps=4096"];
        let mut renderer = renderer_of(&gpu, &scene, &names, 32, names[0], &settings);
        let found = measured(&gpu, &scene, &camera(), &mut renderer, [4, 128]);
        let warnings = renderer.warnings().join("; ");
        println!("{subdivide}: rel-mse {:.1e}; {warnings}", rel_mse(&found));
        let is_said = warnings.contains("points take");
        assert_eq!(is_said, subdivide != "subdivide=0", "{warnings}");
        rel_mse(&found)
    });
    let [coarse, fine] = errors;
    assert!(fine < 0.005 && 5.0 * fine < coarse, "{errors:?}");

    let settings = ["at=vertices", "subdivide=1e-5"];
    let mut renderer = renderer_of(&gpu, &scene, &names, 16, names[0], &settings);
    let refused = renderer.render_sample(&camera(), 1, None, false);
    let message = refused
        .map(|_| ())
        .expect_err("too many points")
        .to_string();
    assert!(message.contains("raise subdivide"), "{message}");
}

/// A sheet behind a ball on a floor, both translucent: from the camera, the sun stands behind the sheet.
fn sheet_and_ball() -> Scene {
    let mut scene = ball_on_floor(Material::translucent("ball", vec3(0.9, 0.8, 0.7), 0.5));
    let sheet = quad(vec3(-0.9, 0.0, -0.4), Vec3::X * 1.8, Vec3::Y * 0.9, 24);
    let leaf = Material {
        diffuse_transmission_color: vec3(0.9, 0.9, 0.3),
        ..Material::translucent("sheet", vec3(0.3, 0.6, 0.2), 0.6)
    };
    place(&mut scene, sheet, leaf);
    let sky = scene.environment.as_mut().expect("a sky");
    sky.rotation = glam::Quat::from_rotation_y(2.5);
    scene
}

/// Light passes through sheets and into closed bodies, is scattered inside and leaves again, at texels and at vertices.
#[test]
fn translucent_surfaces_are_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let scene = sheet_and_ball();
    let names = ["radiance-transfer"];
    for places in ["at=texels", "at=vertices"] {
        let settings = [
            places,
            "bounces=3",
            "resolution=96",
            "rays=128",
            "steps=4096",
        ];
        let mut renderer = renderer_of(&gpu, &scene, &names, 32, names[0], &settings);
        let found = measured(&gpu, &scene, &camera(), &mut renderer, [4, 128]);
        let sum = |of: &[f32]| of.iter().sum::<f32>();
        let ratio = sum(&found.radiance) / sum(&found.truth.radiance);
        let error = rel_mse(&found);
        println!("{places}: rel-mse {error:.1e}, {ratio:.4} of the light");
        assert!(error < 0.01, "{places}: {error}");
        assert!((ratio - 1.0).abs() < 0.02, "{places}: {ratio}");
    }
}

/// A bake of the open room.
fn transfer_bake<'a>(gpu: &Gpu, scene: &'a Scene) -> TransferBake<'a> {
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(scene, &options).expect("an atlas");
    let mut bake = TransferBake::new(gpu, scene, atlas).expect("a bake");
    for (name, value) in [("rays", "256"), ("bounces", "3")] {
        bake.set(name, value).expect("a setting");
    }
    bake
}

/// Takes the steps that are left, and returns their number and the result.
fn finished(mut bake: TransferBake) -> (usize, TransferVectors) {
    let mut steps = 0;
    while bake.step().expect("a step").is_some() {
        steps += 1;
    }
    assert!(bake.is_complete());
    (steps, bake.finish().expect("vectors"))
}

/// Vectors that a scene brings light it as new ones, whatever the settings; those of another scene are not used.
#[test]
fn stored_vectors_light_as_new_ones() {
    let Some(gpu) = gpu() else { return };
    let mut scene = open_room();
    let (steps, mut vectors) = finished(transfer_bake(&gpu, &scene));
    for stop in 1..steps {
        let mut stopped = transfer_bake(&gpu, &scene);
        for _ in 0..stop {
            stopped.step().expect("a step");
        }
        let state = stopped.save().expect("a state");
        let mut resumed = transfer_bake(&gpu, &scene);
        resumed.resume(state);
        let (left, again) = finished(resumed);
        println!("stopped after {stop} of {steps}, {left} more");
        assert!(again == vectors, "stopped after {stop}");
    }
    let unfinished = transfer_bake(&gpu, &scene).finish();
    assert!(unfinished.is_err());
    for (name, value) in [
        ("basis", "haar"),
        ("compressed", "true"),
        ("glossy", "*"),
        ("at", "vertices"),
    ] {
        let refused = transfer_bake(&gpu, &scene).set(name, value);
        assert!(refused.is_err(), "{name}");
    }

    let mut traced = renderer(&gpu, &["radiance-transfer"], &["bounces=3"]);
    let traced = picture(&mut traced, &camera()).radiance;
    vectors.geometry = geometry(&scene, &vectors.atlas);
    scene.transfer = Some(Arc::new(vectors));
    // Settings that give another picture.
    let others = ["rays=1", "order=2", "bounces=1", "resolution=16"];
    let light = |scene: &Scene, settings: &[&str]| {
        let mut renderer = renderer_of(
            &gpu,
            scene,
            &["radiance-transfer"],
            32,
            "radiance-transfer",
            &[&others, settings].concat(),
        );
        let picture = picture(&mut renderer, &camera()).radiance;
        (error(&picture, &traced), renderer.warnings())
    };
    let (stored, warnings) = light(&scene, &[]);
    let (new, _) = light(&scene, &["stored=false"]);
    println!("stored {stored:.1e}, new {new:.1e}");
    assert!(stored < 1e-8 && new > 1e-3, "{stored} {new}");
    assert!(warnings.is_empty(), "{warnings:?}");

    let block = scene.instances.len() - 1;
    scene.instances[block].world_from_mesh.w_axis.x += 0.1;
    let (_, warnings) = light(&scene, &[]);
    assert!(
        warnings
            .iter()
            .any(|warning| warning.contains("has moved since")),
        "{warnings:?}"
    );
}

/// Mean squared difference relative to `truth`.
fn error(found: &[f32], truth: &[f32]) -> f32 {
    let pairs = found.iter().zip(truth);
    let errors = pairs.map(|(a, b)| (a - b).powi(2) / (b * b + 0.01));
    errors.sum::<f32>() / truth.len() as f32
}

/// One bounce and radiosity for the others give what all bounces give.
#[test]
fn radiosity_continues_where_it_ends() {
    let Some(gpu) = gpu() else { return };
    let picture = |techniques: &[&str], bounces| {
        let mut renderer = renderer(&gpu, techniques, &[bounces]);
        if techniques.contains(&"radiosity") {
            for (name, value) in [
                ("resolution", "64"),
                ("rays", "16"),
                ("iterations", "16"),
                ("steps", "24"),
            ] {
                renderer.set("radiosity", name, value).expect("a setting");
            }
        }
        picture(&mut renderer, &camera()).radiance
    };
    let alone = picture(&["radiance-transfer"], "bounces=8");
    let both = picture(&["radiance-transfer", "radiosity"], "bounces=1");
    let direct = picture(&["radiance-transfer"], "bounces=1");
    let sum = |of: &[f32]| of.iter().sum::<f32>();
    let (ratio, share) = (sum(&both) / sum(&alone), sum(&direct) / sum(&alone));
    println!("{ratio} of the light; {share} is direct");
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    assert!(share < 0.9, "{share}");
}

#[test]
fn light_is_not_added_twice() {
    let Some(gpu) = gpu() else { return };
    let made = |other: &str| {
        let names = ["radiance-transfer", other].map(str::to_owned);
        Renderer::new(&gpu, &open_room(), [16, 16], &names)
    };
    let path = |found: Result<(), LightingError>| match found {
        Err(LightingError::Overlap { path, .. }) => path,
        other => panic!("{other:?}"),
    };
    assert_eq!(path(made("image-based-lighting").map(|_| ())), "LDE");
    let mut with_radiosity = made("radiosity").expect("direct light and radiosity");
    let refused = with_radiosity.set("radiance-transfer", "bounces", "2");
    assert_eq!(path(refused), "LDDE");
    // The other way round, environment-map leaves it the diffuse surfaces.
    let with_mirrors = made("environment-map").expect("mirrors");
    let left_out = with_mirrors.left_out();
    assert_eq!(left_out, ["indirect light, such as LDDE (environment)"]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = renderer(&gpu, &["radiance-transfer"], &[]);
    for (name, value) in [
        ("order", "1"),
        ("order", "9"),
        ("bounces", "0"),
        ("rays", "0"),
        ("basis", "cosines"),
        ("coefficients", "5"),
    ] {
        let refused = renderer.set("radiance-transfer", name, value);
        assert!(
            matches!(refused, Err(LightingError::Setting { .. })),
            "{name}"
        );
    }
    for (name, value) in [("order", "8"), ("resolution", "8192")] {
        let set = renderer.set("radiance-transfer", name, value);
        set.expect("a setting");
    }
    let error = renderer
        .render_sample(&camera(), 1, None, false)
        .map(|_| ());
    let message = error.expect_err("an atlas of 32 GiB").to_string();
    assert!(message.contains("lower the resolution"), "{message}");
}

/// An object that environment-map lights gets nothing twice; one with final-gather's indirect light gets none, and a
/// warning says so.
#[test]
fn what_others_claim_is_left_to_them() {
    let Some(gpu) = gpu() else { return };
    let mut scene = open_room();
    let block = scene.instances.len() - 1;
    scene.instances[block].name = "block".into();
    let light = |techniques: &[&str]| {
        let settings = ["objects=block"];
        let mut renderer = renderer_of(&gpu, &scene, techniques, 24, "environment-map", &settings);
        if techniques.contains(&"radiance-transfer") {
            for (name, value) in [("resolution", "32"), ("rays", "64")] {
                renderer
                    .set("radiance-transfer", name, value)
                    .expect("a setting");
            }
        }
        let picture = picture(&mut renderer, &camera());
        let [on_block, elsewhere]: [Vec<Vec3>; 2] = [true, false].map(|wanted| {
            let lit = picture
                .lit()
                .filter(|lit| (lit.instance as usize == block) == wanted);
            lit.map(|lit| lit.radiance).collect()
        });
        (on_block, elsewhere.iter().sum::<Vec3>())
    };
    let (alone, dark) = light(&["environment-map"]);
    let (both, lit) = light(&["radiance-transfer", "environment-map"]);
    assert!(alone.len() > 20 && alone == both);
    assert!(
        dark == Vec3::ZERO && lit.min_element() > 1.0,
        "{dark} {lit}"
    );

    let gathered = ["radiance-transfer", "final-gather"];
    let mut renderer = renderer(&gpu, &gathered, &["bounces=2", "resolution=32", "rays=64"]);
    picture(&mut renderer, &camera());
    let warnings = renderer.warnings();
    let mut warnings = warnings.iter();
    assert!(warnings.any(|warning| warning.contains("set its bounces to 1")));
}
