//! Cubes around points, which are captured and lit in turns. Few points keep what was captured, many share some cubes to
//! work in.

use glam::{Vec3, vec3};

use super::placing::{Placing, Reach, Step};
use crate::capture::{
    Capture, CaptureKernels, CubeView, Faces, Output, SURFACE_POINT_BYTES, SurfacePoints,
};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::{Draw, GpuScene, Versions};

/// Memory in which all points may keep what was captured, so that a change of the light captures nothing again [bytes].
const MOST_KEPT: u64 = 64 << 20;

/// Faces that are captured and lit together: all six of a point, or some of them.
#[derive(Debug, Clone, Copy)]
struct FaceGroup {
    point: usize,
    faces: usize,
    /// [`ProbeCubes::wanted`] when they were lit; `None`: never.
    lit: Option<u64>,
    /// [`Versions::geometry`] when they were captured where the point is now.
    geometry: Option<u64>,
}

/// A cube to work in, and what it shows.
#[derive(Debug)]
struct Workplace<B> {
    capture: Capture,
    faces: Vec<Faces>,
    bench: B,
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

/// A turn that is due, and the cube to work in.
#[derive(Debug, Clone, Copy)]
pub struct DueTurn {
    turn: usize,
    workplace: usize,
}

/// Faces that have been captured, to be lit.
#[derive(Debug)]
pub struct CapturedFaces<'a, B> {
    /// What it takes to light them.
    pub bench: &'a mut B,
    /// The points that they show.
    pub points: SurfacePoints,
    /// The number of the cube.
    pub cube: usize,
    /// Where its point may be moved, if it may.
    pub reach: Option<Reach>,
}

/// The cubes. `B`: what it takes to light one, such as a target.
#[derive(Debug)]
pub struct ProbeCubes<B> {
    pub positions: Vec<Vec3>,
    placing: Option<Placing>,
    /// Whether points have been moved out of solids once.
    was_placed: bool,
    turns: Vec<FaceGroup>,
    /// Where the next frame goes on.
    next: usize,
    wanted: u64,
    /// One per turn, or as many as are lit per frame.
    workplaces: Vec<Workplace<B>>,
    turns_per_frame: usize,
    side: u32,
}

impl<B> ProbeCubes<B> {
    /// Cubes around `positions` with faces of `side` x `side` texels that nothing has lit yet; `faces_per_frame` of them
    /// are lit per frame. `placing`: where the points belong if they may be moved out of solids.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &CaptureKernels,
        side: u32,
        positions: Vec<Vec3>,
        placing: Option<Placing>,
        faces_per_frame: u32,
        bench: impl Fn() -> Result<B, GpuError>,
    ) -> Result<Self, GpuError> {
        let at_once = faces_per_frame.min(6);
        let turns_per_point = 6_u32.div_ceil(at_once);
        let turns: Vec<FaceGroup> = (0..positions.len())
            .flat_map(|point| {
                (0..turns_per_point as usize).map(move |faces| FaceGroup {
                    point,
                    faces,
                    lit: None,
                    geometry: None,
                })
            })
            .collect();
        let turns_per_frame = turns.len().min((faces_per_frame / at_once) as usize);
        let all = turns.len() as u64 * workplace_bytes(side);
        let workplaces = if all <= MOST_KEPT {
            turns.len()
        } else {
            turns_per_frame
        };
        let workplace = |_| {
            let capture = Capture::of_cube(gpu, kernels, side)?;
            let faces = (0..turns_per_point)
                .map(|turn| capture.faces(gpu, turn * at_once..((turn + 1) * at_once).min(6)))
                .collect::<Result<_, _>>()?;
            Ok(Workplace {
                capture,
                faces,
                bench: bench()?,
                holds: None,
            })
        };
        Ok(Self {
            positions,
            placing,
            was_placed: false,
            turns,
            next: 0,
            wanted: 1,
            turns_per_frame,
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
        let count = |is_left: &dyn Fn(&FaceGroup) -> bool| {
            self.turns.iter().filter(|turn| is_left(turn)).count()
        };
        [
            count(&|turn| turn.lit != Some(self.wanted)),
            count(&|turn| turn.lit.is_none()),
        ]
    }

    /// All turns.
    pub fn turns(&self) -> usize {
        self.turns.len()
    }

    /// Whether points have been moved out of solids once, and whether that was for the scene's present geometry.
    pub fn are_placed(&self, geometry: u64) -> [bool; 2] {
        match self.placing.as_ref().map(|placing| &placing.step) {
            None => [true; 2],
            Some(Step::Placed(of)) => [true, *of == geometry],
            Some(_) => [self.was_placed, false],
        }
    }

    /// Bytes of the cubes to work in.
    pub fn bytes(&self) -> u64 {
        self.workplaces.len() as u64 * workplace_bytes(self.side)
    }

    /// The turns that are due in this frame. `ways_out`: four floats per point, the way out of the solid that it lies in
    /// (m), as the light of its faces tells.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn due(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        ways_out: &wgpu::Buffer,
    ) -> Result<Vec<DueTurn>, GpuError> {
        self.place(frame, ways_out, scene.versions.geometry)?;
        let count = self.turns.len();
        // In turn, so that none waits for ever where everything changes in every frame.
        let stale = (0..count)
            .map(|offset| (self.next + offset) % count)
            .filter(|&index| self.turns[index].lit != Some(self.wanted));
        let is_own = self.workplaces.len() == count;
        let due = stale.take(self.turns_per_frame).enumerate();
        let due = due.map(|(number, turn)| DueTurn {
            turn,
            workplace: if is_own { turn } else { number },
        });
        Ok(due.collect())
    }

    /// Captures the faces of a turn that is due, for `output` at what they show. They count as lit.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn capture(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        output: Output,
        due: DueTurn,
    ) -> Result<CapturedFaces<'_, B>, GpuError> {
        let count = self.turns.len();
        let turn = &mut self.turns[due.turn];
        turn.lit = Some(self.wanted);
        turn.geometry = Some(scene.versions.geometry);
        self.next = (due.turn + 1) % count;
        let position = self.positions[turn.point];
        let workplace = &mut self.workplaces[due.workplace];
        Ok(CapturedFaces {
            points: workplace.capture(frame, scene, output, position, turn.faces, self.side)?,
            bench: &mut workplace.bench,
            cube: turn.point,
            reach: self
                .placing
                .as_ref()
                .map(|placing| placing.reach(turn.point)),
        })
    }

    /// Moves points out of solids once all are captured, and again when the scene has come to rest after a change. Until
    /// then moved points stay where they are, so that motion elsewhere does not move them to and fro.
    fn place(
        &mut self,
        frame: &mut Frame<'_>,
        ways_out: &wgpu::Buffer,
        geometry: u64,
    ) -> Result<(), GpuError> {
        let Some(placing) = &mut self.placing else {
            return Ok(());
        };
        let are_captured = self.turns.iter().all(|turn| turn.lit.is_some());
        let are_current = self
            .turns
            .iter()
            .all(|turn| turn.geometry == Some(geometry));
        let mut places = None;
        // Points that were placed before are gathered while they wait for their new light.
        let unlit = self.was_placed.then_some(0);
        match &placing.step {
            Step::Placed(of) if *of != geometry && are_current => {
                placing.step = Step::Home;
                places = Some(placing.home.clone());
            }
            // A scene that never rests does not put the first time off for ever.
            Step::Home if are_current || are_captured && !self.was_placed => {
                let bytes = 16 * self.positions.len() as u64;
                let of = if are_current { geometry } else { 0 };
                let read = Box::new(frame.read_back(ways_out, bytes)?);
                placing.step = Step::Asked(read, of);
            }
            Step::Asked(read, of) => {
                if let Some(found) = read.get() {
                    let home = placing.home.iter();
                    let moved = home
                        .zip(found?)
                        .map(|(home, [x, y, z, _])| *home + vec3(x, y, z));
                    places = Some(moved.collect());
                    placing.step = Step::Placed(*of);
                    self.was_placed = true;
                }
            }
            Step::Home | Step::Placed(_) => (),
        }
        let Some(places) = places else {
            return Ok(());
        };
        for turn in &mut self.turns {
            if places[turn.point] != self.positions[turn.point] {
                turn.lit = unlit;
                turn.geometry = None;
            }
        }
        self.positions = places;
        Ok(())
    }
}

/// Bytes of a cube to work in: surface points and light, hit records and depth.
fn workplace_bytes(side: u32) -> u64 {
    6 * u64::from(side * side) * (SURFACE_POINT_BYTES + 16 + 8)
}

impl<B> Workplace<B> {
    fn capture(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        output: Output,
        position: Vec3,
        turn: usize,
        side: u32,
    ) -> Result<SurfacePoints, GpuError> {
        let near = scene.near();
        let mut view = CubeView::new(position, side, near, 0, 0);
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
        Ok(SurfacePoints {
            output,
            ..faces.points.clone()
        })
    }
}
