//! The series of a chart.

/// Number of colors, after which they repeat (Okabe and Ito, Color Universal Design, 2008, and two grays).
const N_COLORS: usize = 7;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChartMark {
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

/// Some points, drawn in one color.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartSeries {
    /// Name in the legend.
    pub label: String,
    /// Points, by growing x.
    pub points: Vec<[f64; 2]>,
    /// How far each dot's line reaches up and down; empty for none.
    pub spread: Vec<f64>,
    /// How it is drawn.
    pub mark: ChartMark,
}

impl ChartSeries {
    /// Returns the class that gives the i-th series its color.
    pub(super) fn class(&self, i: usize) -> String {
        if self.mark == ChartMark::Ideal { "ideal".to_owned() } else { format!("s{}", i % N_COLORS) }
    }
}
