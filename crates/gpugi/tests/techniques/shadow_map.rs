//! shadow-map against analytic light and shadow: punctual lights, hard shadows, bias, cascades.

use std::f32::consts::PI;

use crate::common::{floor, from_above, gpu, lit_by, meets, picture, place, render, renderer};
use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Scene};

const GREY_BRDF: f32 = 0.5 / PI;

fn point_light(position: Vec3, intensity: f32) -> Light {
    Light::new("point", LightKind::Point, Vec3::splat(intensity)).aimed(position, Vec3::ZERO)
}

fn sun(from: Vec3, irradiance: f32) -> Light {
    Light::new("sun", LightKind::Directional, Vec3::splat(irradiance)).aimed(from, Vec3::ZERO)
}

fn spot(position: Vec3, target: Vec3, inner: f32, outer: f32, intensity: f32) -> Light {
    let kind = LightKind::Spot {
        inner_cone_angle: inner.to_radians(),
        outer_cone_angle: outer.to_radians(),
    };
    Light::new("spot", kind, Vec3::splat(intensity)).aimed(position, target)
}

/// Irradiance of an unshadowed punctual light, KHR_lights_punctual.
fn irradiance(light: &Light, position: Vec3, normal: Vec3) -> f32 {
    if light.kind == LightKind::Directional {
        return light.intensity.x * normal.dot(-light.direction()).max(0.0);
    }
    let toward = light.position() - position;
    let d2 = toward.length_squared();
    let mut value = light.intensity.x * normal.dot(toward.normalize()).max(0.0) / d2;
    if let Some(range) = light.range {
        value *= (1.0 - (d2 / (range * range)).powi(2)).clamp(0.0, 1.0);
    }
    if let LightKind::Spot {
        inner_cone_angle,
        outer_cone_angle,
    } = light.kind
    {
        let cosine = (-toward.normalize()).dot(light.direction());
        let cone =
            (cosine - outer_cone_angle.cos()) / (inner_cone_angle.cos() - outer_cone_angle.cos());
        value *= cone.clamp(0.0, 1.0).powi(2);
    }
    value
}

#[test]
fn unshadowed_light_is_analytic() {
    let Some(gpu) = gpu() else { return };
    let mut ranged = point_light(vec3(0.0, 2.0, 0.0), 10.0);
    ranged.range = Some(3.0);
    let lights = [
        point_light(vec3(0.5, 2.0, -0.3), 10.0),
        ranged,
        spot(vec3(1.0, 3.0, 0.0), vec3(0.2, 0.0, 0.1), 10.0, 25.0, 20.0),
        sun(vec3(1.0, 2.0, 0.5), 3.0),
    ];
    for light in lights {
        let scene = lit_by(floor(2.0), light.clone());
        let picture = render(&gpu, &scene, &from_above(3.8, 5.0), 64, &[]);
        let brightest = picture.lit().map(|lit| lit.radiance.x).fold(0.0, f32::max);
        assert_eq!(picture.lit().count(), 64 * 64, "{}", light.name);
        for lit in picture.lit() {
            let expected = GREY_BRDF * irradiance(&light, lit.position, Vec3::Y);
            let error = (lit.radiance.x - expected).abs();
            assert!(
                error <= 0.01 * expected + 1e-4 * brightest,
                "{}: {lit:?}, not {expected}",
                light.name
            );
        }
    }
}

#[test]
fn narrow_cones_keep_their_intensity() {
    let Some(gpu) = gpu() else { return };
    for (inner, outer) in [
        (0.5, 1.0),
        (0.0, 1.0),
        (1.0, 1.0),
        (0.05, 0.05),
        (20.0, 20.0),
    ] {
        let light = spot(vec3(0.0, 5.0, 0.0), Vec3::ZERO, inner, outer, 50.0);
        let scene = lit_by(floor(2.0), light);
        let picture = render(&gpu, &scene, &from_above(0.001, 2.0), 8, &[]);
        assert_eq!(picture.lit().count(), 8 * 8);
        for lit in picture.lit() {
            let irradiance = lit.radiance.x / GREY_BRDF;
            assert!(
                (irradiance - 2.0).abs() < 0.02,
                "{irradiance} between {inner} and {outer} degrees"
            );
        }
    }
}

#[test]
fn equal_angles_are_a_hard_edge() {
    let Some(gpu) = gpu() else { return };
    let light = spot(vec3(0.0, 3.0, 0.0), Vec3::ZERO, 20.0, 20.0, 20.0);
    let scene = lit_by(floor(2.0), light.clone());
    let picture = render(&gpu, &scene, &from_above(3.8, 5.0), 64, &[]);
    let bulb = Light {
        kind: LightKind::Point,
        ..light
    };
    for lit in picture.lit() {
        let angle = (lit.position.length() / 3.0).atan().to_degrees();
        let is_inside = angle < 20.0;
        let full = GREY_BRDF * irradiance(&bulb, lit.position, Vec3::Y);
        let expected = if is_inside { full } else { 0.0 };
        let error = (lit.radiance.x - expected).abs();
        assert!(
            (angle - 20.0).abs() < 0.01 || error < 0.01 * full,
            "{lit:?}"
        );
    }
}

#[test]
fn a_point_light_casts_shadows_to_all_six_sides() {
    let Some(gpu) = gpu() else { return };
    let light = point_light(vec3(0.05, -0.1, 0.02), 10.0);
    let eye = light.position();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut outward = Vec3::ZERO;
            outward[axis] = sign;
            let mut scene = Scene::new("closed room");
            // The room is closed and faces inward; a box stands in front of each side.
            let mut room = cuboid(Vec3::splat(-2.0), Vec3::splat(2.0), 1);
            room.indices
                .chunks_exact_mut(3)
                .for_each(|triangle| triangle.swap(1, 2));
            room.normals
                .iter_mut()
                .for_each(|normal| *normal = -*normal);
            place(&mut scene, room, Material::matt("grey", Vec3::splat(0.5)));
            let center = outward * 1.0;
            let (min, max) = (center - 0.3, center + 0.3);
            place(
                &mut scene,
                cuboid(min, max, 1),
                Material::matt("box", Vec3::splat(0.5)),
            );
            scene.lights.push(light.clone());
            // Looks past the box from beside it: the wall behind shows the box's shadow.
            let mut camera = Camera::look_at("", outward * 1.35, outward * 2.0, 2.4);
            camera.world_from_view.w_axis = (outward * 1.35).extend(1.0);
            for second_depth in [false, true] {
                let setting = format!("shadow-map.second-depth={second_depth}");
                let picture = render(
                    &gpu,
                    &scene,
                    &camera,
                    64,
                    &[&setting, "shadow-map.resolution=512"],
                );
                let (mut lit_count, mut dark_count) = (0, 0);
                for lit in picture.lit().filter(|lit| lit.instance == 0) {
                    let expected = GREY_BRDF * irradiance(&light, lit.position, lit.normal);
                    // Three texels at this distance, plus the reach of the filter.
                    let margin = 0.05;
                    let inner = meets(lit.position, eye, min + margin, max - margin);
                    let outer = meets(lit.position, eye, min - margin, max + margin);
                    if inner {
                        dark_count += 1;
                        assert_eq!(
                            lit.radiance.x, 0.0,
                            "{outward} {setting}: {lit:?} is in shadow"
                        );
                    } else if !outer {
                        lit_count += 1;
                        let error = (lit.radiance.x - expected).abs();
                        assert!(
                            error < 0.02 * expected,
                            "{outward} {setting}: {lit:?}, not {expected}"
                        );
                    }
                }
                assert!(
                    dark_count > 20 && lit_count > 20,
                    "{outward}: {dark_count} dark, {lit_count} lit"
                );
            }
        }
    }
}

#[test]
fn spot_and_sun_cast_the_projection_of_a_box() {
    let Some(gpu) = gpu() else { return };
    let (min, max) = (vec3(-0.4, 0.0, -0.3), vec3(0.3, 0.7, 0.4));
    for light in [
        spot(vec3(2.0, 3.0, 1.0), Vec3::ZERO, 30.0, 45.0, 40.0),
        sun(vec3(1.0, 2.0, 0.7), 3.0),
    ] {
        for setting in ["second-depth=true", "second-depth=false"] {
            let mut scene = lit_by(floor(2.0), light.clone());
            place(
                &mut scene,
                cuboid(min, max, 1),
                Material::matt("box", Vec3::splat(0.5)),
            );
            let setting = format!("shadow-map.{setting}");
            let picture = render(
                &gpu,
                &scene,
                &from_above(3.0, 5.0),
                128,
                &[&setting, "shadow-map.filter=none"],
            );
            let (mut dark, mut wrong) = (0, 0);
            for lit in picture.lit() {
                let from = lit.position + lit.normal * 1e-4;
                let to = match light.kind {
                    LightKind::Directional => from - light.direction() * 10.0,
                    _ => light.position(),
                };
                let margin = 0.025;
                let (inner, outer) = (
                    meets(from, to, min + margin, max - margin),
                    meets(from, to, min - margin, max + margin),
                );
                let on_box = lit.instance == 1;
                if inner != outer && !on_box {
                    continue;
                }
                let visible = on_box || !outer;
                dark += usize::from(!visible);
                let expected = if visible {
                    GREY_BRDF * irradiance(&light, lit.position, lit.normal)
                } else {
                    0.0
                };
                wrong += usize::from((lit.radiance.x - expected).abs() > 0.01 * expected);
            }
            assert!(
                dark > 200,
                "{} {setting}: only {dark} pixels in shadow",
                light.name
            );
            assert_eq!(wrong, 0, "{} {setting}: wrong pixels", light.name);
        }
    }
}

#[test]
fn lit_surfaces_have_no_acne() {
    let Some(gpu) = gpu() else { return };
    for light in [
        point_light(vec3(1.0, 2.5, 0.5), 10.0),
        spot(vec3(1.0, 2.5, 0.5), Vec3::ZERO, 30.0, 45.0, 10.0),
        sun(vec3(1.0, 1.0, 0.3), 3.0),
    ] {
        for filter in ["none", "pcf", "pcss"] {
            for second_depth in ["false", "true"] {
                let mut light = light.clone();
                light.radius = 0.02;
                let mut scene = Scene::new("acne");
                let tilted = quad(
                    vec3(-2.0, -1.0, 1.5),
                    Vec3::X * 4.0,
                    vec3(0.0, 1.2, -3.0),
                    1,
                );
                place(
                    &mut scene,
                    tilted,
                    Material::matt("tilted", Vec3::splat(0.5)),
                );
                place(
                    &mut scene,
                    sphere(0.5, 48),
                    Material::matt("sphere", Vec3::splat(0.5)),
                );
                scene.lights.push(light.clone());
                let settings = [
                    format!("shadow-map.filter={filter}"),
                    format!("shadow-map.second-depth={second_depth}"),
                    "shadow-map.resolution=512".to_owned(),
                ];
                let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
                let picture = render(&gpu, &scene, &from_above(2.0, 5.0), 64, &settings);
                let mut tested = 0;
                for lit in picture.lit() {
                    let to_light = match light.kind {
                        LightKind::Directional => -light.direction(),
                        _ => (light.position() - lit.position).normalize(),
                    };
                    // Points of the plane near the sphere's shadow, and points near the terminator, belong to another
                    // test.
                    let nearest = lit.position + to_light * (-lit.position.dot(to_light)).max(0.0);
                    if lit.normal.dot(to_light) < 0.15
                        || (lit.instance == 0 && nearest.length() < 0.7)
                    {
                        continue;
                    }
                    tested += 1;
                    let expected = GREY_BRDF * irradiance(&light, lit.position, lit.normal);
                    let error = (lit.radiance.x - expected).abs();
                    assert!(
                        error < 0.01 * expected,
                        "{} {settings:?}: {lit:?}, not {expected}",
                        light.name
                    );
                }
                assert!(tested > 1000, "{tested} points");
            }
        }
    }
}

#[test]
fn unshadowed_light_passes_everything() {
    let Some(gpu) = gpu() else { return };
    let [min, max] = [vec3(-0.5, 0.4, -0.5), vec3(0.5, 0.8, 0.5)];
    let mut boxed = floor(2.0);
    let grey = Material::matt("box", Vec3::splat(0.5));
    place(&mut boxed, cuboid(min, max, 1), grey);
    let camera = Camera::look_at("", vec3(2.0, 2.5, 3.0), Vec3::ZERO, 0.8);
    let lights = [
        point_light(vec3(0.5, 2.0, -0.3), 10.0),
        spot(vec3(1.0, 3.0, 0.0), Vec3::ZERO, 10.0, 25.0, 20.0),
        sun(vec3(1.0, 3.0, 0.5), 3.0),
    ];
    for light in lights {
        let scene = lit_by(boxed.clone(), light.clone());
        let settings = ["shadow-map.filter=unshadowed"];
        let picture = render(&gpu, &scene, &camera, 64, &settings);
        let mut behind = 0;
        for lit in picture.lit().filter(|lit| lit.instance == 0) {
            let toward = match light.kind {
                LightKind::Directional => lit.position - 9.0 * light.direction(),
                _ => light.position(),
            };
            behind += usize::from(meets(lit.position, toward, min, max));
            let expected = GREY_BRDF * irradiance(&light, lit.position, Vec3::Y);
            let error = (lit.radiance.x - expected).abs();
            assert!(
                error <= 0.01 * expected + 1e-4,
                "{}: {lit:?}, not {expected}",
                light.name
            );
        }
        assert!(behind > 50, "{}: {behind} points", light.name);
    }
}

/// A wall without thickness on a floor: no light behind its foot, no shadow in front of it, whatever filters do there.
#[test]
fn no_light_passes_under_a_thin_wall() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    let wall = quad(vec3(0.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::Y, 1);
    let grey = Material {
        double_sided: true,
        ..Material::matt("wall", Vec3::splat(0.5))
    };
    place(&mut scene, wall, grey);
    for light in [
        point_light(vec3(1.5, 1.5, 0.3), 10.0),
        point_light(vec3(0.6, 1.9, -0.8), 10.0),
        spot(vec3(1.5, 1.5, 0.3), Vec3::ZERO, 30.0, 45.0, 10.0),
        sun(vec3(1.0, 1.0, 0.3), 3.0),
    ] {
        let scene = lit_by(scene.clone(), light.clone());
        // A pixel is about 3 mm wide, a texel of these lights 6 to 24 mm.
        let camera = from_above(0.2, 5.0);
        let picture = render(&gpu, &scene, &camera, 64, &["shadow-map.resolution=256"]);
        let lit_at = |lit: &crate::common::Lit| {
            lit.radiance.x / (GREY_BRDF * irradiance(&light, lit.position, Vec3::Y))
        };
        let of_floor = || picture.lit().filter(|lit| lit.instance == 0);
        let behind: Vec<_> = of_floor()
            .filter(|lit| lit.position.x < -0.002)
            .map(lit_at)
            .collect();
        let before: Vec<_> = of_floor()
            .filter(|lit| lit.position.x > 0.002)
            .map(lit_at)
            .collect();
        let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
        let least = before.iter().copied().fold(f32::INFINITY, f32::min);
        let found = format!(
            "{}: behind the wall {} of the light, in front {} and {least} at least",
            light.name,
            mean(&behind),
            mean(&before),
        );
        println!("{found}");
        assert!(behind.len() > 1000 && before.len() > 1000);
        assert!(mean(&behind) < 0.002, "{found}");
        // A few comparisons find the foot of the wall.
        assert!(mean(&before) > 0.99 && least > 0.8, "{found}");
    }
}

/// More point lights than one atlas has room for at the resolution asked for.
#[test]
fn two_hundred_and_fifty_six_point_lights_cast_shadows() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    let (min, max) = (vec3(-0.5, 0.0, -0.4), vec3(0.3, 0.6, 0.5));
    place(
        &mut scene,
        cuboid(min, max, 1),
        Material::matt("box", Vec3::splat(0.5)),
    );
    // In a line, so that the box's shadow has a core that few of them light.
    for index in 0..256 {
        let part = index as f32 / 255.0;
        let at = vec3(1.0 + part, 2.0, 1.5 - 3.0 * part);
        scene.lights.push(point_light(at, 0.02 + 0.18 * part));
    }
    let mut renderer = renderer(&gpu, &scene, 48, &[]);
    let picture = picture(&mut renderer, &from_above(3.8, 5.0));
    let notes = renderer.warnings();
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert!(
        notes[0].starts_with("shadow-map: 256 lights share the shadow atlas: ")
            && notes[0].ends_with(" texels per face instead of 1024"),
        "{notes:?}"
    );
    println!("{}", notes[0]);
    let mut darkest: f32 = 1.0;
    for lit in picture.lit().filter(|lit| lit.instance == 0) {
        // Between what a box that is larger and one that is smaller by three texels let through.
        let [mut all, mut least, mut most] = [0.0; 3];
        for light in &scene.lights {
            let own = GREY_BRDF * irradiance(light, lit.position, Vec3::Y);
            let hidden = |grow: f32| {
                let from = lit.position + Vec3::Y * 1e-4;
                meets(from, light.position(), min - grow, max + grow)
            };
            all += own;
            least += if hidden(0.06) { 0.0 } else { own };
            most += if hidden(-0.06) { 0.0 } else { own };
        }
        let found = lit.radiance.x;
        assert!(
            found >= 0.99 * least && found <= 1.01 * most,
            "{lit:?}, not {least} to {most} of {all}"
        );
        darkest = darkest.min(found / all);
    }
    assert!(darkest < 0.2, "no shadow: {darkest}");
}

/// A plane of 200 m with a post every ten metres.
fn avenue() -> (Scene, Light) {
    let light = sun(vec3(2.0, 2.0, 0.4), 3.0);
    let mut scene = lit_by(floor(100.0), light.clone());
    for z in 0..18 {
        let (x, z) = (1.5, -10.0 * z as f32 + 80.0);
        place(
            &mut scene,
            cuboid(vec3(x, 0.0, z - 0.5), vec3(x + 0.6, 4.0, z + 0.5), 1),
            Material::matt("post", Vec3::splat(0.5)),
        );
    }
    (scene, light)
}

fn down_the_avenue(step: f32) -> Camera {
    Camera::look_at(
        "",
        vec3(-3.0, 4.0, 95.0 - step),
        vec3(-2.0, 0.0, 60.0 - step),
        0.9,
    )
}

#[test]
fn cascades_shade_near_and_far_without_steps() {
    let Some(gpu) = gpu() else { return };
    let (scene, light) = avenue();
    let posts: Vec<_> = scene.instances[1..]
        .iter()
        .map(|post| scene.meshes[post.mesh].bounds())
        .collect();
    let picture = render(&gpu, &scene, &down_the_avenue(0.0), 128, &[]);
    let mut found = [[0; 2]; 2];
    for lit in picture.lit().filter(|lit| lit.instance == 0) {
        let from = lit.position + Vec3::Y * 1e-3;
        let to = from - light.direction() * 50.0;
        let margin = 0.02 + 0.006 * (95.0 - lit.position.z).abs();
        let hits = |grow: f32| {
            posts
                .iter()
                .any(|post| meets(from, to, post.min - grow, post.max + grow))
        };
        let (inner, outer) = (hits(-margin.min(0.25)), hits(margin));
        if inner != outer {
            continue;
        }
        let full = GREY_BRDF * irradiance(&light, lit.position, Vec3::Y);
        let expected = if outer { 0.0 } else { full };
        let error = (lit.radiance.x - expected).abs();
        assert!(error < 0.01 * full, "{lit:?}, not {expected}");
        found[usize::from(lit.position.z < 60.0)][usize::from(outer)] += 1;
    }
    assert!(found.iter().flatten().all(|&count| count > 10), "{found:?}");
}

#[test]
fn shadow_edges_stand_still_when_the_camera_moves() {
    let Some(gpu) = gpu() else { return };
    // A long wall whose shadow's edge runs along the camera's path: what a fixed point of the floor receives must not
    // change.
    let light = sun(vec3(2.0, 2.0, 0.4), 3.0);
    let mut scene = lit_by(floor(100.0), light);
    place(
        &mut scene,
        cuboid(vec3(1.0, 0.0, -90.0), vec3(1.5, 3.0, 90.0), 1),
        Material::matt("wall", Vec3::splat(0.5)),
    );
    let mut renderer = renderer(&gpu, &scene, 160, &[]);
    // Where along x the light falls to half, near z = 84: the mean over half-lit points.
    let edges: Vec<f32> = (0..8)
        .map(|step| {
            let mut camera = down_the_avenue(0.037 * step as f32);
            camera.world_from_view.w_axis.x += 0.013 * step as f32;
            let picture = picture(&mut renderer, &camera);
            let full = GREY_BRDF * irradiance(&scene.lights[0], Vec3::ZERO, Vec3::Y);
            let near = picture
                .lit()
                .filter(|lit| lit.instance == 0 && (lit.position.z - 84.0).abs() < 1.5);
            let half: Vec<f32> = near
                .filter(|lit| (lit.radiance.x / full - 0.5).abs() < 0.3 && lit.position.x < 0.0)
                .map(|lit| lit.position.x)
                .collect();
            assert!(half.len() > 5, "{} points on the edge", half.len());
            half.iter().sum::<f32>() / half.len() as f32
        })
        .collect();
    let spread = edges.iter().copied().fold(f32::MIN, f32::max)
        - edges.iter().copied().fold(f32::MAX, f32::min);
    println!("edge at {edges:?}, spread {spread} m");
    assert!(spread < 0.04, "the edge moves by {spread} m: {edges:?}");
}

#[test]
fn cascades_move_in_whole_texels() {
    let Some(gpu) = gpu() else { return };
    let (scene, _) = avenue();
    let settings = ["shadow-map.resolution=256", "shadow-map.filter=none"];
    let mut renderer = renderer(&gpu, &scene, 64, &settings);
    // Straight down from 10 m: the pixels are a grid on the floor, so the same points are seen 1 to 5 pixels further
    // on.
    let pixel = 2.0 * 10.0 * 0.45_f32.tan() / 64.0;
    let mut seen = |steps: usize| {
        let mut camera = Camera::look_at("", vec3(0.0, 10.0, 30.0), vec3(0.0, 0.0, 30.0), 0.9);
        let right = camera.world_from_view.x_axis;
        camera.world_from_view.w_axis += right * (pixel * steps as f32);
        picture(&mut renderer, &camera)
    };
    let first = seen(0);
    let darkest = first
        .lit()
        .filter(|lit| lit.instance == 0)
        .map(|lit| lit.radiance.x)
        .fold(1.0, f32::min);
    assert_eq!(darkest, 0.0, "no shadow in sight");
    for steps in 1..6 {
        let moved = seen(steps);
        let (mut sum, mut count) = (0.0, 0);
        for (y, x) in (0..64).flat_map(|y| (0..64 - steps).map(move |x| (y, x))) {
            if let (Some(a), Some(b)) = (first.points[y * 64 + x + steps], moved.points[y * 64 + x])
                && (a.instance, b.instance) == (0, 0)
            {
                sum += (a.radiance.x - b.radiance.x).abs();
                count += 1;
            }
        }
        let difference = sum / count as f32 / first.radiance.iter().copied().fold(0.0, f32::max);
        println!("{steps} pixels on: mean difference {difference}");
        assert!(
            difference < 2e-4,
            "{steps} pixels on: mean difference {difference}"
        );
    }
}
