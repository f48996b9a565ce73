//! One chart of a main column: its number against the varied quantity, or by case; a line or a row of points per
//! method.

use super::table::ExperimentNumbers;
use nelu3d_report::chart::{AxisScale, Chart, ChartAxis, ChartMark, ChartSeries};

/// Returns the chart of a column; `None` if there is nothing to show.
pub(super) fn chart(numbers: &ExperimentNumbers<'_>, column: usize) -> Option<Chart> {
    let experiment = numbers.experiment;
    let column_is_log = experiment.columns[column].log;
    // A number for every value, or places one after the other.
    let values = varied_values(numbers);
    let mut series = Vec::new();
    for (m, method) in experiment.methods.iter().enumerate() {
        // Row and position of every point.
        let lines: Vec<(String, Vec<(usize, f64)>)> = match &values {
            Some(values) => {
                let line = |case: usize, label: &str| {
                    let label = match experiment.cases.len() {
                        1 => method.label.clone(),
                        _ => format!("{label}: {}", method.label),
                    };
                    (label, values.iter().enumerate().map(|(v, &x)| (case * values.len() + v, x)).collect())
                };
                experiment.cases.iter().enumerate().map(|(case, k)| line(case, &k.label)).collect()
            }
            None => {
                let aside = (m as f64 + 0.5) / experiment.methods.len() as f64 - 0.5;
                let points = (0..numbers.n_rows()).map(|row| (row, row as f64 + 0.7 * aside)).collect();
                vec![(method.label.clone(), points)]
            }
        };
        for (label, rows) in lines {
            let mark = if values.is_some() { ChartMark::LineAndDots } else { ChartMark::Dots };
            let mut line = ChartSeries { label, points: Vec::new(), spread: Vec::new(), mark };
            for (row, x) in rows {
                let Some(n) = numbers.entry(row, m).and_then(|e| e.numbers[column]) else { continue };
                if n.mean.is_finite() && (!column_is_log || n.mean > 0.0) {
                    line.points.push([x, n.mean]);
                    line.spread.push(n.spread.unwrap_or(0.0));
                }
            }
            if !line.points.is_empty() {
                series.push(line);
            }
        }
    }
    let scale = |log: bool| if log { AxisScale::Log } else { AxisScale::Linear };
    let vary = experiment.vary.as_ref();
    let x = match values {
        Some(_) => {
            let log = vary.is_some_and(|v| v.log);
            ChartAxis { scale: scale(log), ..ChartAxis::linear(vary.map_or("", |v| v.label.as_str())) }
        }
        None => ChartAxis {
            names: (0..numbers.n_rows()).map(|row| numbers.row_label(row)).collect(),
            ..ChartAxis::default()
        },
    };
    let y = ChartAxis {
        scale: scale(column_is_log),
        from_zero: true,
        ..ChartAxis::linear(&experiment.columns[column].label)
    };
    (!series.is_empty()).then_some(Chart { x, y, series })
}

/// Returns the values of the varied quantity, if there are several and all of them are numbers.
fn varied_values(numbers: &ExperimentNumbers<'_>) -> Option<Vec<f64>> {
    let number = |x: &toml::Value| x.as_float().or_else(|| x.as_integer().map(|i| i as f64));
    let values: Option<Vec<f64>> = numbers.experiment.vary.as_ref()?.values.iter().map(number).collect();
    values.filter(|v| v.len() > 1)
}
