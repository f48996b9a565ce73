//! Fitting the spline from nothing, coarse to fine.

use crate::color_field::bins::Bins;
use crate::color_field::fit::{Smoothness, fit};
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

/// A fit that measures, without the held-out positions. The coarsest level leaves next to nothing undetermined, and what
/// it does is smooth: from a quarter of the cells alone, the field of a rig of another renderer was off by 0.01 at its
/// nearest board; from here, by the noise. More fine steps follow the noise: 20 instead of 8 predict held-out positions
/// of two rigs of other renderers worse, by 0.15 dB.
pub const OF_MANY: Schedule = Schedule { coarse: &[(4, 10), (8, 20), (16, 60)], steps: 8 };
/// The schedule where few positions are held out in turn: much of the field rests on one or two boards there, and smooth
/// codes are smoothed far. Steps of the coarse levels are cheap, and without them the coarsest is not solved: of three a
/// la carte patterns under eight boards one was predicted 0.3 dB worse with 60 steps of it and 40 of the next. Under many
/// boards and fine stripes, which coarse cells cannot hold, so many steps are worse by 1.5 dB.
pub(super) const OF_FEW: Schedule = Schedule { coarse: &[(4, 30), (8, 100), (16, 300)], steps: 10 };

/// Fits a spline of `cells` to `bins`, which have as many across.
pub fn fit_spline(
    bins: &Bins,
    cells: [usize; 3],
    smooth: &Smoothness,
    schedule: Schedule,
    progress: &Progress,
) -> Grid {
    // The coarse fits fill what the fine one cannot see, and need no more bins than they have cells for.
    let mut levels: Vec<(Bins, usize, usize)> = Vec::with_capacity(schedule.coarse.len());
    for (part, steps) in schedule.coarse {
        let counts = [cells[0] / part + 1, cells[1] / part + 1, bins.counts()[2]];
        let merged = levels.last().map_or(bins, |(finer, ..)| finer).merged(counts);
        levels.push((merged, *part, *steps));
    }
    let mut grid: Option<Grid> = None;
    while let Some((coarse, part, steps)) = levels.pop() {
        let few = [coarse.counts()[0], coarse.counts()[1], cells[2]];
        let mut next = grid.map_or_else(|| Grid::new(few, bins.k()), |grid| grid.resampled(few));
        fit(&mut next, &coarse, &smooth.of_coarser(part), steps, progress);
        grid = Some(next);
    }
    let mut grid = grid.expect("there are coarse levels").resampled(cells);
    fit(&mut grid, bins, smooth, schedule.steps, progress);
    grid
}
