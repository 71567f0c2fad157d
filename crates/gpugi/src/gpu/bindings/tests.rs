use super::*;
use crate::gpu::{Frame, Kernel, Shader, read_buffer};
use crate::testing::own_test_gpu;

/// Names of which one is the end of another, and one of an imported module.
const PRODUCT: &str = "
@group(0) @binding(0) var<uniform> package_numbers_factor: vec4u;
@group(1) @binding(0) var<storage, read_write> hit_points: array<u32>;
@group(1) @binding(1) var<storage, read> points: array<u32>;

@compute @workgroup_size(1)
fn main() {
    hit_points[0] = package_numbers_factor.x * points[0];
}
";

fn product(gpu: &Gpu) -> Kernel {
    let shader = Shader {
        name: "product",
        source: PRODUCT.into(),
    };
    Kernel::new(gpu, &shader, "main", None).unwrap()
}

fn number(gpu: &Gpu, number: u32) -> wgpu::Buffer {
    gpu.storage("number", &[number; 4]).unwrap()
}

fn run(gpu: &Gpu, kernel: &Kernel, resources: &[Named<'_>]) -> Result<(), GpuError> {
    let mut frame = Frame::new(gpu, false);
    frame.run("product", kernel, None, resources, [1, 1, 1])?;
    frame.submit().map(drop)
}

#[test]
fn passes_bind_what_has_their_names_in_any_group() {
    let Some(gpu) = own_test_gpu() else { return };
    let kernel = product(&gpu);
    let (three, other) = (number(&gpu, 3), number(&gpu, 0));
    let seven = gpu.constant("factor", &[7_u32, 0, 0, 0]).unwrap();
    let named: [Named<'_>; 4] = [
        ("points", &three),
        ("hit_points", &other),
        ("factor", &seven),
        ("what no shader declares", &three),
    ];
    let product = |resources: &[Named<'_>]| {
        gpu.write(&other, 0, &[0_u32; 4]);
        run(&gpu, &kernel, resources).unwrap();
        read_buffer::<u32>(&gpu, &other, 4).unwrap()[0]
    };
    assert_eq!(product(&named), 21);
    let [points, hit_points, factor, rest] = named;
    assert_eq!(product(&[rest, factor, hit_points, points]), 21);
    // The last one of a name counts.
    let five = number(&gpu, 5);
    assert_eq!(product(&join(&named, &[("points", &five)])), 35);
    let two = gpu.constant("factor", &[2_u32, 0, 0, 0]).unwrap();
    assert_eq!(product(&join(&named, &[("factor", &two)])), 6);
    let missing = run(&gpu, &kernel, &[points, hit_points]);
    assert_eq!(
        missing,
        Err(GpuError::Pass {
            pass: "product".into(),
            reason: "nothing is bound to \"package_numbers_factor\"".into(),
        })
    );
}

#[test]
fn groups_are_made_once_and_dropped_when_frames_no_longer_use_them() {
    let Some(gpu) = own_test_gpu() else { return };
    let kernel = product(&gpu);
    let (three, other) = (number(&gpu, 3), number(&gpu, 0));
    let run = |factor: u32| {
        let factor = gpu.constant("factor", &[factor; 4]).unwrap();
        let named: [Named<'_>; 3] = [
            ("points", &three),
            ("hit_points", &other),
            ("factor", &factor),
        ];
        run(&gpu, &kernel, &named).unwrap();
    };
    for _ in 0..3 {
        run(1);
        assert_eq!(gpu.kept_count(), [1, 1]);
    }
    run(2);
    assert_eq!(gpu.kept_count(), [2, 2]);
    for _ in 0..2 * PATIENCE {
        run(2);
    }
    assert_eq!(gpu.kept_count(), [1, 1]);
    // What other frames use stays.
    for _ in 0..2 * PATIENCE {
        run(1);
        run(2);
    }
    assert_eq!(gpu.kept_count(), [2, 2]);
    drop(kernel);
    assert_eq!(gpu.kept_count(), [0, 2]);
}

#[test]
fn large_allocations_find_what_they_replace_gone() {
    let Some(gpu) = own_test_gpu() else { return };
    let kernel = product(&gpu);
    let (three, other) = (number(&gpu, 3), number(&gpu, 0));
    let factor = gpu.uniform("factor", &[1_u32; 4]).unwrap();
    let named: [Named<'_>; 3] = [
        ("points", &three),
        ("hit_points", &other),
        ("factor", &factor),
    ];
    run(&gpu, &kernel, &named).unwrap();
    let storage = wgpu::BufferUsages::STORAGE;
    gpu.buffer("small", LARGE / 2, storage).unwrap();
    assert_eq!(gpu.kept_count(), [1, 0]);
    gpu.buffer("large", LARGE, storage).unwrap();
    assert_eq!(gpu.kept_count(), [0, 0]);
    let mut frame = Frame::new(&gpu, false);
    frame
        .run("product", &kernel, None, &named, [1, 1, 1])
        .unwrap();
    gpu.buffer("large", LARGE, storage).unwrap();
    assert_eq!(gpu.kept_count(), [1, 0]);
    frame.submit().unwrap();
}

#[test]
fn constants_are_shared_by_what_they_hold() {
    let Some(gpu) = own_test_gpu() else { return };
    let of = |values: [u32; 4]| gpu.constant("values", &values).unwrap();
    let [one, same, other] = [[1; 4], [1; 4], [2; 4]].map(of);
    assert_eq!(one, same);
    assert_ne!(one, other);
    assert_eq!(read_buffer::<u32>(&gpu, &other, 16).unwrap(), [2; 4]);
}
