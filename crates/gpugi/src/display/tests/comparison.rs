//! Pictures beside their references.

use super::*;

/// A picture of 4 x 2 pixels in two parts of radiance 1, summed over two samples, beside a reference.
fn compared(gpu: &Gpu, reference: &[[f32; 3]; 8], shown: Compared) -> Vec<[u8; 4]> {
    let half = gpu.storage("radiance", &[[2.0_f32; 4]; 4]).unwrap();
    let other = gpu.storage("radiance", &[[2.0_f32; 4]; 4]).unwrap();
    let comparison = Comparison::new(gpu, [4, 2]).unwrap();
    comparison.set_reference(gpu, reference.as_flattened());
    let display = Display::new(gpu, [4, 2]).unwrap();
    let mut frame = Frame::new(gpu, false);
    let parts = [part(&half, 4), part(&other, 4)];
    let whole = comparison.record(&mut frame, &parts, 2, shown).unwrap();
    let settings = shown.settings(&plain());
    display.record(&mut frame, &[whole], 1, &settings).unwrap();
    frame.submit().unwrap();
    let pixels = display.pixels(gpu).unwrap();
    pixels.as_chunks::<4>().0.to_vec()
}

#[test]
fn the_reference_is_to_the_right_of_the_split() {
    let gpu = gpu!();
    let pixels = compared(&gpu, &[[0.0; 3]; 8], Compared::Split(0.75));
    for row in pixels.as_chunks::<4>().0 {
        let red: Vec<u8> = row.iter().map(|pixel| pixel[0]).collect();
        assert_eq!(red, [255, 255, 255, 0]);
    }
}

#[test]
fn errors_have_colours_by_their_decade() {
    let gpu = gpu!();
    let mut reference = [[1.0; 3]; 8];
    // (1 - b)^2 / (b^2 + 0.01) is 1e-2 for the second and about 100 for the last.
    reference[1] = [1.1117; 3];
    reference[7] = [0.0; 3];
    let pixels = compared(&gpu, &reference, Compared::Error);
    assert_eq!(pixels[0], [0, 0, 0, 255]);
    let [red, green, blue, _] = pixels[1].map(i32::from);
    assert!(
        (red - 230).abs() < 5 && green < 50 && blue < 40,
        "{:?}",
        pixels[1]
    );
    assert_eq!(pixels[7], [255; 4]);
}

#[test]
fn light_that_is_too_much_is_red_and_what_is_missing_blue() {
    let gpu = gpu!();
    let mut reference = [[1.0; 3]; 8];
    // (1 - b) / (b + 0.1) is 10 and -0.5.
    reference[1] = [0.0; 3];
    reference[7] = [2.1; 3];
    let pixels = compared(&gpu, &reference, Compared::Leaks);
    assert_eq!(pixels[0], [0, 0, 0, 255]);
    assert_eq!(pixels[1], [255, 0, 0, 255]);
    assert_eq!(pixels[7], [0, 0, 128, 255]);
}

#[test]
fn a_reference_of_another_size_is_refused() {
    let gpu = gpu!();
    let radiance = gpu.storage("radiance", &[[1.0_f32; 4]; 4]).unwrap();
    let comparison = Comparison::new(&gpu, [4, 2]).unwrap();
    let mut frame = Frame::new(&gpu, false);
    let parts = [part(&radiance, 4)];
    let error = comparison.record(&mut frame, &parts, 1, Compared::Error);
    assert!(error.unwrap_err().to_string().contains("8"));
}
