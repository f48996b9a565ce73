//! Curves of a result: losses, error over time, calibration of the uncertainty.

use nelu3d::Surface;
use nelu3d_evaluate::{GroundTruth, TracePoint};
use nelu3d_scan::statistics::within_sigmas;
use serde_json::Value;

use crate::chart::{Chart, ChartAxis, ChartMark, ChartSeries};
use crate::html::figure;
use crate::page;

/// Shows loss and error by iteration and time, and whether 1σ is calibrated, as far as they are known.
pub(super) fn section(
    method: &Value,
    trace: Option<&[TracePoint]>,
    surface: &Surface,
    truth: Option<&GroundTruth>,
) -> String {
    let mut html = String::new();
    let mut add = |name: &str, note: &str, chart: Chart| {
        html += &figure(name, note, &(chart.svg() + &chart.legend()));
    };
    let losses = losses(method);
    if !losses.is_empty() {
        let values = || losses.iter().flat_map(|s| s.points.iter().map(|p| p[1]));
        let y = ChartAxis::log_if_wide("loss", values(), 20.0);
        add("Loss", "by iteration", Chart { x: ChartAxis::linear("iteration"), y, series: losses.clone() });
    }
    if let Some(trace) = trace.filter(|t| t.len() > 1) {
        let series = |label: &str, value: &dyn Fn(&TracePoint) -> f64| ChartSeries {
            label: label.to_owned(),
            points: trace.iter().map(|p| [p.wall_secs, value(p)]).collect(),
            spread: Vec::new(),
            mark: ChartMark::Line,
        };
        let series = vec![
            series("mean, whole", &|p| p.mae),
            series("RMS, whole", &|p| p.rmse),
            series("median, body", &|p| p.body_median),
        ];
        let values = || series.iter().flat_map(|s| s.points.iter().map(|p| p[1]));
        let y = ChartAxis::log_if_wide("error, mm", values(), 10.0);
        add("Error", "by time since the start", Chart { x: ChartAxis::linear("s"), y, series: series.clone() });
    }
    if let Some(chart) = truth.and_then(|truth| calibration(surface, truth)) {
        add("Is 1σ calibrated?", "fraction of errors within n σ", chart);
    }
    if html.is_empty() { html } else { page::section("Curves", &format!("<div class=grid>{html}</div>")) }
}

/// Finds the losses on record: a list of numbers, one an iteration, or of records that have an `iteration` and several
/// losses.
fn losses(method: &Value) -> Vec<ChartSeries> {
    let line = |label: &str, points: Vec<[f64; 2]>| ChartSeries {
        label: label.to_owned(),
        points,
        spread: Vec::new(),
        mark: ChartMark::Line,
    };
    let numbers = |label: &str, list: &[Value]| {
        let point = |(i, v): (usize, &Value)| Some([i as f64 + 1.0, v.as_f64()?]);
        line(label, list.iter().enumerate().filter_map(point).collect())
    };
    let series = match method.get("losses") {
        Some(Value::Array(list)) if list.iter().all(Value::is_number) => vec![numbers("total", list)],
        Some(Value::Array(records)) => ["image", "mask", "eikonal", "sparsity"]
            .iter()
            .map(|&key| {
                let point = |r: &Value| Some([r.get("iteration")?.as_f64()?, r.get(key)?.as_f64()?]);
                line(key, records.iter().filter_map(point).collect())
            })
            .collect(),
        Some(Value::Object(map)) => map.iter().filter_map(|(k, v)| Some(numbers(k, v.as_array()?))).collect::<Vec<_>>(),
        _ => Vec::new(),
    };
    series.into_iter().filter(|s| s.points.len() > 1 && s.points.iter().any(|p| p[1] != 0.0)).collect()
}

/// Plots the fraction of errors within n σ against n, with what Gaussian errors would give; `None` without errors.
fn calibration(result: &Surface, truth: &GroundTruth) -> Option<Chart> {
    let ratio = |i: usize| f64::from((result.depth[i] - truth.depth[i]).abs() / result.sigma[i]);
    let mut ratios: Vec<f64> =
        (0..result.depth.len()).filter(|&i| truth.mask[i]).map(ratio).filter(|r| r.is_finite()).collect();
    if ratios.is_empty() {
        return None;
    }
    ratios.sort_by(f64::total_cmp);
    let within = |n: f64| ratios.partition_point(|&r| r <= n) as f64 / ratios.len() as f64;
    let steps = || (0..=40).map(|i| 0.1 * f64::from(i));
    let line = |label: &str, points: Vec<[f64; 2]>, mark| ChartSeries {
        label: label.to_owned(),
        points,
        spread: Vec::new(),
        mark,
    };
    Some(Chart {
        x: ChartAxis::linear("σ"),
        y: ChartAxis::linear("fraction of pixels"),
        series: vec![
            line("measured", steps().map(|n| [n, within(n)]).collect(), ChartMark::Line),
            line("Gaussian", steps().map(|n| [n, within_sigmas(n)]).collect(), ChartMark::Ideal),
        ],
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::ball;
    use super::*;

    #[test]
    fn losses_of_every_method_are_found() {
        let of = |v: Value| losses(&serde_json::json!({ "losses": v }));
        assert_eq!(of(serde_json::json!([3.0, 2.0, 1.0]))[0].points, [[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]]);
        let record =
            |i: i32, image: f64| serde_json::json!({ "iteration": i, "image": image, "eikonal": 0.5, "rays": 7 });
        let several = of(serde_json::json!([record(1, 0.5), record(101, 0.25)]));
        assert_eq!(several.iter().map(|s| s.label.as_str()).collect::<Vec<_>>(), ["image", "eikonal"]);
        assert_eq!(several[0].points, [[1.0, 0.5], [101.0, 0.25]]);
        assert!(of(Value::Null).is_empty() && of(serde_json::json!([1.0])).is_empty());
    }

    #[test]
    fn sigmas_have_their_fractions() {
        for (n, fraction) in [(0.0, 0.0), (1.0, 0.682_689_5), (2.0, 0.954_499_7), (3.0, 0.997_300_2)] {
            assert!((within_sigmas(n) - fraction).abs() < 1e-6, "{n}");
        }
        // Errors of one σ everywhere: a step from nothing to all.
        let (mut result, _, truth) = ball();
        result.depth = truth.depth.iter().map(|z| z + 0.2).collect();
        result.sigma = vec![0.19; truth.depth.len()];
        let chart = calibration(&result, &truth).unwrap();
        let measured = &chart.series[0].points;
        assert_eq!((measured[10][1], measured[11][1]), (0.0, 1.0));
    }
}
