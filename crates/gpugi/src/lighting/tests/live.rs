//! Frames of live views, which wait for nothing.

use super::*;
use crate::techniques::Registry;

/// Settings with little work.
const FEW: [(&str, &str); 14] = [
    ("bounces", "1"),
    ("clusters", "8"),
    ("cube-resolution", "16"),
    ("directions", "16"),
    ("entries", "64"),
    ("frames", "1"),
    ("iterations", "2"),
    ("order", "2"),
    ("particles", "16"),
    ("rays", "16"),
    ("resolution", "32"),
    ("samples", "8"),
    ("shape-resolution", "16"),
    ("walks", "1"),
];

/// The lamp and a ball move; the sky turns and becomes brighter.
fn disturb(scene: &mut Scene) {
    let step = Mat4::from_translation(Vec3::X * 0.01);
    let lamp = &mut scene.lights[0].world_from_light;
    *lamp = step * *lamp;
    let ball = &mut scene.instances[1].world_from_mesh;
    *ball = step * *ball;
    let sky = scene.environment.as_mut().unwrap();
    sky.rotation *= glam::Quat::from_rotation_y(0.1);
    if let Pixels::Rgba32Float(texels) = &mut Arc::make_mut(&mut sky.image).pixels {
        texels.iter_mut().for_each(|value| *value *= 1.01);
    }
}

/// Without a budget, frames that never wait have light all the same; with one, no frame waits for its light.
#[test]
fn no_technique_waits_in_a_live_frame() {
    let Some(gpu) = test_gpu() else { return };
    for technique in Registry::default().all() {
        let name = technique.info.name;
        let mut scene = balls();
        let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &[name]).unwrap();
        for (setting, value) in FEW {
            // No technique has all of them.
            let _ = renderer.set(name, setting, value);
        }
        for budget in [Budget::UNLIMITED, Budget::units(100_000)] {
            renderer.set_budget(budget);
            let all = |_, _| ControlFlow::Continue(());
            renderer.converge(&camera(), false, all).unwrap();
            while renderer.is_compiling() {
                std::thread::yield_now();
            }
            let waits = renderer.waits();
            assert_ne!(waits, 0, "convergence waits");
            for _ in 0..3 {
                disturb(&mut scene);
                renderer.update(&scene).unwrap();
                if budget == Budget::UNLIMITED {
                    let frame = renderer.try_render_sample(&camera(), 1, None, false);
                    let (readiness, _) = frame.unwrap();
                    assert!(readiness.is_usable(), "{name}: {readiness:?}");
                } else {
                    renderer.render_sample(&camera(), 1, None, false).unwrap();
                }
            }
            assert_eq!(renderer.waits(), waits, "{name}");
        }
    }
}
