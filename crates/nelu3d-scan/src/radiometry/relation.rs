//! What is known of the light in images of a still scene.

use crate::pattern::Superposition;

/// Images of a still scene whose weighted light cancels at every pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct LightRelation {
    /// Place of each image, and its weight.
    pub terms: Vec<(usize, f64)>,
    /// What it is left out together with, when curves are compared.
    pub fold: usize,
}

impl LightRelation {
    /// What `a` and `b` show adds up to what `both` shows; `black` is seen with each of them.
    pub fn sum(a: usize, b: usize, both: usize, black: usize, fold: usize) -> Self {
        Self { terms: vec![(a, 1.0), (b, 1.0), (both, -1.0), (black, -1.0)], fold }
    }

    /// What `a` shows in `a_secs` is what `b` shows in `b_secs`, times their ratio.
    pub fn exposures(a: (usize, f64), b: (usize, f64), fold: usize) -> Self {
        // Of the longer one's light, so that rows have one scale.
        let longer = a.1.max(b.1);
        Self { terms: vec![(a.0, longer / a.1), (b.0, -longer / b.1)], fold }
    }

    /// All that is known of the images of [`Superposition`], followed by one of black at place `black`.
    pub fn superposition(black: usize) -> Vec<Self> {
        let sums = Superposition::sums();
        let kinds = sums.len() / Superposition::LEVELS;
        // The same sum at every brightness is left out together.
        sums.into_iter().enumerate().map(|(i, [a, b, both])| Self::sum(a, b, both, black, i % kinds)).collect()
    }

    /// All that is known of images with these exposure times: each pair of neighbors, in order of time.
    pub fn exposure_series(secs: &[f64]) -> Vec<Self> {
        let mut order: Vec<usize> = (0..secs.len()).collect();
        order.sort_by(|a, b| secs[*a].total_cmp(&secs[*b]));
        let pair = |(fold, w): (usize, &[usize])| Self::exposures((w[0], secs[w[0]]), (w[1], secs[w[1]]), fold);
        order.windows(2).enumerate().map(pair).collect()
    }

    /// Returns the images' largest place.
    pub(super) fn last(&self) -> usize {
        self.terms.iter().map(|t| t.0).max().unwrap_or(0)
    }
}
