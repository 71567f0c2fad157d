//! Edits of a scene. Each costs what it changes: a few table rows, not an upload of the scene.

use std::sync::Arc;

use glam::Vec3;
use gpugi_scene::{
    AlphaMode, Edit, Environment, Instance, Material, Medium, Mesh, Scene, TextureRef, core_of,
};

use super::atlases::Atlases;
use super::emitters::{emitters, emitters_of};
use super::environment::{check_environment, environment_texels};
use super::extent::MOST_BOXES;
use super::media::{check_media, have_same_grids};
use super::motion::{moved, same_meshes};
use super::rays::Rays;
use super::rows::{is_mirrored, mesh_bounds, set_place, texture_slots};
use super::tables::Tables;
use super::upload::{are_same, is_same_image, is_see_through};
use super::{GpuScene, NOT_MERGED, Object, Versions};
use crate::gpu::{Gpu, GpuError};

/// What takes a change of a scene back: [`GpuScene::undo`].
#[derive(Debug)]
pub(crate) struct Undo(Before);

#[derive(Debug)]
enum Before {
    /// Edits that lead back, in this order, and what depends on what they exchange.
    Edits(Vec<Edit>, Versions, Atlases),
    /// The scene before an upload.
    Scene(Box<GpuScene>),
}

impl GpuScene {
    /// Applies edits in order and counts what changed. If one is refused, all are. A material has instances and tables
    /// uploaded again if its textures change, or if its alpha, transmission or sidedness change how triangles are
    /// drawn. Of a mesh, only vertices and its ray hierarchy are uploaded if the triangles and the number of vertices
    /// are the same, the mesh stays closed or open, and no instance of it is a sphere. Images and densities that are
    /// shared with those before are not uploaded.
    ///
    /// # Errors
    /// [`GpuError::Input`] for an index that the scene does not have and for values from which no light can be
    /// computed; otherwise as [`GpuScene::new`]. Nothing has changed then.
    pub fn edit(&mut self, gpu: &Gpu, edits: &[Edit]) -> Result<(), GpuError> {
        self.edit_with_undo(gpu, edits).map(|_| ())
    }

    /// As [`GpuScene::edit`]; returns what takes it back.
    ///
    /// # Errors
    /// As [`GpuScene::edit`].
    pub(crate) fn edit_with_undo(&mut self, gpu: &Gpu, edits: &[Edit]) -> Result<Undo, GpuError> {
        self.check_all(edits)?;
        if edits.iter().all(|edit| self.can_apply(edit)) {
            return self.apply(gpu, edits.to_vec());
        }
        let mut after = Scene {
            lights: self.lights.clone(),
            environment: self.environment.clone(),
            media: self.media.clone(),
            ..self.host.clone()
        };
        // Those of cameras are for others.
        let known = |edit: &&Edit| !matches!(edit, Edit::Camera { .. });
        for edit in edits.iter().filter(known) {
            edit.apply_to(&mut after);
        }
        self.replace(gpu, &after)
    }

    /// Updates the scene to `after` and counts what changed. Meshes and images count as unchanged if they are shared:
    /// to change one, replace it. Changes that [`Edit`]s can express cost what those edits cost. For others, instances
    /// and tables are uploaded again, and so are meshes, images and the environment's image that are not shared.
    ///
    /// # Errors
    /// As [`GpuScene::new`]. Nothing has changed then.
    pub fn update(&mut self, gpu: &Gpu, after: &Scene) -> Result<(), GpuError> {
        self.update_with_undo(gpu, after).map(|_| ())
    }

    /// As [`GpuScene::update`]; returns what takes it back.
    ///
    /// # Errors
    /// As [`GpuScene::update`].
    pub(crate) fn update_with_undo(&mut self, gpu: &Gpu, after: &Scene) -> Result<Undo, GpuError> {
        check_environment(after.environment.as_ref())?;
        check_media(&after.media)?;
        match self.edits_to(after) {
            Some(edits) if edits.iter().all(|edit| self.can_apply(edit)) => self.apply(gpu, edits),
            _ => self.replace(gpu, after),
        }
    }

    /// As [`GpuScene::edit`], if that writes only what has changed: no image, no table, and of meshes only those that
    /// deform. Otherwise nothing changes, and it returns false.
    ///
    /// # Errors
    /// As [`GpuScene::edit`].
    pub(crate) fn follow(&mut self, gpu: &Gpu, edits: Vec<Edit>) -> Result<bool, GpuError> {
        let uploads = |edit: &Edit| match edit {
            Edit::Environment(after) => !is_same_image(self.environment.as_ref(), Some(after)),
            Edit::Media(after) => !have_same_grids(&self.media, after),
            _ => false,
        };
        self.check_all(&edits)?;
        if edits
            .iter()
            .any(|edit| uploads(edit) || !self.can_apply(edit))
        {
            return Ok(false);
        }
        self.apply(gpu, edits).map(|_| true)
    }

    /// Moves instances and bends meshes as in `posed`, which is the same scene at another time, for the eye and for rays
    /// alone: maps stay current and show them where they were. Lights and media stay where they are. Before other changes, it
    /// has to be displaced back to what maps show: what is where it will be counts as unchanged.
    ///
    /// # Errors
    /// As [`GpuScene::edit`].
    pub(crate) fn displace(&mut self, gpu: &Gpu, posed: &Scene) -> Result<(), GpuError> {
        let (versions, atlases) = (self.versions, self.atlases.clone());
        let mut edits = self.edits_to(posed).unwrap_or_default();
        edits.retain(|edit| matches!(edit, Edit::Instance { .. } | Edit::Mesh { .. }));
        edits.retain(|edit| self.can_apply(edit));
        self.check_all(&edits)?;
        self.apply(gpu, edits)?;
        (self.versions, self.atlases) = (versions, atlases);
        self.forget_moves();
        self.merged_version = NOT_MERGED;
        Ok(())
    }

    /// Takes the last change back. What was made of the scene before it is current again.
    ///
    /// # Errors
    /// As [`GpuScene::new`].
    pub(crate) fn undo(&mut self, gpu: &Gpu, undo: Undo) -> Result<(), GpuError> {
        match undo.0 {
            Before::Scene(before) => {
                *self = *before;
                self.renew_top_level(gpu)
            }
            Before::Edits(mut edits, versions, atlases) => {
                let done = self.exchange(gpu, &mut edits);
                (self.versions, self.atlases) = (versions, atlases);
                self.forget_moves();
                done
            }
        }
    }

    /// Forgets what has moved since a version that is no longer.
    fn forget_moves(&mut self) {
        for placement in &mut self.placements {
            for since in [&mut placement.moved, &mut placement.bent] {
                *since = self.versions.geometry.min(*since);
            }
        }
    }

    /// Builds the top level of the ray hierarchy again: an upload of other instances has overwritten it.
    fn renew_top_level(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if let Some(rays) = &self.rays {
            let rays = rays.with_instances(gpu, &self.host)?;
            self.set_rays(gpu, rays);
            gpu.write(&self.header, 0, &[self.header_values]);
        }
        Ok(())
    }

    /// The edits that lead to `after`, whose values [`GpuScene::update`] checks; `None` if the number of things or the
    /// textures differ.
    pub(crate) fn edits_to(&self, after: &Scene) -> Option<Vec<Edit>> {
        let before = &self.host;
        let made_of = |instance: &Instance| (instance.mesh, instance.material, instance.is_sphere);
        let is_named_as =
            |(a, b): (&Instance, &Instance)| a.name == b.name && made_of(a) == made_of(b);
        let mut instances = before.instances.iter().zip(&after.instances);
        let has_same_things = before.instances.len() == after.instances.len()
            && before.meshes.len() == after.meshes.len()
            && before.materials.len() == after.materials.len()
            && self.environment.is_some() == after.environment.is_some()
            && before.textures == after.textures
            && are_same(&before.images, &after.images)
            && instances.all(is_named_as);
        if !has_same_things {
            return None;
        }
        let meshes = before.meshes.iter().zip(&after.meshes).enumerate();
        let meshes = meshes.filter(|(_, (a, b))| !Arc::ptr_eq(a, b));
        let meshes = meshes.map(|(index, (_, mesh))| Edit::Mesh {
            index,
            mesh: mesh.clone(),
        });
        let materials = before.materials.iter().zip(&after.materials).enumerate();
        let materials = materials.filter(|(_, (a, b))| a != b);
        let materials = materials.map(|(index, (_, material))| Edit::Material {
            index,
            material: Box::new(material.clone()),
        });
        let instances = before.instances.iter().zip(&after.instances).enumerate();
        let instances = instances.filter(|(_, (a, b))| a.world_from_mesh != b.world_from_mesh);
        let instances = instances.map(|(index, (_, instance))| Edit::Instance {
            index,
            world_from_mesh: instance.world_from_mesh,
        });
        let environment = after.environment.clone().map(Edit::Environment);
        let lights = (self.lights != after.lights).then(|| Edit::Lights(after.lights.clone()));
        let media = (self.media != after.media).then(|| Edit::Media(after.media.clone()));
        let edits = meshes.chain(materials).chain(instances);
        Some(
            edits
                .chain(environment)
                .chain(lights)
                .chain(media)
                .collect(),
        )
    }

    fn check_all(&self, edits: &[Edit]) -> Result<(), GpuError> {
        let mut lights = self.lights.len();
        for edit in edits {
            self.check(edit, lights)?;
            if let Edit::Lights(all) = edit {
                lights = all.len();
            }
        }
        Ok(())
    }

    /// Checks an edit of the scene when it has so many lights.
    fn check(&self, edit: &Edit, lights: usize) -> Result<(), GpuError> {
        let refused = |what: String| Err(GpuError::Input { what });
        let (thing, index, count) = match edit {
            Edit::Instance { index, .. } => ("instance", *index, self.host.instances.len()),
            Edit::Material { index, .. } => ("material", *index, self.host.materials.len()),
            Edit::Mesh { index, .. } => ("mesh", *index, self.host.meshes.len()),
            Edit::Light { index, .. } => ("light", *index, lights),
            Edit::Environment(environment) => {
                check_environment(Some(environment))?;
                let count = usize::from(self.environment.is_some());
                ("environment", 0, count)
            }
            Edit::Media(media) => return check_media(media),
            Edit::Lights(_) | Edit::Camera { .. } => return Ok(()),
        };
        if index >= count {
            return refused(format!("there is no {thing} {index} to edit, but {count}"));
        }
        match edit {
            Edit::Material { index, material } => {
                let textures = self.host.textures.len();
                let mut read = texture_slots(material).into_iter();
                if read.any(|(slot, _)| slot.is_some_and(|reference| reference.texture >= textures))
                {
                    return refused(format!(
                        "material {index} reads a texture that there is not: there are {textures}"
                    ));
                }
            }
            Edit::Mesh { index, mesh } => {
                if let Err(error) = mesh.check() {
                    return refused(format!("mesh {index}: {error}"));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Whether an edit keeps the sizes of buffers and textures and the order of draws.
    fn can_apply(&self, edit: &Edit) -> bool {
        match edit {
            Edit::Instance {
                index,
                world_from_mesh,
            } => {
                let instance = &self.host.instances[*index];
                let rays = self.rays.as_ref();
                // A mirroring transform reverses the winding of triangles.
                is_mirrored(&instance.world_from_mesh) == is_mirrored(world_from_mesh)
                    && rays
                        .is_none_or(|rays| rays.can_refit(*index, instance.mesh, world_from_mesh))
            }
            Edit::Material { index, material } => {
                let before = &self.host.materials[*index];
                let drawn = |material: &Material| {
                    let is_opaque = material.alpha_mode == AlphaMode::Opaque;
                    let transmits = material.transmission > 0.0;
                    let sides = (material.has_two_sides(), material.is_translucent());
                    (is_see_through(material), is_opaque, transmits, sides)
                };
                let texture = |slot: &Option<TextureRef>| slot.map(|reference| reference.texture);
                let read = |material: &Material| {
                    texture_slots(material).map(|(slot, space)| (texture(slot), space))
                };
                // A sphere that emits is refused when the scene is uploaded.
                let shows = |instance: &Instance| instance.is_sphere && instance.material == *index;
                let is_refused =
                    material.emissive != Vec3::ZERO && self.host.instances.iter().any(shows);
                drawn(before) == drawn(material) && read(before) == read(material) && !is_refused
            }
            Edit::Mesh { index, mesh } => {
                let before = &self.host.meshes[*index];
                let shows = |instance: &Instance| instance.is_sphere && instance.mesh == *index;
                !self.host.instances.iter().any(shows)
                    && before.positions.len() == mesh.positions.len()
                    && before.indices == mesh.indices
                    && self.geometry.meshes[*index].closed
                        == self.geometry.meshes[*index].is_closed_after(before, mesh)
            }
            Edit::Light { .. }
            | Edit::Lights(_)
            | Edit::Environment(_)
            | Edit::Media(_)
            | Edit::Camera { .. } => true,
        }
    }

    /// Applies edits for which [`GpuScene::can_apply`] holds, or none.
    fn apply(&mut self, gpu: &Gpu, mut edits: Vec<Edit>) -> Result<Undo, GpuError> {
        let (versions, atlases) = (self.versions, self.atlases.clone());
        let done = self.exchange(gpu, &mut edits);
        edits.reverse();
        let undo = Undo(Before::Edits(edits, versions, atlases));
        match done {
            Ok(()) => Ok(undo),
            Err(error) => {
                // What has failed may fail again, but leaves what was there before.
                let _ = self.undo(gpu, undo);
                Err(error)
            }
        }
    }

    /// Gives the scene the values of edits, and the edits those of the scene: in reverse order they lead back. After an
    /// error, only those edits are left that have been exchanged.
    fn exchange(&mut self, gpu: &Gpu, edits: &mut Vec<Edit>) -> Result<(), GpuError> {
        let header = self.header_values;
        let mut moved = Vec::new();
        let mut has_good_trees = true;
        for index in 0..edits.len() {
            match self.exchange_one(gpu, &mut edits[index], &mut moved) {
                Ok(has_good_tree) => has_good_trees &= has_good_tree,
                Err(error) => {
                    edits.truncate(index + 1);
                    return Err(error);
                }
            }
        }
        if let Some(rays) = self.rays.as_ref().filter(|_| !has_good_trees) {
            let rays = Rays::new(gpu, &self.host, &self.geometry, Some(rays))?;
            self.set_rays(gpu, rays);
        }
        moved.sort_unstable();
        moved.dedup();
        self.place(gpu, &moved)?;
        if self.header_values != header {
            gpu.write(&self.header, 0, &[self.header_values]);
        }
        Ok(())
    }

    /// Exchanges the value of one edit, and adds the instances that it moves to `moved`, which are yet to be placed.
    /// Returns false if the ray hierarchies should be built again.
    fn exchange_one(
        &mut self,
        gpu: &Gpu,
        edit: &mut Edit,
        moved: &mut Vec<usize>,
    ) -> Result<bool, GpuError> {
        match edit {
            Edit::Instance {
                index,
                world_from_mesh,
            } => {
                let place = &mut self.host.instances[*index].world_from_mesh;
                std::mem::swap(place, world_from_mesh);
                moved.push(*index);
            }
            Edit::Material { index, material } => self.exchange_material(gpu, *index, material),
            Edit::Mesh { index, mesh } => return self.exchange_mesh(gpu, *index, mesh, moved),
            Edit::Light { index, light } => {
                std::mem::swap(&mut self.lights[*index], light);
                self.versions.lights += u64::from(self.lights[*index] != *light);
            }
            Edit::Lights(lights) => {
                std::mem::swap(&mut self.lights, lights);
                self.versions.lights += u64::from(self.lights != *lights);
            }
            Edit::Environment(environment) => self.exchange_environment(gpu, environment)?,
            Edit::Media(media) => {
                std::mem::swap(&mut self.media, media);
                self.media_changed(gpu, media)?;
            }
            // Pictures are made for cameras of their own.
            Edit::Camera { .. } => {}
        }
        Ok(true)
    }

    /// Updates everything that depends on the transforms of these instances, whose indices are in increasing order.
    fn place(&mut self, gpu: &Gpu, moved: &[usize]) -> Result<(), GpuError> {
        let version = self.versions.geometry + 1;
        let is_elsewhere = |&index: &usize| {
            let placement = &self.placements[index];
            placement.bent == version
                || placement.world_from_mesh != self.host.instances[index].world_from_mesh
        };
        let moved: Vec<usize> = moved.iter().copied().filter(is_elsewhere).collect();
        if moved.is_empty() {
            return Ok(());
        }
        self.versions.geometry = version;
        let mut is_any_emitting = false;
        for &index in &moved {
            let instance = &self.host.instances[index];
            let mesh = &self.geometry.meshes[instance.mesh];
            let mesh_bounds = mesh_bounds(&self.tables.instances[index], mesh);
            let bounds = mesh_bounds.transformed(&instance.world_from_mesh);
            set_place(&mut self.tables.instances[index], &instance.world_from_mesh);
            self.bounds_tree.set(index, bounds);
            if self.has_captures() {
                let draw = &mut self.draws[self.draw_of[index] as usize];
                (draw.mesh_bounds, draw.bounds) = (mesh_bounds, bounds);
            }
            let placement = &mut self.placements[index];
            placement.world_from_mesh = instance.world_from_mesh;
            placement.moved = version;
            if self.host.materials[instance.material].emissive != Vec3::ZERO {
                is_any_emitting = true;
                let number = index as u32;
                let first = self
                    .emitters
                    .partition_point(|emitter| emitter.instance < number);
                let end = self
                    .emitters
                    .partition_point(|emitter| emitter.instance <= number);
                let emitters = emitters_of(&self.host, index);
                self.emitters.splice(first..end, emitters);
            }
        }
        self.versions.lights += u64::from(is_any_emitting);
        self.tables.write_instances(gpu, moved.iter().copied());
        if let Some(rays) = &mut self.rays
            && !rays.follow(gpu, &self.host, &moved)
        {
            let rays = rays.with_instances(gpu, &self.host)?;
            self.set_rays(gpu, rays);
        }
        self.bounds = self.bounds_tree.all();
        self.core = core_of(&self.bounds_tree.at_most(MOST_BOXES), self.bounds);
        self.header_values.diagonal = self.bounds.diagonal();
        self.header_values.longest = self.bounds_tree.longest();
        if (self.media.iter()).any(|medium| medium.world_from_box.is_none()) {
            self.tables.write_media(gpu, &self.media, &self.bounds);
        }
        Ok(())
    }

    fn exchange_material(&mut self, gpu: &Gpu, index: usize, other: &mut Material) {
        std::mem::swap(&mut self.host.materials[index], other);
        let (before, material) = (&*other, &self.host.materials[index]);
        if before == material {
            return;
        }
        self.versions.materials += 1;
        let textures = |material: &Material| texture_slots(material).map(|(slot, _)| *slot);
        let are_others = textures(before) != textures(material);
        self.tables
            .write_material(gpu, &self.host, index, &self.images, are_others);
        let emission = |material: &Material| (material.emissive, material.emissive_texture);
        if emission(before) != emission(material) {
            self.emitters = emitters(&self.host);
            self.versions.lights += 1;
        }
        let nameless = Object::of(material);
        if Object::of(before) != nameless {
            self.versions.objects += 1;
            for (object, instance) in self.objects.iter_mut().zip(&self.host.instances) {
                if instance.material == index {
                    // Its name is kept, not copied: many instances may share the material.
                    *object = Object {
                        name: std::mem::take(&mut object.name),
                        part_of: object.part_of,
                        ..nameless
                    };
                }
            }
        }
    }

    /// Replaces the hierarchies; the header is yet to be written.
    fn set_rays(&mut self, gpu: &Gpu, rays: Rays) {
        if rays.buffer != self.hierarchy {
            self.hierarchy = rays.buffer.clone();
            self.bind(gpu);
        }
        self.header_values.bvh_start = rays.start();
        self.rays = Some(rays);
    }

    /// Exchanges a mesh for a deformed one: see [`GpuScene::exchange_one`].
    fn exchange_mesh(
        &mut self,
        gpu: &Gpu,
        index: usize,
        other: &mut Arc<Mesh>,
        moved: &mut Vec<usize>,
    ) -> Result<bool, GpuError> {
        std::mem::swap(&mut self.host.meshes[index], other);
        let mesh = &self.host.meshes[index];
        if Arc::ptr_eq(mesh, other) {
            return Ok(true);
        }
        self.versions.topology += 1;
        self.versions.meshes += 1;
        self.atlases = std::mem::take(&mut self.atlases).of_other_meshes();
        Arc::make_mut(&mut self.geometry).bend(gpu, index, mesh);
        let instances = self.host.instances.iter().enumerate();
        let of_mesh = instances.filter(|(_, instance)| instance.mesh == index);
        let bent: Vec<usize> = of_mesh.map(|(number, _)| number).collect();
        for &number in &bent {
            self.placements[number].bent = self.versions.geometry + 1;
        }
        let mut has_good_tree = true;
        if let Some(rays) = &mut self.rays {
            let triangles = self.geometry.meshes[index].triangles(mesh);
            has_good_tree = rays.bend(gpu, index, &triangles)?
                && bent.iter().all(|&number| {
                    let place = &self.host.instances[number].world_from_mesh;
                    rays.can_refit(number, index, place)
                });
        }
        moved.extend(bent);
        Ok(has_good_tree)
    }

    /// Makes bind group 0 again, after one of its resources was replaced.
    fn bind(&mut self, gpu: &Gpu) {
        let buffers = [
            &self.header,
            &self.geometry.buffer,
            &self.tables.buffer,
            &self.hierarchy,
        ];
        let environment = &self.environment_texels.view;
        [self.bind_group, self.ray_bind_group] =
            self.bindings.bind(gpu, buffers, environment, &self.images);
    }

    fn exchange_environment(&mut self, gpu: &Gpu, other: &mut Environment) -> Result<(), GpuError> {
        let Some(environment) = &mut self.environment else {
            return Ok(());
        };
        std::mem::swap(environment, other);
        let after = Some(&*environment);
        let is_other_image = !is_same_image(after, Some(&*other));
        if is_other_image {
            self.environment_texels = environment_texels(gpu, after)?;
            self.versions.environment += 1;
        }
        let header = (self.header_values).with_environment(after, self.environment_texels.scale);
        self.versions.sky += u64::from(header != self.header_values);
        self.header_values = header;
        if is_other_image {
            self.bind(gpu);
        }
        Ok(())
    }

    /// Uploads the media, which were `before`; the header is yet to be written.
    fn media_changed(&mut self, gpu: &Gpu, before: &[Medium]) -> Result<(), GpuError> {
        if have_same_grids(before, &self.media) {
            self.tables.write_media(gpu, &self.media, &self.bounds);
        } else {
            let instances = self.tables.instances.clone();
            let media = (&self.media[..], &self.bounds);
            self.tables = Tables::new(gpu, &self.host, instances, &self.images, media)?;
            self.bind(gpu);
            self.header_values.medium_count = self.media.len() as u32;
        }
        self.versions.media += 1;
        Ok(())
    }

    /// Replaces the scene by `after`, whatever it is.
    fn replace(&mut self, gpu: &Gpu, after: &Scene) -> Result<Undo, GpuError> {
        let before = &self.host;
        let same_meshes = same_meshes(before, after);
        let meshes = before.meshes.len() != after.meshes.len() || same_meshes.contains(&false);
        let materials = before.materials != after.materials
            || before.textures != after.textures
            || !are_same(&before.images, &after.images);
        let instances = |of: fn(&Instance) -> (usize, usize, bool)| {
            let [old, new] = [before, after].map(|scene| scene.instances.iter().map(of));
            !old.eq(new)
        };
        let triangles = meshes || instances(|instance| (instance.mesh, 0, false));
        let instances =
            instances(|instance| (instance.mesh, instance.material, instance.is_sphere));
        let geometry = meshes || before.instances != after.instances;
        // Materials and mirroring transforms decide the order and winding of triangles.
        let mirrored = |scene: &Scene| -> Vec<bool> {
            let transforms = scene
                .instances
                .iter()
                .map(|instance| instance.world_from_mesh);
            transforms
                .map(|transform| is_mirrored(&transform))
                .collect()
        };
        let topology = meshes || instances || materials || mirrored(before) != mirrored(after);
        let lights = self.lights != after.lights || materials || instances;
        let texels = !is_same_image(self.environment.as_ref(), after.environment.as_ref());
        let media = self.media != after.media;
        let sky = |environment: Option<&Environment>| {
            environment.map(|environment| (environment.rotation, environment.intensity))
        };
        let sky = sky(self.environment.as_ref()) != sky(after.environment.as_ref());

        let uploaded = match Self::upload(gpu, after, self.use_of, Some(self)) {
            Ok(uploaded) => uploaded,
            Err(error) => {
                // The upload's error says more than one that follows from it.
                let _ = self.renew_top_level(gpu);
                return Err(error);
            }
        };
        let versions = self.versions;
        let placements = match instances {
            true => &[][..],
            false => &self.placements,
        };
        let mut atlases = self.atlases.clone();
        if triangles {
            atlases = atlases.of_other_meshes();
        }
        let grown = |count: u64, changed: bool| count + u64::from(changed);
        let version = grown(versions.geometry, geometry);
        let placements = moved(placements, after, &same_meshes, version);
        // Emitters move with their instances.
        let is_emitting =
            |instance: &Instance| after.materials[instance.material].emissive != Vec3::ZERO;
        let mut placed = placements.iter().zip(&after.instances);
        let emitters =
            geometry && placed.any(|(at, instance)| at.moved == version && is_emitting(instance));
        let replaced = Self {
            placements,
            atlases,
            versions: Versions {
                geometry: version,
                materials: grown(versions.materials, materials),
                lights: grown(versions.lights, lights || emitters),
                sky: grown(versions.sky, sky),
                environment: grown(versions.environment, texels),
                media: grown(versions.media, media),
                topology: grown(versions.topology, topology),
                meshes: grown(versions.meshes, triangles),
                instances: grown(versions.instances, instances),
                objects: versions.objects + 1,
            },
            ..uploaded
        };
        let before = std::mem::replace(self, replaced);
        Ok(Undo(Before::Scene(Box::new(before))))
    }
}
