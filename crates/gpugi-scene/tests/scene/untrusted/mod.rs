//! Files that claim much, lead elsewhere or hold nonsense: a clear error, or a scene, soon and within the limits.

mod exr;
mod files;
mod limits;
mod materials;
mod messages;
mod obj;
mod paths;
mod pictures;
mod slivers;
