//! Places the contents of the default scene.

use std::collections::HashMap;

use glam::{DMat4, DQuat, DVec3, Mat4, Vec3};

use super::document::Document;
use super::geometry::{self, Geometry};
use super::instancing::{self, INSTANCE_BYTES, Instancing};
use super::material::Materials;
use super::media::Media;
use super::{extras, rig, schema};
use crate::animation::{
    Deformer, JOINT_BYTES, MorphTarget, Node, Rig, Transform, rigid, unit_rotation,
};
use crate::import::quoted;
use crate::{
    Camera, ImportError, Instance, Light, LightKind, Mesh, Name, Origin, Projection, Resolver,
    Scene,
};

/// Memory of a morph target's weight (bytes), at rest and posed.
const WEIGHT_BYTES: usize = 8;

/// Adds instances, lights, cameras and media to `scene`, and a rig if anything moves.
pub fn read_all(
    document: &Document,
    resolver: &dyn Resolver,
    materials: &mut Materials,
    scene: &mut Scene,
) -> Result<(), ImportError> {
    let mut placer = Placer {
        document,
        materials,
        rig: hierarchy(document)?,
        geometries: HashMap::new(),
        instancing: Instancing::default(),
        is_hidden: Vec::new(),
        media: Media::new(document, resolver),
    };
    rig::read_skins(document, &mut placer.rig)?;
    rig::read_animations(document, &mut placer.rig)?;
    placer.instancing = instancing::expand(document, &mut placer.rig)?;
    placer.is_hidden = hidden(document, &placer.rig);
    let pose = placer.rig.pose(0.0);
    for carrier in nodes_of_scene(document, &placer.rig)? {
        // World space is that of the file until all is known ([`Scene::settle`]).
        let world_from_node = pose.file_from_node[carrier].as_mat4();
        let place = format!("nodes[{}]", placer.stands(carrier).0);
        if !world_from_node.is_finite() {
            return Err(document.error(place, "the node's world matrix is not finite"));
        }
        placer.place(carrier, world_from_node, &place, scene)?;
    }
    if let Some((index, source)) = default_scene(document)? {
        let place = format!("scenes[{index}]");
        let medium = (placer.media).read(&source.extras, &place, "fog".into(), None, None)?;
        scene.media.extend(medium);
    }
    if let Err((index, error)) = scene.spheres() {
        let node = scene.instances[index]
            .origin
            .map_or(0, |origin| origin.node);
        return Err(document.error(format!("nodes[{node}].extras.gpugi.sphere"), error));
    }
    scene.settle(&placer.rig);
    if placer.rig.moves() {
        scene.rig = Some(placer.rig);
    } else {
        let (instances, lights) = (scene.instances.iter_mut(), scene.lights.iter_mut());
        instances.for_each(|instance| instance.node = None);
        lights.for_each(|light| light.node = None);
        scene.media.iter_mut().for_each(|medium| medium.node = None);
        scene
            .cameras
            .iter_mut()
            .for_each(|camera| camera.node = None);
    }
    Ok(())
}

/// The nodes with their parents; an error unless they form trees.
fn hierarchy(document: &Document) -> Result<Rig, ImportError> {
    let sources = &document.root.nodes;
    let meshes = document.root.meshes.iter();
    let targets: Vec<usize> = meshes
        .map(|mesh| {
            let targets = mesh
                .primitives
                .iter()
                .map(|primitive| primitive.targets.len());
            targets.max().unwrap_or(0)
        })
        .collect();
    let mut nodes = Vec::with_capacity(sources.len());
    for (index, source) in sources.iter().enumerate() {
        nodes.push(Node {
            parent: None,
            rest: transform(source),
            weights: weights(document, source, &targets, &format!("nodes[{index}]"))?,
        });
    }
    for (index, source) in sources.iter().enumerate() {
        let place = format!("nodes[{index}].children");
        for &child in &source.children {
            document.get(sources, "node", child, &place)?;
            if let Some(other) = nodes[child].parent.replace(index) {
                return Err(document.error(
                    place,
                    format!("nodes[{child}] is already a child of nodes[{other}]"),
                ));
            }
        }
    }
    let mut order: Vec<usize> = (0..nodes.len())
        .filter(|&node| nodes[node].parent.is_none())
        .collect();
    let mut next = 0;
    while let Some(&node) = order.get(next) {
        order.extend(&sources[node].children);
        next += 1;
    }
    if order.len() < nodes.len() {
        let mut reached = vec![false; nodes.len()];
        order.iter().for_each(|&node| reached[node] = true);
        let lost = reached.iter().position(|reached| !reached).unwrap_or(0);
        return Err(document.error(
            format!("nodes[{lost}]"),
            "the node hierarchy is cyclic: this node descends from itself",
        ));
    }
    Ok(Rig {
        nodes,
        order,
        ..Rig::default()
    })
}

fn transform(node: &schema::Node) -> Transform {
    if let Some(matrix) = &node.matrix {
        return Transform::Matrix(DMat4::from_cols_array(matrix));
    }
    Transform::Parts {
        translation: node.translation.map_or(DVec3::ZERO, DVec3::from),
        rotation: node.rotation.map_or(DQuat::IDENTITY, unit_rotation),
        scale: node.scale.map_or(DVec3::ONE, DVec3::from),
    }
}

/// The morph target weights for the node's mesh: those of the node, otherwise those of the mesh, otherwise zeros.
/// `targets`: number of morph targets of each mesh.
fn weights(
    document: &Document,
    node: &schema::Node,
    targets: &[usize],
    place: &str,
) -> Result<Vec<f32>, ImportError> {
    let Some(mesh) = node.mesh else {
        return Ok(Vec::new());
    };
    let mesh_place = format!("{place}.mesh");
    let source = document.get(&document.root.meshes, "mesh", mesh, &mesh_place)?;
    let (weights, place) = match (&node.weights, &source.weights) {
        (Some(weights), _) => (weights, place.to_owned()),
        (None, Some(weights)) => (weights, format!("meshes[{mesh}]")),
        (None, None) => {
            document.charge(targets[mesh] as u64, WEIGHT_BYTES, place)?;
            return Ok(vec![0.0; targets[mesh]]);
        }
    };
    if weights.len() != targets[mesh] {
        return Err(document.error(
            format!("{place}.weights"),
            format!(
                "{} weights for {} morph targets",
                weights.len(),
                targets[mesh]
            ),
        ));
    }
    document.charge(weights.len() as u64, WEIGHT_BYTES, &place)?;
    Ok(weights.clone())
}

/// The default scene with its index; otherwise the first scene, if there are any.
fn default_scene<'a>(
    document: &'a Document,
) -> Result<Option<(usize, &'a schema::SceneNodes)>, ImportError> {
    let root = &document.root;
    Ok(match root.scene {
        Some(index) => Some((index, document.get(&root.scenes, "scene", index, "scene")?)),
        None => root.scenes.first().map(|scene| (0, scene)),
    })
}

/// The nodes of the default scene, parents first. If there is no default scene, those of the first scene; if there are
/// no scenes, all nodes.
fn nodes_of_scene(document: &Document, rig: &Rig) -> Result<Vec<usize>, ImportError> {
    let root = &document.root;
    let Some((index, scene)) = default_scene(document)? else {
        return Ok(rig.order.clone());
    };
    let place = format!("scenes[{index}].nodes");
    let mut is_in_scene = vec![false; rig.nodes.len()];
    for &node in &scene.nodes {
        document.get(&root.nodes, "node", node, &place)?;
        is_in_scene[node] = true;
    }
    for &node in &rig.order {
        if let Some(parent) = rig.nodes[node].parent {
            is_in_scene[node] |= is_in_scene[parent];
        }
    }
    let in_scene = rig.order.iter().copied();
    Ok(in_scene.filter(|&node| is_in_scene[node]).collect())
}

/// For each node of the rig, whether it or one above it is hidden (KHR_node_visibility).
fn hidden(document: &Document, rig: &Rig) -> Vec<bool> {
    let mut is_hidden = vec![false; rig.nodes.len()];
    for &node in &rig.order {
        let source = document.root.nodes.get(node);
        let is_own = source.is_some_and(|source| !source.extensions.visibility.visible);
        is_hidden[node] = is_own
            || rig.nodes[node]
                .parent
                .is_some_and(|parent| is_hidden[parent]);
    }
    is_hidden
}

/// A primitive that has been read.
struct Loaded {
    geometry: Geometry,
    /// Its index among the primitives of its mesh.
    primitive: usize,
    material: usize,
    /// The scene mesh that all instances share that do not deform.
    shared: Option<usize>,
}

struct Placer<'a> {
    document: &'a Document<'a>,
    materials: &'a mut Materials,
    rig: Rig,
    /// Primitives, by glTF mesh.
    geometries: HashMap<usize, Vec<Loaded>>,
    instancing: Instancing,
    /// Per node of the rig: it shows no mesh, medium or light. Cameras see from there all the same.
    is_hidden: Vec<bool>,
    media: Media<'a>,
}

impl Placer<'_> {
    /// The file's node for a node of the rig: the same node or, for an instance of an instanced node, that node and the
    /// instance number.
    fn stands(&self, carrier: usize) -> (usize, Option<usize>) {
        match carrier.checked_sub(self.document.root.nodes.len()) {
            None => (carrier, None),
            Some(at) => {
                let (node, number) = self.instancing.places[at];
                (node, Some(number))
            }
        }
    }

    fn place(
        &mut self,
        carrier: usize,
        world_from_node: Mat4,
        place: &str,
        scene: &mut Scene,
    ) -> Result<(), ImportError> {
        let document = self.document;
        let root = &document.root;
        let (index, number) = self.stands(carrier);
        let node = &root.nodes[index];
        let is_shown = !self.is_hidden[carrier];
        if let Some(mesh) = node.mesh
            && is_shown
            && (number.is_some() || !self.instancing.nodes.contains(&index))
        {
            self.instances(carrier, mesh, world_from_node, place, scene)?;
        }
        if number.is_some() {
            return Ok(());
        }
        if node.mesh.is_none() && extras::is_sphere(document, &node.extras, place)? {
            let place = format!("{place}.extras.gpugi.sphere");
            return Err(document.error(place, "the node has no mesh that stands for a sphere"));
        }
        let medium_name = || format!("medium {}", scene.media.len()).into();
        let name = node.name.clone().unwrap_or_else(medium_name);
        let box_of_node = Some(world_from_node);
        let medium = (self.media).read(&node.extras, place, name, box_of_node, Some(index))?;
        scene.media.extend(medium.filter(|_| is_shown));
        if let Some(camera) = node.camera {
            let place = format!("{place}.camera");
            let source = document.get(&root.cameras, "camera", camera, &place)?;
            let name = node.name.clone().or_else(|| source.name.clone());
            let (lens, shutter) = extras::lens(document, &source.extras, camera)?;
            scene.cameras.push(Camera {
                name: name.unwrap_or_else(|| format!("camera {}", scene.cameras.len()).into()),
                world_from_view: rigid(world_from_node),
                projection: projection(document, source, camera)?,
                lens,
                shutter,
                node: Some(index),
            });
        }
        if let Some(reference) = &node.extensions.light
            && is_shown
        {
            let place = format!("{place}.extensions.KHR_lights_punctual");
            let lights = &root.extensions.lights.lights;
            let source = document.get(lights, "light", reference.light, &place)?;
            let name = node.name.clone().or_else(|| source.name.clone());
            scene
                .lights
                .extend(light(document, source, reference.light).map(|light| Light {
                    name: name.unwrap_or_else(|| format!("light {}", scene.lights.len()).into()),
                    world_from_light: rigid(world_from_node),
                    node: Some(index),
                    ..light
                }));
        }
        Ok(())
    }

    fn instances(
        &mut self,
        carrier: usize,
        mesh: usize,
        world_from_mesh: Mat4,
        place: &str,
        scene: &mut Scene,
    ) -> Result<(), ImportError> {
        let document = self.document;
        let (node, number) = self.stands(carrier);
        let source = &document.root.nodes[node];
        if world_from_mesh.determinant().abs() < f32::MIN_POSITIVE {
            document.warn(place, "the node's matrix flattens its mesh");
        }
        self.load(mesh, scene)?;
        let Some(loaded) = self.geometries.get_mut(&mesh) else {
            return Ok(());
        };
        let is_sphere = extras::is_sphere(document, &source.extras, place)?;
        let name = match (&source.name, &document.root.meshes[mesh].name) {
            (Some(name), _) | (None, Some(name)) => name.clone(),
            (None, None) => format!("node {node}").into(),
        };
        document.charge(loaded.len() as u64, INSTANCE_BYTES, place)?;
        for primitive in loaded {
            let geometry = &mut primitive.geometry;
            let skin = match (source.skin, &geometry.influences) {
                (Some(skin), Some(influences)) => {
                    let place = format!("{place}.skin");
                    let joints = &document.get(&self.rig.skins, "skin", skin, &place)?.joints;
                    let used = influences.joints.iter();
                    if let Some((joint, _)) = used
                        .copied()
                        .find(|(joint, _)| *joint as usize >= joints.len())
                    {
                        return Err(document.error(
                            place,
                            format!(
                                "a vertex of \"{}\" follows joint {joint} of {}",
                                quoted(&geometry.mesh.name),
                                joints.len()
                            ),
                        ));
                    }
                    document.charge(influences.joints.len() as u64, JOINT_BYTES, &place)?;
                    Some((skin, influences.clone()))
                }
                _ => None,
            };
            let bends = skin.is_some() || !geometry.targets.is_empty();
            if is_sphere && bends {
                let place = format!("{place}.extras.gpugi.sphere");
                let reason = "a sphere must not bend: its node has a skin, or its mesh has targets";
                return Err(document.error(place, reason));
            }
            let mesh = match primitive.shared {
                Some(shared) if !bends => shared,
                _ => {
                    let copies = if bends { 2 } else { 1 };
                    let bytes = copies * (size_of::<Mesh>() + geometry.mesh.byte_size());
                    document.charge(1, bytes, place)?;
                    scene.add_mesh(geometry.mesh.clone())
                }
            };
            if bends {
                let bytes: usize = geometry.targets.iter().map(MorphTarget::byte_size).sum();
                document.charge(1, bytes + size_of::<Deformer>(), place)?;
                self.rig.deformers.push(Deformer {
                    instance: scene.instances.len(),
                    node,
                    positions: geometry.mesh.positions.clone(),
                    normals: geometry.mesh.normals.clone(),
                    tangents: geometry.mesh.tangents.clone(),
                    flat: geometry.flat,
                    targets: geometry.targets.clone(),
                    skin,
                });
            } else {
                primitive.shared = Some(mesh);
            }
            scene.instances.push(Instance {
                name: name.clone(),
                mesh,
                material: primitive.material,
                world_from_mesh,
                is_sphere,
                node: Some(carrier),
                origin: Some(Origin {
                    node,
                    place: number,
                    primitive: primitive.primitive,
                }),
            });
        }
        Ok(())
    }

    /// Reads the primitives of a mesh, unless that has already happened.
    fn load(&mut self, index: usize, scene: &mut Scene) -> Result<(), ImportError> {
        if self.geometries.contains_key(&index) {
            return Ok(());
        }
        let document = self.document;
        let source = document.get(&document.root.meshes, "mesh", index, "nodes")?;
        let primitives = source.primitives.len() as u64;
        let bytes = size_of::<Loaded>() + Name::LONGEST;
        document.charge(primitives, bytes, &format!("meshes[{index}]"))?;
        let mesh_name = (source.name.clone()).unwrap_or_else(|| format!("mesh {index}").into());
        let mut loaded = Vec::with_capacity(source.primitives.len());
        for (at, primitive) in source.primitives.iter().enumerate() {
            let place = format!("meshes[{index}].primitives[{at}]");
            let name = if source.primitives.len() > 1 {
                mesh_name.with(&format!(" {at}"))
            } else {
                mesh_name.clone()
            };
            let material = self.materials.index(
                document,
                primitive.material,
                &format!("{place}.material"),
                scene,
            )?;
            let is_unlit =
                |&index: &usize| document.root.materials[index].extensions.unlit.is_some();
            if primitive.attributes.contains_key("COLOR_0")
                && primitive.material.as_ref().is_some_and(is_unlit)
            {
                document.warn(&place, "an unlit material does not show vertex colours");
            }
            let uv_sets = self.materials.uv_sets(material);
            let normal_slot = scene.materials[material]
                .normal_texture
                .map(|texture| texture.uv_set as usize);
            if let Some(geometry) =
                geometry::read(document, primitive, name, &place, uv_sets, normal_slot)?
            {
                loaded.push(Loaded {
                    geometry,
                    primitive: at,
                    material,
                    shared: None,
                });
            }
        }
        self.geometries.insert(index, loaded);
        Ok(())
    }
}

fn projection(
    document: &Document,
    camera: &schema::Camera,
    index: usize,
) -> Result<Projection, ImportError> {
    let place = format!("cameras[{index}]");
    match (&camera.perspective, &camera.orthographic) {
        (Some(perspective), None) => {
            let vertical_fov = perspective.yfov;
            if vertical_fov <= 0.0 || vertical_fov >= std::f32::consts::PI {
                return Err(document.error(
                    format!("{place}.perspective.yfov"),
                    format!("{vertical_fov} is not between 0 and pi"),
                ));
            }
            Ok(Projection::Perspective { vertical_fov })
        }
        (None, Some(orthographic)) => {
            let height = 2.0 * orthographic.ymag;
            if height <= 0.0 || !height.is_finite() {
                return Err(document.error(
                    format!("{place}.orthographic.ymag"),
                    format!("{} is not positive", orthographic.ymag),
                ));
            }
            Ok(Projection::Orthographic { height })
        }
        _ => Err(document.error(place, "a camera is either perspective or orthographic")),
    }
}

/// A light of the file; `None`, with a warning, if it cannot shine. Wrong angles and ranges are mended, with a warning.
fn light(document: &Document, light: &schema::Light, index: usize) -> Option<Light> {
    let place = format!("extensions.KHR_lights_punctual.lights[{index}]");
    let left_out = |what: String| {
        document.warn(&place, format!("{what}: the light is left out"));
        None
    };
    let kind = match light.kind.as_str() {
        "point" => LightKind::Point,
        "directional" => LightKind::Directional,
        "spot" => spot(document, &light.spot, &place),
        other => return left_out(format!("\"{}\" is no kind of light", quoted(other))),
    };
    let intensity = Vec3::from(light.color) * light.intensity;
    if !intensity.is_finite() || intensity.cmplt(Vec3::ZERO).any() {
        return left_out(format!("{intensity} is no intensity"));
    }
    let range = light.range.filter(|range| *range > 0.0);
    if range != light.range {
        document.warn(&place, "the range is not positive: the light has none");
    }
    let radius = extras::light_radius(document, &light.extras, &place);
    let radius = radius.unwrap_or_else(|error| {
        document.warn(&error.place, format!("{}: 0 is used", error.reason));
        0.0
    });
    Some(Light {
        range: range.filter(|range| range.is_finite()),
        radius,
        ..Light::new("", kind, intensity)
    })
}

/// A spot with cone angles that obey 0 <= inner <= outer <= pi/2.
fn spot(document: &Document, spot: &schema::Spot, place: &str) -> LightKind {
    const WIDEST: f32 = std::f32::consts::FRAC_PI_2;
    let (inner, outer) = (spot.inner_cone_angle, spot.outer_cone_angle);
    // The largest angle of 32 bits may lie above pi/2. A cone without an angle would be dark.
    let outer_cone_angle = if outer > 0.0 {
        outer.min(WIDEST)
    } else {
        schema::Spot::default().outer_cone_angle
    };
    let inner_cone_angle = if inner >= 0.0 {
        inner.min(outer_cone_angle)
    } else {
        0.0
    };
    let is_kept = |given: f32, used: f32| (given - used).abs() < 1e-4;
    if !is_kept(inner, inner_cone_angle) || !is_kept(outer, outer_cone_angle) {
        document.warn(
            &format!("{place}.spot"),
            format!(
                "cone angles {inner} and {outer} break 0 <= inner <= outer <= pi/2: {inner_cone_angle} and {outer_cone_angle} are used"
            ),
        );
    }
    LightKind::Spot {
        inner_cone_angle,
        outer_cone_angle,
    }
}
