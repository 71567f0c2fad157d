//! Finds texels whose points lie inside other objects, moves the points out or removes them, and counts both.

use bytemuck::{Pod, Zeroable};

use super::{AtlasCapture, AtlasPiece};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, read_buffer};
use crate::scene::GpuScene;
use crate::shader;

/// A point counts as inside if at least this share (0 to 1) of its hemisphere's rays hits surfaces from behind.
const SHARE: f32 = 0.5;
/// Texels per part: the least that a dispatch tests.
const PART: u32 = if cfg!(test) { 1 << 10 } else { 1 << 14 };
/// Most parts per dispatch. Each texel traces up to 40 rays, and no driver may take the dispatch for a hang.
const PARTS_AT_ONCE: usize = 4;
/// Rays that most texels trace: `RAYS` of capture/atlas/leaks.wesl.
const RAYS: u64 = 16;

/// `Settings` of capture/atlas/leaks.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct LeakSettings {
    pub share: f32,
    pub size: u32,
    pub first: u32,
    pub end: u32,
}

/// What became of the texels of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct LeakReport {
    /// Texels that no triangle touches.
    pub empty: u64,
    /// Texels whose points lie where light can reach.
    pub good: u64,
    /// Texels whose points lay inside something and were moved out, by one texel at most.
    pub moved: u64,
    /// Texels whose points lay inside something and were removed.
    pub invalid: u64,
}

/// Color of a texel in a map, by its state: empty, good, moved, invalid.
const COLORS: [[u8; 4]; 4] = [
    [0, 0, 0, 0],
    [128, 128, 128, 255],
    [0, 200, 0, 255],
    [230, 0, 0, 255],
];

impl LeakReport {
    /// Counts the texels that [`LeakTest::map`] shows.
    pub fn of_map(map: &[[u8; 4]]) -> Self {
        let [empty, good, moved, invalid] =
            COLORS.map(|color| map.iter().filter(|texel| **texel == color).count() as u64);
        Self {
            empty,
            good,
            moved,
            invalid,
        }
    }
}

/// Finds the texels of an atlas whose points lie inside other objects.
#[derive(Debug)]
pub struct LeakTest {
    kernel: Kernel,
    pieces: Vec<Piece>,
    /// Number of the capture whose points were last tested.
    tested: u64,
    /// Number of the capture whose points are being tested, and parts so far.
    testing: (u64, usize),
}

#[derive(Debug)]
struct Piece {
    /// Bind group 1 of dispatches that begin at each of its parts.
    parts: Vec<wgpu::BindGroup>,
    states: wgpu::Buffer,
    count: u32,
}

impl LeakTest {
    /// Allocates the test of the texels of `capture`. `rays` is the same scene, uploaded for ray tracing
    /// ([`GpuScene::with_rays`]).
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, rays: &GpuScene, capture: &AtlasCapture) -> Result<Self, GpuError> {
        let kernel = rays.ray_kernel(gpu, &shader!("capture.atlas.leaks"), &[])?;
        let piece = |piece: &AtlasPiece| {
            let count = piece.points.count;
            let storage = wgpu::BufferUsages::STORAGE;
            let states = gpu.buffer("states of texels [bytes]", u64::from(count) * 4, storage)?;
            let part = |first: u32| {
                let settings = LeakSettings {
                    share: SHARE,
                    size: capture.size,
                    first,
                    end: count,
                };
                let settings = gpu.uniform("leak test", &settings)?;
                let resources = [
                    ("settings", settings.as_entire_binding()),
                    ("points", piece.points.points.as_entire_binding()),
                    ("states", states.as_entire_binding()),
                ];
                kernel.bind(gpu, 1, &resources)
            };
            let firsts = (0..count).step_by(PART as usize);
            Ok(Piece {
                parts: firsts.map(part).collect::<Result<_, GpuError>>()?,
                states,
                count,
            })
        };
        Ok(Self {
            pieces: capture
                .pieces()
                .iter()
                .map(piece)
                .collect::<Result<_, GpuError>>()?,
            kernel,
            tested: 0,
            testing: (0, 0),
        })
    }

    /// Tests the points of `capture` if they were captured again since the last test: pass `capture.atlas.leaks`.
    /// Points that lie inside something are moved out along their surface, or lose their instance as if no triangle
    /// touched the texel.
    pub fn record(&mut self, frame: &mut Frame<'_>, rays: &GpuScene, capture: &AtlasCapture) {
        while !self.is_done(capture) {
            self.record_part(frame, rays, capture, usize::MAX);
        }
    }

    /// Whether all points of `capture` are tested.
    pub(crate) fn is_done(&self, capture: &AtlasCapture) -> bool {
        self.tested == capture.number
    }

    /// Tests some more of the points, in `most` parts at most; all of them if the last test was not finished before the
    /// points changed. Returns the number of rays.
    pub(crate) fn record_part(
        &mut self,
        frame: &mut Frame<'_>,
        rays: &GpuScene,
        capture: &AtlasCapture,
        mut most: usize,
    ) -> u64 {
        let (of, mut first) = self.testing;
        if of != capture.number {
            if first > 0 {
                most = usize::MAX;
            }
            first = 0;
        }
        let all = self.pieces.iter().map(|piece| piece.parts.len()).sum();
        let end = first.saturating_add(most).min(all);
        let mut rays_traced = 0;
        frame.compute("capture.atlas.leaks", |pass| {
            let mut before = 0;
            for piece in &self.pieces {
                let within = |part: usize| part.saturating_sub(before).min(piece.parts.len());
                let parts = within(first)..within(end);
                for part in parts.clone().step_by(PARTS_AT_ONCE) {
                    let groups = [(0, &rays.ray_bind_group), (1, &piece.parts[part])];
                    let parts = (parts.end - part).min(PARTS_AT_ONCE) as u32;
                    let count = (parts * PART).min(piece.count - part as u32 * PART);
                    self.kernel.dispatch(pass, &groups, [count, 1, 1]);
                    rays_traced += u64::from(count) * RAYS;
                }
                before += piece.parts.len();
            }
        });
        self.testing = (capture.number, end);
        if end == all {
            self.tested = capture.number;
            self.testing.1 = 0;
        }
        rays_traced
    }

    /// Counts the texels of each kind. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn report(&self, gpu: &Gpu) -> Result<LeakReport, GpuError> {
        Ok(LeakReport::of_map(&self.map(gpu)?))
    }

    /// State of the texels of each piece, 32 bits each: 0 empty, 1 good, 2 moved, 3 invalid.
    pub(crate) fn states(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.pieces.iter().map(|piece| &piece.states)
    }

    /// An image of all rows, 8-bit RGBA: empty texels transparent, good ones grey, moved ones green, invalid ones red.
    /// Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn map(&self, gpu: &Gpu) -> Result<Vec<[u8; 4]>, GpuError> {
        let mut pixels = Vec::new();
        for piece in &self.pieces {
            let states: Vec<u32> = read_buffer(gpu, &piece.states, u64::from(piece.count) * 4)?;
            let color = |state: u32| COLORS[(state as usize).min(COLORS.len() - 1)];
            pixels.extend(states.into_iter().map(color));
        }
        Ok(pixels)
    }
}
