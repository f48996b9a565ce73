//! Fitting the spline from nothing, coarse to fine.

use crate::color_field::bins::Bins;
use crate::color_field::fit::{LeastSquares, Smoothness};
use crate::color_field::grid::Grid;
use crate::progress::Progress;

/// How a spline is fitted from nothing.
#[derive(Clone, Copy)]
pub struct Schedule {
    /// Fits before that of all cells, the coarsest last: by what the cells across are divided, and the steps.
    pub(super) coarse: &'static [(usize, usize)],
    /// Steps of the fit of all cells.
    pub(super) steps: usize,
}

/// Steps of the final fit where much is new to it, and the same of fields of a large sensor, whose cells are several
/// pixels wide: stripes are wide in these, and so many steps would take half of a calibration's time.
///
/// Where samples weigh little, as carried ones do, steps of all cells go a short way: of seven phases under sixteen boards
/// depths have 1.04 times the error after 12 of them that they have after 20 or more.
const STEPS_ANEW: usize = 20;
const STEPS_ANEW_OF_BLOCKS: usize = 10;

impl Schedule {
    /// The schedule of the final fit where much is new to it: the last position that was held out in turn, or samples
    /// that were carried along the stripes. `binning` is the side of the blocks of the sensor's pixels that were read.
    #[must_use]
    pub fn anew(self, binning: usize) -> Self {
        Self { steps: if binning > 1 { STEPS_ANEW_OF_BLOCKS } else { STEPS_ANEW }, ..self }
    }
}

/// A fit that measures, without the held-out positions. The coarsest level leaves next to nothing undetermined, and what
/// it does is smooth: from a quarter of the cells alone, the field of a rig of another renderer was off by 0.01 at its
/// nearest board; from here, by the noise. Twice the steps of all levels predict held-out positions of scanners drawn at
/// random as well, within 0.1 dB.
pub const OF_MANY: Schedule = Schedule { coarse: &[(4, 3), (8, 4), (16, 10)], steps: 4 };
/// The schedule where few positions are held out in turn: much of the field rests on one or two boards there, and smooth
/// codes are smoothed far. Steps of the coarse levels are cheap.
pub const OF_FEW: Schedule = Schedule { coarse: &[(4, 4), (8, 10), (16, 30)], steps: 4 };

/// A spline that is to be fitted to binned samples from nothing, ready for any smoothness.
pub struct SplineFit {
    /// The coarsest level first, the one of all cells last.
    levels: Vec<Level>,
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
        // The coarse fits fill what the fine one cannot see, and need no more bins than they have cells for.
        let mut levels = vec![Level { part: 1, steps: schedule.steps, cells, problem: LeastSquares::new(cells, bins) }];
        let mut merged: Option<Bins> = None;
        for (part, steps) in schedule.coarse.iter().copied() {
            let across = [cells[0] / part + 1, cells[1] / part + 1];
            let coarse = merged.as_ref().unwrap_or(bins).merged([across[0], across[1], bins.counts()[2]]);
            let cells = [across[0], across[1], cells[2]];
            levels.push(Level { part, steps, cells, problem: LeastSquares::new(cells, &coarse) });
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

    /// Does what [`Self::fit`] does, in the memory that the problems take.
    pub fn fit_once(self, smooth: &Smoothness, progress: &Progress) -> Grid {
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
