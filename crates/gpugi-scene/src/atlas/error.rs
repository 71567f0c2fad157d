//! Why a scene gets no atlas.

use super::AtlasOptions;

/// A scene or options that give no atlas.
#[derive(Debug, Clone, thiserror::Error, PartialEq)]
pub enum AtlasError {
    /// An option is out of range.
    #[error("atlas {option}: {value} is not in {least} to {most}")]
    Option {
        /// The option.
        option: &'static str,
        /// What was asked for.
        value: f64,
        /// Smallest value.
        least: f64,
        /// Largest value.
        most: f64,
    },
    /// A mesh that is none.
    #[error("mesh {mesh} ({name}): {reason}")]
    Mesh {
        /// Its number.
        mesh: usize,
        /// Its name.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// An instance that is nowhere.
    #[error("instance {instance} ({name}): {reason}")]
    Instance {
        /// Its number.
        instance: usize,
        /// Its name.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The atlas would have too many pages.
    #[error(
        "the atlas needs {needed} pages of {size} texels a side, {limit} are allowed; take fewer texels per metre, or larger pages"
    )]
    TooManyPages {
        /// Pages needed, gutters maybe not counted.
        needed: u64,
        /// Pages allowed.
        limit: u32,
        /// Texels a side of a page.
        size: u32,
    },
    /// An instance or chart does not fit a page.
    #[error(
        "an instance takes {width}x{height} texels, a page has {size}x{size}; take fewer texels per metre, or larger pages"
    )]
    PageTooSmall {
        /// Its width (texels).
        width: u32,
        /// Its height (texels).
        height: u32,
        /// Texels a side of a page.
        size: u32,
    },
    /// Everything together is beyond what is laid out at all.
    #[error("the atlas would have {texels} texels, 2^30 is the limit; take fewer texels per metre")]
    TooManyTexels {
        /// Texels needed.
        texels: u64,
    },
    /// Whoever watched the progress said so.
    #[error("cancelled")]
    Cancelled,
    /// The unwrapper refused its input: a defect of gpugi.
    #[error("unwrapping: {reason}")]
    Unwrapper {
        /// The unwrapper's words.
        reason: String,
    },
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
            },
            other => Self::Unwrapper {
                reason: other.to_string(),
            },
        }
    }
}
