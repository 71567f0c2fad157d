//! Media as a view sees them: they light the surfaces behind them, what is behind them dims, and what they scatter is
//! added.

use super::network::Network;
use crate::capture::{Gather, PerReceiver, Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Named, join};
use crate::scene::GpuScene;
use crate::shader;

/// The passes that show media.
#[derive(Debug)]
pub struct Passes {
    toward_eye: Kernel,
    field: Kernel,
    composite: Gather,
    /// Adds what media scatter of direct light.
    direct: Option<Gather>,
    /// Adds the light of media on surfaces.
    surfaces: Option<Gather>,
    /// Dims what is noisy behind media, in pictures that tell it.
    dim_noise: Kernel,
}

/// The media of a network as they are seen.
#[derive(Debug)]
pub struct SeenMedia {
    /// What each particle scatters toward the eye of the receiver at hand, and the field at the nodes.
    scattered: wgpu::Buffer,
    field: wgpu::Buffer,
    /// Light of the same points behind the media, and what of it is noisy where a picture tells that.
    behind: PerReceiver<wgpu::Buffer>,
    noise_behind: PerReceiver<wgpu::Buffer>,
}

/// How media are seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct How {
    /// Points on each view ray.
    pub steps: u32,
    /// Shadow rays per view ray and light.
    pub shadow_rays: u32,
    /// Rays on which each surface point finds the light of media.
    pub surface_rays: u32,
    /// Whether there are lights to march toward.
    pub has_marched_lights: bool,
}

impl Passes {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, how: How) -> Result<Self, GpuError> {
        let toward_eye = shader!("techniques.participating_media.toward_eye");
        let field = shader!("techniques.participating_media.field");
        let composite = shader!("techniques.participating_media.composite");
        let dim_noise = shader!("techniques.participating_media.dim_noise");
        let direct = || {
            let shader = shader!("techniques.participating_media.direct");
            let constants = [
                ("STEPS", how.steps.into()),
                ("SHADOW_RAYS", how.shadow_rays.into()),
            ];
            Gather::tracing_rays(gpu, scene, &shader, &constants)
        };
        let surfaces = || {
            let shader = shader!("techniques.participating_media.surfaces");
            let constants = [("RAYS", how.surface_rays.into())];
            Gather::tracing_rays(gpu, scene, &shader, &constants)
        };
        Ok(Self {
            toward_eye: Kernel::new(gpu, &toward_eye, "main", Some(&scene.layout))?,
            field: Kernel::new(gpu, &field, "main", None)?,
            composite: Gather::new(gpu, scene, &composite, &[("STEPS", how.steps.into())])?,
            direct: how.has_marched_lights.then(direct).transpose()?,
            surfaces: (how.surface_rays > 0).then(surfaces).transpose()?,
            dim_noise: Kernel::with_options(
                gpu,
                &dim_noise,
                "main",
                Some(&scene.layout),
                &KernelOptions {
                    constants: &[scene.media_constant()],
                    ..KernelOptions::default()
                },
            )?,
        })
    }
}

impl SeenMedia {
    /// Room for what the passes find out about a network.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, network: &Network) -> Result<Self, GpuError> {
        let rows = |label: &str, count: u32| gpu.room(label, u64::from(count) * 16);
        let values = &network.values;
        Ok(Self {
            scattered: rows("light scattered to the eye [bytes]", values.particles)?,
            field: rows("field of scattered radiance [bytes]", values.nodes)?,
            behind: PerReceiver::default(),
            noise_behind: PerReceiver::default(),
        })
    }

    /// A receiver of the same points, with a cleared target, for everything that media dim.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
    ) -> Result<Receiver, GpuError> {
        let behind = self.behind(frame.gpu, receiver)?;
        frame.clear(&behind.target.radiance);
        if behind.target.is_noisy() {
            frame.clear(&behind.target.noisy);
        }
        Ok(behind)
    }

    /// Adds the light of media on surfaces to what was gathered since [`SeenMedia::begin`], and adds that to the receiver,
    /// dimmed, with what the media scatter and emit: passes `participating-media.surfaces`, `.toward-eye`, `.field`,
    /// `.composite`, `.direct` and, in pictures that tell what is noisy, `.dim-noise`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn end(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        network: &Network,
        passes: &Passes,
    ) -> Result<(), GpuError> {
        let behind = self.behind(frame.gpu, receiver)?;
        let own: [Named<'_>; 4] = [
            ("seen", &receiver.points.view),
            ("scattered", &self.scattered),
            ("field", &self.field),
            ("behind", &behind.target),
        ];
        let resources = join(&network.resources(), &own);
        let count = network.values.particles;
        if count > 0 {
            let (name, own) = ("participating-media.toward-eye", Some(&scene.bind_group));
            // A workgroup of 64 per particle.
            let invocations = [64 * count, 1, 1];
            frame.run(name, &passes.toward_eye, own, &resources, invocations)?;
            let (name, nodes) = ("participating-media.field", network.values.nodes);
            frame.run(name, &passes.field, None, &resources, [nodes, 1, 1])?;
        }
        if let Some(surfaces) = &passes.surfaces {
            let name = "participating-media.surfaces";
            surfaces.record(frame, name, scene, &behind, &resources)?;
        }
        let name = "participating-media.composite";
        passes
            .composite
            .record(frame, name, scene, receiver, &resources)?;
        if let Some(direct) = &passes.direct {
            let name = "participating-media.direct";
            direct.record(frame, name, scene, receiver, &resources)?;
        }
        if receiver.target.is_noisy() {
            let name = "participating-media.dim-noise";
            let noise: [Named<'_>; 2] = [
                ("noise_behind", &behind.target.noisy),
                ("noisy", &receiver.target.noisy),
            ];
            let resources = join(&receiver.resources(), &noise);
            let (own, lit) = (Some(&scene.bind_group), [receiver.points.lit, 1, 1]);
            frame.run(name, &passes.dim_noise, own, &resources, lit)?;
        }
        Ok(())
    }

    fn behind(&mut self, gpu: &Gpu, receiver: &Receiver) -> Result<Receiver, GpuError> {
        let target = &receiver.target;
        let room = |of: &wgpu::Buffer| gpu.room("light behind media", of.size());
        let radiance = self.behind.of(receiver, || room(&target.radiance))?;
        let mut behind = Target {
            radiance: radiance.clone(),
            ..target.clone()
        };
        if target.is_noisy() {
            let noisy = self.noise_behind.of(receiver, || room(&target.noisy))?;
            behind.noisy = noisy.clone();
        }
        Ok(Receiver::new(&receiver.points, &behind))
    }
}
