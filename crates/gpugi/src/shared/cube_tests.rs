//! Tests cube texels: direction round trips and solid angles.

use std::f64::consts::PI;

use crate::shader;
use crate::testing::{run_kernel, test_gpu};

#[test]
fn directions_lead_back_and_solid_angles_fill_the_sphere() {
    let Some(gpu) = test_gpu() else { return };
    for size in [1_u32, 2, 5, 64, 256] {
        let texels: Vec<[u32; 4]> = (0..6 * size * size)
            .map(|index| {
                [
                    index % size,
                    index / size % size,
                    index / (size * size),
                    size,
                ]
            })
            .collect();
        let input = gpu.storage("texels", &texels).unwrap();
        let found: Vec<[f32; 4]> = run_kernel(
            &gpu,
            &shader!("testing.cube"),
            "main",
            &[("texels", &input)],
            texels.len(),
            texels.len() as u32,
        )
        .unwrap();
        let center = |texel: u32| (f64::from(texel) + 0.5) * 2.0 / f64::from(size) - 1.0;
        let mut sum = 0.0;
        for (texel, found) in texels.iter().zip(&found) {
            assert_eq!(found[0], texel[2] as f32, "{texel:?}: the face");
            for axis in 0..2 {
                let off = f64::from(found[1 + axis]) - center(texel[axis]);
                assert!(off.abs() < 1e-5, "{texel:?}: {found:?}");
            }
            let exact = solid_angle(*texel);
            let off = f64::from(found[3]) / exact - 1.0;
            assert!(off.abs() < 1e-6, "{texel:?}: {} is not {exact}", found[3]);
            sum += f64::from(found[3]);
        }
        assert!(
            (sum / (4.0 * PI) - 1.0).abs() < 1e-6,
            "{size} texels a side: {sum}"
        );
    }
}

fn solid_angle([x, y, _, size]: [u32; 4]) -> f64 {
    let area = |x: u32, y: u32| {
        let [x, y] = [x, y].map(|edge| 2.0 * f64::from(edge) / f64::from(size) - 1.0);
        (x * y).atan2((x * x + y * y + 1.0).sqrt())
    };
    area(x + 1, y + 1) - area(x, y + 1) - area(x + 1, y) + area(x, y)
}
