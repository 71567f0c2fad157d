//! Why a scene has no atlas.

use super::{AtlasOptions, TexelDensity};

/// Why no atlas can be made of a scene with the given options.
#[derive(Debug, Clone, thiserror::Error, PartialEq)]
pub enum AtlasError {
    /// An option is out of range.
    #[error("atlas {option}: {value} is not in {least} to {most}")]
    Option {
        /// The option.
        option: &'static str,
        /// Requested value.
        value: f64,
        /// Minimum.
        least: f64,
        /// Maximum.
        most: f64,
    },
    /// A mesh is invalid.
    #[error("mesh {mesh} ({name}): {reason}")]
    Mesh {
        /// Mesh index.
        mesh: usize,
        /// Mesh name.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// An instance cannot be laid out.
    #[error("instance {instance} ({name}): {reason}")]
    Instance {
        /// Instance index.
        instance: usize,
        /// Instance name.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The atlas would have too many pages.
    #[error(
        "the atlas needs {needed} pages of {size} texels a side, {limit} are allowed; take {}larger pages",
        unless_lowest(*.at_any_density)
    )]
    TooManyPages {
        /// Pages needed, possibly without gutters.
        needed: u64,
        /// Maximum number of pages.
        limit: u32,
        /// Side of a page (texels).
        size: u32,
        /// Whether no density was asked for, and the lowest still needs as many: gutters alone take them.
        at_any_density: bool,
    },
    /// An instance or chart does not fit a page.
    #[error(
        "an instance takes {width}x{height} texels, a page has {size}x{size}; take {}larger pages",
        unless_lowest(*.at_any_density)
    )]
    PageTooSmall {
        /// Width of the instance or chart (texels).
        width: u32,
        /// Height of the instance or chart (texels).
        height: u32,
        /// Side of a page (texels).
        size: u32,
        /// As in [`AtlasError::TooManyPages`].
        at_any_density: bool,
    },
    /// All charts together exceed the limit of the unwrapper.
    #[error("the atlas would have {texels} texels, 2^30 is the limit; take fewer texels per metre")]
    TooManyTexels {
        /// Texels needed.
        texels: u64,
    },
    /// The progress callback cancelled the work.
    #[error("cancelled")]
    Cancelled,
    /// The unwrapper rejected its input, which indicates a bug in gpugi.
    #[error("unwrapping: {reason}")]
    Unwrapper {
        /// The unwrapper's message.
        reason: String,
    },
}

/// What else helps where density is not as low as it can be.
fn unless_lowest(at_any_density: bool) -> &'static str {
    if at_any_density {
        ""
    } else {
        "fewer texels per metre, or "
    }
}

impl AtlasError {
    pub(super) fn of_unwrapper(error: uvunwrap::Error, options: &AtlasOptions) -> Self {
        match error {
            uvunwrap::Error::Cancelled => Self::Cancelled,
            uvunwrap::Error::AtlasTooLarge { texels } => Self::TooManyTexels { texels },
            uvunwrap::Error::ChartTooLarge { width, height, .. } => Self::PageTooSmall {
                width,
                height,
                size: options.size,
                at_any_density: options.density == TexelDensity::OnePage,
            },
            other => Self::Unwrapper {
                reason: other.to_string(),
            },
        }
    }
}
