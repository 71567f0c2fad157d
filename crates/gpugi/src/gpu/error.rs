//! What can go wrong on a GPU, said so that a user can act on it.

/// An error of the GPU or of the way it was asked.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum GpuError {
    /// No adapter fits the choice.
    #[error("no GPU adapter {wanted}. {found} {advice}")]
    NoAdapter {
        /// What was asked for.
        wanted: String,
        /// What there is.
        found: String,
        /// What to do.
        advice: String,
    },
    /// The adapter refused to open a device.
    #[error("the adapter {adapter} opens no device: {reason}")]
    Device {
        /// Adapter name.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// The device was lost: driver reset, unplugged, watchdog.
    #[error("the GPU was lost ({reason}); try a smaller --size or another --adapter")]
    Lost {
        /// The driver's words.
        reason: String,
    },
    /// Memory ran out.
    #[error(
        "out of GPU memory in {pass}; try a smaller --size, fewer samples or another --adapter"
    )]
    OutOfMemory {
        /// Where.
        pass: String,
    },
    /// Something is larger than the adapter allows.
    #[error("{what}: {needed} needed, {limit} is the limit of {adapter}")]
    TooLarge {
        /// What is too large, with its unit.
        what: String,
        /// Size needed.
        needed: u64,
        /// Size allowed.
        limit: u64,
        /// Adapter name.
        adapter: String,
    },
    /// The scene holds something that no light can be computed from.
    #[error("{what}")]
    Input {
        /// What, and where.
        what: String,
    },
    /// The GPU API refused a pass: a defect of gpugi.
    #[error("{pass}: {reason}")]
    Pass {
        /// The pass.
        pass: String,
        /// The API's words.
        reason: String,
    },
}

impl GpuError {
    /// The API's `error`, whose text names the labels of what it is about.
    pub(super) fn uncaptured(error: &wgpu::Error) -> Self {
        Self::in_pass("the GPU refused a command", error)
    }

    /// The API's `error`, seen in `pass`.
    pub(super) fn in_pass(pass: &str, error: &wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::OutOfMemory {
                pass: pass.to_owned(),
            },
            other => Self::Pass {
                pass: pass.to_owned(),
                reason: other.to_string(),
            },
        }
    }
}
