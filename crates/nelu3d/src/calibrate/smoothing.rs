//! How smooth a field is, channel by channel: what predicts positions best that a fit has not seen.
//!
//! The penalty on second differences that is right is the noise's variance over that of the code's second differences
//! (a ridge regression's), and codes differ: the stripes of a Gray code bend within two pixels, a color film hardly in
//! twenty. With too small a penalty the field follows the sweep's noise, which its values hardly show and its slopes do:
//! depth is error over slope. So some positions are set aside, two strips of the field are fitted without them at
//! several strengths, and every channel takes the one that predicts them best. The strips cross: an edge of a code, of
//! which the coarsest bit of a Gray code has one, lies beside a strip that runs along it, and a channel that is flat in
//! all that is looked at would be smoothed until its edges are blurred everywhere else.

use std::ops::Range;

use rayon::prelude::*;

use super::spline_fit::SplineFit;
use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::fit::Smoothness;
use crate::color_field::frame::Center;
use crate::color_field::grid::Grid;
use crate::progress::Progress;

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
/// Part by which the squared error has to fall for more smoothness. Noise is most of it, and what the field itself is off
/// by counts where scenes are smooth.
const WORTH: f64 = 1e-3;
/// Part by which it may rise in a step for another one to be tried: along stripes, thirty times the strength may change
/// nothing, and a thousand times a lot.
const NEARLY: f64 = 0.05;
/// Weight of a column's samples from which they are its codeword, whatever others have: a standard deviation of 0.1; and
/// as a fraction of what a bright column has. Ink has less, and where only ink was, nothing is predicted.
const BRIGHT: [f32; 2] = [100.0, 0.1];
/// One of so many positions is set aside.
const EVERY: usize = 4;
/// Pixels that a strip is wide.
const WIDTH: usize = 32;

/// The penalties of a frame at strength 1.
pub fn smoothness(center: Center, of_channels: Vec<[f32; 3]>) -> Smoothness {
    match center {
        Center::Light => Smoothness { across: 3e-4, along: 3e-3, slope_along: 3e-4, of_channels },
        Center::Camera => Smoothness { across: 3e-3, along: 1e-4, slope_along: 0.0, of_channels },
    }
}

/// What is set aside.
pub struct Aside {
    /// What is set aside together, one after the other.
    pub folds: Vec<Fold>,
    /// Cells of the field along a and b.
    cells: [usize; 2],
    /// The strips: cells along a and b.
    pub strips: Vec<[Range<usize>; 2]>,
}

/// Positions that are set aside together.
pub struct Fold {
    /// Positions of the sweep, by index.
    pub positions: Vec<usize>,
    /// Their samples in the strips, position by position as they were kept.
    pub samples: Vec<Gathered>,
}

impl Aside {
    /// Sets positions aside, and two strips in the middle of a field of `cells`, so many per pixel: one along a and one
    /// along b.
    ///
    /// `used` are the positions in the order of their depth. Of many, every fourth is set aside, all at once; of a few
    /// that are held out `in_turn`, the nearest, the middle, and the farthest, one after the other: how far a field may
    /// change along the light's rays is told by those that it has to reach for.
    pub fn new(used: &[usize], in_turn: bool, cells: [usize; 3], cells_per_pixel: usize) -> Self {
        let folds = match used {
            [first, .., last] if in_turn => vec![vec![*first], vec![used[used.len() / 2]], vec![*last]],
            _ => vec![used.iter().skip(1).step_by(EVERY).copied().collect()],
        };
        let folds = folds.into_iter().map(|positions| Fold { positions, samples: Vec::new() }).collect();
        let cells = [cells[0], cells[1]];
        let [middle_a, middle_b] = cells.map(|n| {
            let width = (WIDTH * cells_per_pixel).min(n);
            let first = (n - width) / 2;
            first..first + width
        });
        let strips = vec![[0..cells[0], middle_b], [middle_a, 0..cells[1]]];
        Self { folds, cells, strips }
    }

    /// Keeps the samples of a position that is set aside.
    pub fn keep(&mut self, position: usize, samples: &Gathered) {
        let Self { folds, cells, strips } = self;
        for fold in folds.iter_mut().filter(|fold| fold.positions.contains(&position)) {
            let is_kept = |q: [f32; 3]| strips.iter().any(|strip| place_in(strip, *cells, q).is_some());
            fold.samples.push(samples.kept(is_kept));
        }
    }

    /// Chooses the smoothness of a field that is fitted to `bins`, which have the samples that were set aside, too.
    /// `prepare` prepares to fit a spline to the bins of a strip, which has so many cells; `along` of them along w.
    pub fn choose(
        &self,
        bins: &mut Bins,
        along: usize,
        center: Center,
        prepare: impl Fn(&Bins, [usize; 3]) -> SplineFit,
        progress: &Progress,
    ) -> Smoothness {
        let mut parts = Vec::new();
        for fold in &self.folds {
            bins.remove_all(&fold.samples);
            for strip in &self.strips {
                let bins = bins.window(strip);
                let fit = prepare(&bins, [strip[0].len(), strip[1].len(), along]);
                parts.push(Part { strip, fit, known: bright_columns(&bins), aside: &fold.samples });
            }
            bins.add_all(&fold.samples);
        }
        let k = bins.k();
        let mut searches = vec![Search::new(center); k];
        while searches.iter().any(|s| !s.is_done()) {
            let smooth = smoothness(center, searches.iter().map(Search::next).collect());
            let of_part = |part: &Part<'_>| self.squared_errors(part, &part.fit.fit(&smooth, progress));
            let of_parts: Vec<Vec<f64>> = parts.par_iter().map(of_part).collect();
            let errors: Vec<f64> = (0..k).map(|j| of_parts.iter().map(|errors| errors[j]).sum()).collect();
            tracing::debug!(factors = ?smooth.of_channels, ?errors, "smoothness");
            searches.iter_mut().zip(errors).for_each(|(search, error)| search.take(error));
        }
        let of_channels: Vec<[f32; 3]> = searches.iter().map(Search::best).collect();
        tracing::debug!(?of_channels, "smoothness");
        smoothness(center, of_channels)
    }

    /// Weighted squared errors of a spline of a strip at the samples that were set aside, channel by channel: in the
    /// columns of cells that others have lit.
    fn squared_errors(&self, part: &Part<'_>, grid: &Grid) -> Vec<f64> {
        let [na, nb, _] = grid.cells;
        let of_position = |samples: &Gathered| {
            let (mut sums, mut c) = (vec![0.0; grid.k], vec![0.0; grid.k]);
            samples.for_each(|q, values, omegas| {
                let Some(q) = place_in(part.strip, self.cells, q) else { return };
                if part.known[(q[1] * nb as f32) as usize * na + (q[0] * na as f32) as usize] {
                    grid.eval(q, &mut c);
                    for (j, sum) in sums.iter_mut().enumerate() {
                        *sum += f64::from(omegas[j] * (c[j] - values[j]).powi(2));
                    }
                }
            });
            sums
        };
        let of_positions: Vec<Vec<f64>> = part.aside.par_iter().map(of_position).collect();
        (0..grid.k).map(|j| of_positions.iter().map(|sums| sums[j]).sum()).collect()
    }
}

/// A strip without the positions of a fold.
struct Part<'a> {
    strip: &'a [Range<usize>; 2],
    fit: SplineFit,
    /// Whether bright samples lie in each column of bins.
    known: Vec<bool>,
    /// The samples of the fold's positions.
    aside: &'a [Gathered],
}

/// Returns where a point of a field of `cells` along a and b is in a strip, in the strip's unit coordinates.
fn place_in(strip: &[Range<usize>; 2], cells: [usize; 2], q: [f32; 3]) -> Option<[f32; 3]> {
    let [a, b] = [0, 1].map(|i| (q[i] * cells[i] as f32 - strip[i].start as f32) / strip[i].len() as f32);
    [a, b, q[2]].iter().all(|q| (0.0..1.0).contains(q)).then_some([a, b, q[2]])
}

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

/// Which columns of bins have bright samples.
fn bright_columns(bins: &Bins) -> Vec<bool> {
    let [na, nb, _] = bins.counts();
    let mut weights = vec![0.0f32; na * nb];
    for b in 0..nb {
        bins.for_each_in_row(b, |s| weights[b * na + ((s.q[0] * na as f32) as usize).min(na - 1)] += s.mean);
    }
    let mut lit: Vec<f32> = weights.iter().copied().filter(|w| *w > 0.0).collect();
    lit.sort_unstable_by(f32::total_cmp);
    let [own, of_others] = BRIGHT;
    let least = lit.get(lit.len() * 3 / 4).map_or(0.0, |bright| own.min(of_others * bright));
    weights.iter().map(|w| *w > least).collect()
}
