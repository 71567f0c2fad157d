//! Divides an atlas of depth maps among lights that together request more than it holds.
//!
//! The edge of a shadow is off by about one texel. A light of power P spread over n views of s x s texels thus has an
//! error proportional to P / n / s in each of n views. For a given number of texels, the sum of these errors is least
//! when s^3 is proportional to P / n.

/// Smallest side of a depth view (texels).
const SMALLEST: u32 = 16;
/// Largest ratio between the view sides of the brightest light and the darkest.
const WIDEST_RATIO: f32 = 64.0;
/// Sides shrink by sixths of an octave.
const STEPS_AN_OCTAVE: f32 = 6.0;

/// What a light requests.
#[derive(Debug, Clone, Copy)]
pub struct Demand {
    /// Side of its depth views (texels).
    pub side: u32,
    /// Area of its views, in squares of that side.
    pub squares: f32,
    /// Luminous power (W).
    pub power: f32,
}

/// The side of each light's views (texels). It is the requested side if `fits` accepts that; otherwise the largest
/// proportional sides that fit, and [`SMALLEST`] for all if none do. `area`: texels available.
pub fn share(demands: &[Demand], area: f32, fits: impl Fn(&[u32]) -> bool) -> Vec<u32> {
    let importance = |demand: &Demand| demand.power / demand.squares;
    let most = demands.iter().map(importance).fold(0.0, f32::max);
    // Weights follow whole octaves of power, so that a light that changes slightly keeps its maps.
    let weights: Vec<f32> = demands
        .iter()
        .map(|demand| {
            let octaves = (importance(demand) / most).max(0.0).log2().round();
            (octaves / 3.0).exp2().clamp(1.0 / WIDEST_RATIO, 1.0)
        })
        .collect();
    let widest = demands.iter().map(|demand| demand.side).max().unwrap_or(0) as f32;
    let at = |step: u32| -> Vec<u32> {
        let side = widest * WIDEST_RATIO * (-(step as f32) / STEPS_AN_OCTAVE).exp2();
        let of_demands = demands.iter().zip(&weights);
        of_demands
            .map(|(demand, weight)| {
                let side = (side * weight / 4.0) as u32 * 4;
                side.max(SMALLEST).min(demand.side)
            })
            .collect()
    };
    let has_room = |sides: &[u32]| {
        let texels = |(demand, &side): (&Demand, &u32)| demand.squares * (side as f32).powi(2);
        demands.iter().zip(sides).map(texels).sum::<f32>() <= area
    };
    // Start where even the darkest light would get the widest side requested, and go down to the smallest side for all.
    let octaves = (widest * WIDEST_RATIO / SMALLEST as f32).max(1.0).log2();
    let steps = (octaves * STEPS_AN_OCTAVE).ceil() as u32;
    (0..steps)
        .map(at)
        .find(|sides| has_room(sides) && fits(sides))
        .unwrap_or_else(|| at(steps))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn demand(power: f32) -> Demand {
        Demand {
            side: 1024,
            squares: 6.0,
            power,
        }
    }

    /// An atlas of 8,192 x 8,192 texels, packed without loss.
    fn shared(demands: &[Demand]) -> Vec<u32> {
        share(demands, 8192.0 * 8192.0, |_| true)
    }

    #[test]
    fn who_finds_room_gets_what_it_asks_for() {
        let demands: Vec<Demand> = (0..10).map(|power| demand(power as f32)).collect();
        assert_eq!(shared(&demands), [1024; 10]);
        assert!(shared(&[]).is_empty());
    }

    #[test]
    fn brighter_lights_keep_more_and_the_atlas_is_used() {
        // Sixteen lights that are 64 times as bright as 240 others.
        let demands: Vec<Demand> = (0..256)
            .map(|index| demand(if index < 16 { 64.0 } else { 1.0 }))
            .collect();
        let sides = shared(&demands);
        let (bright, dark) = (sides[0], sides[255]);
        assert!(sides[..16].iter().all(|side| *side == bright));
        assert!(sides[16..].iter().all(|side| *side == dark));
        // The cube root of 64.
        assert!(
            (bright as f32 / dark as f32 - 4.0).abs() < 0.2,
            "{bright}, {dark}"
        );
        let texels: u32 = sides.iter().map(|side| 6 * side * side).sum();
        let part = f64::from(texels) / 8192.0_f64.powi(2);
        assert!((0.75..=1.0).contains(&part), "{part} of the atlas");
    }

    #[test]
    fn what_one_bright_light_cannot_use_others_get() {
        let mut demands = vec![demand(1.0); 12];
        demands[5].power = 1e6;
        let sides = shared(&demands);
        assert_eq!(sides[5], 1024);
        assert!(sides[0] >= 880, "{sides:?}");
    }

    #[test]
    fn small_changes_keep_the_sides() {
        let mut demands = vec![demand(1.0); 256];
        let before = shared(&demands);
        for (index, demand) in demands.iter_mut().enumerate() {
            demand.power *= 1.0 + 0.3 * (index as f32 / 255.0);
        }
        assert_eq!(shared(&demands), before);
    }

    #[test]
    fn nonsense_gets_the_smallest_and_nothing_is_smaller() {
        let powers = [0.0, f32::NAN, f32::INFINITY, -1.0, 1.0];
        let demands: Vec<Demand> = powers.map(demand).to_vec();
        let sides = share(&demands, 1e9, |sides| sides.iter().sum::<u32>() < 200);
        assert!(sides.iter().all(|side| *side >= SMALLEST), "{sides:?}");
        let none = share(&[demand(1.0); 9], 1e9, |_| false);
        assert_eq!(none, [SMALLEST; 9]);
        let zeros = share(&[demand(0.0); 40], 8192.0 * 8192.0, |_| true);
        assert!(zeros.iter().all(|side| *side == zeros[0]));
    }
}
