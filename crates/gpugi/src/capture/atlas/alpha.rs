//! Alpha of the texels of an atlas, for files that hold light in place of base colours.

use gpugi_scene::{AlphaMode, Atlas, Instance, InstanceUvs, Scene};

use super::{AtlasCapture, AtlasCaptureOptions, Dilation, HALO, tiles};
use crate::capture::Target;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, read_buffer};
use crate::scene::GpuScene;
use crate::shader;

/// Texels that are on the GPU at one time: a page of 2,048 texels per side.
const TEXELS_AT_ONCE: u32 = 1 << 22;

/// Alpha (0 to 1) of the texels of an atlas, as the materials give it, without cutoffs: all pages one after the other,
/// row by row. Empty texels are filled from their neighbours. `None` if everything in the atlas is opaque. Pass
/// `capture.atlas.alpha`.
///
/// # Errors
/// As [`AtlasCapture::new`].
pub fn alpha(gpu: &Gpu, scene: &Scene, atlas: &Atlas) -> Result<Option<Vec<f32>>, GpuError> {
    let has_alpha = |(instance, uvs): (&Instance, &Option<InstanceUvs>)| {
        let mode = scene.materials[instance.material].alpha_mode;
        uvs.is_some() && mode != AlphaMode::Opaque
    };
    if !scene.instances.iter().zip(&atlas.instances).any(has_alpha) {
        return Ok(None);
    }
    let mut on_gpu = GpuScene::new(gpu, scene)?;
    let shader = shader!("capture.atlas.alpha");
    let kernel = Kernel::new(gpu, &shader, "main", Some(&on_gpu.layout))?;
    let mut image = Vec::new();
    for tile in tiles(gpu, atlas, TEXELS_AT_ONCE, HALO)? {
        let options = AtlasCaptureOptions {
            rows: Some(tile.captured.clone()),
            ..AtlasCaptureOptions::default()
        };
        let mut capture = AtlasCapture::new(gpu, scene, &on_gpu, atlas, &options)?;
        let mut frame = Frame::new(gpu, false);
        on_gpu.merge(&mut frame);
        capture.record(&mut frame, &on_gpu)?;
        frame.submit()?;
        let mut captured = Vec::new();
        for piece in capture.pieces() {
            let target = Target::new(gpu, piece.points.count)?;
            let resources = [
                ("piece", piece.uniform.as_entire_binding()),
                ("triangles", capture.triangles.as_entire_binding()),
                ("texels", piece.texels.as_entire_binding()),
                ("image", target.radiance.as_entire_binding()),
            ];
            let group = kernel.bind(gpu, 1, &resources)?;
            let rows = piece.rows.end - piece.rows.start;
            let dilation = Dilation::new(gpu, [capture.size, rows])?;
            let mut frame = Frame::new(gpu, false);
            frame.compute("capture.atlas.alpha", |pass| {
                let groups = [(0, &on_gpu.bind_group), (1, &group)];
                kernel.dispatch(pass, &groups, [piece.points.count, 1, 1]);
            });
            dilation.record(&mut frame, &target)?;
            frame.submit()?;
            let size = target.radiance.size();
            let texels: Vec<[f32; 4]> = read_buffer(gpu, &target.radiance, size)?;
            captured.extend(texels.into_iter().map(|[alpha, ..]| alpha));
        }
        image.extend_from_slice(tile.of(&captured, atlas.size));
    }
    Ok(Some(image))
}
