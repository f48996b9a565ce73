//! Strips of rows, of which information and variances are found at a time: these take more than anything else.

use std::ops::Range;

use rayon::prelude::*;

use super::Refinement;
use crate::reconstruct::refine::thin_plate::ThinPlatePrior;
use crate::reconstruct::refine::uncertainty::{Information, Posterior};

/// Rows of a strip.
const ROWS: usize = 512;
/// Rows beside them that what is found there depends on.
const MARGIN: usize = 40;

/// Some rows of a window, as if there were no others.
pub(super) struct Strip {
    /// The rows, those beside the strip included.
    pub(super) rows: Range<usize>,
    /// Pixels of the strip itself, by their index among those of [`Self::rows`].
    own: Range<usize>,
    /// Pixels of the window before the first.
    pub(super) start: usize,
    pub(super) prior: ThinPlatePrior,
    pub(super) information: Vec<Information>,
    pub(super) posterior: Posterior,
}

impl Strip {
    /// Returns what a map of the rows has of the strip itself.
    pub(super) fn own<'a>(&self, map: &'a [f32]) -> &'a [f32] {
        &map[self.own.clone()]
    }
}

impl Refinement<'_> {
    /// Returns the window strip by strip, at the linear system that was set up last.
    pub(super) fn strips(&self) -> impl Iterator<Item = Strip> + '_ {
        let [w, height] = [self.window.w, self.window.h];
        (0..height).step_by(ROWS).map(move |first| {
            let end = (first + ROWS).min(height);
            let rows = first.saturating_sub(MARGIN)..(end + MARGIN).min(height);
            let own = (first - rows.start) * w..(end - rows.start) * w;
            let (prior, start) = (self.prior.of_rows(rows.clone()), rows.start * w);
            let of_pixel = |(at, active): (usize, &bool)| {
                if *active { self.information(start + at) } else { Information::default() }
            };
            let information: Vec<Information> = prior.active.par_iter().enumerate().map(of_pixel).collect();
            let posterior = Posterior::new(&prior, &information);
            Strip { rows, own, start, prior, information, posterior }
        })
    }

    /// Returns what the measurements of pixel `i` of the window tell of its depth and of their noise.
    fn information(&self, i: usize) -> Information {
        // Both beside the noise model that the normal equations were set up with.
        let of = self.scene.measurements.independent_at(self.window.at(i));
        let (chi2, over_cut) = (self.trust * self.data.chi2[i] / of, self.data.chi2[i] / self.robust_cut());
        Information::robust(self.data.h[i], chi2, over_cut, of)
    }

    /// Returns the factor of the noise's variance at a pixel of the window, for a depth that averages over so many.
    pub(super) fn depth_noise_factor(&self, i: usize, pixels: f32) -> f32 {
        let (px, field) = (self.window.at(i), &self.scene.field);
        let distance = f64::from(1.0 / (self.inv_z(i) * self.scene.rays.dir_z(px)));
        let positions = field.validity.fewest_positions_at(self.scene.rays.in_frame(px).at(distance).q);
        field.metadata.depth_noise_factor(pixels, positions)
    }
}
