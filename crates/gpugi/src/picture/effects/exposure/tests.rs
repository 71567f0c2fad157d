//! Exposure that adapts, against the exponential function.

use gpugi_scene::Scene;

use super::*;
use crate::picture::tests::{lit, receiver};
use crate::picture::{Lit, Picture, Shown, Strip};
use crate::scene::GpuScene;
use crate::testing::test_gpu;

/// Pictures of one luminance, one after the other.
struct Pictures {
    gpu: Gpu,
    scene: GpuScene,
    picture: Picture,
    effects: Effects,
}

impl Pictures {
    fn new(gpu: &Gpu, adaptation: f32) -> Self {
        let mut effects = Effects::default();
        effects.exposure.adaptation = adaptation;
        Self {
            gpu: gpu.clone(),
            scene: GpuScene::new(gpu, &Scene::new("nothing")).unwrap(),
            picture: Picture::new(gpu, [2, 2]).unwrap(),
            effects,
        }
    }

    /// Shows the picture, `seconds` after the one before, and returns its exposure value.
    fn show(&mut self, luminance: f32, seconds: f32) -> f32 {
        let receiver = receiver(&self.gpu, &[[luminance; 4]; 4]);
        let strips = [Strip {
            receiver: &receiver,
            rows: 0..2,
            samples: 1,
        }];
        let lit = Lit {
            seconds,
            ..lit(&strips, 1)
        };
        let mut frame = Frame::new(&self.gpu, false);
        (self.picture)
            .record(&mut frame, &self.scene, lit, Shown::Picture, &self.effects)
            .unwrap();
        frame.submit().unwrap();
        self.picture.exposure_value(&self.gpu).unwrap()
    }

    /// The same for the next picture.
    fn next(&mut self, luminance: f32, seconds: f32) -> f32 {
        self.picture.advance();
        self.show(luminance, seconds)
    }
}

/// The exposure value that maps this luminance to middle grey.
fn exposed(luminance: f32) -> f32 {
    (0.18 / luminance).log2()
}

fn assert_near(value: f32, expected: f32, what: impl std::fmt::Debug) {
    let error = (value - expected).abs();
    assert!(error < 0.01, "{what:?}: {value}, not {expected}");
}

/// A step to brighter and one to darker light, at two frame rates, and with a time that is not the eye's.
#[test]
fn exposure_adapts_exponentially() {
    let Some(gpu) = test_gpu() else { return };
    for (from, to, constant) in [(0.02, 3.0, 0.1), (3.0, 0.02, 0.4)] {
        for (adaptation, rate) in [(1.0, 60), (1.0, 25), (3.0, 60)] {
            let mut pictures = Pictures::new(&gpu, adaptation);
            assert_near(pictures.next(from, 0.5), exposed(from), "the first picture");
            for frame in 1..=rate / 5 {
                let found = pictures.next(to, 1.0 / rate as f32);
                let seconds = frame as f32 / rate as f32;
                let left = (-seconds / (constant * adaptation)).exp();
                let expected = exposed(to) + (exposed(from) - exposed(to)) * left;
                assert_near(found, expected, (from, adaptation, rate, frame));
            }
        }
    }
}

/// Samples of one picture share the picture before, however many they are.
#[test]
fn samples_of_a_picture_adapt_once() {
    let Some(gpu) = test_gpu() else { return };
    let mut pictures = Pictures::new(&gpu, 1.0);
    pictures.next(1.0, 0.1);
    let first = pictures.next(8.0, 0.05);
    assert_near(first, exposed(8.0) + 3.0 * (-0.5_f32).exp(), "first sample");
    assert_near(pictures.show(8.0, 0.05), first, "second sample");
    let later = pictures.show(8.0, 0.25);
    let expected = exposed(8.0) + 3.0 * (-2.5_f32).exp();
    assert_near(later, expected, "more time has passed");
}

#[test]
fn exposure_adapts_at_once_without_time_or_memory() {
    let Some(gpu) = test_gpu() else { return };
    let mut pictures = Pictures::new(&gpu, 1.0);
    pictures.next(1.0, 0.1);
    assert_near(pictures.next(5.0, 0.0), exposed(5.0), "no time is known");
    pictures.picture.forget();
    assert_near(pictures.next(0.1, 0.01), exposed(0.1), "after a cut");
    assert!(pictures.next(7.0, 0.01) > exposed(7.0) + 1.0, "no cut");
    let before = pictures.next(0.1, 0.01);
    assert_near(pictures.next(0.0, 0.3), before, "nothing is seen");
    let wide = pictures.picture.resized(&gpu, [2, 2]).unwrap();
    pictures.picture = wide;
    assert!(pictures.next(0.01, 0.01) < before + 1.0, "another size");
    pictures.effects.exposure.adaptation = 0.0;
    assert_near(pictures.next(3.0, 0.01), exposed(3.0), "it is off");
}

#[test]
fn bad_values_are_refused() {
    let mut effects = Effects::default();
    for (effect, name) in [
        ("exposure", "adaptation"),
        ("glow", "strength"),
        ("vignette", "strength"),
        ("vignette", "barrel"),
    ] {
        for value in ["nan", "-0.1", "inf", "1000"] {
            let set = effects.set(effect, name, value).expect("an effect");
            assert!(set.is_err(), "{effect}.{name}={value}");
        }
        assert_eq!(effects.set(effect, name, "0.5"), Some(Ok(())));
    }
}
