//! The illumination network on the GPU: particles, what they see, and what arrives at them.

use std::sync::Arc;

use bytemuck::Zeroable;
use gpugi_scene::PhaseFunction;

use super::gpu;
use super::particles::{NEIGHBOURS, Particles};
use super::phase_matrix::phase_matrix;
use super::sources::MediaSources;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::lights::gpu::LightSample;
use crate::scene::GpuScene;
use crate::shader;

/// Most lights that view rays march toward.
pub const MOST_MARCHED: usize = 8;

/// Sizes of a network, and how its links are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    pub directions: u32,
    /// Whether there is room for the light of surfaces.
    pub sees_surfaces: bool,
    /// Pixels per side of the windows in which particles are peeled; `None`: rays find links.
    pub window: Option<u32>,
}

/// The passes over particles and directions.
#[derive(Debug)]
pub struct Kernels {
    peel: Option<Kernel>,
    visibility: Kernel,
    /// See [`super::reflecting`].
    pub reflecting: Kernel,
    pub mean: Kernel,
    arriving: Kernel,
    emit: Kernel,
    sky: Kernel,
    scatter: Kernel,
    transport: Kernel,
    light_depths: Kernel,
}

impl Kernels {
    /// Compiles the passes. `peels`: links are found by depth peeling.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, peels: bool) -> Result<Self, GpuError> {
        let plain = |shader| Kernel::new(gpu, &shader, "main", None);
        let in_scene = |shader| Kernel::new(gpu, &shader, "main", Some(&scene.layout));
        let tracing = |shader| scene.ray_kernel(gpu, &shader, &[]);
        let visibility = shader!("techniques.participating_media.visibility");
        let peeled = [("PEELED", f64::from(u8::from(peels)))];
        Ok(Self {
            peel: match peels {
                true => Some(plain(shader!("techniques.participating_media.peel"))?),
                false => None,
            },
            visibility: scene.ray_kernel(gpu, &visibility, &peeled)?,
            reflecting: tracing(shader!("techniques.participating_media.reflecting"))?,
            mean: plain(shader!("techniques.participating_media.mean"))?,
            arriving: tracing(shader!("techniques.participating_media.arriving"))?,
            emit: in_scene(shader!("techniques.participating_media.emit"))?,
            sky: in_scene(shader!("techniques.participating_media.sky"))?,
            scatter: in_scene(shader!("techniques.participating_media.scatter"))?,
            transport: plain(shader!("techniques.participating_media.transport"))?,
            light_depths: in_scene(shader!("techniques.participating_media.light_depths"))?,
        })
    }
}

/// The arrays of a network.
#[derive(Debug)]
pub struct Network {
    pub values: gpu::Network,
    pub uniform: wgpu::Buffer,
    pub particles: wgpu::Buffer,
    pub neighbours: wgpu::Buffer,
    /// What that holds.
    neighbours_made: Arc<Vec<[[u32; NEIGHBOURS]; 2]>>,
    /// [`Particles::phases`].
    phases: Vec<PhaseFunction>,
    /// [`Particles::fields`].
    pub fields: wgpu::Buffer,
    /// Light samples.
    pub lights: wgpu::Buffer,
    /// [particle x lights + light].
    pub arriving: wgpu::Buffer,
    /// [node x marched lights + light], 4 bytes each.
    pub light_depths: wgpu::Buffer,
    /// What each particle sees: [particle x directions + direction], as all that follow.
    pub visible: wgpu::Buffer,
    /// Radiance that surfaces send along the links that end on them; one row if particles see surfaces black.
    pub reflected: wgpu::Buffer,
    pub emitted: wgpu::Buffer,
    /// The sources of the light that arrived last.
    pub source: wgpu::Buffer,
    /// Radiance that arrives, of even and of odd iterations.
    pub incoming: [wgpu::Buffer; 2],
    pub sky: wgpu::Buffer,
    pub phase_matrices: wgpu::Buffer,
    cells: wgpu::Buffer,
    /// Of [`Shape::window`]; one word without.
    windows: wgpu::Buffer,
    /// Iterations so far: the last one wrote `incoming[iterations % 2]`.
    pub iterations: u32,
}

impl Network {
    /// Allocates and uploads the network among particles, for light samples. `before`: a network whose neighbours may be
    /// the same.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        made: &Particles,
        shape: Shape,
        lights: &[LightSample],
        before: Option<&Self>,
    ) -> Result<Self, GpuError> {
        let values = values(made, shape, lights);
        let gpu::Network {
            particles,
            directions,
            marched_lights,
            ..
        } = values;
        let sees_surfaces = shape.sees_surfaces;
        let entries = u64::from(particles) * u64::from(directions) * 16;
        let array = |label: &str| gpu.room(label, entries);
        let phases = made.phases.iter();
        let matrices = phases.flat_map(|&phase| phase_matrix(phase, directions));
        let matrices: Vec<f32> = matrices.collect();
        let reached = u64::from(particles) * lights.len() as u64 * 16;
        let uniform = gpu.uniform("illumination network", &values)?;
        let rows = gpu.storage("particles", some(&made.particles, &Zeroable::zeroed()))?;
        let cells = gpu.storage("cells of particles", &made.cells.lists)?;
        let lights = gpu.storage("light samples", some(lights, &Zeroable::zeroed()))?;
        let arriving = gpu.room("light that arrives at particles [bytes]", reached)?;
        let depths = u64::from(values.nodes) * u64::from(marched_lights) * 4;
        let light_depths = gpu.room("optical depths to lights [bytes]", depths)?;
        let fields = gpu.storage("fields of media", &made.fields)?;
        let visible = array("visibility network [bytes]")?;
        let reflected = gpu.room(
            "light that surfaces send to particles [bytes]",
            if sees_surfaces { entries } else { 16 },
        )?;
        let emitted = array("light emitted by particles [bytes]")?;
        let source = array("sources of particles [bytes]")?;
        let incoming = [
            array("illumination network [bytes]")?,
            array("illumination network [bytes]")?,
        ];
        let sky = gpu.room("sky of particles", u64::from(directions) * 16)?;
        // Two windows for each of the views, which serve opposite directions.
        let pixels = u64::from(directions) * u64::from(values.window).pow(2);
        let windows = gpu.room("windows of peeled particles", pixels * 4)?;
        let phase_matrices = gpu.storage("phase matrices", &matrices)?;
        Ok(Self {
            values,
            uniform,
            particles: rows,
            neighbours: match before {
                Some(before) if Arc::ptr_eq(&before.neighbours_made, &made.neighbours) => {
                    before.neighbours.clone()
                }
                _ => gpu.storage("neighbours of nodes", &made.neighbours)?,
            },
            neighbours_made: made.neighbours.clone(),
            phases: made.phases.clone(),
            fields,
            lights,
            arriving,
            light_depths,
            visible,
            reflected,
            emitted,
            source,
            incoming,
            sky,
            phase_matrices,
            cells,
            windows,
            iterations: 0,
        })
    }

    /// Follows particles that have moved, if it has room for just as many, and their media scatter as before: buffers and
    /// light stay. Says whether it does.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        made: &Particles,
        shape: Shape,
        lights: &[LightSample],
    ) -> Result<bool, GpuError> {
        let values = values(made, shape, lights);
        let sizes = |values: &gpu::Network| gpu::Network {
            cells_origin: [0.0; 3],
            cell_side: 0.0,
            cell_counts: [0; 3],
            ..*values
        };
        let is_alike = sizes(&values) == sizes(&self.values)
            && self.phases == made.phases
            && Arc::ptr_eq(&self.neighbours_made, &made.neighbours);
        if is_alike {
            self.values = values;
            self.cells = gpu.storage("cells of particles", &made.cells.lists)?;
            gpu.write(&self.uniform, 0, &[values]);
            gpu.write(&self.particles, 0, &made.particles);
            gpu.write(&self.fields, 0, &made.fields);
            self.set_lights(gpu, lights);
        }
        Ok(is_alike)
    }

    /// Begins with the light that arrived last in the network `before`, of as many particles and directions.
    pub fn continue_from(&self, frame: &mut Frame<'_>, before: &Self) {
        let [own, _] = &self.incoming;
        if before.entries() == self.entries() && self.iterations == 0 {
            frame.copy(before.latest(), own, [0, own.size()]);
        }
    }

    /// Replaces the light samples by as many others.
    pub fn set_lights(&self, gpu: &Gpu, lights: &[LightSample]) {
        gpu.write(&self.lights, 0, lights);
    }

    /// Links: particles x directions.
    pub fn entries(&self) -> u32 {
        self.values.particles * self.values.directions
    }

    /// What passes bind: every array, and the light that arrived last, which is the one `before` a further iteration.
    pub fn resources(&self) -> [Named<'_>; 17] {
        [
            ("net", &self.uniform),
            ("particles", &self.particles),
            ("cells", &self.cells),
            ("windows", &self.windows),
            ("visible", &self.visible),
            ("lights", &self.lights),
            ("arriving", &self.arriving),
            ("light_depths", &self.light_depths),
            ("neighbours", &self.neighbours),
            ("fields", &self.fields),
            ("reflected", &self.reflected),
            ("emitted", &self.emitted),
            ("source", &self.source),
            ("sky", &self.sky),
            ("phase_matrices", &self.phase_matrices),
            ("before", self.latest()),
            ("incoming", self.latest()),
        ]
    }

    /// Records the pass `participating-media.NAME`.
    fn run(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        kernel: &Kernel,
        scene: Option<&wgpu::BindGroup>,
        invocations: u32,
    ) -> Result<(), GpuError> {
        let resources = self.resources();
        frame.run(name, kernel, scene, &resources, [invocations, 1, 1])
    }

    /// Finds what each particle sees: passes `participating-media.peel` and `.visibility`. Returns the number of rays.
    pub fn look(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
    ) -> Result<u64, GpuError> {
        let rays = Some(&scene.ray_bind_group);
        if let Some(peel) = &kernels.peel {
            // A workgroup of 256 per view.
            let invocations = 256 * self.values.directions / 2;
            self.run(frame, "participating-media.peel", peel, None, invocations)?;
        }
        let (name, visibility) = ("participating-media.visibility", &kernels.visibility);
        self.run(frame, name, visibility, rays, self.entries())?;
        Ok(self.entries().into())
    }

    /// Follows direct light to the particles and scatters it: passes `participating-media.arriving`, `.light-depths`,
    /// `.emit`, `.sky` and `.scatter`. Returns the number of rays.
    pub fn light(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
    ) -> Result<u64, GpuError> {
        let (of_scene, of_rays) = (Some(&scene.bind_group), Some(&scene.ray_bind_group));
        let rays = self.values.particles * self.values.lights;
        if rays > 0 {
            let (name, arriving) = ("participating-media.arriving", &kernels.arriving);
            self.run(frame, name, arriving, of_rays, rays)?;
        }
        let depths = self.values.nodes * self.values.marched_lights;
        if depths > 0 {
            let (name, kernel) = ("participating-media.light-depths", &kernels.light_depths);
            self.run(frame, name, kernel, of_scene, depths)?;
        }
        let (name, emit) = ("participating-media.emit", &kernels.emit);
        self.run(frame, name, emit, of_scene, self.entries())?;
        let (name, sky) = ("participating-media.sky", &kernels.sky);
        self.run(frame, name, sky, of_scene, self.values.directions)?;
        self.scatter(frame, scene, kernels)?;
        Ok(rays.into())
    }

    /// The sources of the light that arrived last.
    fn scatter(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
    ) -> Result<(), GpuError> {
        // A workgroup of 64 per particle.
        let invocations = 64 * self.values.particles;
        let (name, scatter) = ("participating-media.scatter", &kernels.scatter);
        self.run(frame, name, scatter, Some(&scene.bind_group), invocations)
    }

    /// One iteration: passes `participating-media.transport` and `participating-media.scatter`. Returns the number of
    /// lookups.
    pub fn iterate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
    ) -> Result<u64, GpuError> {
        let next = &self.incoming[((self.iterations + 1) % 2) as usize];
        let resources = join(&self.resources(), &[("incoming", next)]);
        let (name, transport) = ("participating-media.transport", &kernels.transport);
        let entries = [self.entries(), 1, 1];
        frame.run(name, transport, None, &resources, entries)?;
        self.iterations += 1;
        self.scatter(frame, scene, kernels)?;
        Ok(self.entries().into())
    }

    /// The light that arrived in the last iteration.
    pub fn latest(&self) -> &wgpu::Buffer {
        &self.incoming[(self.iterations % 2) as usize]
    }

    /// For rays through the media.
    pub fn sources(&self) -> MediaSources {
        MediaSources {
            directions: self.values.directions,
            marched_lights: self.values.marched_lights,
            source: self.source.clone(),
            neighbours: self.neighbours.clone(),
            fields: self.fields.clone(),
            lights: self.lights.clone(),
            light_depths: self.light_depths.clone(),
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let [even, odd] = &self.incoming;
        let buffers = [
            &self.particles,
            &self.neighbours,
            &self.fields,
            &self.lights,
            &self.arriving,
            &self.light_depths,
            &self.visible,
            &self.reflected,
            &self.emitted,
            &self.source,
            even,
            odd,
            &self.sky,
            &self.phase_matrices,
            &self.cells,
            &self.windows,
        ];
        buffers.iter().map(|buffer| buffer.size()).sum()
    }
}

/// The sizes of a network, and its cells.
fn values(made: &Particles, shape: Shape, lights: &[LightSample]) -> gpu::Network {
    let is_punctual = |light: &&LightSample| light.kind <= LightSample::DIRECTIONAL;
    let marched_lights = lights.iter().take_while(is_punctual).count();
    gpu::Network {
        particles: made.particles.len() as u32,
        directions: shape.directions,
        lights: lights.len() as u32,
        nodes: made.neighbours.len() as u32,
        cells_origin: made.cells.origin.to_array(),
        cell_side: made.cells.side,
        cell_counts: made.cells.counts.to_array(),
        sees_surfaces: shape.sees_surfaces.into(),
        marched_lights: marched_lights.min(MOST_MARCHED) as u32,
        window: shape.window.unwrap_or(0),
        padding: [0; 2],
    }
}

/// `rows`, or one row if there is none: shaders bind no smaller arrays.
fn some<'a, T>(rows: &'a [T], one: &'a T) -> &'a [T] {
    if rows.is_empty() {
        std::slice::from_ref(one)
    } else {
        rows
    }
}
