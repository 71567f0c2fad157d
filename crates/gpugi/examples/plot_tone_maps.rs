//! Plots the tone-mapping operators as the GPU evaluates them, from grey radiance to the sRGB value shown:
//! `cargo run -p gpugi --example plot_tone_maps` writes `docs/images/tone-maps.svg`, or the file given as argument.

use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;

use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::picture::{Effects, ToneMap, developed};

/// Exposed radiance at the plot's left and right edge, in stops above 1.
const STOPS: [f32; 2] = [-8.0, 6.0];
const POINTS: usize = 141;
/// Pixels per plotted point: the mean over their dither is far finer than 8 bits.
const COPIES: usize = 1024;

/// Edges of the plot within the image, in pixels.
const LEFT: f32 = 48.0;
const RIGHT: f32 = 592.0;
const TOP: f32 = 16.0;
const BOTTOM: f32 = 336.0;

/// Colours told apart by all kinds of colour vision: Okabe and Ito, "Color Universal Design", 2008.
const COLORS: [(ToneMap, &str); 5] = [
    (ToneMap::None, "#999999"),
    (ToneMap::Reinhard, "#e69f00"),
    (ToneMap::Aces, "#d55e00"),
    (ToneMap::AgX, "#0072b2"),
    (ToneMap::Neutral, "#009e73"),
];

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/images/tone-maps.svg"),
        PathBuf::from,
    );
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let mut svg = axes()?;
    for (row, (operator, color)) in COLORS.into_iter().enumerate() {
        let points: Vec<_> = curve(&gpu, operator)?
            .into_iter()
            .map(|(stops, value)| format!("{:.1},{:.1}", x(stops), y(value)))
            .collect();
        let points = points.join(" ");
        let key = TOP + 22.0 + 18.0 * row as f32;
        writeln!(
            svg,
            r#"<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>
<path d="M {} {key} h 24" stroke="{color}" stroke-width="2"/>
<text x="{}" y="{key}" dy="0.35em">{operator}</text>"#,
            LEFT + 14.0,
            LEFT + 44.0
        )?;
    }
    svg.push_str("</svg>\n");
    std::fs::write(&file, svg)?;
    println!("{}", file.display());
    Ok(())
}

/// Stops above radiance 1, and the mean value shown, from 0 to 1.
fn curve(gpu: &Gpu, tone_map: ToneMap) -> Result<Vec<(f32, f32)>, Box<dyn Error>> {
    let [first, last] = STOPS;
    let stops: Vec<f32> = (0..POINTS)
        .map(|point| first + (last - first) * point as f32 / (POINTS - 1) as f32)
        .collect();
    let radiance: Vec<[f32; 3]> = stops
        .iter()
        .flat_map(|stops| std::iter::repeat_n([stops.exp2(); 3], COPIES))
        .collect();
    let mut effects = Effects::default().exposed(0.0);
    effects.tone_map.operator = tone_map;
    let size = [COPIES as u32, POINTS as u32];
    let pixels = developed(gpu, size, radiance.as_flattened(), &effects)?;
    let means = pixels.chunks_exact(COPIES * 4).map(|row| {
        let sum: u32 = row.chunks_exact(4).map(|pixel| u32::from(pixel[1])).sum();
        sum as f32 / (COPIES as f32 * 255.0)
    });
    Ok(stops.into_iter().zip(means).collect())
}

fn x(stops: f32) -> f32 {
    LEFT + (RIGHT - LEFT) * (stops - STOPS[0]) / (STOPS[1] - STOPS[0])
}

fn y(value: f32) -> f32 {
    BOTTOM + (TOP - BOTTOM) * value
}

/// The start of the image: grid, numbers, titles, and a mark at middle grey.
fn axes() -> Result<String, std::fmt::Error> {
    let mut svg = String::from(
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 608 384" font-family="sans-serif" font-size="12">
<rect width="608" height="384" fill="#ffffff"/>
<g stroke="#dddddd">
"##,
    );
    let columns: Vec<f32> = (0..=7).map(|step| STOPS[0] + 2.0 * step as f32).collect();
    let rows: Vec<f32> = (0..=5).map(|step| step as f32 / 5.0).collect();
    for &stops in &columns {
        writeln!(svg, r#"<path d="M {:.1} {TOP} V {BOTTOM}"/>"#, x(stops))?;
    }
    for &value in &rows {
        writeln!(svg, r#"<path d="M {LEFT} {:.1} H {RIGHT}"/>"#, y(value))?;
    }
    let middle_grey = x(0.18_f32.log2());
    writeln!(
        svg,
        r##"</g>
<path d="M {middle_grey:.1} {TOP} V {BOTTOM}" stroke="#888888" stroke-dasharray="4 4"/>
<g fill="#222222" text-anchor="middle">
<text x="{middle_grey:.1}" y="11">middle grey</text>"##
    )?;
    for &stops in &columns {
        let label = if stops < 0.0 {
            format!("1/{}", (-stops).exp2())
        } else {
            stops.exp2().to_string()
        };
        writeln!(svg, r#"<text x="{:.1}" y="354">{label}</text>"#, x(stops))?;
    }
    for &value in &rows {
        writeln!(
            svg,
            r#"<text x="30" y="{:.1}" dy="0.35em">{value}</text>"#,
            y(value)
        )?;
    }
    writeln!(
        svg,
        r#"<text x="{:.1}" y="374">exposed radiance</text>
<text transform="translate(12 {:.1}) rotate(-90)">value shown (sRGB)</text>
</g>"#,
        (LEFT + RIGHT) / 2.0,
        (TOP + BOTTOM) / 2.0
    )?;
    Ok(svg)
}
