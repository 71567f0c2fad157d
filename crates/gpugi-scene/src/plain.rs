//! Long lists of plain values in serialized scenes: as their bytes, in the order of this machine. That is many times as
//! fast as one value after another.

use std::fmt::{self, Formatter};
use std::marker::PhantomData;

use bytemuck::{AnyBitPattern, NoUninit, cast_slice, pod_read_unaligned};
use serde::de::{Error, Visitor};
use serde::{Deserializer, Serializer};

/// For `#[serde(with)]`.
pub fn serialize<T: NoUninit, S: Serializer>(
    values: &[T],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(cast_slice(values))
}

/// For `#[serde(with)]`.
pub fn deserialize<'de, T: AnyBitPattern, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_bytes(Bytes(PhantomData))
}

struct Bytes<T>(PhantomData<T>);

impl<T: AnyBitPattern> Visitor<'_> for Bytes<T> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        formatter.write_str("the bytes of a list")
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<T>, E> {
        let values = bytes.chunks_exact(size_of::<T>());
        if !values.remainder().is_empty() {
            return Err(E::invalid_length(bytes.len(), &self));
        }
        Ok(values.map(pod_read_unaligned).collect())
    }
}
