//! What radiosity is for in default sets.

use crate::techniques::occasion::MOST_UNWRAPPED;
use crate::techniques::{Occasion, Purpose, Speed, Values};

/// Why it suits an occasion.
pub fn suits(occasion: &Occasion<'_>) -> Option<String> {
    match occasion.purpose {
        Purpose::StillPicture => Some(format!(
            "nothing moves, and {} triangles are soon unwrapped",
            occasion.distinct_triangles()
        )),
        Purpose::Bake => Some("texels are laid out for the bake".to_owned()),
        Purpose::LiveView => None,
    }
}

/// Settings for an occasion.
pub fn settings(occasion: &Occasion<'_>) -> Values {
    match occasion.purpose {
        Purpose::StillPicture => sizes(occasion.triangles, occasion.speed),
        Purpose::Bake | Purpose::LiveView => Vec::new(),
    }
}

/// Sizes for a still picture: pages large enough for a dozen texels per triangle. On a discrete GPU, finer texels and
/// more iterates still take a second or two. In software, where rays take most of the time, coarser texels get more
/// iterates, since noise shows before blur does: from 256 texels per side on, three texels per triangle will do. So many
/// triangles are those of instances, whose gutters fill several pages however coarse texels are: larger pages have finer
/// texels for the same gutters.
fn sizes(triangles: u64, speed: Speed) -> Values {
    let side_for = |texels: u64| (texels * triangles).isqrt().next_power_of_two();
    let side = side_for(12);
    let (resolution, iterations) = match speed {
        Speed::Software => {
            let most = if triangles > MOST_UNWRAPPED {
                1024
            } else {
                512
            };
            let side = side.clamp(128, side_for(3).clamp(256, most));
            (side, 128 * 128 / side)
        }
        Speed::Modest => (side.clamp(512, 1024), 256),
        Speed::Fast => (1024, 384),
    };
    // Nobody watches the iterates: more per frame save the overhead of frames.
    [
        ("resolution", resolution),
        ("iterations", iterations),
        ("steps", 16),
    ]
    .map(|(name, value)| (name, value.to_string()))
    .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::techniques::occasion::MOST_IN_TEXELS;

    #[test]
    fn sizes_depend_on_triangles_and_kind_of_adapter_alone() {
        let sizes = |triangles, speed| {
            let sizes = sizes(triangles, speed);
            [0, 1].map(|at| sizes[at].1.parse::<u32>().unwrap())
        };
        assert_eq!(sizes(1, Speed::Software), [128, 128]);
        assert_eq!(sizes(1_500, Speed::Software), [256, 64]);
        assert_eq!(sizes(20_000, Speed::Software), [256, 64]);
        assert_eq!(sizes(MOST_UNWRAPPED, Speed::Software), [512, 32]);
        assert_eq!(sizes(MOST_IN_TEXELS, Speed::Software), [1024, 16]);
        assert_eq!(sizes(1, Speed::Modest), [512, 256]);
        assert_eq!(sizes(MOST_UNWRAPPED, Speed::Modest), [1024, 256]);
        assert_eq!(sizes(1, Speed::Fast), [1024, 384]);
        assert_eq!(sizes(MOST_UNWRAPPED, Speed::Fast), [1024, 384]);
    }
}
