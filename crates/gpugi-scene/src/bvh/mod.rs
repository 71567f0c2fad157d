//! Bounding volume hierarchies for ray tracing: one per mesh and one over all instances, packed in rows of four words
//! for shaders.
//!
//! ```text
//! mesh 0: nodes, triangles | mesh 1: nodes, triangles | ... | top: nodes, instances
//! ```
//! The top level comes last, so that moving an instance rewrites only that part. Row numbers in nodes are absolute.

mod binary;
mod bottom;
mod error;
mod node;
mod overlap;
mod rows;
#[cfg(test)]
mod tests;
mod top;
pub mod traverse;
mod tree;

pub use bottom::{BottomLevel, MeshTriangles, TriangleTree};
pub use error::BvhError;
pub use node::NODE_ROWS;
pub use overlap::overlapping;
pub use rows::{
    FLAG_ALPHA, FLAG_BLACK_BACK, FLAG_SPHERE, INSTANCE_ROWS, Row, STACK_SIZE, TRIANGLE_ROWS,
};
pub use top::{BvhInstance, MovedItem, TopLevel};
