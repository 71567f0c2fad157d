//! Bakes as tasks.

use std::fmt::Debug;

use gpugi_scene::Material;

use super::super::tasks::TaskResult;
use super::*;
use crate::gpu::{AdapterChoice, Gpu};
use crate::lighting::LightingError;

/// The value after a way through text, as between processes.
fn sent<T: serde::Serialize + serde::de::DeserializeOwned>(value: &T) -> T {
    let text = serde_json::to_string(value).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Tasks that run on two GPUs, in another order than those of the plain bake, merge to the same bits. `new` makes a
/// bake on one of the GPUs; `other`: one that has the same tasks, but must not take their results.
fn merges<B: Bake, R: PartialEq + Debug>(
    new: impl Fn(usize) -> B,
    other: B,
    finish: impl Fn(B) -> R,
) {
    let mut plain = new(0);
    while plain.step().unwrap().is_some() {}
    assert!(plain.is_complete());
    let plain = finish(plain);

    let mut merged = new(0);
    let mut other = other;
    let tasks = merged.tasks();
    assert_eq!(other.tasks(), tasks);
    let mut workers = [0, 1].map(&new);
    let has_maps = tasks[0] == Task::Maps;
    if has_maps {
        let maps = workers[0].run(&sent(&tasks[0])).unwrap();
        workers[1].merge(sent(&maps)).unwrap();
        assert!(other.merge(maps).is_err());
    }
    let tasks = &tasks[usize::from(has_maps)..];
    assert!(tasks.len() > 4, "{tasks:?}");
    let mut parts = Vec::new();
    for (number, task) in tasks.iter().enumerate().rev() {
        parts.push(workers[number % 2].run(&sent(task)).unwrap());
    }
    // Odd ones first.
    let (odd, even) = (parts.iter().skip(1).step_by(2), parts.iter().step_by(2));
    for part in odd.chain(even) {
        assert!(!merged.is_complete());
        merged.merge(sent(part)).unwrap();
        // Again, as if a task had been given to two workers.
        merged.merge(sent(part)).unwrap();
        assert!(other.merge(sent(part)).is_err());
    }
    assert!(merged.is_complete());
    assert!(finish(merged) == plain);

    // The plain bake goes on where merged results leave gaps.
    let mut half = new(0);
    for part in parts.iter().step_by(3) {
        half.merge(sent(part)).unwrap();
    }
    while half.step().unwrap().is_some() {}
    assert!(finish(half) == plain);

    // Workers kept nothing of what they ran for others.
    let [mut worker, _] = workers;
    assert!(!worker.is_complete());
    while worker.step().unwrap().is_some() {}
    assert!(finish(worker) == plain);

    let mut bake = new(0);
    for (tile, samples) in [(u32::MAX, 0..1), (0, 1..1), (0, 0..u32::MAX)] {
        assert!(bake.run(&Task::Samples { tile, samples }).is_err());
    }
}

fn two_gpus() -> Option<[Gpu; 2]> {
    Some([test_gpu()?, Gpu::open(&AdapterChoice::Best).unwrap()])
}

/// The room with a darker wall.
fn other_room(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.materials[0].base_color *= 0.5;
    scene
}

#[test]
fn light_merges_to_the_same_bits() {
    let Some(gpus) = two_gpus() else { return };
    let (scene, atlas) = room();
    // The sum of three depends on the order.
    let new = |gpu: usize| bake_by_tasks(&gpus[gpu], &scene, &atlas, u64::from(SIZE), 1);
    let mut other = new(0);
    other.set("radiosity", "iterations", "9").unwrap();
    merges(new, other, LightBake::finish);
}

#[test]
fn obscurances_merge_to_the_same_bits() {
    let Some(gpus) = two_gpus() else { return };
    let (scene, atlas) = room();
    let other_scene = other_room(&scene);
    for mode in ["rays", "peeling"] {
        let mut settings = Settings {
            directions: 16,
            ..Settings::default()
        };
        settings.set("mode", mode).unwrap();
        let new =
            |gpu: usize| ObscuranceBake::new(&gpus[gpu], &scene, &atlas, &settings, 3).unwrap();
        let other = ObscuranceBake::new(&gpus[0], &other_scene, &atlas, &settings, 3).unwrap();
        merges(new, other, |mut bake| bake.pages().unwrap());
    }
}

#[test]
fn volumes_merge_to_the_same_bits() {
    let Some(gpus) = two_gpus() else { return };
    let (scene, _) = room();
    let other_scene = other_room(&scene);
    let names = ["shadow-map", "final-gather"].map(str::to_owned);
    let light = VolumeLight {
        names: &names,
        settings: &[
            ["shadow-map", "area-samples", "4"],
            ["shadow-map", "resolution", "64"],
            ["shadow-map", "area-resolution", "64"],
            ["final-gather", "density", "0.5"],
            ["final-gather", "size", "2"],
            ["final-gather", "resolution", "16"],
        ],
        adds: "final-gather",
    };
    let bake = |gpu: usize, scene| VolumeBake::new(&gpus[gpu], scene, &light, 1.5, 5).unwrap();
    let of_other = bake(0, &other_scene);
    merges(
        |gpu| bake(gpu, &scene),
        of_other,
        VolumeBake::<IrradianceVolume>::finish,
    );
    let of_other = VolumeBake::new(&gpus[0], &other_scene, &light, 1.5, 5).unwrap();
    let new = |gpu: usize| VolumeBake::new(&gpus[gpu], &scene, &light, 1.5, 5).unwrap();
    merges(new, of_other, VolumeBake::<HarmonicVolume>::finish);
}

/// Spoils a sound part in several ways, none of which is accepted.
fn refuses<B: Bake>(
    bake: &mut B,
    part: &Part<B::Samples>,
    unsound: &[fn(&mut B::Samples)],
) -> Result<(), LightingError> {
    let spoilt = |spoil: fn(&mut B::Samples)| {
        let mut part = part.clone();
        let TaskResult::Samples(samples) = &mut part.result else {
            panic!("maps");
        };
        spoil(samples);
        part
    };
    for (number, spoil) in unsound.iter().enumerate() {
        assert!(bake.merge(spoilt(*spoil)).is_err(), "{number}");
    }
    bake.merge(part.clone())
}

#[test]
fn unsound_light_is_refused() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let mut bake = bake(&gpu, &scene, &atlas, u64::from(SIZE));
    let texels = (SIZE * SIZE) as usize;
    let sound = TexelPart {
        tile: 1,
        samples: 2..3,
        sums: vec![[1.0; 4]; texels],
        squares: Vec::new(),
        leak_map: vec![[0; 4]; texels],
    };
    let unsound: [fn(&mut TexelPart); 10] = [
        |part| part.tile = 1000,
        |part| part.tile = u32::MAX,
        |part| part.samples = 1..3,
        |part| part.samples = 2..2,
        |part| part.sums.truncate(7),
        |part| part.leak_map.clear(),
        |part| part.sums[3][1] = f32::NAN,
        |part| part.sums[3][3] = -1.0,
        |part| part.sums[3][3] = 2.0,
        |part| part.squares = vec![[1.0; 3]; part.sums.len()],
    ];
    let tiles = bake.tiles();
    for (number, spoil) in unsound.into_iter().enumerate() {
        let mut part = sound.clone();
        spoil(&mut part);
        let state = LightState {
            done: vec![None; tiles],
            parts: vec![part],
            ..LightState::default()
        };
        assert!(bake.resume(state).is_err(), "{number}");
    }
    assert!(bake.resume(LightState::default()).is_err());
    let of_bake = bake.key();
    let part = |part: &TexelPart| Part {
        bake: of_bake,
        result: TaskResult::Samples(part.clone()),
    };
    // The sum of two finite parts.
    let other = TexelPart {
        tile: 0,
        samples: 0..2,
        sums: vec![[f32::MAX, 0.0, 0.0, 1.0]; texels],
        ..sound.clone()
    };
    let more = TexelPart {
        samples: 2..3,
        ..other.clone()
    };
    bake.merge(part(&other)).unwrap();
    assert!(bake.merge(part(&more)).is_err());
    refuses(&mut bake, &part(&sound), &unsound).unwrap();
}

#[test]
fn unsound_obscurances_are_refused() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let settings = Settings {
        directions: 4,
        ..Settings::default()
    };
    let mut bake = ObscuranceBake::new(&gpu, &scene, &atlas, &settings, 2).unwrap();
    let part = bake.run(&bake.tasks()[0]).unwrap();
    let unsound: [fn(&mut ObscurancePart); 8] = [
        |part| part.tile = u32::MAX,
        |part| part.samples = 1..3,
        |part| part.samples = 2..2,
        |part| part.sums.truncate(7),
        |part| part.sums[3][0] = u32::MAX,
        |part| part.sums[3] = [1, 2, 0, 0, 0, 0, 0, 0, 0],
        |part| part.sums[3] = [2, 1, 0, 0, u32::MAX, 0, 0, 0, 0],
        |part| part.sums[3] = [2, 1, 0, 0, 0, 0, 0, 0, 65_536],
    ];
    refuses(&mut bake, &part, &unsound).unwrap();
    assert!(bake.run(&Task::Maps).is_err());
}

#[test]
fn unsound_volumes_are_refused() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("plate");
    let mesh = scene.add_mesh(gpugi_scene::builtin::shapes::cuboid(
        Vec3::ZERO,
        Vec3::ONE,
        1,
    ));
    let material = scene.add_material(Material::matt("plate", Vec3::ONE));
    scene.add_instance("plate", mesh, material, glam::Mat4::IDENTITY);
    let names = ["shadow-map".to_owned()];
    let light = VolumeLight {
        names: &names,
        settings: &[],
        adds: "shadow-map",
    };
    let mut bake = VolumeBake::<IrradianceVolume>::new(&gpu, &scene, &light, 2.0, 3).unwrap();
    let part = bake.run(&bake.tasks()[2]).unwrap();
    let unsound: [fn(&mut VoxelPart); 4] = [
        |part| part.tile = u32::MAX,
        |part| part.tile = 2,
        |part| part.irradiance.truncate(7),
        |part| part.irradiance[1].y = f32::NAN,
    ];
    refuses(&mut bake, &part, &unsound).unwrap();
}
