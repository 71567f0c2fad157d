//! glTF files with baked light.
//!
//! The original's JSON is kept as values and changed only where the bake requires it ([`json`]). Its buffers and images
//! are merged into the one buffer of the .glb ([`embed`]). [`primitive`] appends geometry to that buffer, and
//! [`textures`] the baked pages, with each of their [`parts`] scaled to use the full value range; [`material`] refers
//! to them. Scenes without an original are first written by [`scene`].

pub mod changed;
mod embed;
mod json;
mod material;
mod output;
mod panes;
mod parts;
mod primitive;
mod prune;
pub mod scene;
mod texels;
mod textures;
mod transfer;

use std::collections::{BTreeMap, HashMap};

use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use super::{BakedPage, ExportError, Exported, Original};
use crate::animation::Transform;
use crate::atlas::{Atlas, InstanceUvs};
use crate::import::gltf::document::{DRACO, Document, INSTANCING};
use crate::import::gltf::{self as import, geometry, instancing};
use crate::{LightPathPanes, Limits, Origin, Resolver, Scene};
use json::{Json, Object, array, object, remove_empty};
use material::Use;
use output::Output;
use primitive::Triangles;
use textures::LightTexture;
pub use transfer::Transfer;

/// What a bake stores for the texels of its atlas, besides pages.
#[derive(Clone, Copy)]
pub enum Stored<'a> {
    Transfer(Transfer<'a>),
    Panes(&'a LightPathPanes),
}

impl Stored<'_> {
    /// The name of its extras.
    fn name(&self) -> &'static str {
        match self {
            Self::Transfer(_) => import::transfer::NAME,
            Self::Panes(_) => import::panes::NAME,
        }
    }
}

/// Limit on vertices read, counting each set of texture coordinates separately. Many nodes of a few bytes each may
/// share one long list. The limit is more than twice what fits a .glb.
const MOST_VERTICES_READ: u64 = 1 << 32;

/// See [`super::export_bake`].
pub fn bake(
    original: Option<Original>,
    scene: &Scene,
    atlas: &Atlas,
    pages: &[BakedPage],
    stored: Option<Stored>,
) -> Result<Exported, ExportError> {
    if atlas.instances.len() != scene.instances.len() || atlas.pages as usize != pages.len() {
        return Err(ExportError::new(
            "atlas",
            format!(
                "{} instances and {} pages for a scene of {} instances and {} baked pages",
                atlas.instances.len(),
                atlas.pages,
                scene.instances.len(),
                pages.len()
            ),
        ));
    }
    let origins = scene.instances.iter().map(|instance| instance.origin);
    if let Some(Original {
        name,
        bytes,
        resolver,
        limits,
    }) = original
    {
        let document = Document::read(name, bytes, resolver, &limits)?;
        let placed = placed(origins, atlas)?;
        return Baker::new(&document, resolver)?.bake(placed, atlas, pages, stored);
    }
    let written = scene::write(scene)?;
    let bytes = written.output.glb()?;
    let document = Document::read(&scene.name, &bytes, &Nothing, &Limits::NONE)?;
    let placed = placed(written.origins.into_iter(), atlas)?;
    let mut exported = Baker::new(&document, &Nothing)?.bake(placed, atlas, pages, stored)?;
    exported.warnings.splice(0..0, written.warnings);
    Ok(exported)
}

/// See [`super::export_original`].
pub fn whole(original: &Original) -> Result<Exported, ExportError> {
    let Original {
        name,
        bytes,
        resolver,
        limits,
    } = original;
    let document = Document::read(name, bytes, *resolver, limits)?;
    let baker = Baker::new(&document, *resolver)?;
    Ok(Exported {
        glb: baker.output.glb()?,
        warnings: baker.warnings,
    })
}

/// Resolver for a file that refers to no others.
struct Nothing;

impl Resolver for Nothing {
    fn read(&self, _: &str) -> Result<Vec<u8>, String> {
        Err("there are no other files".to_owned())
    }
}

/// Baked instances with their indices, by their place in the file.
type Placed<'a> = BTreeMap<Origin, (usize, &'a InstanceUvs)>;

fn placed<'a>(
    origins: impl Iterator<Item = Option<Origin>>,
    atlas: &'a Atlas,
) -> Result<Placed<'a>, ExportError> {
    let mut placed = Placed::new();
    for (instance, (origin, uvs)) in origins.zip(&atlas.instances).enumerate() {
        let Some(uvs) = uvs else { continue };
        let refused = |reason: &str| {
            let place = format!("instances[{instance}]");
            Err(ExportError::new(place, reason))
        };
        let Some(origin) = origin else {
            return refused("it does not come from the original file");
        };
        if uvs.page >= atlas.pages {
            return refused("its page does not exist");
        }
        if !uvs.corners.iter().all(|uv| uv.is_finite()) {
            return refused("its texture coordinates are not finite");
        }
        if placed.insert(origin, (instance, uvs)).is_some() {
            return refused("another instance stands for the same part of the file");
        }
    }
    Ok(placed)
}

struct Baker<'a> {
    document: &'a Document<'a>,
    resolver: &'a dyn Resolver,
    output: Output,
    warnings: Vec<String>,
    /// For each instanced node (EXT_mesh_gpu_instancing), the nodes that replace its instances.
    standing: HashMap<usize, Vec<usize>>,
    /// Triangles, per mesh and primitive of the original.
    triangles: HashMap<(usize, usize), Triangles>,
    vertices_read: u64,
}

impl<'a> Baker<'a> {
    fn new(document: &'a Document<'a>, resolver: &'a dyn Resolver) -> Result<Self, ExportError> {
        let json = Json::parse(document.json)?;
        let mut baker = Self {
            document,
            resolver,
            output: Output::new(json, further_chunks(document.further_chunks)),
            warnings: Vec::new(),
            standing: HashMap::new(),
            triangles: HashMap::new(),
            vertices_read: 0,
        };
        embed::buffers(document, &mut baker.output, &mut baker.warnings)?;
        embed::images(&mut baker.output, resolver, &mut baker.warnings)?;
        embed::densities(&mut baker.output, resolver, &mut baker.warnings)?;
        Ok(baker)
    }

    fn bake(
        mut self,
        placed: Placed,
        atlas: &Atlas,
        pages: &[BakedPage],
        stored: Option<Stored>,
    ) -> Result<Exported, ExportError> {
        texels::remove(&mut self.output.json)?;
        let root = &self.document.root;
        let name = stored.as_ref().map(Stored::name);
        let (pages, scales) = textures::add_pages(&mut self.output, atlas, pages, name)?;
        // Node and primitive of each baked instance.
        let mut carriers = vec![None; atlas.instances.len()];
        let mut users = HashMap::new();
        for node in &root.nodes {
            *users.entry(node.mesh).or_insert(0) += 1;
        }
        let mut uses = material::Uses::new();
        // For each node, and each instance of an instanced node: its own mesh, once it has one.
        let mut own: HashMap<(usize, Option<usize>), Option<usize>> = HashMap::new();
        for (origin, (instance, uvs)) in placed {
            let Origin {
                node,
                place: number,
                primitive,
            } = origin;
            let place = format!("nodes[{node}]");
            let changed = || ExportError::new(&place, "the scene is not what this file gives");
            let mesh = root.nodes.get(node).ok_or_else(changed)?.mesh;
            let mesh = mesh.ok_or_else(changed)?;
            let source = root.meshes.get(mesh).ok_or_else(changed)?;
            let source = source.primitives.get(primitive).ok_or_else(changed)?;
            let target = match own.get(&(node, number)) {
                Some(target) => *target,
                None => {
                    let users = users[&Some(mesh)];
                    let target = match number {
                        None => self.own_mesh(node, mesh, users)?,
                        Some(number) => {
                            let standing = self.standing(node)?;
                            let users = users - 1 + standing.len();
                            let stands = *standing.get(number).ok_or_else(changed)?;
                            self.own_mesh(stands, mesh, users)?
                        }
                    };
                    own.insert((node, number), target);
                    target
                }
            };
            let Some(target) = target else { continue };
            let carrier = number.map_or(node, |number| self.standing[&node][number]);
            carriers[instance] = Some((carrier, primitive));
            let triangles = match self.triangles.entry((mesh, primitive)) {
                std::collections::hash_map::Entry::Occupied(entry) => entry.into_mut(),
                std::collections::hash_map::Entry::Vacant(entry) => {
                    let place = format!("meshes[{mesh}].primitives[{primitive}]");
                    let (count, corners) =
                        geometry::triangle_corners(self.document, source, &place)?;
                    let vertices = usize::try_from(count).map_err(|_| changed())?;
                    entry.insert(Triangles { vertices, corners })
                }
            };
            if triangles.corners.len() != uvs.corners.len() {
                return Err(ExportError::new(
                    place,
                    format!(
                        "{} corners in the atlas for {} of primitive {primitive}",
                        uvs.corners.len(),
                        triangles.corners.len()
                    ),
                ));
            }
            let sets = source.attributes.keys();
            let sets = sets.filter(|name| name.starts_with("TEXCOORD_")).count();
            let reads = (triangles.vertices as u64).saturating_mul(1 + sets as u64);
            self.vertices_read = self.vertices_read.saturating_add(reads);
            if self.vertices_read > MOST_VERTICES_READ {
                return Err(ExportError::new(
                    place,
                    "nodes share more vertices than can be read for each",
                ));
            }
            let light = &pages[uvs.page as usize].light;
            let wanted = material::wanted_set(&mut self.output.json, (target, primitive), light)?;
            let uv_set = primitive::add_uvs(
                self.document,
                &mut self.output,
                (target, primitive),
                source,
                triangles,
                (&uvs.corners, wanted),
            )?;
            // Of the file's own sets, unlit materials read none, and emissive ones only that of their alpha.
            let keeps = matches!(light, None | Some(LightTexture::Lightmap { .. }));
            let own = uv_set.swapped.filter(|_| keeps || uv_set.set > 0);
            let further = uv_set.set.max(own.unwrap_or(0));
            if further > 1 {
                self.warnings.push(format!(
                    "nodes[{node}]: it has coordinates in TEXCOORD_{further}; some viewers read only two sets"
                ));
            }
            let wanted = Use {
                page: uvs.page,
                uv_set,
                scale: scales[instance].to_bits(),
            };
            uses.insert((target, primitive), wanted);
            // Unlit and emissive bakes emit, which no sphere may.
            if matches!(
                light,
                Some(LightTexture::Unlit { .. } | LightTexture::Emissive { .. })
            ) {
                take_sphere(self.output.json.at("nodes", carrier)?);
            }
        }
        let nodes = self.output.json.list("nodes").iter();
        let still = |node: &Value| node["extensions"].get(INSTANCING).is_some();
        if !self.standing.is_empty() && !nodes.into_iter().any(still) {
            self.output.json.no_longer_uses(INSTANCING);
        }
        let meshes = self.output.json.list("meshes").iter();
        let mut primitives = meshes
            .flat_map(|mesh| mesh["primitives"].as_array())
            .flatten();
        if !primitives.any(|primitive| primitive["extensions"].get(DRACO).is_some()) {
            self.output.json.no_longer_uses(DRACO);
        }
        material::assign(&mut self.output, &uses, &pages, &mut self.warnings)?;
        match stored {
            None => {}
            Some(Stored::Transfer(transfer)) => {
                transfer::add(&mut self.output, transfer, self.resolver)?;
            }
            Some(Stored::Panes(stored)) => {
                panes::add(&mut self.output, stored, &carriers, self.resolver)?;
            }
        }
        Ok(Exported {
            glb: self.output.glb()?,
            warnings: self.warnings,
        })
    }

    /// Replaces the instances of an instanced node by one child node each; the node itself then has no mesh.
    fn standing(&mut self, node: usize) -> Result<&[usize], ExportError> {
        if !self.standing.contains_key(&node) {
            let place = format!("nodes[{node}]");
            let places = instancing::places(self.document, node)?
                .ok_or_else(|| ExportError::new(&place, "the scene is not what this file gives"))?;
            let json = self.output.json.at("nodes", node)?;
            let name = json.get("name").and_then(Value::as_str).map(str::to_owned);
            let mesh = json.shift_remove("mesh");
            json.shift_remove("weights");
            let removed = object(json, "extensions").shift_remove(INSTANCING);
            remove_empty(json, "extensions");
            let is_sphere = take_sphere(json);
            let attributes = removed
                .as_ref()
                .and_then(|removed| removed["attributes"].as_object());
            let names = attributes
                .into_iter()
                .flat_map(|attributes| attributes.keys());
            let others =
                names.filter(|name| !["TRANSLATION", "ROTATION", "SCALE"].contains(&name.as_str()));
            for other in others {
                self.warnings.push(format!(
                    "{place}: its instances become nodes, which have no {other}"
                ));
            }
            let mut standing = Vec::with_capacity(places.len());
            for (number, place) in places.into_iter().enumerate() {
                let mut json = json!({ "mesh": mesh });
                if is_sphere {
                    json["extras"] = scene::sphere_extras();
                }
                if let Some(name) = &name {
                    json["name"] = json!(format!("{name} {number}"));
                }
                if let Transform::Parts {
                    translation,
                    rotation,
                    scale,
                } = place
                {
                    if translation != DVec3::ZERO {
                        json["translation"] = json!(translation.to_array());
                    }
                    if rotation != DQuat::IDENTITY {
                        json["rotation"] = json!(rotation.to_array());
                    }
                    if scale != DVec3::ONE {
                        json["scale"] = json!(scale.to_array());
                    }
                }
                let length = json.to_string().len();
                self.output
                    .json
                    .charge(length, || format!("nodes[{node}]"))?;
                standing.push(self.output.json.push("nodes", json)?);
            }
            if !standing.is_empty() {
                let json = self.output.json.at("nodes", node)?;
                array(json, "children")?.extend(standing.iter().map(|&node| Value::from(node)));
            }
            self.standing.insert(node, standing);
        }
        Ok(&self.standing[&node])
    }

    /// Gives `node` a mesh that no other node uses: the one that it has, or a copy. Returns `None` if the node stands
    /// for many instances, which cannot show a single bake.
    fn own_mesh(
        &mut self,
        node: usize,
        mesh: usize,
        users: usize,
    ) -> Result<Option<usize>, ExportError> {
        let json = self.output.json.at("nodes", node)?;
        let extensions = json.get("extensions").and_then(Value::as_object);
        if extensions.is_some_and(|extensions| extensions.contains_key(INSTANCING)) {
            self.warnings.push(format!(
                "nodes[{node}]: {} may make many of it, so it stays as it was",
                INSTANCING
            ));
            return Ok(None);
        }
        if users == 1 {
            return Ok(Some(mesh));
        }
        let copy = self.output.json.copy("meshes", mesh)?;
        let copy = self.output.json.push("meshes", Value::Object(copy))?;
        let json = self.output.json.at("nodes", node)?;
        json.insert("mesh".to_owned(), copy.into());
        Ok(Some(copy))
    }
}

/// Makes triangles of a node's sphere; returns whether it was one.
fn take_sphere(node: &mut Object) -> bool {
    let Some(extras) = node.get_mut("extras").and_then(Value::as_object_mut) else {
        return false;
    };
    let own = extras.get_mut("gpugi").and_then(Value::as_object_mut);
    let taken = own.and_then(|own| own.shift_remove("sphere"));
    remove_empty(extras, "gpugi");
    remove_empty(node, "extras");
    taken == Some(Value::Bool(true))
}

/// The whole chunks at the start of `bytes`.
fn further_chunks(bytes: &[u8]) -> &[u8] {
    let mut end = 0_usize;
    while let Some(length) = bytes
        .get(end..)
        .and_then(|rest| rest.first_chunk::<4>())
        .map(|length| u32::from_le_bytes(*length) as usize)
    {
        match end
            .checked_add(8)
            .and_then(|start| start.checked_add(length))
        {
            Some(next) if next <= bytes.len() => end = next,
            _ => break,
        }
    }
    &bytes[..end]
}
