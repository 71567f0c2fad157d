//! The reference points and their lights, as they were made for a scene and settings.

use glam::{UVec3, Vec3};
use gpugi_scene::Bounds;

use super::gpu;
use super::maps::{Bench, FrameInputs, Kernels, Maps};
use super::objects::ObjectPoint;
use super::places::Places;
use super::settings::{Settings, Visibility};
use crate::capture::{CaptureKernels, Output, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, join};
use crate::probes::{Grid, Placing, ProbeCubes};
use crate::scene::GpuScene;
use crate::stage::Stage;
use crate::techniques::openness::follow;
use crate::techniques::{
    Claimed, Earlier, Generated, Inspection, LightState, Map, OpennessLookup, Slice,
};

/// Most reference points of a grid, and most objects with one.
const MOST_POINTS: u64 = 4096;
pub const MOST_OBJECTS: u64 = 32;
/// Bounces per frame before the light is gathered for the first time; later a frame has one.
const BOUNCES_AT_ONCE: u32 = 16;
/// Widest map of distances (texels): WebGPU promises this much.
const WIDEST: u32 = 8192;

/// What reference points and their lights are made for: settings, what the plan decides, whether passes look for media,
/// and where the points are.
pub type Key = (Settings, ProbePlan, bool, Layout);

/// The reference points and their lights.
#[derive(Debug)]
pub struct LitProbes {
    settings: Settings,
    own: ProbePlan,
    layout: Layout,
    kernels: Kernels,
    maps: Maps,
    cubes: Cubes,
    /// With `occlusion`, what multiplies the light.
    openness: Stage<wgpu::Buffer, Box<dyn OpennessLookup>>,
    /// The light in the cubes, seen from the camera if they are.
    light: Stage<(LightState, Option<Vec3>)>,
    /// Bounces since the light last changed.
    bounced: u32,
    /// Whether the lights have been complete once, so that they can be gathered.
    is_complete: bool,
    revision: u64,
}

/// Where the reference points are.
#[derive(Debug, Clone, PartialEq)]
pub enum Layout {
    /// In a grid, in these bounds.
    Grid(Bounds, Grid),
    Objects(Claimed),
    Camera,
}

#[derive(Debug)]
enum Cubes {
    Own(ProbeCubes<Bench>),
    OfObjects {
        objects: Vec<ObjectPoint>,
        /// The one that is lit first, so that none waits for ever where everything changes in every frame.
        next: usize,
    },
}

impl Cubes {
    fn bytes(&self) -> u64 {
        match self {
            Self::Own(points) => points.bytes(),
            Self::OfObjects { objects, .. } => objects.iter().map(ObjectPoint::bytes).sum(),
        }
    }
}

impl Layout {
    /// Where points belong. A grid stays where it was `before`, with the same settings, while the scene does not leave its
    /// bounds, nor shrink to less than half of them: otherwise whatever moves at the scene's border would move all points.
    fn new(
        settings: &Settings,
        places: Places,
        claimed: &Claimed,
        scene: &GpuScene,
        before: Option<&Self>,
    ) -> Self {
        let now = &scene.core;
        let is_near = |bounds: &Bounds| {
            let slack = bounds.diagonal() * 1e-3;
            *now == *bounds
                || now.min.cmpge(bounds.min - slack).all()
                    && now.max.cmple(bounds.max + slack).all()
                    && now.diagonal() > bounds.diagonal() * 0.5
        };
        match (places, before) {
            (Places::Grid, Some(Self::Grid(bounds, grid))) if is_near(bounds) => {
                Self::Grid(*bounds, *grid)
            }
            (Places::Grid, _) => Self::Grid(*now, Grid::new(now, settings.density)),
            (Places::Objects, _) => Self::Objects(claimed.clone()),
            (Places::Camera, _) => Self::Camera,
        }
    }

    fn places(&self) -> Places {
        match self {
            Self::Grid(..) => Places::Grid,
            Self::Objects(_) => Places::Objects,
            Self::Camera => Places::Camera,
        }
    }

    fn probes(&self, settings: &Settings, scene: &GpuScene) -> Result<gpu::Probes, (u64, u64)> {
        let resolution = settings.resolution;
        let probes = gpu::Probes {
            origin: [0.0; 3],
            side: settings.size,
            spacing: [1.0; 3],
            places: self.places() as u32,
            counts: UVec3::ONE.to_array(),
            count: 1,
            resolution,
            cubes_per_row: (WIDEST / (6 * resolution)).max(1),
            diagonal: scene.diagonal(),
            own: 0,
        };
        let within = |count: u64, most: u64| {
            if count <= most {
                Ok(count as u32)
            } else {
                Err((count, most))
            }
        };
        Ok(match self {
            Self::Grid(_, grid) => gpu::Probes {
                origin: grid.origin.to_array(),
                spacing: grid.spacing.to_array(),
                counts: grid.counts.to_array(),
                count: within(grid.len(), MOST_POINTS)?,
                ..probes
            },
            Self::Objects(claimed) => gpu::Probes {
                count: within(claimed.objects().len() as u64, MOST_OBJECTS)?,
                own: u32::from(settings.own_surface && settings.localize),
                ..probes
            },
            Self::Camera => probes,
        })
    }
}

/// What the plan decides: where the cubes are, what they show, and whether light bounces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ProbePlan {
    pub places: Places,
    /// Whether cubes show emitters, because no other technique adds their direct light.
    pub emission: bool,
    /// The same of the sky.
    pub environment: bool,
    /// Whether light bounces on among the lights; otherwise the techniques before this one already do that.
    pub bounces: bool,
}

/// What is to be made; `before`: what was made last.
pub fn key(
    settings: &Settings,
    own: ProbePlan,
    claimed: &Claimed,
    scene: &GpuScene,
    before: Option<&Key>,
) -> Key {
    let before = before.filter(|(of, ..)| of == settings);
    let before = before.map(|(.., layout)| layout);
    let layout = Layout::new(settings, own.places, claimed, scene, before);
    (settings.clone(), own, !scene.media.is_empty(), layout)
}

impl LitProbes {
    /// Nothing is lit yet.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        capture: &CaptureKernels,
        (settings, own, _, layout): Key,
    ) -> Result<Self, GpuError> {
        let probes = layout.probes(&settings, scene).map_err(|(needed, limit)| {
            let what = match layout {
                Layout::Objects(_) => "objects with reference points (name fewer)",
                _ => "reference points (lower final-gather.density)",
            };
            GpuError::TooLarge {
                what: what.into(),
                needed,
                limit,
                adapter: gpu.adapter.name.clone(),
            }
        })?;
        let has_own = probes.own == 1;
        let points = |points, placing| {
            let (side, at_once) = (settings.resolution, settings.faces_per_frame);
            let bench = || Bench::new(gpu, side);
            ProbeCubes::new(gpu, capture, side, points, placing, at_once, bench).map(Cubes::Own)
        };
        Ok(Self {
            cubes: match &layout {
                Layout::Objects(claimed) => {
                    let point = |object| ObjectPoint::new(gpu, capture, &settings, object, has_own);
                    Cubes::OfObjects {
                        objects: claimed.numbers().map(point).collect::<Result<_, _>>()?,
                        next: 0,
                    }
                }
                Layout::Grid(bounds, grid) => {
                    points(grid.points().collect(), Some(Placing::new(grid, bounds)))?
                }
                Layout::Camera => points(vec![Vec3::ZERO], None)?,
            },
            kernels: Kernels::new(gpu, scene, &settings, has_own)?,
            maps: Maps::new(gpu, &settings, probes)?,
            settings,
            own,
            layout,
            openness: Stage::default(),
            light: Stage::default(),
            bounced: 0,
            is_complete: false,
            revision: 0,
        })
    }

    /// Captures, lights and lets light bounce, as far as a frame may.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        eye: Vec3,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        let openness = earlier.openness().filter(|_| self.settings.occlusion);
        follow(&mut self.openness, openness, frame.gpu, scene)?;
        let is_lit = self.light(frame, scene, eye, earlier)?;
        if is_lit {
            self.bounced = 0;
        }
        let [stale, never, turns] = self.turns();
        let [was_placed, is_placed] = match &self.cubes {
            Cubes::Own(points) => points.are_placed(scene.versions.geometry),
            Cubes::OfObjects { .. } => [true; 2],
        };
        let is_lit_once = never == 0 && was_placed;
        let has_bounced = is_lit_once && self.bounce(frame, scene, &mut earlier.budget)?;
        let all = self.bounces();
        let done = (turns - stale) as f32 + self.bounced as f32 + f32::from(u8::from(is_placed));
        let is_first = !self.is_complete;
        self.is_complete |= is_lit_once && self.bounced >= all;
        // Dependents follow what is better than what could be gathered before.
        self.revision += u64::from(!is_first && (is_lit || has_bounced));
        Ok(Generated {
            revision: self.revision,
            progress: done / (turns as f32 + all as f32 + 1.0),
            pending: (!self.is_complete).then_some("the light of reference points"),
        })
    }

    /// Adds the light at the receiver's points: pass `final-gather.gather`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let maps = self.maps.resources();
        let (name, gather) = ("final-gather.gather", &self.kernels.gather);
        match self.openness.get_mut() {
            Some(openness) => {
                let factors = openness.record(frame, scene, receiver)?;
                let maps = join(&maps, &[("obscurances", factors)]);
                gather.record(frame, name, scene, receiver, &maps)
            }
            None => gather.record(frame, name, scene, receiver, &maps),
        }
    }

    /// The lights, the distances, and the memory that it takes to make them.
    pub fn inspect(&self) -> Inspection {
        let maps = &self.maps;
        let size = [6 * maps.probes.side * maps.probes.side, maps.probes.count];
        let lights = Map::of_colors("final-gather.lights", &maps.sources, size, 32);
        let distances = Map::of_texture("final-gather.distances", &maps.distances);
        let has_distances = self.settings.visibility == Visibility::Distance;
        let distances = has_distances.then_some(distances);
        Inspection {
            maps: [lights].into_iter().chain(distances).collect(),
            work_bytes: maps.lights.size() + self.cubes.bytes(),
            warnings: Vec::new(),
        }
    }

    /// Lights what is stale, as far as a frame may; whether there was anything.
    fn light(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        eye: Vec3,
        earlier: &mut Earlier<'_>,
    ) -> Result<bool, GpuError> {
        let from = matches!(self.layout, Layout::Camera).then_some(eye);
        let is_stale = self.light.renew((earlier.light.state(scene), from));
        let output = if self.settings.glossy {
            Output::RadianceToEye
        } else {
            Output::Irradiance
        };
        let probes = &self.maps.probes;
        let work = gpu::Work {
            point: 0,
            side: probes.side,
            resolution: probes.resolution,
            cubes_per_row: probes.cubes_per_row,
            with_emission: u32::from(self.own.emission),
            with_environment: u32::from(self.own.environment && scene.environment.is_some()),
            instance: u32::MAX,
            places: probes.places,
            // Only grids move their points.
            low: [1.0; 3],
            margin: 0.0,
            high: [0.0; 3],
            points: probes.count,
        };
        let making = FrameInputs {
            scene,
            kernels: &self.kernels,
            maps: &self.maps,
            output,
            work,
        };
        match &mut self.cubes {
            Cubes::Own(points) => {
                if is_stale {
                    points.invalidate();
                }
                if matches!(self.layout, Layout::Camera) {
                    points.positions[0] = eye;
                }
                let due = points.due(frame, scene, &self.maps.ways_out)?;
                for &turn in &due {
                    if !earlier.budget.may_step() {
                        break;
                    }
                    let faces = points.capture(frame, scene, output, turn)?;
                    let mut work = gpu::Work {
                        point: faces.cube as u32,
                        ..making.work
                    };
                    if let Some(reach) = faces.reach {
                        work.low = reach.low.to_array();
                        work.high = reach.high.to_array();
                        work.margin = reach.margin;
                    }
                    let bench = faces.bench;
                    bench.light(frame, making, earlier, &faces.points, &work)?;
                }
                Ok(!due.is_empty())
            }
            Cubes::OfObjects { objects, next } => {
                let count = objects.len();
                let (first, mut is_lit) = (*next, false);
                for index in (0..count).map(|offset| (first + offset) % count) {
                    let object = &mut objects[index];
                    if is_stale {
                        object.invalidate();
                    }
                    if object.light(frame, making, earlier, index as u32)? {
                        is_lit = true;
                        *next = (index + 1) % count;
                    }
                }
                Ok(is_lit)
            }
        }
    }

    /// Lets light bounce as often as a frame may; whether it did.
    fn bounce(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        budget: &mut Slice,
    ) -> Result<bool, GpuError> {
        let all = self.bounces();
        let most = if self.is_complete { 1 } else { BOUNCES_AT_ONCE };
        let most = most.min(all - self.bounced.min(all));
        let mut times = 0;
        budget.steps(
            most,
            &mut times,
            |_| false,
            |times| {
                *times += 1;
                Ok::<_, GpuError>(self.maps.lookups_of_bounce())
            },
        )?;
        if times > 0 {
            self.maps.bounce(frame, scene, &self.kernels, times)?;
            self.bounced += times;
        }
        Ok(times > 0)
    }

    fn bounces(&self) -> u32 {
        if self.own.bounces {
            self.settings.bounces
        } else {
            0
        }
    }

    /// Stale turns, turns that were never lit, and all turns.
    fn turns(&self) -> [usize; 3] {
        match &self.cubes {
            Cubes::Own(points) => {
                let [stale, never] = points.left();
                [stale, never, points.turns()]
            }
            Cubes::OfObjects { objects, .. } => {
                let stale = objects.iter().filter(|object| object.is_stale()).count();
                let never = objects.iter().filter(|object| !object.is_lit).count();
                [stale, never, objects.len()]
            }
        }
    }
}
