//! Tests of the open directions that texels sum up.

use glam::{DVec3, dvec3};

use super::scenes::{floor_and_wall, settings};
use super::{Bench, Falloff, Mode, Settings, rms};
use crate::gpu::read_buffer;
use crate::techniques::obscurances::gpu::TEXEL_BYTES;
use crate::testing::{read_points, test_gpu};
use gpugi_scene::atlas::AtlasOptions;

/// Words of `Texel` of obscurance.wesl.
const WORDS: usize = TEXEL_BYTES as usize / 4;

/// The mean over all samples of a point at distance `x` from an endless wall in the direction of -X, with reach 1: of
/// directions that meet nothing, and zero for those that meet the wall. On the unit disc onto which the directions
/// project, those more than `x` toward the wall meet it.
fn before_wall(x: f64) -> DVec3 {
    let x = x.min(1.0);
    let away = 2.0 / 3.0 * (1.0 - x * x).powf(1.5) / std::f64::consts::PI;
    // Half of a ball's cap.
    let hidden = (2.0 / 3.0 - x + x.powi(3) / 3.0) / 2.0;
    dvec3(away, 2.0 / 3.0 - hidden, 0.0)
}

#[test]
fn open_directions_lead_away_from_walls() {
    let Some(gpu) = test_gpu() else { return };
    for (mode, most) in [(Mode::Rays, 0.004), (Mode::Peeling, 0.02)] {
        let atlas = AtlasOptions {
            size: 48,
            ..Default::default()
        };
        let settings = Settings {
            lines: 2.0,
            ..settings(mode, 1.0, Falloff::Sqrt)
        };
        let scene = floor_and_wall();
        let options = Default::default();
        let mut bench = Bench::new(&gpu, scene, &atlas, &options, &settings).unwrap();
        bench.finish(&gpu);
        let [texels, _] = bench.obscurances.buffers();
        let words: Vec<u32> = read_buffer(&gpu, texels, texels.size()).unwrap();
        let points = bench.capture.points();
        let points = points.flat_map(|points| read_points(&gpu, &bench.on_gpu, points));
        let of_texels = points.zip(words.chunks_exact(WORDS));
        // The wall ends at z = 3: closer to its end it does not count as endless. At its foot peeling, which sees whole
        // texels, differs.
        let floor = of_texels.filter(|(point, _)| {
            point.instance == 0 && point.position.z.abs() < 1.9 && point.position.x > 0.3
        });
        let errors: Vec<f64> = floor
            .map(|(point, words)| {
                let [count, open] = [words[3], words[4]].map(f64::from);
                let sums = [words[9], words[10], words[11]].map(f64::from);
                let mean = (2.0 / 65535.0 * DVec3::from_array(sums) - open) / count;
                mean.distance(before_wall(f64::from(point.position.x)))
            })
            .collect();
        assert!(errors.len() > 100, "{}", errors.len());
        let error = rms(errors.into_iter());
        println!("{mode:?}: {error:.4}");
        assert!(error < most, "{mode:?}: {error}");
    }
}
