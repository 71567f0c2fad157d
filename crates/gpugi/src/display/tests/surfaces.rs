//! Surface points in colours.

use super::*;

/// Words of a surface point that faces +Z, with albedo (1, 0, 0), roughness 0 and the given instance and material.
fn point(instance: u32, material: u32) -> [u32; 12] {
    let red = 24 << 27 | 1;
    [0, 0, 0, 0, 0, 0, red, 0, 0, 0, instance, material]
}

#[test]
fn surface_points_have_the_colours_of_their_quantities() {
    let gpu = gpu!();
    let near = gpu.storage("points", &[point(0, 5), point(1, 5)]).unwrap();
    let far = gpu.storage("points", &[point(u32::MAX, 0)]).unwrap();
    let shown = |quantity: Quantity| -> Vec<[u8; 4]> {
        let surfaces = Surfaces::new(&gpu, [3, 1]).unwrap();
        let display = Display::new(&gpu, [3, 1]).unwrap();
        let mut frame = Frame::new(&gpu, false);
        let parts = [(&near, 2), (&far, 1)];
        let colors = surfaces.record(&mut frame, &parts, quantity).unwrap();
        let settings = Quantity::settings(&plain());
        display.record(&mut frame, &[colors], 1, &settings).unwrap();
        frame.submit().unwrap();
        let pixels = display.pixels(&gpu).unwrap();
        assert_eq!(pixels[8..], [0, 0, 0, 255], "no surface is black");
        pixels.as_chunks::<4>().0.to_vec()
    };
    for quantity in [Quantity::Normal, Quantity::GeometricNormal] {
        let [red, green, blue, _] = shown(quantity)[0];
        assert!((127..=128).contains(&red) && red == green && blue == 255);
    }
    assert_eq!(shown(Quantity::Albedo)[0], [255, 0, 0, 255]);
    assert_eq!(shown(Quantity::Roughness)[0], [0, 0, 0, 255]);
    let objects = shown(Quantity::Objects);
    assert_ne!(objects[0], objects[1]);
    let materials = shown(Quantity::Materials);
    assert_eq!(materials[0], materials[1]);
}

#[test]
fn points_of_a_picture_of_another_size_are_refused() {
    let gpu = gpu!();
    let points = gpu.storage("points", &[point(0, 0)]).unwrap();
    let surfaces = Surfaces::new(&gpu, [2, 1]).unwrap();
    let mut frame = Frame::new(&gpu, false);
    let error = surfaces.record(&mut frame, &[(&points, 1)], Quantity::Normal);
    assert!(error.unwrap_err().to_string().contains("instead of 2"));
}
