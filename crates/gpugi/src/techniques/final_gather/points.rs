//! Reference points with cubes of their own: they are captured and lit in turns, in benches that they share.

use glam::Vec3;

use super::gpu::Work;
use super::maps::{Bench, Kernels, Making, Maps};
use crate::capture::{Capture, CubeView, Faces, SURFACE_POINT_BYTES, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::{Draw, Versions};
use crate::techniques::Earlier;

/// Near distance of cubes, as a fraction of the scene's diagonal.
const NEAR: f32 = 1e-4;

/// Faces that are captured and lit together: all six of a reference point, or some of them.
#[derive(Debug, Clone, Copy)]
struct Turn {
    point: usize,
    faces: usize,
    /// [`Points::wanted`] when they were lit; 0: never.
    lit: u64,
}

/// A cube to work in, and what it shows.
#[derive(Debug)]
struct Workplace {
    capture: Capture,
    faces: Vec<Faces>,
    bench: Bench,
    holds: Option<Captured>,
}

/// What a cube shows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Captured {
    position: Vec3,
    turn: usize,
    geometry: u64,
    materials: u64,
    instances: u64,
}

/// The reference points.
#[derive(Debug)]
pub struct Points {
    pub positions: Vec<Vec3>,
    turns: Vec<Turn>,
    /// Where the next frame goes on.
    next: usize,
    wanted: u64,
    workplaces: Vec<Workplace>,
    side: u32,
}

impl Points {
    /// Points that nothing has lit yet; `faces_per_frame` of their faces are lit per frame.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        maps: &Maps,
        earlier: &Earlier<'_>,
        positions: Vec<Vec3>,
        faces_per_frame: u32,
    ) -> Result<Self, GpuError> {
        let side = maps.probes.resolution;
        let at_once = faces_per_frame.min(6);
        let turns_per_point = 6_u32.div_ceil(at_once);
        let turns: Vec<Turn> = (0..positions.len())
            .flat_map(|point| {
                (0..turns_per_point as usize).map(move |faces| Turn {
                    point,
                    faces,
                    lit: 0,
                })
            })
            .collect();
        let workplaces = (faces_per_frame / at_once).min(turns.len() as u32);
        let workplace = |_| {
            let capture = Capture::of_cube(gpu, earlier.impostors.capture_kernels(), side)?;
            let faces = (0..turns_per_point)
                .map(|turn| capture.faces(gpu, turn * at_once..((turn + 1) * at_once).min(6)))
                .collect::<Result<_, _>>()?;
            Ok(Workplace {
                capture,
                faces,
                bench: Bench::new(gpu, kernels, maps, side)?,
                holds: None,
            })
        };
        Ok(Self {
            positions,
            turns,
            next: 0,
            wanted: 1,
            workplaces: (0..workplaces)
                .map(workplace)
                .collect::<Result<_, GpuError>>()?,
            side,
        })
    }

    /// Makes all of them stale.
    pub fn invalidate(&mut self) {
        self.wanted += 1;
    }

    /// Turns that are not lit as they should be, and turns that were never lit.
    pub fn left(&self) -> [usize; 2] {
        let count = |is_left: &dyn Fn(&Turn) -> bool| {
            self.turns.iter().filter(|turn| is_left(turn)).count()
        };
        [
            count(&|turn| turn.lit != self.wanted),
            count(&|turn| turn.lit == 0),
        ]
    }

    /// All turns.
    pub fn turns(&self) -> usize {
        self.turns.len()
    }

    /// Bytes of the cubes that points share.
    pub fn bytes(&self) -> u64 {
        // Besides points and light: hit records and depth.
        let texel = SURFACE_POINT_BYTES + 8;
        let cube = 6 * u64::from(self.side * self.side) * texel;
        let cubes = self.workplaces.iter();
        cubes.map(|one| cube + one.bench.bytes()).sum()
    }

    /// Captures and lights as many stale faces as the frame may; whether there were any.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn light(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        earlier: &mut Earlier<'_>,
    ) -> Result<bool, GpuError> {
        let count = self.turns.len();
        // In turn, so that none waits for ever where everything changes in every frame.
        let stale: Vec<usize> = (0..count)
            .map(|offset| (self.next + offset) % count)
            .filter(|&index| self.turns[index].lit != self.wanted)
            .take(self.workplaces.len())
            .collect();
        for (workplace, &index) in self.workplaces.iter_mut().zip(&stale) {
            if !earlier.may_step() {
                break;
            }
            let turn = &mut self.turns[index];
            turn.lit = self.wanted;
            self.next = (index + 1) % count;
            let position = self.positions[turn.point];
            let work = Work {
                point: turn.point as u32,
                ..making.work
            };
            workplace.light(frame, making, earlier, position, turn.faces, &work)?;
        }
        Ok(!stale.is_empty())
    }
}

impl Workplace {
    fn light(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        earlier: &mut Earlier<'_>,
        position: Vec3,
        turn: usize,
        work: &Work,
    ) -> Result<(), GpuError> {
        let Making { scene, output, .. } = making;
        let near = scene.diagonal() * NEAR;
        let mut view = CubeView::new(position, work.resolution, near, 0, 0);
        output.write(&mut view.uniform);
        let Versions {
            geometry,
            materials,
            instances,
            ..
        } = scene.versions;
        let captured = Captured {
            position,
            turn,
            geometry,
            materials,
            instances,
        };
        let faces = &self.faces[turn];
        if self.holds != Some(captured) {
            // Solids are seen from inside, too: so a point inside one is known, and the backs of walls hide what is
            // behind them.
            let class_of = |draw: &Draw| Some(draw.seen.from_both_sides());
            self.capture
                .record_faces(frame, scene, &view, faces, class_of)?;
            self.holds = Some(captured);
        }
        let points = SurfacePoints {
            output,
            ..faces.points.clone()
        };
        self.bench.light(frame, making, earlier, &points, work)
    }
}
