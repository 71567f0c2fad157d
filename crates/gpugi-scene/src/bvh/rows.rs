//! How hierarchies are packed in rows.

/// Four words of the packed hierarchies.
pub type Row = [u32; 4];

/// Rows per triangle in a leaf: one per corner, in the mesh's units. The fourth word of the first row is the triangle's
/// number.
pub const TRIANGLE_ROWS: u32 = 3;

/// Rows per instance in a leaf: three rows of the affine transform from world space to the mesh's units, then one row
/// with the row of the mesh's root, the instance's number, flags and, of a sphere, the row that holds its centre and
/// radius in the mesh's units.
pub const INSTANCE_ROWS: u32 = 4;

/// Flag of an instance whose material uses alpha: its hits are only candidates.
pub const FLAG_ALPHA: u32 = 1;

/// Flag of an instance that is a sphere: its triangles tell only which of them lies below a hit.
pub const FLAG_SPHERE: u32 = 2;

/// Flag of an instance whose back faces nobody sees and no light leaves: a front face in the same place hides them.
pub const FLAG_BLACK_BACK: u32 = 4;

/// Maximum number of levels of a mesh's hierarchy. A deeper one is replaced by a balanced one, which holds 10^11
/// triangles in this many levels.
pub(super) const MESH_LEVELS: u32 = 12;

/// Maximum number of levels of a top level, likewise: 10^7 instances.
pub(super) const TOP_LEVELS: u32 = 8;

/// Size of the traversal stack. Each level leaves at most one entry (the siblings still to visit), the first level
/// none; entering an instance leaves one more. So a ray needs at most the levels of the top plus those of the deepest
/// mesh, minus one.
pub const STACK_SIZE: u32 = MESH_LEVELS + TOP_LEVELS - 1;

/// Bound on the rounding errors of slab tests, projected corners and the ray's transform: boxes grow by this fraction
/// of the distances and extents involved. One rounding is 2^-24; a chain has about ten.
pub(super) const ROUNDING: f64 = 1.0 / (1 << 20) as f64;
