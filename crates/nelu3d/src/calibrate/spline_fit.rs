//! Fitting the spline from nothing, coarse to fine.

use std::ops::Range;

use rayon::prelude::*;

use crate::color_field::bins::Bins;
use crate::color_field::fit::{LeastSquares, NormalEquations, Smoothness};
use crate::color_field::frame::Center;
use crate::color_field::grid::Grid;
use crate::progress::Progress;

/// How a spline is fitted from nothing.
#[derive(Clone, Copy)]
pub struct Schedule {
    /// Fits before that of all cells, the coarsest last: by what the cells across are divided, and the steps.
    coarse: &'static [(usize, usize)],
    /// Steps of the fit of all cells.
    pub(super) steps: usize,
    /// Steps of the final fit from there, once the held-out positions have joined.
    pub(super) joined: usize,
    /// Steps of the final fit where much is new to it, and the same of fields of a large sensor, whose cells are
    /// several pixels wide: stripes are wide in these, and so many steps would take half of a calibration's time.
    anew: [usize; 2],
}

/// A fit that measures, without the held-out positions. The coarsest level leaves next to nothing undetermined, and
/// what it does is smooth: from a quarter of the cells alone, the field of a rig of another renderer was off by 0.01 at
/// its nearest board; from here, by the noise. Twice the steps of every level predict held-out positions of scanners
/// drawn at random as well, within 0.01 dB. Where samples weigh little, as carried ones do, steps of all cells go a
/// short way: of seven phases under sixteen boards depths have 1.04 times the error after 12 of them that they have
/// after 20 or more.
const OF_MANY: Schedule = Schedule { coarse: &[(4, 3), (8, 4), (16, 10)], steps: 4, joined: 2, anew: [20, 10] };
/// The schedule where few positions are held out in turn: much of the field rests on one or two boards there, and
/// smooth codes are smoothed far. Steps of the coarse levels are cheap.
const OF_FEW: Schedule = Schedule { coarse: &[(4, 4), (8, 10), (16, 30)], ..OF_MANY };
/// The schedule of many positions in the camera's frame, where codewords change along every axis, and the
/// preconditioner is the diagonal alone. More fine steps follow the noise: 20 instead of 8 predict held-out positions
/// of two rigs of other renderers worse, by 0.15 dB.
const OF_MANY_IN_CAMERA: Schedule =
    Schedule { coarse: &[(4, 10), (8, 20), (16, 60)], steps: 8, joined: 4, anew: [80, 20] };
/// The schedule of few positions in the camera's frame: of such coarse levels more steps, as of [`OF_FEW`].
const OF_FEW_IN_CAMERA: Schedule = Schedule { coarse: &[(4, 30), (8, 100), (16, 300)], steps: 10, ..OF_MANY_IN_CAMERA };

impl Schedule {
    /// Returns the schedule in a frame, of few positions that are held out `in_turn` or of many.
    pub fn of(center: Center, in_turn: bool) -> Self {
        match (center, in_turn) {
            (Center::Light, false) => OF_MANY,
            (Center::Light, true) => OF_FEW,
            (Center::Camera, false) => OF_MANY_IN_CAMERA,
            (Center::Camera, true) => OF_FEW_IN_CAMERA,
        }
    }

    /// Returns the schedule with no fewer than `least` steps of the fit of all cells.
    #[must_use]
    pub(super) fn with_steps(self, least: usize) -> Self {
        Self { steps: self.steps.max(least), ..self }
    }

    /// The schedule of the final fit where much is new to it: the last position that was held out in turn, or samples
    /// that were carried along the stripes. `binning` is the side of the blocks of the sensor's pixels that were read.
    #[must_use]
    pub fn anew(self, binning: usize) -> Self {
        Self { steps: self.anew[usize::from(binning > 1)], ..self }
    }
}

/// Steps of the fits that tell what a spline takes over of a change.
const FOLLOWED: usize = 2;

/// A spline that is to be fitted to binned samples from nothing, ready for any smoothness.
pub struct SplineFit {
    /// The coarsest level first, the one of all cells last.
    levels: Vec<Level>,
}

/// Most coefficients that are fitted at once, about. Their equations take seven numbers for each.
const AT_ONCE: usize = 8_000_000;

/// Fits a spline of `cells` to `bins`, which have as many across, from nothing. Channels are problems of their own: of
/// a large spline some are solved at a time, in a part of the memory.
pub fn fit_spline(
    bins: &Bins,
    cells: [usize; 3],
    schedule: Schedule,
    smooth: &Smoothness,
    progress: &Progress,
) -> Grid {
    let k = bins.k();
    let mut grid = Grid::new(cells, k);
    let at_once = k.div_ceil(grid.coeffs.len().div_ceil(AT_ONCE).max(1));
    for first in (0..k).step_by(at_once) {
        let channels = first..(first + at_once).min(k);
        let fit = SplineFit::of_channels(bins, cells, schedule, channels.clone());
        let part = fit.fit_once(&smooth.part(channels.clone()), progress);
        let nodes = grid.coeffs.par_chunks_mut(k).zip(part.coeffs.par_chunks(part.k)).with_min_len(1 << 12);
        nodes.for_each(|(node, part)| node[channels.clone()].copy_from_slice(part));
    }
    grid
}

/// A level of a fit.
struct Level {
    /// By what the cells across are divided.
    part: usize,
    steps: usize,
    cells: [usize; 3],
    problem: LeastSquares,
}

impl SplineFit {
    /// Prepares to fit a spline of `cells` to `bins`, which have as many across.
    pub fn new(bins: &Bins, cells: [usize; 3], schedule: Schedule) -> Self {
        Self::of_channels(bins, cells, schedule, 0..bins.k())
    }

    /// Prepares to fit a spline of `cells` to some channels of `bins`, which have as many across.
    fn of_channels(bins: &Bins, cells: [usize; 3], schedule: Schedule, channels: Range<usize>) -> Self {
        let level = |part, steps, cells, bins: &Bins| {
            let problem = LeastSquares::of_channels(cells, bins, channels.clone());
            Level { part, steps, cells, problem }
        };
        // The coarse fits fill what the fine one cannot see, and need no more bins than they have cells for.
        let mut levels = vec![level(1, schedule.steps, cells, bins)];
        let mut merged: Option<Bins> = None;
        for (part, steps) in schedule.coarse.iter().copied() {
            let across = [cells[0] / part + 1, cells[1] / part + 1];
            let coarse = merged.as_ref().unwrap_or(bins).merged([across[0], across[1], bins.counts()[2]]);
            levels.push(level(part, steps, [across[0], across[1], cells[2]], &coarse));
            merged = Some(coarse);
        }
        levels.reverse();
        Self { levels }
    }

    /// Fits the spline.
    pub fn fit(&self, smooth: &Smoothness, progress: &Progress) -> Grid {
        let mut grid = None;
        for level in &self.levels {
            let mut next = level.start(grid);
            level.problem.solve(&mut next, &smooth.of_coarser(level.part), level.steps, progress);
            grid = Some(next);
        }
        grid.expect("there is a level")
    }

    /// Returns the equations of how much of some `changes` there is of the spline that it fits with `smooth`.
    pub fn equations_of<const N: usize>(
        &self,
        changes: impl FnOnce(&Grid) -> [Vec<f32>; N],
        smooth: &Smoothness,
        progress: &Progress,
    ) -> NormalEquations<N> {
        let level = self.levels.last().expect("there is a level");
        let grid = self.fit(smooth, progress);
        level.problem.equations_of(&grid, &changes(&grid), smooth, FOLLOWED, progress)
    }

    /// Does what [`Self::fit`] does, in the memory that the problems take.
    fn fit_once(self, smooth: &Smoothness, progress: &Progress) -> Grid {
        let mut grid = None;
        for level in self.levels {
            let mut next = level.start(grid);
            level.problem.solve_once(&mut next, &smooth.of_coarser(level.part), level.steps, progress);
            grid = Some(next);
        }
        grid.expect("there is a level")
    }
}

impl Level {
    /// Returns the spline to begin with, from that of the coarser level.
    fn start(&self, coarser: Option<Grid>) -> Grid {
        coarser.map_or_else(|| Grid::new(self.cells, self.problem.k()), |grid| grid.resampled(self.cells))
    }
}
