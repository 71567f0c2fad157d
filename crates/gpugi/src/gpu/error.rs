//! GPU errors, in words that tell the user what to do.

/// An error of the GPU or in the use of it.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum GpuError {
    /// No adapter fits the choice.
    #[error("no GPU adapter {wanted}. {found} {advice}")]
    NoAdapter {
        /// What was requested.
        wanted: String,
        /// What is available.
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
        /// The pass that needed it.
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
    /// The scene holds values from which no light can be computed.
    #[error("{what}")]
    Input {
        /// What it is, and where.
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
    /// From the API's `error`, whose text names the labels of the objects involved. `None` for an error of a window's
    /// surface, which the window learns from the surface's state and mends: wgpu refuses to configure a surface while
    /// another thread submits work, as gpugi's threads do.
    pub(super) fn uncaptured(error: &wgpu::Error) -> Option<Self> {
        let of_surface = |description: &String| description.contains("In Surface::");
        match error {
            wgpu::Error::Validation { description, .. } if of_surface(description) => None,
            _ => Some(Self::in_pass("the GPU refused a command", error)),
        }
    }

    /// From the API's `error`, raised in `pass`.
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

#[cfg(test)]
mod tests {
    use super::GpuError;

    #[test]
    fn a_surface_that_could_not_be_configured_is_no_fault() {
        let refused = |call: &str| wgpu::Error::Validation {
            source: Box::new(std::fmt::Error),
            description: format!("Validation Error\n\nCaused by:\n  In {call}\n    Failed to wait"),
        };
        assert_eq!(GpuError::uncaptured(&refused("Surface::configure")), None);
        let error = GpuError::uncaptured(&refused("Queue::submit"));
        assert!(matches!(error, Some(GpuError::Pass { .. })));
    }
}
