//! Converts primitives to meshes.

use std::collections::BTreeMap;

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::document::Document;
use super::schema::Primitive;
use crate::animation::{Influences, JOINT_BYTES, MorphTarget};
use crate::import::replaced::Broken;
use crate::normals::replace_zero_normals;
use crate::tangents::{self, any_tangent, unit_or};
use crate::{ImportError, Mesh, Name, origin};

/// Memory of an index (bytes).
const INDEX_BYTES: usize = size_of::<u32>();

/// A primitive and the data that may deform it.
pub struct Geometry {
    pub mesh: Mesh,
    /// The file has no normals, so triangles are flat and share no vertices.
    pub flat: bool,
    pub influences: Option<Influences>,
    pub targets: Vec<MorphTarget>,
}

/// Reads a primitive. `None`, with a warning, if it has no triangles. `uv_sets`: the UV sets of the file that fill the
/// mesh's slots. `normal_slot`: the slot that the material's normal map uses.
pub fn read(
    document: &Document,
    primitive: &Primitive,
    name: Name,
    place: &str,
    uv_sets: [u32; 2],
    normal_slot: Option<usize>,
) -> Result<Option<Geometry>, ImportError> {
    if primitive.mode < 4 {
        document.warn(
            place,
            "points and lines are left out; gpugi draws triangles",
        );
        return Ok(None);
    }
    let reader = Reader {
        document,
        place,
        attributes_place: &format!("{place}.attributes"),
        count: vertex_count(document, primitive, place)?,
    };
    let indices = reader.indices(primitive)?;
    if indices.is_empty() {
        document.warn(place, "the primitive has no triangles and is left out");
        return Ok(None);
    }
    let mut geometry = reader.vertices(primitive, name, indices, uv_sets)?;
    if let Some(step) = geometry.mesh.step_of_positions() {
        let place = format!("{place}.attributes.POSITION");
        document.warn(&place, origin::coarse_positions(step));
    }
    // Skins and targets refer to where the vertices are.
    if geometry.influences.is_none() && geometry.targets.is_empty() {
        geometry.mesh.recentre();
    }
    if geometry.mesh.normals.is_empty() {
        // glTF 2.0, 3.7.2.1: use flat normals and ignore the file's tangents.
        document.charge(
            geometry.mesh.indices.len() as u64,
            geometry.split_bytes(),
            place,
        )?;
        geometry.mesh.tangents.clear();
        geometry.flat = true;
        let sources = tangents::make_flat(&mut geometry.mesh);
        geometry.follow(&sources);
    }
    if let Some(slot) = normal_slot
        && geometry.mesh.tangents.is_empty()
    {
        document.charge(
            geometry.mesh.indices.len() as u64,
            geometry.split_bytes(),
            place,
        )?;
        match tangents::generate(&mut geometry.mesh, slot) {
            Some(sources) => geometry.follow(&sources),
            None => document.warn(
                place,
                format!(
                    "there is no TEXCOORD_{} for the material's normal map",
                    uv_sets[slot]
                ),
            ),
        }
    }
    Ok(Some(geometry))
}

/// The number of vertices that the file stores for a primitive, and the vertex of each corner of its triangles: three
/// per triangle, in the order of the [`Mesh::indices`] that [`read`] returns. Neither splitting vertices nor generating
/// tangents changes that order.
pub fn triangle_corners(
    document: &Document,
    primitive: &Primitive,
    place: &str,
) -> Result<(u64, Vec<u32>), ImportError> {
    let reader = Reader {
        document,
        place,
        attributes_place: &format!("{place}.attributes"),
        count: vertex_count(document, primitive, place)?,
    };
    Ok((reader.count, reader.indices(primitive)?))
}

/// Memory of a vertex while vertices are split (bytes): its normal, its tangent, its old number and its new one, and
/// the table in which equal ones are found.
const SPLIT_BYTES: usize = 128;

impl Geometry {
    /// Memory that a vertex takes when vertices are split (bytes).
    fn split_bytes(&self) -> usize {
        let vertices = self.mesh.positions.len().max(1);
        let targets = self.targets.iter().map(MorphTarget::byte_size);
        let joints = self
            .influences
            .as_ref()
            .map_or(0, |influences| influences.per_vertex);
        let all = self.mesh.byte_size() + targets.sum::<usize>();
        SPLIT_BYTES + all.div_ceil(vertices) + joints * JOINT_BYTES
    }

    /// Applies the splitting of vertices to influences and morph targets.
    fn follow(&mut self, sources: &[u32]) {
        for target in &mut self.targets {
            tangents::select(&mut target.positions, sources);
            tangents::select(&mut target.normals, sources);
            tangents::select(&mut target.tangents, sources);
        }
        if let Some(influences) = &mut self.influences {
            influences.joints = sources
                .iter()
                .flat_map(|&source| {
                    let start = source as usize * influences.per_vertex;
                    influences.joints[start..start + influences.per_vertex].to_vec()
                })
                .collect();
        }
    }
}

fn vertex_count(
    document: &Document,
    primitive: &Primitive,
    place: &str,
) -> Result<u64, ImportError> {
    let place = format!("{place}.attributes.POSITION");
    let positions = primitive
        .attributes
        .get("POSITION")
        .ok_or_else(|| document.error(&place, "the primitive has no positions"))?;
    document.count(*positions, &place)
}

struct Reader<'a> {
    document: &'a Document<'a>,
    place: &'a str,
    attributes_place: &'a str,
    /// Number of vertices; every attribute must have as many elements.
    count: u64,
}

impl Reader<'_> {
    /// Three indices per triangle, all in range.
    fn indices(&self, primitive: &Primitive) -> Result<Vec<u32>, ImportError> {
        let Self {
            document, count, ..
        } = self;
        let place = format!("{}.indices", self.place);
        let corners: Vec<u32> = match primitive.indices {
            Some(accessor) => {
                document.charge(document.count(accessor, &place)?, INDEX_BYTES, &place)?;
                let indices = document.integers::<1>(accessor, &place)?;
                indices.into_iter().map(|[index]| index).collect()
            }
            None => {
                document.charge(*count, INDEX_BYTES, &place)?;
                let count = u32::try_from(*count)
                    .map_err(|_| document.error(&place, "more vertices than 32 bits count"))?;
                (0..count).collect()
            }
        };
        if let Some(at) = corners.iter().position(|&index| u64::from(index) >= *count) {
            return Err(document.error(
                place,
                format!(
                    "index {} at position {at} is out of range: there are {count} vertices",
                    corners[at]
                ),
            ));
        }
        let triangles = corners.windows(3);
        match primitive.mode {
            4 => {
                if !corners.len().is_multiple_of(3) {
                    document.warn(
                        self.place,
                        format!("the last of {} indices make no triangle", corners.len()),
                    );
                }
                let whole = corners.len() / 3 * 3;
                Ok(corners[..whole].to_vec())
            }
            5 => {
                document.charge(corners.len() as u64, 3 * INDEX_BYTES, &place)?;
                // Every other triangle of a strip has the opposite winding.
                let turned = triangles.enumerate().map(|(at, corners)| match at % 2 {
                    0 => [corners[0], corners[1], corners[2]],
                    _ => [corners[0], corners[2], corners[1]],
                });
                Ok(turned.flatten().collect())
            }
            6 => {
                document.charge(corners.len() as u64, 3 * INDEX_BYTES, &place)?;
                let around = corners.get(1..).unwrap_or_default().windows(2);
                Ok(around
                    .flat_map(|edge| [edge[0], edge[1], corners[0]])
                    .collect())
            }
            other => Err(document.error(
                format!("{}.mode", self.place),
                format!("{other} is no primitive mode"),
            )),
        }
    }

    fn vertices(
        &self,
        primitive: &Primitive,
        name: Name,
        indices: Vec<u32>,
        uv_sets: [u32; 2],
    ) -> Result<Geometry, ImportError> {
        let attributes = &primitive.attributes;
        let positions = self.floats::<3>(attributes, "POSITION")?;
        let normals = self.any_floats::<3>(attributes, "NORMAL")?;
        let tangents = self.any_floats::<4>(attributes, "TANGENT")?;
        let uvs = |set: u32| -> Result<Vec<Vec2>, ImportError> {
            let name = format!("TEXCOORD_{set}");
            let uvs = self.finite_floats(attributes, &name, Broken::Uv, [0.0; 2])?;
            Ok(uvs.into_iter().map(Vec2::from).collect())
        };
        let mut mesh = Mesh {
            name,
            origin: DVec3::ZERO,
            positions: positions.into_iter().map(Vec3::from).collect(),
            normals: normals
                .into_iter()
                .map(|normal| unit_or(Vec3::ZERO, normal.into()))
                .collect(),
            tangents: tangents
                .into_iter()
                .map(|[x, y, z, w]| {
                    unit_or(Vec3::ZERO, Vec3::new(x, y, z)).extend(1.0_f32.copysign(w))
                })
                .collect(),
            uvs: [uvs(uv_sets[0])?, uvs(uv_sets[1])?],
            colors: self.colors(attributes)?,
            indices,
            tree: None,
        };
        self.replace_directions(&mut mesh);
        let targets = primitive.targets.iter().enumerate();
        Ok(Geometry {
            mesh,
            flat: false,
            influences: self.influences(attributes)?,
            targets: targets
                .map(|(index, target)| self.target(target, index))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Replaces normals and tangents that are zero.
    fn replace_directions(&self, mesh: &mut Mesh) {
        let mut replaced = self.document.replaced.borrow_mut();
        replaced.add(Broken::Normal, replace_zero_normals(mesh), self.place);
        let directions = mesh.tangents.iter_mut().zip(&mesh.normals);
        let broken = directions.filter(|(tangent, _)| tangent.truncate() == Vec3::ZERO);
        let count = broken
            .map(|(tangent, normal)| *tangent = any_tangent(*normal))
            .count();
        replaced.add(Broken::Tangent, count, self.place);
    }

    fn colors(&self, attributes: &BTreeMap<String, usize>) -> Result<Vec<Vec4>, ImportError> {
        let Some(&accessor) = attributes.get("COLOR_0") else {
            return Ok(Vec::new());
        };
        let place = format!("{}.COLOR_0", self.attributes_place);
        if self.document.width(accessor, &place)? == 3 {
            let colors = self.finite_floats(attributes, "COLOR_0", Broken::Color, [1.0; 3])?;
            let opaque = colors
                .into_iter()
                .map(|color| Vec3::from(color).extend(1.0));
            return Ok(opaque.collect());
        }
        let colors = self.finite_floats(attributes, "COLOR_0", Broken::Color, [1.0; 4])?;
        Ok(colors.into_iter().map(Vec4::from).collect())
    }

    /// Joints and weights of all sets. The weights of each vertex are scaled to sum to 1.
    fn influences(
        &self,
        attributes: &BTreeMap<String, usize>,
    ) -> Result<Option<Influences>, ImportError> {
        let sets = (0..)
            .take_while(|set| attributes.contains_key(&format!("JOINTS_{set}")))
            .count();
        if sets == 0 {
            return Ok(None);
        }
        let per_vertex = sets * 4;
        self.document
            .charge(self.count, per_vertex * JOINT_BYTES, self.place)?;
        let mut joints = vec![(0, 0.0); self.count as usize * per_vertex];
        for set in 0..sets {
            let name = format!("JOINTS_{set}");
            let place = format!("{}.{name}", self.attributes_place);
            let accessor = attributes[&name];
            self.check_count(accessor, &place)?;
            let numbers = self.document.integers::<4>(accessor, &place)?;
            let name = format!("WEIGHTS_{set}");
            let weights = self.floats::<4>(attributes, &name)?;
            if weights.is_empty() {
                return Err(self
                    .document
                    .error(self.attributes_place, format!("{name} is missing")));
            }
            for (vertex, (numbers, weights)) in numbers.into_iter().zip(weights).enumerate() {
                for (lane, (number, weight)) in numbers.into_iter().zip(weights).enumerate() {
                    // Negative weights are meaningless; a joint with weight 0 may have any index.
                    let weight = weight.max(0.0);
                    joints[vertex * per_vertex + set * 4 + lane] = if weight > 0.0 {
                        (number, weight)
                    } else {
                        (0, 0.0)
                    };
                }
            }
        }
        for vertex in joints.chunks_exact_mut(per_vertex) {
            let sum: f32 = vertex.iter().map(|(_, weight)| weight).sum();
            if sum > 0.0 && sum.is_finite() {
                vertex.iter_mut().for_each(|(_, weight)| *weight /= sum);
            } else {
                // A vertex without weights would collapse to the origin.
                vertex[0].1 = 1.0;
            }
        }
        Ok(Some(Influences { per_vertex, joints }))
    }

    fn target(
        &self,
        attributes: &BTreeMap<String, usize>,
        index: usize,
    ) -> Result<MorphTarget, ImportError> {
        let place = format!("{}.targets[{index}]", self.place);
        let reader = Reader {
            place: &place,
            attributes_place: &place,
            ..*self
        };
        let known = ["POSITION", "NORMAL", "TANGENT"];
        if let Some(other) = attributes
            .keys()
            .find(|name| !known.contains(&name.as_str()))
        {
            self.document
                .warn(reader.place, format!("{other} does not morph"));
        }
        let positions = reader.floats::<3>(attributes, "POSITION")?;
        let offsets = |name, broken| -> Result<Vec<Vec3>, ImportError> {
            let offsets = reader.finite_floats(attributes, name, broken, [0.0; 3])?;
            Ok(offsets.into_iter().map(Vec3::from).collect())
        };
        Ok(MorphTarget {
            positions: positions.into_iter().map(Vec3::from).collect(),
            normals: offsets("NORMAL", Broken::NormalOffset)?,
            tangents: offsets("TANGENT", Broken::NormalOffset)?,
        })
    }

    /// A per-vertex attribute; empty if the primitive does not have it.
    fn floats<const N: usize>(
        &self,
        attributes: &BTreeMap<String, usize>,
        name: &str,
    ) -> Result<Vec<[f32; N]>, ImportError> {
        match self.attribute::<N>(attributes, name)? {
            Some((accessor, place)) => self.document.floats(accessor, &place),
            None => Ok(Vec::new()),
        }
    }

    /// As [`Reader::floats`], finite or not.
    fn any_floats<const N: usize>(
        &self,
        attributes: &BTreeMap<String, usize>,
        name: &str,
    ) -> Result<Vec<[f32; N]>, ImportError> {
        match self.attribute::<N>(attributes, name)? {
            Some((accessor, place)) => self.document.any_floats(accessor, &place),
            None => Ok(Vec::new()),
        }
    }

    /// As [`Reader::floats`]; those that are not finite are replaced.
    fn finite_floats<const N: usize>(
        &self,
        attributes: &BTreeMap<String, usize>,
        name: &str,
        broken: Broken,
        with: [f32; N],
    ) -> Result<Vec<[f32; N]>, ImportError> {
        let mut values = self.any_floats(attributes, name)?;
        let place = format!("{}.{name}", self.attributes_place);
        let mut replaced = self.document.replaced.borrow_mut();
        replaced.replace(&mut values, broken, with, &place);
        Ok(values)
    }

    /// The accessor of a per-vertex attribute of `N` floats, which is charged here, and its place.
    fn attribute<const N: usize>(
        &self,
        attributes: &BTreeMap<String, usize>,
        name: &str,
    ) -> Result<Option<(usize, String)>, ImportError> {
        let Some(&accessor) = attributes.get(name) else {
            return Ok(None);
        };
        let place = format!("{}.{name}", self.attributes_place);
        self.check_count(accessor, &place)?;
        self.document
            .charge(self.count, size_of::<[f32; N]>(), &place)?;
        Ok(Some((accessor, place)))
    }

    fn check_count(&self, accessor: usize, place: &str) -> Result<(), ImportError> {
        let count = self.document.count(accessor, place)?;
        if count != self.count {
            return Err(self.document.error(
                place,
                format!("{count} elements for {} positions", self.count),
            ));
        }
        Ok(())
    }
}
