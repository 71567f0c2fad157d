//! Tests of the ambient term.

use crate::capture::Receiver;
use glam::{Mat4, Vec2, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{AlphaMode, Camera, Light, LightKind, Material, Scene};

use super::super::Obscurances;
use super::scenes::{hollow_sphere, matt};
use crate::capture::{Capture, CaptureKernels, Emission, Target, View};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::scene::GpuScene;
use crate::techniques::shadow_map::ShadowMap;
use crate::techniques::{Earlier, EarlierLight, Shared, Technique};
use crate::testing::{settled, test_gpu};
use crate::{LightingError, Renderer};

/// The image from inside a scene, after all steps.
fn radiance(
    gpu: &Gpu,
    scene: &Scene,
    techniques: &[&str],
    settings: &[(&str, &str)],
) -> Result<Vec<f32>, LightingError> {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [16; 2], &names)?;
    for (name, value) in settings {
        renderer.set("obscurances", name, value)?;
    }
    rendered(&mut renderer)
}

fn rendered(renderer: &mut Renderer) -> Result<Vec<f32>, LightingError> {
    let camera = Camera::look_at("", Vec3::Z * 0.3, Vec3::X, 1.2);
    renderer.render_sample(&camera, 1, None, false)?;
    Ok(renderer.radiance()?)
}

#[test]
fn who_asks_for_ambient_light_in_the_open_is_warned() {
    let Some(gpu) = test_gpu() else { return };
    let mut open = matt([(shapes::sphere(1.0, 16), Vec3::splat(0.5))]);
    open.lights = lit_ball(Vec3::ONE).lights;
    let names = ["shadow-map", "obscurances"].map(str::to_owned);
    for (scene, is_open) in [(lit_ball(Vec3::splat(0.5)), false), (open, true)] {
        let mut renderer = Renderer::new(&gpu, &scene, [8; 2], &names).unwrap();
        renderer.set("obscurances", "resolution", "32").unwrap();
        rendered(&mut renderer).unwrap();
        assert!(renderer.warnings().is_empty());
        renderer.set("obscurances", "ambient", "plain").unwrap();
        rendered(&mut renderer).unwrap();
        gpu.wait().unwrap();
        let warnings = renderer.warnings();
        assert_eq!(warnings.len(), usize::from(is_open), "{warnings:?}");
        assert!(
            warnings.iter().all(|warning| warning.contains("100 %")),
            "{warnings:?}"
        );
    }
}

/// A ball seen from inside, with a lamp at its centre.
fn lit_ball(albedo: Vec3) -> Scene {
    let mut scene = matt([(hollow_sphere(1.0, 32), albedo)]);
    let light = Light::new("lamp", LightKind::Point, Vec3::splat(2.0));
    scene.lights.push(light.aimed(Vec3::ZERO, Vec3::X));
    scene
}

const SETTINGS: [(&str, &str); 3] = [("resolution", "64"), ("directions", "16"), ("steps", "16")];

#[test]
fn in_an_even_room_ambient_light_is_the_sum_of_all_bounces() {
    let Some(gpu) = test_gpu() else { return };
    let albedo = Vec3::new(0.8, 0.5, 0.2);
    let scene = lit_ball(albedo);
    let direct = radiance(&gpu, &scene, &["shadow-map"], &[]).unwrap();
    // Nothing is near, so W = 1: L = a / pi R E / (1 - R), and L_direct = a E / pi.
    for (ambient, mode) in [("plain", "rays"), ("colored", "rays"), ("plain", "peeling")] {
        let settings = [("ambient", ambient), ("distance", "0.001"), ("mode", mode)];
        let settings = [&settings[..], &SETTINGS].concat();
        let all = radiance(&gpu, &scene, &["shadow-map", "obscurances"], &settings).unwrap();
        for (index, (all, direct)) in all.iter().zip(&direct).enumerate() {
            let albedo = albedo[index % 3];
            let wanted = 1.0 / (1.0 - albedo);
            assert!(
                (all / direct / wanted - 1.0).abs() < 0.05,
                "{ambient}: {all}, {direct} {wanted}"
            );
        }
    }
}

#[test]
fn ambient_light_is_obscured_and_off_unless_asked_for() {
    let Some(gpu) = test_gpu() else { return };
    let scene = lit_ball(Vec3::splat(0.5));
    let both = ["shadow-map", "obscurances"];
    let direct = radiance(&gpu, &scene, &["shadow-map"], &[]).unwrap();
    assert_eq!(radiance(&gpu, &scene, &both, &SETTINGS).unwrap(), direct);
    let of = |distance| {
        let settings = [("ambient", "plain"), ("distance", distance)];
        let all = radiance(&gpu, &scene, &both, &[&settings[..], &SETTINGS].concat()).unwrap();
        let added = all.iter().zip(&direct).map(|(all, direct)| all - direct);
        added.sum::<f32>()
    };
    // The same W as in the test inside a sphere.
    let share = of("2.5") / of("0.001");
    let known = 0.8 * (2.0_f32 / 2.5).sqrt();
    assert!((share - known).abs() < 0.03, "{share}, not {known}");
}

#[test]
fn nothing_obscures_constant_ambient_light() {
    let Some(gpu) = test_gpu() else { return };
    let scene = lit_ball(Vec3::splat(0.5));
    let direct = radiance(&gpu, &scene, &["shadow-map"], &[]).unwrap();
    let settings = [("ambient", "constant"), ("distance", "2.5")];
    let settings = [&settings[..], &SETTINGS].concat();
    let all = radiance(&gpu, &scene, &["shadow-map", "obscurances"], &settings).unwrap();
    // L = a / pi R E / (1 - R), and L_direct = a E / pi.
    for (all, direct) in all.iter().zip(&direct) {
        assert!((all / direct / 2.0 - 1.0).abs() < 0.05, "{all}, {direct}");
    }
}

#[test]
fn ambient_radiance_may_be_given() {
    let Some(gpu) = test_gpu() else { return };
    let albedo = Vec3::new(0.8, 0.5, 0.2);
    let mut scene = lit_ball(albedo);
    scene.lights.clear();
    // W inside a sphere is known.
    let obscured = 0.8 * (2.0_f32 / 2.5).sqrt();
    for (ambient, factor) in [("constant", 1.0), ("plain", obscured)] {
        let settings = [
            ("ambient", ambient),
            ("ambient-radiance", "0.7"),
            ("distance", "2.5"),
        ];
        let settings = [&settings[..], &SETTINGS].concat();
        let all = radiance(&gpu, &scene, &["obscurances"], &settings).unwrap();
        for (index, found) in all.iter().enumerate() {
            let wanted = 0.7 * factor * albedo[index % 3];
            let error = (found / wanted - 1.0).abs();
            assert!(error < 0.05, "{ambient}: {found}, not {wanted}");
        }
    }
}

#[test]
fn indirect_light_is_added_once() {
    let Some(gpu) = test_gpu() else { return };
    let scene = lit_ball(Vec3::splat(0.5));
    let all = ["shadow-map", "radiosity", "obscurances"];
    let refused = radiance(&gpu, &scene, &all, &[("ambient", "colored")]);
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .contains("choose one of them")
    );
    // As maps alone, obscurances combine with all techniques.
    let settings = [("resolution", "16"), ("directions", "1")];
    assert!(radiance(&gpu, &scene, &all, &settings).is_ok());
}

#[test]
fn scenes_without_surfaces_or_light_have_no_ambient_light() {
    let Some(gpu) = test_gpu() else { return };
    let black = matt([(shapes::quad(Vec3::ZERO, Vec3::Z, Vec3::X, 1), Vec3::ZERO)]);
    let mut white = lit_ball(Vec3::ONE);
    white.lights.clear();
    let mut behind = lit_ball(Vec3::ONE);
    behind.instances[0].world_from_mesh = Mat4::from_scale(Vec3::ZERO);
    for scene in [Scene::new("empty"), black, white, behind] {
        let settings = [&[("ambient", "colored")][..], &SETTINGS].concat();
        let all = radiance(&gpu, &scene, &["shadow-map", "obscurances"], &settings).unwrap();
        assert!(all.iter().all(|&value| value == 0.0), "{all:?}");
    }
}

#[test]
fn ambient_light_follows_what_moves() {
    let Some(gpu) = test_gpu() else { return };
    let scene = |x: f32| {
        let block = shapes::cuboid(Vec3::splat(-0.1), Vec3::splat(0.1), 1);
        let mut scene = lit_ball(Vec3::splat(0.5));
        let mesh = scene.add_mesh(block);
        let at = Mat4::from_translation(Vec3::new(0.7, x, 0.0));
        scene.add_instance("block", mesh, 0, at);
        scene
    };
    let names = ["shadow-map", "obscurances"].map(str::to_owned);
    for mode in ["rays", "peeling"] {
        let renderer = |scene: &Scene| {
            let mut renderer = Renderer::new(&gpu, scene, [16; 2], &names).unwrap();
            let settings = [("ambient", "plain"), ("distance", "0.3"), ("mode", mode)];
            for (name, value) in [&settings[..], &SETTINGS].concat() {
                renderer.set("obscurances", name, value).unwrap();
            }
            renderer
        };
        let (before, mut after) = (scene(-0.2), scene(0.2));
        after.meshes.clone_from(&before.meshes);
        let mut moving = renderer(&before);
        let first = rendered(&mut moving).unwrap();
        moving.update(&after).unwrap();
        let moved = rendered(&mut moving).unwrap();
        let fresh = rendered(&mut renderer(&after)).unwrap();
        let difference = |a: &[f32], b: &[f32]| {
            let pairs = a.iter().zip(b);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(difference(&moved, &fresh) < 1e-5, "{mode}");
        assert!(difference(&moved, &first) > 1e-2, "{mode}");
    }
}

#[test]
fn ambient_light_follows_materials() {
    let Some(gpu) = test_gpu() else { return };
    let scene = |change: fn(&mut Material)| {
        let sheet = shapes::quad(Vec3::new(0.5, -0.5, -0.5), Vec3::Y, Vec3::Z, 1);
        let mut scene = lit_ball(Vec3::splat(0.5));
        let mut material = Material::matt("sheet", Vec3::splat(0.7));
        change(&mut material);
        let (mesh, material) = (scene.add_mesh(sheet), scene.add_material(material));
        scene.add_instance("sheet", mesh, material, Mat4::IDENTITY);
        scene
    };
    let names = ["shadow-map", "obscurances"].map(str::to_owned);
    let renderer = |scene: &Scene| {
        let mut renderer = Renderer::new(&gpu, scene, [16; 2], &names).unwrap();
        let settings = [("ambient", "colored"), ("distance", "0.6")];
        for (name, value) in [&settings[..], &SETTINGS].concat() {
            renderer.set("obscurances", name, value).unwrap();
        }
        renderer
    };
    let changes: [fn(&mut Material); 4] = [
        |_| (),
        |material| material.base_color.x = 0.1,
        |material| material.transmission = 1.0,
        |material| {
            material.alpha_mode = AlphaMode::Mask { cutoff: 0.5 };
            material.base_color.w = 0.0;
        },
    ];
    let before = scene(changes[0]);
    let mut changing = renderer(&before);
    let mut was = rendered(&mut changing).unwrap();
    for change in &changes[1..] {
        let mut after = scene(*change);
        after.meshes.clone_from(&before.meshes);
        changing.update(&after).unwrap();
        let now = rendered(&mut changing).unwrap();
        let fresh = rendered(&mut renderer(&after)).unwrap();
        let most = |a: &[f32], b: &[f32]| {
            let pairs = a.iter().zip(b);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(most(&now, &fresh) < 1e-5);
        assert!(most(&now, &was) > 1e-2);
        was = now;
    }
}

/// The ambient term beside a lamp's light, at the pixels of a camera and at the texels themselves, with the atlas in
/// pieces of at most `most_texels` texels.
fn ambient_in_pieces(gpu: &Gpu, scene: &Scene, most_texels: Option<u32>) -> [Vec<f32>; 2] {
    let mut on_gpu = GpuScene::with_texels(gpu, scene).unwrap();
    let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
    let mut shared = Shared::new(gpu, &on_gpu, &kernels).unwrap();
    let mut emission = Emission::new(gpu, &on_gpu).unwrap();
    let mut earlier: Vec<Box<dyn Technique>> =
        vec![Box::new(ShadowMap::new(gpu, &on_gpu).unwrap())];
    let mut technique = Obscurances::default();
    technique.most_texels = most_texels;
    let settings = [("ambient", "colored"), ("distance", "0.5")];
    for (name, value) in [&settings[..], &SETTINGS].concat() {
        technique.settings_mut().set(name, value).unwrap();
    }
    let covered = earlier[0].plan(&on_gpu, &[], &[]).paths;
    technique.plan(&on_gpu, &covered, &[]);
    let camera = Camera::look_at("", Vec3::Z * 0.3, Vec3::X, 1.2);
    let mut capture = Capture::of_camera(gpu, &kernels, [16; 2]).unwrap();
    let view = View::new(&camera, [16; 2], Vec2::ZERO, 0, 0, on_gpu.diagonal());
    let mut frame = Frame::new(gpu, false);
    on_gpu.merge(&mut frame);
    capture
        .record(&mut frame, &on_gpu, &view, |draw| draw.seen)
        .unwrap();
    let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut []), &mut shared);
    earlier[0]
        .generate(&mut frame, &on_gpu, &view, &mut lit)
        .unwrap();
    let mut lit = Earlier::unlimited(EarlierLight::new(&mut emission, &mut earlier), &mut shared);
    let mut generate = || {
        let generated = technique.generate(&mut frame, &on_gpu, &view, &mut lit);
        settled(generated).unwrap().pending
    };
    assert!(generate().is_some(), "the atlas is laid out beside frames");
    on_gpu.wait_for_atlas();
    assert_eq!(generate(), None);
    let made = technique.maps.get().unwrap();
    let own: Vec<_> = made.capture.points().cloned().collect();
    assert_eq!(own.len() > 5, most_texels.is_some());
    let all = [vec![capture.points.clone()], own].map(|points| {
        let lit = points.into_iter().map(|points| {
            let target = Target::new(gpu, points.count).unwrap();
            frame.clear(&target.radiance);
            let receiver = Receiver::new(&points, &target);
            let gathered = technique.gather(&mut frame, &on_gpu, &receiver, &mut lit);
            gathered.unwrap();
            (target, points.count)
        });
        lit.collect::<Vec<_>>()
    });
    frame.submit().unwrap();
    all.map(|lit| {
        let read = |(target, count): &(Target, u32)| {
            let bytes = u64::from(*count) * 16;
            read_buffer::<[f32; 4]>(gpu, &target.radiance, bytes).unwrap()
        };
        let texels = lit.iter().flat_map(read);
        texels.flat_map(|[r, g, b, _]| [r, g, b]).collect()
    })
}

#[test]
fn pieces_make_no_difference_to_ambient_light() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = lit_ball(Vec3::new(0.8, 0.5, 0.2));
    let block = shapes::cuboid(Vec3::new(0.5, -0.2, -0.2), Vec3::new(0.8, 0.2, 0.2), 1);
    let mesh = scene.add_mesh(block);
    let material = scene.add_material(Material::matt("block", Vec3::new(0.1, 0.4, 0.9)));
    scene.add_instance("block", mesh, material, Mat4::IDENTITY);
    let whole = ambient_in_pieces(&gpu, &scene, None);
    let parts = ambient_in_pieces(&gpu, &scene, Some(64 * 9));
    for (whole, parts) in whole.iter().zip(&parts) {
        let sum: f32 = whole.iter().sum();
        assert!(sum > 0.01 * whole.len() as f32, "{sum}");
        assert_eq!(whole.len(), parts.len());
        for (index, (a, b)) in whole.iter().zip(parts).enumerate() {
            // Random decisions in the lamp's shadow differ from piece to piece.
            assert!(
                (a - b).abs() < 2e-3 * a.max(0.1),
                "{index}: {a}, in pieces {b}"
            );
        }
    }
}
