//! The passes of a gather: paths begin at a receiver's points, go on step by step, and their light is added to the target.
//! Nothing is read back; the GPU counts the paths of each step.

use bytemuck::Zeroable;
use gpugi_scene::Image;

use super::Settings;
use super::cache::Cache;
use crate::capture::{Output, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Named, join};
use crate::light_paths::{LightClass, PathFilter};
use crate::paths::gpu::{EyeUniform, Header, Parameters};
use crate::paths::{
    Kernels, LightBuffers, LightTable, PATH_ROWS, Sky, has_light_tree, has_straight,
};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;
use crate::stage::{Same, Stage};

/// Paths in flight, as far as a binding holds them: on a discrete GPU those of all pixels of a large picture, because each
/// step of few keeps it waiting; in software, as many as caches hold.
const PATHS_OF_A_PICTURE: u32 = 1 << 21;
const PATHS: u32 = 1 << 18;
const PATHS_IN_SOFTWARE: u32 = 1 << 14;
/// `MOST_FOLLOWED` of look.wesl.
const MOST_FOLLOWED: u32 = 8;
/// Bytes of a path, with its result.
const PATH_BYTES: u64 = (PATH_ROWS + 1) * 16;
/// Surfaces after which chance may end a path.
const ROULETTE_AFTER: u32 = 3;
/// Side of a block of points, whose paths are neighbours.
const BLOCK: u32 = 8;

/// What the passes are compiled for.
#[derive(Debug, Clone, PartialEq)]
pub struct Constants {
    values: Vec<(&'static str, f64)>,
    pattern: &'static str,
    /// Whether any object is an ideal mirror or glass.
    has_smooth: bool,
    /// Mirrors and glass behind which paths find the sky and lamps.
    most_shown: u32,
}

impl Constants {
    /// In `scene`, for paths of `pattern` over `bounces` surfaces. `shows_lights`: the pattern contains `LS+E`. `had_tree`:
    /// lights had a tree before, whose kernels are right without one, too, so that a lamp that goes off compiles nothing.
    pub fn of(
        scene: &GpuScene,
        pattern: &'static str,
        bounces: u32,
        (shows_lights, had_tree): (bool, bool),
    ) -> Self {
        let flag = |set: bool| f64::from(u8::from(set));
        let mut objects = scene.objects.iter();
        let passes_light = objects.any(|object| object.is_transmissive || object.is_translucent);
        let mut values = vec![
            ("HAS_TRANSMISSION", flag(passes_light)),
            ("HAS_STRAIGHT", flag(has_straight(scene.kept()))),
            ("HAS_PATH_FILTER", 1.0),
            ("HAS_KNOWN_LIGHT", 1.0),
            ("LIGHT_TRACER_HAS_LAMPS", 0.0),
            ("LIGHT_TRACER_MERGES", 0.0),
            ("HAS_LIGHT_TREE", flag(had_tree || has_light_tree(scene))),
            ("HAS_LIT_MEDIA", flag(scene.has_lit_media())),
        ];
        values.extend(scene.tracking_constants());
        values.extend(scene.ray_constants());
        Self {
            values,
            pattern,
            most_shown: match shows_lights {
                true => bounces.min(MOST_FOLLOWED),
                false => 0,
            },
            has_smooth: scene.objects.iter().any(|object| object.is_smooth),
        }
    }

    /// Whether kernels know of a tree of lights.
    pub fn has_tree(&self) -> bool {
        self.values.contains(&("HAS_LIGHT_TREE", 1.0))
    }
}

/// Lights of a scene that paths are led to.
#[derive(Debug, Default)]
pub struct Lights {
    /// The grid of the environment's image, and the light in it.
    sky: Stage<Option<Same<Image>>, (wgpu::Buffer, f64)>,
    table: Stage<Versions, Table>,
}

#[derive(Debug)]
struct Table {
    buffers: LightBuffers,
    count: u32,
    sky_probability: f32,
}

impl Lights {
    /// Follows the scene's lights.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(&mut self, gpu: &Gpu, scene: &GpuScene) -> Result<(), GpuError> {
        let environment = scene.environment.as_ref();
        let image = environment.map(|environment| Same(environment.image.clone()));
        let (sky, luminance) = self.sky.keep(image, |_| {
            let sky =
                environment.map_or_else(Sky::none, |environment| Sky::new(&environment.image));
            Ok::<_, GpuError>((sky.upload(gpu)?, sky.luminance))
        })?;
        let made_of = Inputs::LIGHTS | Inputs::SKY | Inputs::ENVIRONMENT;
        self.table.keep(scene.versions.of(made_of), |_| {
            let table = LightTable::new(scene, &LightClass::ALL, *luminance);
            Ok::<_, GpuError>(Table {
                buffers: LightBuffers::new(gpu, &table, sky.clone())?,
                count: table.rows.len() as u32,
                sky_probability: table.sky_probability,
            })
        })?;
        Ok(())
    }
}

/// The compiled passes, and the paths in flight.
#[derive(Debug)]
pub struct Passes {
    begin: Kernel,
    kernels: Kernels,
    add: Kernel,
    /// If there are ideal mirrors or glass.
    look: Option<Kernel>,
    /// What kernels that process vertices are compiled with.
    constants: Vec<(&'static str, f64)>,
    automaton: wgpu::Buffer,
    /// `trace` binds the eye, from which none of these paths begins.
    eye: wgpu::Buffer,
    arguments: wgpu::Buffer,
    /// `Pool` of paths/pool.wesl, and for how many paths.
    pool: Option<(u32, wgpu::Buffer)>,
    /// Light of earlier frames, if live pictures have been lit.
    cache: Option<Cache>,
}

impl Passes {
    /// Compiles the passes, for paths of `filter`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        constants: &Constants,
        filter: &PathFilter,
    ) -> Result<Self, GpuError> {
        let own = Some(&scene.layout);
        let begin = shader!("techniques.path_tracing.begin");
        let add = shader!("techniques.path_tracing.add");
        // Rays are traced later.
        let of_vertices = constants.values.iter().copied();
        let constants_of_vertices: Vec<_> = of_vertices
            .filter(|(name, _)| {
                ![
                    "SCENE_HAS_ALPHA",
                    "SCENE_HAS_SPHERES",
                    "HAS_MEDIA",
                    "HAS_UNEVEN_MEDIA",
                ]
                .contains(name)
            })
            .collect();
        let of_vertices = KernelOptions {
            constants: &constants_of_vertices,
            ..KernelOptions::default()
        };
        Ok(Self {
            begin: Kernel::with_options(gpu, &begin, "main", own, &of_vertices)?,
            kernels: Kernels::new(gpu, scene, &constants.values)?,
            add: Kernel::new(gpu, &add, "main", None)?,
            look: match constants.has_smooth {
                true => Some(scene.ray_kernel(
                    gpu,
                    &shader!("techniques.path_tracing.look"),
                    &[("MOST_SHOWN", f64::from(constants.most_shown))],
                )?),
                false => None,
            },
            constants: constants_of_vertices.clone(),
            automaton: gpu.storage("path-tracing.automaton", &filter.automaton().words())?,
            eye: gpu.uniform("path-tracing.eye", &EyeUniform::zeroed())?,
            arguments: gpu.buffer(
                "path-tracing.arguments",
                24,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT,
            )?,
            pool: None,
            cache: None,
        })
    }

    /// Adds light to the receiver's target.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        lights: &Lights,
        (settings, most_paths, places_of_block): (&Settings, Option<u32>, u32),
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let points = &receiver.points;
        let Some(table) = lights.table.get().filter(|_| points.lit > 0) else {
            return Ok(());
        };
        // Rows as wide as the picture's, for blocks of neighbours.
        let interval = (f64::from(points.count) / f64::from(points.lit))
            .sqrt()
            .round() as u32;
        let width = points.hits.texture().width().div_ceil(interval.max(1));
        let size = [width, points.lit.div_ceil(width)];
        let blocks = size
            .map(|side| side.div_ceil(BLOCK))
            .iter()
            .product::<u32>();
        let remembers =
            settings.cache && receiver.target.is_noisy() && points.output == Output::RadianceToEye;
        let places_of_block = match remembers {
            true => places_of_block,
            false => 0,
        };
        let of_block = BLOCK * BLOCK * settings.samples + places_of_block;
        let most = most_paths.unwrap_or_else(|| most_paths_of(gpu));
        let (capacity, pool) = self.pool(gpu, (blocks * of_block).min(most).max(of_block))?;
        let blocks_at_once = most.min(capacity) / of_block;
        let (of_scene, of_rays) = (Some(&scene.bind_group), Some(&scene.ray_bind_group));
        if let Some(look) = self.look.as_ref().filter(|_| receiver.target.is_noisy()) {
            let resources = receiver.resources().map(|(name, resource)| match name {
                "seen" => ("seen_by", resource),
                _ => (name, resource),
            });
            frame.run(
                "path-tracing.look",
                look,
                of_rays,
                &resources,
                [points.count, 1, 1],
            )?;
        }
        match (settings.cache, &self.cache) {
            (true, None) if remembers => {
                self.cache = Some(Cache::new(gpu, scene, &self.constants)?);
            }
            (false, Some(_)) => self.cache = None,
            _ => {}
        }
        // While its shaders are compiled, frames do without.
        let turned = match &mut self.cache {
            Some(cache) if remembers && cache.is_ready(frame) => {
                Some(cache.turned(frame, blocks * places_of_block)?)
            }
            _ => None,
        };
        for first_block in (0..blocks).step_by(blocks_at_once as usize) {
            let count = blocks_at_once.min(blocks - first_block);
            let parameters = Parameters {
                tile_width: size[0],
                tile_height: size[1],
                first_block,
                samples: settings.samples,
                max_bounces: settings.bounces,
                roulette_after: ROULETTE_AFTER,
                light_count: table.count,
                sky_probability: table.sky_probability,
                emission_classes: 3,
                first_remembered: count * BLOCK * BLOCK * settings.samples,
                places_of_block,
                near_light: scene.near_in_media(),
                ..Parameters::zeroed()
            };
            let parameters = gpu.constant("path-tracing.settings", &parameters)?;
            let of_points: [Named<'_>; 6] = [
                ("seen_by", &points.view),
                ("points", &points.points),
                ("radiance", &receiver.target.radiance),
                ("noisy", &receiver.target.noisy),
                ("settings", &parameters),
                ("pool", &pool),
            ];
            let of_paths: [Named<'_>; 5] = [
                ("seen", &self.eye),
                ("settings", &parameters),
                ("automaton", &self.automaton),
                ("pool", &pool),
                ("arguments", &self.arguments),
            ];
            let [rows, emitters, sky] = table.buffers.named();
            let lights: [Named<'_>; 3] =
                [(rows.0, rows.1), (emitters.0, emitters.1), (sky.0, sky.1)];
            let begin = join(&of_points, &[("automaton", &self.automaton)]);
            let begin = join(&begin, &lights);
            let shade = join(&of_paths, &lights);
            let of_known: [Named<'_>; 4] = [
                ("seen_by", &points.view),
                ("settings", &parameters),
                ("automaton", &self.automaton),
                ("pool", &pool),
            ];
            frame.clear_range(&pool, 4..size_of::<Header>() as u64);
            let items = [count * BLOCK * BLOCK * settings.samples, 1, 1];
            frame.run("path-tracing.begin", &self.begin, of_scene, &begin, items)?;
            if let Some(cache) = &turned {
                let begin = join(&of_known[1..], &lights);
                cache.begin(frame, scene, &begin, count * places_of_block)?;
            }
            frame.compute("path-tracing.trace", |pass| {
                for _ in 0..settings.bounces {
                    let Kernels {
                        plan,
                        trace,
                        shade: vertices,
                    } = &self.kernels;
                    plan.run(pass, None, &of_paths, [1, 1, 1])?;
                    trace.run_indirect(pass, of_rays, &of_paths, (&self.arguments, 0))?;
                    if let Some(cache) = &turned {
                        cache.end(pass, scene, &of_known, (&self.arguments, 12))?;
                    }
                    vertices.run_indirect(pass, of_rays, &shade, (&self.arguments, 12))?;
                }
                Ok::<_, GpuError>(())
            })?;
            let points = [count * BLOCK * BLOCK, 1, 1];
            frame.run("path-tracing.add", &self.add, None, &of_points, points)?;
            if let Some(cache) = &turned {
                cache.learn(frame, &of_known, count * places_of_block)?;
            }
        }
        Ok(())
    }

    /// Lets paths of this frame end on the light that those of earlier frames have found, while the scene is at `versions`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn settle(&mut self, frame: &mut Frame<'_>, versions: Versions) -> Result<(), GpuError> {
        match &mut self.cache {
            Some(cache) => cache.settle(frame, versions),
            None => Ok(()),
        }
    }

    /// Memory for so many paths at once.
    fn pool(&mut self, gpu: &Gpu, capacity: u32) -> Result<(u32, wgpu::Buffer), GpuError> {
        if let Some((there, pool)) = self.pool.as_ref().filter(|(there, _)| *there >= capacity) {
            return Ok((*there, pool.clone()));
        }
        let bytes = size_of::<Header>() as u64 + u64::from(capacity) * PATH_BYTES;
        let pool = gpu.buffer(
            "path-tracing.pool [bytes]",
            bytes,
            wgpu::BufferUsages::STORAGE,
        )?;
        gpu.write(
            &pool,
            0,
            &[Header {
                capacity,
                ..Header::zeroed()
            }],
        );
        self.pool = Some((capacity, pool.clone()));
        Ok((capacity, pool))
    }

    /// Memory of the paths in flight (bytes).
    pub fn bytes(&self) -> u64 {
        let cache = self.cache.as_ref().map_or(0, Cache::bytes);
        self.pool.as_ref().map_or(0, |(_, pool)| pool.size()) + cache
    }
}

/// Most paths in flight on an adapter.
fn most_paths_of(gpu: &Gpu) -> u32 {
    let most = match gpu.adapter.device_type {
        wgpu::DeviceType::Cpu => PATHS_IN_SOFTWARE,
        wgpu::DeviceType::DiscreteGpu => PATHS_OF_A_PICTURE,
        _ => PATHS,
    };
    let limits = gpu.limits();
    let bytes = (limits.max_buffer_size).min(limits.max_storage_buffer_binding_size);
    let bound = (bytes - size_of::<Header>() as u64) / PATH_BYTES;
    u64::from(most).min(bound) as u32
}
