//! One picture of a main column: its number against the varied quantity, or by case; a line or a row of points per method.

use anyhow::{Result, anyhow};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::table::Numbers;

const SIZE: (u32, u32) = (860, 420);
/// Room for the methods' names.
const LEGEND_PX: u32 = 190;
/// Colors that people who confuse red and green can tell apart (Okabe and Ito, Color Universal Design, 2008).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];

/// A point: where, how high, and the spread over the seeds.
type Point = (f64, f64, f64);

/// The picture of a column as SVG; `None` if there is nothing to show.
pub(super) fn svg(numbers: &Numbers<'_>, column: usize) -> Result<Option<String>> {
    let experiment = numbers.experiment;
    let c = &experiment.columns[column];
    let vary = experiment.vary.as_ref();
    // A number for every value, or places one after the other.
    let values: Option<Vec<f64>> = vary.and_then(|v| {
        let number = |x: &toml::Value| x.as_float().or_else(|| x.as_integer().map(|i| i as f64));
        let values: Option<Vec<f64>> = v.values.iter().map(number).collect();
        values.filter(|v| v.len() > 1)
    });
    let log_x = vary.is_some_and(|v| v.log);
    let n_values = vary.map_or(1, |v| v.values.len());
    let scale = |v: f64, log: bool| if log { v.log10() } else { v };

    let mut series: Vec<(String, Vec<Point>)> = Vec::new();
    for (m, method) in experiment.methods.iter().enumerate() {
        let point = |row: usize, x: f64| {
            let n = numbers.entry(row, m).and_then(|e| e.numbers[column])?;
            (n.mean.is_finite() && (!c.log || n.mean > 0.0)).then(|| (x, n.mean, n.spread.unwrap_or(0.0)))
        };
        match &values {
            Some(values) => {
                for (case, k) in experiment.cases.iter().enumerate() {
                    let points: Vec<Point> =
                        (0..n_values).filter_map(|v| point(case * n_values + v, scale(values[v], log_x))).collect();
                    let label = match experiment.cases.len() {
                        1 => method.label.clone(),
                        _ => format!("{}: {}", k.label, method.label),
                    };
                    series.push((label, points));
                }
            }
            None => {
                let aside = (m as f64 + 0.5) / experiment.methods.len() as f64 - 0.5;
                let points = (0..numbers.n_rows()).filter_map(|row| point(row, row as f64 + 0.7 * aside)).collect();
                series.push((method.label.clone(), points));
            }
        }
    }
    series.retain(|s| !s.1.is_empty());
    let all = || series.iter().flat_map(|s| &s.1);
    if all().next().is_none() {
        return Ok(None);
    }
    let y = |p: &Point, by: f64| scale(p.1 + by * p.2, c.log);
    let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
        let (below, above) = (y(p, -1.0), y(p, 1.0));
        (a.min(if below.is_finite() { below } else { y(p, 0.0) }), b.max(above))
    });
    let low = if c.log { low } else { low.min(0.0) };
    let pad = 0.06 * (high - low).max(1e-9);
    let y_range = (if c.log || low < 0.0 { low - pad } else { 0.0 })..high + pad;
    let x_range = match &values {
        Some(_) => {
            let (a, b) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p.0), b.max(p.0)));
            let pad = 0.03 * (b - a).max(1e-9);
            a - pad..b + pad
        }
        None => -0.5..numbers.n_rows() as f64 - 0.5,
    };
    draw(numbers, column, &series, x_range, y_range, values.is_some(), log_x).map(Some)
}

fn draw(
    numbers: &Numbers<'_>,
    column: usize,
    series: &[(String, Vec<Point>)],
    x_range: std::ops::Range<f64>,
    y_range: std::ops::Range<f64>,
    lines: bool,
    log_x: bool,
) -> Result<String> {
    let experiment = numbers.experiment;
    let c = &experiment.columns[column];
    let wrong = |e: &dyn std::fmt::Display| anyhow!("a plot cannot be drawn: {e}");
    let tick = |v: f64, log: bool| number(if log { 10f64.powf(v) } else { v });
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE).map_err(|e| wrong(&e))?;
        let (area, legend) = root.split_horizontally(SIZE.0 - LEGEND_PX);
        let mut chart = ChartBuilder::on(&area)
            .margin(12)
            .x_label_area_size(if lines { 44 } else { 34 })
            .y_label_area_size(64)
            .build_cartesian_2d(x_range.clone(), y_range.clone())
            .map_err(|e| wrong(&e))?;
        let rows = numbers.n_rows();
        let x_label = |x: &f64| match lines {
            true => tick(*x, log_x),
            false if (x - x.round()).abs() < 1e-6 && *x >= 0.0 && (*x as usize) < rows => {
                numbers.row_label(x.round() as usize)
            }
            false => String::new(),
        };
        let x_description = experiment.vary.as_ref().filter(|_| lines).map_or("", |v| v.label.as_str());
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(225, 225, 225))
            .x_labels(if lines { 7 } else { rows })
            .y_labels(7)
            .x_label_formatter(&x_label)
            .y_label_formatter(&|v| tick(*v, c.log))
            .x_desc(x_description)
            .y_desc(c.label.as_str())
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .draw()
            .map_err(|e| wrong(&e))?;
        let height = |v: f64| if c.log { v.max(1e-12).log10() } else { v }.clamp(y_range.start, y_range.end);
        for (i, (label, points)) in series.iter().enumerate() {
            let color = COLORS[i % COLORS.len()];
            if lines {
                chart
                    .draw_series(LineSeries::new(points.iter().map(|p| (p.0, height(p.1))), color.stroke_width(2)))
                    .map_err(|e| wrong(&e))?;
            }
            let bars = points.iter().filter(|p| p.2 > 0.0).map(|p| {
                PathElement::new(vec![(p.0, height(p.1 - p.2)), (p.0, height(p.1 + p.2))], color.stroke_width(1))
            });
            chart.draw_series(bars).map_err(|e| wrong(&e))?;
            let dots = points.iter().map(|p| Circle::new((p.0, height(p.1)), 4, color.filled()));
            chart.draw_series(dots).map_err(|e| wrong(&e))?;
            let y = 30 + 22 * i as i32;
            legend.draw(&Circle::new((8, y), 4, color.filled())).map_err(|e| wrong(&e))?;
            let style = ("sans-serif", 13).into_text_style(&legend).pos(Pos::new(HPos::PixelStatus, VPos::Center));
            legend.draw(&Text::new(label.clone(), (18, y), style)).map_err(|e| wrong(&e))?;
        }
        root.present().map_err(|e| wrong(&e))?;
    }
    Ok(svg)
}

/// A number in few characters.
fn number(v: f64) -> String {
    match v.abs() {
        a if a < 1e-12 => "0".to_owned(),
        a if !(1e-3..1e5).contains(&a) => format!("{v:.0e}"),
        a if a < 0.1 => format!("{v:.3}"),
        a if a < 10.0 => format!("{v:.2}"),
        _ => format!("{v:.0}"),
    }
}
