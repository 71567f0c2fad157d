//! The cache of the environment's maps.

use gpugi_scene::Environment as Sky;

use super::*;
use crate::testing::test_gpu;

#[test]
fn maps_are_shared_filled_in_slices_and_dropped() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = gpugi_scene::Scene::new("sky");
    scene.environment = Some(Sky::default_sky());
    let scene = GpuScene::new(&gpu, &scene).unwrap();
    let mut environments = Environments::default();
    let small = |samples| PrefilteredRequest {
        resolution: 16,
        samples,
        ..PrefilteredRequest::default()
    };
    let of = |environments: &mut Environments, samples| {
        environments
            .of(&gpu, &scene, small(samples))
            .unwrap()
            .clone()
    };
    let first = of(&mut environments, 4);
    assert!(first == of(&mut environments, 4));
    assert!(first != of(&mut environments, 8));
    assert_eq!(environments.len(), 2);
    // One step per frame.
    let (mut frames, mut all) = (1, 0);
    loop {
        environments.begin_frame();
        let mut frame = Frame::new(&gpu, false);
        let mut steps = 0;
        let takes = |work: u64| {
            assert!(work > 0);
            steps += 1;
            steps == 1
        };
        let filled = environments
            .fill(&mut frame, &scene, small(4), takes)
            .unwrap();
        frame.submit().unwrap();
        all += steps.min(1);
        if filled.is_current {
            break;
        }
        frames += 1;
    }
    assert_eq!(frames, all);
    assert!(frames > 5, "{frames}");
    let mut frame = Frame::new(&gpu, false);
    let takes_none = |_| -> bool { panic!("all steps are done") };
    assert!(
        environments
            .fill(&mut frame, &scene, small(4), takes_none)
            .unwrap()
            .is_current
    );
    // Nobody has asked for the others since.
    assert_eq!(environments.len(), 1);
    for _ in 0..4 {
        environments.begin_frame();
    }
    assert_eq!(environments.len(), 0);
    assert!(first != of(&mut environments, 4));
}

/// A sky that changes in every frame must not keep steps from being done.
#[test]
fn maps_of_a_changing_environment_are_filled() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = gpugi_scene::Scene::new("sky");
    scene.environment = Some(Sky::default_sky());
    let mut scene = GpuScene::new(&gpu, &scene).unwrap();
    let mut environments = Environments::default();
    let wanted = PrefilteredRequest {
        resolution: 16,
        samples: 4,
        ..PrefilteredRequest::default()
    };
    let mut fill = |scene: &GpuScene| {
        environments.begin_frame();
        let mut frame = Frame::new(&gpu, false);
        let mut steps = 0;
        let takes_one = |_| {
            steps += 1;
            steps == 1
        };
        let filled = environments.fill(&mut frame, scene, wanted, takes_one);
        frame.submit().unwrap();
        filled.unwrap()
    };
    let mut filled = Filled::default();
    for _ in 0..100 {
        scene.versions.environment += 1;
        filled = fill(&scene);
        assert!(!filled.is_current);
    }
    // What depends on the environment follows each change by itself.
    assert!(filled.is_whole && filled.revision == 0, "{filled:?}");
    for _ in 0..100 {
        filled = fill(&scene);
    }
    assert!(filled.is_current && filled.revision > 0, "{filled:?}");
}
