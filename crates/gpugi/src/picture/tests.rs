//! Compares the display on the GPU with formulas in double precision, and checks what an image must never show.

use super::effects::tone_map::twin;
use super::*;
use crate::capture::{Output, Receiver, Slots, SurfacePoints, Target};
use crate::gpu::{AdapterChoice, Kernel};
use crate::shader;

/// The best adapter. `None` only if GPUGI_SKIP_GPU=1 allows it.
fn open() -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::Best) {
        Ok(gpu) => Some(gpu),
        Err(_) if std::env::var_os("GPUGI_SKIP_GPU").is_some_and(|value| value == "1") => None,
        Err(error) => panic!("{error}"),
    }
}

/// Opens the GPU, or returns from the test.
macro_rules! gpu {
    () => {
        match open() {
            Some(gpu) => gpu,
            None => return,
        }
    };
}

mod color;
mod comparison;
mod motion;
mod surfaces;

/// Width of pictures of many pixels.
const WIDTH: usize = 4096;

/// A receiver whose target holds sums of radiance, and whose points nobody reads.
pub(super) fn receiver(gpu: &Gpu, sums: &[[f32; 4]]) -> Receiver {
    let unread = gpu.storage("unread", &[0_u32; 4]).expect("it fits");
    let format = wgpu::TextureFormat::R32Uint;
    let usage = wgpu::TextureUsages::TEXTURE_BINDING;
    let hits = gpu.texture_2d("hits", [1, 1, 1], format, usage);
    let hits = hits.expect("it fits");
    let points = SurfacePoints {
        points: unread.clone(),
        view: unread,
        first: 0,
        count: sums.len() as u32,
        lit: sums.len() as u32,
        hits: hits.create_view(&Default::default()),
        output: Output::default(),
        slots: Slots::default(),
    };
    let radiance = gpu.storage("radiance", sums).expect("it fits");
    Receiver::new(&points, &Target::of(gpu, radiance).expect("it fits"))
}

/// A picture of strips whose radiance is summed over `samples` samples.
pub(super) fn lit<'a>(strips: &'a [Strip<'a>], samples: u32) -> Lit<'a> {
    Lit {
        strips,
        samples,
        of: samples,
        shot: Shot {
            eye: glam::Vec4::W,
            film_from_world: Default::default(),
            lens: Default::default(),
            shutter: 0.0,
            half_height: TANGENT,
            tangent: TANGENT,
            versions: Default::default(),
        },
        is_through_lens: false,
        seconds: 0.0,
    }
}

/// Pixels and exposure value for radiance summed over `samples` samples. Black pixels fill the last row; they are not
/// exposed for.
fn show_samples(
    gpu: &Gpu,
    radiance: &[[f32; 3]],
    samples: u32,
    effects: &Effects,
) -> (Vec<[u8; 4]>, f32) {
    let width = radiance.len().min(WIDTH);
    let height = radiance.len().div_ceil(width);
    let mut sums: Vec<[f32; 4]> = radiance
        .iter()
        .map(|&[r, g, b]| [r, g, b, f32::NAN])
        .collect();
    sums.resize(width * height, [0.0; 4]);
    let mut picture = Picture::new(gpu, [width as u32, height as u32]).expect("it fits");
    let scene = GpuScene::new(gpu, &gpugi_scene::Scene::new("nothing")).expect("it fits");
    let receiver = receiver(gpu, &sums);
    let strips = [Strip {
        receiver: &receiver,
        rows: 0..height as u32,
        samples,
    }];
    let mut frame = Frame::new(gpu, false);
    picture
        .record(
            &mut frame,
            &scene,
            lit(&strips, samples),
            Shown::Picture,
            effects,
        )
        .expect("the buffer fits");
    frame.submit().expect("the passes are valid");
    let pixels = picture.pixels(gpu).expect("pixels can be read");
    let exposure = picture
        .exposure_value(gpu)
        .expect("the exposure can be read");
    let pixels = pixels.as_chunks::<4>().0;
    (pixels[..radiance.len()].to_vec(), exposure)
}

fn show(gpu: &Gpu, radiance: &[[f32; 3]], effects: &Effects) -> Vec<[u8; 4]> {
    show_samples(gpu, radiance, 1, effects).0
}

/// EV 0, no operator, no dither.
fn plain() -> Effects {
    Effects::default().of_colors()
}

/// The same with automatic exposure.
fn automatically_exposed() -> Effects {
    let mut effects = plain();
    effects.exposure.value = Exposure::Auto;
    effects
}

/// The same with an operator.
fn mapped(operator: ToneMap) -> Effects {
    let mut effects = plain();
    effects.tone_map.operator = operator;
    effects
}

/// The same with noise.
fn dithered(seed: u32) -> Effects {
    let mut effects = plain();
    effects.encode = encode::Settings { dither: true, seed };
    effects
}

/// The result of automatic exposure for an image.
fn automatic(gpu: &Gpu, radiance: &[[f32; 3]]) -> f32 {
    let effects = automatically_exposed();
    let exposure = show_samples(gpu, radiance, 1, &effects).1;
    assert!(exposure.is_finite());
    exposure
}

/// The exposure value that maps this luminance to middle grey.
fn to_middle_grey(luminance: f32) -> f32 {
    (0.18 / luminance).log2()
}

fn assert_near(value: f64, expected: f64, tolerance: f64, what: impl std::fmt::Debug) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{what:?}: {value}, not {expected}"
    );
}

/// Black, greys, primaries and mixtures, from far below to far above the display range.
fn ramp() -> Vec<[f32; 3]> {
    let hues = [
        [1.0, 1.0, 1.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.5, 0.1],
        [0.05, 0.6, 1.0],
    ];
    let strengths = [
        1e-30, 1e-6, 1e-3, 0.02, 0.079, 0.18, 0.5, 0.77, 0.81, 1.0, 3.0, 17.0, 900.0, 1e6,
    ];
    std::iter::once([0.0; 3])
        .chain(
            strengths
                .iter()
                .flat_map(|&strength| hues.map(|hue| hue.map(|channel| channel * strength))),
        )
        .collect()
}

#[test]
fn names_are_read_as_they_are_written() {
    let mut effects = Effects::default();
    for operator in ToneMap::ALL {
        let set = effects.set("tone-map", "operator", operator.name());
        assert_eq!(set, Some(Ok(())));
        assert_eq!(effects.tone_map.operator, operator);
        assert_eq!(operator.to_string(), operator.name());
    }
    assert_eq!("auto".parse(), Ok(Exposure::Auto));
    assert_eq!("-1.5".parse(), Ok(Exposure::Manual(-1.5)));
    assert_eq!(
        Exposure::Manual(2.0).to_string().parse(),
        Ok(Exposure::Manual(2.0))
    );
    let unknown = effects.set("tone-map", "operator", "filmic");
    let unknown = unknown.expect("an effect").expect_err("unknown");
    assert!(unknown.to_string().contains("neutral"));
    assert_eq!(effects.set("filmic", "operator", "none"), None);
    for nonsense in ["", "bright", "nan", "inf"] {
        assert!(nonsense.parse::<Exposure>().is_err(), "{nonsense:?}");
    }
}

/// Averaging dithered pixels resolves far finer values than the 8 bits of one pixel.
#[test]
fn operators_match_their_twins() {
    const COPIES: usize = 4096;
    let gpu = gpu!();
    let ramp = ramp();
    let copies: Vec<_> = ramp
        .iter()
        .flat_map(|&color| std::iter::repeat_n(color, COPIES))
        .collect();
    for tone_map in ToneMap::ALL {
        for (exposure, white_point) in [(0.0, 4.0), (1.5, 2.0)] {
            let mut effects = Effects::default().exposed(exposure);
            effects.tone_map = effects::tone_map::Settings {
                operator: tone_map,
                white_point,
            };
            let pixels = show(&gpu, &copies, &effects);
            for (color, pixels) in ramp.iter().zip(pixels.chunks_exact(COPIES)) {
                let exposed = color.map(|channel| f64::from(channel) * f64::from(exposure).exp2());
                let expected = twin::encoded(tone_map, exposed, white_point.into());
                for channel in 0..3 {
                    let sum: u64 = pixels.iter().map(|pixel| u64::from(pixel[channel])).sum();
                    let mean = sum as f64 / COPIES as f64;
                    assert_near(
                        mean,
                        255.0 * expected[channel],
                        0.05,
                        (tone_map, color, channel),
                    );
                }
            }
        }
    }
}

#[test]
fn without_dither_the_nearest_value_is_shown() {
    let gpu = gpu!();
    for tone_map in ToneMap::ALL {
        let pixels = show(&gpu, &ramp(), &mapped(tone_map));
        for (color, pixel) in ramp().iter().zip(pixels) {
            let expected = twin::encoded(tone_map, color.map(f64::from), 4.0);
            for channel in 0..3 {
                assert_near(
                    pixel[channel].into(),
                    255.0 * expected[channel],
                    0.51,
                    (tone_map, color),
                );
            }
            assert_eq!(pixel[3], 255);
        }
    }
}

#[test]
fn greys_stay_grey_and_in_order() {
    let gpu = gpu!();
    let greys: Vec<_> = (0..4096)
        .map(|step| [(step as f32 / 128.0 - 20.0).exp2(); 3])
        .collect();
    for tone_map in ToneMap::ALL {
        let pixels = show(&gpu, &greys, &mapped(tone_map));
        assert!(
            pixels
                .windows(2)
                .all(|pair| (0..3).all(|channel| pair[0][channel] <= pair[1][channel]))
        );
        for [r, g, b, _] in &pixels {
            assert!(
                r.abs_diff(*g) <= 1 && g.abs_diff(*b) <= 1,
                "{tone_map}: {r} {g} {b}"
            );
        }
        assert!(pixels[0][1] == 0 && pixels[4095][1] >= 254, "{tone_map}");
    }
}

#[test]
fn samples_and_exposure_scale_the_sum() {
    let gpu = gpu!();
    let effects = plain().exposed(-1.0);
    let (pixels, exposure) = show_samples(&gpu, &[[8.0, 4.0, 0.0]], 8, &effects);
    let expected =
        [0.5, 0.25, 0.0].map(|value| (255.0 * twin::srgb_from_linear(value)).round() as u8);
    assert_eq!((&pixels[0][..3], exposure), (&expected[..], -1.0));
}

#[test]
fn a_constant_image_becomes_middle_grey() {
    let gpu = gpu!();
    for luminance in [1e-5, 0.031, 0.18, 1.0, 40.0, 5e4] {
        let image = vec![[luminance; 3]; 5000];
        assert_near(
            automatic(&gpu, &image).into(),
            to_middle_grey(luminance).into(),
            0.01,
            luminance,
        );
    }
    let effects = automatically_exposed();
    let (pixels, _) = show_samples(&gpu, &[[6.0; 3]; 100], 4, &effects);
    let middle_grey = 255.0 * twin::srgb_from_linear(0.18);
    assert!(
        pixels
            .iter()
            .all(|pixel| (f64::from(pixel[1]) - middle_grey).abs() < 1.0)
    );
}

#[test]
fn a_black_image_stays_black_at_exposure_0() {
    let gpu = gpu!();
    let effects = Effects::default();
    let (pixels, exposure) = show_samples(&gpu, &[[0.0; 3]; 1000], 1, &effects);
    assert_eq!(exposure, 0.0);
    assert!(pixels.iter().all(|pixel| *pixel == [0, 0, 0, 255]));
}

#[test]
fn background_and_outliers_do_not_rule_the_exposure() {
    let gpu = gpu!();
    let mut image = vec![[0.0; 3]; 20_000];
    image[7000..7200].fill([5.0; 3]);
    assert_near(
        automatic(&gpu, &image).into(),
        to_middle_grey(5.0).into(),
        0.01,
        "a bright spot on black",
    );

    let mut image = vec![[0.3; 3]; 20_000];
    image[..1900].fill([1e5; 3]);
    image[18_200..].fill([1e-4; 3]);
    assert_near(
        automatic(&gpu, &image).into(),
        to_middle_grey(0.3).into(),
        0.01,
        "lamps and dark corners",
    );
}

/// The image is a gradient, so that an omitted or double-counted pixel shows. It is uneven, so that the trimmed part
/// matters.
#[test]
fn automatic_exposure_is_the_trimmed_log_average() {
    let gpu = gpu!();
    for (count, tolerance) in [
        (1_usize, 0.01),
        (9, 0.01),
        (300, 0.01),
        (4097, 0.003),
        (100_003, 0.003),
    ] {
        let image: Vec<_> = (0..count)
            .map(|pixel| {
                let strength = (18.0 * (pixel as f32 / count as f32).powi(2) - 8.0).exp2();
                [strength, 0.4 * strength, 0.1 * strength]
            })
            .collect();
        let trimmed = count / 10;
        let kept = &image[trimmed..count - trimmed];
        let sum: f64 = kept
            .iter()
            .map(|color| twin::luminance(color.map(f64::from)).log2())
            .sum();
        let expected = 0.18_f64.log2() - sum / kept.len() as f64;
        assert_near(automatic(&gpu, &image).into(), expected, tolerance, count);
    }
}

#[test]
fn dither_is_unbiased_and_repeatable() {
    const COPIES: usize = 65_536;
    let gpu = gpu!();
    // Encoded values, in 8-bit steps. Noise could be clipped at those near the ends.
    let targets = [
        0.02_f64, 0.3, 0.5, 0.7, 1.0, 1.4, 2.5, 90.1, 127.5, 200.0, 201.3, 253.6, 254.2, 254.5,
        254.9,
    ];
    let image: Vec<_> = targets
        .iter()
        .flat_map(|target| {
            let encoded = target / 255.0;
            let linear = if encoded <= 0.04045 {
                encoded / 12.92
            } else {
                ((encoded + 0.055) / 1.055).powf(2.4)
            };
            std::iter::repeat_n([linear as f32; 3], COPIES)
        })
        .collect();
    let pixels = show(&gpu, &image, &dithered(7));
    for (target, pixels) in targets.iter().zip(pixels.chunks_exact(COPIES)) {
        for channel in 0..3 {
            let sum: u64 = pixels.iter().map(|pixel| u64::from(pixel[channel])).sum();
            assert_near(sum as f64 / COPIES as f64, *target, 0.02, (target, channel));
            assert!(
                pixels
                    .iter()
                    .all(|pixel| (f64::from(pixel[channel]) - target).abs() < 1.5 + 1e-3)
            );
        }
    }
    assert_eq!(pixels, show(&gpu, &image, &dithered(7)));
    assert_ne!(pixels, show(&gpu, &image, &dithered(8)));
}

#[test]
fn dither_leaves_black_and_white_alone() {
    let gpu = gpu!();
    for (value, shown) in [(0.0, 0), (1.0, 255)] {
        let pixels = show(&gpu, &[[value; 3]; 50_000], &dithered(0));
        assert!(
            pixels
                .iter()
                .all(|pixel| *pixel == [shown, shown, shown, 255])
        );
    }
}

#[test]
fn wrong_radiance_never_spreads() {
    let gpu = gpu!();
    let (nan, infinity) = (f32::NAN, f32::INFINITY);
    let image = [
        [nan, 1.0, 1.0],
        [1.0, 1.0, -nan],
        [-1.0, -infinity, -1e-40],
        [infinity; 3],
        [f32::MAX; 3],
        [0.5; 3],
    ];
    let black = [0, 0, 0, 255];
    for tone_map in ToneMap::ALL {
        for exposure in [0.0, 127.0, -300.0, nan, infinity] {
            let pixels = show(&gpu, &image, &mapped(tone_map).exposed(exposure));
            assert_eq!(pixels[..3], [black; 3], "{tone_map} {exposure}");
            assert_eq!(pixels[3], pixels[4], "{tone_map} {exposure}");
        }
        let pixels = show(&gpu, &image, &mapped(tone_map));
        assert!(
            pixels[3].iter().all(|&channel| channel >= 254),
            "{tone_map}: {:?}",
            pixels[3]
        );
    }
    assert!(automatic(&gpu, &image).abs() < 40.0);
    assert_eq!(automatic(&gpu, &[[nan; 3]; 9]), 0.0);
    assert_near(
        automatic(&gpu, &image[5..]).into(),
        to_middle_grey(0.5).into(),
        0.01,
        "one pixel",
    );
}

/// The image needs more workgroups than one axis of a dispatch holds.
#[test]
fn a_large_picture_is_shown_to_its_last_pixel() {
    let gpu = gpu!();
    let image = vec![[1.0, 0.0, 1.0]; 64 * 65_535 + 12_345];
    let pixels = show(&gpu, &image, &plain());
    assert!(pixels.iter().all(|pixel| *pixel == [255, 0, 255, 255]));
}

/// Strips of different brightness share one exposure, and radiance on the host is shown in the same way.
#[test]
fn a_picture_in_strips_is_the_picture() {
    let gpu = gpu!();
    let radiance = &ramp()[..84];
    let effects = automatically_exposed();
    let whole = show(&gpu, radiance, &effects);
    let sums: Vec<[f32; 4]> = radiance.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let scene = GpuScene::new(&gpu, &gpugi_scene::Scene::new("nothing")).unwrap();
    let [first, second] = [&sums[..36], &sums[36..]].map(|sums| receiver(&gpu, sums));
    let strips = [(&first, 0..3), (&second, 3..7)];
    let strips = strips.map(|(receiver, rows)| Strip {
        receiver,
        rows,
        samples: 1,
    });
    let mut picture = Picture::new(&gpu, [12, 7]).unwrap();
    let mut frame = Frame::new(&gpu, false);
    picture
        .record(
            &mut frame,
            &scene,
            lit(&strips, 1),
            Shown::Picture,
            &effects,
        )
        .unwrap();
    frame.submit().unwrap();
    assert_eq!(picture.pixels(&gpu).unwrap(), whole.concat());
    let floats: Vec<f32> = radiance.iter().flatten().copied().collect();
    let developed = |size, radiance| developed(&gpu, size, radiance, &effects).unwrap();
    assert_eq!(developed([12, 7], &floats), whole.concat());
    assert!(developed([0, 7], &[]).is_empty());
}

#[test]
fn a_picture_follows_its_input() {
    let gpu = gpu!();
    let scene = GpuScene::new(&gpu, &gpugi_scene::Scene::new("nothing")).unwrap();
    let mut picture = Picture::new(&gpu, [2, 2]).expect("it fits");
    for (value, shown) in [(0.0_f32, 0), (1.0, 255), (0.0, 0)] {
        let receiver = receiver(&gpu, &[[value; 4]; 4]);
        let strips = [Strip {
            receiver: &receiver,
            rows: 0..2,
            samples: 1,
        }];
        let mut frame = Frame::new(&gpu, false);
        picture
            .record(
                &mut frame,
                &scene,
                lit(&strips, 1),
                Shown::Picture,
                &plain(),
            )
            .expect("the buffer fits");
        frame.submit().expect("the passes are valid");
        assert_eq!(picture.pixels(&gpu).expect("pixels can be read")[0], shown);
    }
}
