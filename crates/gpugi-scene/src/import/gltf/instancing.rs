//! EXT_mesh_gpu_instancing: nodes whose meshes appear in many places.

use std::collections::HashSet;

use glam::{DQuat, DVec3};

use super::document::{Document, INSTANCING};
use crate::animation::{Node, Rig, Transform, unit_rotation};
use crate::{ImportError, Instance};

/// Memory of an instance (bytes); names are shared. Two short lists in a file can multiply to a huge number of
/// instances.
pub const INSTANCE_BYTES: usize = size_of::<Instance>();
/// Memory of a place (bytes): its transform as read and as placed, a node of the rig with its entry in the order, and
/// its pose.
const PLACE_BYTES: usize = 40 + 3 * size_of::<Transform>() + size_of::<Node>() + 128;

/// The instanced nodes of a file and their instances.
#[derive(Default)]
pub struct Instancing {
    /// Nodes whose mesh appears at their instances and not at the node itself.
    pub nodes: HashSet<usize>,
    /// Node and instance number of each place. In the rig, places come after the file's nodes.
    pub places: Vec<(usize, usize)>,
}

/// Adds to `rig` one node per place, as a child of the instanced node, so that it moves with that node.
pub fn expand(document: &Document, rig: &mut Rig) -> Result<Instancing, ImportError> {
    let mut found = Instancing::default();
    for node in 0..document.root.nodes.len() {
        let Some(places) = places(document, node)? else {
            continue;
        };
        found.nodes.insert(node);
        for (number, rest) in places.into_iter().enumerate() {
            found.places.push((node, number));
            rig.order.push(rig.nodes.len());
            rig.nodes.push(Node {
                parent: Some(node),
                rest,
                weights: Vec::new(),
            });
        }
    }
    Ok(found)
}

/// The transforms of the instances of `node`'s mesh, in the node's space. `None` if the mesh appears at the node
/// itself: always without the extension, and also, with a warning, if the mesh deforms.
pub fn places(document: &Document, node: usize) -> Result<Option<Vec<Transform>>, ImportError> {
    let source = &document.root.nodes[node];
    let (Some(extension), Some(mesh)) = (&source.extensions.instancing, source.mesh) else {
        return Ok(None);
    };
    let mesh_place = format!("nodes[{node}].mesh");
    let mesh = document.get(&document.root.meshes, "mesh", mesh, &mesh_place)?;
    let place = format!("nodes[{node}].extensions.{INSTANCING}");
    let mut primitives = mesh.primitives.iter();
    if source.skin.is_some() || primitives.any(|primitive| !primitive.targets.is_empty()) {
        document.warn(&place, "a mesh that bends stands only where its node is");
        return Ok(None);
    }
    let mut count = None;
    for (name, &accessor) in &extension.attributes {
        let place = format!("{place}.attributes.{name}");
        let of_attribute = document.count(accessor, &place)?;
        let count = *count.get_or_insert(of_attribute);
        if of_attribute != count {
            let reason = format!("{of_attribute} elements for {count} instances");
            return Err(document.error(place, reason));
        }
    }
    let count = count.ok_or_else(|| document.error(&place, "it has no attributes"))?;
    document.charge(count, PLACE_BYTES + INSTANCE_BYTES, &place)?;
    let attribute = |name: &str| extension.attributes.get(name).copied();
    let vectors = |name: &str| {
        let read = |accessor| document.floats::<3>(accessor, &format!("{place}.attributes.{name}"));
        attribute(name).map(read).transpose()
    };
    let (translations, scales) = (vectors("TRANSLATION")?, vectors("SCALE")?);
    let rotations = attribute("ROTATION")
        .map(|accessor| document.floats::<4>(accessor, &format!("{place}.attributes.ROTATION")))
        .transpose()?;
    let transform = |number: usize| Transform::Parts {
        translation: (translations.as_ref())
            .map_or(DVec3::ZERO, |all| all[number].map(f64::from).into()),
        rotation: (rotations.as_ref()).map_or(DQuat::IDENTITY, |all| {
            unit_rotation(all[number].map(f64::from))
        }),
        scale: (scales.as_ref()).map_or(DVec3::ONE, |all| all[number].map(f64::from).into()),
    };
    Ok(Some((0..count as usize).map(transform).collect()))
}
