use crate::settings::SettingSet;
use glam::Vec3;
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Atlas, AtlasOptions, Scene};

use super::light::TEXEL_BYTES;
use super::*;
use crate::techniques::obscurances::Settings;
use crate::testing::test_gpu;

const SIZE: u32 = 32;

fn room() -> (Scene, Atlas) {
    let scene = builtin("cornell", 1).unwrap();
    let options = AtlasOptions {
        size: SIZE,
        density: gpugi_scene::TexelDensity::PerMetre(4.0),
        gutter: 1,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    assert!(atlas.pages > 1);
    (scene, atlas)
}

fn names() -> [String; 2] {
    ["shadow-map", "radiosity"].map(str::to_owned)
}

/// A bake with memory for `rows` rows of texels at a time.
fn bake(gpu: &crate::gpu::Gpu, scene: &Scene, atlas: &Atlas, rows: u64) -> LightBake {
    bake_by_tasks(gpu, scene, atlas, rows, 2)
}

fn bake_by_tasks(
    gpu: &crate::gpu::Gpu,
    scene: &Scene,
    atlas: &Atlas,
    rows: u64,
    samples_per_task: u32,
) -> LightBake {
    let options = LightOptions {
        samples: 3,
        samples_per_task,
        memory: rows * u64::from(SIZE) * TEXEL_BYTES,
        ..LightOptions::default()
    };
    let mut bake = LightBake::new(gpu, scene, atlas, &names(), &options).unwrap();
    for (technique, name, value) in [
        ("shadow-map", "area-samples", "4"),
        ("shadow-map", "resolution", "64"),
        ("radiosity", "resolution", "32"),
        ("radiosity", "iterations", "8"),
        ("radiosity", "burn-in", "2"),
    ] {
        bake.set(technique, name, value).unwrap();
    }
    bake
}

/// Takes `steps` steps, or as many as there are; returns how many it took.
fn take(bake: &mut LightBake, steps: usize) -> usize {
    (0..steps)
        .take_while(|_| bake.step().unwrap().is_some())
        .count()
}

/// A bake that resumes from a checkpoint gives the same bits, wherever the first one stopped.
#[test]
fn a_bake_goes_on_as_if_it_had_not_been_stopped() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let mut whole = bake(&gpu, &scene, &atlas, u64::from(SIZE));
    assert_eq!(whole.tiles(), atlas.pages as usize);
    let steps = take(&mut whole, usize::MAX);
    let whole = whole.finish();
    let lit = whole
        .pages
        .iter()
        .flatten()
        .filter(|&&texel| texel != Vec3::ZERO);
    assert!(lit.count() * 2 > whole.pages.len() * (SIZE * SIZE) as usize);
    assert!(whole.leaks.report.invalid > 0);
    // Stop in the maps, within a tile, between two tiles, and in the last tile.
    for stop in [2, 5, 11, 12, 13, steps - 1, steps] {
        let mut stopped = bake(&gpu, &scene, &atlas, u64::from(SIZE));
        assert_eq!(take(&mut stopped, stop), stop);
        let state = stopped.save().unwrap();
        drop(stopped);
        let mut other = bake(&gpu, &scene, &atlas, u64::from(SIZE));
        other.resume(state).unwrap();
        let first = take(&mut other, 1);
        let early = other.save().unwrap();
        let left = first + take(&mut other, usize::MAX);
        println!("stopped after {stop} of {steps} steps, {left} more");
        assert!(other.finish() == whole, "stopped after {stop}");
        // The result must stay the same when the resumed bake stops, too, before it reaches the point where the first
        // one stopped.
        let mut again = bake(&gpu, &scene, &atlas, u64::from(SIZE));
        again.resume(early).unwrap();
        let twice = take(&mut again, usize::MAX);
        assert!(again.finish() == whole, "stopped after {stop}, and again");
        assert!(
            twice <= left + 1,
            "stopped after {stop}: {twice}, not {left}"
        );
        // No work is repeated, except for the step in which the atlas is laid out, and for the frame that finds where
        // texels are.
        assert!(left <= steps - stop + 3, "stopped after {stop}: {left}");
    }
}

mod denoising;
mod merging;

/// Less memory means more tiles but the same light, also beside charts that a tile boundary cuts.
#[test]
fn tiles_are_of_one_picture() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    let lit = |rows| {
        let mut bake = bake(&gpu, &scene, &atlas, rows);
        // With few samples, the light at the edges of lamps would be noise.
        bake.set("shadow-map", "area-samples", "16").unwrap();
        take(&mut bake, usize::MAX);
        (bake.tiles(), bake.finish())
    };
    let (one, whole) = lit(u64::MAX / 1_000_000);
    assert_eq!(one, 1);
    let halo = u64::from(2 * crate::capture::atlas::HALO);
    for (rows, at_once) in [(u64::from(SIZE), SIZE), (5 + halo, 5)] {
        let (tiles, parts) = lit(rows);
        assert_eq!(tiles, (atlas.pages * SIZE).div_ceil(at_once) as usize);
        assert_eq!(parts.leaks, whole.leaks);
        // Compare texels of charts and the empty ones around them, but not texels that lie inside objects: their
        // neighbours' light is never seen.
        let lies_inside = |state: &[u8; 4]| state[0] > state[1];
        let is_covered = |page: &[[u8; 4]], x: i32, y: i32| {
            let side = SIZE as i32;
            let is_inside = (0..side).contains(&x) && (0..side).contains(&y);
            is_inside && page[(y * side + x) as usize][3] > 0
        };
        let mut most: f32 = 0.0;
        let pages = parts.pages.iter().zip(&whole.pages);
        for ((part, whole), states) in pages.zip(&whole.leaks.maps) {
            for (at, (here, there)) in part.iter().zip(whole).enumerate() {
                let (x, y) = (at as i32 % SIZE as i32, at as i32 / SIZE as i32);
                let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
                let mut around = around;
                if !lies_inside(&states[at]) && around.any(|(x, y)| is_covered(states, x, y)) {
                    let off = (*here - *there).abs().max_element();
                    most = most.max(off / (there.max_element() + 0.02));
                }
            }
        }
        println!("{at_once} rows at a time: up to {most} off");
        assert!(most < 0.15, "{at_once} rows at a time: {most}");
    }
}

/// Finished tiles keep nothing on the GPU.
#[test]
fn memory_of_tiles_is_bounded() {
    if test_gpu().is_none() {
        return;
    }
    // A device that no other test allocates from.
    let gpu = crate::gpu::Gpu::open(&crate::gpu::AdapterChoice::Best).unwrap();
    let allocated = || {
        gpu.wait().unwrap();
        let report = gpu.device.generate_allocator_report();
        report.map(|report| report.total_allocated_bytes)
    };
    let scene = builtin("cornell", 1).unwrap();
    let options = AtlasOptions {
        size: 512,
        gutter: 1,
        density: gpugi_scene::TexelDensity::PerMetre(24.0),
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    let rows = 32;
    let memory = rows * u64::from(atlas.size) * TEXEL_BYTES;
    let options = LightOptions {
        samples: 2,
        memory,
        ..LightOptions::default()
    };
    let names = ["environment-map".to_owned()];
    let mut bake = LightBake::new(&gpu, &scene, &atlas, &names, &options).unwrap();
    assert!(bake.tiles() >= 8);
    let mut most = Vec::new();
    while bake.step().unwrap().is_some() {
        // Some adapters do not report allocations.
        let Some(bytes) = allocated() else { return };
        most.push(bytes);
    }
    // Between two samples the tile is allocated; after the second it is not.
    let [least, most] = [most.iter().min(), most.iter().max()].map(|bytes| bytes.unwrap());
    println!("{least} to {most} bytes, {memory} for texels");
    assert!((memory / 2..memory).contains(&(most - least)));
}

#[test]
fn obscurances_go_on_as_if_they_had_not_been_stopped() {
    let Some(gpu) = test_gpu() else { return };
    let (scene, atlas) = room();
    for mode in ["rays", "peeling"] {
        let mut settings = Settings {
            directions: 8,
            ..Settings::default()
        };
        settings.set("mode", mode).unwrap();
        let new = || ObscuranceBake::new(&gpu, &scene, &atlas, &settings, 3).unwrap();
        let mut whole = new();
        let mut steps = 0;
        while whole.step().unwrap().is_some() {
            steps += 1;
        }
        let pages = whole.pages().unwrap();
        for stop in [steps / 2, steps] {
            let mut stopped = new();
            for _ in 0..stop {
                stopped.step().unwrap();
            }
            let state = stopped.save().unwrap();
            let mut other = new();
            other.resume(&state).unwrap();
            let mut left = 0;
            while other.step().unwrap().is_some() {
                left += 1;
            }
            assert_eq!(left, steps - stop, "{mode}");
            assert!(other.pages().unwrap() == pages, "{mode}");
        }
        // The checkpoint of a bake with other settings.
        let fewer = Settings {
            directions: 7,
            ..settings.clone()
        };
        let state = whole.save().unwrap();
        let mut other = ObscuranceBake::new(&gpu, &scene, &atlas, &fewer, 3).unwrap();
        assert!(other.resume(&state).is_err(), "{mode}");
    }
}

#[test]
fn checkpoints_are_believed_only_when_they_are_whole() {
    let (scene, atlas) = room();
    let kept = Checkpoint {
        atlas,
        obscurances: None,
        light: Some(LightState::default()),
        precomputed: None,
    };
    let key = CheckpointKey::new(&[1; 32], "key");
    let whole = kept.to_bytes(&key);
    assert_eq!(Checkpoint::from_bytes(&whole, &key, &scene).unwrap(), kept);
    for other in [
        CheckpointKey::new(&[1; 32], "other"),
        CheckpointKey::new(&[2; 32], "key"),
    ] {
        assert!(matches!(
            Checkpoint::from_bytes(&whole, &other, &scene),
            Err(CheckpointError::OtherBake)
        ));
    }
    let other = builtin("room", 1).unwrap();
    assert!(matches!(
        Checkpoint::from_bytes(&whole, &key, &other),
        Err(CheckpointError::Damaged(_))
    ));
    let refused = |what: &str, bytes: &[u8]| {
        let read = Checkpoint::from_bytes(bytes, &key, &scene);
        assert!(matches!(read, Err(CheckpointError::Damaged(_))), "{what}");
    };
    let places = (0..200).chain((200..whole.len()).step_by(997));
    for at in places {
        let mut bytes = whole.clone();
        bytes[at] ^= 4;
        refused("a flipped bit", &bytes);
        refused("cut off", &whole[..at]);
    }
    refused("longer", &[&whole[..], &[0]].concat());
    // Its checksum is right, but it is no checkpoint.
    for end in [0, 1, 7, whole.len() - 81] {
        let content = &whole[48..][..32 + end];
        let checksum = blake3::hash(content);
        refused(
            "cut off",
            &[&whole[..16], &checksum.as_bytes()[..], content].concat(),
        );
    }
}

/// Caustics improve while radiosity already iterates, and make it begin again: the maps are final all the same,
/// however often the bake is stopped.
#[test]
fn maps_are_final_with_caustics() {
    let Some(gpu) = test_gpu() else { return };
    let (mut scene, _) = room();
    let ball = scene.add_mesh(gpugi_scene::builtin::shapes::sphere(0.2, 12));
    let mirror = gpugi_scene::Material::metal("mirror", Vec3::splat(0.9), 0.0);
    let mirror = scene.add_material(mirror);
    let center = scene.bounds().center();
    scene.add_instance("ball", ball, mirror, glam::Mat4::from_translation(center));
    let options = AtlasOptions {
        size: SIZE,
        gutter: 1,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    let new = || {
        let names = ["shadow-map", "caustics", "radiosity"].map(str::to_owned);
        let options = LightOptions {
            samples: 1,
            ..LightOptions::default()
        };
        let mut bake = LightBake::new(&gpu, &scene, &atlas, &names, &options).unwrap();
        for (technique, name, value) in [
            ("shadow-map", "resolution", "64"),
            ("caustics", "resolution", "32"),
            ("caustics", "cube-resolution", "16"),
            ("caustics", "frames", "8"),
            ("radiosity", "resolution", "32"),
            ("radiosity", "iterations", "16"),
        ] {
            bake.set(technique, name, value).unwrap();
        }
        bake
    };
    let mut whole = new();
    let mut steps = 0;
    let mut done = 0.0;
    while whole.stage() == Stage::Maps {
        done = whole.step().unwrap().unwrap().done;
        steps += 1;
    }
    // Radiosity begins a second time with the last frame of caustics, and no more often.
    assert_eq!(done, 1.0);
    assert!((8 + 15..8 + 20).contains(&steps), "{steps}");
    let maps = whole.save().unwrap().maps;
    take(&mut whole, usize::MAX);
    let whole = whole.finish();
    for stop in [5, 12] {
        let mut stopped = new();
        take(&mut stopped, stop);
        let state = stopped.save().unwrap();
        let mut other = new();
        other.resume(state).unwrap();
        take(&mut other, usize::MAX);
        assert!(other.finish() == whole, "stopped after {stop}");
    }

    // Maps with light that is no number.
    let mut spoilt = maps.clone();
    let light = spoilt.get_mut("radiosity").unwrap();
    for at in (light.len() - 400..light.len()).rev() {
        light[at] = 0xff;
    }
    let mut other = new();
    let part = new().run(&Task::Maps).unwrap();
    other
        .merge(Part {
            result: super::tasks::TaskResult::Maps(spoilt),
            ..part
        })
        .unwrap();
    let refused = (0..steps).any(|_| other.step().is_err());
    assert!(refused);
}
