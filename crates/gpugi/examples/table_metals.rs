//! Prints a table of metals' reflectance, exact and by the tutorial's equation 4: `cargo run -p gpugi --example
//! table_metals`. It uses double precision and the formulas of shared/fresnel.wesl.

/// Refractive index and extinction at 650, 550 and 450 nm: Johnson and Christy 1972; aluminium: Rakic 1995.
const METALS: [(&str, [f64; 3], [f64; 3]); 4] = [
    ("gold", [0.16, 0.42, 1.50], [3.47, 2.35, 1.88]),
    ("silver", [0.05, 0.06, 0.04], [4.42, 3.59, 2.66]),
    ("copper", [0.21, 0.95, 1.18], [3.67, 2.58, 2.34]),
    ("aluminium", [1.56, 0.98, 0.63], [7.71, 6.57, 5.31]),
];
const DEGREES: [f64; 5] = [0.0, 45.0, 60.0, 75.0, 85.0];

fn main() {
    print!("| metal, channel |");
    for degrees in DEGREES {
        print!(" {degrees} degrees |");
    }
    println!(" largest difference |");
    println!("|---|{}---|", "---|".repeat(DEGREES.len()));
    for (name, n, k) in METALS {
        for (channel, (n, k)) in ["red", "green", "blue"].iter().zip(n.into_iter().zip(k)) {
            print!("| {name}, {channel} |");
            for degrees in DEGREES {
                let cosine = degrees.to_radians().cos();
                print!(
                    " {:.3} {:.3} |",
                    exact(n, k, cosine),
                    approximate(n, k, cosine)
                );
            }
            let difference = |step: u32| {
                let cosine = f64::from(step) / 1000.0;
                approximate(n, k, cosine) - exact(n, k, cosine)
            };
            let steps = (0..=1000).map(difference);
            let worst = steps.max_by(|a, b| a.abs().total_cmp(&b.abs()));
            println!(" {:+.3} |", worst.unwrap_or(0.0));
        }
    }
}

/// Born and Wolf, section 14.2.
fn exact(n: f64, k: f64, cosine: f64) -> f64 {
    let c2 = cosine * cosine;
    let s2 = 1.0 - c2;
    let t = n * n - k * k - s2;
    let sum = (t * t + 4.0 * n * n * k * k).sqrt();
    let a = (0.5 * (sum + t)).max(0.0).sqrt();
    let s = (sum + c2 - 2.0 * cosine * a) / (sum + c2 + 2.0 * cosine * a);
    let across = 2.0 * cosine * s2 * a;
    let p = s * (c2 * sum + s2 * s2 - across) / (c2 * sum + s2 * s2 + across);
    0.5 * (s + p)
}

/// Fp + (1 - Fp) (1 - cos)^5.
fn approximate(n: f64, k: f64, cosine: f64) -> f64 {
    let straight = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
    straight + (1.0 - straight) * (1.0 - cosine).powi(5)
}
