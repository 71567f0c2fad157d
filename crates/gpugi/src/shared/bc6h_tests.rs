//! Tests blocks of BC6H against an independent decoder.

use crate::shader;
use crate::testing::{Random, run_kernel, test_gpu};

type Block = [[f32; 4]; 16];

fn filled(color: impl FnMut(usize) -> [f32; 3]) -> Block {
    let mut color = color;
    std::array::from_fn(|texel| {
        let [r, g, b] = color(texel);
        [r, g, b, 1.0]
    })
}

/// Blocks by kind, and the largest error of each kind: the root of the mean square of the difference, in parts of the
/// brightest channel.
fn cases(random: &mut Random) -> Vec<(&'static str, f32, Vec<Block>)> {
    let mut number = || random.next() as f32;
    let mut even = Vec::new();
    let mut smooth = Vec::new();
    let mut edges = Vec::new();
    let mut noise = Vec::new();
    for _ in 0..200 {
        let scale = 10.0_f32.powf(8.0 * number() - 4.0);
        let color = [0; 3].map(|_| scale * (0.1 + number()));
        even.push(filled(|_| color));
        let slopes = [0; 6].map(|_| 0.1 * (number() - 0.5));
        smooth.push(filled(|texel| {
            let (x, y) = ((texel % 4) as f32, (texel / 4) as f32);
            std::array::from_fn(|c| {
                color[c] * (1.0 + slopes[0] * x + slopes[1] * y + 0.1 * slopes[2 + c] * x)
            })
        }));
        let column = (4.0 * number()) as usize;
        edges.push(filled(|texel| {
            color.map(|value| if texel % 4 < column { 0.0 } else { value })
        }));
        noise.push(filled(|_| color.map(|value| value * number())));
    }
    // Texels that do not exist say nothing.
    let mut holes = smooth.clone();
    for (block, hole) in holes.iter_mut().zip(0..) {
        for (texel, color) in block.iter_mut().enumerate() {
            if (texel + hole) % 3 == 0 {
                *color = [1e4, 0.0, 7.0, 0.0];
            }
        }
    }
    let black = vec![
        [[0.0; 4]; 16],
        filled(|_| [0.0; 3]),
        filled(|_| [6e4, 0.0, 1e-7]),
    ];
    vec![
        ("even", 0.002, even),
        ("smooth", 0.01, smooth),
        ("holes", 0.01, holes),
        ("edges", 0.03, edges),
        // A line does not hold three independent channels.
        ("noise", 0.35, noise),
        ("black", 0.002, black),
    ]
}

#[test]
fn blocks_are_those_of_the_format_and_near_their_colors() {
    let Some(gpu) = test_gpu() else { return };
    let mut modes = [0_u32; 4];
    for (kind, bound, blocks) in cases(&mut Random(1)) {
        let colors = gpu.storage("colours", &blocks.concat()).unwrap();
        let shader = shader!("testing.bc6h");
        let count = blocks.len();
        let output: Vec<[u32; 4]> = run_kernel(
            &gpu,
            &shader,
            "main",
            &[("colors", &colors)],
            17 * count,
            count as u32,
        )
        .unwrap();
        let mut worst = 0.0_f32;
        for (block, output) in blocks.iter().zip(output.chunks(17)) {
            let coded = output[0];
            let mut found = [0.0; 48];
            bcdec_rs::bc6h_float(bytemuck::cast_slice(&coded), &mut found, 12, false);
            modes[(coded[0] as usize & 31) / 4] += 1;
            let (mut sum, mut count, mut brightest) = (0.0, 0.0_f32, 1e-30_f32);
            for ((color, decoded), found) in block.iter().zip(&output[1..]).zip(found.chunks(3)) {
                assert_eq!(
                    decoded[..3],
                    *found
                        .iter()
                        .map(|value| value.to_bits())
                        .collect::<Vec<_>>(),
                    "{kind}: {coded:08x?}"
                );
                if color[3] > 0.0 {
                    for (wanted, found) in color.iter().zip(found) {
                        sum += (wanted - found).powi(2);
                        brightest = brightest.max(*wanted);
                    }
                    count += 3.0;
                }
            }
            worst = worst.max((sum / count.max(1.0)).sqrt() / brightest);
        }
        println!("{kind}: {worst}");
        assert!(worst <= bound, "{kind}: {worst}");
    }
    assert!(modes.iter().all(|count| *count > 0), "{modes:?}");
}
