//! What metrics are and return.

use super::picture::Picture;

/// Side of the Gaussian window of SSIM (pixels).
pub(super) const WINDOW: usize = 11;

/// A measure of how far a picture is from its reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Mean of (a - b)^2 / (b^2 + [`EPSILON`](super::EPSILON)) over the pixels and channels of linear RGB.
    RelMse,
    /// The same for the means of blocks of 4x4 pixels: what remains once averaging over neighbours has reduced noise.
    RelMse4,
    /// Root of the mean squared difference: of sRGB values if both pictures are display-referred, otherwise of
    /// radiance.
    Rmse,
    /// 20 log10(peak / rmse) (dB). The peak is 1 if both pictures are display-referred, otherwise the reference's
    /// largest channel.
    Psnr,
    /// Structural similarity of luma; 1 for equal pictures (Wang et al. 2004).
    Ssim,
    /// The difference that a person sees when flipping between the two pictures, 0 to 1 (Andersson et al. 2020; 2021
    /// for radiance).
    Flip,
}

impl Metric {
    /// All metrics, in the order in which reports list them.
    pub const ALL: [Self; 6] = [
        Self::RelMse,
        Self::RelMse4,
        Self::Rmse,
        Self::Psnr,
        Self::Ssim,
        Self::Flip,
    ];

    /// The name used by the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::RelMse => "rel-mse",
            Self::RelMse4 => "rel-mse-4",
            Self::Rmse => "rmse",
            Self::Psnr => "psnr",
            Self::Ssim => "ssim",
            Self::Flip => "flip",
        }
    }

    /// Whether larger values are better, as for PSNR and SSIM.
    pub fn larger_is_better(self) -> bool {
        matches!(self, Self::Psnr | Self::Ssim)
    }

    /// Whether `value` satisfies `bound`, which is a maximum, or a minimum if larger is better.
    pub fn within(self, value: f64, bound: f64) -> bool {
        if self.larger_is_better() {
            value >= bound
        } else {
            value <= bound
        }
    }
}

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The metric's value; infinite for the PSNR of equal pictures.
    pub value: f64,
    /// The parameters used, by name, such as epsilon.
    pub parameters: Vec<(&'static str, f64)>,
    /// One error per pixel, row by row from the top. 0 means no error; 1 means an error as large as the reference, or
    /// the largest error.
    pub map: Vec<f32>,
}

/// Why a metric cannot compare two pictures.
#[derive(Debug, Clone, Copy, thiserror::Error, PartialEq, Eq)]
pub enum MetricError {
    /// The pictures differ in size.
    #[error("the sizes differ: {}x{} and, of the reference, {}x{}", .test[0], .test[1], .reference[0], .reference[1])]
    SizesDiffer {
        /// Width and height of the picture under test.
        test: [u32; 2],
        /// Width and height of the reference.
        reference: [u32; 2],
    },
    /// The pictures are smaller than SSIM's window.
    #[error("SSIM needs {0}x{0} pixels or more", WINDOW)]
    TooSmall,
}

/// Whether the pictures are compared as a display shows them, rather than as radiance.
pub fn both_display_referred(test: &Picture, reference: &Picture) -> bool {
    test.is_display_referred() && reference.is_display_referred()
}

/// The mean of some values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    sum / count as f64
}
