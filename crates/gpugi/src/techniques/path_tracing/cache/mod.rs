//! Light of earlier frames, on which the paths of live pictures end: cells of a hash table (cells.wesl). Some of the places
//! where paths end are remembered (end.wesl); paths of the next frame that begin there (begin.wesl) teach their cells
//! (learn.wesl), and themselves end on light that is known, so that over the frames it has all bounces (settle.wesl).

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Named, join};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;

/// Places that are remembered of each block of 8 x 8 points. Twice as many gained less than a hundredth.
pub const PLACES_OF_BLOCK: u32 = 8;
/// Slots of the table; fewer in software, where each frame goes through all of them.
const CELLS: u32 = 1 << 19;
const CELLS_IN_SOFTWARE: u32 = 1 << 16;
/// Bytes of `Cell`, `Known` and `Place` of cells.wesl.
const CELL_BYTES: u64 = 40;
const KNOWN_BYTES: u64 = 16;
const PLACE_BYTES: u64 = 32;
/// Samples of earlier frames that count, and the part of them that still does in the next frame; the same after places have
/// changed, which changes light here and there; and after lights or materials have, which changes it everywhere.
const SETTLED: [f32; 2] = [1024.0, 1.0];
const MOVED: [f32; 2] = [64.0, 0.95];
const CHANGED: [f32; 2] = [16.0, 0.75];
/// Frames after such a change, while light goes on from cell to cell.
const UNSETTLED_FRAMES: u32 = 16;

/// `Settling` of settle.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SettlingUniform {
    most_samples: f32,
    kept: f32,
    padding: [u32; 2],
}

/// The table, and the places that are remembered.
#[derive(Debug)]
pub struct Cache {
    /// Knows of its pipelines alone.
    gpu: Gpu,
    begin: Kernel,
    end: Kernel,
    learn: Kernel,
    settle: Kernel,
    cells: wgpu::Buffer,
    known: wgpu::Buffer,
    /// Slots of both.
    count: u32,
    /// Those that this frame remembers, and those of the frame before.
    places: [wgpu::Buffer; 2],
    /// Whether cells have samples that they do not know yet.
    is_taught: bool,
    versions: Option<Versions>,
    /// Frames since anything changed, and since more did than places.
    settled: [u32; 2],
}

impl Cache {
    /// An empty table. `constants` are those of kernels that process vertices.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        constants: &[(&'static str, f64)],
    ) -> Result<Self, GpuError> {
        let gpu = &gpu.apart();
        let own = Some(&scene.layout);
        let kernel = |shader, constants: &[(&str, f64)]| {
            let options = KernelOptions {
                constants,
                ..KernelOptions::default()
            };
            Kernel::with_options(gpu, &shader, "main", own, &options)
        };
        let lone = |shader| Kernel::new(gpu, &shader, "main", None);
        let of_ends: Vec<_> = constants
            .iter()
            .copied()
            .filter(|(name, _)| *name == "HAS_TRANSMISSION")
            .collect();
        let cells = match gpu.adapter.device_type {
            wgpu::DeviceType::Cpu => CELLS_IN_SOFTWARE,
            _ => CELLS,
        };
        let buffer =
            |label: &str, bytes: u64| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        let places = || buffer("path-tracing.places", PLACE_BYTES);
        Ok(Self {
            gpu: gpu.clone(),
            begin: kernel(shader!("techniques.path_tracing.cache.begin"), constants)?,
            end: kernel(shader!("techniques.path_tracing.cache.end"), &of_ends)?,
            learn: lone(shader!("techniques.path_tracing.cache.learn"))?,
            settle: lone(shader!("techniques.path_tracing.cache.settle"))?,
            cells: buffer("path-tracing.cells", u64::from(cells) * CELL_BYTES)?,
            known: buffer("path-tracing.known", u64::from(cells) * KNOWN_BYTES)?,
            count: cells,
            places: [places()?, places()?],
            is_taught: false,
            versions: None,
            settled: [0; 2],
        })
    }

    /// Whether a frame can use it without waiting for its shaders.
    pub fn is_ready(&self, frame: &Frame<'_>) -> bool {
        !(frame.never_waits() && self.gpu.is_compiling())
    }

    /// The same, with the places of the frame before to begin from, and room for `count` places of this one.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn turned(&mut self, frame: &mut Frame<'_>, count: u32) -> Result<&Self, GpuError> {
        self.places.swap(0, 1);
        let bytes = u64::from(count) * PLACE_BYTES;
        let places = &mut self.places[0];
        if places.size() < bytes {
            *places =
                frame
                    .gpu
                    .buffer("path-tracing.places", bytes, wgpu::BufferUsages::STORAGE)?;
        }
        frame.clear(places);
        self.is_taught = true;
        Ok(self)
    }

    /// Begins `count` paths that teach. `of_paths`: lights and what paths bind.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        of_paths: &[Named<'_>],
        count: u32,
    ) -> Result<(), GpuError> {
        let resources = join(of_paths, &[("places", &self.places[1])]);
        let places = [count, 1, 1];
        let of_scene = Some(&scene.bind_group);
        frame.run(
            "path-tracing.cache",
            &self.begin,
            of_scene,
            &resources,
            places,
        )
    }

    /// Lets the paths end that have met known light. `arguments`: how many there are.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn end(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: &GpuScene,
        of_paths: &[Named<'_>],
        arguments: (&wgpu::Buffer, u64),
    ) -> Result<(), GpuError> {
        let resources = join(
            of_paths,
            &[("known", &self.known), ("places", &self.places[0])],
        );
        self.end
            .run_indirect(pass, Some(&scene.bind_group), &resources, arguments)
    }

    /// Teaches the cells what `count` paths have found.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn learn(
        &self,
        frame: &mut Frame<'_>,
        of_paths: &[Named<'_>],
        count: u32,
    ) -> Result<(), GpuError> {
        let own: [Named<'_>; 2] = [("places", &self.places[1]), ("cells_of_scene", &self.cells)];
        let resources = join(of_paths, &own);
        let places = [count, 1, 1];
        frame.run("path-tracing.cache", &self.learn, None, &resources, places)
    }

    /// Lets cells know what they were taught before this frame, whose scene is at `versions`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn settle(&mut self, frame: &mut Frame<'_>, versions: Versions) -> Result<(), GpuError> {
        if !std::mem::take(&mut self.is_taught) {
            // Nobody has followed what has changed meanwhile.
            if self.versions.is_some_and(|before| before != versions) {
                self.versions = None;
                frame.clear(&self.cells);
                frame.clear(&self.known);
            }
            return Ok(());
        }
        let before = self.versions.replace(versions).or(Some(versions));
        let but_places = Inputs::GEOMETRY.without();
        let light = |versions: Option<Versions>| versions.map(|versions| versions.of(but_places));
        let has_changed = [
            before != Some(versions),
            light(before) != light(Some(versions)),
        ];
        for (settled, has_changed) in self.settled.iter_mut().zip(has_changed) {
            *settled = match has_changed {
                true => 0,
                false => settled.saturating_add(1),
            };
        }
        let [most_samples, kept] = match self.settled.map(|frames| frames >= UNSETTLED_FRAMES) {
            [_, false] => CHANGED,
            [false, true] => MOVED,
            [true, true] => SETTLED,
        };
        let settling = SettlingUniform {
            most_samples,
            kept,
            padding: [0; 2],
        };
        let settling = frame.gpu.constant("path-tracing.settling", &settling)?;
        let resources: [Named<'_>; 3] = [
            ("settling", &settling),
            ("cells_of_scene", &self.cells),
            ("known", &self.known),
        ];
        frame.run(
            "path-tracing.cache",
            &self.settle,
            None,
            &resources,
            [self.count, 1, 1],
        )
    }

    /// Memory of the table and the places (bytes).
    pub fn bytes(&self) -> u64 {
        let places = self.places.iter().map(wgpu::Buffer::size);
        self.cells.size() + self.known.size() + places.sum::<u64>()
    }
}
