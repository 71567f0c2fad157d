//! Edits: values of a scene that are replaced by others.

use std::sync::Arc;

use glam::Mat4;

use crate::{Camera, Environment, Light, Material, Medium, Mesh, Scene};

/// One edit of a scene: replaces a value that the scene already has.
#[derive(Debug, Clone, PartialEq)]
pub enum Edit {
    /// Moves an instance.
    Instance {
        /// Index into [`Scene::instances`].
        index: usize,
        /// World space (m) from mesh space; affine, may mirror.
        world_from_mesh: Mat4,
    },
    /// Replaces a material.
    Material {
        /// Index into [`Scene::materials`].
        index: usize,
        /// The new material.
        material: Box<Material>,
    },
    /// Replaces a mesh.
    Mesh {
        /// Index into [`Scene::meshes`].
        index: usize,
        /// The new mesh.
        mesh: Arc<Mesh>,
    },
    /// Replaces a punctual light.
    Light {
        /// Index into [`Scene::lights`].
        index: usize,
        /// The new light.
        light: Light,
    },
    /// Replaces all punctual lights; their number may be another one.
    Lights(Vec<Light>),
    /// Replaces the environment, or its rotation or intensity.
    Environment(Environment),
    /// Replaces all media; their number may be another one.
    Media(Vec<Medium>),
    /// Replaces a camera. Pictures are made for cameras of their own: they stay as they are.
    Camera {
        /// Index into [`Scene::cameras`].
        index: usize,
        /// The new camera.
        camera: Camera,
    },
}

impl Edit {
    /// Makes the edit in a scene, which must have its index.
    pub fn apply_to(&self, scene: &mut Scene) {
        match self.clone() {
            Self::Instance {
                index,
                world_from_mesh,
            } => scene.instances[index].world_from_mesh = world_from_mesh,
            Self::Material { index, material } => scene.materials[index] = *material,
            Self::Mesh { index, mesh } => scene.meshes[index] = mesh,
            Self::Light { index, light } => scene.lights[index] = light,
            Self::Lights(lights) => scene.lights = lights,
            Self::Environment(environment) => scene.environment = Some(environment),
            Self::Media(media) => scene.media = media,
            Self::Camera { index, camera } => scene.cameras[index] = camera,
        }
    }
}
