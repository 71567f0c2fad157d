//! Material images as eight texture arrays: four size classes for sRGB images, four for linear ones.

use gpugi_scene::{Image, Pixels, Scene};

use super::rows::texture_slots;
use crate::gpu::{Blit, Gpu, GpuError};

/// Size classes for each colour space.
const CLASSES: usize = 4;

/// Where an image is stored: class 0-3 sRGB, 4-7 linear, and its layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImagePlace {
    pub class: u32,
    pub layer: u32,
}

/// Texture arrays, and the place of every image in them.
#[derive(Debug, Clone)]
pub struct ImageArrays {
    /// Views of the eight arrays in binding order.
    pub views: Vec<wgpu::TextureView>,
    /// Per image: its places in the sRGB and in the linear arrays, where it is used as such.
    pub places: Vec<[Option<ImagePlace>; 2]>,
    /// Bytes on the GPU.
    pub bytes: u64,
}

impl ImageArrays {
    /// Uploads every image that a material uses, scaled up to the power-of-two square of its class, with mip levels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when a class has more images than a texture has layers; [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let mut places = vec![[None; 2]; scene.images.len()];
        let mut views = Vec::new();
        let mut bytes = 0;
        for (space, format) in [
            wgpu::TextureFormat::Rgba8UnormSrgb,
            wgpu::TextureFormat::Rgba8Unorm,
        ]
        .into_iter()
        .enumerate()
        {
            let used = images_used(scene, space);
            let sizes = class_sizes(gpu, scene, &used);
            for (class, &size) in sizes.iter().enumerate() {
                let members: Vec<usize> = used
                    .iter()
                    .copied()
                    .filter(|&image| class_of(&sizes, &scene.images[image]) == class)
                    .collect();
                for (layer, &image) in members.iter().enumerate() {
                    places[image][space] = Some(ImagePlace {
                        class: (space * CLASSES + class) as u32,
                        layer: layer as u32,
                    });
                }
                let images: Vec<&Image> =
                    members.iter().map(|&image| &*scene.images[image]).collect();
                bytes += u64::from(size) * u64::from(size) * 16 / 3 * images.len() as u64;
                views.push(upload(gpu, &images, size, format)?);
            }
        }
        Ok(Self {
            views,
            places,
            bytes,
        })
    }
}

/// Images that materials read as colour (space 0) or as data (space 1).
pub(super) fn images_used(scene: &Scene, space: usize) -> Vec<usize> {
    let slots = scene.materials.iter().flat_map(texture_slots);
    let in_space = slots.filter(|(_, of_slot)| *of_slot == space);
    let references = in_space.filter_map(|(texture, _)| texture.as_ref());
    let images = references.map(|reference| scene.textures[reference.texture].image);
    let mut used: Vec<usize> = images.collect();
    used.sort_unstable();
    used.dedup();
    used
}

fn side(image: &Image) -> u32 {
    image.width.max(image.height).next_power_of_two()
}

/// The largest sizes that occur, at most four; smaller images are scaled up to the smallest of these.
fn class_sizes(gpu: &Gpu, scene: &Scene, used: &[usize]) -> [u32; CLASSES] {
    let limit = gpu.limits().max_texture_dimension_2d;
    let mut sizes: Vec<u32> = used
        .iter()
        .map(|&image| side(&scene.images[image]).min(limit))
        .collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    sizes.dedup();
    std::array::from_fn(|class| sizes.get(class).copied().unwrap_or(1))
}

/// The smallest class that holds an image at full size.
fn class_of(sizes: &[u32; CLASSES], image: &Image) -> usize {
    (0..CLASSES)
        .rev()
        .find(|&class| sizes[class] >= side(image))
        .unwrap_or(0)
}

fn upload(
    gpu: &Gpu,
    images: &[&Image],
    size: u32,
    format: wgpu::TextureFormat,
) -> Result<wgpu::TextureView, GpuError> {
    let levels = size.ilog2() + 1;
    let sides = [size, size, images.len().max(1) as u32];
    let usage = wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::COPY_DST
        | wgpu::TextureUsages::RENDER_ATTACHMENT;
    let texture = gpu.texture_with_levels("material images", sides, levels, format, usage)?;
    let level_view = |layer: u32, level: u32| {
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            base_mip_level: level,
            mip_level_count: Some(1),
            ..Default::default()
        })
    };
    let blit = Blit::new(gpu, format)?;
    for (layer, image) in images.iter().enumerate() {
        let layer = layer as u32;
        write_image(
            gpu,
            &texture,
            image,
            size,
            layer,
            &blit,
            &level_view(layer, 0),
        )?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        for level in 1..levels {
            blit.copy(
                gpu,
                &mut encoder,
                &level_view(layer, level - 1),
                &level_view(layer, level),
            )?;
        }
        gpu.submit(encoder.finish());
    }
    Ok(texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    }))
}

/// Writes an image to the finest level, through a scaling blit unless the sizes match.
fn write_image(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    image: &Image,
    size: u32,
    layer: u32,
    blit: &Blit,
    target: &wgpu::TextureView,
) -> Result<(), GpuError> {
    let Pixels::Rgba8(texels) = &image.pixels else {
        // Importers reject float images for materials.
        return Ok(());
    };
    let write = |texture: &wgpu::Texture, layer: u32| {
        let copy = wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d {
                z: layer,
                ..Default::default()
            },
            aspect: wgpu::TextureAspect::All,
        };
        let size = wgpu::Extent3d {
            width: image.width,
            height: image.height,
            depth_or_array_layers: 1,
        };
        gpu.write_texture(copy, texels, image.width * 4, size);
    };
    if image.width == size && image.height == size {
        write(texture, layer);
        return Ok(());
    }
    let sides = [image.width, image.height, 1];
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let original = gpu.texture_2d("image before scaling", sides, texture.format(), usage)?;
    write(&original, 0);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    blit.copy(
        gpu,
        &mut encoder,
        &original.create_view(&Default::default()),
        target,
    )?;
    gpu.submit(encoder.finish());
    Ok(())
}
