//! The light in the texels of an atlas: direct light from other techniques, and the iteration that computes the
//! indirect light.

use std::ops::Range;

use gpugi_scene::Atlas;
use gpugi_scene::atlas::Seams;

use super::choosing::{self, Choosing};
use super::gpu::{MOST_CHOSEN, TEXEL_BYTES, Work};
use super::shooting::{Batch, Shooting};
use crate::capture::atlas::{
    AtlasCapture, AtlasCaptureOptions, AtlasLookup, AtlasPiece, Dilation, LeakTest, SeamFilter,
};
use crate::capture::{Receiver, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, read_buffer};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::{Earlier, Map, Texels};

/// Texels that trace rays in a frame, if the budget allows fewer (but the rest of an iterate).
const LEAST_TRACED: u64 = 8192;

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
    /// Texels of all pieces that have traced the rays of the next iterate.
    traced: u32,
    /// What [`Solution::begin`] was given.
    work: Work,
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
    work: HostBuffer,
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
            choosing: Choosing::new(gpu, scene, &lookup, count, &iterates, &steps, &chosen)?,
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
            traced: 0,
            work: bytemuck::Zeroable::zeroed(),
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

    /// Updates the texels' points, and finds those that leak: with a budget, in as many steps as it allows. Returns
    /// whether that is done.
    pub(super) fn capture(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        budget: Option<&mut Earlier<'_>>,
    ) -> Result<bool, GpuError> {
        self.texels.record(frame, scene)?;
        let Some(budget) = budget else {
            self.leaks.record(frame, scene, &self.texels);
            return Ok(true);
        };
        while !self.leaks.is_done(&self.texels) && budget.may_step() {
            let rays = self.leaks.record_part(frame, scene, &self.texels, 1);
            budget.count(rays);
        }
        Ok(self.leaks.is_done(&self.texels))
    }

    /// Number of parts in which the texels are lit directly.
    pub(super) fn parts(&self) -> usize {
        let pieces = self.texels.pieces().iter();
        pieces.map(|piece| piece.parts.len()).sum()
    }

    /// What is to be lit directly once the first `lit` parts are, and how many parts it is: a whole piece of the atlas, if
    /// so many points fit the frame's budget, or else a part.
    pub(super) fn next_direct(
        &self,
        mut lit: usize,
        fits: impl Fn(u64) -> bool,
    ) -> Option<(Receiver, usize)> {
        for (captured, piece) in self.texels.pieces().iter().zip(&self.pieces) {
            let parts = captured.parts.len();
            if lit == 0 && fits(piece.count.into()) {
                return Some((Receiver::new(&captured.points, &piece.direct), parts));
            }
            if let Some(part) = captured.parts.get(lit) {
                return Some((Receiver::new(&part.points, &piece.direct), 1));
            }
            lit -= parts;
        }
        None
    }

    /// Drops the light of the last iterate, before the iteration restarts.
    pub(super) fn forget(&self, frame: &mut Frame<'_>) {
        frame.clear(&self.light[self.last]);
    }

    /// Prepares to shoot, or to trace rays if `batch` is `None`. The iteration has to begin again.
    pub(super) fn shoot(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        batch: Option<Batch>,
    ) -> Result<(), GpuError> {
        if self.shooting.as_ref().map(|shooting| shooting.batch) != batch {
            self.shooting = None;
        }
        if let (None, Some(batch)) = (&self.shooting, batch) {
            let steps = for_steps(&self.texels, &self.pieces);
            let shooting = Shooting::new(gpu, scene, batch, &self.chosen, &self.light, &steps)?;
            self.shooting = Some(shooting);
        }
        Ok(())
    }

    /// Restarts the iteration from the light of the last iterate and discards all else: pass `radiosity.begin`.
    pub(super) fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        kernels: &Kernels,
        work: &Work,
    ) -> Result<(), GpuError> {
        (self.iterates, self.traced) = (0, 0);
        let texels = self.pieces.iter().map(|piece| piece.count).sum();
        let batch = self.shooting.as_ref().map(|shooting| shooting.batch);
        self.chosen_count = match batch {
            Some(batch) => batch.shooters,
            None if work.light_sampled > 0 => MOST_CHOSEN,
            None => 0,
        };
        self.work_per_texel = match batch {
            Some(batch) => batch.shooters.into(),
            None => (work.rays + work.light_sampled).into(),
        };
        self.work = Work {
            texels,
            chosen: self.chosen_count,
            ..*work
        };
        for piece in &self.pieces {
            piece.write(frame.gpu, &self.work, 0..piece.count);
        }
        frame.compute("radiosity.begin", |pass| {
            for piece in &self.pieces {
                let groups = [(1, &piece.begin), (3, &piece.begin_texels[self.last])];
                kernels.begin.dispatch(pass, &groups, [piece.count, 1, 1]);
            }
        });
        Ok(())
    }

    /// The texels that trace the rays of the next iterate in a frame with a budget of `units`, at least
    /// [`LEAST_TRACED`]. A frame may do one part of an iterate, or whole ones: the passes read one range of texels.
    pub(super) fn next_part(&self, units: u64) -> Range<u32> {
        let most = units / self.work_per_texel.max(1);
        let end = most.max(LEAST_TRACED).saturating_add(self.traced.into());
        let end = end.min(self.work.texels.into()) as u32;
        match self.shooting {
            Some(_) => 0..self.work.texels,
            None => self.traced..end,
        }
    }

    /// Number of texels of all pieces.
    pub(super) fn texel_count(&self) -> u32 {
        self.work.texels
    }

    /// Computes the next iterate, or a part of it ([`Solution::next_part`]). Returns the number of rays, or of texels that
    /// shooters are compared with: passes `radiosity.choose`, and `radiosity.rays` or those of shooting.
    pub(super) fn iterate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        part: Range<u32>,
    ) -> u64 {
        if self.chosen_count > 0 && self.traced == 0 {
            self.choosing
                .record(frame, scene, self.last, self.chosen_count);
        }
        if let Some(shooting) = &self.shooting {
            shooting.iterate(frame, scene, self.last);
        } else {
            for piece in &self.pieces {
                piece.write(frame.gpu, &self.work, piece.texels_of(&part));
            }
            frame.compute("radiosity.rays", |pass| {
                for piece in &self.pieces {
                    let groups = [
                        (0, &scene.ray_bind_group),
                        (1, &piece.rays),
                        (2, &self.corners),
                        (3, &piece.rays_texels[self.last]),
                    ];
                    let texels = piece.texels_of(&part).len() as u32;
                    if texels > 0 {
                        kernels.rays.dispatch(pass, &groups, [texels, 1, 1]);
                    }
                }
            });
        }
        self.traced = part.end;
        if part.end == self.work.texels {
            self.traced = 0;
            self.last = 1 - self.last;
            self.iterates += 1;
        }
        part.len() as u64 * self.work_per_texel
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
        (self.iterates, self.traced) = (iterates, 0);
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
    /// Texels of the piece that are among these of all pieces.
    fn texels_of(&self, texels: &Range<u32>) -> Range<u32> {
        let here = |texel: u32| texel.saturating_sub(self.first_texel).min(self.count);
        here(texels.start)..here(texels.end)
    }

    /// Writes what the passes of the piece read, of which these texels trace rays.
    fn write(&self, gpu: &Gpu, work: &Work, traced: Range<u32>) {
        let work = Work {
            first_texel: self.first_texel,
            count: self.count,
            first_traced: traced.start,
            end_traced: traced.end,
            ..*work
        };
        self.work.write(gpu, std::slice::from_ref(&work));
    }

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
        let work = HostBuffer::new(gpu, "radiosity", bytes, wgpu::BufferUsages::UNIFORM)?;
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
