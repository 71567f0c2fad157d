//! Tests the energy of all texels together, and their irradiance against that of many rays.

use std::f32::consts::PI;

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Camera, Instance, Material, Mesh, Scene};

use super::{Radiosity, Saved};
use crate::capture::{CaptureKernels, Emission, View};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::scene::GpuScene;
use crate::techniques::{Earlier, EarlierLight, Resume, Shared, Technique, Texels};
use crate::testing::{read_points, settled, test_gpu};

const ALBEDO: f32 = 0.6;

/// A mesh seen from inside.
fn inside_out(mut mesh: Mesh) -> Mesh {
    for triangle in mesh.indices.as_chunks_mut::<3>().0 {
        triangle.swap(1, 2);
    }
    for normal in &mut mesh.normals {
        *normal = -*normal;
    }
    mesh
}

/// A closed room with a box in it that emits light and reflects nothing.
fn room() -> Scene {
    let [min, max] = [vec3(-0.2, 0.6, -0.3), vec3(0.3, 0.9, 0.2)];
    room_with_lamp(min, max, 3.0)
}

fn room_with_lamp(min: Vec3, max: Vec3, radiance: f32) -> Scene {
    let mut scene = Scene::new("room");
    let mut add = |mesh: Mesh, material: Material| {
        let (mesh, material) = (scene.add_mesh(mesh), scene.add_material(material));
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    };
    let walls = inside_out(cuboid(vec3(-1.0, 0.0, -1.5), vec3(1.0, 1.5, 1.5), 1));
    add(walls, Material::matt("grey", Vec3::splat(ALBEDO)));
    add(
        cuboid(min, max, 1),
        Material::emitter("lamp", Vec3::splat(radiance)),
    );
    scene
}

/// A texel: instance, area (m^2) and the first channel of its irradiance (W/m^2).
type Texel = (u32, f32, f32);

/// The texels after a scene's first frame: those of all pieces, of at most `most_texels` each, in order.
fn texels(
    gpu: &Gpu,
    scene: &Scene,
    settings: &[(&str, &str)],
    seed: u32,
    most_texels: u32,
) -> Vec<Texel> {
    let (on_gpu, radiosity) = solved(gpu, scene, settings, seed, most_texels);
    found(gpu, &on_gpu, &radiosity)
}

/// The texels that have points.
fn found(gpu: &Gpu, on_gpu: &GpuScene, radiosity: &Radiosity) -> Vec<Texel> {
    let solution = radiosity.solution().unwrap();
    let points = solution.texels.capture.points();
    let points = points.flat_map(|points| read_points(gpu, on_gpu, points));
    let irradiance = &solution.irradiance.target.radiance;
    let irradiance: Vec<[f32; 4]> = read_buffer(gpu, irradiance, irradiance.size()).unwrap();
    let texels = points.zip(&irradiance);
    texels
        .filter(|(point, _)| point.instance != u32::MAX)
        .map(|(point, found)| (point.instance, point.area, found[0]))
        .collect()
}

/// Radiosity after a scene's first frame.
fn solved(
    gpu: &Gpu,
    scene: &Scene,
    settings: &[(&str, &str)],
    seed: u32,
    most_texels: u32,
) -> (GpuScene, Radiosity) {
    let mut on_gpu = GpuScene::with_texels(gpu, scene).unwrap();
    let mut radiosity = Radiosity {
        most_texels,
        ..Default::default()
    };
    for (name, value) in settings {
        radiosity.settings_mut().set(name, value).unwrap();
    }
    radiosity.plan(&on_gpu, &[], &[]);
    let mut emission = Emission::new(gpu, &on_gpu).unwrap();
    let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
    let mut shared = Shared::new(gpu, &on_gpu, &kernels).unwrap();
    let camera = Camera::look_at("", Vec3::ONE, Vec3::ZERO, 1.0);
    let view = View::new(&camera, [8, 8], glam::Vec2::ZERO, 0, seed, 1.0);
    let mut frame = Frame::new(gpu, false);
    on_gpu.merge(&mut frame);
    let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut []), &mut shared);
    let mut generate = || {
        let generated = radiosity.generate(&mut frame, &on_gpu, &view, &mut lit);
        settled(generated).unwrap().pending
    };
    assert!(generate().is_some(), "the atlas is laid out beside frames");
    on_gpu.wait_for_atlas();
    assert_eq!(generate(), None);
    frame.submit().unwrap();
    (on_gpu, radiosity)
}

const RAYS: &[(&str, &str)] = &[
    ("resolution", "48"),
    ("rays", "16"),
    ("burn-in", "24"),
    ("iterations", "16"),
    ("steps", "16"),
];
const SHOOTING: &[(&str, &str)] = &[
    ("mode", "shooting"),
    ("resolution", "48"),
    ("hemicube-resolution", "64"),
    ("burn-in", "24"),
    ("iterations", "96"),
    ("steps", "96"),
];

/// The fraction of a lamp's power that is absorbed in the end: sum (1 - rho) E A / (pi L_e A_lamp), which is 1 in a
/// closed room.
fn absorbed_part(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> f32 {
    let texels = texels(gpu, scene, settings, 0, u32::MAX);
    let lamp = scene.instances.len() as u32 - 1;
    let absorbed = |(instance, area, irradiance): &Texel| {
        let part = if *instance == lamp { 1.0 } else { 1.0 - ALBEDO };
        part * area * irradiance
    };
    let shining = texels.iter().filter(|texel| texel.0 == lamp);
    let emitted = PI * 3.0 * shining.map(|texel| texel.1).sum::<f32>();
    texels.iter().map(absorbed).sum::<f32>() / emitted
}

#[test]
fn all_power_is_absorbed_in_a_closed_room() {
    let Some(gpu) = test_gpu() else { return };
    let part = absorbed_part(&gpu, &room(), RAYS);
    println!("rays: {part}");
    assert!((part - 1.0).abs() < 0.01, "{part}");
}

/// The bound on the light of near texels loses less and less light as texels shrink.
#[test]
fn shooting_conserves_power_as_texels_shrink() {
    let Some(gpu) = test_gpu() else { return };
    let lost = ["24", "48", "96"].map(|resolution| {
        let mut settings = SHOOTING.to_vec();
        settings.push(("resolution", resolution));
        1.0 - absorbed_part(&gpu, &room(), &settings)
    });
    println!("lost: {lost:?}");
    assert!(
        lost[2] < 0.05 && lost[2] < 0.6 * lost[1] && lost[1] < 0.7 * lost[0],
        "{lost:?}"
    );
}

/// The mean over seeds is what many rays find: its error keeps falling as the number of seeds grows.
#[test]
fn the_mean_over_seeds_converges() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room();
    let mut exact = RAYS.to_vec();
    exact.extend([("rays", "32"), ("iterations", "32"), ("steps", "32")]);
    let exact = texels(&gpu, &scene, &exact, 1000, u32::MAX);
    let total: f32 = exact.iter().map(|texel| texel.1 * texel.2 * texel.2).sum();
    // Relative mean square errors of the mean light, with so few rays that much noise remains.
    let few = [
        ("rays", "1"),
        ("iterations", "2"),
        ("steps", "2"),
        ("burn-in", "16"),
    ];
    let mut settings = RAYS.to_vec();
    settings.extend(few);
    let mut sums = vec![0.0; exact.len()];
    let mut errors = Vec::new();
    for seed in 0..16_u32 {
        let found = texels(&gpu, &scene, &settings, seed, u32::MAX);
        for (sum, texel) in sums.iter_mut().zip(&found) {
            *sum += texel.2;
        }
        let off =
            |(sum, texel): (&f32, &Texel)| texel.1 * (sum / (seed + 1) as f32 - texel.2).powi(2);
        errors.push(sums.iter().zip(&exact).map(off).sum::<f32>() / total);
    }
    println!("{errors:?}");
    // Variance falls in proportion to 1 / seeds; a bias would remain.
    assert!(errors[0] > 12.0 * errors[15], "{errors:?}");
}

/// If light comes from a small source, most rays miss it unless some are aimed at it; the mean light is the same.
#[test]
fn rays_aimed_at_bright_texels_find_them() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room_with_lamp(vec3(0.3, 0.8, 0.3), vec3(0.5, 1.0, 0.5), 100.0);
    let of = |settings: &[(&str, &str)], seed| {
        let settings = [RAYS, settings].concat();
        texels(&gpu, &scene, &settings, seed, u32::MAX)
    };
    let many = [("rays", "64"), ("iterations", "64"), ("steps", "64")];
    let unaimed = [&many[..], &[("light-sampled-rays", "0")]].concat();
    let [exact, unaimed] = [of(&many, 1000), of(&unaimed, 2000)];
    let power = |texels: &[Texel]| texels.iter().map(|texel| texel.1 * texel.2).sum::<f32>();
    let ratio = power(&exact) / power(&unaimed);
    println!("{ratio} of what is found without aim");
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    let total: f32 = exact.iter().map(|texel| texel.1 * texel.2 * texel.2).sum();
    let error = |aimed| {
        let found = of(&[("rays", "4"), ("light-sampled-rays", aimed)], 0);
        let off = |(texel, other): (&Texel, &Texel)| texel.1 * (texel.2 - other.2).powi(2);
        found.iter().zip(&exact).map(off).sum::<f32>() / total
    };
    let [without, aimed] = [error("0"), error("1")];
    println!("error {aimed} instead of {without}");
    assert!(aimed * 2.5 < without, "{aimed} {without}");
}

#[test]
fn what_was_not_saved_for_it_is_refused() {
    let Some(gpu) = test_gpu() else { return };
    let (_, mut radiosity) = solved(&gpu, &room(), RAYS, 0, u32::MAX);
    let bytes = radiosity.save(&gpu).unwrap().unwrap();
    assert_eq!(radiosity.resume(&gpu, &bytes), Ok(true));
    let mut changed = |change: &dyn Fn(&mut Saved)| {
        let mut saved: Saved = postcard::from_bytes(&bytes).unwrap();
        change(&mut saved);
        radiosity.resume(&gpu, &postcard::to_allocvec(&saved).unwrap())
    };
    // 24 are dropped, 16 count.
    for iterates in [0, 7, 24, 41, u32::MAX] {
        assert!(changed(&|saved| saved.iterates = iterates).is_err());
    }
    assert!(changed(&|saved| saved.light.truncate(8)).is_err());
    assert_eq!(changed(&|saved| saved.revision_of_light += 1), Ok(false));
    assert!(radiosity.resume(&gpu, &bytes[..7]).is_err());
}

/// Texels in several dispatches, and in several pages.
#[test]
fn pieces_make_no_difference_and_pages_hold_the_same_light() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room();
    for settings in [RAYS, SHOOTING] {
        let [whole, pieces] = [u32::MAX, 500].map(|most| texels(&gpu, &scene, settings, 0, most));
        assert!(whole.len() > 500 && whole == pieces);
    }
    // Objects that light does not reach, but that need pages of their own.
    let mut scene = room();
    for x in [5.0, 9.0] {
        let mesh = scene.add_mesh(cuboid(vec3(x, 0.0, 0.0), vec3(x + 2.0, 2.0, 2.0), 1));
        scene.instances.insert(
            0,
            Instance {
                mesh,
                ..scene.instances[0].clone()
            },
        );
    }
    let mut settings = RAYS.to_vec();
    settings.extend([("resolution", "128"), ("density", "16")]);
    let lit = texels(&gpu, &scene, &settings, 0, 128 * 128);
    let areas = |of: &[Texel]| {
        of.iter()
            .filter(|texel| texel.2 > 0.0)
            .map(|texel| texel.1)
            .sum::<f32>()
    };
    assert!((areas(&lit) / areas(&texels(&gpu, &room(), RAYS, 0, u32::MAX)) - 1.0).abs() < 0.01);
    let part = absorbed_part(&gpu, &scene, &settings);
    assert!((part - 1.0).abs() < 0.01, "{part}");
}

/// A room whose walls are separate meshes, each of which may lie in another page.
fn room_of_walls() -> Scene {
    let (width, height, depth) = (Vec3::X * 2.0, Vec3::Y * 1.5, Vec3::Z * 3.0);
    let [low, high] = [vec3(-1.0, 0.0, -1.5), vec3(1.0, 1.5, 1.5)];
    let mut scene = Scene::new("walls");
    let walls = [
        (quad(low, depth, width, 1), 0.3),
        (quad(low, height, depth, 1), 0.8),
        (quad(low, width, height, 1), 0.6),
        (quad(high, -width, -depth, 1), 0.5),
        (quad(high, -depth, -height, 1), 0.2),
        (quad(high, -height, -width, 1), 0.7),
    ];
    for (mesh, albedo) in walls {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material::matt("wall", Vec3::splat(albedo)));
        scene.add_instance("", mesh, material, Mat4::IDENTITY);
    }
    let mesh = scene.add_mesh(cuboid(vec3(-0.2, 0.6, -0.3), vec3(0.3, 0.9, 0.2), 1));
    let material = scene.add_material(Material::emitter("lamp", Vec3::splat(3.0)));
    scene.add_instance("lamp", mesh, material, Mat4::IDENTITY);
    scene
}

#[test]
fn several_pages_hold_the_light_of_one() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room_of_walls();
    // The noise of shooting stems from few shooters, which all texels share.
    for (mode, most, most_of_all) in [(RAYS, 0.01, 0.005), (SHOOTING, 0.08, 0.015)] {
        let of = |resolution, seed| {
            let more = [("resolution", resolution), ("density", "16")];
            let settings = [mode, &more].concat();
            let (on_gpu, radiosity) = solved(&gpu, &scene, &settings, seed, u32::MAX);
            let pages = radiosity.solution().unwrap().texels.capture.pages;
            (pages, found(&gpu, &on_gpu, &radiosity))
        };
        let ((one, whole), (several, parts)) = (of("128", 0), of("64", 1));
        assert!(one == 1 && several > 1, "{one} and {several} pages");
        let off = |is_meant: &dyn Fn(u32) -> bool| {
            let mean = |texels: &[Texel]| {
                let meant = texels.iter().filter(|texel| is_meant(texel.0));
                let sums = meant.map(|texel| (texel.1 * texel.2, texel.1));
                let (light, area) = sums.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
                light / area
            };
            mean(&parts) / mean(&whole) - 1.0
        };
        let of_walls = [0, 1, 2, 3, 4, 5].map(|wall| off(&|instance| instance == wall));
        let of_all = off(&|_| true);
        println!("in {several} pages {of_walls:+.4?} more, of all {of_all:+.4}");
        assert!(of_walls.iter().all(|off| off.abs() < most), "{of_walls:?}");
        assert!(of_all.abs() < most_of_all, "{of_all}");
    }
}

#[test]
fn maps_are_those_of_all_pages() {
    let Some(gpu) = test_gpu() else { return };
    let settings = [RAYS, &[("resolution", "64"), ("density", "16")]].concat();
    let (_, radiosity) = solved(&gpu, &room_of_walls(), &settings, 0, 64 * 64);
    let pages = radiosity.solution().unwrap().texels.capture.pages;
    let maps = radiosity.inspect().maps;
    assert_eq!(maps.len() as u32, 1 + 2 * pages);
    let mut rows = [0; 3];
    for map in &maps {
        let Texels::Buffer {
            buffer,
            size: [width, height],
            stride,
            is_number,
        } = &map.texels
        else {
            panic!("{} is a texture", map.name);
        };
        let kinds = ["irradiance", "direct", "coverage"];
        let kind = kinds.map(|kind| map.name.starts_with(&format!("radiosity.{kind}")));
        let kind = kind.iter().position(|is| *is).unwrap();
        rows[kind] += height;
        assert_eq!((*width, *is_number), (64, kind == 2));
        let bytes = u64::from(width * height) * stride;
        assert!(buffer.size() >= bytes, "{}", map.name);
        let words: Vec<u32> = read_buffer(&gpu, buffer, bytes).unwrap();
        if *is_number {
            assert!(words.contains(&0) && words.contains(&1), "{}", map.name);
        } else {
            assert!(
                words.iter().any(|word| *word != 0) || kind == 1,
                "{}",
                map.name
            );
        }
    }
    assert_eq!(rows, [64 * pages; 3]);
    // At least the points and two iterates.
    assert!(radiosity.inspect().work_bytes > u64::from(64 * 64 * pages) * (48 + 64));
}
