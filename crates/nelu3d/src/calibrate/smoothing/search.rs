//! The search for a channel's strengths of smoothing.

use crate::color_field::frame::Center;

/// Factor between strengths that are tried.
pub const RATIO: f32 = 30.0;
/// Strengths that are tried, at most: powers of [`RATIO`] below this one.
pub const MAX_POWER: i32 = 6;
/// What is tried in turn: more smoothness along all axes, across, and more or less along each. Most codes are stripes,
/// along which they do not change; one whose noise asks for much smoothness along all axes may still be out of focus at
/// one end. Along the light's rays comes last: a wave that is smoothed too far across hides what it loses out of focus.
/// In the camera's frame smoothness across is not taken back: less predicts a little better there and scans worse, as
/// slopes show noise that values hide.
const LINES: [[i32; 3]; 8] =
    [[1, 1, 1], [1, 1, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, -1], [0, 0, 1]];
/// Part by which the squared error has to fall for more smoothness. Noise is most of it, and what the field itself is
/// off by counts where scenes are smooth.
const WORTH: f64 = 1e-3;
/// Part by which it may rise in a step for another one to be tried: along stripes, thirty times the strength may change
/// nothing, and a thousand times a lot.
const NEARLY: f64 = 0.05;

/// The search for a channel's strengths: along each of `LINES` for as long as the error falls, or nearly so.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// Where the line begins: powers of [`RATIO`] along a, b and w.
    start: [i32; 3],
    /// Which of [`LINES`] is searched.
    line: usize,
    /// Errors at the line's start and after it.
    errors: Vec<f64>,
    /// Lines that led to something better.
    good: Vec<[i32; 3]>,
    /// Whether smoothness across is taken back where less predicts better.
    gives_back: bool,
    /// By what the strengths differ from powers, in powers.
    between: [f32; 3],
}

impl Search {
    /// Begins the search in a frame.
    pub fn new(center: Center) -> Self {
        Self { gives_back: center == Center::Light, ..Self::default() }
    }

    /// Begins anew from what was found, along the light's rays alone: the last two lines.
    pub(super) fn along_again(&self) -> Self {
        let [a, b, _] = self.between;
        Self { line: LINES.len() - 2, errors: Vec::new(), good: Vec::new(), between: [a, b, 0.0], ..self.clone() }
    }

    /// Returns the least error that was found, at the strengths where [`Self::along_again`] begins.
    pub(super) fn least(&self) -> f64 {
        self.errors.first().copied().unwrap_or(0.0)
    }

    /// Returns whether all lines have been searched.
    pub fn is_done(&self) -> bool {
        self.line == LINES.len()
    }

    /// Returns the powers of [`RATIO`] after so many steps of the line.
    fn after(&self, steps: usize) -> [i32; 3] {
        let line = LINES.get(self.line).copied().unwrap_or_default();
        [0, 1, 2].map(|i| self.start[i] + line[i] * steps as i32)
    }

    /// Returns the factors to try next; the best ones where the search is done.
    pub fn next(&self) -> [f32; 3] {
        if self.is_done() { self.best() } else { self.after(self.errors.len()).map(|power| RATIO.powi(power)) }
    }

    /// Returns the best factors.
    pub fn best(&self) -> [f32; 3] {
        [0, 1, 2].map(|i| RATIO.powf(self.start[i] as f32 + self.between[i]))
    }

    /// Takes the squared error at what was tried. Where the line has its least error between others, the best strength
    /// is that of the parabola through the three, in logarithms of both: strengths are far apart, and one that is five
    /// times too strong for a code hardly shows where paper is bright, but bends the field where samples are dim.
    pub fn take(&mut self, error: f64) {
        if self.is_done() {
            return;
        }
        self.errors.push(error);
        let n = self.errors.len();
        let best = (1..n).fold(0, |best, i| if self.errors[i] < (1.0 - WORTH) * self.errors[best] { i } else { best });
        let goes_on = best + 1 == n || best + 2 == n && error < (1.0 + NEARLY) * self.errors[best];
        if goes_on && self.is_tried(n) {
            return;
        }
        if best > 0 && best + 1 < n && self.errors[best] > 0.0 {
            let [before, here, after] = [best - 1, best, best + 1].map(|i| self.errors[i].max(f64::MIN_POSITIVE).ln());
            let bend = (before - here) + (after - here);
            let vertex = if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            for (between, line) in self.between.iter_mut().zip(LINES[self.line]) {
                *between += vertex as f32 * line as f32;
            }
        }
        if best > 0 {
            self.good.push(LINES[self.line]);
        }
        self.start = self.after(best);
        self.errors = vec![self.errors[best]];
        self.line += 1;
        // At the end of the strengths nothing is left to try, nor back along a line that was good.
        while !self.is_done() && (!self.is_tried(1) || self.is_idle(LINES[self.line])) {
            self.line += 1;
        }
    }

    /// Returns whether a line leads back along one that was good, or gives back what is kept.
    fn is_idle(&self, line: [i32; 3]) -> bool {
        self.good.contains(&line.map(|step| -step)) || !self.gives_back && (line[0] < 0 || line[1] < 0)
    }

    /// Returns whether strengths are tried after so many steps of the line.
    fn is_tried(&self, steps: usize) -> bool {
        self.after(steps).into_iter().all(|power| (0..MAX_POWER).contains(&power))
    }
}
