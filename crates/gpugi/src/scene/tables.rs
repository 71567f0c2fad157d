//! The scene's tables: a row an instance, a row a material, rows for the textures that each material may read, and media
//! with their densities.

use std::ops::Range;

use gpugi_scene::{Bounds, Medium, Scene};

use super::gpu;
use super::images::ImageArrays;
use super::media::{densest, density_words, medium_words};
use super::rows::{TEXTURE_SLOTS, material_row};
use crate::gpu::{Gpu, GpuError};

/// The buffer of the tables.
#[derive(Debug)]
pub(super) struct Tables {
    pub buffer: wgpu::Buffer,
    /// What the buffer has, to be written by [`Tables::write_instances`] once changed.
    pub instances: Vec<gpu::Instance>,
    /// The largest density of each medium.
    pub densest: Vec<f32>,
    material_count: usize,
}

impl Tables {
    /// Tables of a scene, but with `media`, of which those that fill everything fill the bounds beside them.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        instances: Vec<gpu::Instance>,
        images: &ImageArrays,
        media: (&[Medium], &Bounds),
    ) -> Result<Self, GpuError> {
        let rows = (0..scene.materials.len()).map(|index| material_row(scene, index, images));
        let (materials, textures): (Vec<gpu::Material>, Vec<_>) = rows.unzip();
        let mut tables: Vec<u8> = Vec::new();
        tables.extend(bytemuck::cast_slice::<gpu::Instance, u8>(&instances));
        tables.extend(bytemuck::cast_slice::<gpu::Material, u8>(&materials));
        tables.extend(bytemuck::cast_slice::<gpu::TextureReference, u8>(
            textures.as_flattened(),
        ));
        let (media, bounds) = media;
        let parameters = medium_words(media, bounds);
        tables.extend(bytemuck::cast_slice::<u32, u8>(parameters.as_flattened()));
        tables.extend(bytemuck::cast_slice::<u32, u8>(&density_words(media)));
        Ok(Self {
            buffer: gpu.storage("scene tables [bytes]", &tables)?,
            instances,
            densest: densest(media),
            material_count: materials.len(),
        })
    }

    /// Bytes where instances, materials, textures and media begin.
    fn starts(&self) -> [usize; 4] {
        let materials = size_of_val(&self.instances[..]);
        let textures = materials + self.material_count * size_of::<gpu::Material>();
        let of_material = TEXTURE_SLOTS * size_of::<gpu::TextureReference>();
        let media = textures + self.material_count * of_material;
        [0, materials, textures, media]
    }

    /// Rows (of 16 bytes) where instances, materials, textures and media begin.
    pub fn rows(&self) -> [u32; 4] {
        self.starts().map(|bytes| bytes as u32 / 16)
    }

    /// Writes the rows of instances, in increasing order without repetition.
    pub fn write_instances(&self, gpu: &Gpu, indices: impl IntoIterator<Item = usize>) {
        for rows in joined(indices.into_iter().map(|index| index..index + 1)) {
            let at = rows.start * size_of::<gpu::Instance>();
            gpu.write(&self.buffer, at as u64, &self.instances[rows]);
        }
    }

    /// Writes the row of one of the scene's materials, and with `textures` the rows of those that it reads.
    pub fn write_material(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        index: usize,
        images: &ImageArrays,
        textures: bool,
    ) {
        let (material, references) = material_row(scene, index, images);
        let [_, materials, texture_rows, _] = self.starts();
        let at = materials + index * size_of::<gpu::Material>();
        gpu.write(&self.buffer, at as u64, &[material]);
        if textures {
            let at = texture_rows + index * TEXTURE_SLOTS * size_of::<gpu::TextureReference>();
            gpu.write(&self.buffer, at as u64, &references);
        }
    }

    /// Writes the parameters of media whose grids are those in the buffer.
    pub fn write_media(&self, gpu: &Gpu, media: &[Medium], bounds: &Bounds) {
        let [.., start] = self.starts();
        let words = medium_words(media, bounds);
        gpu.write(&self.buffer, start as u64, words.as_flattened());
    }
}

/// Ranges in increasing order, those joined that follow each other without a gap.
pub(super) fn joined(ranges: impl IntoIterator<Item = Range<usize>>) -> Vec<Range<usize>> {
    let mut joined: Vec<Range<usize>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => joined.push(range),
        }
    }
    joined
}
