//! Image metrics: hand-computed cases, invariants, and values of other implementations.

use std::io::Cursor;

use gpugi_scene::Limits;
use gpugi_scene::image::metrics::{
    Comparison, Metric, MetricError, Picture, compare, decode_picture, heat_map, rel_mse,
};
use image::{DynamicImage, ImageFormat, Rgb, Rgb32FImage, RgbImage};

const WIDTH: u32 = 48;
const HEIGHT: u32 = 32;

fn radiance(width: u32, height: u32, rgb: &[f32]) -> Picture {
    Picture::of_radiance(width, height, rgb.to_vec()).expect("finite values")
}

fn decoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Picture {
    let mut bytes = Cursor::new(Vec::new());
    image
        .into()
        .write_to(&mut bytes, format)
        .expect("a picture");
    decode_picture("picture", &bytes.into_inner(), &Limits::default()).expect("a picture")
}

/// A PNG of the given sRGB bytes.
fn display(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Picture {
    let image = RgbImage::from_fn(width, height, |x, y| Rgb(pixel(x, y)));
    decoded(image, ImageFormat::Png)
}

fn value(metric: Metric, test: &Picture, reference: &Picture) -> f64 {
    result(metric, test, reference).value
}

fn result(metric: Metric, test: &Picture, reference: &Picture) -> Comparison {
    compare(metric, test, reference).expect("pictures that can be compared")
}

fn parameter(result: &Comparison, name: &str) -> f64 {
    let found = result.parameters.iter().find(|(key, _)| *key == name);
    found.expect("the parameter").1
}

#[track_caller]
fn assert_close(value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{value}, expected {expected}"
    );
}

/// Gradients, squares, noise and a bright patch, as sRGB bytes: a test picture and its reference.
fn display_pair() -> (Picture, Picture) {
    let reference = |x: u32, y: u32| [5 * x, 8 * y, (x / 6 + y / 6) % 2 * 200];
    let test = |x: u32, y: u32| {
        if (30..36).contains(&x) && (10..16).contains(&y) {
            return [255; 3];
        }
        [0, 1, 2].map(|channel| {
            let noise = (37 * x + 91 * y + 53 * channel) % 41;
            (reference(x, y)[channel as usize] + noise)
                .saturating_sub(20)
                .min(255) as u8
        })
    };
    (
        display(WIDTH, HEIGHT, test),
        display(WIDTH, HEIGHT, |x, y| reference(x, y).map(|v| v as u8)),
    )
}

/// Radiance over a range of 11 EV with up to 20% of noise: a test picture and its reference.
fn radiance_pair() -> (Picture, Picture) {
    let (mut test, mut reference) = (Vec::new(), Vec::new());
    for (y, x) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (y, x))) {
        for channel in 0..3 {
            let pattern = (1 + (7 * x + 13 * y + 31 * channel) % 17) as f32;
            let noise = ((37 * x + 91 * y + 53 * channel) % 41) as f32 - 20.0;
            let value = pattern * f32::powi(2.0, (x / 8) as i32 - 3);
            reference.push(value);
            test.push(value * (1.0 + noise / 100.0));
        }
    }
    (
        radiance(WIDTH, HEIGHT, &test),
        radiance(WIDTH, HEIGHT, &reference),
    )
}

#[test]
fn relative_errors_by_hand() {
    let (test, reference) = (
        [1.0, 0.0, 0.5, 0.1, 0.0, 0.0],
        [0.5, 0.0, 0.5, 0.0, 0.0, 3.0],
    );
    let first = 0.25 / 0.26;
    let (second, third) = (0.01 / 0.01, 9.0 / 9.01);
    let expected = (first + second + third) / 6.0;
    assert_close(rel_mse(test.into_iter().zip(reference)), expected, 1e-7);
    let result = result(
        Metric::RelMse,
        &radiance(2, 1, &test),
        &radiance(2, 1, &reference),
    );
    assert_close(result.value, expected, 1e-7);
    assert_close(parameter(&result, "epsilon"), 0.01, 0.0);
    assert_close(f64::from(result.map[0]).powi(2), first / 3.0, 1e-6);
    assert_close(
        f64::from(result.map[1]).powi(2),
        (second + third) / 3.0,
        1e-6,
    );
}

#[test]
fn blocks_average_noise_before_they_compare() {
    // A block of 4x4 pixels and one of 1x4, each of mean 1; then the second is 1.5 everywhere.
    let noisy = |second: f32| {
        let pixels = (0..20).map(|at| match (at % 5, at / 5) {
            (4, y) => second + if y % 2 == 0 { 0.5 } else { -0.5 },
            (x, y) => 1.0 + if (x + y) % 2 == 0 { 0.25 } else { -0.25 },
        });
        radiance(5, 4, &pixels.flat_map(|v| [v; 3]).collect::<Vec<_>>())
    };
    let even = radiance(5, 4, &[1.0; 60]);
    assert_close(value(Metric::RelMse4, &noisy(1.0), &even), 0.0, 1e-12);
    assert!(value(Metric::RelMse, &noisy(1.0), &even) > 0.05);
    let result = result(Metric::RelMse4, &noisy(1.5), &even);
    // Blocks count alike, however many pixels they hold.
    assert_close(result.value, 0.25 / 1.01 / 2.0, 1e-7);
    for (at, &error) in result.map.iter().enumerate() {
        let expected = if at % 5 == 4 { 0.25 / 1.01 } else { 0.0 };
        assert_close(f64::from(error).powi(2), expected, 1e-6);
    }
    // The fifth row is a block of its own.
    let mut low = [1.0; 60];
    low[48..].fill(2.0);
    let map = self::result(
        Metric::RelMse4,
        &radiance(4, 5, &low),
        &radiance(4, 5, &[1.0; 60]),
    )
    .map;
    assert!(map[..16].iter().all(|&e| e == 0.0) && map[16..].iter().all(|&e| e > 0.9));
}

#[test]
fn peaks_are_1_for_displays_and_the_largest_radiance_otherwise() {
    let (test, reference) = (
        display(3, 2, |_, _| [102; 3]),
        display(3, 2, |_, _| [51; 3]),
    );
    assert_close(value(Metric::Rmse, &test, &reference), 0.2, 1e-6);
    let psnr = result(Metric::Psnr, &test, &reference);
    assert_close(psnr.value, 13.9794, 1e-4);
    assert_close(parameter(&psnr, "peak"), 1.0, 0.0);

    let (test, reference) = (
        radiance(2, 1, &[1.0, 2.0, 3.0, 4.0, 5.0, 2.0]),
        radiance(2, 1, &[1.0, 2.0, 3.0, 4.0, 8.0, 6.0]),
    );
    let rmse = (25.0_f64 / 6.0).sqrt();
    assert_close(value(Metric::Rmse, &test, &reference), rmse, 1e-7);
    let psnr = result(Metric::Psnr, &test, &reference);
    assert_close(psnr.value, 20.0 * (8.0 / rmse).log10(), 1e-6);
    assert_close(parameter(&psnr, "peak"), 8.0, 0.0);
}

#[test]
fn a_display_picture_beside_radiance_is_linearised() {
    let grey = display(12, 12, |_, _| [188; 3]);
    let linear = ((188.0_f32 / 255.0 + 0.055) / 1.055).powf(2.4);
    let same = radiance(12, 12, &[linear; 432]);
    for metric in Metric::ALL {
        let perfect = if metric == Metric::Ssim { 1.0 } else { 0.0 };
        if metric == Metric::Psnr {
            assert!(value(metric, &grey, &same) > 100.0);
        } else {
            assert_close(value(metric, &grey, &same), perfect, 1e-3);
        }
    }
    // Compared as radiance: the peak is the reference's.
    let psnr = result(Metric::Psnr, &grey, &radiance(12, 12, &[2.0; 432]));
    assert_close(parameter(&psnr, "peak"), 2.0, 0.0);
}

#[test]
fn equal_pictures_have_no_error() {
    for (_, picture) in [display_pair(), radiance_pair()] {
        for metric in Metric::ALL {
            let result = result(metric, &picture, &picture);
            let perfect = match metric {
                Metric::Psnr => f64::INFINITY,
                Metric::Ssim => 1.0,
                _ => 0.0,
            };
            assert_eq!(result.value, perfect, "{}", metric.name());
            assert!(result.map.iter().all(|&error| error == 0.0));
        }
    }
}

#[test]
fn only_some_metrics_are_symmetric() {
    let both = |metric, (a, b): &(Picture, Picture)| (value(metric, a, b), value(metric, b, a));
    let (shown, radiance) = (display_pair(), radiance_pair());
    for metric in [Metric::Rmse, Metric::Ssim, Metric::Psnr, Metric::Flip] {
        let (there, back) = both(metric, &shown);
        assert_close(there, back, 1e-6);
    }
    for metric in [Metric::RelMse, Metric::RelMse4] {
        let (there, back) = both(metric, &shown);
        assert!((there - back).abs() > 0.01 * back, "{}", metric.name());
    }
    // The reference of radiance also sets the peak and the exposures.
    for metric in [Metric::Psnr, Metric::Flip] {
        let (there, back) = both(metric, &radiance);
        assert!((there - back).abs() > 1e-4 * back, "{}", metric.name());
    }
}

/// Values of scikit-image 0.26: `structural_similarity(a, b, gaussian_weights=True, sigma=1.5,
/// use_sample_covariance=False, data_range=1)` on luma.
#[test]
fn ssim_agrees_with_scikit_image() {
    let (test, reference) = display_pair();
    assert_close(value(Metric::Ssim, &test, &reference), 0.692464, 2e-6);
}

#[test]
fn ssim_by_hand() {
    // Without variance only the means count: (2 a b + c1) / (a^2 + b^2 + c1).
    let (test, reference) = (
        display(11, 11, |_, _| [51; 3]),
        display(11, 11, |_, _| [102; 3]),
    );
    let expected = (2.0 * 0.2 * 0.4 + 1e-4) / (0.04 + 0.16 + 1e-4);
    assert_close(value(Metric::Ssim, &test, &reference), expected, 1e-5);
    // Radiance is exposed so that its geometric mean shows as middle grey, which is 0.4613 in sRGB.
    let (test, reference) = (radiance(11, 11, &[0.0; 363]), radiance(11, 11, &[7.0; 363]));
    let result = result(Metric::Ssim, &test, &reference);
    assert_close(
        parameter(&result, "exposure"),
        (0.18_f64 / 7.0).log2(),
        1e-5,
    );
    assert_close(result.value, 1e-4 / (0.4613_f64.powi(2) + 1e-4), 1e-5);
}

#[test]
fn flip_by_hand() {
    let one = |color| display(1, 1, move |_, _| color);
    let flip = |a, b| value(Metric::Flip, &one(a), &one(b));
    // Green and blue are as far apart as colours get.
    assert_close(flip([0, 255, 0], [0, 0, 255]), 1.0, 1e-5);
    // Lightness 100 apart: 100^0.7 = 25.119 of the largest 41.279.
    let knee = 0.4 * 41.279;
    let expected = 0.95 + 0.05 * (25.119 - knee) / (41.279 - knee);
    assert_close(flip([255; 3], [0; 3]), expected, 1e-4);
}

/// Values of NVIDIA's flip-evaluator 1.7 at its default 67 pixels per degree.
#[test]
fn flip_agrees_with_its_authors_implementation() {
    let (test, reference) = display_pair();
    let result = result(Metric::Flip, &test, &reference);
    assert_close(result.value, 0.145248, 2e-5);
    for (x, y, expected) in [
        (33, 13, 0.987952),
        (0, 0, 0.027376),
        (47, 31, 0.188725),
        (5, 20, 0.081582),
    ] {
        let error = result.map[y * WIDTH as usize + x];
        assert_close(f64::from(error), expected, 1e-4);
    }
}

/// Values of NVIDIA's flip-evaluator 1.7.
#[test]
fn hdr_flip_agrees_with_its_authors_implementation() {
    let (test, reference) = radiance_pair();
    let result = result(Metric::Flip, &test, &reference);
    assert_close(result.value, 0.0703376, 2e-5);
    assert_close(parameter(&result, "start_exposure"), -4.766822, 1e-4);
    assert_close(parameter(&result, "stop_exposure"), -1.430345, 1e-4);
    assert_close(parameter(&result, "exposures"), 4.0, 0.0);
    for (x, y, expected) in [
        (33, 13, 0.021232),
        (0, 0, 0.153193),
        (47, 31, 0.076661),
        (5, 20, 0.033352),
    ] {
        let error = result.map[y * WIDTH as usize + x];
        assert_close(f64::from(error), expected, 1e-4);
    }
}

#[test]
fn any_finite_values_have_finite_errors() {
    let black = radiance(12, 12, &[0.0; 432]);
    let huge = radiance(12, 12, &[f32::MAX; 432]);
    let negative = radiance(12, 12, &[-1e30; 432]);
    let mut spot = vec![0.0; 432];
    spot[7] = f32::MIN_POSITIVE;
    spot[200] = 1e20;
    let spot = radiance(12, 12, &spot);
    for test in [&black, &huge, &negative, &spot] {
        for reference in [&black, &huge, &negative, &spot] {
            for metric in Metric::ALL {
                let result = result(metric, test, reference);
                let name = metric.name();
                let infinite = metric == Metric::Psnr && test == reference;
                assert!(
                    result.value.is_finite() || infinite,
                    "{name}: {}",
                    result.value
                );
                assert!(result.map.iter().all(|error| !error.is_nan()), "{name}");
            }
        }
    }
}

#[test]
fn a_reference_mostly_black_is_exposed_for_the_rest() {
    let with_black = |value: f32| {
        let mut rgb = vec![0.0; 3 * 64];
        rgb[..30].fill(value);
        radiance(8, 8, &rgb)
    };
    let result = result(Metric::Flip, &with_black(4.1), &with_black(4.0));
    let shown = parameter(&result, "start_exposure");
    assert_close(parameter(&result, "stop_exposure"), shown, 1e-6);
    assert!(result.value > 0.0);
}

#[test]
fn what_cannot_be_compared_says_why() {
    let (small, wide) = (radiance(2, 2, &[1.0; 12]), radiance(3, 2, &[1.0; 18]));
    for metric in Metric::ALL {
        let error = compare(metric, &small, &wide).expect_err("different sizes");
        assert!(error.to_string().contains("2x2") && error.to_string().contains("3x2"));
    }
    assert_eq!(
        compare(Metric::Ssim, &small, &small),
        Err(MetricError::TooSmall)
    );
    let error = Picture::of_radiance(2, 1, vec![0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0]);
    assert!(error.expect_err("not a number").contains("(1, 0)"));
}

#[test]
fn files_keep_what_they_hold() {
    let texels = [[-0.5, 0.0, 70000.0], [1.0, 2.0, 3.0]];
    let exr = Rgb32FImage::from_fn(2, 1, |x, _| Rgb(texels[x as usize]));
    let picture = decoded(exr, ImageFormat::OpenExr);
    assert!(!picture.is_display_referred());
    let flat = texels.as_flattened();
    assert_eq!(picture, radiance(2, 1, flat));
    assert!(display(2, 1, |_, _| [1; 3]).is_display_referred());
}

#[test]
fn bounds_know_which_way_is_better() {
    assert!(Metric::RelMse.within(0.1, 0.1) && !Metric::RelMse.within(0.2, 0.1));
    assert!(Metric::Psnr.within(40.0, 30.0) && !Metric::Psnr.within(20.0, 30.0));
    assert!(Metric::Ssim.within(1.0, 0.9) && !Metric::Ssim.within(0.8, 0.9));
    // What is not a number keeps to no bound.
    assert!(
        Metric::ALL
            .iter()
            .all(|metric| !metric.within(f64::NAN, 1.0))
    );
}

#[test]
fn heat_maps_brighten_with_the_error() {
    let brightness = |color: &[u8; 4]| color[..3].iter().map(|&v| u32::from(v)).sum::<u32>();
    for (metric, errors) in [
        (
            Metric::Flip,
            [0.0, 0.25, 0.5, 0.75, 1.0, 9.0, f32::INFINITY],
        ),
        (
            Metric::RelMse,
            [0.0, 0.003, 0.03, 0.3, 1.0, 9.0, f32::INFINITY],
        ),
    ] {
        let colors = heat_map(metric, &errors);
        let (colors, _) = colors.as_chunks::<4>();
        assert!(brightness(&colors[0]) < 10);
        let rises = |pair: &[[u8; 4]]| brightness(&pair[0]) + 50 < brightness(&pair[1]);
        assert!(colors[..5].windows(2).all(rises), "{colors:?}");
        assert_eq!(colors[4], colors[5]);
        assert_eq!(colors[4], colors[6]);
        assert!(colors.iter().all(|color| color[3] == 255));
    }
}
