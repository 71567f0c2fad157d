//! Directional domains of an environment, computed on the GPU: domains.wesl describes how.

use glam::Vec3;

use super::draws::CellsOnTheWay;
use super::gpu;
use super::{Settings, Spread};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, ReadBack};
use crate::scene::GpuScene;
use crate::shader;

/// Most cells along each axis. Larger maps are reduced to this many; their sums are preserved.
const MOST_CELLS: [u32; 2] = [512, 256];
/// Fewest cells along each axis: texels of smaller maps are split, so that their light does not all come from few
/// directions.
const FEWEST_CELLS: [u32; 2] = [64, 32];
/// Iterations that find the power that one sample stands for. They suffice unless nearly all power lies in fewer cells
/// than there are samples; then some samples coincide and are dropped.
const SHARE_ROUNDS: u32 = 8;
/// Relaxation ends when no sample moves by more than this fraction of the mean distance between samples.
const LITTLE: f32 = 0.01;

/// A directional domain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Domain {
    /// Unit direction toward its light, in the map's own frame: before the environment's rotation.
    pub toward: Vec3,
    /// Integral of the map's radiance over it, before the environment's intensity: irradiance of a surface that faces
    /// it (W/m^2).
    pub flux_density: Vec3,
    /// Solid angle (sr).
    pub solid_angle: f32,
    /// Solid angle of a uniform cap whose light is spread as widely as the domain's (sr); a sun's is smaller than its
    /// domain.
    pub lit_solid_angle: f32,
}

/// Domains on their way from the GPU.
#[derive(Debug)]
pub struct DomainsOnTheWay {
    rows: ReadBack<Vec<gpu::Domain>>,
    count: usize,
}

impl DomainsOnTheWay {
    /// The domains, one per sample, once they have arrived. Those without light belong to unused samples.
    pub fn get(&self) -> Option<Result<Vec<Domain>, GpuError>> {
        let rows = self.rows.get()?;
        Some(rows.map(|rows| domains(&rows[..self.count])))
    }

    /// Blocks until they have arrived.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn wait(self) -> Result<Vec<Domain>, GpuError> {
        Ok(domains(&self.rows.wait()?[..self.count]))
    }
}

fn domains(rows: &[gpu::Domain]) -> Vec<Domain> {
    let domain = |row: &gpu::Domain| Domain {
        toward: row.direction.into(),
        flux_density: row.flux_density.into(),
        solid_angle: row.solid_angle,
        lit_solid_angle: row.lit_solid_angle,
    };
    rows.iter().map(domain).collect()
}

/// The kernels that decompose environments, and the last decomposition, from which the next one starts.
#[derive(Debug)]
pub struct Decomposition {
    reduce: Kernel,
    steps: Steps,
    made: Option<DecompositionBuffers>,
}

/// The entry points of domains.wesl.
#[derive(Debug)]
struct Steps {
    start: Kernel,
    sum_tile: Kernel,
    share_out: Kernel,
    limit: Kernel,
    draw: Kernel,
    wake: Kernel,
    assign: Kernel,
    relax: Kernel,
    settle: Kernel,
    sum_domain: Kernel,
}

/// Resources for one size of map and one choice of settings.
#[derive(Debug)]
struct DecompositionBuffers {
    map: [u32; 2],
    settings: Settings,
    grid: gpu::Grid,
    side: u32,
    zones: wgpu::Buffer,
    cells: wgpu::Buffer,
    tiles: wgpu::Buffer,
    samples: wgpu::Buffer,
    owners: wgpu::Buffer,
    domains: wgpu::Buffer,
    state: wgpu::Buffer,
    texture: wgpu::Texture,
    /// Whether the samples are those of an earlier map.
    warm: bool,
}

impl Decomposition {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let step = |entry| {
            let shader = shader!("techniques.image_based_lighting.domains");
            Kernel::new(gpu, &shader, entry, None)
        };
        Ok(Self {
            reduce: Kernel::new(
                gpu,
                &shader!("techniques.image_based_lighting.reduce"),
                "main",
                Some(&scene.layout),
            )?,
            steps: Steps {
                start: step("start")?,
                sum_tile: step("sum_tile")?,
                share_out: step("share_out")?,
                limit: step("limit")?,
                draw: step("draw")?,
                wake: step("wake")?,
                assign: step("assign")?,
                relax: step("relax")?,
                settle: step("settle")?,
                sum_domain: step("sum_domain")?,
            },
            made: None,
        })
    }

    /// Records the decomposition of the scene's environment into domains, one per sample, which arrive some time after
    /// the frame is submitted. Domains without light belong to unused samples. If size and settings are unchanged, the
    /// decomposition starts from the last one, so that samples follow a changing sky instead of jumping. Submits what
    /// `frame` has recorded so far.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn decompose(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        settings: &Settings,
    ) -> Result<Option<DomainsOnTheWay>, GpuError> {
        let Some(environment) = &scene.environment else {
            self.made = None;
            return Ok(None);
        };
        let map = [environment.image.width, environment.image.height];
        let is_kept = self
            .made
            .as_ref()
            .is_some_and(|made| made.map == map && made.settings == *settings);
        if !is_kept {
            self.made = None;
        }
        let made = match self.made.take() {
            Some(made) => made,
            None => DecompositionBuffers::new(frame.gpu, map, settings)?,
        };
        self.record(frame, scene, &made)?;
        let rows = frame.read_back(&made.domains, made.domains.size())?;
        self.made = Some(DecompositionBuffers { warm: true, ..made });
        Ok(Some(DomainsOnTheWay {
            rows,
            count: settings.samples as usize,
        }))
    }

    /// The cells of the last environment decomposed.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(super) fn cells(&self, frame: &mut Frame<'_>) -> Result<Option<CellsOnTheWay>, GpuError> {
        let Some(made) = &self.made else {
            return Ok(None);
        };
        let rows = frame.read_back(&made.cells, made.cells.size())?;
        let grid = made.grid;
        Ok(Some(CellsOnTheWay { grid, rows }))
    }

    fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        made: &DecompositionBuffers,
    ) -> Result<(), GpuError> {
        let count = made.settings.samples;
        // The mean area of a domain is 4 pi / N.
        let tolerance = LITTLE * LITTLE * 4.0 * std::f32::consts::PI / count as f32;
        let settings = gpu::Settings {
            width: made.grid.width,
            height: made.grid.height,
            stride: made.grid.stride,
            side: made.side,
            count,
            squared: u32::from(made.settings.spread == Spread::Power),
            warm: u32::from(made.warm),
            tolerance,
        };
        let grid = frame.gpu.constant("grid of the environment", &made.grid)?;
        let settings = frame.gpu.constant("settings of decomposition", &settings)?;
        let resources: [Named<'_>; 9] = [
            ("grid", &grid),
            ("zones", &made.zones),
            ("settings", &settings),
            ("cells", &made.cells),
            ("tiles", &made.tiles),
            ("samples", &made.samples),
            ("owners", &made.owners),
            ("domains", &made.domains),
            ("state", &made.state),
        ];
        let cells = made.grid.stride * made.grid.height;
        let tiled = 2 * made.side * made.side;
        let steps = &self.steps;
        frame.compute("image-based-lighting.decompose", |pass| {
            let mut run = |kernel: &Kernel, scene: Option<&wgpu::BindGroup>, invocations: u32| {
                kernel.run(pass, scene, &resources, [invocations, 1, 1])
            };
            run(&self.reduce, Some(&scene.bind_group), cells)?;
            let mut run = |kernel: &Kernel, invocations: u32| run(kernel, None, invocations);
            run(&steps.start, 1)?;
            for round in 0..SHARE_ROUNDS {
                if round > 0 {
                    run(&steps.limit, 1)?;
                }
                run(&steps.sum_tile, tiled)?;
                run(&steps.share_out, LANES)?;
            }
            run(&steps.draw, count)?;
            run(&steps.wake, 1)?;
            for _ in 0..made.settings.iterations {
                run(&steps.assign, cells)?;
                run(&steps.relax, count * LANES)?;
                run(&steps.settle, 1)?;
            }
            run(&steps.wake, 1)?;
            run(&steps.assign, cells)?;
            run(&steps.sum_domain, count * LANES)
        })?;
        frame.fill(&made.texture, &made.owners, made.grid.stride * 4);
        Ok(())
    }

    /// The number of the domain of each cell of the map, once decomposed.
    pub fn owners(&self) -> Option<&wgpu::Texture> {
        self.made.as_ref().map(|made| &made.texture)
    }
}

/// `LANES` of domains.wesl.
const LANES: u32 = 256;

impl DecompositionBuffers {
    fn new(gpu: &Gpu, map: [u32; 2], settings: &Settings) -> Result<Self, GpuError> {
        let [width, height] = [0, 1].map(|axis| {
            let parts = FEWEST_CELLS[axis].div_ceil(map[axis]);
            (map[axis] * parts).min(MOST_CELLS[axis])
        });
        let grid = gpu::Grid {
            width,
            height,
            // Texture copies require rows of a multiple of 256 bytes.
            stride: width.next_multiple_of(64),
            padding: 0,
        };
        let side = width.div_ceil(2).max(height).next_power_of_two().max(16);
        let cell_count = u64::from(grid.stride * height);
        let count = u64::from(settings.samples);
        let storage = |label: &str, size: u64| gpu.room(label, size);
        let cells = storage("cells of the environment [bytes]", cell_count * 16)?;
        let tiles = storage(
            "tiles of the environment [bytes]",
            u64::from(side * side / 32),
        )?;
        let samples = storage("environment samples [bytes]", count * 16)?;
        let owners = storage("owners of the environment's cells [bytes]", cell_count * 4)?;
        let domains = storage("environment domains [bytes]", count * 32)?;
        let state = storage(
            "state of decomposition [bytes]",
            size_of::<gpu::State>() as u64,
        )?;
        let zones = gpu.storage("zones [bytes]", &zones(map[1], height))?;
        let texture = gpu.texture_2d(
            "domains of the environment",
            [width, height, 1],
            wgpu::TextureFormat::R32Uint,
            wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_DST
                | wgpu::TextureUsages::COPY_SRC,
        )?;
        Ok(Self {
            map,
            settings: settings.clone(),
            grid,
            side,
            zones,
            cells,
            tiles,
            samples,
            owners,
            domains,
            state,
            texture,
            warm: false,
        })
    }
}

/// Solid angles of the zones in which rows of texels and rows of cells overlap, around the whole sphere, at index texel
/// row + cell row (sr): 2 pi (cos a - cos b), as a product, which keeps its precision near the poles.
fn zones(texels: u32, cells: u32) -> Vec<f32> {
    let mut zones = vec![0.0; (texels + cells) as usize];
    let all = u64::from(texels) * u64::from(cells);
    let (mut texel, mut cell, mut top) = (0, 0, 0);
    while texel < texels && cell < cells {
        // In units of 1 / (texels x cells) of the way from pole to pole.
        let ends = [
            (texel + 1) as u64 * u64::from(cells),
            (cell + 1) as u64 * u64::from(texels),
        ];
        let bottom = ends[0].min(ends[1]);
        let angle = |at: u64| std::f64::consts::PI * at as f64 / all as f64;
        let (middle, half) = (
            (angle(top) + angle(bottom)) / 2.0,
            (angle(bottom) - angle(top)) / 2.0,
        );
        zones[(texel + cell) as usize] =
            (4.0 * std::f64::consts::PI * middle.sin() * half.sin()) as f32;
        texel += u32::from(ends[0] == bottom);
        cell += u32::from(ends[1] == bottom);
        top = bottom;
    }
    zones
}
