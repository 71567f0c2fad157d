//! What the pixels of a picture see: normals, materials, objects and triangles in colours.

use bytemuck::{Pod, Zeroable};

use super::film::{Strip, radiance_32};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::shader;

/// What is shown of each surface point. Where there is no surface, the picture is black.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Shading normals in world space: -1 to 1 of x, y and z as red, green and blue.
    Normal,
    /// Normals of the triangles, toward the viewer.
    GeometricNormal,
    /// Albedo of diffuse reflection, and of what is transmitted.
    Albedo,
    /// Roughness: 0 black, 1 white; Phong's surfaces count as 1.
    Roughness,
    /// A colour per instance.
    Objects,
    /// A colour per material.
    Materials,
    /// A colour per triangle of an instance: the hit records.
    Triangles,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Normal,
        Self::GeometricNormal,
        Self::Albedo,
        Self::Roughness,
        Self::Objects,
        Self::Materials,
        Self::Triangles,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normals",
            Self::GeometricNormal => "normals of triangles",
            Self::Albedo => "albedo",
            Self::Roughness => "roughness",
            Self::Objects => "objects",
            Self::Materials => "materials",
            Self::Triangles => "triangles",
        }
    }
}

/// `Surfaces` of surfaces.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SurfacesUniform {
    quantity: u32,
    width: u32,
    first_row: u32,
    pixel_count: u32,
}

/// The pass that shows surface points of pictures of one size in colours.
#[derive(Debug)]
pub struct Surfaces {
    kernel: Kernel,
    size: [u32; 2],
    colors: wgpu::TextureView,
}

impl Surfaces {
    /// For pictures of `size` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, &shader!("picture.surfaces"), "show_surfaces", None)?;
        Self::by(kernel, gpu, size)
    }

    /// The same for pictures of another size; it compiles nothing.
    ///
    /// # Errors
    /// As [`Surfaces::new`].
    pub fn resized(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Self::by(self.kernel.clone(), gpu, size)
    }

    fn by(kernel: Kernel, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Ok(Self {
            kernel,
            size,
            colors: radiance_32(gpu, size)?,
        })
    }

    /// Records the pass `picture.surfaces` over a picture's strips. What it returns is to be displayed as it is, without
    /// exposure or tone map.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the picture has another size.
    pub(super) fn record(
        &self,
        frame: &mut Frame<'_>,
        strips: &[Strip<'_>],
        quantity: Quantity,
    ) -> Result<&wgpu::TextureView, GpuError> {
        let gpu = frame.gpu;
        let [width, height] = self.size;
        let pixels: u32 = strips.iter().map(|strip| strip.receiver.points.count).sum();
        if pixels != width * height {
            return Err(GpuError::Pass {
                pass: "picture.surfaces".into(),
                reason: format!(
                    "the picture has {pixels} pixels instead of {}",
                    width * height
                ),
            });
        }
        for strip in strips {
            let points = &strip.receiver.points;
            let uniform = gpu.constant(
                "surfaces",
                &SurfacesUniform {
                    quantity: quantity as u32,
                    width,
                    first_row: strip.rows.start,
                    pixel_count: points.count,
                },
            )?;
            let resources: [Named<'_>; 4] = [
                ("points", &points.points),
                ("hits", &points.hits),
                ("surfaces", &uniform),
                ("colors", &self.colors),
            ];
            frame.compute("picture.surfaces", |pass| {
                self.kernel
                    .run(pass, None, &resources, [points.count, 1, 1])
            })?;
        }
        Ok(&self.colors)
    }
}
