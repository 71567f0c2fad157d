//! A path tracer that goes on with an edited scene, or with pictures of another size.

use gpugi_scene::{Edit, Scene};

use super::{Pass, PathTracer, check, tiles};
use crate::denoise::Features;
use crate::gpu::GpuError;
use crate::lighting::LightingError;

impl PathTracer {
    /// Edits the scene, and begins its picture anew, if that costs no more than what the edits change: instances that
    /// move, meshes that deform, lights, factors of materials, and the environment's rotation and intensity. Returns
    /// false if it would cost more, such as an upload or other kernels: then it renders no more until it has followed
    /// edits of the same scene, these included, to one that it can show.
    ///
    /// # Errors
    /// As [`PathTracer::new`].
    pub fn edit(&mut self, edits: &[Edit]) -> Result<bool, LightingError> {
        self.take_first_pose()?;
        self.follow(edits.to_vec())
    }

    /// As [`PathTracer::edit`], by the edits that lead to the scene `after`. Meshes and images count as unchanged if they
    /// are shared.
    ///
    /// # Errors
    /// As [`PathTracer::new`].
    pub fn update(&mut self, after: &Scene) -> Result<bool, LightingError> {
        (self.motion, self.is_later) = (None, false);
        match self.scene.edits_to(after) {
            Some(edits) => self.follow(edits),
            None => Ok(false),
        }
    }

    fn follow(&mut self, edits: Vec<Edit>) -> Result<bool, LightingError> {
        edits.iter().try_for_each(check::check_edit)?;
        let follows = self.change(edits, false)?;
        if follows {
            self.restart(self.seed)?;
        }
        Ok(follows)
    }

    /// Edits the scene, if that costs little ([`PathTracer::edit`]). `goes_on`: the picture does.
    fn change(&mut self, edits: Vec<Edit>, goes_on: bool) -> Result<bool, LightingError> {
        if !self.scene.follow(&self.gpu, edits)? {
            return Ok(false);
        }
        self.lit.follow(&self.scene);
        if !self.has_kernels_for_lights() {
            return Ok(false);
        }
        self.lights = self.lights.with_table(&self.gpu, &self.lit.table)?;
        self.wavefront.light(&self.gpu, &self.lights.named())?;
        if let Some(photons) = &mut self.photons {
            photons.aim(&self.gpu, self.lit.aims.as_ref(), goes_on)?;
        }
        Ok(true)
    }

    /// Goes back to the pose in which the scene was before the shutter opened.
    pub(super) fn take_first_pose(&mut self) -> Result<(), LightingError> {
        let is_later = std::mem::take(&mut self.is_later);
        let motion = self.motion.take().filter(|_| is_later);
        motion.map_or(Ok(()), |motion| self.take_pose(motion.scene()))
    }

    /// Goes on with the same scene in another pose.
    pub(super) fn take_pose(&mut self, posed: &Scene) -> Result<(), LightingError> {
        let edits = self.scene.edits_to(posed);
        let follows = edits.map(|edits| self.change(edits, true)).transpose()?;
        match follows {
            Some(true) => Ok(()),
            _ => Err(GpuError::Input {
                what: "what the animation changes while the shutter is open needs another upload"
                    .into(),
            }
            .into()),
        }
    }

    /// Whether the kernels know of lights as they are now. Those that look for lamps in caustics, for points
    /// in media and for photons serve scenes that have none, too.
    fn has_kernels_for_lights(&self) -> bool {
        (self.looks_for_lamps || !self.lit.has_lamps)
            && (self.looks_in_media || !self.scene.has_lit_media())
            && (self.photons.is_some() || self.lit.aims.is_none())
    }

    /// Begins anew with pictures of `size` pixels. Only what depends on the size is made again.
    ///
    /// # Errors
    /// [`LightingError::Gpu`] when the picture does not fit the adapter or has no pixels.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<(), LightingError> {
        check::check_size(size)?;
        self.forget();
        // The memory of the last picture is free before the next one takes its own.
        self.tiles.clear();
        self.size = size;
        self.make_tiles()?;
        Ok(())
    }

    /// Makes what depends on the picture's size.
    pub(super) fn make_tiles(&mut self) -> Result<(), GpuError> {
        let gpu = &self.gpu;
        self.wavefront.resize(gpu, self.size)?;
        // A tile's largest buffer fits a binding.
        let limits = gpu.limits();
        let features = limits.max_storage_buffer_binding_size / size_of::<Features>() as u64;
        let most = match &self.looker {
            Some(_) => (features.isqrt() as u32).max(8) & !7,
            None => u32::MAX,
        };
        let side = self.tile_side.min(most);
        if let Some(photons) = &mut self.photons {
            let of_tile = self.size.map(|length| length.min(side));
            photons.resize(gpu, self.size, of_tile)?;
        }
        self.tiles = tiles(
            gpu,
            self.size,
            side,
            (&self.wavefront, self.photons.as_ref(), self.looker.as_ref()),
            &self.parameters,
            (&self.noise_kernel, &self.shown_kernel),
        )?;
        Ok(())
    }

    /// Forgets the samples so far.
    pub(super) fn forget(&mut self) {
        (self.samples, self.balanced, self.moments) = (0, 0, 0);
        self.photon_count = 0;
        if let Some(photons) = &mut self.photons {
            photons.begin_anew();
        }
        self.pass = Pass::default();
        (self.batch, self.sums, self.noise) = (None, None, None);
    }
}
