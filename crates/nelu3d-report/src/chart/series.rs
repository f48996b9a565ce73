//! The series of a chart.

/// Number of colors, after which they repeat (Okabe and Ito, Color Universal Design, 2008, and two grays).
const N_COLORS: usize = 7;
/// Number of kinds of dashes, which tell series of the same color apart.
const N_DASHES: usize = 2;

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
    /// Returns the classes that give the i-th series its color and, where colors repeat, its dashes.
    pub(super) fn class(&self, i: usize) -> String {
        match (self.mark, i / N_COLORS) {
            (ChartMark::Ideal, _) => "ideal".to_owned(),
            (_, 0) => format!("s{i}"),
            (_, round) => format!("s{} d{}", i % N_COLORS, (round - 1) % N_DASHES + 1),
        }
    }
}
