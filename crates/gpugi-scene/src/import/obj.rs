//! OBJ + MTL.
//!
//! The parsers are custom so that errors name their line, which OBJ crates do not report, and so that no damaged file
//! makes them panic or allocate more than the file's own size suggests.

mod displace;
mod geometry;
mod material;
mod numbers;
mod refine;
mod texture;

use std::collections::HashSet;

use glam::Mat4;

use self::displace::displace;
use self::geometry::Geometry;
use self::material::Library;
use super::budget::Budget;
use super::text::without_mark;
use super::{default_material, quoted};
use crate::{ImportError, Limits, Resolver, Scene};

/// Reads an OBJ scene: one instance per group (or object) and material. Parts without normals get smooth ones. Missing
/// files other than the OBJ itself (material libraries, images) cause warnings.
pub fn import(
    name: &str,
    bytes: &[u8],
    resolver: &dyn Resolver,
    limits: &Limits,
) -> Result<Scene, ImportError> {
    let bytes =
        without_mark(bytes).map_err(|reason| ImportError::new(name, "whole file", reason))?;
    let text = String::from_utf8_lossy(bytes);
    let budget = Budget::new(limits, bytes.len());
    let geometry = Geometry::parse(name, &text, &budget)?;
    let mut scene = Scene::new(name);
    scene.origin = geometry.origin;
    scene.warnings = geometry.warnings;
    let mut library = Library::new(resolver, &budget);
    for names in &geometry.libraries {
        library.load(names, &mut scene)?;
    }

    let mut default_materials = [None; 2];
    let mut missing = HashSet::new();
    let (mut meshes, mut materials) = (Vec::new(), Vec::new());
    for part in geometry.parts {
        let found = part.material.as_deref().and_then(|name| library.find(name));
        let material = found.unwrap_or_else(|| {
            if let Some(name) = &part.material
                && missing.insert(name.clone())
            {
                let name = quoted(name);
                let warning = format!("material \"{name}\" is in no library: it becomes grey");
                scene.warnings.push(warning);
            }
            let is_colored = !part.mesh.colors.is_empty();
            *default_materials[usize::from(is_colored)]
                .get_or_insert_with(|| scene.add_material(default_material(is_colored)))
        });
        let mut mesh = part.mesh;
        if mesh.normals.is_empty() {
            let smoothed = budget.smooth_normals(&mut mesh);
            smoothed.map_err(|reason| ImportError::new(name, quoted(&mesh.name), reason))?;
        }
        meshes.push(mesh);
        materials.push(material);
    }

    let reliefs = materials.iter().map(|&material| library.relief(material));
    let reliefs: Vec<_> = reliefs.collect();
    displace(name, &mut meshes, &reliefs, &budget, &mut scene.warnings)?;

    for (mut mesh, material) in meshes.into_iter().zip(materials) {
        if scene.materials[material].normal_texture.is_some() {
            let completed = budget.tangents(&mut mesh);
            completed.map_err(|reason| ImportError::new(name, quoted(&mesh.name), reason))?;
        }
        let name = mesh.name.clone();
        let mesh = scene.add_mesh(mesh);
        let instance = scene.add_instance("", mesh, material, Mat4::IDENTITY);
        scene.instances[instance].name = name;
    }
    Ok(scene)
}
