//! Tests that packed and encoded colours survive a round trip.

use super::*;
use crate::gpu::Shader;

/// Results of `color_test.wesl`: unpacked colour and luminance, and the sRGB round trip.
fn color_round_trips(gpu: &Gpu, colors: &[[f32; 3]]) -> Vec<[[f32; 4]; 2]> {
    let shader: Shader = shader!("picture.color_test");
    let kernel = Kernel::new(gpu, &shader, "round_trips", None).expect("the shader is valid");
    let inputs: Vec<[f32; 4]> = colors.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
    let bytes = inputs.len() as u64 * 32;
    let inputs = gpu.storage("colors", &inputs).expect("it fits");
    let results = gpu
        .buffer("results", bytes, wgpu::BufferUsages::STORAGE)
        .expect("it fits");
    let from = kernel
        .bind(gpu, 1, &[("colors", inputs.as_entire_binding())])
        .expect("it binds");
    let to = kernel
        .bind(gpu, 3, &[("results", results.as_entire_binding())])
        .expect("it binds");
    let mut frame = Frame::new(gpu, false);
    frame.compute("round trips", |pass| {
        kernel.dispatch(pass, &[(1, &from), (3, &to)], [colors.len() as u32, 1, 1]);
    });
    frame.submit().expect("the pass is valid");
    read_buffer(gpu, &results, bytes).expect("results can be read")
}

#[test]
fn packed_colors_keep_nine_bits() {
    let gpu = gpu!();
    let mut colors = ramp();
    // Mantissas that round up to the next exponent, the limits, and values beyond them.
    colors.extend([
        [1.999; 3],
        [0.9999, 0.5, 0.25],
        [511.9, 1.0, 255.8],
        [65_408.0; 3],
        [1e30, 1.0, -1.0],
    ]);
    colors.extend((0..2000).map(|step| {
        let strength = (step as f32 / 70.0 - 15.0).exp2();
        [
            strength,
            strength * (step % 17) as f32 / 17.0,
            strength * (step % 5) as f32 / 4.0,
        ]
    }));
    for (color, [unpacked, _]) in colors.iter().zip(color_round_trips(&gpu, &colors)) {
        let clamped = color.map(|channel| channel.clamp(0.0, 65_408.0));
        let largest = clamped.into_iter().fold(0.0, f32::max);
        let tolerance = (largest / 512.0).max(0.5_f32.powi(25));
        for channel in 0..3 {
            assert_near(
                unpacked[channel].into(),
                clamped[channel].into(),
                tolerance.into(),
                color,
            );
        }
        assert_near(
            unpacked[3].into(),
            twin::luminance(color.map(f64::from)),
            1e-6 * f64::from(color[0].max(color[1]).max(color[2])),
            color,
        );
    }
    let exact = [[0.0; 3], [1.0; 3], [0.5, 0.25, 2.0], [65_408.0, 0.0, 256.0]];
    for (color, [unpacked, _]) in exact.iter().zip(color_round_trips(&gpu, &exact)) {
        assert_eq!(unpacked[..3], *color);
    }
}

#[test]
fn srgb_encoding_has_its_inverse() {
    let gpu = gpu!();
    let mut linear: Vec<_> = (0..=1000).map(|step| [step as f32 / 1000.0; 3]).collect();
    linear.extend([[0.003_130_8; 3], [0.003_13; 3], [0.003_131; 3], [1e-7; 3]]);
    for (color, [_, decoded]) in linear.iter().zip(color_round_trips(&gpu, &linear)) {
        assert_near(decoded[0].into(), color[0].into(), 2e-6, color);
    }
}
