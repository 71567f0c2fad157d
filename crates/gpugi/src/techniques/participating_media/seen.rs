//! Media as a view sees them: they light the surfaces behind them, what is behind them dims, and what they scatter is
//! added.

use std::sync::Arc;

use super::network::{Network, of};
use crate::capture::{PerReceiver, Receiver, ReceiverKernel, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

/// The passes that show media.
#[derive(Debug)]
pub struct Passes {
    pub how: How,
    toward_eye: Kernel,
    field: Kernel,
    composite: ReceiverKernel,
    /// Adds what media scatter of direct light.
    direct: Option<ReceiverKernel>,
    /// Adds the light of media on surfaces.
    surfaces: Option<ReceiverKernel>,
}

/// The media of a network as they are seen.
#[derive(Debug)]
pub struct Seen {
    passes: Arc<Passes>,
    /// Bind groups 2.
    lights: Option<wgpu::BindGroup>,
    sources: Option<wgpu::BindGroup>,
    /// What each particle scatters toward the eye of the receiver at hand, and the field at the nodes.
    scattered: wgpu::Buffer,
    field: wgpu::Buffer,
    field_group: wgpu::BindGroup,
    kept: PerReceiver<Arc<Behind>>,
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

/// What is kept for a receiver.
#[derive(Debug)]
struct Behind {
    /// The same points with a target of their own, for what is behind the media.
    receiver: Receiver,
    /// Bind groups of `toward_eye`, by the parity of the iteration.
    toward_eye: [[wgpu::BindGroup; 2]; 2],
    /// Groups 1 and 3.
    composite: [wgpu::BindGroup; 2],
    direct: Option<[wgpu::BindGroup; 2]>,
    surfaces: Option<[wgpu::BindGroup; 2]>,
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
        let direct = || {
            let shader = shader!("techniques.participating_media.direct");
            let constants = [
                ("STEPS", how.steps.into()),
                ("SHADOW_RAYS", how.shadow_rays.into()),
            ];
            ReceiverKernel::tracing_rays(gpu, scene, &shader, &constants)
        };
        let surfaces = || {
            let shader = shader!("techniques.participating_media.surfaces");
            let constants = [("RAYS", how.surface_rays.into())];
            ReceiverKernel::tracing_rays(gpu, scene, &shader, &constants)
        };
        Ok(Self {
            how,
            toward_eye: Kernel::new(gpu, &toward_eye, "main", Some(&scene.layout))?,
            field: Kernel::new(gpu, &field, "main", None)?,
            composite: ReceiverKernel::new(gpu, scene, &composite, &[("STEPS", how.steps.into())])?,
            direct: how.has_marched_lights.then(direct).transpose()?,
            surfaces: (how.surface_rays > 0).then(surfaces).transpose()?,
        })
    }
}

impl Seen {
    /// Room for what the passes find out about a network.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, network: &Network, passes: &Arc<Passes>) -> Result<Self, GpuError> {
        let sources = network.sources();
        let direct = passes.direct.as_ref();
        let lights = direct.map(|direct| sources.bind_lights(gpu, direct.to_bind()));
        let surfaces = passes.surfaces.as_ref();
        let sources = surfaces.map(|surfaces| sources.bind(gpu, surfaces.to_bind()));
        let rows = |count: u32| u64::from(count) * 16;
        let storage = wgpu::BufferUsages::STORAGE;
        let particles = rows(network.values.particles);
        let scattered = gpu.buffer("light scattered to the eye [bytes]", particles, storage)?;
        let field = gpu.buffer(
            "field of scattered radiance [bytes]",
            rows(network.values.nodes),
            storage,
        )?;
        let field_group = passes.field.bind(
            gpu,
            3,
            &[
                ("net", of(&network.uniform)),
                ("neighbours", of(&network.neighbours)),
                ("scattered", of(&scattered)),
                ("field", of(&field)),
            ],
        )?;
        Ok(Self {
            passes: passes.clone(),
            lights: lights.transpose()?,
            sources: sources.transpose()?,
            scattered,
            field,
            field_group,
            kept: PerReceiver::default(),
        })
    }

    /// Whether these passes show it.
    pub fn is_by(&self, passes: &Arc<Passes>) -> bool {
        Arc::ptr_eq(&self.passes, passes)
    }

    /// A receiver of the same points, with a cleared target, for everything that media dim.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
        network: &Network,
    ) -> Result<Receiver, GpuError> {
        let behind = &self.of(frame.gpu, receiver, network)?.receiver;
        frame.clear(&behind.target.radiance);
        Ok(behind.clone())
    }

    /// Adds the light of media on surfaces to what was gathered since [`Seen::begin`], and adds that to the receiver,
    /// dimmed, with what the media scatter and emit: passes `participating-media.surfaces`, `.toward-eye`, `.field`,
    /// `.composite` and `.direct`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn end(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        network: &Network,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let kept = self.of(gpu, receiver, network)?;
        let passes = &self.passes;
        let parity = (network.iterations % 2) as usize;
        let count = network.values.particles;
        if count > 0 {
            frame.compute("participating-media.toward-eye", |pass| {
                let [seen, own] = &kept.toward_eye[parity];
                let groups = [(0, &scene.bind_group), (1, seen), (3, own)];
                // A workgroup of 64 per particle.
                passes
                    .toward_eye
                    .dispatch(pass, &groups, [64 * count, 1, 1]);
            });
            frame.compute("participating-media.field", |pass| {
                let nodes = [network.values.nodes, 1, 1];
                passes
                    .field
                    .dispatch(pass, &[(3, &self.field_group)], nodes);
            });
        }
        if let (Some(surfaces), Some(sources), Some([seen, own])) =
            (&passes.surfaces, &self.sources, &kept.surfaces)
        {
            let kernel = surfaces.of(gpu, &receiver.points)?;
            frame.compute("participating-media.surfaces", |pass| {
                let scene = &scene.ray_bind_group;
                let groups = [(0, scene), (1, seen), (2, sources), (3, own)];
                kernel.dispatch(pass, &groups, [receiver.points.count, 1, 1]);
            });
        }
        let composite = passes.composite.of(gpu, &receiver.points)?;
        frame.compute("participating-media.composite", |pass| {
            let [seen, own] = &kept.composite;
            let groups = [(0, &scene.bind_group), (1, seen), (3, own)];
            composite.dispatch(pass, &groups, [receiver.points.count, 1, 1]);
        });
        if let (Some(direct), Some(lights), Some([seen, own])) =
            (&passes.direct, &self.lights, &kept.direct)
        {
            let kernel = direct.of(gpu, &receiver.points)?;
            frame.compute("participating-media.direct", |pass| {
                let scene = &scene.ray_bind_group;
                let groups = [(0, scene), (1, seen), (2, lights), (3, own)];
                kernel.dispatch(pass, &groups, [receiver.points.count, 1, 1]);
            });
        }
        Ok(())
    }

    /// What is kept for the receiver.
    fn of(
        &mut self,
        gpu: &Gpu,
        receiver: &Receiver,
        network: &Network,
    ) -> Result<Arc<Behind>, GpuError> {
        let passes = &self.passes;
        let make = || {
            let Receiver { points, target, .. } = receiver;
            let size = target.radiance.size();
            let behind = gpu.buffer("light behind media", size, wgpu::BufferUsages::STORAGE)?;
            let toward_eye = |incoming: &wgpu::Buffer| {
                let kernel = &passes.toward_eye;
                let resources = [
                    ("net", of(&network.uniform)),
                    ("particles", of(&network.particles)),
                    ("lights", of(&network.lights)),
                    ("arriving", of(&network.arriving)),
                    ("incoming", of(incoming)),
                    ("scattered", of(&self.scattered)),
                ];
                Ok::<_, GpuError>([
                    kernel.bind(gpu, 1, &[("seen", of(&points.view))])?,
                    kernel.bind(gpu, 3, &resources)?,
                ])
            };
            let [even, odd] = &network.incoming;
            let adding = |kernel: &ReceiverKernel, radiance: &wgpu::Buffer| {
                let kernel = kernel.to_bind();
                let own = [("net", of(&network.uniform)), ("radiance", of(radiance))];
                Ok::<_, GpuError>([points.bind(gpu, kernel)?, kernel.bind(gpu, 3, &own)?])
            };
            let direct = passes.direct.as_ref();
            let direct = direct.map(|direct| adding(direct, &target.radiance));
            let surfaces = passes.surfaces.as_ref();
            let surfaces = surfaces.map(|surfaces| adding(surfaces, &behind));
            let composite = passes.composite.to_bind();
            let resources = [
                ("field", of(&self.field)),
                ("fields", of(&network.fields)),
                ("behind", of(&behind)),
                ("radiance", of(&target.radiance)),
            ];
            Ok(Arc::new(Behind {
                toward_eye: [toward_eye(even)?, toward_eye(odd)?],
                composite: [
                    points.bind(gpu, composite)?,
                    composite.bind(gpu, 3, &resources)?,
                ],
                direct: direct.transpose()?,
                surfaces: surfaces.transpose()?,
                receiver: Receiver::new(points, &Target { radiance: behind }),
            }))
        };
        self.kept.of(receiver, make).cloned()
    }
}
