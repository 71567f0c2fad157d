//! Receivers: surface points, and where gathers add the light that arrives at them. A camera's pixels, the faces of a
//! cube, texels of an atlas, vertices of a mesh, probes and particles are all receivers, lit by the same gathers.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{SURFACE_POINT_BYTES, SurfacePoints, Target, ViewUniform, hits_of_points};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::gpu::octahedral;

/// The quantity that a gather computes at a point: the constants of capture/receiver.wesl.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Output {
    /// Radiance toward the eye (W/sr/m^2), by all lobes of the point's material.
    #[default]
    RadianceToEye,
    /// Irradiance (W/m^2), independent of the surface's material.
    Irradiance,
    /// Fluence at a point in free space (W/m^2): radiance integrated over the sphere. Techniques that keep light only
    /// on surfaces (radiosity, obscurances, caustics) add none.
    Fluence,
    /// Radiance that a medium scatters in the point's direction, per unit of scattering (W/sr/m^2), with the phase
    /// function of Henyey and Greenstein.
    Inscatter {
        /// Mean cosine of the phase function (-1 to 1, both excluded).
        asymmetry: f32,
    },
}

impl Output {
    /// Writes it into the struct that shaders read.
    pub(crate) fn write(self, view: &mut ViewUniform) {
        (view.output, view.asymmetry) = match self {
            Self::RadianceToEye => (0, 0.0),
            Self::Irradiance => (1, 0.0),
            Self::Fluence => (2, 0.0),
            Self::Inscatter { asymmetry } => (3, asymmetry),
        };
    }
}

/// Points that receive light, and the target to which it is added. Cloning copies handles only.
#[derive(Debug, Clone)]
pub struct Receiver {
    /// The points, the view that sees them, and the quantity that gathers compute at them.
    pub points: SurfacePoints,
    /// Where gathers add.
    pub target: Target,
    /// See [`Receiver::briefly`].
    pub(crate) is_brief: bool,
    /// See [`Receiver::seen_through`].
    pub(super) transmittance: Option<wgpu::Buffer>,
}

impl Receiver {
    /// A receiver whose light at `points` is added to `target`.
    pub fn new(points: &SurfacePoints, target: &Target) -> Self {
        Self {
            points: points.clone(),
            target: target.clone(),
            is_brief: false,
            transmittance: None,
        }
    }

    /// The same receiver, whose light is soon gathered again: until then, neighbouring points may share samples of
    /// lights, as cameras' pixels do.
    pub(crate) fn briefly(self) -> Self {
        Self {
            is_brief: true,
            ..self
        }
    }

    /// The same receiver, seen through a medium or through surfaces: what gathers add is multiplied by a transmittance
    /// per point, one vec4f for each entry of the points' buffer (0 to 1 in rgb; a is not read). The light is added to
    /// the target with every sample, also with the first, so that several layers can share a target: clear it before.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when there are fewer transmittances than points.
    pub fn seen_through(self, transmittance: &wgpu::Buffer) -> Result<Self, GpuError> {
        let needed = self.points.points.size() / SURFACE_POINT_BYTES * 16;
        if transmittance.size() < needed {
            return Err(GpuError::Pass {
                pass: "frame.attenuation".into(),
                reason: format!(
                    "the transmittances have {} bytes, {needed} are needed",
                    transmittance.size()
                ),
            });
        }
        Ok(Self {
            transmittance: Some(transmittance.clone()),
            ..self
        })
    }

    /// Clears what the target has of the points; all of it, if their results do not lie side by side.
    pub(crate) fn clear(&self, frame: &mut Frame<'_>) {
        let SurfacePoints {
            first,
            count,
            slots,
            ..
        } = self.points;
        let target = &self.target.radiance;
        let [start, end] = [first, first + count].map(|entry| u64::from(entry) * 16);
        let bytes = match slots == Slots::default() {
            true => start..end.min(target.size()),
            false => 0..target.size(),
        };
        frame.clear_range(target, bytes);
    }

    /// What passes over the points bind: `seen`, `points` and `hits`, `radiance`, to which they add, `mirrored` and
    /// `noisy`.
    pub fn resources(&self) -> [Named<'_>; 6] {
        let [seen, points, hits] = self.points.resources();
        let Target {
            radiance,
            mirrored,
            noisy,
        } = &self.target;
        [
            seen,
            points,
            hits,
            ("radiance", radiance),
            ("mirrored", mirrored),
            ("noisy", noisy),
        ]
    }
}

/// A point that is lit, but does not belong to a surface that a view sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// World space (m).
    pub position: Vec3,
    /// Unit vector: the normal for irradiance, the direction of scattering for inscatter; unused for fluence.
    pub direction: Vec3,
}

/// `PackedSurfacePoint` of capture/surface_point.wesl, of a white point without an instance.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct PackedProbe {
    position: [f32; 3],
    normal: u32,
    geometric_normal: u32,
    area: f32,
    diffuse: u32,
    f0: u32,
    gloss: u32,
    emission: u32,
    instance: u32,
    material: u32,
}

/// Instance of points that belong to no instance; at `NO_INSTANCE`, there is no point.
const FREE: u32 = u32::MAX - 1;

/// Where the results of probes are stored in their target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slots {
    /// Entry of the first probe (16 bytes each).
    pub first: u32,
    /// Distance between consecutive probes, at least 1 (entries).
    pub stride: u32,
}

impl Default for Slots {
    fn default() -> Self {
        Self {
            first: 0,
            stride: 1,
        }
    }
}

impl Receiver {
    /// `probes` that write their results to `slots` of `target`, such as one of 36 coefficients of each vertex.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`]; [`GpuError::Pass`] when the target is too small.
    pub fn of_probes(
        gpu: &Gpu,
        probes: &[Probe],
        output: Output,
        target: &Target,
        slots: Slots,
    ) -> Result<Self, GpuError> {
        let count = probes.len() as u32;
        let end = u64::from(slots.first)
            + u64::from(count.saturating_sub(1)) * u64::from(slots.stride.max(1))
            + 1;
        if count > 0 && end * 16 > target.radiance.size() {
            return Err(GpuError::Pass {
                pass: "probes".into(),
                reason: format!(
                    "the target has {} bytes, {} are needed",
                    target.radiance.size(),
                    end * 16
                ),
            });
        }
        let packed: Vec<PackedProbe> = probes
            .iter()
            .map(|probe| {
                let normal = octahedral(probe.direction);
                PackedProbe {
                    position: probe.position.to_array(),
                    normal,
                    geometric_normal: normal,
                    instance: FREE,
                    ..Zeroable::zeroed()
                }
            })
            .collect();
        let mut view = ViewUniform {
            width: count.max(1),
            height: 1,
            target_first: slots.first,
            target_skip: slots.stride.max(1) - 1,
            ..Zeroable::zeroed()
        };
        output.write(&mut view);
        // Gathers that look up atlases bind a visibility buffer; these points have none.
        let hits = hits_of_points(gpu, [1, 1])?;
        let bytes = u64::from(count) * SURFACE_POINT_BYTES;
        let buffer = gpu.buffer("probes [bytes]", bytes, wgpu::BufferUsages::STORAGE)?;
        gpu.write(&buffer, 0, &packed);
        Ok(Self {
            points: SurfacePoints {
                points: buffer,
                view: gpu.uniform("view of probes", &view)?,
                first: 0,
                count,
                lit: count,
                hits,
                output,
                slots,
            },
            target: target.clone(),
            is_brief: false,
            transmittance: None,
        })
    }
}
