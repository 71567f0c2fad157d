//! What the path tracer knows of a scene beside what [`GpuScene`] holds: which lights it samples, where photons are sent,
//! and which solids there are. It follows edits; what they keep is measured once.

use std::collections::BTreeSet;

use gpugi_scene::Scene;

use super::Settings;
use super::lights::{Light, LightTable};
use super::photons::{self, Aims, Measured};
use super::sky::Sky;
use super::surroundings::{self, Solid};
use crate::gpu::{Gpu, GpuError};
use crate::light_paths::LightClass;
use crate::scene::GpuScene;

/// Lights, solids and aims of a scene.
#[derive(Debug)]
pub(super) struct Lit {
    classes: Vec<LightClass>,
    /// The classes whose photons are kept; `None` if there are no photons at all.
    photon_classes: Option<Vec<LightClass>>,
    /// [`Sky::luminance`].
    sky: f64,
    measured: Measured,
    /// Versions of lights and sky that the table is of.
    of: [u64; 2],
    pub table: LightTable,
    pub solids: Vec<Solid>,
    /// Where photons are sent, if there are any to send.
    pub aims: Option<Aims>,
    /// Whether the light tracer finds light of lamps.
    pub has_lamps: bool,
}

impl Lit {
    /// What is to be known of `scene`, for light of some classes. `sky`: [`Sky::luminance`].
    pub fn new(
        scene: &GpuScene,
        (settings, classes): (&Settings, &[LightClass]),
        sky: f64,
        has_photons: bool,
    ) -> Self {
        let mut lit = Self {
            classes: classes.to_vec(),
            photon_classes: has_photons.then(|| photons::kept_classes(settings, classes)),
            sky,
            measured: Measured::default(),
            of: versions(scene),
            table: LightTable::new(scene, classes, sky),
            solids: Vec::new(),
            aims: None,
            has_lamps: false,
        };
        lit.follow(scene);
        lit
    }

    /// Follows edits that keep images, the environment's image, too.
    pub fn follow(&mut self, scene: &GpuScene) {
        let now = versions(scene);
        if self.of != now {
            self.table = LightTable::new(scene, &self.classes, self.sky);
            self.of = now;
        }
        self.solids = surroundings::solids(scene);
        if let Some(classes) = &self.photon_classes {
            let rows = &mut self.table.rows;
            let spheres = photons::spheres(scene.kept(), rows, &mut self.measured);
            self.has_lamps = photons::mark_lamps(&spheres, rows);
            self.aims = Aims::new(&spheres, rows, classes, &self.solids);
        }
    }
}

/// Whether the scene has surfaces that pass light without bending it: thin panes, or solids with the refractive index of
/// air. Without them, shadow rays need not look for any, and the light tracer finds what passes a solid in another of the
/// same index.
pub(super) fn has_straight(scene: &Scene) -> bool {
    let materials = scene.instances.iter().map(|instance| instance.material);
    let used: BTreeSet<usize> = materials.collect();
    used.iter().any(|&index| {
        let material = &scene.materials[index];
        material.transmission > 0.0 && (material.volume.is_none() || material.ior == 1.0)
    })
}

/// Versions of what the light table is made of.
fn versions(scene: &GpuScene) -> [u64; 2] {
    [scene.versions.lights, scene.versions.sky]
}

/// The lights that paths are led to, on the GPU.
#[derive(Debug)]
pub(super) struct LightBuffers {
    rows: wgpu::Buffer,
    emitter_rows: wgpu::Buffer,
    sky: wgpu::Buffer,
}

impl LightBuffers {
    pub fn new(gpu: &Gpu, table: &LightTable, sky: &Sky) -> Result<Self, GpuError> {
        let sky = gpu.storage("path-tracer.sky [bytes]", &sky.words)?;
        Self::under(gpu, table, sky)
    }

    /// Those of another table under the same sky.
    pub fn with_table(&self, gpu: &Gpu, table: &LightTable) -> Result<Self, GpuError> {
        Self::under(gpu, table, self.sky.clone())
    }

    fn under(gpu: &Gpu, table: &LightTable, sky: wgpu::Buffer) -> Result<Self, GpuError> {
        // A binding must hold at least one element, even if it is unused.
        let unlit = [bytemuck::Zeroable::zeroed()];
        let rows: &[Light] = match table.rows.is_empty() {
            true => &unlit,
            false => &table.rows,
        };
        Ok(Self {
            rows: gpu.storage("path-tracer.lights [bytes]", rows)?,
            emitter_rows: gpu.storage("path-tracer.emitters [bytes]", &table.emitter_rows)?,
            sky,
        })
    }

    /// The buffers with their names in the shaders.
    pub fn named(&self) -> [(&'static str, &wgpu::Buffer); 3] {
        [
            ("lights", &self.rows),
            ("emitter_rows", &self.emitter_rows),
            ("sky_grid", &self.sky),
        ]
    }
}
