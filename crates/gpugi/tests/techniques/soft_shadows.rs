//! shadow-map's area lights, soft filters and see-through surfaces against analytic light and shadow.

use std::sync::Arc;

use std::f64::consts::PI;

use crate::common::{
    Lit, Picture, floor, from_above, gpu, lit_by, measured, meets, picture, place, render,
    renderer, renderer_of,
};
use glam::{DVec3, Vec3, Vec4, dvec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::image::metrics::rel_mse;
use gpugi_scene::{
    AlphaMode, Camera, Image, Light, LightKind, Material, Pixels, Scene, Texture, TextureRef, Wrap,
};

const HEIGHT: f32 = 2.0;
const RADIANCE: f32 = 5.0;

/// A square lamp with sides of 1 m over the floor, facing down.
fn under_a_lamp(double_sided: bool) -> Scene {
    let mut scene = floor(2.0);
    let lamp = quad(vec3(-0.5, HEIGHT, -0.5), Vec3::X, Vec3::Z, 1);
    let material = Material {
        double_sided,
        ..Material::emitter("lamp", Vec3::splat(RADIANCE))
    };
    place(&mut scene, lamp, material);
    scene
}

/// Looks at the floor from below the lamp.
fn below_the_lamp(side: f32) -> Camera {
    from_above(side, HEIGHT - 0.3)
}

/// Exact irradiance at a point of the floor under the part of a lamp between two values of x, by quadrature over the
/// visible part of the rectangle.
fn lamp_irradiance(at: Vec3, x_from: f64, x_to: f64) -> f64 {
    const STEPS: u32 = 64;
    if x_to <= x_from {
        return 0.0;
    }
    let at = at.as_dvec3();
    let mut sum = 0.0;
    for i in 0..STEPS {
        for j in 0..STEPS {
            let along = |k: u32| (f64::from(k) + 0.5) / f64::from(STEPS);
            let lamp = dvec3(
                x_from + (x_to - x_from) * along(i),
                f64::from(HEIGHT),
                along(j) - 0.5,
            );
            let toward: DVec3 = lamp - at;
            let d2 = toward.length_squared();
            sum += toward.y * toward.y / (d2 * d2);
        }
    }
    sum / f64::from(STEPS * STEPS) * (x_to - x_from) * f64::from(RADIANCE)
}

fn samples(count: u32) -> String {
    format!("shadow-map.area-samples={count}")
}

fn floor_of(lit: &Lit) -> bool {
    lit.instance == 0
}

#[test]
fn an_area_light_is_its_form_factor() {
    let Some(gpu) = gpu() else { return };
    let errors = [16, 64, 256].map(|count| {
        let picture = render(
            &gpu,
            &under_a_lamp(false),
            &below_the_lamp(3.0),
            32,
            &[&samples(count)],
        );
        let errors = picture.lit().filter(|lit| floor_of(lit)).map(|lit| {
            let expected = 0.5 / PI * lamp_irradiance(lit.position, -0.5, 0.5);
            (f64::from(lit.radiance.x) / expected - 1.0).abs()
        });
        errors.fold(0.0, f64::max)
    });
    println!("largest relative error at 16, 64, 256 samples: {errors:?}");
    assert!(errors[2] < 0.01, "{errors:?}");
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "{errors:?}");
}

/// Five more faces for each sample: more than one atlas has room for at the default side.
#[test]
fn samples_of_a_lamp_that_shines_to_both_sides_share_the_atlas() {
    let Some(gpu) = gpu() else { return };
    let scene = under_a_lamp(true);
    let mut renderer = renderer(&gpu, &scene, 32, &[&samples(256)]);
    let picture = picture(&mut renderer, &below_the_lamp(3.0));
    let notes = renderer.warnings();
    println!("{notes:?}");
    assert_eq!(notes.len(), 1);
    for lit in picture.lit().filter(|lit| floor_of(lit)) {
        let expected = 0.5 / PI * lamp_irradiance(lit.position, -0.5, 0.5);
        let error = (f64::from(lit.radiance.x) / expected - 1.0).abs();
        assert!(error < 0.01, "{lit:?}, not {expected}");
    }
}

#[test]
fn an_area_light_casts_the_exact_penumbra() {
    let Some(gpu) = gpu() else { return };
    // A half-plane x > 0 at height 1 hides the part of the lamp beyond the line from the point over the half-plane's
    // edge.
    let mut scene = under_a_lamp(false);
    let blocker = quad(vec3(0.0, 1.0, 4.0), Vec3::X * 4.0, Vec3::NEG_Z * 8.0, 1);
    place(
        &mut scene,
        blocker,
        Material::matt("blocker", Vec3::splat(0.5)),
    );
    let camera = from_above(1.6, 0.9);
    let errors = [16, 64, 256].map(|count| {
        let picture = render(&gpu, &scene, &camera, 64, &[&samples(count)]);
        let pairs = picture.lit().filter(|lit| floor_of(lit)).map(|lit| {
            // Seen from x, the edge at half the lamp's height hides the part of the lamp beyond -x.
            let visible_to = f64::from(-lit.position.x).clamp(-0.5, 0.5);
            let expected = 0.5 / PI * lamp_irradiance(lit.position, -0.5, visible_to);
            (lit.radiance.x, expected as f32)
        });
        rel_mse(pairs)
    });
    println!("rel-mse of the penumbra at 16, 64, 256 samples: {errors:?}");
    assert!(errors[2] < 0.005, "{errors:?}");
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "{errors:?}");
}

#[test]
fn emitters_light_the_sides_that_emit() {
    let Some(gpu) = gpu() else { return };
    for double_sided in [false, true] {
        let mut scene = under_a_lamp(double_sided);
        // A ceiling over the lamp, facing down, as far from the lamp as the floor is.
        let ceiling = quad(
            vec3(-2.0, 2.0 * HEIGHT, -2.0),
            Vec3::X * 4.0,
            Vec3::Z * 4.0,
            1,
        );
        place(
            &mut scene,
            ceiling,
            Material::matt("ceiling", Vec3::splat(0.5)),
        );
        let mut camera =
            Camera::look_at("", Vec3::Y * (HEIGHT + 0.3), Vec3::Y * (HEIGHT + 2.0), 1.0);
        camera.projection = gpugi_scene::Projection::Orthographic { height: 3.0 };
        let settings = [&samples(256)[..], "shadow-map.area-resolution=128"];
        let above = render(&gpu, &scene, &camera, 32, &settings);
        let below = render(&gpu, &scene, &below_the_lamp(3.0), 32, &settings);
        assert_eq!(above.lit().filter(|lit| lit.instance == 2).count(), 32 * 32);
        for lit in above.lit() {
            let mirrored = vec3(lit.position.x, 0.0, lit.position.z);
            let expected = if double_sided {
                0.5 / PI * lamp_irradiance(mirrored, -0.5, 0.5)
            } else {
                0.0
            };
            let error = (f64::from(lit.radiance.x) - expected).abs();
            assert!(
                error <= 0.03 * expected,
                "double-sided {double_sided}: {lit:?}, not {expected}"
            );
        }
        for lit in below.lit().filter(|lit| floor_of(lit)) {
            let expected = 0.5 / PI * lamp_irradiance(lit.position, -0.5, 0.5);
            let error = (f64::from(lit.radiance.x) - expected).abs();
            assert!(
                error <= 0.03 * expected,
                "double-sided {double_sided}: {lit:?}, not {expected}"
            );
        }
    }
}

/// A 2 x 2 checker, not repeated, in the red, green, blue and alpha channels.
fn checker(scene: &mut Scene, dark: [u8; 4], light: [u8; 4]) -> TextureRef {
    scene.images.push(Arc::new(Image {
        name: "checker".into(),
        width: 2,
        height: 2,
        pixels: Pixels::Rgba8([dark, light, light, dark].concat()),
    }));
    scene.textures.push(Texture {
        image: scene.images.len() - 1,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: true,
    });
    TextureRef::new(scene.textures.len() - 1)
}

#[test]
fn an_emissive_texture_lights_by_its_mean() {
    let Some(gpu) = gpu() else { return };
    let mut scene = under_a_lamp(false);
    let texture = checker(&mut scene, [0, 0, 0, 255], [255, 255, 255, 255]);
    scene.materials[1].emissive_texture = Some(texture);
    let plain = render(&gpu, &under_a_lamp(false), &below_the_lamp(3.0), 32, &[]);
    let halved = render(&gpu, &scene, &below_the_lamp(3.0), 32, &[]);
    for (plain, halved) in plain.lit().zip(halved.lit()) {
        let ratio = halved.radiance.x / plain.radiance.x;
        // The mean is taken at 36 points per triangle.
        assert!(
            (ratio - 0.5).abs() < 0.07,
            "{ratio} of the light at {}",
            halved.position
        );
    }
}

/// The floor's mean brightness inside and outside the shadow of a square sheet with sides of 1 m at height 1, under a
/// sun at the zenith.
fn through_a_sheet(
    gpu: &gpugi::gpu::Gpu,
    material: impl FnOnce(&mut Scene) -> Material,
) -> (f32, crate::common::Picture) {
    let sun =
        Light::new("sun", LightKind::Directional, Vec3::splat(2.0)).aimed(Vec3::Y, Vec3::ZERO);
    let mut scene = lit_by(floor(2.0), sun);
    let material = material(&mut scene);
    place(
        &mut scene,
        quad(vec3(-0.5, 1.0, 0.5), Vec3::X, Vec3::NEG_Z, 1),
        material,
    );
    let picture = render(
        gpu,
        &scene,
        &from_above(1.6, 0.9),
        64,
        &["shadow-map.resolution=512"],
    );
    let full = 0.5 / PI as f32 * 2.0;
    let inside = picture
        .lit()
        .filter(|lit| lit.position.abs().max_element() < 0.47);
    let (sum, count) = inside.fold((0.0, 0), |(sum, count), lit| {
        (sum + lit.radiance.x / full, count + 1)
    });
    for lit in picture
        .lit()
        .filter(|lit| lit.position.abs().max_element() > 0.53)
    {
        assert!(
            (lit.radiance.x / full - 1.0).abs() < 0.01,
            "{lit:?} is outside the shadow"
        );
    }
    (sum / count as f32, picture)
}

#[test]
fn see_through_surfaces_cast_what_they_hide() {
    let Some(gpu) = gpu() else { return };
    let (opaque, _) = through_a_sheet(&gpu, |_| Material::matt("opaque", Vec3::ONE));
    assert_eq!(opaque, 0.0);
    let full = 0.5 / PI as f32 * 2.0;
    let (_, masked) = through_a_sheet(&gpu, |scene| Material {
        base_color_texture: Some(checker(scene, [255, 255, 255, 0], [255; 4])),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        ..Material::matt("masked", Vec3::ONE)
    });
    // v grows downward: texel (0, 0) lies at -x and -z.
    for lit in masked.lit() {
        let (x, z) = (lit.position.x, lit.position.z);
        if x.abs().min(z.abs()) < 0.04 || x.abs().max(z.abs()) > 0.46 {
            continue;
        }
        let expected = if (x < 0.0) == (z < 0.0) { full } else { 0.0 };
        assert!(
            (lit.radiance.x - expected).abs() < 0.01 * full,
            "{lit:?}, not {expected}"
        );
    }
    let (blended, _) = through_a_sheet(&gpu, |_| Material {
        base_color: Vec4::new(1.0, 1.0, 1.0, 0.3),
        alpha_mode: AlphaMode::Blend,
        ..Material::matt("blended", Vec3::ONE)
    });
    assert!(
        (blended - 0.7).abs() < 0.02,
        "{blended} of the light through alpha 0.3"
    );
    let (glass, _) = through_a_sheet(&gpu, |_| Material {
        transmission: 1.0,
        roughness: 0.0,
        ..Material {
            name: "glass".into(),
            ..Material::default()
        }
    });
    assert!(
        (glass - 0.96).abs() < 0.02,
        "{glass} of the light through glass"
    );
}

/// Width (m) over which light rises from none to full across the shadow edge of a half-plane at `height`, under a spot
/// light at 3 m.
fn penumbra(gpu: &gpugi::gpu::Gpu, filter: &str, radius: f32, height: f32) -> f32 {
    let cone = LightKind::Spot {
        inner_cone_angle: 0.6,
        outer_cone_angle: 0.7,
    };
    let mut spot = Light::new("spot", cone, Vec3::splat(20.0)).aimed(Vec3::Y * 3.0, Vec3::ZERO);
    spot.radius = radius;
    let unshadowed = lit_by(floor(2.0), spot);
    let mut scene = unshadowed.clone();
    place(
        &mut scene,
        quad(vec3(0.0, height, 3.0), Vec3::X * 3.0, Vec3::NEG_Z * 6.0, 1),
        Material::matt("", Vec3::ONE),
    );
    let settings = [
        &format!("shadow-map.filter={filter}")[..],
        "shadow-map.taps=64",
    ];
    let camera = from_above(1.6, 0.2);
    let shadowed = render(gpu, &scene, &camera, 96, &settings);
    let full = render(gpu, &unshadowed, &camera, 96, &settings);
    // The mean over columns of |d light / dx| is a disc's profile; its standard deviation is a quarter of its width.
    let part: Vec<f32> = (0..96)
        .map(|x| {
            let sum = |picture: &crate::common::Picture| {
                (0..96)
                    .map(|y| picture.radiance[(y * 96 + x) * 3])
                    .sum::<f32>()
            };
            sum(&shadowed) / sum(&full)
        })
        .collect();
    let slope: Vec<f32> = part
        .windows(2)
        .map(|pair| (pair[0] - pair[1]).abs())
        .collect();
    let total: f32 = slope.iter().sum();
    let mean = slope
        .iter()
        .enumerate()
        .map(|(i, s)| i as f32 * s)
        .sum::<f32>()
        / total;
    let variance = slope
        .iter()
        .enumerate()
        .map(|(i, s)| (i as f32 - mean).powi(2) * s)
        .sum::<f32>()
        / total;
    4.0 * variance.sqrt() * 1.6 / 96.0
}

#[test]
fn pcss_penumbrae_grow_and_pcf_edges_do_not() {
    let Some(gpu) = gpu() else { return };
    let mut pcf = Vec::new();
    for (radius, height) in [(0.05, 1.0), (0.1, 1.0), (0.1, 0.5), (0.1, 1.5)] {
        let analytic = 2.0 * radius * height / (3.0 - height);
        let width = penumbra(&gpu, "pcss", radius, height);
        println!("radius {radius} m, blocker at {height} m: {width} m wide, exact {analytic} m");
        assert!(
            (width / analytic - 1.0).abs() < 0.4,
            "{width} m, not {analytic} m"
        );
        pcf.push(penumbra(&gpu, "pcf", radius, height));
    }
    println!("pcf: {pcf:?}");
    assert!(
        pcf.iter().all(|width| (width - pcf[0]).abs() < 0.015),
        "{pcf:?}"
    );
}

#[test]
fn every_face_of_a_hemicube_casts() {
    let Some(gpu) = gpu() else { return };
    // A tiny lamp half a metre from a surface below (or, if two-sided, above), with a box on each of its four sides,
    // beyond 45 degrees.
    for up in [-1.0_f32, 1.0] {
        let lamp = vec3(0.05, 0.0, -0.03);
        let mut scene = Scene::new("sides");
        let edge = Vec3::Z * up * 2.5;
        let surface = quad(
            vec3(-2.5, up * 0.5, 0.0) + edge,
            Vec3::X * 5.0,
            edge * -2.0,
            1,
        );
        let surface = if up > 0.0 {
            quad(vec3(-2.5, 0.5, -2.5), Vec3::X * 5.0, Vec3::Z * 5.0, 1)
        } else {
            surface
        };
        let mut grey = Material::matt("grey", Vec3::splat(0.5));
        grey.double_sided = true;
        place(&mut scene, surface, grey.clone());
        let boxes: Vec<(Vec3, Vec3)> = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z]
            .map(|side| {
                (
                    side * 1.2 + vec3(0.0, up * 0.35, 0.0),
                    Vec3::new(0.2, 0.1, 0.2),
                )
            })
            .map(|(center, half)| (center - half, center + half))
            .to_vec();
        for (min, max) in &boxes {
            place(&mut scene, cuboid(*min, *max, 1), grey.clone());
        }
        let emitter = Material {
            double_sided: up > 0.0,
            ..Material::emitter("lamp", Vec3::splat(1e4))
        };
        place(
            &mut scene,
            quad(
                lamp - vec3(0.005, 0.0, 0.005),
                Vec3::X * 0.01,
                Vec3::Z * 0.01,
                1,
            ),
            emitter,
        );
        // Seen through the surface, which is double-sided: lit parts are visible only from the lamp's side.
        let mut camera = Camera::look_at(
            "",
            lamp + vec3(0.0, -up * 1.0, 0.0),
            lamp + vec3(0.0, up, 0.0),
            1.0,
        );
        camera.projection = gpugi_scene::Projection::Orthographic { height: 4.8 };
        let settings = [
            "shadow-map.area-samples=4",
            "shadow-map.area-resolution=512",
        ];
        let picture = render(&gpu, &scene, &camera, 96, &settings);
        let mut dark = [0; 4];
        for lit in picture.lit().filter(|lit| floor_of(lit)) {
            let from = lit.position - Vec3::Y * up * 1e-3;
            for (count, (min, max)) in dark.iter_mut().zip(&boxes) {
                if meets(from, lamp, *min + 0.04, *max - 0.04) {
                    *count += 1;
                    assert_eq!(
                        lit.radiance.x, 0.0,
                        "{lit:?} lies in the shadow of the box at {min}"
                    );
                }
            }
            if !boxes
                .iter()
                .any(|(min, max)| meets(from, lamp, *min - 0.06, *max + 0.06))
            {
                assert!(lit.radiance.x > 0.0, "{lit:?} is lit");
            }
        }
        assert!(
            dark.iter().all(|&count| count > 5),
            "{dark:?} pixels in the four shadows"
        );
    }
}

/// Error against the path tracer of the shadow of a box on the floor, without the path tracer's own error.
fn soft_shadow_error(gpu: &gpugi::gpu::Gpu, light: Light, per_sample: bool) -> f64 {
    let mut scene = lit_by(floor(2.0), light);
    let block = cuboid(vec3(-0.3, 0.0, -0.3), vec3(0.3, 1.0, 0.3), 1);
    place(&mut scene, block, Material::matt("", Vec3::splat(0.5)));
    let camera = Camera::look_at("", vec3(2.0, 2.5, 2.0), vec3(-0.3, 0.2, -0.3), 0.9);
    let setting = format!("per-sample={per_sample}");
    let name = "shadow-map";
    let mut renderer = renderer_of(gpu, &scene, &[name], 48, name, &[&setting]);
    crate::common::rel_mse(&measured(gpu, &scene, &camera, &mut renderer, [64, 512]))
}

#[test]
fn samples_of_a_picture_add_up_to_exact_soft_shadows() {
    let Some(gpu) = gpu() else { return };
    let kinds = [
        (LightKind::Point, Vec3::splat(20.0), 0.3),
        (LightKind::Directional, Vec3::splat(3.0), 0.1),
    ];
    for (kind, intensity, radius) in kinds {
        let mut light = Light::new("", kind, intensity).aimed(vec3(1.5, 3.0, -1.0), Vec3::ZERO);
        light.radius = radius;
        let [moved, fixed] =
            [true, false].map(|per_sample| soft_shadow_error(&gpu, light.clone(), per_sample));
        println!("{kind:?}: rel-mse {moved:.1e}, of the light's centre {fixed:.1e}");
        assert!(moved < 1e-3, "{kind:?}: {moved}");
        assert!(fixed > 5.0 * moved, "{kind:?}: {fixed}, {moved}");
    }
}

/// Mean of the red of 2 x 2 pixels.
fn fours(picture: &Picture, side: usize) -> Vec<f32> {
    let red = |x: usize, y: usize| picture.radiance[3 * (y * side + x)];
    let corners = (0..side / 2).flat_map(|y| (0..side / 2).map(move |x| (2 * x, 2 * y)));
    let sums = corners.map(|(x, y)| red(x, y) + red(x + 1, y) + red(x, y + 1) + red(x + 1, y + 1));
    sums.map(|sum| sum / 4.0).collect()
}

#[test]
fn neighbours_share_the_samples_of_an_area_light() {
    const SIDE: u32 = 64;
    let Some(gpu) = gpu() else { return };
    let mut scene = under_a_lamp(false);
    let block = cuboid(vec3(-0.3, 0.0, -0.3), vec3(0.3, 0.6, 0.3), 1);
    place(&mut scene, block, Material::matt("", Vec3::splat(0.5)));
    let camera = from_above(2.2, 1.8);
    let [whole, shared] = ["false", "true"].map(|is_shared| {
        let interleaved = format!("shadow-map.interleaved={is_shared}");
        render(&gpu, &scene, &camera, SIDE, &[&interleaved])
    });
    let error = |radiance: &[f32], other: &[f32]| {
        rel_mse(radiance.iter().copied().zip(other.iter().copied()))
    };
    let of_pixels = error(&shared.radiance, &whole.radiance);
    let of_fours = error(
        &fours(&shared, SIDE as usize),
        &fours(&whole, SIDE as usize),
    );
    println!("rel-mse of pixels {of_pixels:.1e}, of 2 x 2 pixels {of_fours:.1e}");
    assert!(of_pixels < 5e-3, "{of_pixels}");
    assert!(of_fours < 0.2 * of_pixels, "{of_fours}, {of_pixels}");
    // Fewer samples are too few to share.
    let [whole, shared] = ["false", "true"].map(|is_shared| {
        let interleaved = format!("shadow-map.interleaved={is_shared}");
        render(&gpu, &scene, &camera, SIDE, &[&samples(12), &interleaved])
    });
    assert_eq!(whole.radiance, shared.radiance);
}
