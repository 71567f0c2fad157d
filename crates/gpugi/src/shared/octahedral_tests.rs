//! Tests the 32-bit encoding of unit vectors.

use crate::scene::gpu::octahedral;
use crate::shader;
use crate::testing::{Random, run_kernel, test_gpu};
use glam::{DVec3, Vec3};

fn directions() -> Vec<Vec3> {
    let mut random = Random(1);
    let mut directions: Vec<Vec3> = (0..8192).map(|_| random.direction()).collect();
    // Axes, edges and corners of the octahedron, and both sides of its fold.
    for x in [-1.0, -1e-4, -0.0, 0.0, 1e-4, 1.0] {
        for y in [-1.0, -1e-4, -0.0, 0.0, 1e-4, 1.0] {
            for z in [-1.0, -1e-6, 0.0, 1e-6, 1.0] {
                directions.extend(Vec3::new(x, y, z).try_normalize());
            }
        }
    }
    directions
}

#[test]
fn codes_keep_directions_and_host_and_shader_agree() {
    let Some(gpu) = test_gpu() else { return };
    let directions = directions();
    let input: Vec<[f32; 4]> = directions
        .iter()
        .map(|d| d.extend(0.0).to_array())
        .collect();
    let buffer = gpu.storage("directions", &input).unwrap();
    let count = directions.len();
    let output: Vec<[u32; 4]> = run_kernel(
        &gpu,
        &shader!("testing.octahedral"),
        "main",
        &[("directions", &buffer)],
        count,
        count as u32,
    )
    .unwrap();
    let mut worst: f64 = 0.0;
    for (direction, [code, x, y, z]) in directions.iter().zip(output) {
        let decoded = Vec3::new(f32::from_bits(x), f32::from_bits(y), f32::from_bits(z));
        assert!(
            (decoded.length() - 1.0).abs() < 1e-6,
            "{direction}: {decoded}"
        );
        let (a, b): (DVec3, DVec3) = (direction.as_dvec3(), decoded.as_dvec3());
        worst = worst.max(a.cross(b).length().atan2(a.dot(b)));
        // Rounding of the division may resolve a tie either way, so each number may differ by one step.
        let twin = octahedral(*direction);
        let step = |shift: u32| {
            (i32::from((code >> shift) as i16) - i32::from((twin >> shift) as i16)).abs()
        };
        assert!(
            step(0) <= 1 && step(16) <= 1,
            "{direction}: shader {code:08x}, host {twin:08x}"
        );
    }
    // Cigolle et al. 2014, table 2: oct32 errs by at most 0.0037 degrees.
    assert!(
        worst.to_degrees() < 0.0038,
        "largest error {} degrees",
        worst.to_degrees()
    );
}
