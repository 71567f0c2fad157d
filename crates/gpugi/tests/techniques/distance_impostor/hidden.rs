//! Objects whose reference point, or whose centre, does not see everything: a mirror beside a box, and a teapot of
//! glass. No one-layer map shows them correctly; classical environment mapping is at least four times as far from the
//! truth.

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Camera, Scene};

use super::scenes::{add, glass, rel_mse, set, shining_room};
use crate::common::{gpu, measured, picture};

const SIZE: u32 = 48;
const SAMPLES: u32 = 8;

/// rel-mse over an instance's pixels, with the settings as they are and with classical environment mapping, both
/// against the truth of the former.
fn errors(gpu: &Gpu, scene: &Scene, camera: &Camera, name: &str) -> [f64; 2] {
    let techniques = ["shadow-map", "distance-impostor"].map(str::to_owned);
    let mut renderer = Renderer::new(gpu, scene, [SIZE; 2], &techniques).expect("a renderer");
    for side in ["resolution", "shape-resolution"] {
        set(&mut renderer, (side, "64"));
    }
    let found = measured(gpu, scene, camera, &mut renderer, [SAMPLES, 64]);
    for setting in [("search", "none"), ("bounces", "0")] {
        set(&mut renderer, setting);
    }
    renderer.restart();
    for _ in 0..SAMPLES {
        let rendered = renderer.render_sample(camera, SAMPLES, None, false);
        rendered.expect("a picture");
    }
    let classical = renderer.radiance().expect("radiance");
    let seen = picture(&mut renderer, camera);
    let is_own: Vec<bool> = (seen.points.iter())
        .map(|point| {
            point.is_some_and(|point| scene.instances[point.instance as usize].name == name)
        })
        .collect();
    assert!(
        is_own.iter().filter(|own| **own).count() > 300,
        "{name} is in view"
    );
    let own = |radiance: &[f32]| -> Vec<f32> {
        let pixels = radiance.as_chunks::<3>().0.iter().zip(&is_own);
        pixels
            .filter(|(_, own)| **own)
            .flat_map(|(pixel, _)| *pixel)
            .collect()
    };
    let truth = own(&found.truth.radiance);
    [&found.radiance, &classical].map(|radiance| rel_mse(&own(radiance), &truth))
}

/// The tutorial's figure 34: the box hides part of the room from the ball's centre.
#[test]
fn a_mirror_beside_a_box() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("room", 1).expect("a scene");
    let at = vec3(-0.6, 0.6, -0.3);
    let camera = Camera::look_at("", vec3(0.1, 1.2, 1.4), at, 0.7);
    let [found, classical] = errors(&gpu, &scene, &camera, "sphere");
    println!("mirror beside a box: rel-mse {found:.1e}, classical {classical:.1e}");
    assert!(found < 0.006, "{found}");
    assert!(classical > 4.0 * found, "{classical}");
}

#[test]
fn a_teapot_of_glass() {
    let Some(gpu) = gpu() else { return };
    let room = builtin("glass-room", 1).expect("a scene");
    let teapot = room.meshes.iter().find(|mesh| mesh.name == "solid teapot");
    let teapot = teapot.expect("a teapot").clone();
    assert!(teapot.is_closed());
    for (ior, bound) in [(1.1, 0.08), (1.5, 0.25)] {
        let mut scene = shining_room();
        let index = add(&mut scene, "teapot", teapot.clone(), glass(ior), Vec3::ZERO);
        scene.instances[index].world_from_mesh = Mat4::from_translation(vec3(0.3, -0.6, -0.4))
            * Mat4::from_rotation_y(-0.5)
            * Mat4::from_scale(Vec3::splat(2.5));
        let camera = Camera::look_at("", vec3(0.5, 0.3, 1.4), vec3(0.35, -0.25, -0.4), 0.8);
        let [found, classical] = errors(&gpu, &scene, &camera, "teapot");
        println!("teapot of index {ior}: rel-mse {found:.1e}, classical {classical:.1e}");
        assert!(found < bound, "index {ior}: {found}");
        assert!(classical > 4.0 * found, "index {ior}: {found}, {classical}");
    }
}
