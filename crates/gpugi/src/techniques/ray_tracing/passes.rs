//! The passes of a gather: rays from a receiver's points, generation by generation. Nothing is read back; the GPU sets
//! the number of workgroups of each generation.

use bytemuck::Zeroable;

use super::{SeenEnvironment, Settings, Tracer, gpu};
use crate::capture::{
    Output, PerReceiver, Receiver, SURFACE_POINT_BYTES, Slots, SurfacePoints, Target, ViewUniform,
    hits_of_points,
};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, read_buffer};
use crate::scene::GpuScene;
use crate::shader;
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
    media_kernel: Kernel,
    shade: Kernel,
    add: Kernel,
    pub(super) in_flight: Option<InFlight>,
    chunks: PerReceiver<Vec<Chunk>>,
    /// All triangles, if the tracer tests every one.
    triangles: Option<Triangles>,
    /// Media that rays pass, and bind groups 2 of `media_kernel` and `shade`.
    media: (MediaSources, [wgpu::BindGroup; 2]),
    /// With which `chunks` are bound.
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
    hit_records: wgpu::TextureView,
}

/// The triangles of all instances.
#[derive(Debug)]
struct Triangles {
    /// Bind group 2 of `trace`, and of `advance`.
    group: wgpu::BindGroup,
    advance_group: wgpu::BindGroup,
    /// Bind group 2 of the pass that makes their bounding spheres, until it has run.
    spheres: Option<wgpu::BindGroup>,
    count: u32,
    /// For which geometry and instances.
    versions: [u64; 2],
}

/// A part of a receiver's points, as large as the rays in flight allow.
#[derive(Debug)]
struct Chunk {
    begin: [wgpu::BindGroup; 2],
    plan: [wgpu::BindGroup; 2],
    advance: wgpu::BindGroup,
    /// Groups the rays, for `cones`.
    group: Option<wgpu::BindGroup>,
    trace: [wgpu::BindGroup; 2],
    media: [wgpu::BindGroup; 2],
    shade: [wgpu::BindGroup; 2],
    add: [wgpu::BindGroup; 3],
    values: gpu::Chunk,
}

impl Passes {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
        let layout = Some(&scene.layout);
        let trace = match settings.tracer {
            Tracer::Bvh => shader!("techniques.ray_tracing.bvh"),
            Tracer::Engine => shader!("techniques.ray_tracing.engine"),
            Tracer::Cones => shader!("techniques.ray_tracing.cones"),
        };
        let plan = shader!("techniques.ray_tracing.plan");
        let advance = shader!("techniques.ray_tracing.advance");
        let [begin, add] = [
            (shader!("techniques.ray_tracing.begin"), layout),
            (shader!("techniques.ray_tracing.add"), None),
        ]
        .map(|(shader, layout)| Kernel::new(gpu, &shader, "main", layout));
        let shade = shader!("techniques.ray_tracing.shade");
        let options = KernelOptions {
            constants: &[scene.media_constant()],
            ..Default::default()
        };
        let shade = Kernel::with_options(gpu, &shade, "main", layout, &options)?;
        let of_cones = match settings.tracer {
            Tracer::Cones => {
                let shader = shader!("techniques.ray_tracing.spheres");
                let spheres = Kernel::new(gpu, &shader, "main", Some(&scene.ray_layout))?;
                let shader = shader!("techniques.ray_tracing.groups");
                Some([spheres, Kernel::new(gpu, &shader, "main", None)?])
            }
            Tracer::Bvh | Tracer::Engine => None,
        };
        let media = shader!("techniques.ray_tracing.media");
        let media_kernel = scene.ray_kernel(gpu, &media, &[])?;
        let none = MediaSources::none(gpu)?;
        let no_media = [
            none.bind_lights(gpu, &media_kernel)?,
            none.bind(gpu, &shade)?,
        ];
        Ok(Self {
            begin: begin?,
            of_cones,
            plan: Kernel::new(gpu, &plan, "main", None)?,
            advance: Kernel::new(gpu, &advance, "main", None)?,
            trace: scene.ray_kernel(gpu, &trace, &[("LOWEST_WINS", 1.0)])?,
            media: (none, no_media),
            media_kernel,
            shade,
            add: add?,
            in_flight: None,
            chunks: PerReceiver::default(),
            triangles: None,
            settings: settings.clone(),
        })
    }

    /// Follows the scene's triangles, if the tracer tests every one.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(&mut self, gpu: &Gpu, scene: &GpuScene) -> Result<(), GpuError> {
        let versions = [scene.versions.geometry, scene.versions.instances];
        let is_current = |triangles: &Triangles| triangles.versions == versions;
        if self.settings.tracer == Tracer::Bvh || self.triangles.as_ref().is_some_and(is_current) {
            return Ok(());
        }
        let Some(runs) = scene.triangle_runs(gpu)? else {
            return Ok(());
        };
        let count = runs.last().map_or(0, |all| all[2]);
        let buffer = gpu.storage("ray-tracing.triangles [bytes]", &runs)?;
        let mut resources = vec![("runs", buffer.as_entire_binding())];
        let advance_group = self.advance.bind(gpu, 2, &resources)?;
        let mut made_by = None;
        let spheres;
        if let Some([kernel, _]) = &self.of_cones {
            let bytes = u64::from(count.max(1) + count.div_ceil(BLOCK)) * SPHERE_BYTES;
            spheres = gpu.buffer(
                "ray-tracing.spheres [bytes]",
                bytes,
                wgpu::BufferUsages::STORAGE,
            )?;
            resources.push(("spheres", spheres.as_entire_binding()));
            made_by = Some(kernel.bind(gpu, 2, &resources)?);
        }
        self.triangles = Some(Triangles {
            group: self.trace.bind(gpu, 2, &resources)?,
            advance_group,
            spheres: made_by,
            count,
            versions,
        });
        Ok(())
    }

    /// Has rays see media from now on, or none.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn see(&mut self, gpu: &Gpu, media: Option<MediaSources>) -> Result<(), GpuError> {
        let media = match media {
            Some(media) => media,
            None if self.media.0.directions == 0 => return Ok(()),
            None => MediaSources::none(gpu)?,
        };
        if self.media.0 != media {
            let groups = [
                media.bind_lights(gpu, &self.media_kernel)?,
                media.bind(gpu, &self.shade)?,
            ];
            self.media = (media, groups);
            self.chunks.clear();
        }
        Ok(())
    }

    /// Number of triangles against which every ray is tested.
    pub fn triangles(&self) -> u32 {
        self.triangles.as_ref().map_or(0, |all| all.count)
    }

    /// Adds what the rays from a receiver's points find, with at most `most_rays` in flight.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        settings: &Settings,
        most_rays: u64,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        if self.settings != *settings {
            self.settings = settings.clone();
            self.chunks.clear();
        }
        let points = receiver.points.count;
        let most_rays = match settings.tracer {
            Tracer::Cones => most_rays.min(MOST_RAYS_OF_CONES),
            Tracer::Bvh | Tracer::Engine => most_rays,
        };
        let wanted = slots(gpu, points, settings.split, most_rays);
        let in_flight = match self.in_flight.take() {
            Some(made) if made.capacity >= wanted => made,
            _ => {
                self.chunks.clear();
                InFlight::new(gpu, wanted, self.settings.tracer)?
            }
        };
        let Self {
            begin,
            plan,
            advance,
            of_cones,
            trace,
            shade,
            add,
            chunks,
            triangles,
            media_kernel,
            media: (media, [lights_group, sources_group]),
            ..
        } = self;
        let in_flight = &*self.in_flight.insert(in_flight);
        let kernels = [&*begin, plan, advance, trace, media_kernel, shade, add];
        let group_kernel = of_cones.as_ref().map(|[_, groups]| groups);
        let sees_only_environment = settings.environment == SeenEnvironment::Only;
        let chunks = chunks.of(receiver, || {
            let several = points.div_ceil(in_flight.capacity >> settings.split).max(1);
            let count = points.div_ceil(several);
            let all = (0..several).map(|number| gpu::Chunk {
                first: number * count,
                count: count.min(points.saturating_sub(number * count)),
                bounces: settings.bounces,
                split: settings.split,
                tests: most_tests(gpu, settings.tracer),
                sees_only_environment: u32::from(sees_only_environment),
                media_directions: if sees_only_environment {
                    0
                } else {
                    media.directions
                },
                marched_lights: if sees_only_environment {
                    0
                } else {
                    media.marched_lights
                },
            });
            all.map(|chunk| in_flight.bind(gpu, kernels, group_kernel, receiver, chunk))
                .collect()
        })?;
        let own = (0, &scene.bind_group);
        if let (Some([kernel, _]), Some(all)) = (&*of_cones, triangles.as_mut())
            && let Some(group) = all.spheres.take()
        {
            frame.compute("ray-tracing.spheres", |pass| {
                let groups = [(0, &scene.ray_bind_group), (2, &group)];
                kernel.dispatch(pass, &groups, [all.count, 1, 1]);
            });
        }
        for chunk in chunks {
            frame.clear_range(&in_flight.rays, 0..COUNTERS);
            frame.compute("ray-tracing.begin", |pass| {
                let [seen, rays] = &chunk.begin;
                let slots = [in_flight.capacity, 1, 1];
                begin.dispatch(pass, &[own, (1, seen), (3, rays)], slots);
            });
            for generation in 1..=settings.bounces {
                frame.compute("ray-tracing.plan", |pass| {
                    let [seen, rays] = &chunk.plan;
                    plan.dispatch(pass, &[(1, seen), (3, rays)], [1, 1, 1]);
                });
                if let (Some(kernel), Some(group)) = (group_kernel, &chunk.group) {
                    frame.compute("ray-tracing.groups", |pass| {
                        kernel.dispatch(pass, &[(3, group)], [in_flight.capacity, 1, 1]);
                    });
                }
                frame.compute("ray-tracing.trace", |pass| {
                    let [seen, rays] = &chunk.trace;
                    let mut groups = vec![(0, &scene.ray_bind_group), (1, seen), (3, rays)];
                    let mut times = 1;
                    if let Some(all) = &*triangles {
                        groups.push((2, &all.group));
                        let values = &chunk.values;
                        times = passes(all.count, values.count << values.split, values.tests);
                    }
                    for time in 0..times {
                        if let (1.., Some(all)) = (time, &*triangles) {
                            let groups = [(2, &all.advance_group), (3, &chunk.advance)];
                            advance.dispatch(pass, &groups, [1, 1, 1]);
                        }
                        // Of one workgroup per group of rays, if there are groups.
                        let arguments = if group_kernel.is_some() { 24 } else { 12 };
                        trace.dispatch_indirect(pass, &groups, &in_flight.arguments, arguments);
                    }
                });
                if chunk.values.marched_lights > 0 {
                    frame.compute("ray-tracing.media", |pass| {
                        let [seen, rays] = &chunk.media;
                        let own = (0, &scene.ray_bind_group);
                        let groups = [own, (1, seen), (2, &*lights_group), (3, rays)];
                        media_kernel.dispatch_indirect(pass, &groups, &in_flight.arguments, 0);
                    });
                }
                frame.compute("ray-tracing.shade", |pass| {
                    let [seen, rays] = &chunk.shade;
                    let groups = [own, (1, seen), (2, &*sources_group), (3, rays)];
                    shade.dispatch_indirect(pass, &groups, &in_flight.arguments, 0);
                });
                if !sees_only_environment {
                    earlier.gather(frame, scene, &in_flight.hits, false)?;
                } else if generation < settings.bounces {
                    continue;
                }
                frame.compute("ray-tracing.add", |pass| {
                    let [seen, light, rays] = &chunk.add;
                    let groups = [(1, seen), (2, light), (3, rays)];
                    add.dispatch(pass, &groups, [chunk.values.count, 1, 1]);
                });
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
        let rays = gpu.buffer("ray-tracing.rays [bytes]", bytes, storage)?;
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
        let points = u64::from(capacity) * SURFACE_POINT_BYTES;
        let points = gpu.buffer("ray-tracing.points [bytes]", points, storage)?;
        let hit_records = hits_of_points(gpu, [ROW_OF_POINTS, capacity / ROW_OF_POINTS])?;
        let hits = SurfacePoints {
            points,
            view,
            first: 0,
            count: capacity,
            hits: hit_records.clone(),
            output: Output::RadianceToEye,
            slots: Slots::default(),
        };
        let groups = u64::from(capacity) + 2 * u64::from(capacity / TILE * GROUPS_PER_TILE);
        let groups = (tracer == Tracer::Cones)
            .then(|| gpu.buffer("ray-tracing.groups [bytes]", 4 * groups, storage))
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
            hit_records,
        })
    }

    /// Binds a chunk of a receiver's points to `begin`, `plan`, `trace`, `media`, `shade` and `add`, and to the kernel that
    /// groups rays.
    fn bind(
        &self,
        gpu: &Gpu,
        [begin, plan, advance, trace, media, shade, add]: [&Kernel; 7],
        group: Option<&Kernel>,
        receiver: &Receiver,
        values: gpu::Chunk,
    ) -> Result<Chunk, GpuError> {
        let chunk = gpu.uniform("ray-tracing.chunk", &values)?;
        let chunk = ("chunk", chunk.as_entire_binding());
        let seen = ("seen", receiver.points.view.as_entire_binding());
        let points = ("points", receiver.points.points.as_entire_binding());
        let hits_seen = ("hits_seen", self.hits.points.view.as_entire_binding());
        let rays = ("rays", self.rays.as_entire_binding());
        let hit_points = ("hit_points", self.hits.points.points.as_entire_binding());
        let arguments = ("arguments", self.arguments.as_entire_binding());
        let hits = (
            "hits",
            wgpu::BindingResource::TextureView(&self.hit_records),
        );
        let light = [
            ("gathered", self.hits.target.radiance.as_entire_binding()),
            ("radiance", receiver.target.radiance.as_entire_binding()),
        ];
        let mut traced = vec![rays.clone()];
        traced.extend(
            self.groups
                .as_ref()
                .map(|groups| ("groups", groups.as_entire_binding())),
        );
        let grouped = [&traced[..], std::slice::from_ref(&arguments)].concat();
        Ok(Chunk {
            begin: [
                begin.bind(gpu, 1, &[seen.clone(), chunk.clone(), points])?,
                begin.bind(gpu, 3, &[rays.clone(), hit_points.clone()])?,
            ],
            plan: [
                plan.bind(gpu, 1, &[seen.clone(), chunk.clone()])?,
                plan.bind(
                    gpu,
                    3,
                    &[rays.clone(), arguments.clone(), hits_seen.clone()],
                )?,
            ],
            advance: advance.bind(gpu, 3, &[rays.clone(), arguments])?,
            trace: [
                trace.bind(gpu, 1, std::slice::from_ref(&hits_seen))?,
                trace.bind(gpu, 3, &traced)?,
            ],
            group: group
                .map(|group| group.bind(gpu, 3, &grouped))
                .transpose()?,
            media: [
                media.bind(gpu, 1, &[hits_seen.clone(), chunk.clone()])?,
                media.bind(gpu, 3, std::slice::from_ref(&rays))?,
            ],
            shade: [
                shade.bind(gpu, 1, &[hits_seen, chunk.clone()])?,
                shade.bind(gpu, 3, &[rays.clone(), hit_points.clone(), hits])?,
            ],
            add: [
                add.bind(gpu, 1, &[seen, chunk])?,
                add.bind(gpu, 2, &light)?,
                add.bind(gpu, 3, &[rays, hit_points])?,
            ],
            values,
        })
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
