//! What must hold for every scene: finite radiance, the same picture from the same seed, and maps generated only when
//! something changed.

use std::sync::atomic::Ordering;

use crate::common::{floor, from_above, gpu, lit_by, picture, place, render, renderer};
use glam::{Mat4, Vec3, vec3};
use gpugi::techniques::Registry;
use gpugi::{LightingError, Purpose, Renderer};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Mesh, Scene};

fn lights() -> [Light; 3] {
    let spot = LightKind::Spot {
        inner_cone_angle: 0.3,
        outer_cone_angle: 0.6,
    };
    [LightKind::Point, spot, LightKind::Directional].map(|kind| {
        Light::new("light", kind, Vec3::splat(3.0)).aimed(vec3(0.5, 2.0, 0.5), Vec3::ZERO)
    })
}

fn looking_down() -> Camera {
    Camera::look_at("", vec3(0.0, 3.0, 3.0), Vec3::ZERO, 0.8)
}

/// A floor, a box and every kind of light.
fn furnished() -> Scene {
    let mut scene = floor(2.0);
    place(
        &mut scene,
        cuboid(vec3(-0.3, 0.0, -0.3), vec3(0.3, 0.6, 0.3), 1),
        Material::matt("box", Vec3::splat(0.5)),
    );
    place(
        &mut scene,
        quad(vec3(-1.0, 1.5, -1.0), Vec3::X * 0.3, Vec3::Z * 0.3, 1),
        Material::emitter("lamp", Vec3::splat(5.0)),
    );
    scene.lights = lights().to_vec();
    scene
}

/// Triangles without area.
fn line() -> Mesh {
    let mut mesh = quad(vec3(0.0, 1.0, 0.0), Vec3::X, Vec3::X * 0.5, 2);
    mesh.normals.fill(Vec3::Y);
    mesh
}

#[test]
fn degenerate_scenes_stay_finite() {
    let Some(gpu) = gpu() else { return };
    // `render` asserts that radiance is finite. What can be lit is lit.
    let is_lit =
        |picture: &crate::common::Picture| picture.lit().any(|point| point.radiance.x > 0.0);
    let settings = [
        "shadow-map.resolution=64",
        "shadow-map.filter=pcss",
        "shadow-map.area-samples=4",
    ];
    let mut empty = Scene::new("empty");
    empty.lights = lights().to_vec();
    render(&gpu, &empty, &looking_down(), 8, &settings);
    render(&gpu, &Scene::new("nothing at all"), &looking_down(), 8, &[]);

    let mut scene = furnished();
    // On the floor, at a corner of the box, and in the camera.
    for position in [Vec3::ZERO, vec3(0.3, 0.6, 0.3), vec3(0.0, 3.0, 3.0)] {
        for mut light in lights() {
            light.world_from_light.w_axis = position.extend(1.0);
            light.radius = 0.1;
            scene.lights.push(light);
        }
    }
    let mut without_range = lights()[0].clone();
    without_range.range = Some(0.0);
    scene.lights.push(without_range);
    assert!(is_lit(&render(
        &gpu,
        &scene,
        &looking_down(),
        16,
        &settings
    )));
    assert!(is_lit(&render(&gpu, &scene, &looking_down(), 1, &settings)));

    // The camera and a light inside the box.
    let inside = Camera::look_at("", vec3(0.0, 0.3, 0.0), vec3(0.0, 0.2, -1.0), 1.0);
    render(&gpu, &scene, &inside, 16, &settings);

    // Emitters and walls without area, a mesh of a single point, and an instance flattened to a plane.
    let mut flat = furnished();
    let nothing = line();
    place(
        &mut flat,
        nothing.clone(),
        Material::emitter("line", Vec3::ONE),
    );
    place(&mut flat, nothing, Material::matt("line", Vec3::ONE));
    let ball = flat.add_mesh(sphere(0.3, 4));
    let grey = flat.add_material(Material::matt("grey", Vec3::splat(0.5)));
    flat.add_instance(
        "disc",
        ball,
        grey,
        Mat4::from_scale_rotation_translation(vec3(1.0, 0.0, 1.0), glam::Quat::IDENTITY, Vec3::Y),
    );
    flat.add_instance("point", ball, grey, Mat4::from_scale(Vec3::ZERO));
    assert!(is_lit(&render(&gpu, &flat, &looking_down(), 16, &settings)));

    let mut only_line = Scene::new("line");
    place(&mut only_line, line(), Material::emitter("line", Vec3::ONE));
    render(&gpu, &only_line, &looking_down(), 8, &settings);
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let Some(gpu) = gpu() else { return };
    let scene = furnished();
    let render_with = |seed: u32| {
        let mut renderer = renderer(&gpu, &scene, 48, &[]);
        renderer.set_seed(seed);
        for _ in 0..2 {
            renderer
                .render_sample(&looking_down(), 2, None, false)
                .expect("a sample");
        }
        renderer.radiance().expect("radiance")
    };
    let (first, again, other) = (render_with(7), render_with(7), render_with(8));
    assert!(
        first
            .iter()
            .zip(&again)
            .all(|(a, b)| a.to_bits() == b.to_bits()),
        "the same seed gave another picture"
    );
    assert_ne!(first, other, "the seed has no effect");
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    let difference = first
        .iter()
        .zip(&other)
        .map(|(a, b)| (a - b).abs())
        .sum::<f32>()
        / first.len() as f32;
    assert!(
        difference < 0.01 * mean(&first),
        "another seed changes {difference} of {}",
        mean(&first)
    );
}

#[test]
fn maps_are_made_again_only_when_something_changed() {
    let Some(gpu) = gpu() else { return };
    assert!(
        gpu.has_timestamps,
        "this test needs an adapter that times passes"
    );
    let mut before = furnished();
    before.lights.retain(|light| light.kind == LightKind::Point);
    let mut renderer = renderer(&gpu, &before, 16, &[]);
    let generates = |renderer: &mut Renderer| {
        let timings = renderer
            .render_sample(&looking_down(), 1, None, true)
            .and_then(|timings| Ok(timings.wait()?))
            .expect("a sample");
        assert!(
            timings
                .iter()
                .any(|timing| timing.pass == "shadow-map.gather")
        );
        timings
            .iter()
            .any(|timing| timing.pass == "shadow-map.generate")
    };
    assert!(generates(&mut renderer), "the first frame needs maps");
    assert!(!generates(&mut renderer), "nothing changed");
    let mut after = before.clone();
    after.lights[0].world_from_light.w_axis.x += 0.7;
    renderer.update(&after).expect("an update");
    assert!(generates(&mut renderer), "a light moved");
    assert!(!generates(&mut renderer), "nothing changed since");
    renderer
        .set("shadow-map", "filter-radius", "3")
        .expect("a setting");
    assert!(generates(&mut renderer), "a setting changed");
    // The picture after the update is that of the changed scene.
    renderer
        .set("shadow-map", "filter-radius", "1.5")
        .expect("a setting");
    let updated = picture(&mut renderer, &looking_down());
    let fresh = render(&gpu, &after, &looking_down(), 16, &[]);
    assert_eq!(updated.radiance, fresh.radiance);
}

#[test]
fn a_moved_instance_moves_its_shadow() {
    let Some(gpu) = gpu() else { return };
    let before = furnished();
    let mut after = before.clone();
    after.instances[1].world_from_mesh = Mat4::from_translation(vec3(0.4, 0.2, 0.1));
    let mut renderer = renderer(&gpu, &before, 32, &[]);
    picture(&mut renderer, &looking_down());
    renderer.update(&after).expect("an update");
    let updated = picture(&mut renderer, &looking_down());
    assert_eq!(
        updated.radiance,
        render(&gpu, &after, &looking_down(), 32, &[]).radiance
    );
}

#[test]
fn without_shadow_maps_there_is_no_direct_light() {
    let Some(gpu) = gpu() else { return };
    let scene = lit_by(floor(2.0), lights()[0].clone());
    let on = render(&gpu, &scene, &from_above(2.0, 1.0), 16, &[]);
    assert!(on.lit().all(|lit| lit.radiance.x > 0.0));
    let mut off =
        Renderer::new(&gpu, &scene, [16, 16], &["environment-map".to_owned()]).expect("a renderer");
    let off = picture(&mut off, &from_above(2.0, 1.0));
    assert!(off.lit().all(|lit| lit.radiance == Vec3::ZERO));
    let unknown = Renderer::new(&gpu, &scene, [16, 16], &["shadow-maps".to_owned()]);
    assert!(matches!(
        unknown,
        Err(LightingError::UnknownTechnique { .. })
    ));
}

#[test]
fn more_materials_than_a_surface_point_can_name_are_refused() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(1.0);
    scene
        .materials
        .resize((1 << 16) + 1, Material::matt("one of many", Vec3::ONE));
    let refused = Renderer::new(&gpu, &scene, [8, 8], Purpose::LiveView).map(|_| ());
    assert!(
        matches!(
            refused,
            Err(LightingError::Gpu(gpugi::gpu::GpuError::TooLarge { .. }))
        ),
        "{refused:?}"
    );
}

/// What moves, is added or is removed shows as in a new renderer, including mirrors and shadows.
#[test]
fn a_renderer_follows_its_scene() {
    let Some(gpu) = gpu() else { return };
    let mut start = furnished();
    let ball = place(
        &mut start,
        sphere(0.25, 24),
        Material::metal("mirror", Vec3::ONE, 0.0),
    );
    start.instances[ball].world_from_mesh = Mat4::from_translation(vec3(0.7, 0.3, 0.2));
    let mut moved = start.clone();
    moved.instances[1].world_from_mesh = Mat4::from_translation(vec3(-0.4, 0.1, 0.3));
    // The lamp, which is an emitter, and the mirror ball.
    moved.instances[2].world_from_mesh = Mat4::from_translation(vec3(0.4, 0.2, 0.5));
    moved.instances[ball].world_from_mesh = Mat4::from_translation(vec3(-0.5, 0.3, 0.9));
    let mut more = moved.clone();
    let sheet = quad(vec3(-0.2, 0.8, 0.2), Vec3::X, vec3(0.0, 0.3, -0.3), 1);
    place(&mut more, sheet, Material::matt("sheet", Vec3::X));
    let mut turned = moved.clone();
    turned.instances[1].world_from_mesh *= Mat4::from_scale(vec3(-1.0, 1.0, 1.0));
    let mut fewer = start.clone();
    fewer.instances.remove(1);
    let camera = looking_down();
    // Maps that are quick to make: they are made eleven times.
    let settings = [
        "shadow-map.resolution=256",
        "shadow-map.area-samples=16",
        "caustics.resolution=64",
        "caustics.area-samples=1",
        "distance-impostor.resolution=64",
    ];
    let mut renderer = renderer(&gpu, &start, 48, &settings);
    picture(&mut renderer, &camera);
    for (what, after) in [
        ("moved", &moved),
        ("one more", &more),
        ("mirrored", &turned),
        ("one less", &fewer),
        ("as it was", &start),
    ] {
        renderer.update(after).expect("an update");
        let followed = picture(&mut renderer, &camera);
        let anew = render(&gpu, after, &camera, 48, &settings);
        let differ = followed.radiance.iter().zip(&anew.radiance);
        let worst = differ.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-4, "{what}: {worst}");
    }
}

/// A technique that adds nothing and counts how often it plans.
mod planner {
    use std::sync::atomic::{AtomicU32, Ordering};

    use gpugi::capture::{Receiver, View};
    use gpugi::gpu::{Frame, GpuError};
    use gpugi::light_paths::LightPaths;
    use gpugi::scene::{Claims, GpuScene};
    use gpugi::settings::SettingSet;
    use gpugi::techniques::{Earlier, Generated, Info, Plan, Registration, Technique, Unready};

    pub static PLANS: AtomicU32 = AtomicU32::new(0);

    gpugi::settings! {
        /// Settings, of which there must be one.
        pub struct Settings {
            /// Without effect.
            pub weight: f32 = 1.0 => in_range(0.0, 1.0),
        }
    }

    static INFO: Info = Info {
        name: "planner",
        summary: "counts plans",
        source: "robustness.rs",
        ..Info::BASE
    };

    pub const REGISTRATION: Registration = Registration {
        info: &INFO,
        fields: Settings::fields,
        make: |_, _| Ok(Box::new(Planner::default())),
        suits: |_| None,
        settings: |_| Vec::new(),
    };

    #[derive(Debug, Default)]
    struct Planner {
        settings: Settings,
    }

    impl Technique for Planner {
        fn info(&self) -> &'static Info {
            &INFO
        }

        fn settings(&self) -> &dyn SettingSet {
            &self.settings
        }

        fn settings_mut(&mut self) -> &mut dyn SettingSet {
            &mut self.settings
        }

        fn plan(&mut self, scene: &GpuScene, _: &[LightPaths], _: &[Claims]) -> Plan {
            PLANS.fetch_add(1, Ordering::Relaxed);
            Plan::adding(Vec::new(), scene)
        }

        fn generate(
            &mut self,
            _: &mut Frame<'_>,
            _: &GpuScene,
            _: &View,
            _: &mut Earlier<'_>,
        ) -> Result<Generated, Unready> {
            Ok(Generated::FINAL)
        }

        fn gather(
            &mut self,
            _: &mut Frame<'_>,
            _: &GpuScene,
            _: &Receiver,
            _: &mut Earlier<'_>,
        ) -> Result<(), GpuError> {
            Ok(())
        }
    }
}

/// Planning takes milliseconds: too long for each frame of an animation.
#[test]
fn techniques_plan_anew_only_if_what_they_plan_for_changes() {
    let Some(gpu) = gpu() else { return };
    let mut registry = Registry::default();
    registry.insert_before("shadow-map", planner::REGISTRATION);
    let mut scene = furnished();
    let names = ["planner".to_owned(), "shadow-map".to_owned()];
    let made = Renderer::with_registry(&gpu, &scene, [16, 16], &names, &registry);
    let mut renderer = made.expect("a renderer");
    let mut plans_after = |change: &dyn Fn(&mut Scene)| {
        change(&mut scene);
        let before = planner::PLANS.load(Ordering::Relaxed);
        renderer.update(&scene).expect("an update");
        planner::PLANS.load(Ordering::Relaxed) - before
    };
    let moves = |scene: &mut Scene| {
        scene.instances[1].world_from_mesh *= Mat4::from_translation(Vec3::Y * 0.1);
        scene.lights[0].world_from_light *= Mat4::from_translation(Vec3::X * 0.1);
    };
    let deforms = |scene: &mut Scene| {
        let mut mesh = Mesh::clone(&scene.meshes[1]);
        mesh.positions.iter_mut().for_each(|at| at.y *= 1.1);
        scene.meshes[1] = mesh.into();
    };
    assert_eq!([plans_after(&moves), plans_after(&deforms)], [0, 0]);
    let gets_a_light = |scene: &mut Scene| scene.lights.extend(lights());
    let becomes_glass = |scene: &mut Scene| scene.materials[1].transmission = 1.0;
    for change in [&gets_a_light as &dyn Fn(&mut Scene), &becomes_glass] {
        assert!(plans_after(change) > 0);
    }
}
