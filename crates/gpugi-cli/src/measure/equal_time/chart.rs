//! Error over time as a chart: still pictures beside live frames, a line per set.

use std::ops::Range;
use std::path::Path;

use anyhow::Context;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::Report;

const SIZE: (u32, u32) = (1200, 520);
const BLACK_TEXT: RGBColor = RGBColor(32, 32, 32);
/// Lines that people tell apart, colour-blind or not: Okabe and Ito's palette.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// A line: its name, and points of time (ms) and error.
type Line = (String, Vec<(f64, f64)>);

type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Writes the chart of a report.
pub fn write(path: &Path, report: &Report<'_>) -> anyhow::Result<()> {
    let mut text = String::new();
    draw(&mut text, report).map_err(|error| anyhow::anyhow!("the chart: {error}"))?;
    std::fs::write(path, text).with_context(|| path.display().to_string())
}

fn draw(text: &mut String, report: &Report<'_>) -> Result<(), Box<dyn std::error::Error>> {
    let still = report.compared.still.iter().map(|row| {
        let points = row
            .points
            .iter()
            .map(|point| (point.milliseconds, point.flip));
        (row.set.clone(), points.collect())
    });
    let live = report.compared.live.iter().map(|row| {
        let points = row
            .points
            .iter()
            .map(|point| (point.milliseconds, point.moving));
        (row.set.clone(), points.collect())
    });
    let [width, height] = report.size;
    let area = SVGBackend::with_string(text, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let title = format!("{}, {width}x{height}, {}", report.scene, report.adapter);
    let area = area.titled(&title, ("sans-serif", 20).into_font().color(&BLACK_TEXT))?;
    let (left, right) = area.split_horizontally(SIZE.0 / 2);
    panel(
        &left,
        "still picture",
        "time from stale maps on (ms)",
        still.collect(),
    )?;
    panel(
        &right,
        "frame in motion",
        "GPU time per frame (ms)",
        live.collect(),
    )?;
    area.present()?;
    Ok(())
}

/// Draws lines on logarithmic axes.
fn panel(
    area: &Panel<'_>,
    title: &str,
    of_time: &str,
    lines: Vec<Line>,
) -> Result<(), Box<dyn std::error::Error>> {
    let points = || lines.iter().flat_map(|(_, points)| points);
    let times = range(points().map(|point| point.0));
    let errors = range(points().map(|point| point.1));
    let (Some(times), Some(errors)) = (times, errors) else {
        return Ok(());
    };
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 17).into_font().color(&BLACK_TEXT))
        .margin(12)
        .x_label_area_size(45)
        .y_label_area_size(60)
        .build_cartesian_2d(
            times.clone().log_scale().with_key_points(ticks(&times)),
            errors.clone().log_scale().with_key_points(ticks(&errors)),
        )?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(240, 240, 240))
        .bold_line_style(RGBColor(215, 215, 215))
        .label_style(("sans-serif", 13).into_font().color(&BLACK_TEXT))
        .x_desc(of_time)
        .y_desc("HDR-FLIP")
        .x_label_formatter(&|value| short(*value))
        .y_label_formatter(&|value| short(*value))
        .draw()?;
    for (index, (name, points)) in lines.into_iter().enumerate() {
        let color = COLORS[index % COLORS.len()];
        let style = color.stroke_width(2);
        chart
            .draw_series(LineSeries::new(points.clone(), style))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], style));
        let marks = points.into_iter();
        chart.draw_series(marks.map(|point| Circle::new(point, 3, color.filled())))?;
    }
    chart
        .configure_series_labels()
        .label_font(("sans-serif", 13).into_font().color(&BLACK_TEXT))
        .background_style(WHITE.mix(0.8))
        .border_style(RGBColor(215, 215, 215))
        .draw()?;
    Ok(())
}

/// A range that holds all values, with room around them.
fn range(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let values = values.filter(|value| *value > 0.0 && value.is_finite());
    let (least, most) = values.fold((f64::INFINITY, 0.0_f64), |(least, most), value| {
        (least.min(value), most.max(value))
    });
    // Two ticks lie in a factor of five.
    let middle = (least * most).sqrt();
    (most > 0.0).then(|| (least / 1.3).min(middle / 2.3)..(most * 1.3).max(middle * 2.3))
}

/// 1, 2 and 5 times powers of ten.
fn ticks(range: &Range<f64>) -> Vec<f64> {
    let decades = range.start.log10().floor() as i32..=range.end.log10().ceil() as i32;
    let ticks = decades.flat_map(|decade| [1.0, 2.0, 5.0].map(|digit| digit * 10_f64.powi(decade)));
    ticks.filter(|tick| range.contains(tick)).collect()
}

/// A number in few digits.
fn short(value: f64) -> String {
    match value {
        value if value >= 1.0 => format!("{value:.0}"),
        value => {
            let text = format!("{value:.4}");
            text.trim_end_matches('0').to_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_two_ticks_at_least() {
        for values in [
            [0.18, 0.65],
            [0.3, 0.3],
            [0.0, 33.0],
            [7e-4, 2e4],
            [f64::NAN, 1.0],
        ] {
            let range = range(values.into_iter()).unwrap();
            let ticks = ticks(&range);
            assert!(ticks.len() >= 2, "{values:?}: {ticks:?}");
            assert!(ticks.is_sorted());
            let shown = values.into_iter().filter(|value| *value > 0.0);
            assert!(shown.into_iter().all(|value| range.contains(&value)));
        }
        assert!(range([0.0, f64::INFINITY].into_iter()).is_none());
        assert_eq!(
            [0.005, 0.2, 5.0, 200.0].map(short),
            ["0.005", "0.2", "5", "200"]
        );
    }
}
