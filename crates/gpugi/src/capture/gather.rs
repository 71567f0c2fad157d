//! Passes over the points of receivers.

use std::sync::OnceLock;

use super::{Output, Receiver, Slots, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Named, Shader};
use crate::scene::GpuScene;

/// A kernel with one invocation per point of a receiver that is lit. It binds the scene, the points (`seen`, `points`),
/// their `hits`
/// and the target (`radiance`), as far as its shader declares them, and whatever else it is given by name. It is compiled
/// for cameras and cubes; a general variant for all other receivers is compiled when one first needs it, or in advance if
/// techniques of the scene's lighting will.
#[derive(Debug)]
pub struct Gather {
    radiance: Kernel,
    general: OnceLock<Kernel>,
    traces_rays: bool,
}

impl Gather {
    /// Compiles the entry point `main` of a shader that imports `capture::receiver`, with values of its
    /// pipeline-overridable constants.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let options = KernelOptions {
            constants,
            ..Default::default()
        };
        Self::with_options(gpu, scene, shader, &options)
    }

    /// The same with all options.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub(crate) fn with_options(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        options: &KernelOptions<'_>,
    ) -> Result<Self, GpuError> {
        Self::over(gpu, scene, false, shader, options)
    }

    /// The same for a shader that traces rays in this scene, with `more` pipeline constants.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub(crate) fn tracing_rays(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        more: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let options = KernelOptions {
            constants: &[&scene.ray_constants(), more].concat(),
            ..Default::default()
        };
        Self::over(gpu, scene, true, shader, &options)
    }

    fn over(
        gpu: &Gpu,
        scene: &GpuScene,
        traces_rays: bool,
        shader: &Shader,
        options: &KernelOptions<'_>,
    ) -> Result<Self, GpuError> {
        let layout = match traces_rays {
            true => &scene.ray_layout,
            false => &scene.layout,
        };
        let options = KernelOptions {
            constants: &[options.constants, &[("IS_GENERAL", 0.0)]].concat(),
            ..*options
        };
        let made = Self {
            radiance: Kernel::with_options(gpu, shader, "main", Some(layout), &options)?,
            general: OnceLock::new(),
            traces_rays,
        };
        if scene.has_irradiance {
            made.general(gpu)?;
        }
        Ok(made)
    }

    /// The same kernel with other values of some constants ([`Kernel::variant`]).
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the shader has no such constant.
    pub(crate) fn variant(&self, gpu: &Gpu, constants: &[(&str, f64)]) -> Result<Self, GpuError> {
        Ok(Self {
            radiance: self.radiance.variant(gpu, constants)?,
            general: OnceLock::new(),
            ..*self
        })
    }

    /// Records the pass `name`, which binds `more` by their names in the shader.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        receiver: &Receiver,
        more: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let count = receiver.points.lit;
        frame.compute(name, |pass| {
            self.run(gpu, pass, scene, receiver, more, count)
        })
    }

    /// Runs in a pass, for `count` of the points.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub(crate) fn run(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        more: &[Named<'_>],
        count: u32,
    ) -> Result<(), GpuError> {
        let group = match self.traces_rays {
            true => &scene.ray_bind_group,
            false => &scene.bind_group,
        };
        let resources = [&receiver.resources()[..], more].concat();
        let kernel = self.of(gpu, &receiver.points)?;
        kernel.run(pass, Some(group), &resources, [count, 1, 1])
    }

    /// The kernel for `points`.
    fn of(&self, gpu: &Gpu, points: &SurfacePoints) -> Result<&Kernel, GpuError> {
        if points.output == Output::RadianceToEye && points.slots == Slots::default() {
            return Ok(&self.radiance);
        }
        self.general(gpu)
    }

    fn general(&self, gpu: &Gpu) -> Result<&Kernel, GpuError> {
        made_once(&self.general, || {
            self.radiance.variant(gpu, &[("IS_GENERAL", 1.0)])
        })
    }
}

/// What `kept` holds; `make` makes it on first use.
///
/// # Errors
/// Those of `make`.
pub(super) fn made_once<T>(
    kept: &OnceLock<T>,
    make: impl FnOnce() -> Result<T, GpuError>,
) -> Result<&T, GpuError> {
    if let Some(made) = kept.get() {
        return Ok(made);
    }
    let made = make()?;
    Ok(kept.get_or_init(|| made))
}
