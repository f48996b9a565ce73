//! Charts as SVG, in the colors of the page: lines, dots or bars over two axes with labels.
//!
//! The only place where charts are drawn: reports, evaluations and experiments describe theirs as a [`Chart`].

use std::fmt::Write;

use super::html::escape;
use super::number::short;

/// Size of the drawing, and of the margins left, top, right and below for labels.
const SIZE: [f64; 2] = [460.0, 250.0];
const MARGIN: [f64; 4] = [52.0, 12.0, 14.0, 40.0];
/// Room for the names of series, at the right of a file of its own.
const LEGEND_PX: f64 = 150.0;
/// Number of colors, after which they repeat (Okabe and Ito, Color Universal Design, 2008, and two grays).
const N_COLORS: usize = 7;

/// Colors of a file of its own; in a page the style sheet rules.
const FILE_STYLE: &str = "text{font:12px sans-serif;fill:#5d6673}line,.frame{stroke:#dfe3e8;fill:none}\
                          polyline{fill:none;stroke-width:1.6}.s0{stroke:#1f6f8b;fill:#1f6f8b}\
                          .s1{stroke:#d55e00;fill:#d55e00}.s2{stroke:#7a8b2f;fill:#7a8b2f}.s3{stroke:#8a4f9e;fill:#8a4f9e}\
                          .s4{stroke:#8a8f98;fill:#8a8f98}.s5{stroke:#56b4e9;fill:#56b4e9}.s6{stroke:#e69f00;fill:#e69f00}\
                          polyline.s0,polyline.s1,polyline.s2,polyline.s3,polyline.s4,polyline.s5,polyline.s6{fill:none}\
                          rect.s0{stroke:none}.ideal{stroke:#8a8f98;stroke-dasharray:4 4}";

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
    /// A dot for each point, with its spread as a line up and down.
    Dots,
    /// Dots with their spread, and a line through them.
    LineAndDots,
}

/// Some points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Its name in the legend.
    pub label: String,
    /// Its points, by growing x.
    pub points: Vec<[f64; 2]>,
    /// How far each dot's line reaches up and down; empty for none.
    pub spread: Vec<f64>,
    /// How it is drawn.
    pub mark: Mark,
}

impl Series {
    /// The class that gives the i-th series its color.
    fn class(&self, i: usize) -> String {
        if self.mark == Mark::Ideal { "ideal".to_owned() } else { format!("s{}", i % N_COLORS) }
    }
}

/// An axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Axis {
    /// What it shows, with the unit.
    pub label: String,
    /// How.
    pub scale: Scale,
    /// Names of the positions 0, 1, 2 … instead of numbers; empty for numbers.
    pub names: Vec<String>,
    /// Whether a linear axis shows zero, whatever the values.
    pub from_zero: bool,
}

impl Axis {
    /// A linear one.
    pub(crate) fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), ..Self::default() }
    }

    /// A logarithmic one if the values are positive and span more than a factor of `over`.
    pub(crate) fn log_if_wide(label: &str, values: impl Iterator<Item = f64>, over: f64) -> Self {
        let (low, high) =
            values.filter(|v| v.is_finite()).fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        let scale = if low > 0.0 && high > over * low { Scale::Log } else { Scale::Linear };
        Self { label: label.to_owned(), scale, ..Self::default() }
    }

    fn at(&self, v: f64) -> f64 {
        if self.scale == Scale::Log { v.log10() } else { v }
    }

    /// Values to label between two positions: 1, 2 or 5 times a power of ten.
    fn ticks(&self, [low, high]: [f64; 2]) -> Vec<f64> {
        let span = high - low;
        if !self.names.is_empty() {
            return (0..self.names.len()).map(|i| i as f64).collect();
        }
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

    /// The positions that are shown, for values at these; wider by a twentieth if `wider`.
    fn limits(&self, values: impl Iterator<Item = f64>, wider: bool) -> [f64; 2] {
        if !self.names.is_empty() {
            return [-0.5, self.names.len() as f64 - 0.5];
        }
        let [low, high] = limits(values.filter(|v| v.is_finite()), wider);
        if !self.from_zero || self.scale == Scale::Log {
            return [low, high];
        }
        // What lies at zero but for the widening begins there.
        let span = high - low;
        [if low < -0.06 * span { low } else { 0.0 }, high.max(0.0)]
    }

    /// What is written at a value of [`Axis::ticks`].
    fn tick(&self, v: f64) -> String {
        self.names.get(v as usize).map_or_else(|| tick(v), |name| escape(name))
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
        let series = Series { label: String::new(), points, spread: Vec::new(), mark: Mark::Bars };
        Self { x: Axis::linear(label), y: Axis::linear("points"), series: vec![series] }
    }

    /// For a page.
    pub(crate) fn svg(&self) -> String {
        self.draw("", 0.0)
    }

    /// As a file of its own, with the names of its series if there are several.
    pub(crate) fn as_file(&self) -> String {
        let mut before = format!("<style>{FILE_STYLE}</style><rect width='100%' height='100%' fill='#fff'/>");
        if self.series.len() < 2 {
            return with_namespace(&self.draw(&before, 0.0));
        }
        for (i, series) in self.series.iter().enumerate() {
            let (x, y) = (SIZE[0] + 4.0, 24.0 + 18.0 * i as f64);
            let class = series.class(i);
            let _ = write!(before, "<polyline class='{class}' points='{x},{y} {},{y}'/>", x + 16.0);
            let _ = write!(before, "<text x='{}' y='{}'>{}</text>", x + 20.0, y + 4.0, escape(&series.label));
        }
        with_namespace(&self.draw(&before, LEGEND_PX))
    }

    fn draw(&self, before: &str, right_of_it: f64) -> String {
        let visible = |p: &&[f64; 2]| self.x.at(p[0]).is_finite() && self.y.at(p[1]).is_finite();
        let all = || self.series.iter().flat_map(|s| s.points.iter().filter(visible));
        if all().next().is_none() {
            return "<p class=note>There is nothing to draw.</p>".to_owned();
        }
        let bars = self.series.iter().any(|s| s.mark == Mark::Bars);
        let x = self.x.limits(all().map(|p| self.x.at(p[0])), false);
        let ends = self.series.iter().flat_map(|s| {
            let ends = s.points.iter().zip(&s.spread).filter(|(p, _)| visible(p));
            ends.flat_map(|(p, spread)| [p[1] - spread, p[1] + spread]).map(|v| self.y.at(v))
        });
        let mut y = self.y.limits(all().map(|p| self.y.at(p[1])).chain(ends), true);
        if bars {
            y[0] = 0.0;
        }
        let [left, top, right, below] = MARGIN;
        let bar = bars.then(|| self.series[0].points.get(1).map_or(1.0, |p| p[0] - self.series[0].points[0][0]));
        let x = [x[0], x[1] + bar.unwrap_or(0.0)];
        let px = |v: f64| left + (self.x.at(v) - x[0]) / (x[1] - x[0]) * (SIZE[0] - left - right);
        let py = |v: f64| SIZE[1] - below - (self.y.at(v) - y[0]) / (y[1] - y[0]) * (SIZE[1] - top - below);
        let mut s =
            format!("<svg class='chart' viewBox='0 0 {} {}' role='img'>{before}", SIZE[0] + right_of_it, SIZE[1]);
        for v in self.x.ticks(x) {
            let at = px(v);
            let _ = write!(s, "<line x1='{at:.1}' x2='{at:.1}' y1='{top}' y2='{:.1}'/>", SIZE[1] - below);
            let _ = write!(
                s,
                "<text x='{at:.1}' y='{:.1}' text-anchor='middle'>{}</text>",
                SIZE[1] - below + 15.0,
                self.x.tick(v)
            );
        }
        for v in self.y.ticks(y) {
            let at = py(v);
            let _ = write!(s, "<line y1='{at:.1}' y2='{at:.1}' x1='{left}' x2='{:.1}'/>", SIZE[0] - right);
            let _ = write!(
                s,
                "<text x='{:.1}' y='{:.1}' text-anchor='end'>{}</text>",
                left - 5.0,
                at + 4.0,
                self.y.tick(v)
            );
        }
        for (i, series) in self.series.iter().enumerate() {
            let class = series.class(i);
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
                continue;
            }
            if series.mark != Mark::Dots {
                let _ = write!(s, "<polyline class='{class}' points='");
                for p in points.clone() {
                    let _ = write!(s, "{:.1},{:.1} ", px(p[0]), py(p[1]));
                }
                s += "'/>";
            }
            if matches!(series.mark, Mark::Dots | Mark::LineAndDots) {
                for (k, p) in series.points.iter().enumerate().filter(|(_, p)| visible(p)) {
                    let (at, spread) = (px(p[0]), series.spread.get(k).copied().unwrap_or(0.0));
                    let _ = write!(s, "<circle class='{class}' cx='{at:.1}' cy='{:.1}' r='3'/>", py(p[1]));
                    if spread > 0.0 {
                        // Below zero there is no logarithm: down to the frame.
                        let low =
                            if self.y.at(p[1] - spread).is_finite() { py(p[1] - spread) } else { SIZE[1] - below };
                        let _ = write!(
                            s,
                            "<polyline class='{class}' points='{at:.1},{low:.1} {at:.1},{:.1}'/>",
                            py(p[1] + spread)
                        );
                    }
                }
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

/// What a file needs that a page has: the name of the language.
fn with_namespace(svg: &str) -> String {
    svg.replacen("<svg ", "<svg xmlns='http://www.w3.org/2000/svg' ", 1)
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
            series: vec![Series { label: "l".to_owned(), points: points.to_vec(), spread: vec![], mark: Mark::Line }],
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
        let series = |label: &str, y: f64, spread: f64| Series {
            label: label.to_owned(),
            points: vec![[0.0, y], [1.0, 2.0 * y]],
            spread: vec![spread, 0.0],
            mark: Mark::Dots,
        };
        for scale in [Scale::Linear, Scale::Log] {
            let chart = Chart {
                x: Axis { names: vec!["plane".to_owned(), "a & b".to_owned()], ..Axis::linear("") },
                y: Axis { scale, from_zero: true, ..Axis::linear("mm") },
                series: vec![series("first", 1.0, 0.2), series("second", 3.0, 5.0)],
            };
            let svg = chart.svg();
            assert_eq!((svg.matches("<circle class='s1'").count(), svg.matches("<polyline").count()), (2, 2));
            assert!(svg.contains(">plane<") && svg.contains(">a &amp; b<") && !svg.contains("NaN"), "{svg}");
            assert!(!svg.contains("second") && chart.as_file().contains(">second</text>"));
        }
        let zero = Axis { from_zero: true, ..Axis::linear("") };
        assert_eq!(zero.limits([1.0, 3.0].into_iter(), false), [0.0, 3.0]);
        assert_eq!(zero.limits([-2.0, 3.0].into_iter(), false), [-2.0, 3.0]);
    }
}
