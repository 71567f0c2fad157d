//! The reference points and their lights, as they were made for a scene and settings.

use glam::{UVec3, Vec3};
use gpugi_scene::Bounds;

use super::gpu;
use super::maps::{Bench, Kernels, Making, Maps};
use super::objects::ObjectPoint;
use super::places::Places;
use super::settings::{Settings, Visibility};
use crate::capture::{Output, Receiver};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::probes::{Grid, Placing, ProbeCubes};
use crate::scene::{GpuScene, Versions};
use crate::techniques::openness::following;
use crate::techniques::{
    Earlier, Generated, Inspection, Map, ObjectMapsKey, OpennessLookup, Texels,
};

/// Most reference points of a grid, and most objects with one.
const MOST_POINTS: u64 = 4096;
pub const MOST_OBJECTS: u64 = 32;
/// Bounces per frame before the light is gathered for the first time; later a frame has one.
const BOUNCES_AT_ONCE: u32 = 16;
/// Widest map of distances (texels): WebGPU promises this much.
const WIDEST: u32 = 8192;

/// The reference points and their lights, and what they were made for.
#[derive(Debug)]
pub struct Made {
    settings: Settings,
    own: Own,
    /// Whether the passes look for media.
    knows_media: bool,
    of: Layout,
    kernels: Kernels,
    maps: Maps,
    cubes: Cubes,
    /// With `occlusion`, what multiplies the light.
    openness: Option<Box<dyn OpennessLookup>>,
    lit_as: Option<LitAs>,
    /// Bounces since the light last changed.
    bounced: u32,
    /// Whether the lights have been complete once, so that they can be gathered.
    is_complete: bool,
    revision: u64,
}

/// Where the reference points are.
#[derive(Debug)]
enum Layout {
    /// In a grid, in these bounds.
    Grid(Bounds, Grid),
    Objects(ObjectMapsKey<Settings>),
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

/// Everything that the light in the cubes depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LitAs {
    versions: Versions,
    settings: u64,
    revision: u64,
    eye: Option<Vec3>,
}

impl Layout {
    fn new(settings: &Settings, places: Places, claimed: &[u32], scene: &GpuScene) -> Self {
        match places {
            Places::Grid => {
                let grid = Grid::new(&scene.core, settings.density);
                Self::Grid(scene.core, grid)
            }
            Places::Objects => Self::Objects(ObjectMapsKey::new(settings, claimed, scene)),
            Places::Camera => Self::Camera,
        }
    }

    /// Whether it serves the scene as it is, with the same settings. A grid stays while the scene does not leave its
    /// bounds, nor shrink to less than half of them: otherwise whatever moves at the scene's border would move all
    /// points.
    fn serves(&self, settings: &Settings, claimed: &[u32], scene: &GpuScene) -> bool {
        match self {
            Self::Grid(bounds, _) => {
                let now = &scene.core;
                let slack = bounds.diagonal() * 1e-3;
                *now == *bounds
                    || now.min.cmpge(bounds.min - slack).all()
                        && now.max.cmple(bounds.max + slack).all()
                        && now.diagonal() > bounds.diagonal() * 0.5
            }
            Self::Objects(key) => key.serves(settings, claimed, scene),
            Self::Camera => true,
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
            Self::Objects(key) => gpu::Probes {
                count: within(key.objects().count() as u64, MOST_OBJECTS)?,
                own: u32::from(settings.own_surface && settings.localize),
                ..probes
            },
            Self::Camera => probes,
        })
    }
}

/// What the plan decides: where the cubes are, what they show, and whether light bounces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Own {
    pub places: Places,
    /// Whether cubes show emitters, because no other technique adds their direct light.
    pub emission: bool,
    /// The same of the sky.
    pub environment: bool,
    /// Whether light bounces on among the lights; otherwise the techniques before this one already do that.
    pub bounces: bool,
}

impl Made {
    /// Nothing is lit yet. `claimed`: the instances with a reference point, if objects have them.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        earlier: &Earlier<'_>,
        settings: &Settings,
        own: Own,
        claimed: &[u32],
    ) -> Result<Self, GpuError> {
        let of = Layout::new(settings, own.places, claimed, scene);
        let probes = of.probes(settings, scene).map_err(|(needed, limit)| {
            let what = match of {
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
        let kernels = Kernels::new(gpu, scene, settings, probes.own == 1)?;
        let maps = Maps::new(gpu, &kernels, settings, probes)?;
        let capture = earlier.impostors.capture_kernels();
        let own_cubes = |points: Vec<Vec3>, placing: Option<Placing>| {
            let side = maps.probes.resolution;
            let at_once = settings.faces_per_frame;
            let bench = || Bench::new(gpu, &kernels, &maps, side);
            ProbeCubes::new(gpu, capture, side, points, placing, at_once, bench).map(Cubes::Own)
        };
        let cubes = match &of {
            Layout::Objects(key) => {
                let objects = key.objects().map(|(instance, _)| {
                    ObjectPoint::new(gpu, capture, &kernels, &maps, settings, instance)
                });
                Cubes::OfObjects {
                    objects: objects.collect::<Result<_, _>>()?,
                    next: 0,
                }
            }
            Layout::Grid(bounds, grid) => {
                own_cubes(grid.points().collect(), Some(Placing::new(grid, bounds)))?
            }
            Layout::Camera => own_cubes(vec![Vec3::ZERO], None)?,
        };
        Ok(Self {
            settings: settings.clone(),
            own,
            knows_media: !scene.media.is_empty(),
            of,
            kernels,
            maps,
            cubes,
            openness: None,
            lit_as: None,
            bounced: 0,
            is_complete: false,
            revision: 0,
        })
    }

    /// Whether it serves these settings and the scene as it is.
    pub fn serves(&self, settings: &Settings, own: Own, claimed: &[u32], scene: &GpuScene) -> bool {
        self.settings == *settings
            && self.own == own
            && self.knows_media != scene.media.is_empty()
            && self.of.serves(settings, claimed, scene)
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
        self.openness = following(self.openness.take(), openness, frame.gpu, scene)?;
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
        let has_bounced = is_lit_once && self.bounce(frame, scene, earlier);
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
        let openness = match &mut self.openness {
            Some(openness) => Some(openness.record(frame, scene, receiver)?),
            None => None,
        };
        let gathered = self.maps.gathered(frame.gpu, &self.kernels, openness)?;
        let gather = &mut self.kernels.gather;
        gather.record(frame, "final-gather.gather", scene, receiver, &[gathered])
    }

    /// The lights, the distances, and the memory that it takes to make them.
    pub fn inspect(&self) -> Inspection {
        let maps = &self.maps;
        let lights = Map {
            name: "final-gather.lights".into(),
            texels: Texels::Buffer {
                buffer: maps.sources.clone(),
                size: [6 * maps.probes.side * maps.probes.side, maps.probes.count],
                stride: 32,
                is_number: false,
            },
        };
        let distances = Map {
            name: "final-gather.distances".into(),
            texels: Texels::Texture(maps.distances.clone()),
        };
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
        let now = LitAs {
            versions: scene.versions,
            settings: earlier.settings_version,
            revision: earlier.revision,
            eye: matches!(self.of, Layout::Camera).then_some(eye),
        };
        let is_stale = self.lit_as != Some(now);
        self.lit_as = Some(now);
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
        let making = Making {
            scene,
            kernels: &self.kernels,
            output,
            work,
        };
        match &mut self.cubes {
            Cubes::Own(points) => {
                if is_stale {
                    points.invalidate();
                }
                if matches!(self.of, Layout::Camera) {
                    points.positions[0] = eye;
                }
                let due = points.due(frame, scene, &self.maps.ways_out)?;
                for &turn in &due {
                    if !earlier.may_step() {
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
        earlier: &mut Earlier<'_>,
    ) -> bool {
        let all = self.bounces();
        let most = if self.is_complete { 1 } else { BOUNCES_AT_ONCE };
        let most = most.min(all - self.bounced.min(all));
        let mut times = 0;
        while times < most && earlier.may_step() {
            earlier.count(self.maps.lookups_of_bounce());
            times += 1;
        }
        if times > 0 {
            self.maps.bounce(frame, scene, &self.kernels, times);
            self.bounced += times;
        }
        times > 0
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
                let stale = objects.iter().filter(|one| one.is_stale()).count();
                let never = objects.iter().filter(|one| !one.is_lit).count();
                [stale, never, objects.len()]
            }
        }
    }
}
