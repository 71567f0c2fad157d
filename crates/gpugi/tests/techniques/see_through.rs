//! Light that passes see-through surfaces, against the path tracer and in closed form.

use std::sync::Arc;

use crate::common::{floor, from_above, gpu, lit_by, measured, picture, place, renderer_of};
use glam::{Vec3, Vec4, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{
    AlphaMode, Environment, Image, Light, LightKind, Material, Pixels, Scene, Texture, TextureRef,
    Volume, Wrap,
};

/// Clear thin glass of one colour.
fn pane(color: Vec3) -> Material {
    Material {
        name: "pane".into(),
        base_color: color.extend(1.0),
        transmission: 1.0,
        roughness: 0.0,
        ..Material::default()
    }
}

/// A texture of 2 x 2 colours.
fn colors(scene: &mut Scene, texels: [[u8; 4]; 4]) -> TextureRef {
    scene.images.push(Arc::new(Image {
        name: "colours".into(),
        width: 2,
        height: 2,
        pixels: Pixels::Rgba8(texels.concat()),
    }));
    scene.textures.push(Texture {
        image: scene.images.len() - 1,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: false,
    });
    TextureRef::new(scene.textures.len() - 1)
}

/// Stained glass with a corner of wood.
fn stained(scene: &mut Scene) -> Material {
    let base = [
        [255, 60, 40, 255],
        [40, 90, 255, 255],
        [120, 255, 60, 255],
        [200, 150, 90, 255],
    ];
    let clear = [[255; 4], [255; 4], [255; 4], [0, 0, 0, 255]];
    Material {
        base_color_texture: Some(colors(scene, base)),
        transmission_texture: Some(colors(scene, clear)),
        ..pane(Vec3::ONE)
    }
}

/// A horizontal square around the y axis with sides of `side` (m).
fn sheet(scene: &mut Scene, height: f32, side: f32, material: Material) {
    let corner = vec3(-side / 2.0, height, side / 2.0);
    let mesh = quad(corner, Vec3::X * side, Vec3::NEG_Z * side, 1);
    place(scene, mesh, material);
}

fn sky(radiance: Vec3) -> Environment {
    let texel = [radiance.x, radiance.y, radiance.z, 1.0];
    Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width: 64,
            height: 32,
            pixels: Pixels::Rgba32Float(texel.repeat(64 * 32)),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

fn sun() -> Light {
    Light::new("sun", LightKind::Directional, Vec3::splat(2.0)).aimed(Vec3::Y, Vec3::ZERO)
}

/// Radiance of the floor of albedo 0.5 under [`sun`].
const FULL: f32 = 0.5 * 2.0 / std::f32::consts::PI;

/// Asserts that a square of the floor with sides of `side` (m) gets the path tracer's light in each channel.
fn assert_energies(gpu: &Gpu, (light, scene, technique): Lit, side: f32, what: &str) {
    let of_lamps = ["per-sample=true", "resolution=256"];
    let of_area = ["area-samples=8", "area-resolution=64"];
    let of_sky = ["per-sample=true", "resolution=128"];
    let settings: &[&str] = match technique {
        "shadow-map" => &[of_lamps, of_area].concat(),
        _ => &of_sky,
    };
    let mut renderer = renderer_of(gpu, &scene, &[technique], 16, technique, settings);
    let camera = from_above(side, 0.9);
    let found = measured(gpu, &scene, &camera, &mut renderer, [16, 256]);
    let energy = |radiance: &[f32], channel: usize| -> f32 {
        radiance.iter().skip(channel).step_by(3).sum()
    };
    let ratios = [0, 1, 2]
        .map(|channel| energy(&found.radiance, channel) / energy(&found.truth.radiance, channel));
    println!("{light} through {what}: {ratios:.3?} of the path tracer's light");
    for ratio in ratios {
        assert!((ratio - 1.0).abs() < 0.05, "{light}, {what}: {ratios:?}");
    }
}

/// A light, a scene with it, and the technique that adds it.
type Lit = (&'static str, Scene, &'static str);

/// The scene under lights of all kinds, one at a time.
fn under_each_light(scene: &Scene) -> Vec<Lit> {
    let cone = LightKind::Spot {
        inner_cone_angle: 0.3,
        outer_cone_angle: 0.5,
    };
    let above =
        |kind| Light::new("", kind, Vec3::splat(5.0)).aimed(vec3(0.2, 2.5, 0.1), Vec3::ZERO);
    let lamp = {
        let mut scene = scene.clone();
        let lamp = quad(vec3(-0.4, 2.5, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8, 1);
        place(
            &mut scene,
            lamp,
            Material::emitter("lamp", Vec3::splat(8.0)),
        );
        scene
    };
    let mut outdoors = scene.clone();
    outdoors.environment = Some(sky(vec3(0.8, 1.0, 1.2)));
    vec![
        (
            "point",
            lit_by(scene.clone(), above(LightKind::Point)),
            "shadow-map",
        ),
        ("spot", lit_by(scene.clone(), above(cone)), "shadow-map"),
        (
            "sun",
            lit_by(scene.clone(), above(LightKind::Directional)),
            "shadow-map",
        ),
        ("lamp", lamp, "shadow-map"),
        ("sky", outdoors, "image-based-lighting"),
    ]
}

#[test]
fn stained_glass_tints_every_light_as_the_path_tracer_does() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    let material = stained(&mut scene);
    sheet(&mut scene, 1.0, 1.6, material);
    for lit in under_each_light(&scene) {
        assert_energies(&gpu, lit, 1.6, "stained glass");
    }
}

#[test]
fn blended_sheets_hide_their_coverage() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    let texels = [
        [255, 0, 0, 64],
        [255, 0, 0, 255],
        [0, 0, 255, 0],
        [0, 255, 0, 128],
    ];
    let material = Material {
        base_color_texture: Some(colors(&mut scene, texels)),
        alpha_mode: AlphaMode::Blend,
        ..Material::matt("sheet", Vec3::ONE)
    };
    sheet(&mut scene, 1.0, 1.6, material);
    for lit in under_each_light(&scene) {
        assert_energies(&gpu, lit, 1.6, "a blended sheet");
    }
}

/// Every pixel, not only the mean.
#[test]
fn sheets_multiply_and_tint_only_what_lies_behind_them() {
    let Some(gpu) = gpu() else { return };
    let red = vec3(0.8, 0.4, 0.2);
    let grey = Vec4::new(1.0, 1.0, 1.0, 0.25);
    let mut scene = lit_by(floor(2.0), sun());
    sheet(&mut scene, 1.0, 3.0, pane(red));
    let blended = Material {
        base_color: grey,
        alpha_mode: AlphaMode::Blend,
        ..Material::matt("blended", Vec3::ONE)
    };
    sheet(&mut scene, 0.7, 3.0, blended);
    // Plates above and between the two.
    for (height, half) in [(1.3, 0.1), (0.85, 0.25)] {
        let white = Material::matt("white", Vec3::splat(0.5));
        let min = vec3(-half, height - 0.01, -half);
        place(&mut scene, cuboid(min, vec3(half, height, half), 1), white);
    }
    let through = red * 0.96;
    // Of each surface, what lies outside the shadow of the plate above.
    for (eye, height, shadow, expected) in [
        (1.4, 1.3, 0.0, Vec3::ONE),
        (0.95, 0.85, 0.15, through),
        (0.65, 0.0, 0.3, 0.75 * through),
    ] {
        let mut renderer = renderer_of(&gpu, &scene, &["shadow-map"], 64, "", &[]);
        let picture = picture(&mut renderer, &from_above(1.6, eye));
        let points: Vec<_> = picture
            .lit()
            .filter(|lit| (lit.position.y - height).abs() < 1e-3)
            .filter(|lit| lit.position.x.abs().max(lit.position.z.abs()) > shadow)
            .collect();
        assert!(points.len() > 10, "{} points", points.len());
        for lit in points {
            let error = (lit.radiance / FULL - expected).abs().max_element();
            assert!(error < 0.01, "{lit:?}, not {expected} of {FULL}");
        }
    }
}

/// Solid glass without caustics: straight light, absorbed on its way through.
#[test]
fn solids_without_caustics_pass_straight_tinted_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    // So wide that light which its sides reflect arrives elsewhere.
    let block = cuboid(vec3(-3.0, 1.0, -3.0), vec3(3.0, 1.1, 3.0), 1);
    let glass = Material {
        ior: 1.5,
        volume: Some(Volume {
            attenuation_distance: 0.1,
            attenuation_color: vec3(0.3, 0.9, 0.5),
        }),
        ..pane(Vec3::ONE)
    };
    place(&mut scene, block, glass);
    // Under a sky it absorbs too much.
    let mut lamps = under_each_light(&scene);
    lamps.retain(|lamp| lamp.0 != "sky");
    for lit in lamps {
        assert_energies(&gpu, lit, 0.6, "a block of glass");
    }
}

/// A pane whose light caustics brings casts a whole shadow, and a tinted one again when caustics leaves it alone.
#[test]
fn claimed_panes_cast_whole_shadows() {
    let Some(gpu) = gpu() else { return };
    let mut scene = lit_by(floor(2.0), sun());
    let tint = vec3(0.8, 0.4, 0.2);
    sheet(&mut scene, 1.0, 3.0, pane(tint));
    let mirror = Material {
        metallic: 1.0,
        roughness: 0.0,
        ..Material::default()
    };
    let ball = vec3(5.0, 0.5, 0.0);
    let index = place(&mut scene, cuboid(ball, ball + 0.1, 1), mirror);
    scene.instances[index].name = "mirror".into();
    let names = ["shadow-map", "caustics"];
    let mut renderer = renderer_of(&gpu, &scene, &names, 16, "", &[]);
    let camera = from_above(0.5, 0.9);
    // Light paths overlap on other objects alone.
    let light = |renderer: &mut Renderer, objects: &str| {
        renderer.set("caustics", "objects", objects).unwrap();
        let lit = picture(renderer, &camera);
        lit.lit().map(|lit| lit.radiance / FULL).sum::<Vec3>() / lit.lit().count() as f32
    };
    let tinted = light(&mut renderer, "mirror");
    assert!(
        (tinted - 0.96 * tint).abs().max_element() < 0.01,
        "{tinted}"
    );
    let with_caustic = light(&mut renderer, "auto");
    let mut alone = renderer_of(&gpu, &scene, &["caustics"], 16, "", &[]);
    let caustic = light(&mut alone, "auto");
    assert!(
        (with_caustic - caustic).abs().max_element() < 0.01,
        "{with_caustic}, {caustic}"
    );
    assert_eq!(light(&mut renderer, "mirror"), tinted);
}
