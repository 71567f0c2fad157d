//! The scene: everything that a technique may light.

use std::sync::Arc;

use glam::{DMat4, DVec3, Mat4, Vec3};
use serde::{Deserialize, Serialize};

use crate::animation::Rig;
use crate::names::{Name, UnknownObject, check_names, is_named_by};
use crate::{
    AlphaMode, Bounds, Camera, Environment, Image, Light, LightKind, LightPathPanes, Material,
    Medium, Mesh, Texture, TransferVectors,
};

/// A placed mesh. Several instances may share a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Instance {
    /// Name for reports.
    pub name: Name,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// World space (m) from mesh space; affine, possibly mirrored.
    pub world_from_mesh: Mat4,
    /// Whether rays meet the sphere of which the mesh is a tessellation ([`Mesh::sphere`]), and not its triangles.
    pub is_sphere: bool,
    /// The animation node that carries the instance, if any.
    pub node: Option<usize>,
    /// Where the instance comes from in its glTF file, if it comes from one.
    pub origin: Option<Origin>,
}

/// The place of an instance in its glTF file. Corner c of triangle t of the instance's mesh is corner c of triangle t
/// of that primitive, once strips and fans are converted to triangle lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Origin {
    /// Index into the file's nodes.
    pub node: usize,
    /// Index of the copy, for a node that is instanced many times (EXT_mesh_gpu_instancing).
    pub place: Option<usize>,
    /// Index into the primitives of that node's mesh.
    pub primitive: usize,
}

/// All scene contents, in world space. A file's coordinates are those of world space plus [`Scene::origin`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scene {
    /// File or built-in name.
    pub name: String,
    /// Where the origin of world space lies in the file's coordinates (m), in whole metres. Zero, unless the scene lies
    /// far from the file's own origin (ARCHITECTURE.md, "Far from the origin").
    pub origin: DVec3,
    /// Triangle meshes, each in its own mesh space. Copies of the scene share them; to edit a mesh, replace it.
    pub meshes: Vec<Arc<Mesh>>,
    /// Placed meshes.
    pub instances: Vec<Instance>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Images with their sampling modes.
    pub textures: Vec<Texture>,
    /// Decoded images, shared like meshes.
    pub images: Vec<Arc<Image>>,
    /// Punctual lights.
    pub lights: Vec<Light>,
    /// Cameras, the default one first.
    pub cameras: Vec<Camera>,
    /// Light from infinitely far away.
    pub environment: Option<Environment>,
    /// Fog, smoke and clouds.
    pub media: Vec<Medium>,
    /// Animation data: see [`Scene::pose`].
    pub rig: Option<Rig>,
    /// Transfer vectors that the file holds: those of the scene as it was imported.
    pub transfer: Option<Arc<TransferVectors>>,
    /// Panes of light path maps that the file holds: those of the scene as it was imported.
    pub panes: Option<Arc<LightPathPanes>>,
    /// Features that the file asked for and the importer could not provide.
    pub warnings: Vec<String>,
}

/// Scene statistics, for `gpugi info`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Statistics {
    /// Distinct meshes.
    pub meshes: usize,
    /// Placed meshes.
    pub instances: usize,
    /// Triangles after instancing.
    pub triangles: u64,
    /// Materials.
    pub materials: usize,
    /// Materials whose alpha mode is mask or blend.
    pub alpha_materials: usize,
    /// Images.
    pub images: usize,
    /// Point lights.
    pub point_lights: usize,
    /// Spot lights.
    pub spot_lights: usize,
    /// Directional lights.
    pub directional_lights: usize,
    /// Emissive triangles after instancing.
    pub emissive_triangles: u64,
    /// Media.
    pub media: usize,
    /// Cameras.
    pub cameras: usize,
    /// Whether there is an environment.
    pub environment: bool,
    /// Whether the scene has a rig.
    pub animated: bool,
    /// Bytes of meshes in memory.
    pub mesh_bytes: u64,
    /// Bytes of images in memory.
    pub image_bytes: u64,
    /// Smallest corner of the scene in the file's coordinates (m).
    pub bounds_min: [f64; 3],
    /// Largest corner of the scene in the file's coordinates (m).
    pub bounds_max: [f64; 3],
    /// [`Scene::origin`].
    pub origin: [f64; 3],
}

impl Scene {
    /// An empty scene.
    pub fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            ..Self::default()
        }
    }

    /// The place in the file's coordinates (m) of a point in world space. It has no more decimals than the point, so
    /// that texts show the number that was meant.
    pub fn in_file(&self, point: Vec3) -> DVec3 {
        let shortest = |value: f32| value.to_string().parse().unwrap_or(f64::from(value));
        DVec3::from_array(point.to_array().map(shortest)) + self.origin
    }

    /// The place in world space of a point in the file's coordinates (m).
    pub fn in_world(&self, point: DVec3) -> Vec3 {
        (point - self.origin).as_vec3()
    }

    /// The file's coordinates from a space that `world_from_space` places in world space.
    pub fn file_from(&self, world_from_space: Mat4) -> DMat4 {
        DMat4::from_translation(self.origin) * world_from_space.as_dmat4()
    }

    /// Adds a mesh; returns its index.
    pub fn add_mesh(&mut self, mesh: impl Into<Arc<Mesh>>) -> usize {
        self.meshes.push(mesh.into());
        self.meshes.len() - 1
    }

    /// Builds the trees of meshes that have none ([`Mesh::tree`]), so that uploads for rays take less time.
    pub fn build_trees(&mut self) {
        for mesh in &mut self.meshes {
            if mesh.tree.is_none() {
                Arc::make_mut(mesh).build_tree();
            }
        }
    }

    /// Adds a material; returns its index.
    pub fn add_material(&mut self, material: Material) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Places a mesh; returns the instance's index.
    pub fn add_instance(
        &mut self,
        name: &str,
        mesh: usize,
        material: usize,
        world_from_mesh: Mat4,
    ) -> usize {
        self.instances.push(Instance {
            name: name.into(),
            mesh,
            material,
            world_from_mesh,
            is_sphere: false,
            node: None,
            origin: None,
        });
        self.instances.len() - 1
    }

    /// Removes the instances, lights and media that `list` names ([`is_named_by`]). Meshes and materials stay.
    ///
    /// # Errors
    /// [`UnknownObject`] if a name in the list matches no object; the scene is then unchanged.
    pub fn remove(&mut self, list: &str) -> Result<(), UnknownObject> {
        let instances = self.instances.iter().map(|instance| instance.name.as_str());
        let lights = self.lights.iter().map(|light| light.name.as_str());
        let media = self.media.iter().map(|medium| medium.name.as_str());
        check_names(list, instances.chain(lights).chain(media))?;
        self.media.retain(|medium| !is_named_by(&medium.name, list));
        self.lights.retain(|light| !is_named_by(&light.name, list));
        let mut kept = 0;
        let new_index: Vec<Option<usize>> = (self.instances.iter())
            .map(|instance| {
                let stays = !is_named_by(&instance.name, list);
                kept += usize::from(stays);
                stays.then(|| kept - 1)
            })
            .collect();
        self.instances
            .retain(|instance| !is_named_by(&instance.name, list));
        if let Some(rig) = &mut self.rig {
            rig.deformers
                .retain_mut(|deformer| match new_index[deformer.instance] {
                    Some(index) => {
                        deformer.instance = index;
                        true
                    }
                    None => false,
                });
        }
        Ok(())
    }

    /// Bounding box of all instances and of the boxes of media.
    pub fn bounds(&self) -> Bounds {
        let mesh_bounds: Vec<Bounds> = self.meshes.iter().map(|mesh| mesh.bounds()).collect();
        let instances = self
            .instances
            .iter()
            .map(|instance| mesh_bounds[instance.mesh].transformed(&instance.world_from_mesh));
        let media = self.media.iter().filter_map(Medium::bounds);
        instances
            .chain(media)
            .fold(Bounds::EMPTY, |all, bounds| all.union(bounds))
    }

    /// Whether anything in the scene emits light.
    pub fn has_light(&self) -> bool {
        !self.lights.is_empty()
            || self.environment.is_some()
            || self
                .instances
                .iter()
                .any(|instance| self.materials[instance.material].emissive != Vec3::ZERO)
            || self
                .media
                .iter()
                .any(|medium| medium.emission != Vec3::ZERO)
    }

    /// Counts and sizes of the scene's contents.
    pub fn statistics(&self) -> Statistics {
        let triangles = |instance: &Instance| self.meshes[instance.mesh].indices.len() as u64 / 3;
        let count = |test: fn(&LightKind) -> bool| {
            self.lights.iter().filter(|light| test(&light.kind)).count()
        };
        let bounds = self.bounds();
        let (bounds_min, bounds_max) = if bounds.is_empty() {
            ([0.0; 3], [0.0; 3])
        } else {
            [bounds.min, bounds.max]
                .map(|corner| self.in_file(corner).to_array())
                .into()
        };
        Statistics {
            meshes: self.meshes.len(),
            instances: self.instances.len(),
            triangles: self.instances.iter().map(triangles).sum(),
            materials: self.materials.len(),
            alpha_materials: self
                .materials
                .iter()
                .filter(|material| material.alpha_mode != AlphaMode::Opaque)
                .count(),
            images: self.images.len(),
            point_lights: count(|kind| matches!(kind, LightKind::Point)),
            spot_lights: count(|kind| matches!(kind, LightKind::Spot { .. })),
            directional_lights: count(|kind| matches!(kind, LightKind::Directional)),
            emissive_triangles: self
                .instances
                .iter()
                .filter(|instance| self.materials[instance.material].emissive != Vec3::ZERO)
                .map(triangles)
                .sum(),
            media: self.media.len(),
            cameras: self.cameras.len(),
            environment: self.environment.is_some(),
            animated: self.rig.is_some(),
            mesh_bytes: self.meshes.iter().map(|mesh| mesh.byte_size() as u64).sum(),
            image_bytes: self
                .images
                .iter()
                .map(|image| image.byte_size() as u64)
                .sum(),
            bounds_min,
            bounds_max,
            origin: self.origin.to_array(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PhaseFunction;
    use crate::animation::Deformer;
    use crate::light::LightKind;

    #[test]
    fn what_is_removed_takes_what_bends_it_along() {
        let mut scene = Scene::new("three");
        let mut rig = Rig::default();
        for (index, name) in ["first", "second", "third"].into_iter().enumerate() {
            let mesh = scene.add_mesh(Mesh::default());
            let material = scene.add_material(Material::default());
            scene.add_instance(name, mesh, material, Mat4::IDENTITY);
            rig.deformers.push(Deformer {
                instance: index,
                node: 10 + index,
                positions: Vec::new(),
                normals: Vec::new(),
                tangents: Vec::new(),
                flat: false,
                targets: Vec::new(),
                skin: None,
            });
        }
        scene.rig = Some(rig);
        for name in ["lamp", "second lamp"] {
            let light = Light::new(name, LightKind::Point, Vec3::ONE);
            scene.lights.push(light);
        }
        for name in ["fog", "second fog"] {
            scene.media.push(Medium {
                name: name.into(),
                world_from_box: None,
                extinction: Vec3::ONE,
                albedo: Vec3::ONE,
                phase: PhaseFunction::HenyeyGreenstein(0.0),
                emission: Vec3::ZERO,
                density: None,
                node: None,
            });
        }
        let before = scene.clone();
        assert!(scene.remove("second,fourth").is_err());
        assert_eq!(scene, before);
        scene.remove("").unwrap();
        assert_eq!(scene, before);
        scene.remove("sec*").unwrap();
        let names: Vec<_> = scene
            .instances
            .iter()
            .map(|instance| &instance.name)
            .collect();
        assert_eq!(names, ["first", "third"]);
        let lights: Vec<_> = scene.lights.iter().map(|light| &light.name).collect();
        assert_eq!(lights, ["lamp"]);
        let media: Vec<_> = scene.media.iter().map(|medium| &medium.name).collect();
        assert_eq!(media, ["fog"]);
        let deformers = &scene.rig.as_ref().unwrap().deformers;
        let bent: Vec<_> = deformers
            .iter()
            .map(|deformer| (deformer.instance, deformer.node))
            .collect();
        assert_eq!(bent, [(0, 10), (1, 12)]);
    }
}
