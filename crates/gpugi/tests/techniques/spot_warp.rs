//! Warping a spot light's depth view: the shadows are the same, and sharper where the camera looks.

use glam::Vec3;
use gpugi::Renderer;
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Camera, Light, LightKind, Material};

#[test]
fn a_warped_map_comes_nearer_to_a_large_one() {
    let Some(gpu) = crate::common::gpu() else {
        return;
    };
    let mut scene = crate::common::floor(20.0);
    for post in 0..10 {
        let (x, z) = (post as f32 * 1.3 - 6.0, 16.0 - post as f32 * 3.4);
        let mesh = cuboid(
            Vec3::new(x - 0.15, 0.0, z - 0.15),
            Vec3::new(x + 0.15, 1.5, z + 0.15),
            1,
        );
        crate::common::place(&mut scene, mesh, Material::matt("post", Vec3::splat(0.5)));
    }
    let cone = LightKind::Spot {
        inner_cone_angle: 0.7,
        outer_cone_angle: 0.75,
    };
    scene.lights.push(
        Light::new("spot", cone, Vec3::splat(900.0))
            .aimed(Vec3::new(6.0, 30.0, 1.0), Vec3::new(0.0, 0.0, 0.0)),
    );
    let camera = Camera::look_at("", Vec3::new(0.0, 2.0, 19.0), Vec3::new(0.0, 0.5, 0.0), 0.8);
    let render = |resolution: &str, warp: &str| -> Vec<f32> {
        let mut renderer =
            Renderer::new(&gpu, &scene, [128, 96], &["shadow-map"]).expect("a renderer");
        for (name, value) in [
            ("resolution", resolution),
            ("warp", warp),
            ("filter", "none"),
        ] {
            renderer.set("shadow-map", name, value).expect("a setting");
        }
        renderer
            .render_sample(&camera, 1, None, false)
            .expect("a frame");
        renderer.radiance().expect("radiance")
    };
    let truth = render("4096", "false");
    let error = |picture: Vec<f32>| -> f32 {
        picture
            .iter()
            .zip(&truth)
            .map(|(a, b)| (a - b).abs())
            .sum::<f32>()
            / truth.iter().sum::<f32>()
    };
    let (plain, warped) = (error(render("96", "false")), error(render("96", "true")));
    println!("mean difference from a 4096 map: plain {plain:.4}, warped {warped:.4}");
    assert!(plain > 1e-3, "the scene is no test: {plain}");
    assert!(warped < 0.75 * plain, "plain {plain}, warped {warped}");
}
