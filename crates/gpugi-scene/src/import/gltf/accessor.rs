//! Reads numbers from accessors: every component type, normalised, strided and sparse. Nothing is allocated before its
//! count has been checked against the available bytes or the limits.

use std::borrow::Cow;

use super::document::{Document, range};
use super::schema::Accessor;
use crate::ImportError;
use crate::import::quoted;

/// A component type, identified by glTF's constant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    /// That of a constant.
    pub fn new(number: u32) -> Option<Self> {
        Some(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// Bytes.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// A function that reads a component as a float. glTF: c / (2^n - 1) unsigned, max(c / (2^(n-1) - 1), -1) signed.
    fn reader(self, normalized: bool) -> fn(&[u8]) -> f32 {
        match (self, normalized) {
            (Self::I8, false) => |bytes| f32::from(i8::from_le_bytes(first(bytes))),
            (Self::U8, false) => |bytes| f32::from(u8::from_le_bytes(first(bytes))),
            (Self::I16, false) => |bytes| f32::from(i16::from_le_bytes(first(bytes))),
            (Self::U16, false) => |bytes| f32::from(u16::from_le_bytes(first(bytes))),
            (Self::I8, true) => {
                |bytes| (f32::from(i8::from_le_bytes(first(bytes))) / 127.0).max(-1.0)
            }
            (Self::U8, true) => |bytes| f32::from(u8::from_le_bytes(first(bytes))) / 255.0,
            (Self::I16, true) => {
                |bytes| (f32::from(i16::from_le_bytes(first(bytes))) / 32767.0).max(-1.0)
            }
            (Self::U16, true) => |bytes| f32::from(u16::from_le_bytes(first(bytes))) / 65535.0,
            (Self::U32, false) => |bytes| u32::from_le_bytes(first(bytes)) as f32,
            (Self::U32, true) => {
                |bytes| (f64::from(u32::from_le_bytes(first(bytes))) / f64::from(u32::MAX)) as f32
            }
            (Self::F32, _) => |bytes| f32::from_le_bytes(first(bytes)),
        }
    }
}

/// The first `N` bytes; the caller must pass at least `N`.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.first_chunk().copied().unwrap_or([0; N])
}

/// Memory layout of an element. The columns of matrices start at multiples of 4 bytes.
struct Layout {
    component: Component,
    rows: usize,
    columns: usize,
}

impl Layout {
    fn column_stride(&self) -> usize {
        let size = self.rows * self.component.size();
        if self.columns > 1 {
            size.next_multiple_of(4)
        } else {
            size
        }
    }

    /// Bytes from the start of an element's first component to the end of its last one.
    fn size(&self) -> usize {
        self.column_stride() * (self.columns - 1) + self.rows * self.component.size()
    }

    /// Bytes from one element to the next if they are tightly packed.
    fn packed_stride(&self) -> usize {
        self.column_stride() * self.columns
    }

    fn read<const N: usize, T: Copy + Default>(
        &self,
        bytes: &[u8],
        read: impl Fn(&[u8]) -> T,
    ) -> [T; N] {
        let mut element = [T::default(); N];
        for (index, value) in element.iter_mut().enumerate() {
            let (column, row) = (index / self.rows, index % self.rows);
            *value = read(&bytes[column * self.column_stride() + row * self.component.size()..]);
        }
        element
    }
}

/// The elements of an accessor in stored form, tightly packed.
pub struct Packed<'a> {
    /// `stride` bytes per element.
    pub bytes: Cow<'a, [u8]>,
    /// Bytes per element, including padding between the columns of matrices.
    pub stride: usize,
}

impl Document<'_> {
    /// Number of components per element of accessor `index`, for attributes that come in several widths.
    pub fn width(&self, index: usize, place: &str) -> Result<usize, ImportError> {
        let (_, layout) = self.layout(index, place)?;
        Ok(layout.rows * layout.columns)
    }

    /// The component type of accessor `index`.
    pub fn component(&self, index: usize, place: &str) -> Result<Component, ImportError> {
        Ok(self.layout(index, place)?.1.component)
    }

    /// Number of elements of accessor `index`.
    pub fn count(&self, index: usize, place: &str) -> Result<u64, ImportError> {
        Ok(self
            .get(&self.root.accessors, "accessor", index, place)?
            .count)
    }

    /// All elements of accessor `index` as floats, normalised if the accessor requires it; all are finite.
    pub fn floats<const N: usize>(
        &self,
        index: usize,
        place: &str,
    ) -> Result<Vec<[f32; N]>, ImportError> {
        let elements = self.any_floats(index, place)?;
        let is_finite = |element: &[f32; N]| element.iter().all(|value| value.is_finite());
        if let Some(at) = elements.iter().position(|element| !is_finite(element)) {
            return Err(self.error(
                place,
                format!(
                    "element {at} of accessors[{index}] is {:?}, which is not finite",
                    elements[at]
                ),
            ));
        }
        Ok(elements)
    }

    /// As [`Document::floats`], finite or not.
    pub fn any_floats<const N: usize>(
        &self,
        index: usize,
        place: &str,
    ) -> Result<Vec<[f32; N]>, ImportError> {
        let (accessor, layout) = self.layout(index, place)?;
        let read = layout.component.reader(accessor.normalized);
        self.elements(index, place, read)
    }

    /// All elements of accessor `index` as unsigned integers.
    pub fn integers<const N: usize>(
        &self,
        index: usize,
        place: &str,
    ) -> Result<Vec<[u32; N]>, ImportError> {
        let (_, layout) = self.layout(index, place)?;
        let read = integer_reader(layout.component).ok_or_else(|| {
            self.error(
                place,
                format!("accessors[{index}] does not hold unsigned integers"),
            )
        })?;
        self.elements(index, place, read)
    }

    fn layout(&self, index: usize, place: &str) -> Result<(&Accessor, Layout), ImportError> {
        let accessor = self.get(&self.root.accessors, "accessor", index, place)?;
        let component = Component::new(accessor.component_type).ok_or_else(|| {
            self.error(
                format!("accessors[{index}].componentType"),
                format!("{} is no component type", accessor.component_type),
            )
        })?;
        let (rows, columns) = match accessor.kind.as_str() {
            "SCALAR" => (1, 1),
            "VEC2" => (2, 1),
            "VEC3" => (3, 1),
            "VEC4" => (4, 1),
            "MAT2" => (2, 2),
            "MAT3" => (3, 3),
            "MAT4" => (4, 4),
            other => {
                return Err(self.error(
                    format!("accessors[{index}].type"),
                    format!("\"{}\" is no accessor type", quoted(other)),
                ));
            }
        };
        Ok((
            accessor,
            Layout {
                component,
                rows,
                columns,
            },
        ))
    }

    fn elements<const N: usize, T: Copy + Default>(
        &self,
        index: usize,
        place: &str,
        read: impl Fn(&[u8]) -> T + Copy,
    ) -> Result<Vec<[T; N]>, ImportError> {
        let (accessor, layout) = self.layout(index, place)?;
        if layout.rows * layout.columns != N {
            return Err(self.error(
                place,
                format!(
                    "accessors[{index}] is {}, not of {N} components",
                    accessor.kind
                ),
            ));
        }
        let packed = self.packed(index, place)?;
        let elements = packed.bytes.chunks_exact(packed.stride);
        Ok(elements.map(|bytes| layout.read(bytes, read)).collect())
    }

    /// The bytes of all elements of accessor `index`, with sparse replacements applied.
    pub fn packed(&self, index: usize, place: &str) -> Result<Packed<'_>, ImportError> {
        let (accessor, layout) = self.layout(index, place)?;
        // Nothing but the budget limits an accessor without a buffer view, whose elements are all zero.
        let packed_stride = layout.packed_stride();
        let fits = self.budget.check(accessor.count, packed_stride);
        fits.map_err(|reason| self.error(place, format!("accessors[{index}]: {reason}")))?;
        let length = accessor.count as usize * packed_stride;
        let count = accessor.count as usize;
        let accessor_place = format!("accessors[{index}]");
        let mut packed = match accessor.buffer_view {
            _ if let Some(decoded) = self.decoded_accessors.get(&index) => {
                Cow::from(decoded.as_slice())
            }
            Some(view) => {
                let (bytes, stride) = self.view(view, &accessor_place)?;
                let stride = stride.unwrap_or(packed_stride as u64);
                let bytes = self.strided(
                    bytes,
                    accessor.byte_offset,
                    count,
                    stride,
                    &layout,
                    &accessor_place,
                )?;
                let stride = stride as usize;
                if stride == packed_stride && bytes.len() == length {
                    Cow::from(bytes)
                } else {
                    let mut packed = vec![0; length];
                    let elements = packed.chunks_exact_mut(packed_stride);
                    // Without elements, the stride may be 0.
                    for (element, bytes) in elements.zip(bytes.chunks(stride.max(1))) {
                        element[..layout.size()].copy_from_slice(&bytes[..layout.size()]);
                    }
                    Cow::from(packed)
                }
            }
            None => Cow::from(vec![0; length]),
        };
        if let Some(sparse) = &accessor.sparse {
            let place = format!("{accessor_place}.sparse");
            // A sparse accessor replaces existing elements, each at most once.
            if sparse.count > accessor.count {
                return Err(self.error(
                    place,
                    format!("replaces {} of {count} elements", sparse.count),
                ));
            }
            let replaced = sparse.count as usize;
            let values = &sparse.values;
            let (bytes, _) = self.view(values.buffer_view, &format!("{place}.values"))?;
            let bytes = self.strided(
                bytes,
                values.byte_offset,
                replaced,
                packed_stride as u64,
                &layout,
                &format!("{place}.values"),
            )?;
            let indices = self.sparse_indices(accessor, &format!("{place}.indices"))?;
            let packed = packed.to_mut();
            for (target, bytes) in indices.into_iter().zip(bytes.chunks(packed_stride)) {
                if u64::from(target) >= accessor.count {
                    return Err(self.error(
                        format!("{place}.indices"),
                        format!("element {target} is out of range: there are {count}"),
                    ));
                }
                let start = target as usize * packed_stride;
                packed[start..start + layout.size()].copy_from_slice(&bytes[..layout.size()]);
            }
        }
        Ok(Packed {
            bytes: packed,
            stride: packed_stride,
        })
    }

    fn sparse_indices(&self, accessor: &Accessor, place: &str) -> Result<Vec<u32>, ImportError> {
        let Some(sparse) = &accessor.sparse else {
            return Ok(Vec::new());
        };
        let part = &sparse.indices;
        let component = part.component_type.and_then(Component::new);
        let (component, read) = component
            .and_then(|component| Some((component, integer_reader(component)?)))
            .ok_or_else(|| self.error(place, "componentType is no unsigned integer"))?;
        let layout = Layout {
            component,
            rows: 1,
            columns: 1,
        };
        let (bytes, _) = self.view(part.buffer_view, place)?;
        let (count, stride) = (sparse.count as usize, component.size());
        let bytes = self.strided(
            bytes,
            part.byte_offset,
            count,
            stride as u64,
            &layout,
            place,
        )?;
        Ok(bytes.chunks_exact(stride).take(count).map(read).collect())
    }

    /// The bytes from `offset` on, once it is certain that they hold `count` elements that lie `stride` bytes apart.
    fn strided<'b>(
        &self,
        bytes: &'b [u8],
        offset: u64,
        count: usize,
        stride: u64,
        layout: &Layout,
        place: &str,
    ) -> Result<&'b [u8], ImportError> {
        if count == 0 {
            return Ok(&[]);
        }
        // Each element needs bytes of its own, so that the size of the buffer bounds `count`.
        if stride < layout.size() as u64 {
            return Err(self.error(
                place,
                format!(
                    "elements of {} bytes lie {stride} bytes apart",
                    layout.size()
                ),
            ));
        }
        let needed = (count as u64 - 1)
            .checked_mul(stride)
            .and_then(|bytes| bytes.checked_add(layout.size() as u64));
        needed
            .and_then(|needed| range(bytes, offset, needed))
            .ok_or_else(|| {
                self.error(
                    place,
                    format!(
                        "{count} elements {stride} bytes apart at {offset} exceed the {} bytes of the buffer view",
                        bytes.len()
                    ),
                )
            })
    }
}

fn integer_reader(component: Component) -> Option<fn(&[u8]) -> u32> {
    match component {
        Component::U8 => Some(|bytes| u32::from(u8::from_le_bytes(first(bytes)))),
        Component::U16 => Some(|bytes| u32::from(u16::from_le_bytes(first(bytes)))),
        Component::U32 => Some(|bytes| u32::from_le_bytes(first(bytes))),
        _ => None,
    }
}
