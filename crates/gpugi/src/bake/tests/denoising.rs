//! Texels that paths light, and the filter of their noise.

use gpugi_scene::Environment;

use super::*;

/// A bake by paths.
fn traced(
    gpu: &crate::gpu::Gpu,
    (scene, atlas): (&Scene, &Atlas),
    quantity: Quantity,
    (samples, samples_per_task, denoises): (u32, u32, bool),
) -> LightBake {
    let options = LightOptions {
        quantity,
        samples,
        samples_per_task,
        denoises,
        seed: samples,
        ..LightOptions::default()
    };
    let mut bake =
        LightBake::new(gpu, scene, atlas, &["path-tracing".to_owned()], &options).unwrap();
    bake.set("path-tracing", "bounces", "4").unwrap();
    bake
}

fn lit(mut bake: LightBake) -> LitAtlas {
    take(&mut bake, usize::MAX);
    bake.finish()
}

/// Under a uniform sky of radiance 2, a ball has an irradiance of 2 pi everywhere, and reflects its albedo of it.
#[test]
fn paths_light_texels_in_all_quantities() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::default();
    let mesh = scene.add_mesh(gpugi_scene::builtin::shapes::sphere(1.0, 12));
    let material = gpugi_scene::Material::matt("grey", Vec3::splat(0.5));
    let material = scene.add_material(material);
    scene.add_instance("ball", mesh, material, glam::Mat4::IDENTITY);
    let image = gpugi_scene::Image {
        name: "sky".into(),
        width: 2,
        height: 1,
        pixels: gpugi_scene::Pixels::Rgba32Float([2.0; 8].to_vec()),
    };
    scene.environment = Some(Environment {
        image: std::sync::Arc::new(image),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    let options = AtlasOptions {
        size: SIZE,
        gutter: 1,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    for (quantity, expected) in [
        (Quantity::Irradiance, 2.0),
        (Quantity::Diffuse, 1.0),
        (Quantity::All, 1.0),
    ] {
        for denoises in [false, true] {
            let lit = lit(traced(&gpu, (&scene, &atlas), quantity, (32, 32, denoises)));
            let texels = lit.pages[0].iter().filter(|texel| **texel != Vec3::ZERO);
            let (sum, count) =
                texels.fold((0.0, 0), |(sum, count), texel| (sum + texel.x, count + 1));
            let mean = sum / count as f32;
            assert!((mean / expected - 1.0).abs() < 0.01, "{quantity:?}: {mean}");
        }
    }
}

/// 8 samples filtered have a third of their error left, and what separates walls separates their light.
#[test]
fn the_filter_takes_noise_out_of_texels() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let of = |samples, paths| {
        let mut bake = traced(&gpu, (&scene, &atlas), Quantity::Irradiance, samples);
        bake.set("path-tracing", "samples", paths).unwrap();
        lit(bake)
    };
    let truth = of((9, 9, false), "16");
    let error = |lit: &LitAtlas| {
        let pages = lit.pages.iter().flatten().zip(truth.pages.iter().flatten());
        let squares = pages.map(|(a, b)| (*a - *b).length_squared() / (b.length_squared() + 0.01));
        squares.sum::<f32>()
    };
    let [noisy, filtered] = [false, true].map(|denoises| error(&of((8, 8, denoises), "1")));
    println!("{noisy} to {filtered}");
    assert!(filtered < noisy / 3.0, "{noisy} to {filtered}");
}

/// A denoised bake that is stopped within a task, or consists of tasks that run elsewhere, has the same bits.
#[test]
fn denoised_bakes_go_on_and_merge() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let new = || traced(&gpu, (&scene, &atlas), Quantity::Diffuse, (5, 3, true));
    let whole = lit(new());
    let without = lit(traced(
        &gpu,
        (&scene, &atlas),
        Quantity::Diffuse,
        (5, 3, false),
    ));
    assert!(without.pages != whole.pages);
    let mut stopped = new();
    while stopped.stage() == Stage::Maps {
        stopped.step().unwrap();
    }
    take(&mut stopped, 2);
    let mut other = new();
    other.resume(stopped.save().unwrap()).unwrap();
    assert!(lit(other) == whole);
    let mut merged = new();
    for task in merged.tasks().iter().rev() {
        let part = new().run(task).unwrap();
        merged.merge(part).unwrap();
    }
    assert!(merged.finish() == whole);
}

/// Sums of squares that are missing, or that no samples have.
#[test]
fn unsound_squares_are_refused() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let new = || traced(&gpu, (&scene, &atlas), Quantity::Diffuse, (3, 2, true));
    let texels = (SIZE * SIZE * atlas.pages) as usize;
    let whole = |samples| TexelPart {
        tile: 0,
        samples,
        sums: vec![[1.0; 4]; texels],
        squares: vec![[1.0; 3]; texels],
        leak_map: vec![[0; 4]; texels],
    };
    let state = |part: &TexelPart| LightState {
        done: vec![None],
        unfinished: Some(part.clone()),
        ..LightState::default()
    };
    let sound = whole(0..1);
    new().resume(state(&sound)).unwrap();
    let unsound: [fn(&mut TexelPart); 4] = [
        |part| part.squares.clear(),
        |part| part.squares.truncate(7),
        |part| part.squares[3][1] = f32::NAN,
        |part| part.squares[3][1] = -1.0,
    ];
    for (number, spoil) in unsound.into_iter().enumerate() {
        let mut part = sound.clone();
        spoil(&mut part);
        assert!(new().resume(state(&part)).is_err(), "{number}");
    }
    // The sum of two finite parts.
    let parts = [0..2, 2..3].map(|samples| TexelPart {
        squares: vec![[f32::MAX; 3]; texels],
        ..whole(samples)
    });
    let parts = LightState {
        done: vec![None],
        parts: parts.to_vec(),
        ..LightState::default()
    };
    assert!(new().resume(parts).is_err());
}
