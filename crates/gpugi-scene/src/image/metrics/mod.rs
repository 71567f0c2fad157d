//! Measures how far a picture is from its reference: one number, and an error for each pixel. `docs/measuring.md` has
//! the equations.

mod comparison;
mod filter;
mod flip;
mod hdr_flip;
mod heat_map;
mod picture;
mod squared;
mod ssim;

pub use comparison::{Comparison, Metric, MetricError, both_display_referred};
pub use heat_map::heat_map;
pub use picture::{Picture, decode_picture, load_picture};
pub use squared::{EPSILON, rel_mse};

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
