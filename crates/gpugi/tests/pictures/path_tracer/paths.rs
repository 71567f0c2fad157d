//! Light paths and classes of lights: the parts of a partition sum to the whole, and each part is where it belongs.

use glam::{DVec3, Vec3, vec3};
use gpugi::reference::Settings;
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Camera, Light, LightKind, Material, Scene, Volume};

use super::{Batches, environment, picture, trace, tracer};
use crate::common::{floor, gpu, place};

const SIZE: [u32; 2] = [24, 16];

/// A matt floor with a glossy box, a mirror and a block of glass on it, under a lamp, a point light and a sky.
fn still_life() -> Scene {
    let mut scene = floor(2.0);
    let coated = Material {
        roughness: 0.4,
        ..Material::matt("", vec3(0.7, 0.3, 0.2))
    };
    let glossy = Material {
        specular: 1.0,
        ..coated
    };
    let stand =
        |x: f32, z: f32| cuboid(vec3(x - 0.3, 0.0, z - 0.3), vec3(x + 0.3, 0.6, z + 0.3), 1);
    place(&mut scene, stand(-0.9, 0.2), glossy);
    let mirror = quad(vec3(-0.5, 0.0, -0.8), Vec3::X, Vec3::Y * 0.9, 1);
    place(
        &mut scene,
        mirror,
        Material::metal("mirror", Vec3::splat(0.9), 0.0),
    );
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: vec3(0.9, 0.7, 0.5),
        }),
        ..Material::default()
    };
    place(&mut scene, stand(0.9, 0.2), glass);
    let lamp = quad(vec3(-0.4, 1.6, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8, 1);
    place(
        &mut scene,
        lamp,
        Material::emitter("lamp", vec3(3.0, 2.5, 2.0)),
    );
    let bulb = Light::new("bulb", LightKind::Point, Vec3::splat(0.6));
    scene
        .lights
        .push(bulb.aimed(vec3(0.2, 0.9, 1.0), Vec3::ZERO));
    scene.environment = Some(environment(
        2,
        &[
            vec3(0.1, 0.2, 0.4),
            vec3(0.3, 0.2, 0.1),
            Vec3::splat(0.05),
            Vec3::splat(0.1),
        ],
    ));
    scene
}

fn eye() -> Camera {
    Camera::look_at("", vec3(0.0, 1.3, 2.8), vec3(0.0, 0.35, 0.0), 0.65)
}

fn keeping(paths: &str) -> Settings {
    Settings {
        paths: paths.to_owned(),
        ..Settings::default()
    }
}

/// Checks that the means of the parts sum to the mean of the whole, within their noise.
fn check_sum(what: &str, whole: &Batches, parts: &[Batches], tolerance: f64) {
    let mut sum = DVec3::ZERO;
    let mut variance = DVec3::ZERO;
    for part in parts {
        let mean = part.mean();
        assert!(mean.value.min_element() > 0.0, "{what}: a part is black");
        sum += mean.value;
        variance += mean.error * mean.error;
    }
    let whole = whole.mean();
    variance += whole.error * whole.error;
    let error = variance.max_element().sqrt();
    let off = (sum - whole.value).abs().max_element();
    println!("{what}: {sum}, whole {}, noise {error}", whole.value);
    assert!(4.0 * error < tolerance, "{what}: noise of {error}");
    assert!(off < tolerance, "{what}: {sum} is not {}", whole.value);
}

#[test]
fn the_parts_of_a_partition_add_up() {
    let Some(gpu) = gpu() else { return };
    let scene = still_life();
    let of = |settings: &Settings| trace(&gpu, &scene, &eye(), SIZE, 24, settings);
    let whole = of(&Settings::default());
    let tolerance = 0.025 * whole.mean().value.max_element();
    let parts = |patterns: &[&str]| -> Vec<Batches> {
        patterns.iter().map(|paths| of(&keeping(paths))).collect()
    };
    check_sum(
        "lobes at the eye",
        &whole,
        &parts(&["LE", "L.*DE", "L.*GE", "L.*SE"]),
        tolerance,
    );
    let by_class: Vec<Batches> = ["punctual", "area", "environment"]
        .map(|lights| {
            of(&Settings {
                lights: lights.to_owned(),
                ..Settings::default()
            })
        })
        .into();
    check_sum("classes of lights", &whole, &by_class, tolerance);
}

/// Where lobes are not told apart, the same seed traces the same paths: the parts sum to the whole in every pixel.
#[test]
fn the_numbers_of_bounces_add_up_in_every_pixel() {
    let Some(gpu) = gpu() else { return };
    let scene = still_life();
    let of = |paths: &str| {
        let mut tracer = tracer(&gpu, &scene, SIZE, &keeping(paths));
        picture(&mut tracer, &eye(), 16, 5)
    };
    let whole = of("L.*E");
    let parts = ["LE", "L.E", "L..E", "L...+E"].map(of);
    for (at, whole) in whole.iter().enumerate() {
        let sum: f32 = parts.iter().map(|part| part[at]).sum();
        assert!(
            (sum - whole).abs() < 1e-5 + 1e-4 * whole,
            "value {at}: {sum}, not {whole}"
        );
    }
    // At most one bounce gives exactly the direct light.
    let settings = Settings {
        max_bounces: 1,
        ..Settings::default()
    };
    let direct = picture(&mut tracer(&gpu, &scene, SIZE, &settings), &eye(), 16, 5);
    for ((direct, emitted), once) in direct.iter().zip(&parts[0]).zip(&parts[1]) {
        assert!((direct - emitted - once).abs() < 1e-5 + 1e-4 * direct);
    }
}

/// Whether a pixel of the still life lies wholly within one of its objects: whether the rays through its four corners
/// meet the object's box.
fn shows(at: usize, low: Vec3, high: Vec3) -> bool {
    let camera = eye();
    let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
    let tangent = 0.325_f32.tan();
    corners.iter().all(|(dx, dy)| {
        let x = ((at as u32 % SIZE[0]) as f32 + dx) / SIZE[0] as f32 * 2.0 - 1.0;
        let y = 1.0 - ((at as u32 / SIZE[0]) as f32 + dy) / SIZE[1] as f32 * 2.0;
        let aspect = SIZE[0] as f32 / SIZE[1] as f32;
        let in_view = vec3(x * tangent * aspect, y * tangent, -1.0);
        let from = camera.world_from_view.w_axis.truncate();
        let direction = camera.world_from_view.transform_vector3(in_view);
        crate::common::meets(from, from + direction * 10.0, low, high)
    })
}

#[test]
fn each_part_is_where_its_lobe_is() {
    let Some(gpu) = gpu() else { return };
    let scene = still_life();
    let of = |paths: &str| {
        let mut tracer = tracer(&gpu, &scene, SIZE, &keeping(paths));
        picture(&mut tracer, &eye(), 16, 5)
    };
    let (matt, specular) = (of("LDE"), of("L.*SE"));
    let (glossy, diffuse) = (of("L.*GE"), of("L.*DE"));
    let count = (SIZE[0] * SIZE[1]) as usize;
    let luminance = |picture: &[f32], at: usize| picture[at * 3] + picture[at * 3 + 1];
    let block = |x: f32| (vec3(x - 0.3, 0.0, -0.1), vec3(x + 0.3, 0.6, 0.5));
    let mut counts = [0; 3];
    for at in 0..count {
        let (low, high) = block(-0.9);
        let (glass_low, glass_high) = block(0.9);
        if shows(at, vec3(-0.5, 0.0, -0.81), vec3(0.5, 0.9, -0.79)) {
            counts[0] += 1;
            assert!(luminance(&specular, at) > 0.0, "the mirror at {at}");
            assert_eq!(luminance(&matt, at) + luminance(&diffuse, at), 0.0);
            assert_eq!(luminance(&glossy, at), 0.0);
        } else if shows(at, glass_low, glass_high) {
            counts[1] += 1;
            assert!(luminance(&specular, at) > 0.0, "the glass at {at}");
            assert_eq!(luminance(&matt, at) + luminance(&glossy, at), 0.0);
        } else if shows(at, low, high) {
            counts[2] += 1;
            assert!(luminance(&glossy, at) > 0.0, "the glossy box at {at}");
            assert!(luminance(&matt, at) > 0.0);
            assert_eq!(luminance(&specular, at), 0.0);
        }
    }
    println!("pixels of mirror, glass and glossy box: {counts:?}");
    assert!(counts.iter().all(|&count| count >= 6), "{counts:?}");
}

/// A lamp, a mirror, a floor: the floor is lit by way of the mirror, and only where the mirror reflects the light.
#[test]
fn a_mirror_throws_a_caustic() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    // The lamp at x = -1 shines toward +x, and the mirror stands at x = 1; by reflection, the lamp seems to shine from
    // x = 3.
    let lamp = quad(vec3(-1.0, 0.3, 0.4), Vec3::NEG_Z * 0.8, Vec3::Y * 0.8, 1);
    assert!(lamp.normals[0].x > 0.9);
    place(
        &mut scene,
        lamp,
        Material::emitter("lamp", Vec3::splat(5.0)),
    );
    let mirror = quad(vec3(1.0, 0.0, -4.0), Vec3::Z * 8.0, Vec3::Y * 8.0, 1);
    assert!(mirror.normals[0].x < -0.9);
    place(
        &mut scene,
        mirror,
        Material::metal("mirror", Vec3::splat(0.8), 0.0),
    );
    let camera = crate::common::from_above(0.8, 10.0);
    let caustic = trace(&gpu, &scene, &camera, [8, 8], 512, &keeping("LS+[DG]E")).mean();

    // The same without the mirror: a second lamp behind the wall, four fifths as bright.
    let mut unfolded = floor(2.0);
    let image = quad(vec3(3.0, 0.3, -0.4), Vec3::Z * 0.8, Vec3::Y * 0.8, 1);
    assert!(image.normals[0].x < -0.9);
    place(
        &mut unfolded,
        image,
        Material::emitter("image", Vec3::splat(4.0)),
    );
    let expected = trace(&gpu, &unfolded, &camera, [8, 8], 64, &keeping("L[DG]E")).mean();
    assert!(expected.value.x > 0.0 && expected.error.x < 0.01 * expected.value.x);
    caustic.check("the caustic", expected.value, 0.12 * expected.value.x);
}

/// Half metal, half matt, under a white sky: a path that must tell its lobes apart continues with one of them, and both
/// get their share.
#[test]
fn two_lobes_of_a_surface_share_its_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    scene.materials[0] = Material {
        metallic: 0.5,
        roughness: 0.5,
        ..Material::matt("", Vec3::splat(0.9))
    };
    scene.environment = Some(super::white());
    let camera = super::parallel(Vec3::ZERO, vec3(0.0, 1.0, 1.0), 1.0);
    let of = |paths: &str| trace(&gpu, &scene, &camera, [16, 16], 32, &keeping(paths));
    let parts = ["LDE", "LGE"].map(of);
    check_sum("two lobes", &of("L.*E"), &parts, 0.008);
}
