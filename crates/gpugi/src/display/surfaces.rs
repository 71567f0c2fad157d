//! What the pixels of a picture see: normals, materials, objects and triangles in colours.

use bytemuck::{Pod, Zeroable};

use super::{DisplaySettings, Exposure, Part, ToneMap};
use crate::capture::SurfacePoints;
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel};
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

    /// The settings with which it is displayed: colours appear as they are.
    pub(crate) fn settings(settings: &DisplaySettings) -> DisplaySettings {
        DisplaySettings {
            exposure: Exposure::Manual(0.0),
            tone_map: ToneMap::None,
            dither: false,
            ..*settings
        }
    }
}

/// `Surfaces` of surfaces.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SurfacesUniform {
    quantity: u32,
    pixel_count: u32,
    first_pixel: u32,
}

/// The pass that shows surface points of pictures of one size in colours.
#[derive(Debug)]
pub struct Surfaces {
    kernel: Kernel,
    pixels: u32,
    colors: wgpu::Buffer,
}

impl Surfaces {
    /// For pictures of `size` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, &shader!("display.surfaces"), "show_surfaces", None)?;
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
        let bytes = u64::from(size[0]) * u64::from(size[1]) * 16;
        Ok(Self {
            kernel,
            pixels: size[0] * size[1],
            colors: gpu.buffer("display.colors", bytes, wgpu::BufferUsages::STORAGE)?,
        })
    }

    /// Records the pass `display.surfaces`. `parts` are the surface points of consecutive pixels. What it returns is to be
    /// displayed as one sample, with [`Quantity::settings`].
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the picture has another size.
    pub(crate) fn record(
        &self,
        frame: &mut Frame<'_>,
        parts: &[&SurfacePoints],
        quantity: Quantity,
    ) -> Result<Part, GpuError> {
        let gpu = frame.gpu;
        let all: u32 = parts.iter().map(|points| points.count).sum();
        if all != self.pixels {
            return Err(GpuError::Pass {
                pass: "display.surfaces".into(),
                reason: format!("the picture has {all} pixels instead of {}", self.pixels),
            });
        }
        let mut first_pixel = 0;
        for points in parts {
            let uniform = HostBuffer::new(
                gpu,
                "display.surfaces",
                size_of::<SurfacesUniform>() as u64,
                wgpu::BufferUsages::UNIFORM,
            )?;
            let values = SurfacesUniform {
                quantity: quantity as u32,
                pixel_count: points.count,
                first_pixel,
            };
            uniform.write(gpu, std::slice::from_ref(&values));
            let seen = [
                ("points", points.points.as_entire_binding()),
                ("hits", wgpu::BindingResource::TextureView(&points.hits)),
            ];
            let own = [
                ("surfaces", uniform.as_entire_binding()),
                ("colors", self.colors.as_entire_binding()),
            ];
            let seen = self.kernel.bind(gpu, 1, &seen)?;
            let own = self.kernel.bind(gpu, 3, &own)?;
            frame.compute("display.surfaces", |pass| {
                let groups = [(1, &seen), (3, &own)];
                let invocations = [points.count, 1, 1];
                self.kernel.dispatch(pass, &groups, invocations);
            });
            first_pixel += points.count;
        }
        Ok(Part {
            radiance: self.colors.clone(),
            pixels: self.pixels,
        })
    }
}
