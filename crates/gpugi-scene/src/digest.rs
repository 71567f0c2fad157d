//! One hash that identifies a picture's inputs: it covers everything in a scene that can change what a camera sees.
//! Names, cameras, warnings, animation data (what would move at another time), transfer vectors
//! and panes (which follow from the rest) are excluded.
//!
//! Structs are destructured field by field, so adding a field breaks the build until somebody decides whether the hash
//! includes it.

use std::sync::Arc;

use blake3::Hasher;
use bytemuck::NoUninit;
use glam::{Affine2, DVec3, Mat4};

use crate::{
    AlphaMode, Camera, DensityGrid, Environment, Image, Instance, Light, LightKind, Material,
    MaterialModel, Medium, Mesh, PhaseFunction, Pixels, Projection, Scene, Texture, TextureRef,
    Volume, Wrap,
};

impl Scene {
    /// BLAKE3 of the origin, meshes, instances, materials, textures, images, lights, environment and media. Scenes that hold the same
    /// values, and hence look the same from everywhere, have equal digests on all machines with the same byte order.
    pub fn digest(&self) -> [u8; 32] {
        let Self {
            name: _,
            origin,
            meshes,
            instances,
            materials,
            textures,
            images,
            lights,
            cameras: _,
            environment,
            media,
            rig: _,
            transfer: _,
            panes: _,
            warnings: _,
        } = self;
        let mut hasher = Hasher::new();
        origin.feed(&mut hasher);
        meshes.feed(&mut hasher);
        instances.feed(&mut hasher);
        materials.feed(&mut hasher);
        textures.feed(&mut hasher);
        images.feed(&mut hasher);
        lights.feed(&mut hasher);
        environment.feed(&mut hasher);
        media.feed(&mut hasher);
        *hasher.finalize().as_bytes()
    }

    /// BLAKE3 of materials, textures and images, and of which instance has which material.
    pub fn material_digest(&self) -> [u8; 32] {
        let mut hasher = Hasher::new();
        self.materials.feed(&mut hasher);
        self.textures.feed(&mut hasher);
        self.images.feed(&mut hasher);
        for instance in &self.instances {
            instance.material.feed(&mut hasher);
        }
        *hasher.finalize().as_bytes()
    }
}

impl Camera {
    /// BLAKE3 of the camera's placement, projection, lens and shutter.
    pub fn digest(&self) -> [u8; 32] {
        let Self {
            name: _,
            world_from_view,
            projection,
            lens,
            shutter,
            node: _,
        } = self;
        let mut hasher = Hasher::new();
        world_from_view.feed(&mut hasher);
        match projection {
            Projection::Perspective { vertical_fov } => plain(&mut hasher, &[0.0, *vertical_fov]),
            Projection::Orthographic { height } => plain(&mut hasher, &[1.0, *height]),
        }
        if !lens.is_pinhole() {
            plain(
                &mut hasher,
                &[2.0, lens.aperture, lens.focus, lens.blades as f32],
            );
        }
        if *shutter > 0.0 {
            plain(&mut hasher, &[3.0, *shutter]);
        }
        *hasher.finalize().as_bytes()
    }
}

/// Feeds its values to a hasher in an unambiguous encoding: anything of variable length or with several variants also
/// writes its length or variant.
trait Feed {
    fn feed(&self, hasher: &mut Hasher);
}

/// Feeds the raw bytes of the values.
fn plain<T: NoUninit>(hasher: &mut Hasher, values: &[T]) {
    hasher.update(bytemuck::cast_slice(values));
}

/// Feeds the number of values, then their raw bytes.
fn list<T: NoUninit>(hasher: &mut Hasher, values: &[T]) {
    values.len().feed(hasher);
    plain(hasher, values);
}

impl Feed for usize {
    fn feed(&self, hasher: &mut Hasher) {
        plain(hasher, &[*self as u64]);
    }
}

impl Feed for f32 {
    fn feed(&self, hasher: &mut Hasher) {
        plain(hasher, &[*self]);
    }
}

impl Feed for bool {
    fn feed(&self, hasher: &mut Hasher) {
        plain(hasher, &[u8::from(*self)]);
    }
}

impl Feed for Mat4 {
    fn feed(&self, hasher: &mut Hasher) {
        plain(hasher, &self.to_cols_array());
    }
}

impl Feed for DVec3 {
    fn feed(&self, hasher: &mut Hasher) {
        plain(hasher, &self.to_array());
    }
}

impl Feed for Affine2 {
    fn feed(&self, hasher: &mut Hasher) {
        plain(hasher, &self.to_cols_array());
    }
}

impl<T: Feed> Feed for Option<T> {
    fn feed(&self, hasher: &mut Hasher) {
        self.is_some().feed(hasher);
        if let Some(value) = self {
            value.feed(hasher);
        }
    }
}

impl<T: Feed> Feed for Arc<T> {
    fn feed(&self, hasher: &mut Hasher) {
        T::feed(self, hasher);
    }
}

impl<T: Feed> Feed for Vec<T> {
    fn feed(&self, hasher: &mut Hasher) {
        self.len().feed(hasher);
        for value in self {
            value.feed(hasher);
        }
    }
}

impl Feed for Mesh {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            name: _,
            origin: _,
            positions,
            normals,
            tangents,
            uvs,
            colors,
            indices,
            tree: _,
        } = self;
        list(hasher, positions);
        list(hasher, normals);
        list(hasher, tangents);
        list(hasher, &uvs[0]);
        list(hasher, &uvs[1]);
        list(hasher, colors);
        list(hasher, indices);
    }
}

impl Feed for Instance {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            name: _,
            mesh,
            material,
            world_from_mesh,
            is_sphere,
            node: _,
            origin: _,
        } = self;
        mesh.feed(hasher);
        material.feed(hasher);
        world_from_mesh.feed(hasher);
        is_sphere.feed(hasher);
    }
}

impl Feed for Material {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            name: _,
            model,
            base_color,
            base_color_texture,
            metallic,
            roughness,
            metallic_roughness_texture,
            normal_texture,
            normal_scale,
            emissive,
            emissive_texture,
            ior,
            specular,
            specular_texture,
            specular_color,
            specular_color_texture,
            transmission,
            transmission_texture,
            diffuse_transmission,
            diffuse_transmission_texture,
            diffuse_transmission_color,
            diffuse_transmission_color_texture,
            volume,
            alpha_mode,
            double_sided,
        } = self;
        match model {
            MaterialModel::MetallicRoughness => plain(hasher, &[0_u8]),
            MaterialModel::Phong { kd, ks, shininess } => {
                plain(hasher, &[1_u8]);
                plain(hasher, &[*kd, *ks]);
                shininess.feed(hasher);
            }
            MaterialModel::Blinn { kd, ks, shininess } => {
                plain(hasher, &[3_u8]);
                plain(hasher, &[*kd, *ks]);
                shininess.feed(hasher);
            }
            MaterialModel::Conductor { n, k } => {
                plain(hasher, &[2_u8]);
                plain(hasher, &[*n, *k]);
            }
        }
        plain(hasher, &[*base_color]);
        plain(
            hasher,
            &[*emissive, *specular_color, *diffuse_transmission_color],
        );
        for factor in [
            metallic,
            roughness,
            normal_scale,
            ior,
            specular,
            transmission,
            diffuse_transmission,
        ] {
            factor.feed(hasher);
        }
        for texture in [
            base_color_texture,
            metallic_roughness_texture,
            normal_texture,
            emissive_texture,
            specular_texture,
            specular_color_texture,
            transmission_texture,
            diffuse_transmission_texture,
            diffuse_transmission_color_texture,
        ] {
            texture.feed(hasher);
        }
        volume.feed(hasher);
        let (mode, cutoff) = match alpha_mode {
            AlphaMode::Opaque => (0_u8, 0.0),
            AlphaMode::Mask { cutoff } => (1, *cutoff),
            AlphaMode::Blend => (2, 0.0),
        };
        plain(hasher, &[mode]);
        cutoff.feed(hasher);
        double_sided.feed(hasher);
    }
}

impl Feed for Volume {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            attenuation_distance,
            attenuation_color,
        } = self;
        attenuation_distance.feed(hasher);
        plain(hasher, &[*attenuation_color]);
    }
}

impl Feed for TextureRef {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            texture,
            uv_set,
            uv_from_mesh,
        } = self;
        texture.feed(hasher);
        plain(hasher, &[*uv_set]);
        uv_from_mesh.feed(hasher);
    }
}

impl Feed for Texture {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            image,
            wrap,
            nearest,
            has_levels,
        } = self;
        image.feed(hasher);
        for wrap in wrap {
            let mode = match wrap {
                Wrap::Repeat => 0_u8,
                Wrap::MirroredRepeat => 1,
                Wrap::ClampToEdge => 2,
            };
            plain(hasher, &[mode]);
        }
        nearest.feed(hasher);
        has_levels.feed(hasher);
    }
}

impl Feed for Image {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            name: _,
            width,
            height,
            pixels,
        } = self;
        plain(hasher, &[*width, *height]);
        match pixels {
            Pixels::Rgba8(values) => {
                plain(hasher, &[0_u8]);
                list(hasher, values);
            }
            Pixels::Rgba32Float(values) => {
                plain(hasher, &[1_u8]);
                list(hasher, values);
            }
        }
    }
}

impl Feed for Light {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            name: _,
            kind,
            intensity,
            range,
            radius,
            world_from_light,
            node: _,
        } = self;
        let (shape, angles) = match kind {
            LightKind::Point => (0_u8, [0.0; 2]),
            LightKind::Spot {
                inner_cone_angle,
                outer_cone_angle,
            } => (1, [*inner_cone_angle, *outer_cone_angle]),
            LightKind::Directional => (2, [0.0; 2]),
        };
        plain(hasher, &[shape]);
        plain(hasher, &angles);
        plain(hasher, &[*intensity]);
        range.feed(hasher);
        radius.feed(hasher);
        world_from_light.feed(hasher);
    }
}

impl Feed for Medium {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            name: _,
            world_from_box,
            extinction,
            albedo,
            phase,
            emission,
            density,
            node: _,
        } = self;
        world_from_box.feed(hasher);
        let (kind, g) = match phase {
            PhaseFunction::HenyeyGreenstein(g) => (0.0, *g),
            PhaseFunction::CornetteShanks(g) => (1.0, *g),
        };
        plain(
            hasher,
            &[*extinction, *albedo, *emission].map(|v| v.to_array()),
        );
        plain(hasher, &[kind, g]);
        density.feed(hasher);
    }
}

impl Feed for DensityGrid {
    fn feed(&self, hasher: &mut Hasher) {
        let Self { size, values } = self;
        plain(hasher, size);
        list(hasher, values);
    }
}

impl Feed for Environment {
    fn feed(&self, hasher: &mut Hasher) {
        let Self {
            image,
            rotation,
            intensity,
        } = self;
        image.feed(hasher);
        // Nearly all are turned about +Y: such a turn feeds its angle alone.
        match rotation.x == 0.0 && rotation.z == 0.0 {
            true => (2.0 * rotation.y.atan2(rotation.w)).feed(hasher),
            false => plain(hasher, &rotation.to_array()),
        }
        intensity.feed(hasher);
    }
}
