//! The passes of a gather: rays from a receiver's points, generation by generation. Nothing is read back; the GPU sets
//! the number of workgroups of each generation.

use bytemuck::Zeroable;

use super::{SeenEnvironment, Settings, Tracer, gpu};
use crate::capture::{Output, Receiver, SurfacePoints, Target, ViewUniform};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join, read_buffer};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;
use crate::stage::Stage;
use crate::techniques::{Earlier, Figure, MediaSources};

/// Bytes per ray in `rows` of rays.wesl: eight rows of 16 bytes, and an entry in each of two lists.
const RAY_BYTES: u64 = 8 * 16 + 2 * 4;
/// Most rays in flight. A receiver with more points is handled in chunks.
pub const MOST_RAYS: u64 = 1 << 21;
/// With `cones`: all groups of rays have one dispatch.
const MOST_RAYS_OF_CONES: u64 = 1 << 20;
/// Tests of a ray against a triangle in a dispatch of `engine`: some 10 ms on a large GPU, 100 ms on a small one, and
/// likewise on a processor.
const MOST_TESTS: u64 = 1 << 30;
const MOST_TESTS_IN_SOFTWARE: u64 = 1 << 25;
/// With `cones`, a dispatch may stand for this many times as many tests: cones have spared three quarters or more of them
/// wherever that was measured.
const SPARED_BY_CONES: u64 = 4;
/// Of a triangle or a block of them, a `vec4f`.
const SPHERE_BYTES: u64 = 16;
/// Triangles of a block: `BLOCK` of triangles.wesl.
const BLOCK: u32 = 64;
/// Invocations of a workgroup of `engine` and `cones`, and rays of a tile.
const TILE: u32 = 256;
/// `RAYS` of ray_groups.wesl.
const RAYS_PER_GROUP: u32 = 32;
/// Most groups of a tile's rays, which are in eight octants.
const GROUPS_PER_TILE: u32 = TILE / RAYS_PER_GROUP + 7;
/// Workgroups of an indirect dispatch along one axis.
const MOST_WORKGROUPS: u32 = 65_535;
const _: () = assert!(MOST_RAYS_OF_CONES as u32 / TILE * GROUPS_PER_TILE <= MOST_WORKGROUPS);
/// `ROW_OF_POINTS` of plan.wesl.
const ROW_OF_POINTS: u32 = 1024;
/// Bytes of the header that are zero when a chunk begins.
const COUNTERS: u64 = std::mem::offset_of!(gpu::Header, capacity) as u64;

/// The compiled passes, and the rays in flight.
#[derive(Debug)]
pub struct Passes {
    begin: Kernel,
    plan: Kernel,
    advance: Kernel,
    /// Bounding spheres of triangles and groups of rays, for `cones`.
    of_cones: Option<[Kernel; 2]>,
    trace: Kernel,
    media: Kernel,
    shade: Kernel,
    add: Kernel,
    pub(super) in_flight: Option<InFlight>,
    /// All triangles, if the tracer tests every one.
    triangles: Stage<Versions, Option<Triangles>>,
    no_media: MediaSources,
    settings: Settings,
}

/// Memory of the rays in flight, one slot per ray.
#[derive(Debug)]
pub(super) struct InFlight {
    pub capacity: u32,
    pub rays: wgpu::Buffer,
    arguments: wgpu::Buffer,
    /// `Groups` of ray_groups.wesl, for `cones`.
    groups: Option<wgpu::Buffer>,
    /// The points that rays hit, which the techniques before this one light.
    hits: Receiver,
}

/// The triangles of all instances.
#[derive(Debug)]
struct Triangles {
    /// `runs` of triangles.wesl.
    runs: wgpu::Buffer,
    count: u32,
    /// Their bounding spheres, for `cones`, and whether these are yet to be made.
    spheres: Option<wgpu::Buffer>,
    is_unbounded: bool,
}

impl Passes {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
        let own = Some(&scene.layout);
        let kernel = |shader, layout| Kernel::new(gpu, &shader, "main", layout);
        let trace = match settings.tracer {
            Tracer::Bvh => shader!("techniques.ray_tracing.bvh"),
            Tracer::Engine => shader!("techniques.ray_tracing.engine"),
            Tracer::Cones => shader!("techniques.ray_tracing.cones"),
        };
        let spheres = shader!("techniques.ray_tracing.spheres");
        let groups = shader!("techniques.ray_tracing.groups");
        let shade = shader!("techniques.ray_tracing.shade");
        let media = shader!("techniques.ray_tracing.media");
        Ok(Self {
            begin: kernel(shader!("techniques.ray_tracing.begin"), own)?,
            of_cones: match settings.tracer {
                Tracer::Cones => Some([
                    kernel(spheres, Some(&scene.ray_layout))?,
                    kernel(groups, None)?,
                ]),
                Tracer::Bvh | Tracer::Engine => None,
            },
            plan: kernel(shader!("techniques.ray_tracing.plan"), None)?,
            advance: kernel(shader!("techniques.ray_tracing.advance"), None)?,
            trace: scene.ray_kernel(gpu, &trace, &[("LOWEST_WINS", 1.0)])?,
            media: scene.ray_kernel(gpu, &media, &[])?,
            shade: Kernel::with_constants(gpu, &shade, "main", own, &[scene.media_constant()])?,
            add: kernel(shader!("techniques.ray_tracing.add"), None)?,
            in_flight: None,
            triangles: Stage::default(),
            no_media: MediaSources::none(gpu)?,
            settings: settings.clone(),
        })
    }

    /// Follows the scene's triangles, if the tracer tests every one.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(&mut self, gpu: &Gpu, scene: &GpuScene) -> Result<(), GpuError> {
        if self.settings.tracer == Tracer::Bvh {
            return Ok(());
        }
        let versions = scene.versions.of(Inputs::GEOMETRY | Inputs::INSTANCES);
        let has_spheres = self.of_cones.is_some();
        let made = self.triangles.keep(versions, |_| {
            let Some(runs) = scene.triangle_runs(gpu)? else {
                return Ok(None);
            };
            let count = runs.last().map_or(0, |all| all[2]);
            let bytes = u64::from(count.max(1) + count.div_ceil(BLOCK)) * SPHERE_BYTES;
            let spheres = || gpu.room("ray-tracing.spheres [bytes]", bytes);
            Ok(Some(Triangles {
                runs: gpu.storage("ray-tracing.triangles [bytes]", &runs)?,
                count,
                spheres: has_spheres.then(spheres).transpose()?,
                is_unbounded: has_spheres,
            }))
        });
        made.map(drop)
    }

    fn all_triangles(&self) -> Option<&Triangles> {
        self.triangles.get()?.as_ref()
    }

    /// Number of triangles against which every ray is tested.
    pub fn triangles(&self) -> u32 {
        self.all_triangles().map_or(0, |all| all.count)
    }

    /// Adds what the rays from a receiver's points find, with at most `most_rays` in flight. `media`: those that rays pass.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        (settings, most_rays): (&Settings, u64),
        media: Option<MediaSources>,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        if self.settings != *settings {
            self.settings = settings.clone();
        }
        let points = receiver.points.count;
        let most_rays = match settings.tracer {
            Tracer::Cones => most_rays.min(MOST_RAYS_OF_CONES),
            Tracer::Bvh | Tracer::Engine => most_rays,
        };
        let wanted = slots(gpu, points, settings.split, most_rays);
        let in_flight = match self.in_flight.take() {
            Some(made) if made.capacity >= wanted => made,
            _ => InFlight::new(gpu, wanted, settings.tracer)?,
        };
        let in_flight = &*self.in_flight.insert(in_flight);
        let media = media.as_ref().unwrap_or(&self.no_media);
        let triangles = self.triangles.get_mut().and_then(Option::as_mut);
        let is_unbounded = triangles.map(|all| std::mem::take(&mut all.is_unbounded));
        let triangles = self.triangles.get().and_then(Option::as_ref);
        let mut shared = join(&receiver.resources(), &in_flight.resources());
        shared.extend(media.resources());
        if let Some(groups) = &in_flight.groups {
            shared.push(("groups", groups));
        }
        if let Some(all) = triangles {
            shared.push(("runs", &all.runs));
            if let Some(spheres) = &all.spheres {
                shared.push(("spheres", spheres));
            }
        }
        let (of_scene, of_rays) = (Some(&scene.bind_group), Some(&scene.ray_bind_group));
        if let (Some([spheres, _]), Some(all), Some(true)) =
            (&self.of_cones, triangles, is_unbounded)
        {
            let (name, count) = ("ray-tracing.spheres", [all.count, 1, 1]);
            frame.run(name, spheres, of_rays, &shared, count)?;
        }
        let sees_only_environment = settings.environment == SeenEnvironment::Only;
        let of_media = |number: u32| if sees_only_environment { 0 } else { number };
        let several = points.div_ceil(in_flight.capacity >> settings.split).max(1);
        let count = points.div_ceil(several);
        for number in 0..several {
            let values = gpu::Chunk {
                first: number * count,
                count: count.min(points.saturating_sub(number * count)),
                bounces: settings.bounces,
                split: settings.split,
                tests: most_tests(gpu, settings.tracer),
                sees_only_environment: u32::from(sees_only_environment),
                media_directions: of_media(media.directions),
                marched_lights: of_media(media.marched_lights),
            };
            let chunk = gpu.constant("ray-tracing.chunk", &values)?;
            let resources = join(&shared, &[("chunk", &chunk)]);
            frame.clear_range(&in_flight.rays, 0..COUNTERS);
            let (name, slots) = ("ray-tracing.begin", [in_flight.capacity, 1, 1]);
            frame.run(name, &self.begin, of_scene, &resources, slots)?;
            for generation in 1..=settings.bounces {
                frame.run("ray-tracing.plan", &self.plan, None, &resources, [1, 1, 1])?;
                if let Some([_, groups]) = &self.of_cones {
                    frame.run("ray-tracing.groups", groups, None, &resources, slots)?;
                }
                let times = triangles.map_or(1, |all| {
                    passes(all.count, values.count << values.split, values.tests)
                });
                frame.compute("ray-tracing.trace", |pass| {
                    for time in 0..times {
                        if time > 0 {
                            self.advance.run(pass, None, &resources, [1, 1, 1])?;
                        }
                        // Of one workgroup per group of rays, if there are groups.
                        let offset = if self.of_cones.is_some() { 24 } else { 12 };
                        let workgroups = (&in_flight.arguments, offset);
                        self.trace
                            .run_indirect(pass, of_rays, &resources, workgroups)?;
                    }
                    Ok::<_, GpuError>(())
                })?;
                let workgroups = (&in_flight.arguments, 0);
                if values.marched_lights > 0 {
                    frame.compute("ray-tracing.media", |pass| {
                        self.media
                            .run_indirect(pass, of_rays, &resources, workgroups)
                    })?;
                }
                frame.compute("ray-tracing.shade", |pass| {
                    self.shade
                        .run_indirect(pass, of_scene, &resources, workgroups)
                })?;
                if !sees_only_environment {
                    earlier.gather(frame, scene, &in_flight.hits, false)?;
                } else if generation < settings.bounces {
                    continue;
                }
                let (name, count) = ("ray-tracing.add", [values.count, 1, 1]);
                frame.run(name, &self.add, None, &resources, count)?;
            }
        }
        Ok(())
    }

    /// Rays, the bytes that they take in each generation, and the share of tests against triangles that cones
    /// spare, since the last call.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn figures(&self, gpu: &Gpu) -> Result<Vec<Figure>, GpuError> {
        let Some(in_flight) = &self.in_flight else {
            return Ok(Vec::new());
        };
        let counted = in_flight.counted(gpu)?;
        let all = counted.rays.map(f64::from).iter().sum();
        let mut figures =
            vec![Figure::new("ray-tracing.rays", all, "rays").by("ray-tracing.trace")];
        let bytes_per_ray = in_flight.bytes() / u64::from(in_flight.capacity);
        let generations = counted.rays.iter().take(self.settings.bounces as usize);
        for (index, &rays) in generations.enumerate() {
            let name = format!("ray-tracing.rays of generation {}", index + 1);
            figures.push(Figure::new(&name, f64::from(rays), "rays"));
            let name = format!("ray-tracing.bytes of generation {}", index + 1);
            let bytes = u64::from(rays) * bytes_per_ray;
            figures.push(Figure::new(&name, bytes as f64, "bytes"));
        }
        let [tests, left] = [counted.tests, counted.tests_left]
            .map(|[low, high]| f64::from(high) * 2_f64.powi(32) + f64::from(low));
        if tests > 0.0 {
            let share = 100.0 * (1.0 - left / tests);
            figures.push(Figure::new("ray-tracing.culled by cones", share, "%"));
        }
        Ok(figures)
    }

    /// Memory of the rays in flight (bytes).
    pub fn bytes(&self) -> u64 {
        self.in_flight.as_ref().map_or(0, InFlight::bytes)
    }
}

/// Tests against triangles that rays of a dispatch may make, of which `cones` spares some, divided by [`TILE`]. The step of
/// a single ray is [`TILE`] times as large and has 32 bits.
fn most_tests(gpu: &Gpu, tracer: Tracer) -> u32 {
    let tests = match gpu.adapter.device_type {
        wgpu::DeviceType::Cpu => MOST_TESTS_IN_SOFTWARE,
        _ => MOST_TESTS,
    };
    let tests = match tracer {
        Tracer::Cones => tests * SPARED_BY_CONES,
        Tracer::Bvh | Tracer::Engine => tests,
    };
    tests.min(u32::MAX.into()) as u32 / TILE
}

/// Passes in which so many rays are tested against all triangles: by the step that plan.wesl sets.
fn passes(triangles: u32, rays: u32, tests: u32) -> u32 {
    let step = u64::from((tests / rays.max(1)).max(1)) * u64::from(TILE);
    u64::from(triangles).div_ceil(step).max(1) as u32
}

/// Slots for a receiver of so many points.
fn slots(gpu: &Gpu, points: u32, split: u32, most_rays: u64) -> u32 {
    let limits = gpu.limits();
    let bytes = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size)
        - size_of::<gpu::Header>() as u64;
    let row = u64::from(ROW_OF_POINTS);
    let most = (bytes / RAY_BYTES).min(most_rays) / row * row;
    let wanted = (u64::from(points) << split).next_multiple_of(row);
    wanted.clamp(row, most) as u32
}

impl InFlight {
    fn new(gpu: &Gpu, capacity: u32, tracer: Tracer) -> Result<Self, GpuError> {
        let storage = wgpu::BufferUsages::STORAGE;
        let bytes = size_of::<gpu::Header>() as u64 + u64::from(capacity) * RAY_BYTES;
        let rays = gpu.room("ray-tracing.rays [bytes]", bytes)?;
        let header = gpu::Header {
            capacity,
            ..gpu::Header::zeroed()
        };
        gpu.write(&rays, 0, &[header]);
        let view = gpu.buffer(
            "ray-tracing.view",
            size_of::<ViewUniform>() as u64,
            storage | wgpu::BufferUsages::UNIFORM,
        )?;
        let (label, output) = ("ray-tracing.points [bytes]", Output::RadianceToEye);
        let size = [ROW_OF_POINTS, capacity / ROW_OF_POINTS];
        let hits = SurfacePoints::room(gpu, label, size, view, output)?;
        let groups = u64::from(capacity) + 2 * u64::from(capacity / TILE * GROUPS_PER_TILE);
        let groups = (tracer == Tracer::Cones)
            .then(|| gpu.room("ray-tracing.groups [bytes]", 4 * groups))
            .transpose()?;
        Ok(Self {
            capacity,
            groups,
            arguments: gpu.buffer(
                "ray-tracing.arguments",
                36,
                storage | wgpu::BufferUsages::INDIRECT,
            )?,
            hits: Receiver::new(&hits, &Target::new(gpu, capacity)?),
            rays,
        })
    }

    /// What passes bind of them.
    fn resources(&self) -> [Named<'_>; 6] {
        [
            ("rays", &self.rays),
            ("arguments", &self.arguments),
            ("hits_seen", &self.hits.points.view),
            ("hit_points", &self.hits.points.points),
            ("hits", &self.hits.points.hits),
            ("gathered", &self.hits.target),
        ]
    }

    /// What the passes have counted, which begins anew.
    fn counted(&self, gpu: &Gpu) -> Result<gpu::Counted, GpuError> {
        let size = size_of::<gpu::Header>() as u64;
        let header: Vec<gpu::Header> = read_buffer(gpu, &self.rays, size)?;
        let place = std::mem::offset_of!(gpu::Header, counted) as u64;
        gpu.write(&self.rays, place, &[gpu::Counted::zeroed()]);
        Ok(header[0].counted)
    }

    fn bytes(&self) -> u64 {
        let points = &self.hits.points;
        let texels = u64::from(self.capacity) * 4;
        let buffers = [&self.rays, &points.points, &self.hits.target.radiance];
        let groups = self.groups.as_ref().map_or(0, wgpu::Buffer::size);
        buffers.map(wgpu::Buffer::size).iter().sum::<u64>() + texels + groups
    }
}
