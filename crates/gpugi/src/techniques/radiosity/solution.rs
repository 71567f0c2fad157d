//! The light in the texels of an atlas: direct light from other techniques, and the iteration that computes the
//! indirect light.

use gpugi_scene::Atlas;
use gpugi_scene::atlas::Seams;

use super::choosing::{self, Choosing};
use super::gpu::{MOST_CHOSEN, TEXEL_BYTES, Work};
use super::shooting::{Batch, Shooting};
use crate::capture::atlas::{
    AtlasCapture, AtlasCaptureOptions, AtlasLookup, AtlasPiece, Dilation, LeakTest, SeamFilter,
};
use crate::capture::{SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, read_buffer};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::{Map, Texels};

/// The passes of the iteration.
#[derive(Debug)]
pub(super) struct Kernels {
    begin: Kernel,
    rays: Kernel,
    average: Kernel,
}

impl Kernels {
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        Ok(Self {
            begin: kernel(shader!("techniques.radiosity.begin"))?,
            average: kernel(shader!("techniques.radiosity.average"))?,
            rays: scene.ray_kernel(
                gpu,
                &shader!("techniques.radiosity.rays"),
                &[
                    ("HAS_GLOSS", f64::from(u8::from(scene.has_gloss()))),
                    scene.media_constant(),
                ],
            )?,
        })
    }
}

/// The light in the texels of an atlas.
#[derive(Debug)]
pub struct Solution {
    /// Indirect irradiance [W/m^2] of the texels of all rows, row by row, with 1 in a; empty texels are filled from
    /// their neighbours.
    pub irradiance: Target,
    /// Lookup of triangles in the atlas.
    pub lookup: AtlasLookup,
    /// The texels.
    pub texels: AtlasCapture,
    /// Iterates so far, including dropped ones.
    pub iterates: u32,
    leaks: LeakTest,
    pieces: Vec<Piece>,
    /// Bind group of the atlas lookup and of the chosen texels in `rays`.
    corners: wgpu::BindGroup,
    dilation: Dilation,
    seams: SeamFilter,
    /// Two buffers of iterates, used in turn.
    light: [wgpu::Buffer; 2],
    /// Index of the buffer that holds the last iterate.
    last: usize,
    choosing: Choosing,
    chosen: wgpu::Buffer,
    /// Number of texels that each iterate chooses.
    chosen_count: u32,
    /// Rays per texel and iterate, or shooters.
    work_per_texel: u64,
    /// Shooters and hemicubes; `None` in the mode that traces rays.
    shooting: Option<Shooting>,
}

/// Inputs of one step's passes for a piece.
#[derive(Debug)]
pub(super) struct ForStep<'a> {
    pub count: u32,
    pub work: &'a wgpu::Buffer,
    pub points: &'a wgpu::Buffer,
    pub direct: &'a wgpu::Buffer,
}

/// Resources of the passes for one piece of the atlas.
#[derive(Debug)]
struct Piece {
    first_texel: u32,
    count: u32,
    direct: Target,
    work: wgpu::Buffer,
    begin: wgpu::BindGroup,
    rays: wgpu::BindGroup,
    average: wgpu::BindGroup,
    /// By the index of the buffer that holds the last iterate.
    begin_texels: [wgpu::BindGroup; 2],
    rays_texels: [wgpu::BindGroup; 2],
    average_texels: [wgpu::BindGroup; 2],
}

impl Solution {
    pub(super) fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        kernels: &Kernels,
        atlas: &Atlas,
        most_texels: u32,
    ) -> Result<Self, GpuError> {
        let host = scene.host().ok_or_else(|| GpuError::Pass {
            pass: "radiosity".into(),
            reason: "there is an atlas, but no scene that it is one of".into(),
        })?;
        let options = AtlasCaptureOptions {
            most_texels,
            ..AtlasCaptureOptions::default()
        };
        let texels = AtlasCapture::new(gpu, host, scene, atlas, &options)?;
        let lookup = AtlasLookup::new(gpu, host, atlas)?;
        let size = [atlas.size, atlas.size * atlas.pages];
        let count = size[0] * size[1];
        let storage = wgpu::BufferUsages::STORAGE;
        let bytes = u64::from(count) * TEXEL_BYTES;
        let iterates = [0, 1].map(|_| gpu.buffer("light of texels [bytes]", bytes, storage));
        let [one, other] = iterates;
        let iterates = [one?, other?];
        let irradiance = Target::new(gpu, count)?;
        let chosen = choosing::room(gpu)?;
        let resources = [
            ("atlas", lookup.words.as_entire_binding()),
            ("chosen_texels", chosen.as_entire_binding()),
        ];
        let corners = kernels.rays.bind(gpu, 2, &resources)?;
        let pieces = texels.pieces().iter();
        let pieces = pieces
            .map(|piece| Piece::new(gpu, kernels, piece, atlas.size, &iterates, &irradiance))
            .collect::<Result<Vec<_>, _>>()?;
        let steps = for_steps(&texels, &pieces);
        Ok(Self {
            choosing: Choosing::new(gpu, count, &iterates, &steps, &chosen)?,
            chosen,
            chosen_count: 0,
            work_per_texel: 0,
            leaks: LeakTest::new(gpu, scene, &texels)?,
            dilation: Dilation::new(gpu, size)?,
            seams: SeamFilter::new(gpu, &Seams::new(host, atlas), &irradiance)?,
            irradiance,
            lookup,
            texels,
            iterates: 0,
            pieces,
            corners,
            light: iterates,
            last: 0,
            shooting: None,
        })
    }

    /// Irradiance of all rows; for each piece, its direct light and the states of its texels (0 empty, 1 good, 2 moved,
    /// 3 invalid).
    pub(super) fn maps(&self) -> Vec<Map> {
        let width = self.texels.size;
        let colors = |name: String, of: &Target, rows: u32| Map {
            name: format!("{}.{name}", super::INFO.name),
            texels: Texels::Buffer {
                buffer: of.radiance.clone(),
                size: [width, rows],
                stride: 16,
                is_number: false,
            },
        };
        let rows = width * self.texels.pages;
        let mut maps = vec![colors("irradiance".into(), &self.irradiance, rows)];
        let pieces = self.texels.pieces().iter().zip(&self.pieces);
        for (number, ((of, piece), states)) in pieces.zip(self.leaks.states()).enumerate() {
            let rows = of.rows.end - of.rows.start;
            maps.push(colors(format!("direct.{number}"), &piece.direct, rows));
            maps.push(Map {
                name: format!("{}.coverage.{number}", super::INFO.name),
                texels: Texels::Buffer {
                    buffer: states.clone(),
                    size: [width, rows],
                    stride: 4,
                    is_number: true,
                },
            });
        }
        maps
    }

    /// Bytes that are not in maps.
    pub(super) fn work_bytes(&self) -> u64 {
        let light = self.light.iter().map(wgpu::Buffer::size).sum::<u64>();
        let shooting = self.shooting.as_ref().map_or(0, |shooting| shooting.bytes);
        let lookup = self.lookup.words.size();
        let around = self.dilation.bytes() + self.seams.bytes;
        light + self.texels.bytes + lookup + around + self.choosing.bytes + shooting
    }

    /// Updates the texels' points.
    pub(super) fn capture(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
    ) -> Result<(), GpuError> {
        self.texels.record(frame, scene)?;
        self.leaks.record(frame, scene, &self.texels);
        Ok(())
    }

    /// The texels' points, and the targets of their direct light.
    pub(super) fn direct(&self) -> impl Iterator<Item = (&SurfacePoints, &Target)> {
        let direct = self.pieces.iter().map(|piece| &piece.direct);
        self.texels.points().zip(direct)
    }

    /// Drops the light of the last iterate, before the iteration restarts.
    pub(super) fn forget(&self, frame: &mut Frame<'_>) {
        frame.clear(&self.light[self.last]);
    }

    /// Restarts the iteration from the light of the last iterate and discards all else: pass `radiosity.begin`.
    /// `batch`: number and resolution of shooters; `None` to trace rays.
    pub(super) fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        work: &Work,
        batch: Option<Batch>,
    ) -> Result<(), GpuError> {
        self.iterates = 0;
        let texels = self.pieces.iter().map(|piece| piece.count).sum();
        if self.shooting.as_ref().map(|shooting| shooting.batch) != batch {
            self.shooting = None;
        }
        if let (None, Some(batch)) = (&self.shooting, batch) {
            let steps = for_steps(&self.texels, &self.pieces);
            let shooting =
                Shooting::new(frame.gpu, scene, batch, &self.chosen, &self.light, &steps)?;
            self.shooting = Some(shooting);
        }
        self.chosen_count = match batch {
            Some(batch) => batch.shooters,
            None if work.light_sampled > 0 => MOST_CHOSEN,
            None => 0,
        };
        self.work_per_texel = match batch {
            Some(batch) => batch.shooters.into(),
            None => (work.rays + work.light_sampled).into(),
        };
        for piece in &self.pieces {
            let work = Work {
                texels,
                chosen: self.chosen_count,
                first_texel: piece.first_texel,
                count: piece.count,
                ..*work
            };
            frame.gpu.write(&piece.work, 0, std::slice::from_ref(&work));
        }
        frame.compute("radiosity.begin", |pass| {
            for piece in &self.pieces {
                let groups = [(1, &piece.begin), (3, &piece.begin_texels[self.last])];
                kernels.begin.dispatch(pass, &groups, [piece.count, 1, 1]);
            }
        });
        Ok(())
    }

    /// Computes one iterate, and returns the number of its rays, or of texels that shooters are compared with: passes
    /// `radiosity.choose`, and `radiosity.rays` or those of shooting.
    pub(super) fn iterate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
    ) -> u64 {
        if self.chosen_count > 0 {
            self.choosing.record(frame, self.last, self.chosen_count);
        }
        if let Some(shooting) = &self.shooting {
            shooting.iterate(frame, scene, self.last);
        } else {
            frame.compute("radiosity.rays", |pass| {
                for piece in &self.pieces {
                    let groups = [
                        (0, &scene.ray_bind_group),
                        (1, &piece.rays),
                        (2, &self.corners),
                        (3, &piece.rays_texels[self.last]),
                    ];
                    kernels.rays.dispatch(pass, &groups, [piece.count, 1, 1]);
                }
            });
        }
        self.last = 1 - self.last;
        self.iterates += 1;
        let texels: u64 = self.pieces.iter().map(|piece| u64::from(piece.count)).sum();
        texels * self.work_per_texel
    }

    /// Averages the iterates into the irradiance that other passes look up: passes `radiosity.average`,
    /// `capture.atlas.dilate` and `capture.atlas.seams`.
    pub(super) fn average(&self, frame: &mut Frame<'_>, kernels: &Kernels) -> Result<(), GpuError> {
        frame.compute("radiosity.average", |pass| {
            for piece in &self.pieces {
                let groups = [(1, &piece.average), (3, &piece.average_texels[self.last])];
                kernels.average.dispatch(pass, &groups, [piece.count, 1, 1]);
            }
        });
        self.dilation.record(frame, &self.irradiance)?;
        self.seams.record(frame);
        Ok(())
    }

    /// The state from which the next iterate continues: `Texel` of texel.wesl. Waits for the GPU.
    pub(super) fn light(&self, gpu: &Gpu) -> Result<Vec<u32>, GpuError> {
        let last = &self.light[self.last];
        read_buffer(gpu, last, last.size())
    }

    /// Continues from the state that [`Solution::light`] returned after `iterates` iterates, which started from the
    /// same direct light. Returns false if `light` has a different number of texels, or light that is not finite.
    pub(super) fn resume(&mut self, gpu: &Gpu, iterates: u32, light: &[u32]) -> bool {
        let last = &self.light[self.last];
        // Each texel is two vectors of floats, and a number behind each.
        let mut vectors = light.chunks(4);
        let is_finite = |word: &u32| f32::from_bits(*word).is_finite();
        let fits = light.len() as u64 * 4 == last.size()
            && vectors.all(|vector| vector.iter().take(3).all(is_finite));
        if !fits {
            return false;
        }
        gpu.write(last, 0, light);
        self.iterates = iterates;
        true
    }
}

/// Inputs of one step's passes for each piece.
fn for_steps<'a>(texels: &'a AtlasCapture, pieces: &'a [Piece]) -> Vec<ForStep<'a>> {
    let of_piece = |(points, piece): (&'a SurfacePoints, &'a Piece)| ForStep {
        count: piece.count,
        work: &piece.work,
        points: &points.points,
        direct: &piece.direct.radiance,
    };
    texels.points().zip(pieces).map(of_piece).collect()
}

impl Piece {
    fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        piece: &AtlasPiece,
        size: u32,
        iterates: &[wgpu::Buffer; 2],
        irradiance: &Target,
    ) -> Result<Self, GpuError> {
        let count = piece.points.count;
        let direct = Target::new(gpu, count)?;
        let bytes = size_of::<Work>() as u64;
        let work = gpu.buffer("radiosity", bytes, wgpu::BufferUsages::UNIFORM)?;
        let begin = [("work", work.as_entire_binding())];
        let average = [
            ("work", work.as_entire_binding()),
            ("points", piece.points.points.as_entire_binding()),
        ];
        let rays = [
            ("work", work.as_entire_binding()),
            ("points", piece.points.points.as_entire_binding()),
            ("direct", direct.radiance.as_entire_binding()),
        ];
        let by_last = |bind: &dyn Fn(usize) -> Result<wgpu::BindGroup, GpuError>| {
            Ok::<_, GpuError>([bind(0)?, bind(1)?])
        };
        Ok(Self {
            first_texel: piece.rows.start * size,
            count,
            begin: kernels.begin.bind(gpu, 1, &begin)?,
            rays: kernels.rays.bind(gpu, 1, &rays)?,
            average: kernels.average.bind(gpu, 1, &average)?,
            begin_texels: by_last(&|last| {
                let resources = [("after", iterates[last].as_entire_binding())];
                kernels.begin.bind(gpu, 3, &resources)
            })?,
            rays_texels: by_last(&|last| {
                let resources = [
                    ("before", iterates[last].as_entire_binding()),
                    ("after", iterates[1 - last].as_entire_binding()),
                ];
                kernels.rays.bind(gpu, 3, &resources)
            })?,
            average_texels: by_last(&|last| {
                let resources = [
                    ("before", iterates[last].as_entire_binding()),
                    ("irradiance", irradiance.radiance.as_entire_binding()),
                ];
                kernels.average.bind(gpu, 3, &resources)
            })?,
            direct,
            work,
        })
    }
}
