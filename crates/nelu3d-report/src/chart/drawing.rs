//! Charts drawn as SVG.

use std::fmt::Write;

use super::axis::ChartAxis;
use super::series::{ChartMark, ChartSeries};
use crate::html::escape;

/// Width and height of the drawing.
const SIZE: [f64; 2] = [460.0, 250.0];
/// Margins left, top, right and below, for labels.
const MARGIN: [f64; 4] = [52.0, 12.0, 14.0, 40.0];
/// Legend of a file of its own, at its right: height of a line, room before a name, and widest letter of it.
const LEGEND_PX: [f64; 3] = [18.0, 24.0, 6.6];
/// Colors of a file of its own; in a page the style sheet rules.
const FILE_STYLE: &str = "text{font:12px sans-serif;fill:#5d6673}line,.frame{stroke:#dfe3e8;fill:none}\
                          polyline{fill:none;stroke-width:1.6}.s0{stroke:#1f6f8b;fill:#1f6f8b}\
                          .s1{stroke:#d55e00;fill:#d55e00}.s2{stroke:#7a8b2f;fill:#7a8b2f}.s3{stroke:#8a4f9e;fill:#8a4f9e}\
                          .s4{stroke:#8a8f98;fill:#8a8f98}.s5{stroke:#56b4e9;fill:#56b4e9}.s6{stroke:#e69f00;fill:#e69f00}\
                          polyline.s0,polyline.s1,polyline.s2,polyline.s3,polyline.s4,polyline.s5,polyline.s6{fill:none}\
                          polyline.d1{stroke-dasharray:7 3}polyline.d2{stroke-dasharray:2 3}rect.s0{stroke:none}\
                          .ideal{stroke:#8a8f98;stroke-dasharray:4 4}";

/// A chart: series over two axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The axis from left to right.
    pub x: ChartAxis,
    /// The axis upwards.
    pub y: ChartAxis,
    /// The series that are drawn.
    pub series: Vec<ChartSeries>,
}

impl Chart {
    /// Creates a histogram: numbers of values in `bins` equal bins of a range; values outside are not counted.
    pub fn histogram(label: &str, values: &[f64], [low, high]: [f64; 2], bins: usize) -> Self {
        let mut counts = vec![0.0; bins];
        for &v in values.iter().filter(|v| (low..high).contains(v)) {
            counts[(((v - low) / (high - low) * bins as f64) as usize).min(bins - 1)] += 1.0;
        }
        let points =
            counts.iter().enumerate().map(|(i, &n)| [low + (high - low) * i as f64 / bins as f64, n]).collect();
        let series = ChartSeries { label: String::new(), points, spread: Vec::new(), mark: ChartMark::Bars };
        Self { x: ChartAxis::linear(label), y: ChartAxis::linear("points"), series: vec![series] }
    }

    /// Draws the chart for a page.
    pub fn svg(&self) -> String {
        self.draw("", SIZE)
    }

    /// Draws the chart as a file of its own, with the names of its series if there are several.
    pub fn as_file(&self) -> String {
        let mut before = format!("<style>{FILE_STYLE}</style><rect width='100%' height='100%' fill='#fff'/>");
        if self.series.len() < 2 {
            return with_namespace(&self.draw(&before, SIZE));
        }
        let [line, before_name, letter] = LEGEND_PX;
        for (i, series) in self.series.iter().enumerate() {
            let (x, y) = (SIZE[0] + 4.0, 24.0 + line * i as f64);
            let class = series.class(i);
            let _ = write!(before, "<polyline class='{class}' points='{x},{y} {},{y}'/>", x + 16.0);
            let _ = write!(before, "<text x='{}' y='{}'>{}</text>", x + 20.0, y + 4.0, escape(&series.label));
        }
        let longest = self.series.iter().map(|s| s.label.chars().count()).max().unwrap_or(0);
        let right = SIZE[0] + before_name + letter * longest as f64;
        let low = 24.0 + line * self.series.len() as f64;
        with_namespace(&self.draw(&before, [right.ceil(), SIZE[1].max(low)]))
    }

    /// Draws the chart after the elements `before`, in the upper left of a picture of a size.
    fn draw(&self, before: &str, [width, height]: [f64; 2]) -> String {
        let Some(plot) = Plot::new(self) else {
            return "<p class=note>There is nothing to draw.</p>".to_owned();
        };
        let mut s = format!("<svg class='chart' viewBox='0 0 {width} {height}' role='img'>{before}");
        plot.grid(&mut s);
        for (i, series) in self.series.iter().enumerate() {
            plot.series(series, &series.class(i), &mut s);
        }
        plot.labels(&mut s);
        s
    }

    /// Returns which line is what; empty when there is only one.
    pub fn legend(&self) -> String {
        if self.series.len() < 2 {
            return String::new();
        }
        let items = self.series.iter().enumerate().fold(String::new(), |mut html, (i, s)| {
            let class = s.class(i);
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

/// A chart with the ranges that are shown.
struct Plot<'a> {
    chart: &'a Chart,
    /// Range of positions along x.
    x: [f64; 2],
    /// Range of positions along y.
    y: [f64; 2],
    /// Width of a bar, where there are bars.
    bar: Option<f64>,
}

impl<'a> Plot<'a> {
    /// Chooses the ranges; `None` if there is nothing to draw.
    fn new(chart: &'a Chart) -> Option<Self> {
        let (x_axis, y_axis) = (&chart.x, &chart.y);
        let visible = |p: &&[f64; 2]| x_axis.at(p[0]).is_finite() && y_axis.at(p[1]).is_finite();
        let all = || chart.series.iter().flat_map(|s| s.points.iter().filter(visible));
        all().next()?;
        let bars = chart.series.iter().any(|s| s.mark == ChartMark::Bars);
        let x = x_axis.limits(all().map(|p| x_axis.at(p[0])), false);
        let ends = chart.series.iter().flat_map(|s| {
            let ends = s.points.iter().zip(&s.spread).filter(|(p, _)| visible(p));
            ends.flat_map(|(p, spread)| [p[1] - spread, p[1] + spread]).map(|v| y_axis.at(v))
        });
        let mut y = y_axis.limits(all().map(|p| y_axis.at(p[1])).chain(ends), true);
        if bars {
            y[0] = 0.0;
        }
        let bar = bars.then(|| chart.series[0].points.get(1).map_or(1.0, |p| p[0] - chart.series[0].points[0][0]));
        Some(Self { chart, x: [x[0], x[1] + bar.unwrap_or(0.0)], y, bar })
    }

    fn px(&self, v: f64) -> f64 {
        let [left, _, right, _] = MARGIN;
        left + (self.chart.x.at(v) - self.x[0]) / (self.x[1] - self.x[0]) * (SIZE[0] - left - right)
    }

    fn py(&self, v: f64) -> f64 {
        let [_, top, _, below] = MARGIN;
        SIZE[1] - below - (self.chart.y.at(v) - self.y[0]) / (self.y[1] - self.y[0]) * (SIZE[1] - top - below)
    }

    fn visible(&self, p: &[f64; 2]) -> bool {
        self.chart.x.at(p[0]).is_finite() && self.chart.y.at(p[1]).is_finite()
    }

    /// Draws lines with their values.
    fn grid(&self, s: &mut String) {
        let [left, top, right, below] = MARGIN;
        for v in self.chart.x.ticks(self.x) {
            let at = self.px(v);
            let _ = write!(s, "<line x1='{at:.1}' x2='{at:.1}' y1='{top}' y2='{:.1}'/>", SIZE[1] - below);
            let _ = write!(
                s,
                "<text x='{at:.1}' y='{:.1}' text-anchor='middle'>{}</text>",
                SIZE[1] - below + 15.0,
                self.chart.x.tick(v)
            );
        }
        for v in self.chart.y.ticks(self.y) {
            let at = self.py(v);
            let _ = write!(s, "<line y1='{at:.1}' y2='{at:.1}' x1='{left}' x2='{:.1}'/>", SIZE[0] - right);
            let _ = write!(
                s,
                "<text x='{:.1}' y='{:.1}' text-anchor='end'>{}</text>",
                left - 5.0,
                at + 4.0,
                self.chart.y.tick(v)
            );
        }
    }

    /// Draws a series.
    fn series(&self, series: &ChartSeries, class: &str, s: &mut String) {
        if let Some(width) = self.bar.filter(|_| series.mark == ChartMark::Bars) {
            return self.bars(series, class, width, s);
        }
        if series.mark != ChartMark::Dots {
            let _ = write!(s, "<polyline class='{class}' points='");
            for p in series.points.iter().filter(|p| self.visible(p)) {
                let _ = write!(s, "{:.1},{:.1} ", self.px(p[0]), self.py(p[1]));
            }
            *s += "'/>";
        }
        if matches!(series.mark, ChartMark::Dots | ChartMark::LineAndDots) {
            self.dots(series, class, s);
        }
    }

    fn bars(&self, series: &ChartSeries, class: &str, width: f64, s: &mut String) {
        let below = MARGIN[3];
        for p in series.points.iter().filter(|p| self.visible(p)) {
            let (a, b, t) = (self.px(p[0]), self.px(p[0] + width), self.py(p[1]));
            let size = [(b - a - 0.6).max(0.4), (SIZE[1] - below - t).max(0.0)];
            let _ = write!(
                s,
                "<rect class='{class}' x='{a:.1}' y='{t:.1}' width='{:.1}' height='{:.1}'/>",
                size[0], size[1]
            );
        }
    }

    fn dots(&self, series: &ChartSeries, class: &str, s: &mut String) {
        let below = MARGIN[3];
        for (k, p) in series.points.iter().enumerate().filter(|(_, p)| self.visible(p)) {
            let (at, spread) = (self.px(p[0]), series.spread.get(k).copied().unwrap_or(0.0));
            let _ = write!(s, "<circle class='{class}' cx='{at:.1}' cy='{:.1}' r='3'/>", self.py(p[1]));
            if spread > 0.0 {
                // Below zero there is no logarithm: down to the frame.
                let low = p[1] - spread;
                let low = if self.chart.y.at(low).is_finite() { self.py(low) } else { SIZE[1] - below };
                let high = self.py(p[1] + spread);
                let _ = write!(s, "<polyline class='{class}' points='{at:.1},{low:.1} {at:.1},{high:.1}'/>");
            }
        }
    }

    /// Draws the names of the axes and ends the drawing.
    fn labels(&self, s: &mut String) {
        let [left, top, right, below] = MARGIN;
        let middle = [(left + SIZE[0] - right) / 2.0, (top + SIZE[1] - below) / 2.0];
        let _ = write!(
            s,
            "<text x='{}' y='{}' text-anchor='middle'>{}</text>",
            middle[0],
            SIZE[1] - 6.0,
            escape(&self.chart.x.label)
        );
        let _ = write!(
            s,
            "<text x='12' y='{0}' text-anchor='middle' transform='rotate(-90 12 {0})'>{1}</text></svg>",
            middle[1],
            escape(&self.chart.y.label)
        );
    }
}

/// Adds the name of the language, which a file needs and a page has.
fn with_namespace(svg: &str) -> String {
    svg.replacen("<svg ", "<svg xmlns='http://www.w3.org/2000/svg' ", 1)
}

#[cfg(test)]
mod tests {
    use super::super::axis::AxisScale;
    use super::*;

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
            x: ChartAxis::linear("a < b"),
            y: ChartAxis::log_if_wide("y", points.iter().map(|p| p[1]), 30.0),
            series: vec![ChartSeries {
                label: "l".to_owned(),
                points: points.to_vec(),
                spread: vec![],
                mark: ChartMark::Line,
            }],
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

    /// Methods against named cases, one of them with a spread that reaches below zero.
    #[test]
    fn dots_have_names_and_spreads() {
        let series = |label: &str, y: f64, spread: f64| ChartSeries {
            label: label.to_owned(),
            points: vec![[0.0, y], [1.0, 2.0 * y]],
            spread: vec![spread, 0.0],
            mark: ChartMark::Dots,
        };
        for scale in [AxisScale::Linear, AxisScale::Log] {
            let chart = Chart {
                x: ChartAxis { names: vec!["plane".to_owned(), "a & b".to_owned()], ..ChartAxis::linear("") },
                y: ChartAxis { scale, from_zero: true, ..ChartAxis::linear("mm") },
                series: vec![series("first", 1.0, 0.2), series("second", 3.0, 5.0)],
            };
            let svg = chart.svg();
            assert_eq!((svg.matches("<circle class='s1'").count(), svg.matches("<polyline").count()), (2, 2));
            assert!(svg.contains(">plane<") && svg.contains(">a &amp; b<") && !svg.contains("NaN"), "{svg}");
            assert!(!svg.contains("second") && chart.as_file().contains(">second</text>"));
        }
    }

    #[test]
    fn many_series_are_told_apart_and_have_room_for_their_names() {
        let series = |i: usize| ChartSeries {
            label: format!("a method with a long name under pattern {i}"),
            points: vec![[0.0, 1.0], [1.0, i as f64]],
            spread: Vec::new(),
            mark: ChartMark::Line,
        };
        let (x, y) = (ChartAxis::linear("x"), ChartAxis::linear("y"));
        let chart = Chart { x, y, series: (0..16).map(series).collect() };
        let classes: std::collections::HashSet<String> = (0..16).map(|i| chart.series[i].class(i)).collect();
        assert_eq!(classes.len(), 16);
        let file = chart.as_file();
        // 42 letters, 16 lines.
        let size = file.split("viewBox='0 0 ").nth(1).unwrap().split('\'').next().unwrap();
        let size: Vec<f64> = size.split(' ').map(|n| n.parse().unwrap()).collect();
        assert!(size[0] >= SIZE[0] + 42.0 * 6.0 && size[1] >= 24.0 + 16.0 * 18.0, "{size:?}");
        assert!(chart.svg().contains(&format!("viewBox='0 0 {} {}'", SIZE[0], SIZE[1])));
    }
}
