use super::*;
use crate::gpu::Kernel;
use crate::testing::test_gpu;

type Made = Stage<u32, String>;

fn keep(stage: &mut Made, key: u32) -> String {
    let made = stage.keep(key, |before| {
        let before = before.unwrap_or_default();
        Ok::<_, GpuError>(format!("{before}{key}"))
    });
    made.unwrap().clone()
}

fn failure() -> GpuError {
    GpuError::Input { what: "it".into() }
}

#[test]
fn the_same_inputs_keep_and_others_make() {
    let mut stage = Made::default();
    assert_eq!(stage.get(), None);
    assert_eq!(keep(&mut stage, 1), "1");
    assert_eq!(keep(&mut stage, 1), "1");
    assert_eq!(keep(&mut stage, 2), "12");
    stage.clear();
    assert_eq!(stage.get(), None);
    assert_eq!(keep(&mut stage, 2), "2");
}

#[test]
fn what_fails_is_not_kept() {
    let mut stage = Made::default();
    keep(&mut stage, 1);
    assert_eq!(stage.keep(2, |_| Err(failure())), Err(failure()));
    assert_eq!(stage.get(), None);
    assert!(!stage.is_current());
    assert_eq!(keep(&mut stage, 2), "2");
    stage.keep(1, |_| Err(failure())).unwrap_err();
    assert_eq!(keep(&mut stage, 2), "2");
}

#[test]
fn what_compiles_shaders_waits_for_them_once() {
    let Some(gpu) = test_gpu() else { return };
    // Each question whether it is compiling compiles one pipeline.
    let gpu = gpu.as_in_a_browser();
    let compile = |_| {
        let shader = crate::shader!("capture.attenuation");
        Kernel::new(&gpu, &shader, "main", None)?;
        Kernel::new(&gpu, &crate::shader!("scene.refit"), "main", None)?;
        Ok(())
    };
    let mut stage = Stage::default();
    let frame = Frame::without_waiting(&gpu, false);
    let waits = Err(Unready::waits_for("shaders"));
    assert_eq!(stage.compiled(&frame, 1, compile).map(drop), waits);
    // It was made all the same, and is not made again.
    assert_eq!(stage.compiled(&frame, 1, |_| Err(failure())), Ok(&mut ()));
    while gpu.is_compiling() {}
    let frame = Frame::new(&gpu, false);
    assert_eq!(stage.compiled(&frame, 2, compile), Ok(&mut ()));
    while gpu.is_compiling() {}
}

#[test]
fn work_goes_on_with_what_it_has_begun() {
    let mut stage = Stage::<u32>::default();
    assert!(!stage.is_current());
    assert!(stage.ask(1));
    assert!(!stage.is_current());
    stage.begin();
    assert!(stage.is_current());
    assert!(!stage.ask(1));
    assert!(stage.ask(2));
    assert!(!stage.is_current());
    assert_eq!(stage.begun(), Some(&1));
    assert!(stage.ask(1) && stage.is_current());
    assert!(stage.ask(2));
    stage.begin();
    assert_eq!(stage.begun(), Some(&2));
    stage.restart();
    assert!(!stage.ask(2) && !stage.is_current());
}

#[test]
fn revisions_count_what_users_would_not_notice() {
    let mut stage = Stage::<u32>::default();
    stage.ask(1);
    stage.begin();
    stage.improve();
    assert_eq!(stage.revision(), 0);
    stage.ask(1);
    stage.improve();
    assert_eq!(stage.revision(), 1);
    // Users follow the change, although the work does not yet.
    stage.ask(2);
    stage.improve();
    assert_eq!(stage.revision(), 1);
    stage.ask(2);
    stage.improve();
    assert_eq!(stage.revision(), 2);
    stage.set_revision(u64::MAX);
    stage.improve();
    assert_eq!(stage.revision(), 1 << 32);
}

#[test]
fn stale_work_is_never_complete() {
    let mut stage = Stage::<u32>::default();
    stage.ask(1);
    assert_eq!(stage.progress(4, 4), 0.8);
    stage.begin();
    assert_eq!(stage.progress(2, 4), 0.5);
    assert_eq!(stage.progress(4, 4), 1.0);
    stage.ask(2);
    assert_eq!(stage.progress(4, 4), 0.8);
}
