//! Pictures beside their references.

use super::*;

/// A picture of 4 x 2 pixels in two strips of radiance 1, summed over two samples, beside a reference.
fn compared(gpu: &Gpu, reference: &[[f32; 3]; 8], shown: Compared) -> Vec<[u8; 4]> {
    let scene = GpuScene::new(gpu, &gpugi_scene::Scene::new("nothing")).unwrap();
    let [half, other] = [0, 1].map(|_| receiver(gpu, &[[2.0; 4]; 4]));
    let strips = [(&half, 0..1), (&other, 1..2)];
    let strips = strips.map(|(receiver, rows)| Strip {
        receiver,
        rows,
        samples: 2,
    });
    let comparison = Comparison::new(gpu, [4, 2]).unwrap();
    comparison.set_reference(gpu, reference.as_flattened());
    let mut picture = Picture::new(gpu, [4, 2]).unwrap();
    let mut frame = Frame::new(gpu, false);
    let shown = Shown::Compared(&comparison, shown);
    picture
        .record(&mut frame, &scene, lit(&strips, 2), shown, &plain())
        .unwrap();
    frame.submit().unwrap();
    let pixels = picture.pixels(gpu).unwrap();
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
    let film = film::radiance_32(&gpu, [2, 2]).unwrap();
    let comparison = Comparison::new(&gpu, [4, 2]).unwrap();
    let mut frame = Frame::new(&gpu, false);
    let error = comparison.record(&mut frame, &film, [2, 2], Compared::Error);
    assert!(error.unwrap_err().to_string().contains("4x2"));
}
