//! How much memory an import may take.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};

use crate::Limits;

/// Memory that any file may take, however short it is (bytes): a desktop hardly notices it.
const FREE: u64 = 256 << 20;

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

    /// The limits for the next image: what earlier ones left.
    pub fn image_limits(&self) -> Limits {
        let most = self.limits.expanded(self.given.get());
        Limits {
            image_bytes: self
                .limits
                .image_bytes
                .min(most)
                .saturating_sub(self.images.get()),
            ..self.limits
        }
    }

    /// Charges an image of `bytes`; the error says that none are left.
    pub fn charge_image(&self, bytes: usize) -> Result<(), String> {
        let left = self.image_limits().image_bytes;
        if bytes as u64 > left {
            return Err(format!(
                "{bytes} bytes exceed the {left} that are left for images; --limits images=BYTES raises them"
            ));
        }
        self.images.set(self.images.get() + bytes as u64);
        Ok(())
    }
}

impl Limits {
    /// Memory that `given` bytes of files may expand to (bytes).
    pub(crate) fn expanded(&self, given: u64) -> u64 {
        FREE.saturating_add(given.saturating_mul(self.expansion))
    }
}
