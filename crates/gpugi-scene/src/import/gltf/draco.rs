//! KHR_draco_mesh_compression: primitives compressed by Draco. Decoding gives the bytes of their accessors, which have no
//! buffer views.

use std::collections::BTreeMap;

use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex,
};

use super::accessor::Component;
use super::document::{DRACO, Document};
use super::schema::Primitive;
use crate::ImportError;

/// Bytes that any primitive may decode to.
const LEAST_BYTES: u64 = 1 << 16;

/// The bytes of accessors, tightly packed.
pub type Accessors = BTreeMap<usize, Vec<u8>>;
/// The buffer view of compressed data from which an accessor was decoded.
type Sources = BTreeMap<usize, usize>;

impl Document<'_> {
    /// Decodes all primitives whose accessors have no buffer views.
    pub fn decode_primitives(&self) -> Result<Accessors, ImportError> {
        let mut accessors = Accessors::new();
        let mut sources = Sources::new();
        for (mesh, json) in self.root.meshes.iter().enumerate() {
            for (number, primitive) in json.primitives.iter().enumerate() {
                let place = format!("meshes[{mesh}].primitives[{number}].extensions.{DRACO}");
                self.decode_primitive(primitive, &place, (&mut accessors, &mut sources))?;
            }
        }
        Ok(accessors)
    }

    fn decode_primitive(
        &self,
        primitive: &Primitive,
        place: &str,
        (accessors, sources): (&mut Accessors, &mut Sources),
    ) -> Result<(), ImportError> {
        let Some(packed) = &primitive.extensions.draco else {
            return Ok(());
        };
        let mut wanted = Vec::new();
        for (name, &id) in &packed.attributes {
            if let Some(&accessor) = primitive.attributes.get(name) {
                wanted.push((accessor, id));
            }
        }
        // Each stream has its own order of vertices, so that no accessor can stand for two. Those with uncompressed data can.
        let all = wanted.iter().map(|(accessor, _)| *accessor);
        for accessor in all.chain(primitive.indices) {
            let json = self.get(&self.root.accessors, "accessor", accessor, place)?;
            if json.buffer_view.is_some() {
                continue;
            }
            let source = *sources.entry(accessor).or_insert(packed.buffer_view);
            if source != packed.buffer_view {
                let reason = format!("accessors[{accessor}] is shared with other compressed data");
                return Err(self.error(place, reason));
            }
        }
        let is_needed = |index: usize| -> Result<bool, ImportError> {
            let accessor = self.get(&self.root.accessors, "accessor", index, place)?;
            Ok(accessor.buffer_view.is_none() && !accessors.contains_key(&index))
        };
        let mut needed = Vec::new();
        for &(accessor, id) in &wanted {
            if is_needed(accessor)? {
                needed.push((accessor, id));
            }
        }
        let indices = match primitive.indices {
            Some(index) if is_needed(index)? => Some(index),
            _ => None,
        };
        if needed.is_empty() && indices.is_none() {
            return Ok(());
        }
        let indices_of = primitive
            .indices
            .ok_or_else(|| self.error(place, "it has no indices"))?;
        if primitive.mode != 4 {
            return Err(self.error(place, "compressed strips are not supported, only triangles"));
        }
        // The accessors say how much is decoded; it is charged first. The factor leaves room for attributes that no accessor
        // names.
        let mut bytes = LEAST_BYTES;
        for &(accessor, _) in &wanted {
            let count = self.count(accessor, place)?;
            let size = self.width(accessor, place)? * self.component(accessor, place)?.size();
            if needed.iter().any(|(needed, _)| *needed == accessor) {
                self.charge(count, size, place)?;
            }
            bytes = bytes.saturating_add(count.saturating_mul(4 * size as u64));
        }
        let corners = self.count(indices_of, place)?;
        self.charge(corners, size_of::<u32>(), place)?;
        let limits = DecodeLimits::default()
            .with_max_faces(corners / 3)
            .with_max_decoded_bytes(bytes);
        let (content, _) = self.view(packed.buffer_view, place)?;
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(content).with_limits(limits);
        MeshDecoder::new()
            .decode(&mut buffer, &mut mesh)
            .map_err(|reason| self.error(place, reason))?;
        for (accessor, id) in needed {
            let attribute = mesh.attribute_by_unique_id(id);
            let attribute = attribute
                .ok_or_else(|| self.error(place, format!("there is no attribute {id}")))?;
            let bytes = self.attribute(accessor, attribute, mesh.num_points(), place)?;
            accessors.insert(accessor, bytes);
        }
        if let Some(index) = indices {
            let corners = mesh
                .faces()
                .iter()
                .flatten()
                .map(|point| f64::from(point.0));
            let bytes = self.stored(index, corners, 3 * mesh.num_faces(), place)?;
            accessors.insert(index, bytes);
        }
        Ok(())
    }

    /// The values of an attribute, as an accessor stores them.
    fn attribute(
        &self,
        accessor: usize,
        attribute: &PointAttribute,
        points: usize,
        place: &str,
    ) -> Result<Vec<u8>, ImportError> {
        let width = self.width(accessor, place)?;
        if width != usize::from(attribute.num_components()) {
            return Err(self.error(
                place,
                format!(
                    "accessors[{accessor}] does not have {} components",
                    attribute.num_components()
                ),
            ));
        }
        let read = reader(attribute.data_type())
            .ok_or_else(|| self.error(place, "it has numbers that no accessor holds"))?;
        let size = attribute.data_type().byte_length();
        let stride = usize::try_from(attribute.byte_stride()).unwrap_or(0);
        let data = attribute.buffer().data();
        let values = (0..points).flat_map(|point| {
            let value = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
            (0..width).map(move |component| {
                let start = value
                    .checked_mul(stride)
                    .and_then(|start| start.checked_add(component * size));
                let bytes = start.and_then(|start| data.get(start..)?.get(..size));
                // What maps to no value is damaged.
                bytes.map_or(f64::NAN, read)
            })
        });
        self.stored(accessor, values, points * width, place)
    }

    /// Numbers in the component type of an accessor, which must have as many.
    fn stored(
        &self,
        accessor: usize,
        values: impl Iterator<Item = f64>,
        count: usize,
        place: &str,
    ) -> Result<Vec<u8>, ImportError> {
        let width = self.width(accessor, place)?;
        let wanted = self.count(accessor, place)?.saturating_mul(width as u64);
        if wanted != count as u64 {
            return Err(self.error(
                place,
                format!("{count} numbers were decoded for the {wanted} of accessors[{accessor}]"),
            ));
        }
        let component = self.component(accessor, place)?;
        let mut bytes = Vec::with_capacity(count * component.size());
        for value in values {
            match component {
                Component::I8 => bytes.extend((value as i8).to_le_bytes()),
                Component::U8 => bytes.extend((value as u8).to_le_bytes()),
                Component::I16 => bytes.extend((value as i16).to_le_bytes()),
                Component::U16 => bytes.extend((value as u16).to_le_bytes()),
                Component::U32 => bytes.extend((value as u32).to_le_bytes()),
                Component::F32 => bytes.extend((value as f32).to_le_bytes()),
            }
        }
        Ok(bytes)
    }
}

/// A function that reads a number of a type; `None` for 64-bit integers, which no accessor holds.
fn reader(kind: DataType) -> Option<fn(&[u8]) -> f64> {
    macro_rules! read {
        ($type:ty) => {
            |bytes| {
                f64::from(<$type>::from_le_bytes(
                    bytes.first_chunk().copied().unwrap_or_default(),
                ))
            }
        };
    }
    Some(match kind {
        DataType::Int8 => read!(i8),
        DataType::Uint8 | DataType::Bool => read!(u8),
        DataType::Int16 => read!(i16),
        DataType::Uint16 => read!(u16),
        DataType::Int32 => read!(i32),
        DataType::Uint32 => read!(u32),
        DataType::Float32 => read!(f32),
        DataType::Float64 => read!(f64),
        _ => return None,
    })
}
