//! How smooth a field is, channel by channel: what predicts positions best that a fit has not seen.
//!
//! The penalty on second differences that is right is the noise's variance over that of the code's second differences
//! (a ridge regression's), and codes differ: the stripes of a Gray code bend within two pixels, a color film hardly in
//! twenty. With too small a penalty the field follows the sweep's noise, which its values hardly show and its slopes
//! do: depth is error over slope. So some positions are set aside, two strips of the field are fitted without them at
//! several strengths, and every channel takes the one that predicts them best. The strips cross: an edge of a code, of
//! which the coarsest bit of a Gray code has one, lies beside a strip that runs along it, and a channel that is flat in
//! all that is looked at would be smoothed until its edges are blurred everywhere else.
//!
//! What patterns lose out of focus is found on the same strips, for all channels together, and taken for those channels
//! that it predicts better.

mod search;

use std::ops::Range;

use rayon::prelude::*;

pub use search::{MAX_POWER, RATIO, Search};

use super::spline_fit::SplineFit;
use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::fit::defocus::{self, Defocus};
use crate::color_field::fit::{NormalEquations, Smoothness};
use crate::color_field::frame::Center;
use crate::color_field::grid::Grid;
use crate::progress::Progress;

/// Part by which a channel's squared error has to fall for it to go out of focus as all do.
const DEFOCUS_WORTH: f64 = 5e-3;
/// Weight of a column's samples from which they are its codeword, whatever others have: a standard deviation of 0.1;
/// and as a fraction of what a bright column has. Ink has less, and where only ink was, nothing is predicted.
const BRIGHT: [f32; 2] = [100.0, 0.1];
/// Strength along the light's rays of a field that hardly changes there: the largest that is searched.
pub(super) const STIFFEST: f32 = {
    let (mut strength, mut power) = (1.0, 1);
    while power < MAX_POWER {
        (strength, power) = (strength * RATIO, power + 1);
    }
    strength
};
/// One of so many positions is set aside.
const EVERY: usize = 4;
/// Pixels that a strip is wide.
const WIDTH: usize = 32;

/// The penalties of a frame at strength 1.
pub fn smoothness(center: Center, of_channels: Vec<[f32; 3]>) -> Smoothness {
    match center {
        Center::Light => Smoothness { across: 3e-4, along: 3e-3, slope_along: 3e-4, of_channels, defocus: None },
        Center::Camera => Smoothness { across: 3e-3, along: 1e-4, slope_along: 0.0, of_channels, defocus: None },
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
    /// `aspect` is the square of the ratio of a cell's size along a to that along b.
    pub fn choose(
        &self,
        bins: &mut Bins,
        along: usize,
        aspect: f64,
        center: Center,
        prepare: impl Fn(&Bins, [usize; 3]) -> SplineFit + Copy,
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
        let mut searches = vec![Search::new(center); bins.k()];
        let with = |searches: &[Search], defocus: Option<&Defocus>| Smoothness {
            defocus: defocus.cloned(),
            ..smoothness(center, searches.iter().map(Search::next).collect())
        };
        while searches.iter().any(|s| !s.is_done()) {
            let errors = self.errors(&parts, &with(&searches, None), progress);
            searches.iter_mut().zip(errors).for_each(|(search, error)| search.take(error));
        }
        let found = with(&searches, None);
        tracing::debug!(of_channels = ?found.of_channels, "smoothness");
        if center == Center::Camera {
            return found;
        }
        let Some(mut defocus) = self.defocus(bins, along, aspect, &found, prepare, progress) else { return found };
        // Along the light's rays anew, of the channels that it explains: what is left there is smoother.
        let mut again: Vec<Search> = searches.iter().map(Search::along_again).collect();
        let errors = self.errors(&parts, &with(&again, Some(&defocus)), progress);
        let of_channels = searches.iter().zip(&errors).map(|(search, e)| *e < (1.0 - DEFOCUS_WORTH) * search.least());
        defocus.of_channels = of_channels.collect();
        tracing::debug!(?defocus, "defocus");
        if !defocus.of_channels.contains(&true) {
            return found;
        }
        for (j, (search, error)) in again.iter_mut().zip(errors).enumerate() {
            if defocus.of_channels[j] {
                search.take(error);
            } else {
                *search = searches[j].clone();
            }
        }
        while again.iter().any(|s| !s.is_done()) {
            let errors = self.errors(&parts, &with(&again, Some(&defocus)), progress);
            again.iter_mut().zip(errors).for_each(|(search, error)| search.take(error));
        }
        let found = with(&again, Some(&defocus));
        tracing::debug!(of_channels = ?found.of_channels, "smoothness");
        found
    }

    /// Returns how patterns go out of focus in the strips, of all samples; `found` is how smooth the field is without
    /// that, and along the light's rays it is as stiff as can be. `None` where the samples do not tell.
    fn defocus(
        &self,
        bins: &Bins,
        along: usize,
        aspect: f64,
        found: &Smoothness,
        prepare: impl Fn(&Bins, [usize; 3]) -> SplineFit,
        progress: &Progress,
    ) -> Option<Defocus> {
        let of_channels = found.of_channels.iter().map(|[a, b, _]| [*a, *b, STIFFEST]).collect();
        let stiff = Smoothness { of_channels, ..found.clone() };
        let mut equations = NormalEquations::none();
        for strip in &self.strips {
            let fit = prepare(&bins.window(strip), [strip[0].len(), strip[1].len(), along]);
            let of_strip = fit.equations_of(|grid| defocus::changes(grid, aspect), &stiff, progress);
            equations.add(&of_strip, &Defocus::to_window(strip, self.cells));
        }
        let held = 1e-9 * equations.left.diagonal();
        let beta = equations.solve(&held)?.into();
        Some(Defocus { beta, aspect, of_channels: vec![true; bins.k()] })
    }

    /// Squared errors of what was set aside from fits of a smoothness, channel by channel.
    fn errors(&self, parts: &[Part<'_>], smooth: &Smoothness, progress: &Progress) -> Vec<f64> {
        let of_part = |part: &Part<'_>| {
            let defocus = smooth.defocus.as_ref().map(|defocus| defocus.of_window(part.strip, self.cells));
            self.squared_errors(part, &part.fit.fit(&Smoothness { defocus, ..smooth.clone() }, progress))
        };
        let of_parts: Vec<Vec<f64>> = parts.par_iter().map(of_part).collect();
        let k = smooth.of_channels.len();
        let errors: Vec<f64> = (0..k).map(|j| of_parts.iter().map(|errors| errors[j]).sum()).collect();
        tracing::debug!(factors = ?smooth.of_channels, ?errors, "smoothness");
        errors
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
