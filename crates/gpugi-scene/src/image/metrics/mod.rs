//! How far a picture is from its reference: numbers, and an error for each pixel. `docs/measuring.md` has the equations.

mod filter;
mod flip;
mod hdr_flip;
mod heat_map;
mod picture;
mod squared;
mod ssim;

pub use heat_map::heat_map;
pub use picture::{Picture, decode_picture, load_picture};
pub use squared::{EPSILON, rel_mse};

/// A way to say how far a picture is from its reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Mean of (a - b)^2 / (b^2 + [`EPSILON`]) over pixels and channels of linear RGB.
    RelMse,
    /// The same on the means of blocks of 4x4 pixels: what is left of noise when neighbours are averaged.
    RelMse4,
    /// Root of the mean squared difference: of sRGB values where both pictures are display-referred, else of radiance.
    Rmse,
    /// 20 log10(peak / rmse) (dB). The peak is 1 where both are display-referred, else the reference's largest channel.
    Psnr,
    /// Structural similarity of luma: 1 for equal pictures (Wang et al. 2004).
    Ssim,
    /// What an eye sees flipping between the two, 0 to 1 (Andersson et al. 2020; 2021 for radiance).
    Flip,
}

impl Metric {
    /// Every metric, in the order in which reports list them.
    pub const ALL: [Self; 6] = [
        Self::RelMse,
        Self::RelMse4,
        Self::Rmse,
        Self::Psnr,
        Self::Ssim,
        Self::Flip,
    ];

    /// The name that the command line and reports use.
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

    /// Whether `value` keeps to `bound`: a largest value, or a smallest one where larger is better.
    pub fn within(self, value: f64, bound: f64) -> bool {
        if self.larger_is_better() {
            value >= bound
        } else {
            value <= bound
        }
    }
}

/// What a metric found.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The metric's value; infinite for the PSNR of equal pictures.
    pub value: f64,
    /// What it was computed with, such as its epsilon, by name.
    pub parameters: Vec<(&'static str, f64)>,
    /// An error for each pixel, row by row from the top; 0 is none, and 1 as large as the reference, or the largest.
    pub map: Vec<f32>,
}

/// Pictures that a metric cannot compare.
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
    /// The window of SSIM does not fit into the pictures.
    #[error("SSIM needs {0}x{0} pixels or more", ssim::WINDOW)]
    TooSmall,
}

/// Compares a picture with its reference.
pub fn compare(
    metric: Metric,
    test: &Picture,
    reference: &Picture,
) -> Result<Comparison, MetricError> {
    if test.size() != reference.size() {
        return Err(MetricError::SizesDiffer {
            test: test.size(),
            reference: reference.size(),
        });
    }
    match metric {
        Metric::RelMse => Ok(squared::relative(test, reference)),
        Metric::RelMse4 => Ok(squared::relative_of_blocks(test, reference)),
        Metric::Rmse => Ok(squared::root_mean(test, reference)),
        Metric::Psnr => Ok(squared::peak_signal_to_noise(test, reference)),
        Metric::Ssim => ssim::similarity(test, reference),
        Metric::Flip if both_display_referred(test, reference) => {
            Ok(flip::compare(test, reference))
        }
        Metric::Flip => Ok(hdr_flip::compare(test, reference)),
    }
}

/// Whether the pictures are compared as a display shows them, and not as radiance.
pub fn both_display_referred(test: &Picture, reference: &Picture) -> bool {
    test.is_display_referred() && reference.is_display_referred()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    sum / count as f64
}

/// Weights of Rec. 709.
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}
