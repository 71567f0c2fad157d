//! How much memory an import may take.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};

use crate::normals::{CREASE_ANGLE, smooth_normals_within};
use crate::{Limits, Mesh, tangents};

/// Memory that any file may take, however short it is (bytes): a desktop hardly notices it.
const FREE: u64 = 256 << 20;
/// The same for images, because flat ones compress well: the texels of a file of one colour may take four times what
/// Deflate unpacks, which in turn is up to 1032 times the file.
const FREE_IMAGES: u64 = 1 << 30;

/// Memory of a vertex of a mesh (bytes): position, normal, texture coordinate, colour and tangent.
const VERTEX: usize = 12 + 12 + 8 + 16 + 16;
/// Memory of a corner while normals are generated (bytes): its part of a face, and its place in three tables.
const SMOOTHED_CORNER: usize = 64;
/// Memory of a new vertex meanwhile (bytes): its place in a table that may grow, and in three lists.
const SMOOTHED_VERTEX: usize = 192;
/// Memory of a corner while tangents are generated (bytes): the face, the corner in two tables, and the new vertex in a
/// third one and in the mesh.
const TANGENT_CORNER: usize = 256;
/// Memory of a triangle that displacement adds, and of the vertex that it may add (bytes).
const DISPLACED: usize = 12 + VERTEX;
/// Memory of a triangle while meshes are displaced (bytes): the vertex and the triangle in lists that may grow, its edges
/// and its new vertex in tables, and the place and the normals of the vertex.
const DISPLACING: usize = 512;

/// The memory of one import. Everything whose size a file decides is charged here before it is allocated.
#[derive(Debug)]
pub struct Budget {
    limits: Limits,
    /// Bytes of all files read so far.
    given: Cell<u64>,
    /// Their paths.
    files: RefCell<HashSet<PathBuf>>,
    /// Bytes charged for the scene, without images.
    scene: Cell<u64>,
    /// Bytes charged for images.
    images: Cell<u64>,
}

impl Budget {
    /// A budget for a file of `given` bytes.
    pub fn new(limits: &Limits, given: usize) -> Self {
        Self {
            limits: *limits,
            given: Cell::new(given as u64),
            files: RefCell::default(),
            scene: Cell::new(0),
            images: Cell::new(0),
        }
    }

    /// Counts another file that the first one refers to; the same one counts once.
    pub fn give(&self, uri: &str, bytes: usize) {
        let mut path = PathBuf::new();
        for part in Path::new(uri).components() {
            match part {
                Component::ParentDir => drop(path.pop()),
                Component::CurDir => {}
                other => path.push(other),
            }
        }
        if self.files.borrow_mut().insert(path) {
            let total = self.given.get().saturating_add(bytes as u64);
            self.given.set(total);
        }
    }

    /// Charges `count` things of `size` bytes. The error says what is exceeded and how to raise it.
    pub fn charge(&self, count: u64, size: usize) -> Result<(), String> {
        self.scene.set(self.check(count, size)?);
        Ok(())
    }

    /// Checks that [`Budget::charge`] would allow this, for what is soon freed. Returns the total with it (bytes).
    pub fn check(&self, count: u64, size: usize) -> Result<u64, String> {
        let bytes = count.saturating_mul(size as u64);
        let total = self.scene.get().saturating_add(bytes);
        let by_size = self.limits.expanded(self.given.get());
        if total > self.limits.scene_bytes {
            return Err(format!(
                "{bytes} more bytes exceed the limit of {} for a scene; --limits scene=BYTES raises it",
                self.limits.scene_bytes
            ));
        }
        if total > by_size {
            return Err(format!(
                "{bytes} more bytes exceed the limit of {by_size} for a file of this size; --limits expansion=N raises it"
            ));
        }
        Ok(total)
    }

    /// Gives `mesh` smooth normals, and charges the vertices that this adds.
    pub fn smooth_normals(&self, mesh: &mut Mesh) -> Result<(), String> {
        let vertices = mesh.positions.len();
        let used = self.check(mesh.indices.len() as u64, SMOOTHED_CORNER)?;
        let scene = self.limits.scene_bytes;
        let left = scene.min(self.limits.expanded(self.given.get())) - used;
        let most = vertices as u64 + left / SMOOTHED_VERTEX as u64;
        let most = usize::try_from(most).unwrap_or(usize::MAX);
        if !smooth_normals_within(mesh, CREASE_ANGLE, most) {
            // It splits more vertices than fit, one for each corner at most: what that takes, and so the limit.
            self.check(mesh.indices.len() as u64, SMOOTHED_CORNER + SMOOTHED_VERTEX)?;
        }
        self.charge_new_vertices(vertices, mesh)
    }

    /// Gives `mesh` tangents, and charges the vertices that this adds.
    pub fn tangents(&self, mesh: &mut Mesh) -> Result<(), String> {
        let vertices = mesh.positions.len();
        self.check(mesh.indices.len() as u64, TANGENT_CORNER)?;
        tangents::generate(mesh, 0);
        self.charge_new_vertices(vertices, mesh)
    }

    /// How many triangles meshes of `triangles` in total may have once they are displaced, and the limit that decides so,
    /// as it is written. The error says that even `triangles` are too many.
    pub fn displaced_triangles(&self, triangles: u64) -> Result<(u64, &'static str), String> {
        let used = self.check(triangles, DISPLACING)?;
        let by_size = self.limits.expanded(self.given.get());
        let more = |most: u64| triangles + (most - used) / (DISPLACED + DISPLACING) as u64;
        let limits = [
            (self.limits.displaced_triangles, "displacement=N"),
            (more(self.limits.scene_bytes), "scene=BYTES"),
            (more(by_size), "expansion=N"),
        ];
        let least = limits.into_iter().min_by_key(|&(most, _)| most);
        Ok(least.expect("there are three"))
    }

    /// Charges what displacement added to a mesh: numbers of vertices and of indices before and after.
    pub fn charge_displaced(&self, before: [usize; 2], after: [usize; 2]) -> Result<(), String> {
        let [vertices, indices] = [0, 1].map(|at| after[at].saturating_sub(before[at]) as u64);
        self.charge(vertices, VERTEX)?;
        self.charge(indices, size_of::<u32>())
    }

    /// Whether meshes may be displaced at all.
    pub fn displaces(&self) -> bool {
        self.limits.displaced_triangles > 0
    }

    /// Charges the vertices of `mesh` beyond the first `vertices`, which were charged before.
    fn charge_new_vertices(&self, vertices: usize, mesh: &Mesh) -> Result<(), String> {
        let new = mesh.positions.len().saturating_sub(vertices);
        self.charge(new as u64, VERTEX)
    }

    /// The limits for the next image: what earlier ones left.
    pub fn image_limits(&self) -> ImageLimits {
        let used = self.images.get();
        let by_size = FREE_IMAGES.saturating_add(self.limits.expansion_of(self.given.get()));
        ImageLimits {
            limits: Limits {
                image_bytes: self.limits.image_bytes.saturating_sub(used),
                ..self.limits
            },
            expanded: by_size.saturating_sub(used),
        }
    }

    /// Charges an image of `bytes`; the error says that none are left.
    pub fn charge_image(&self, bytes: usize) -> Result<(), String> {
        self.image_limits().check_bytes(bytes as u64)?;
        self.images.set(self.images.get() + bytes as u64);
        Ok(())
    }

    /// Charges an image that could not be decoded, whose texels would take `bytes`. It may use up what is left.
    pub fn charge_broken_image(&self, bytes: u64) {
        self.images.set(self.images.get().saturating_add(bytes));
    }
}

impl Limits {
    /// Memory that `given` bytes of files may expand to (bytes).
    pub(crate) fn expanded(&self, given: u64) -> u64 {
        FREE.saturating_add(self.expansion_of(given))
    }

    fn expansion_of(&self, given: u64) -> u64 {
        given.saturating_mul(self.expansion)
    }
}

/// What an image may take.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ImageLimits {
    /// Its `image_bytes` are what earlier images of the scene left.
    pub limits: Limits,
    /// What `expansion` and earlier images of the scene left (bytes).
    expanded: u64,
}

impl ImageLimits {
    /// For an image that is no part of a scene.
    pub fn alone(limits: &Limits) -> Self {
        Self {
            limits: *limits,
            expanded: u64::MAX,
        }
    }

    /// Bytes that a decoder may allocate.
    pub fn most(&self) -> u64 {
        self.limits.image_bytes.min(self.expanded)
    }

    /// The error names the limit that `bytes` exceed.
    pub fn check_bytes(&self, bytes: u64) -> Result<(), String> {
        for (most, limit) in [
            (self.limits.image_bytes, "images=BYTES"),
            (self.expanded, "expansion=N"),
        ] {
            if bytes > most {
                return Err(format!(
                    "{bytes} bytes exceed the {most} that are left for images; --limits {limit} raises them"
                ));
            }
        }
        Ok(())
    }

    /// Checks an image of `bytes` against the size of its own file. `is_dense`: whether its encoding needs next to
    /// nothing for texels of one colour.
    pub fn check_file(&self, bytes: u64, given: usize, is_dense: bool) -> Result<(), String> {
        let free = if is_dense { FREE_IMAGES } else { FREE };
        let most = free.saturating_add(self.limits.expansion_of(given as u64));
        if bytes > most {
            return Err(format!(
                "a file of {given} bytes may take {most}, and not {bytes}; --limits expansion=N raises that"
            ));
        }
        Ok(())
    }
}
