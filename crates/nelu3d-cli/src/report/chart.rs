//! Charts as SVG, in the colors of the page: lines, dots or bars over two axes with labels.

use std::fmt::Write;

use super::html::escape;
use super::number::short;

/// Size of the drawing, and of the margins left, top, right and below for labels.
const SIZE: [f64; 2] = [460.0, 250.0];
const MARGIN: [f64; 4] = [52.0, 12.0, 14.0, 40.0];

/// Colors of a file of its own; in a page the style sheet rules.
const FILE_STYLE: &str = "text{font:12px sans-serif;fill:#5d6673}line,.frame{stroke:#dfe3e8;fill:none}\
                          polyline{fill:none;stroke-width:1.6}.s0{stroke:#1f6f8b}.s1{stroke:#d55e00}.s2{stroke:#7a8b2f}\
                          .s3{stroke:#8a4f9e}.s4{stroke:#8a8f98}rect.s0{fill:#1f6f8b;stroke:none}\
                          .ideal{stroke:#8a8f98;stroke-dasharray:4 4}";

/// How a quantity runs along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By factors; only positive values are shown.
    Log,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// A line through its points.
    Line,
    /// A dashed gray line: what would be expected.
    Ideal,
    /// Bars from zero, each as wide as the step to the next.
    Bars,
}

/// Some points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Its name in the legend.
    pub label: String,
    /// Its points, by growing x.
    pub points: Vec<[f64; 2]>,
    /// How it is drawn.
    pub mark: Mark,
}

/// An axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Axis {
    /// What it shows, with the unit.
    pub label: String,
    /// How.
    pub scale: Scale,
}

impl Axis {
    /// A linear one.
    pub(crate) fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), scale: Scale::Linear }
    }

    /// A logarithmic one if the values are positive and span more than a factor of `over`.
    pub(crate) fn log_if_wide(label: &str, values: impl Iterator<Item = f64>, over: f64) -> Self {
        let (low, high) =
            values.filter(|v| v.is_finite()).fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        let scale = if low > 0.0 && high > over * low { Scale::Log } else { Scale::Linear };
        Self { label: label.to_owned(), scale }
    }

    fn at(&self, v: f64) -> f64 {
        if self.scale == Scale::Log { v.log10() } else { v }
    }

    /// Values to label between two positions: 1, 2 or 5 times a power of ten.
    fn ticks(&self, [low, high]: [f64; 2]) -> Vec<f64> {
        let span = high - low;
        if self.scale == Scale::Log {
            let decades = (low.floor() as i32..=high.ceil() as i32).map(|e| 10f64.powi(e));
            let steps: &[f64] = if span > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            return decades
                .flat_map(|d| steps.iter().map(move |s| s * d))
                .filter(|v| (low..=high).contains(&v.log10()))
                .collect();
        }
        let raw = span / 5.0;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= raw * 0.999).unwrap_or(raw);
        let first = (low / step - 1e-9).ceil() as i64;
        let last = (high / step + 1e-9).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// PixelStatus to right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// What is drawn.
    pub series: Vec<Series>,
}

impl Chart {
    /// A histogram: numbers of values in `bins` equal bins of `range`; values outside are left out.
    pub(crate) fn histogram(label: &str, values: &[f64], [low, high]: [f64; 2], bins: usize) -> Self {
        let mut counts = vec![0.0; bins];
        for &v in values.iter().filter(|v| (low..high).contains(v)) {
            counts[(((v - low) / (high - low) * bins as f64) as usize).min(bins - 1)] += 1.0;
        }
        let points =
            counts.iter().enumerate().map(|(i, &n)| [low + (high - low) * i as f64 / bins as f64, n]).collect();
        let series = Series { label: String::new(), points, mark: Mark::Bars };
        Self { x: Axis::linear(label), y: Axis::linear("points"), series: vec![series] }
    }

    /// For a page.
    pub(crate) fn svg(&self) -> String {
        self.draw("")
    }

    /// As a file of its own.
    pub(crate) fn as_file(&self) -> String {
        self.draw(&format!("<style>{FILE_STYLE}</style><rect width='100%' height='100%' fill='#fff'/>")).replacen(
            "<svg ",
            "<svg xmlns='http://www.w3.org/2000/svg' ",
            1,
        )
    }

    fn draw(&self, before: &str) -> String {
        let visible = |p: &&[f64; 2]| self.x.at(p[0]).is_finite() && self.y.at(p[1]).is_finite();
        let all = || self.series.iter().flat_map(|s| s.points.iter().filter(visible));
        if all().next().is_none() {
            return "<p class=note>There is nothing to draw.</p>".to_owned();
        }
        let bars = self.series.iter().any(|s| s.mark == Mark::Bars);
        let x = limits(all().map(|p| self.x.at(p[0])), false);
        let mut y = limits(all().map(|p| self.y.at(p[1])), true);
        if bars {
            y[0] = 0.0;
        }
        let [left, top, right, below] = MARGIN;
        let bar = bars.then(|| self.series[0].points.get(1).map_or(1.0, |p| p[0] - self.series[0].points[0][0]));
        let x = [x[0], x[1] + bar.unwrap_or(0.0)];
        let px = |v: f64| left + (self.x.at(v) - x[0]) / (x[1] - x[0]) * (SIZE[0] - left - right);
        let py = |v: f64| SIZE[1] - below - (self.y.at(v) - y[0]) / (y[1] - y[0]) * (SIZE[1] - top - below);
        let mut s = format!("<svg class=chart viewBox='0 0 {} {}' role=img>{before}", SIZE[0], SIZE[1])
            .replace("class=chart", "class='chart'")
            .replace("role=img", "role='img'");
        for v in self.x.ticks(x) {
            let at = px(v);
            let _ = write!(s, "<line x1='{at:.1}' x2='{at:.1}' y1='{top}' y2='{:.1}'/>", SIZE[1] - below);
            let _ = write!(
                s,
                "<text x='{at:.1}' y='{:.1}' text-anchor='middle'>{}</text>",
                SIZE[1] - below + 15.0,
                tick(v)
            );
        }
        for v in self.y.ticks(y) {
            let at = py(v);
            let _ = write!(s, "<line y1='{at:.1}' y2='{at:.1}' x1='{left}' x2='{:.1}'/>", SIZE[0] - right);
            let _ = write!(s, "<text x='{:.1}' y='{:.1}' text-anchor='end'>{}</text>", left - 5.0, at + 4.0, tick(v));
        }
        for (i, series) in self.series.iter().enumerate() {
            let class = if series.mark == Mark::Ideal { "ideal".to_owned() } else { format!("s{}", i % 5) };
            let points = series.points.iter().filter(visible);
            if let Some(width) = bar.filter(|_| series.mark == Mark::Bars) {
                for p in points {
                    let (a, b, t) = (px(p[0]), px(p[0] + width), py(p[1]));
                    let size = [(b - a - 0.6).max(0.4), (SIZE[1] - below - t).max(0.0)];
                    let _ = write!(
                        s,
                        "<rect class='{class}' x='{a:.1}' y='{t:.1}' width='{:.1}' height='{:.1}'/>",
                        size[0], size[1]
                    );
                }
            } else {
                let _ = write!(s, "<polyline class='{class}' points='");
                for p in points {
                    let _ = write!(s, "{:.1},{:.1} ", px(p[0]), py(p[1]));
                }
                s += "'/>";
            }
        }
        let middle = [(left + SIZE[0] - right) / 2.0, (top + SIZE[1] - below) / 2.0];
        let _ = write!(
            s,
            "<text x='{}' y='{}' text-anchor='middle'>{}</text>",
            middle[0],
            SIZE[1] - 6.0,
            escape(&self.x.label)
        );
        let _ = write!(
            s,
            "<text x='12' y='{0}' text-anchor='middle' transform='rotate(-90 12 {0})'>{1}</text></svg>",
            middle[1],
            escape(&self.y.label)
        );
        s
    }

    /// Which line is what; empty when there is but one.
    pub(crate) fn legend(&self) -> String {
        if self.series.len() < 2 {
            return String::new();
        }
        let items = self.series.iter().enumerate().fold(String::new(), |mut html, (i, s)| {
            let class = if s.mark == Mark::Ideal { "ideal".to_owned() } else { format!("s{}", i % 5) };
            let _ = write!(
                html,
                "<span><svg class=key viewBox='0 0 20 8'><polyline class='{class}' points='0,4 20,4'/></svg>{}</span>",
                escape(&s.label)
            );
            html
        });
        format!("<div class=legend>{items}</div>")
    }
}

/// The smallest interval around all values, never empty; a twentieth wider on both sides if `wider`.
fn limits(values: impl Iterator<Item = f64>, wider: bool) -> [f64; 2] {
    let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    let span = high - low;
    match (span > 0.0, wider) {
        (false, _) => [low - 0.5, high + 0.5],
        (true, false) => [low, high],
        (true, true) => [low - 0.05 * span, high + 0.05 * span],
    }
}

/// A label, without zeros that say nothing.
fn tick(v: f64) -> String {
    let text = short(v);
    match text.split_once('e') {
        None if text.contains('.') => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        _ => text,
    }
}

/// A small curve of a list of numbers, without axes.
pub(crate) fn curve(values: &[f64]) -> String {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let span = if high > low { high - low } else { 1.0 };
    let points = values.iter().enumerate().fold(String::new(), |mut s, (i, v)| {
        let x = 240.0 * i as f64 / (values.len() - 1) as f64;
        let _ = write!(s, "{x:.1},{:.1} ", 38.0 - 36.0 * (v - low) / span);
        s
    });
    format!(
        "<svg viewBox='0 0 240 40' class=curve><polyline points='{points}'/></svg> <span class=note>{} values, {} … \
         {}</span>",
        values.len(),
        short(low),
        short(high)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let linear = Axis::linear("x");
        assert_eq!(linear.ticks([0.0, 10.0]), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(linear.ticks([-0.5, 0.5]).len(), 5);
        let log = Axis::log_if_wide("x", [0.01, 100.0].into_iter(), 30.0);
        assert_eq!(log.scale, Scale::Log);
        assert_eq!(log.ticks([-2.0, 2.0]), [0.01, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(Axis::log_if_wide("x", [0.0, 100.0].into_iter(), 30.0).scale, Scale::Linear);
    }

    #[test]
    fn a_histogram_counts() {
        let chart = Chart::histogram("mm", &[-1.0, -0.9, 0.1, 0.2, 0.3, 1.0, 7.0, f64::NAN], [-1.0, 1.0], 4);
        assert_eq!(chart.series[0].points, [[-1.0, 2.0], [-0.5, 0.0], [0.0, 3.0], [0.5, 0.0]]);
        let svg = chart.svg();
        assert_eq!(svg.matches("<rect class='s0'").count(), 4);
        assert!(chart.as_file().starts_with("<svg xmlns="));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn odd_values_draw_nothing_odd() {
        let line = |points: &[[f64; 2]]| Chart {
            x: Axis::linear("a < b"),
            y: Axis::log_if_wide("y", points.iter().map(|p| p[1]), 30.0),
            series: vec![Series { label: "l".to_owned(), points: points.to_vec(), mark: Mark::Line }],
        };
        assert!(line(&[]).svg().contains("nothing to draw"));
        assert!(line(&[[f64::NAN, 1.0]]).svg().contains("nothing to draw"));
        for points in
            [vec![[1.0, 1.0]], vec![[1.0, 0.001], [2.0, f64::INFINITY], [3.0, 1.0]], vec![[0.0, 0.0], [1.0, 0.0]]]
        {
            let svg = line(&points).svg();
            assert!(svg.contains("a &lt; b") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}
