//! Budgets slice the capturing of cubes and the drawing of depth maps.

use super::*;

fn one_frame(renderer: &mut Renderer) -> Readiness {
    let stop = |_, _| ControlFlow::Break(());
    renderer.converge(&camera(), false, stop).unwrap()
}

/// Frames until the maps are final.
fn frames(renderer: &mut Renderer) -> usize {
    (1..100)
        .find(|_| one_frame(renderer) == Readiness::Ready)
        .expect("maps that become final")
}

/// Whether each of the two lists has other words at each place.
fn changes(before: &[(String, Vec<u32>)], after: &[(String, Vec<u32>)]) -> Vec<bool> {
    assert_eq!(before.len(), after.len());
    let pairs = before.iter().zip(after);
    pairs.map(|(before, after)| before.1 != after.1).collect()
}

/// Four mirror balls in a row on a block.
fn four_balls() -> Scene {
    let mut scene = balls();
    scene.environment = None;
    let ball = scene.instances[1].clone();
    for x in [-1.5, 1.5] {
        let place = Mat4::from_translation(Vec3::new(x, 0.5, 0.0));
        scene.instances.push(gpugi_scene::Instance {
            world_from_mesh: place,
            ..ball.clone()
        });
    }
    scene
}

fn mirrors(gpu: &Gpu, scene: &Scene, budget: Budget) -> Renderer {
    let names = ["shadow-map", "distance-impostor"].map(str::to_owned);
    let mut renderer = Renderer::new(gpu, scene, [8, 8], &names).unwrap();
    for [technique, name, value] in [
        ["shadow-map", "resolution", "32"],
        ["distance-impostor", "resolution", "16"],
    ] {
        renderer.set(technique, name, value).unwrap();
    }
    renderer.set_budget(budget);
    renderer
}

/// The distances and the radiance of each cube.
fn cubes(gpu: &Gpu, renderer: &Renderer) -> [Vec<(String, Vec<u32>)>; 2] {
    [".distances", ".radiance"].map(|end| {
        let mut maps = words_of_maps(gpu, renderer);
        maps.retain(|(name, _)| name.ends_with(end));
        maps
    })
}

/// Lowers the block, which all balls mirror.
fn lower_block(scene: &mut Scene) {
    let matrix = &mut scene.instances[0].world_from_mesh;
    *matrix = Mat4::from_translation(Vec3::new(0.0, -0.05, 0.0)) * *matrix;
}

/// A frame captures no more cubes than it lights, the others stay as they were, and in the end all are the same as
/// without a budget.
#[test]
fn cubes_are_captured_one_per_frame() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = four_balls();
    let mut sliced = mirrors(&gpu, &scene, Budget::units(1));
    let first = one_frame(&mut sliced);
    assert!(!first.is_usable(), "{first:?}");
    frames(&mut sliced);
    lower_block(&mut scene);
    sliced.update(&scene).unwrap();
    let [mut distances, mut radiance] = cubes(&gpu, &sliced);
    assert_eq!(distances.len(), 4);
    let mut captured = [0; 4];
    // Without the depth maps of the lamp.
    let of_lamp = work_of_lamp(&scene);
    let of_cubes = |renderer: &Renderer| match renderer.work() {
        work if work >= of_lamp => work - of_lamp,
        work => work,
    };
    let mut most = 0;
    loop {
        let readiness = one_frame(&mut sliced);
        assert!(readiness.is_usable(), "{readiness:?}");
        most = most.max(of_cubes(&sliced));
        let [distances_now, radiance_now] = cubes(&gpu, &sliced);
        let is_captured = changes(&distances, &distances_now);
        let is_lit = changes(&radiance, &radiance_now);
        assert!(is_captured.iter().filter(|is| **is).count() <= 1);
        for (cube, (is_captured, is_lit)) in is_captured.into_iter().zip(is_lit).enumerate() {
            assert!(is_lit || !is_captured, "cube {cube}");
            captured[cube] += usize::from(is_captured);
        }
        (distances, radiance) = (distances_now, radiance_now);
        if readiness == Readiness::Ready {
            break;
        }
    }
    assert_eq!(captured, [1; 4]);
    let mut whole = mirrors(&gpu, &scene, Budget::UNLIMITED);
    assert_eq!(frames(&mut whole), 1);
    let all = of_cubes(&whole);
    println!("{most} units per frame at most, {all} without a budget");
    assert!(most * 3 < all);
    assert!(cubes(&gpu, &whole)[0] == distances);
}

/// While a light changes, cubes are lit by a share of a lamp's points, at a part of the work; in the end, by all.
#[test]
fn cubes_that_are_lit_again_are_lit_briefly_first() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = four_balls();
    scene.lights.clear();
    add_lamp(&mut scene, 0.0);
    let lamp = Material::emitter("lamp", Vec3::splat(20.0));
    let (mesh, material) = (
        scene.add_mesh(quad(Vec3::new(-1.0, 3.0, 1.0), Vec3::X, -Vec3::Y, 1)),
        scene.add_material(lamp),
    );
    scene.add_instance("lamp", mesh, material, Mat4::IDENTITY);
    let mut renderers = ["true", "false"].map(|interleaved| {
        let mut renderer = mirrors(&gpu, &scene, Budget::units(1));
        for (name, value) in [
            ("area-samples", "16"),
            ("area-resolution", "32"),
            ("interleaved", interleaved),
        ] {
            renderer.set("shadow-map", name, value).unwrap();
        }
        frames(&mut renderer);
        renderer
    });
    scene.lights[0].intensity *= 2.0;
    for renderer in &mut renderers {
        renderer.update(&scene).unwrap();
    }
    let others = |renderers: &[Renderer; 2]| {
        let [shared, whole] = [0, 1].map(|index| {
            let [_, radiance] = cubes(&gpu, &renderers[index]);
            let words = radiance.into_iter().flat_map(|(_, words)| words);
            words.collect::<Vec<_>>()
        });
        let all = shared.iter().zip(&whole);
        all.filter(|(a, b)| a != b).count() as f32 / whole.len() as f32
    };
    // Balls that mirror each other show what the others were at the time.
    let least = others(&renderers);
    assert!(least < 0.05, "{least}");
    // The light's own depth maps come first.
    for renderer in &mut renderers {
        one_frame(renderer);
    }
    for _ in 0..4 {
        for renderer in &mut renderers {
            one_frame(renderer);
        }
        let [shared, whole] = renderers.each_ref().map(Renderer::work);
        assert!(shared * 2 < whole, "{shared} of {whole}");
    }
    let most = others(&renderers);
    assert!(most > 0.3, "{most}");
    let frames = renderers.each_mut().map(frames);
    assert_eq!(frames, [4, 4]);
    let [shared, whole] = renderers.each_ref().map(Renderer::work);
    assert_eq!(shared, whole);
    let left = others(&renderers);
    println!("{least} of the words, then {most} and {left}");
    assert!(left < 0.05, "{left}");
}

/// Surroundings that change in every frame are captured in turn: depth maps, which come first, use up the budget, and
/// every third frame exceeds it.
#[test]
fn every_cube_is_captured_while_everything_moves() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = four_balls();
    let mut renderer = mirrors(&gpu, &scene, Budget::units(1));
    frames(&mut renderer);
    let [first, _] = cubes(&gpu, &renderer);
    let mut before = first.clone();
    let mut captured = Vec::new();
    for _ in 0..12 {
        lower_block(&mut scene);
        renderer.update(&scene).unwrap();
        one_frame(&mut renderer);
        let [after, _] = cubes(&gpu, &renderer);
        let is_captured = changes(&before, &after);
        captured.push(is_captured.iter().filter(|is| **is).count());
        before = after;
    }
    assert_eq!(captured, [0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0]);
    assert_eq!(changes(&first, &before), [true; 4]);
}

/// Three lamps over the block, and two balls.
fn lamps() -> Scene {
    let mut scene = balls();
    scene.environment = None;
    scene.lights.clear();
    for x in [-1.0, 0.0, 1.0] {
        add_lamp(&mut scene, x);
    }
    scene
}

fn add_lamp(scene: &mut Scene, x: f32) {
    let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(8.0));
    let place = Vec3::new(x, 2.5, 1.0);
    scene.lights.push(lamp.aimed(place, Vec3::new(x, 0.0, 0.0)));
}

fn shadows(gpu: &Gpu, scene: &Scene, budget: Budget) -> Renderer {
    let names = ["shadow-map".to_owned()];
    let mut renderer = Renderer::new(gpu, scene, [16, 16], &names).unwrap();
    renderer.set("shadow-map", "resolution", "32").unwrap();
    renderer.set_budget(budget);
    renderer
}

fn depths(gpu: &Gpu, renderer: &Renderer) -> Vec<u32> {
    words_of_maps(gpu, renderer).swap_remove(0).1
}

fn move_lamp(scene: &mut Scene, lamp: usize) {
    let matrix = &mut scene.lights[lamp].world_from_light;
    *matrix = Mat4::from_translation(Vec3::new(0.0, 0.02, 0.0)) * *matrix;
}

/// The maps of one lamp have six faces of 32 x 32 texels; a triangle counts as 64.
fn work_of_lamp(scene: &Scene) -> u64 {
    6 * 32 * 32 + 64 * scene.statistics().triangles
}

/// A frame draws the maps of one lamp; the final ones are the same as without a budget. A moving lamp's shadow follows
/// in the same frame.
#[test]
fn depth_maps_are_drawn_one_lamp_per_frame() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = lamps();
    let mut sliced = shadows(&gpu, &scene, Budget::units(1));
    for _ in 0..2 {
        let readiness = one_frame(&mut sliced);
        assert!(!readiness.is_usable(), "{readiness:?}");
        assert!(readiness.progress() < 1.0);
        assert_eq!(sliced.work(), work_of_lamp(&scene));
        assert!(words_of_maps(&gpu, &sliced).is_empty());
    }
    assert_eq!(one_frame(&mut sliced), Readiness::Ready);
    let same_as_whole = |scene: &Scene, sliced: &mut Renderer| {
        let mut whole = shadows(&gpu, scene, Budget::UNLIMITED);
        assert_eq!(frames(&mut whole), 1);
        assert_eq!(
            whole.work(),
            scene.lights.len() as u64 * work_of_lamp(scene)
        );
        assert!(depths(&gpu, sliced) == depths(&gpu, &whole));
        for renderer in [&mut whole, &mut *sliced] {
            renderer.render_sample(&camera(), 1, None, false).unwrap();
        }
        assert!(whole.radiance().unwrap() == sliced.radiance().unwrap());
    };
    same_as_whole(&scene, &mut sliced);

    move_lamp(&mut scene, 1);
    sliced.update(&scene).unwrap();
    assert_eq!(one_frame(&mut sliced), Readiness::Ready);
    assert_eq!(sliced.work(), work_of_lamp(&scene));
    same_as_whole(&scene, &mut sliced);
    assert_eq!(one_frame(&mut sliced), Readiness::Ready);
    assert_eq!(sliced.work(), 0);

    // What moves changes all maps, one after another.
    lower_block(&mut scene);
    sliced.update(&scene).unwrap();
    for _ in 0..2 {
        let readiness = one_frame(&mut sliced);
        assert!(matches!(readiness, Readiness::Refining { .. }));
        assert_eq!(sliced.work(), work_of_lamp(&scene));
    }
    assert_eq!(one_frame(&mut sliced), Readiness::Ready);
    same_as_whole(&scene, &mut sliced);

    // Another lamp needs another atlas: the old one stays until the new one is whole.
    let before = depths(&gpu, &sliced);
    add_lamp(&mut scene, 0.5);
    sliced.update(&scene).unwrap();
    for _ in 0..3 {
        let readiness = one_frame(&mut sliced);
        assert!(matches!(readiness, Readiness::Refining { .. }));
        assert!(depths(&gpu, &sliced) == before);
    }
    assert_eq!(one_frame(&mut sliced), Readiness::Ready);
    same_as_whole(&scene, &mut sliced);
}

/// Neither lamps that rest nor new ones wait for ever while another lamp and the scene move.
#[test]
fn every_depth_map_is_drawn_while_everything_moves() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = lamps();
    let mut renderer = shadows(&gpu, &scene, Budget::units(1));
    frames(&mut renderer);
    let of_lamps = |renderer: &Renderer| -> Vec<Vec<u32>> {
        let words = depths(&gpu, renderer);
        // Rows of six tiles in an atlas of 160 texels: tiles of 32 texels, five per row.
        let side = words.len().isqrt();
        let per_row = side / 32;
        let tile = |index: usize| {
            let corner = (index / per_row * side + index % per_row) * 32;
            let rows = (0..32).map(move |row| corner + row * side);
            rows.flat_map(|start| words[start..start + 32].to_vec())
                .collect::<Vec<u32>>()
        };
        (0..3)
            .map(|lamp| (6 * lamp..6 * lamp + 6).flat_map(tile).collect())
            .collect()
    };
    let before = of_lamps(&renderer);
    for _ in 0..20 {
        move_lamp(&mut scene, 0);
        lower_block(&mut scene);
        renderer.update(&scene).unwrap();
        one_frame(&mut renderer);
        assert_eq!(renderer.work(), work_of_lamp(&scene));
    }
    let after = of_lamps(&renderer);
    for (lamp, (before, after)) in before.iter().zip(&after).enumerate() {
        assert!(before != after, "lamp {lamp}");
    }
    // The number of lamps changes in every frame, faster than an atlas is finished.
    let old = depths(&gpu, &renderer);
    for frame in 0..8 {
        add_lamp(&mut scene, frame as f32 / 10.0);
        renderer.update(&scene).unwrap();
        let readiness = one_frame(&mut renderer);
        assert!(matches!(readiness, Readiness::Refining { .. }));
        assert_eq!(renderer.work(), work_of_lamp(&scene));
    }
    assert!(depths(&gpu, &renderer) != old);
}

/// Light between surfaces, which could use up every budget, does not delay what mirrors show.
#[test]
fn cubes_come_before_radiosity() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = four_balls();
    let names = ["shadow-map", "radiosity", "distance-impostor"].map(str::to_owned);
    let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).unwrap();
    for [technique, name, value] in [
        ["shadow-map", "resolution", "32"],
        ["radiosity", "resolution", "32"],
        ["radiosity", "steps", "256"],
        ["distance-impostor", "resolution", "16"],
    ] {
        renderer.set(technique, name, value).unwrap();
    }
    // Enough for all cubes, and for a few iterates.
    renderer.set_budget(Budget::units(100_000));
    while !one_frame(&mut renderer).is_usable() {
        renderer.scene().wait_for_atlas();
    }
    lower_block(&mut scene);
    renderer.update(&scene).unwrap();
    let [before, _] = cubes(&gpu, &renderer);
    let is_shown = |renderer: &mut Renderer| {
        one_frame(renderer);
        let [after, _] = cubes(&gpu, renderer);
        changes(&before, &after) == [true; 4]
    };
    let needed = (1..10).find(|_| is_shown(&mut renderer));
    println!("{needed:?} frames");
    assert!(needed.is_some_and(|frames| frames <= 2));
}

/// While the domains of a changed sky are on their way, the maps of the old one serve.
#[test]
fn maps_of_the_old_sky_serve_until_the_new_ones_are_made() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = balls();
    let new = |scene: &Scene, budget| {
        let names = ["image-based-lighting".to_owned()];
        let mut renderer = Renderer::new(&gpu, scene, [16, 16], &names).unwrap();
        for (name, value) in [("samples", "8"), ("resolution", "32")] {
            renderer.set("image-based-lighting", name, value).unwrap();
        }
        renderer.set_budget(budget);
        renderer
    };
    let mut renderer = new(&scene, Budget::units(1));
    frames(&mut renderer);
    let before = depths(&gpu, &renderer);
    let mut sky = Environment::default_sky();
    let image = std::sync::Arc::make_mut(&mut sky.image);
    let gpugi_scene::Pixels::Rgba32Float(texels) = &mut image.pixels else {
        panic!("a sky of floats");
    };
    // A quarter turn.
    texels.rotate_left(4 * 64);
    scene.environment = Some(sky);
    renderer.update(&scene).unwrap();
    let readiness = one_frame(&mut renderer);
    assert!(
        matches!(readiness, Readiness::Refining { .. }),
        "{readiness:?}"
    );
    assert!(depths(&gpu, &renderer) == before);
    frames(&mut renderer);
    // Domains start from the earlier ones.
    let mut whole = new(&balls(), Budget::UNLIMITED);
    frames(&mut whole);
    whole.update(&scene).unwrap();
    frames(&mut whole);
    let after = depths(&gpu, &renderer);
    assert!(after != before && after == depths(&gpu, &whole));
}
