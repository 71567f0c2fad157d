//! Texels or vertices, their transfer vectors, and the irradiance that these give under the present light.

use std::sync::Arc;

use gpugi_scene::Atlas;
use serde::{Deserialize, Serialize};

use super::compression::{self, Compressed, Compression};
use super::glossy::{Glossy, GlossyObject};
use super::light::{Light, ProjectedLight};
use super::places::Places;
use super::transfer::{self, Transfer};
use super::{Basis, Cut, INFO, Settings};
use crate::capture::Receiver;
use crate::capture::atlas::KeptIrradiance;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::{Earlier, Generated, Map};

/// Progress that was saved.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Saved {
    pub revision: u64,
    pub transfer: transfer::Saved,
    /// Instead of vectors, once these are compressed.
    pub compressed: Option<compression::Saved>,
}

/// Texels or vertices, and their light.
#[derive(Debug)]
pub(super) struct LitTexels {
    pub places: Places,
    settings: Settings,
    pub transfer: Transfer,
    /// Work toward compressed vectors.
    compression: Option<Compression>,
    /// Compressed vectors, once they are ready.
    compressed: Option<Compressed>,
    pub light: Light,
    pub irradiance: KeptIrradiance,
    relight: Kernel,
    /// Whether the irradiance was computed once.
    is_lit: bool,
    pub revision: u64,
}

impl LitTexels {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        glossy: &[GlossyObject],
        atlas: Option<Arc<Atlas>>,
        cut: Cut,
    ) -> Result<Self, GpuError> {
        let places = Places::new(gpu, scene, settings, atlas, cut.most_texels)?;
        let size = places.map_size();
        let (relight, length) = match settings.basis {
            Basis::Harmonics => (
                shader!("techniques.radiance_transfer.relight"),
                ("ORDER", f64::from(settings.order)),
            ),
            Basis::Haar => (
                shader!("techniques.radiance_transfer.haar.relight"),
                ("TERMS", f64::from(settings.coefficients)),
            ),
        };
        let left_out = ("LEFT_OUT", f64::from(settings.left_out().bits()));
        let glossy = match glossy {
            [] => None,
            glossy => Some(Glossy::new(gpu, scene, settings, glossy, &places, cut)?),
        };
        let constants = [left_out, places.constant()];
        Ok(Self {
            settings: settings.clone(),
            compression: None,
            compressed: None,
            transfer: Transfer::new(gpu, scene, settings, &places, glossy, cut)?,
            light: Light::new(gpu, scene, settings)?,
            relight: Kernel::with_constants(gpu, &relight, "main", None, &[length])?,
            irradiance: KeptIrradiance::new(gpu, scene, size, places.atlas(), &constants)?,
            places,
            is_lit: false,
            revision: 0,
        })
    }

    /// Takes steps toward the transfer vectors, and lights the texels if these or the light have changed.
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        steps: u32,
        made_of_light: ProjectedLight,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        self.places.record(frame, scene)?;
        if self.transfer.follow(scene) {
            self.compression = None;
        }
        let bounces = self.transfer.bounces();
        let (transfer, places) = (&mut self.transfer, &self.places);
        let step = |transfer: &mut Transfer| transfer.step(frame, scene, places);
        earlier
            .budget
            .steps(steps, transfer, Transfer::is_done, step)?;
        let mut has_improved = self.transfer.bounces() > bounces;
        if has_improved {
            self.compressed = None;
        }
        has_improved |= self.compress(frame, earlier)?;
        let changed = self.light.follow(frame, scene, made_of_light)?;
        if let Some(work) = changed {
            earlier.budget.count(work);
        }
        let has_vectors = self.is_lit || self.transfer.bounces() > 0;
        if has_vectors && (has_improved || changed.is_some()) {
            self.relight(frame)?;
            earlier
                .budget
                .count(self.irradiance.target.radiance.size() / 16);
            self.is_lit = true;
            self.revision += u64::from(has_improved);
        }
        Ok(Generated {
            revision: self.revision,
            progress: self.progress(),
            pending: (!self.is_lit).then_some("the first bounce of light"),
        })
    }

    /// Part of the work that is done (0 to 1).
    fn progress(&self) -> f32 {
        let vectors = self.transfer.progress();
        if !self.settings.is_compressed() {
            return vectors;
        }
        let compression = self.compression.as_ref().map(Compression::progress);
        let is_done = self.transfer.is_done() && self.compressed.is_some();
        let compressed = compression.unwrap_or(f32::from(u8::from(is_done)));
        let bounces = self.settings.bounces as f32;
        (vectors * bounces + compressed) / (bounces + 1.0)
    }

    /// Takes a step toward compressed vectors, if they are asked for, and returns whether they have become ready.
    fn compress(
        &mut self,
        frame: &mut Frame<'_>,
        earlier: &mut Earlier<'_>,
    ) -> Result<bool, GpuError> {
        let is_wanted = self.settings.is_compressed() && self.compressed.is_none();
        let vectors = self.transfer.vectors();
        let Some(vectors) = vectors.filter(|_| is_wanted && self.transfer.is_done()) else {
            return Ok(false);
        };
        if !earlier.budget.may_step() {
            return Ok(false);
        }
        let texels = self.irradiance.target.radiance.size() / 16;
        let mut compression = match self.compression.take() {
            Some(compression) => compression,
            None => Compression::new(frame.gpu, &self.settings, texels as u32)?,
        };
        let saved = compression.step(frame, &self.places, vectors)?;
        earlier
            .budget
            .count(texels * u64::from(self.settings.clusters));
        match &saved {
            Some(saved) => {
                self.compressed = Some(Compressed::new(frame.gpu, &self.settings, saved)?);
                self.transfer.free_vectors();
            }
            None => self.compression = Some(compression),
        }
        Ok(saved.is_some())
    }

    /// Saved progress; `None` while there is none. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self, gpu: &Gpu) -> Result<Option<Saved>, GpuError> {
        let Some(transfer) = self.transfer.save(gpu)? else {
            return Ok(None);
        };
        // After a change, compressed vectors remain until there are others.
        let compressed = self.compressed.as_ref();
        let compressed = compressed.filter(|_| self.transfer.vectors().is_none());
        let compressed = compressed
            .map(|compressed| compressed.save(gpu))
            .transpose()?;
        Ok(Some(Saved {
            revision: self.revision,
            transfer,
            compressed,
        }))
    }

    /// Continues from saved progress.
    ///
    /// # Errors
    /// Why it does not fit these texels.
    pub fn resume(&mut self, gpu: &Gpu, saved: &Saved) -> Result<(), String> {
        let texels = self.irradiance.target.radiance.size() / 16;
        let fits = |compressed: &compression::Saved| {
            self.settings.is_compressed() && compressed.fits(&self.settings, texels)
        };
        if !saved.compressed.as_ref().is_none_or(fits) {
            return Err("other clusters".into());
        }
        let text = |error: GpuError| error.to_string();
        let is_compressed = saved.compressed.is_some();
        self.transfer.resume(gpu, &saved.transfer, is_compressed)?;
        let compressed = saved.compressed.as_ref();
        let compressed =
            compressed.map(|compressed| Compressed::new(gpu, &self.settings, compressed));
        self.compressed = compressed.transpose().map_err(text)?;
        self.compression = None;
        if saved.transfer.bounces > 0 {
            self.restore(gpu, saved.revision).map_err(text)?;
        }
        Ok(())
    }

    /// Lights the texels by transfer vectors that were restored, as [`LitTexels::generate`] left them at `revision`.
    fn restore(&mut self, gpu: &Gpu, revision: u64) -> Result<(), GpuError> {
        let mut frame = Frame::new(gpu, false);
        self.relight(&mut frame)?;
        frame.submit()?;
        self.is_lit = true;
        // A file may hold any number, and counters are added to it.
        self.revision = revision.min(u32::MAX.into());
        Ok(())
    }

    /// Multiplies transfer vectors, and matrices, and light: passes `radiance-transfer.relight`,
    /// `radiance-transfer.glossy`, `capture.atlas.dilate` and `capture.atlas.seams`.
    fn relight(&self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        let (light, irradiance) = (&self.light.coefficients, &self.irradiance.target.radiance);
        if let Some(compressed) = &self.compressed {
            compressed.relight(frame, light, irradiance)?;
        } else if let Some(vectors) = self.transfer.vectors() {
            let resources: [Named<'_>; 3] = [
                ("light", light),
                ("transfer", vectors),
                ("irradiance", irradiance),
            ];
            let (name, texels) = ("radiance-transfer.relight", irradiance.size() / 16);
            let texels = [texels as u32, 1, 1];
            frame.run(name, &self.relight, None, &resources, texels)?;
        }
        if let Some(glossy) = &self.transfer.glossy {
            glossy.relight(frame, light)?;
        }
        self.irradiance.finish(frame)
    }

    /// Adds the light at the receiver's points: passes `radiance-transfer.gather` and
    /// `radiance-transfer.glossy-gather`.
    pub fn gather(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let found = (self.places.capture(), self.places.lookup());
        let name = "radiance-transfer.gather";
        self.irradiance
            .gather(frame, name, scene, receiver, found)?;
        match &self.transfer.glossy {
            Some(glossy) => glossy.gather(frame, scene, &self.places, receiver),
            None => Ok(()),
        }
    }

    /// Irradiance of all rows, and the coefficients of the light.
    pub fn maps(&self) -> Vec<Map> {
        let map = |name: &str, buffer: &wgpu::Buffer, size: [u32; 2]| {
            Map::of_colors(format!("{}.{name}", INFO.name), buffer, size, 16)
        };
        let size = self.places.map_size();
        vec![
            map("irradiance", &self.irradiance.target.radiance, size),
            map("light", &self.light.coefficients, self.light.map_size()),
        ]
    }

    /// Bytes that are not in maps.
    pub fn work_bytes(&self) -> u64 {
        let around = self.irradiance.work_bytes();
        let compressed = self.compressed.as_ref().map_or(0, Compressed::bytes);
        self.places.bytes() + self.transfer.bytes() + compressed + self.light.bytes() + around
    }
}
