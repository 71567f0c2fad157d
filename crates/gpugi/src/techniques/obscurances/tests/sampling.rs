//! Tests of sampling: rays and peeling agree, steps resume, moving instances recompute what is near; and of what is
//! refused.

use glam::{Mat4, Vec3};
use gpugi_scene::atlas::{AtlasOptions, TexelDensity};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Atlas, Material, Scene};

use super::scenes::{
    FLOOR, WALL, check_bleeding, check_floor_and_wall, check_integral, check_sphere, corner, faces,
    floor_and_wall, hollow_sphere, matt, settings, to_edge,
};
use super::{Bench, Falloff, Found, Mode, Settings, Solution, found, rms};
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions};
use crate::gpu::GpuError;
use crate::scene::GpuScene;
use crate::settings::{SettingError, SettingSet};
use crate::testing::test_gpu;

fn peeling(distance: f32, falloff: Falloff) -> Settings {
    Settings {
        lines: 2.0,
        layers: 12,
        ..settings(Mode::Peeling, distance, falloff)
    }
}

#[test]
fn peeling_finds_a_floor_before_a_wall_too() {
    let Some(gpu) = test_gpu() else { return };
    for falloff in [Falloff::Sqrt, Falloff::Step] {
        let all = found(&gpu, &floor_and_wall(), 48, &peeling(1.0, falloff));
        check_floor_and_wall(&all, falloff, 0.01);
        if falloff == Falloff::Sqrt {
            check_bleeding(&all);
        }
    }
}

/// Also where surfaces cover little of a texel, so that few lines meet it.
#[test]
fn peeling_looks_around_inside_a_sphere() {
    let Some(gpu) = test_gpu() else { return };
    let albedo = Vec3::new(0.9, 0.5, 0.25);
    let scene = matt([(hollow_sphere(1.0, 32), albedo)]);
    for (lines, most) in [(1.0, 0.01), (2.0, 0.006)] {
        let settings = Settings {
            lines,
            ..peeling(2.5, Falloff::Sqrt)
        };
        let all = found(&gpu, &scene, 64, &settings);
        check_sphere(&all, albedo.as_dvec3(), most);
    }
}

#[test]
fn peeling_a_corner_against_the_integral() {
    let Some(gpu) = test_gpu() else { return };
    let scene = corner();
    let all = found(&gpu, &scene, 64, &peeling(1.5, Falloff::Sqrt));
    check_integral(&scene, &all, 1.5, all.len() / 100, 0.01);
}

fn difference(one: &[Found], other: &[Found]) -> (f64, f64) {
    assert_eq!(one.len(), other.len());
    let pairs = one.iter().zip(other);
    let plain = rms(pairs.clone().map(|(a, b)| a.plain - b.plain));
    (
        plain,
        rms(pairs.map(|(a, b)| a.colored.distance(b.colored))),
    )
}

#[test]
fn rays_and_peeling_agree() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
    let diagonal = scene.bounds().diagonal();
    // Where blocks touch the floor, rays would start on its far side.
    for instance in &mut scene.instances {
        if instance.name.contains("block") {
            let lift = Mat4::from_translation(Vec3::Y * diagonal * 0.01);
            instance.world_from_mesh = lift * instance.world_from_mesh;
        }
    }
    let [rays, peeled] = [Mode::Rays, Mode::Peeling].map(|mode| {
        let settings = Settings {
            mode,
            ..peeling(diagonal / 4.0, Falloff::Sqrt)
        };
        found(&gpu, &scene, 64, &settings)
    });
    // Rays sample W at a point, peeling its mean over a texel. In corners, where W is curved, that mean is smaller;
    // texels near edges are left out.
    let faces = faces(&scene);
    let [rays, peeled] = [rays, peeled].map(|all| -> Vec<Found> {
        let inner = all
            .into_iter()
            .filter(|texel| to_edge(&faces, texel.position) > 0.1);
        inner.collect()
    });
    assert!(rays.len() > 400, "{}", rays.len());
    let (plain, colored) = difference(&rays, &peeled);
    println!("rays and peeling: {plain:.4}, colours {colored:.4}");
    let mean = |all: &[Found]| all.iter().map(|texel| texel.plain).sum::<f64>() / all.len() as f64;
    println!("means {:.4} {:.4}", mean(&rays), mean(&peeled));
    assert!(plain < 0.02 && colored < 0.02, "{plain}, {colored}");
    assert!((mean(&rays) - mean(&peeled)).abs() < 0.006);
}

/// Where no surfaces touch, W at a texel's point equals its mean over the texel, and only noise differs, at each texel.
#[test]
fn rays_and_peeling_agree_at_every_texel_of_what_floats() {
    let Some(gpu) = test_gpu() else { return };
    let floor = shapes::quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, 1);
    let above = shapes::cuboid(Vec3::new(-0.6, 0.4, -0.5), Vec3::new(0.1, 0.9, 0.4), 1);
    let beside = shapes::cuboid(Vec3::new(0.45, 0.3, -0.4), Vec3::new(0.7, 1.1, 0.5), 1);
    let parts = [(floor, FLOOR), (above, WALL), (beside, Vec3::splat(0.8))];
    let scene = matt(parts);
    let faces = faces(&scene);
    let [rays, peeled] = [Mode::Rays, Mode::Peeling].map(|mode| {
        let settings = Settings {
            mode,
            directions: 512,
            ..peeling(1.0, Falloff::Sqrt)
        };
        found(&gpu, &scene, 64, &settings)
    });
    let mean = rays.iter().map(|texel| texel.area).sum::<f64>() / rays.len() as f64;
    let mut noises = Vec::new();
    let mut differences = Vec::new();
    for (by_rays, by_peeling) in rays.iter().zip(&peeled) {
        assert_eq!(by_rays.position, by_peeling.position);
        if to_edge(&faces, by_rays.position) < mean.sqrt() {
            continue;
        }
        let difference = by_rays.plain - by_peeling.plain;
        // Variance of a value between 0 and 1, with one sample per line: 4 lines of each bundle meet a texel that faces
        // them, half as many on average. The lines' even spread at least halves the noise.
        let samples = 512.0 * 4.0 / 2.0 * by_rays.area / mean;
        let noise = (by_rays.plain * (1.0 - by_rays.plain) / samples).sqrt() / 2.0;
        assert!(
            difference.abs() < 4.0 * noise + 1e-3,
            "{by_rays:?}, {by_peeling:?}: noise {noise}"
        );
        noises.push(noise);
        differences.push(difference);
    }
    let count = differences.len();
    let bias = differences.iter().sum::<f64>() / count as f64;
    let (noise, difference) = (rms(noises.into_iter()), rms(differences.into_iter()));
    println!("{count} texels: RMS {difference:.4}, noise {noise:.4}, bias {bias:.5}");
    assert!(count > 800 && difference < noise && bias.abs() < 1e-3);
}

#[test]
fn surfaces_on_each_other_are_neither_lost_nor_met_twice() {
    let Some(gpu) = test_gpu() else { return };
    // Below a plane that faces down, several coincident planes that face up.
    let quad = || shapes::quad(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0, 1);
    let sheets = |count: usize| {
        let above = shapes::quad(Vec3::Y * 0.5, Vec3::X * 2.0, Vec3::Z * 2.0, 1);
        let below = (0..count).map(|_| (quad(), Vec3::new(0.9, 0.3, 0.1)));
        matt([(above, FLOOR)].into_iter().chain(below))
    };
    let of = |count| {
        let settings = Settings {
            directions: 128,
            layers: 8,
            ..peeling(1.0, Falloff::Sqrt)
        };
        found(&gpu, &sheets(count), 64, &settings)
    };
    let mean = |all: &[Found], instance: u32| {
        let some = all.iter().filter(|texel| texel.instance == instance);
        let some: Vec<_> = some.map(|texel| texel.plain).collect();
        some.iter().sum::<f64>() / some.len() as f64
    };
    let (one, three) = (of(1), of(3));
    // The plane above sees no difference.
    assert!((mean(&one, 0) - mean(&three, 0)).abs() < 0.01);
    // Of the three coincident planes, the one that comes last on lines from below sees the plane above; the others hit
    // their neighbour at once.
    let seen: Vec<f64> = (1..4).map(|instance| mean(&three, instance)).collect();
    let open = mean(&one, 1);
    let sum: f64 = seen.iter().sum();
    assert!((sum - open).abs() < 0.02, "{seen:?}, alone {open}");
}

/// A block on a floor, and another far away.
fn blocks(at: f32) -> Scene {
    let block = || shapes::cuboid(Vec3::new(-0.3, 0.01, -0.3), Vec3::new(0.3, 0.6, 0.3), 1);
    let mut scene = matt([(
        shapes::quad(Vec3::new(-4.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 8.0, 1),
        FLOOR,
    )]);
    for (x, albedo) in [(at, Vec3::new(0.9, 0.1, 0.1)), (3.0, Vec3::splat(0.3))] {
        let mesh = scene.add_mesh(block());
        let material = scene.add_material(Material::matt("block", albedo));
        scene.add_instance("block", mesh, material, Mat4::from_translation(Vec3::X * x));
    }
    scene
}

/// The same meshes, with the block elsewhere.
fn with_block_at(scene: &Scene, at: f32) -> Scene {
    Scene {
        instances: blocks(at).instances,
        ..scene.clone()
    }
}

#[test]
fn what_moves_changes_what_is_near_and_nothing_else() {
    let Some(gpu) = test_gpu() else { return };
    // The texels are the same wherever the block stands.
    let atlas = AtlasOptions {
        size: 64,
        ..Default::default()
    };
    for mode in [Mode::Rays, Mode::Peeling] {
        let settings = Settings {
            directions: 64,
            ..settings(mode, 0.5, Falloff::Sqrt)
        };
        let options = AtlasCaptureOptions::default();
        let bench = |at| Bench::new(&gpu, blocks(at), &atlas, &options, &settings).unwrap();
        let mut moving = bench(-2.0);
        let before = moving.finish(&gpu);
        let before = moving.found(&gpu, &before);
        let after = with_block_at(&moving.scene, -1.5);
        moving.follow(&gpu, after);
        moving.step(&gpu);
        let region = moving.obscurances.region().unwrap();
        assert!(region.max.x < -0.5 && region.min.x > -3.0, "{region:?}");
        let after = moving.finish(&gpu);
        assert!(
            after == bench(-1.5).finish(&gpu),
            "{mode:?}: not as if computed at once"
        );
        let found = moving.found(&gpu, &after);
        let pairs = before.iter().zip(&found);
        let differ = pairs.filter(|(before, after)| before.plain != after.plain);
        let differ: Vec<_> = differ.map(|(_, after)| after.position.as_vec3()).collect();
        println!(
            "{mode:?}: {} of {} texels changed",
            differ.len(),
            found.len()
        );
        assert!(differ.len() > 50 && differ.len() < found.len() / 2);
        let is_near = |at: &Vec3| at.cmpge(region.min).all() && at.cmple(region.max).all();
        assert!(differ.iter().all(is_near), "{mode:?}");
        // Nothing moved.
        let same = moving.scene.clone();
        moving.follow(&gpu, same);
        assert!(moving.obscurances.is_done());
        // When interrupted, earlier work is finished, too.
        let after = with_block_at(&moving.scene, -2.0);
        moving.follow(&gpu, after);
        moving.step(&gpu);
        let after = with_block_at(&moving.scene, 0.5);
        moving.follow(&gpu, after);
        let after = moving.finish(&gpu);
        let at_once = bench(0.5).finish(&gpu);
        let differ = after.iter().zip(&at_once).filter(|(a, b)| a != b).count();
        // A hierarchy that was refitted decides ties elsewhere, on one GPU for one texel.
        let is_software = gpu.adapter.is_software();
        let most = if is_software { 0 } else { 1 };
        assert!(
            differ <= most,
            "{mode:?}: interrupted, {differ} words differ"
        );
    }
}

#[test]
fn pieces_and_pages_make_no_difference() {
    let Some(gpu) = test_gpu() else { return };
    let block = shapes::cuboid(Vec3::splat(-0.3), Vec3::splat(0.3), 1);
    let scene = matt([0.0, 0.7, 1.5, 2.2].map(|x| {
        let at = Mat4::from_translation(Vec3::X * x);
        (shapes::transformed(block.clone(), &at), FLOOR)
    }));
    let atlas = AtlasOptions {
        size: 48,
        density: TexelDensity::PerMetre(15.0),
        gutter: 1,
        ..Default::default()
    };
    for mode in [Mode::Rays, Mode::Peeling] {
        let settings = Settings {
            directions: 16,
            ..settings(mode, 0.5, Falloff::Linear)
        };
        let of = |most_texels| {
            let options = AtlasCaptureOptions {
                most_texels,
                ..Default::default()
            };
            let mut bench = Bench::new(&gpu, scene.clone(), &atlas, &options, &settings).unwrap();
            (bench.finish(&gpu), bench.capture.pieces().len())
        };
        let (whole, pieces) = of(u32::MAX);
        assert!(whole.len() > 1 && pieces == 1);
        let (parts, pieces) = of(48 * 5);
        assert!(pieces > 6 && whole == parts);
    }
}

#[test]
fn light_passes_glass_and_leaves_gaps_open() {
    let Some(gpu) = test_gpu() else { return };
    // A sheet above a floor: opaque, of glass, half transparent.
    let of = |mode, change: fn(&mut Material)| {
        let floor = shapes::quad(Vec3::ZERO, Vec3::Z, Vec3::X, 1);
        let mut scene = matt([(floor, FLOOR)]);
        let sheet = shapes::quad(Vec3::new(-1.0, 0.1, -1.0), Vec3::Z * 3.0, Vec3::X * 3.0, 1);
        let mesh = scene.add_mesh(sheet);
        let mut material = Material::matt("sheet", FLOOR);
        change(&mut material);
        let material = scene.add_material(material);
        scene.add_instance("sheet", mesh, material, Mat4::IDENTITY);
        let settings = Settings {
            directions: 128,
            ..settings(mode, 10.0, Falloff::Step)
        };
        let all = found(&gpu, &scene, 32, &settings);
        let floor: Vec<_> = all.iter().filter(|texel| texel.instance == 0).collect();
        floor.iter().map(|texel| texel.plain).sum::<f64>() / floor.len() as f64
    };
    for mode in [Mode::Rays, Mode::Peeling] {
        let opaque = of(mode, |_| {});
        let glass = of(mode, |material| material.transmission = 1.0);
        let half = of(mode, |material| {
            material.alpha_mode = gpugi_scene::AlphaMode::Blend;
            material.base_color.w = 0.5;
        });
        println!("{mode:?}: opaque {opaque:.3}, glass {glass:.3}, half {half:.3}");
        assert!(opaque < 0.05, "{mode:?}: {opaque}");
        assert!(glass > 0.94, "{mode:?}: {glass}");
        assert!((half - 0.5).abs() < 0.05, "{mode:?}: {half}");
    }
}

#[test]
fn texels_without_samples_continue_their_neighbours() {
    let Some(gpu) = test_gpu() else { return };
    let settings = settings(Mode::Rays, 0.1, Falloff::Step);
    let scene = matt([(shapes::quad(Vec3::ZERO, Vec3::Z, Vec3::X, 1), FLOOR)]);
    let atlas = AtlasOptions {
        size: 32,
        ..Default::default()
    };
    let options = AtlasCaptureOptions::default();
    let mut bench = Bench::new(&gpu, scene, &atlas, &options, &settings).unwrap();
    let pages = bench.finish(&gpu);
    assert!(pages[0].obscurance.iter().all(|&w| w == 1.0));
    let mut frame = crate::gpu::Frame::new(&gpu, false);
    bench.obscurances.record_maps(&mut frame).unwrap();
    frame.submit().unwrap();
    let maps = bench.obscurances.maps();
    assert_eq!(maps[0].name, "obscurances.0");
    let all = wgpu::TextureAspect::All;
    let halves: Vec<[u16; 4]> =
        crate::gpu::read_texture(&gpu, maps[0].texture().unwrap(), all, 0, 0).unwrap();
    let [half, one] = [0x3800, 0x3c00];
    for [r, g, b, w] in halves {
        assert_eq!(w, one);
        assert!(
            [r, g, b].iter().all(|value| value.abs_diff(half) < 3),
            "{r:x}"
        );
    }
}

#[test]
fn impossible_settings_and_scenes_are_refused_or_empty() {
    let Some(gpu) = test_gpu() else { return };
    let scene = floor_and_wall();
    let options = AtlasOptions {
        size: 16,
        ..Default::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    let rays = GpuScene::with_rays(&gpu, &scene).unwrap();
    let capture = AtlasCapture::new(&gpu, &scene, &rays, &atlas, &Default::default()).unwrap();
    let refused = |settings: &Settings| {
        let made = Solution::new(&gpu, &scene, &rays, &atlas, &capture, settings);
        match made {
            Err(GpuError::Pass { reason, .. }) => reason,
            other => panic!("{other:?}"),
        }
    };
    for distance in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let reason = refused(&settings(Mode::Rays, distance, Falloff::Sqrt));
        assert!(reason.contains("distance"), "{reason}");
        let mut settings = Settings::default();
        let text = distance.to_string();
        assert!(matches!(
            settings.set("distance", &text),
            Err(SettingError::Value { .. })
        ));
    }
    let none = Settings {
        directions: 0,
        ..Default::default()
    };
    assert!(refused(&none).contains("directions"));
    assert!(refused(&peeling(1.0, Falloff::Sqrt)).contains("captures"));
    let mut words = Settings::default();
    assert!(words.set("mode", "guessing").is_err());
    assert!(words.set("reach", "1").is_err());
    for (name, value) in [
        ("mode", "peeling"),
        ("falloff", "step"),
        ("colored", "false"),
    ] {
        words.set(name, value).unwrap();
    }
    assert_eq!(
        (words.mode, words.falloff, words.colored),
        (Mode::Peeling, Falloff::Step, false)
    );
    let fewer = {
        let mut scene = scene.clone();
        scene.instances.pop();
        scene
    };
    let settings = Settings::default();
    let made = Solution::new(&gpu, &fewer, &rays, &atlas, &capture, &settings);
    assert!(made.is_err());

    for mode in [Mode::Rays, Mode::Peeling] {
        let settings = Settings {
            mode,
            ..Default::default()
        };
        for scene in [Scene::new("empty"), matt([(Default::default(), FLOOR)])] {
            let capture = AtlasCaptureOptions::default();
            let mut bench = Bench::new(&gpu, scene, &options, &capture, &settings).unwrap();
            assert!(bench.finish(&gpu).is_empty());
        }
    }
}

#[test]
fn without_colors_there_are_none() {
    let Some(gpu) = test_gpu() else { return };
    for mode in [Mode::Rays, Mode::Peeling] {
        let colored = Settings {
            directions: 16,
            ..settings(mode, 1.0, Falloff::Step)
        };
        let plain = Settings {
            colored: false,
            ..colored.clone()
        };
        let atlas = AtlasOptions {
            size: 32,
            ..Default::default()
        };
        let pages = [colored, plain].map(|settings| {
            let capture = AtlasCaptureOptions::default();
            let mut bench = Bench::new(&gpu, corner(), &atlas, &capture, &settings).unwrap();
            bench.finish(&gpu)
        });
        assert!(pages[1][0].colored.is_none());
        assert_eq!(pages[0][0].obscurance, pages[1][0].obscurance);
    }
}
