//! Alias tables, which choose among n weighted entries in constant time (Vose, "A Linear Algorithm for Generating
//! Random Numbers with a Given Distribution", 1991).

/// An entry is chosen if the second random number is below `threshold`; otherwise `alias` is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    pub threshold: f32,
    pub alias: u32,
    /// Total probability of choosing this entry, directly or as an alias.
    pub probability: f32,
}

/// The table of non-negative `weights`. Empty if no weight is positive or their sum is not finite.
pub fn table(weights: &[f64]) -> Vec<Entry> {
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let count = weights.len() as f64;
    let mut entries: Vec<Entry> = weights
        .iter()
        .zip(0..)
        .map(|(weight, index)| Entry {
            threshold: 1.0,
            alias: index,
            probability: (weight / total) as f32,
        })
        .collect();
    let mut share: Vec<f64> = weights
        .iter()
        .map(|weight| weight / total * count)
        .collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) =
        (0..weights.len()).partition(|&index| share[index] < 1.0);
    while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
        small.pop();
        entries[poor].threshold = share[poor] as f32;
        entries[poor].alias = rich as u32;
        share[rich] -= 1.0 - share[poor];
        if share[rich] < 1.0 {
            large.pop();
            small.push(rich);
        }
    }
    // The remaining entries keep their own share, apart from rounding. An entry of weight 0 must never be chosen: it
    // aliases the heaviest entry.
    if let Some(heaviest) = (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])) {
        for index in small {
            if weights[index] == 0.0 {
                entries[index].threshold = 0.0;
                entries[index].alias = heaviest as u32;
            }
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The probability that a table gives each entry.
    fn chances(entries: &[Entry]) -> Vec<f64> {
        let mut chances = vec![0.0; entries.len()];
        for (index, entry) in entries.iter().enumerate() {
            let own = f64::from(entry.threshold);
            chances[index] += own / entries.len() as f64;
            chances[entry.alias as usize] += (1.0 - own) / entries.len() as f64;
        }
        chances
    }

    #[test]
    fn chances_are_the_weights() {
        let weights: Vec<f64> = (0..1000).map(|i| f64::from((i * 7919) % 1009)).collect();
        let total: f64 = weights.iter().sum();
        let entries = table(&weights);
        for ((chance, weight), entry) in chances(&entries).iter().zip(&weights).zip(&entries) {
            assert!((chance - weight / total).abs() < 1e-9, "{chance} {weight}");
            assert!((f64::from(entry.probability) - weight / total).abs() < 1e-9);
        }
    }

    #[test]
    fn nothing_without_weight_is_chosen() {
        let weights = [0.0, 1e-30, 0.0, 3e30, 0.0];
        let entries = table(&weights);
        let chances = chances(&entries);
        assert_eq!([chances[0], chances[2], chances[4]], [0.0; 3]);
        assert!(table(&[0.0, 0.0]).is_empty() && table(&[]).is_empty());
        assert!(table(&[f64::INFINITY]).is_empty() && table(&[f64::NAN]).is_empty());
        assert_eq!(table(&[2.0])[0].threshold, 1.0);
    }
}
