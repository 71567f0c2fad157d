//! Reference points in the centres of objects, whose surroundings are captured by the impostors that techniques share.

use super::gpu::Work;
use super::maps::{Bench, FrameInputs};
use super::own::OwnSurface;
use super::settings::Settings;
use crate::capture::{CaptureKernels, CubeView, SurfacePoints, ViewUniform};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::impostor::{ImpostorRequest, Renew, Renewal};
use crate::techniques::Earlier;

/// An object with a reference point.
#[derive(Debug)]
pub struct ObjectPoint {
    instance: u32,
    wanted: ImpostorRequest,
    bench: Bench,
    /// Unless its own surface is no light.
    own: Option<OwnSurface>,
    /// View of the cube's points, with what is asked for there.
    view: wgpu::Buffer,
    is_stale: bool,
    /// [`crate::impostor::Maps::renewals`] when it was lit.
    renewals: u64,
    /// Whether its surroundings were lit once.
    pub is_lit: bool,
}

impl ObjectPoint {
    /// The point of an instance, which nothing has lit yet. `has_own`: its own surface is a light, too.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        capture: &CaptureKernels,
        settings: &Settings,
        instance: u32,
        has_own: bool,
    ) -> Result<Self, GpuError> {
        let side = settings.resolution;
        let bytes = size_of::<ViewUniform>() as u64;
        let own = has_own.then(|| OwnSurface::new(gpu, capture, side));
        Ok(Self {
            instance,
            wanted: ImpostorRequest {
                instances: [instance].into(),
                side,
                shape_side: None,
                reference: None,
                layers: 1,
                renewal: Renewal {
                    renew: Renew::Changed(1),
                    threshold: 0.0,
                    faces: settings.faces_per_frame.min(6),
                },
            },
            bench: Bench::new(gpu, side)?,
            own: own.transpose()?,
            view: gpu.buffer("view", bytes, wgpu::BufferUsages::UNIFORM)?,
            is_stale: true,
            renewals: 0,
            is_lit: false,
        })
    }

    /// Follows the object, and lights its surroundings, if they changed since or [`ObjectPoint::invalidate`] was called,
    /// as soon as a frame may; whether it did. `point`: the index of the object's reference point.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn light(
        &mut self,
        frame: &mut Frame<'_>,
        making: FrameInputs<'_>,
        earlier: &mut Earlier<'_>,
        point: u32,
    ) -> Result<bool, GpuError> {
        let FrameInputs { scene, output, .. } = making;
        let settings = earlier.light.settings_version;
        let impostors = &mut earlier.shared.impostors;
        let maps = impostors.follow(frame.gpu, scene, &self.wanted, settings, 0)?;
        self.is_stale |= maps.due.is_some() || maps.renewals != self.renewals;
        if !self.is_stale || !earlier.budget.may_step() {
            return Ok(false);
        }
        (self.is_stale, self.is_lit) = (false, true);
        let maps = earlier.renew(frame, scene, &self.wanted, 0)?;
        self.renewals = maps.renewals;
        let mut view = CubeView::new(maps.reference, self.wanted.side, 0.0, 0, 0);
        output.write(&mut view.uniform);
        let uniform = std::slice::from_ref(&view.uniform);
        frame.gpu.write(&self.view, 0, uniform);
        let points = SurfacePoints {
            view: self.view.clone(),
            output,
            ..maps.points
        };
        let work = Work {
            point,
            instance: self.instance,
            ..making.work
        };
        self.bench.light(frame, making, earlier, &points, &work)?;
        if let Some(own) = &mut self.own {
            own.light(frame, making, earlier, &work)?;
        }
        Ok(true)
    }

    /// Makes its light stale.
    pub fn invalidate(&mut self) {
        self.is_stale = true;
    }

    /// Whether its light is stale.
    pub fn is_stale(&self) -> bool {
        self.is_stale
    }

    /// Bytes of the light of its cube.
    pub fn bytes(&self) -> u64 {
        self.bench.bytes() + self.own.as_ref().map_or(0, OwnSurface::bytes)
    }
}
