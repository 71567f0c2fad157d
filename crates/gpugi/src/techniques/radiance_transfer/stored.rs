//! Transfer vectors that leave the program in files, and come back (docs/relight.md).

use std::sync::Arc;

use glam::Vec3;
use gpugi_scene::atlas::Seams;
use gpugi_scene::{Atlas, Scene, TransferVectors};
use half::f16;

use super::{At, Basis, INFO, Settings, transfer};
use crate::capture::Target;
use crate::capture::atlas::Dilation;
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};

/// Words of a coefficient: `vec2u` of coefficients.wesl.
const WORDS: usize = 2;

/// Finished vectors as progress that [`super::transfer::Transfer::resume`] continues from.
pub(super) fn as_saved(vectors: &TransferVectors) -> transfer::Saved {
    let (functions, page) = (vectors.functions(), vectors.texels_per_page());
    let texels = page * vectors.atlas.pages as usize;
    let mut words = vec![0; texels * functions * WORDS];
    for (number, layer) in vectors.coefficients.chunks(page.max(1)).enumerate() {
        let (first, function) = (number / functions * page, number % functions);
        for (texel, rgbp) in layer.iter().enumerate() {
            let at = ((first + texel) * functions + function) * WORDS;
            // Texels between charts are filled: done again, that would undo how seams were closed.
            let filled = [rgbp[0], rgbp[1], rgbp[2], f16::ONE];
            words[at..at + WORDS].copy_from_slice(bytemuck::cast_slice(&filled));
        }
    }
    // Buffers are multiples of 16 bytes.
    let whole = |mut words: Vec<u32>| {
        words.resize(words.len().next_multiple_of(4), 0);
        words
    };
    transfer::Saved {
        bounces: vectors.bounces,
        tiles: 0,
        vectors: whole(words),
        next: Vec::new(),
        albedos: whole(vec![0; 2 * texels]),
        matrices: Vec::new(),
    }
}

/// The vectors that were saved once all bounces were done, for files: texels without a point are
/// filled from those around them, and both sides of each seam are made to agree, so that any bilinear filter may read
/// them. The hash of the geometry is left to the file's writer. Waits for the GPU.
///
/// # Errors
/// [`GpuError`], also if `saved` is of other texels, unfinished, compressed or of wavelets.
pub(super) fn finished(
    gpu: &Gpu,
    scene: &Scene,
    atlas: Arc<Atlas>,
    settings: &Settings,
    saved: &transfer::Saved,
) -> Result<TransferVectors, GpuError> {
    let is_of_vertices = settings.at == At::Vertices;
    if settings.basis != Basis::Harmonics || settings.is_compressed() || is_of_vertices {
        return Err(INFO.unfit("files hold harmonics of texels that are not compressed"));
    }
    let functions = settings.terms() as usize;
    let page = (atlas.size as usize).pow(2);
    let texels = page * atlas.pages as usize;
    if saved.bounces != settings.bounces || saved.vectors.len() < texels * functions * WORDS {
        return Err(INFO.unfit("other texels, or fewer bounces"));
    }
    let packed: &[[f16; 4]] = bytemuck::cast_slice(&saved.vectors);
    let seams = Seams::new(scene, &atlas);
    let image = Target::new(gpu, texels as u32)?;
    let dilation = Dilation::new(gpu, [atlas.size, atlas.size * atlas.pages])?;
    let mut coefficients = vec![[f16::ZERO; 4]; texels * functions];
    for function in 0..functions {
        let of_function = packed[function..].iter().step_by(functions).take(texels);
        let values: Vec<[f32; 4]> = of_function
            .clone()
            .map(|texel| texel.map(f16::to_f32))
            .collect();
        gpu.write(&image.radiance, 0, &values);
        let mut frame = Frame::new(gpu, false);
        dilation.record(&mut frame, &image)?;
        frame.submit()?;
        let filled: Vec<[f32; 4]> = read_buffer(gpu, &image.radiance, texels as u64 * 16)?;
        let mut filled: Vec<Vec3> = filled
            .into_iter()
            .map(|[r, g, b, _]| Vec3::new(r, g, b))
            .collect();
        seams.smooth(&mut filled);
        for (texel, (rgb, before)) in filled.iter().zip(of_function).enumerate() {
            let layer = texel / page * functions + function;
            let [red, green, blue] = rgb.to_array().map(f16::from_f32);
            coefficients[layer * page + texel % page] = [red, green, blue, before[3]];
        }
    }
    Ok(TransferVectors {
        order: settings.order,
        bounces: settings.bounces,
        atlas,
        coefficients,
        geometry: [0; 32],
    })
}
