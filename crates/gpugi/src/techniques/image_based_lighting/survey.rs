//! Which parts of the environment light what a camera sees: decides how many of the directions that are drawn for each
//! sample lie in each part. Through the window of a room, few parts of the sky are seen at all.

use std::f64::consts::{PI, TAU};

use glam::{Quat, Vec3};

use super::batches::{self, Batches, DepthMaps, GUTTER};
use super::draws::{CellsOfSky, Draws};
use super::{Settings, gpu};
use crate::capture::depth::DepthViewSpec;
use crate::capture::{Capture, CaptureKernels, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, ReadBack, join};
use crate::scene::{GpuScene, Versions};
use crate::shader;

/// Rows of parts from pole to pole: parts are ten degrees wide.
const ROWS: u32 = 18;
/// Side of the depth map of a part's direction (texels).
const SIDE: u32 = 128;
/// Width of the picture whose points are asked (pixels).
const WIDTH: u32 = 64;
/// Share of the draws that ignores what is seen, so that what the survey misses is drawn, too.
const BLIND: f64 = 0.1;
/// Least share of draws by power alone that count (0 to 1), with which they are kept: in the open, lobes that are not
/// diffuse, of which the survey knows nothing, gain more from them.
const OPEN: f64 = 0.5;
/// Cosine of the angle between the directions of neighbouring parts, at most: 15 degrees.
const NEAR: f32 = 0.966;

/// Surveys, and what the last one found.
#[derive(Debug)]
pub struct Survey {
    light: Kernel,
    weigh: Kernel,
    parts: Parts,
    capture: Option<Capture>,
    on_the_way: Option<(Key, ReadBack<Vec<f32>>)>,
    found: Option<(Key, Draws)>,
}

/// What a survey depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    versions: Versions,
    settings: Settings,
    /// Position, axes and field of view of the camera, bit by bit; `None`: nothing was surveyed.
    camera: Option<([u32; 16], [u32; 2])>,
}

impl Key {
    pub fn new(versions: Versions, settings: &Settings, view: &View) -> Self {
        Self {
            versions,
            settings: settings.clone(),
            camera: Some((
                view.world_from_view.to_cols_array().map(f32::to_bits),
                view.half_extent.to_array().map(f32::to_bits),
            )),
        }
    }
}

impl Survey {
    /// Compiles the passes. `has_transmittance`: [`Batches::has_transmittance`].
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, has_transmittance: bool) -> Result<Self, GpuError> {
        let constants = [("HAS_TRANSMITTANCE", has_transmittance.into())];
        let kernel = |entry| {
            let shader = shader!("techniques.image_based_lighting.survey");
            Kernel::with_constants(gpu, &shader, entry, None, &constants)
        };
        Ok(Self {
            light: kernel("light")?,
            weigh: kernel("weigh")?,
            parts: Parts::new(),
            capture: None,
            on_the_way: None,
            found: None,
        })
    }

    /// The draws that the last survey of this environment found, whatever the camera saw then; without one, draws by
    /// power alone.
    pub fn latest(&mut self, key: Key, cells: &CellsOfSky) -> &Draws {
        let serves = |found: &Key| {
            let environment = key.versions.environment;
            found.versions.environment == environment && found.settings == key.settings
        };
        let found = self.found.take().filter(|(found, _)| serves(found));
        let found = found.unwrap_or_else(|| {
            let draws = Draws::new(cells, key.settings.samples, |_| 1.0);
            (
                Key {
                    camera: None,
                    ..key
                },
                draws,
            )
        });
        &self.found.insert(found).1
    }

    /// Whether the last survey was for this key. Otherwise [`Survey::draws`] may use the batches for a new one.
    pub fn is_current(&self, key: &Key) -> bool {
        self.found.as_ref().is_some_and(|(found, _)| found == key)
    }

    /// The draws from `cells` that suit what `view` sees: pass `image-based-lighting.survey`. `None` while the survey is
    /// on its way from the GPU; `batches` hold its depth maps then.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn draws(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        (key, view): (Key, &View),
        cells: &CellsOfSky,
        (batches, maps): (&mut Batches, &DepthMaps),
        kernels: &CaptureKernels,
    ) -> Result<Option<&Draws>, GpuError> {
        if !self.is_current(&key) {
            let Some((asked, weights)) = self.on_the_way.take() else {
                let weights = self.begin(frame, scene, view, cells, (batches, maps), kernels)?;
                self.on_the_way = Some((key, weights));
                return Ok(None);
            };
            let Some(found) = weights.get() else {
                self.on_the_way = Some((asked, weights));
                return Ok(None);
            };
            // Also if the camera has moved on: draws are right for any, and one that never rests must not wait for ever.
            let draws = self.parts.draws(cells, key.settings.samples, &found?);
            self.found = Some((asked, draws));
        }
        Ok(self.found.as_ref().map(|(_, draws)| draws))
    }

    /// Captures the points, draws the depth maps of all parts and weighs the parts.
    fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        cells: &CellsOfSky,
        (batches, maps): (&mut Batches, &DepthMaps),
        kernels: &CaptureKernels,
    ) -> Result<ReadBack<Vec<f32>>, GpuError> {
        let gpu = frame.gpu;
        let aspect = view.half_extent.y / view.half_extent.x;
        let size = [
            WIDTH,
            ((WIDTH as f32 * aspect).round() as u32).clamp(1, 512),
        ];
        let view = view.at_size(size, scene.diagonal());
        let mut capture = match self.capture.take().filter(|capture| capture.size() == size) {
            Some(capture) => capture,
            None => Capture::of_camera(gpu, kernels, size)?,
        };
        capture.record(frame, scene, &view, |draw| draw.seen)?;

        let environment = scene.environment.as_ref();
        let world_from_map = environment.map_or(Quat::IDENTITY, |environment| environment.rotation);
        let light = self.parts.light(cells);
        let directions = self.parts.toward.iter().zip(light);
        let (directions, views): (Vec<_>, Vec<_>) = directions
            .map(|(toward, flux_density)| {
                let toward = world_from_map * *toward;
                let view = DepthViewSpec::around_core(-toward, scene, SIDE, GUTTER);
                let direction = gpu::Direction {
                    toward: toward.to_array(),
                    solid_angle: 0.0,
                    flux_density: flux_density.to_array(),
                    texel: view.texel,
                };
                (direction, view)
            })
            .unzip();
        // All are kept, however little memory there is for the maps of a sample.
        let maps = DepthMaps {
            memory: u64::MAX,
            ..*maps
        };
        batches.generate(frame, scene, (&directions, &views), &maps)?;

        let storage = |label, count| gpu.room(label, 4 * count as u64);
        let arriving = storage(
            "light of surveyed points [bytes]",
            (size[0] * size[1]) as usize,
        )?;
        let importance = storage("importance of directions [bytes]", directions.len())?;
        frame.clear(&arriving);
        for (kernel, is_per_point) in [(&self.light, true), (&self.weigh, false)] {
            for (directions, maps) in batches.maps() {
                let invocations = match is_per_point {
                    true => capture.points.count,
                    false => directions.len() as u32 * LANES,
                };
                let range = batches::range(gpu, directions)?;
                let own: [Named<'_>; 4] = [
                    ("points", &capture.points.points),
                    ("range", &range),
                    ("arriving", &arriving),
                    ("importance", &importance),
                ];
                let resources = join(&maps, &own);
                let name = "image-based-lighting.survey";
                frame.run(name, kernel, None, &resources, [invocations, 1, 1])?;
            }
        }
        self.capture = Some(capture);
        frame.read_back(&importance, importance.size())
    }
}

/// `LANES` of survey.wesl.
const LANES: u32 = 64;

/// Parts of the sphere, about equally large: rows of equal height between the poles, each cut into columns.
#[derive(Debug)]
struct Parts {
    /// Number of columns of each row, and of the parts before it.
    rows: Vec<[u32; 2]>,
    /// Direction of each part's centre, in the map's own frame.
    toward: Vec<Vec3>,
}

impl Parts {
    fn new() -> Self {
        let (mut rows, mut toward) = (Vec::new(), Vec::new());
        for row in 0..ROWS {
            let theta = PI * (f64::from(row) + 0.5) / f64::from(ROWS);
            let columns = (f64::from(2 * ROWS) * theta.sin()).round().max(4.0) as u32;
            rows.push([columns, toward.len() as u32]);
            toward.extend((0..columns).map(|column| {
                let phi = TAU * ((f64::from(column) + 0.5) / f64::from(columns) - 0.5);
                let (sine, cosine) = theta.sin_cos();
                glam::dvec3(phi.sin() * sine, cosine, -phi.cos() * sine).as_vec3()
            }));
        }
        Self { rows, toward }
    }

    /// The part that contains the centre of a cell.
    fn part_of(&self, cells: &CellsOfSky, [column, row]: [u32; 2]) -> usize {
        let within = |index: u32, of: u32, parts: u32| (2 * index + 1) * parts / (2 * of);
        let [columns, first] = self.rows[within(row, cells.grid.height, ROWS) as usize];
        (first + within(column, cells.grid.width, columns)) as usize
    }

    /// Integral of the radiance over each part (W/m^2).
    fn light(&self, cells: &CellsOfSky) -> Vec<Vec3> {
        let mut light = vec![Vec3::ZERO; self.toward.len()];
        for (cell, flux_density, _) in cells.all() {
            light[self.part_of(cells, cell)] += flux_density;
        }
        light
    }

    /// Draws that suit the weights of the parts' centres.
    fn draws(&self, cells: &CellsOfSky, count: u32, weights: &[f32]) -> Draws {
        let around = self.spread(weights);
        let blind = Draws::new(cells, count, |_| 1.0);
        let mut expected = vec![0.0; around.len()];
        for (cell, draws) in blind.expected() {
            expected[self.part_of(cells, cell)] += draws;
        }
        let parts = || expected.iter().zip(&around);
        let all: f64 = expected.iter().sum();
        let seen: f64 = parts().map(|(draws, weight)| draws * weight).sum();
        let squares: f64 = parts().map(|(draws, weight)| draws * weight * weight).sum();
        // Kish's effective sample size, relative to the number of draws. Where nothing is seen, or rounding made weights
        // infinite, nothing is known.
        let is_narrow = seen * seen < OPEN * all * squares;
        if !is_narrow {
            return blind;
        }
        let mean = seen / all;
        Draws::new(cells, count, |cell| {
            (1.0 - BLIND) * around[self.part_of(cells, cell)] / mean + BLIND
        })
    }

    /// Each part's weight, and that of its most important neighbour: what a part's centre does not see, its border may.
    fn spread(&self, weights: &[f32]) -> Vec<f64> {
        let all = || self.toward.iter().zip(weights);
        let around = all().map(|(toward, own)| {
            let near = all().filter(|(other, _)| other.dot(*toward) > NEAR);
            let most = near.map(|(_, weight)| *weight).fold(0.0, f32::max);
            f64::from(own + most) / 2.0
        });
        around.collect()
    }
}
