//! How well a component is explained, alone and beside the others of a picture.

use nelu3d_scan::statistics::median;

use super::settings::FilterSettings;
use crate::reconstruct::refine::Refined;

/// What other explanations the codewords of a component have.
#[derive(Clone, Copy, Debug)]
pub struct Alternatives {
    /// Fraction of foreign codewords that are explained as well as the component's own; `None` where that cannot be
    /// tried.
    pub by_chance: Option<f32>,
    /// Least χ² of a foreign codeword at any depth over that of the component's own; 0 where that cannot be tried.
    pub foreign_chi2: f32,
    /// Fraction of the component's pixels that a point outside the calibrated volume explains far better, beyond what
    /// chance does.
    pub beyond: f32,
}

/// What is known of a component.
pub(super) struct Score {
    /// Median χ² per measurement.
    pub(super) chi2: f32,
    /// From 1 on it is not explained.
    pub(super) score: f32,
    /// It is explained outside the calibrated volume.
    pub(super) is_beyond: bool,
    /// Foreign codewords fit far worse than its own: it need not fit quite as well as the rest of the scene does.
    pub(super) is_unique: bool,
    /// χ² and light of unseen origin as parts of what noise alone lets fit; 1 is the limit.
    pub(super) clear: f32,
    /// Fraction of foreign codewords that are explained as well, as far as it was needed.
    pub(super) by_chance: f32,
}

/// The components of a picture, and what is known of them together.
pub(super) struct Judgement {
    /// Pixels of every component.
    pub(super) members: Vec<Vec<usize>>,
    /// What is known of each.
    pub(super) scores: Vec<Score>,
    /// Score above which a component is not explained.
    pub(super) limit: f32,
    /// Largest χ² of an explained component: of any, and of one that is unique.
    pub(super) max_chi2: [f32; 2],
    /// Number of pixels that are explained.
    pub(super) explained: usize,
    /// Number of pixels in components.
    pub(super) decoded: usize,
}

impl Judgement {
    /// Puts components together.
    pub(super) fn new(members: Vec<Vec<usize>>, scores: Vec<Score>, settings: &FilterSettings) -> Self {
        // A right depth explains codewords about as well everywhere in a scene.
        let candidates = members.iter().zip(&scores).filter(|(_, s)| s.score < 1.0 && !s.is_beyond);
        let typical = weighted_median(candidates.map(|(pixels, s)| (s.chi2, pixels.len())).collect());
        let max_chi2 =
            settings.chi2_over_typical.map(|times| settings.clear_chi2.max(times * typical.unwrap_or(f32::INFINITY)));
        let decoded: usize = members.iter().map(Vec::len).sum();
        let of_component = |(p, s): (&Vec<usize>, &Score)| if s.is_explained(max_chi2) { p.len() } else { 0 };
        let explained: usize = members.iter().zip(&scores).map(of_component).sum();
        // Where next to nothing is explained, what is left was found by chance, too.
        let share = (explained as f32 / decoded.max(1) as f32 / settings.explained).min(1.0);
        let limit = settings.max_score_alone + (1.0 - settings.max_score_alone) * share;
        Self { members, scores, limit, max_chi2, explained, decoded }
    }

    /// Returns the pixels of components that are not explained.
    pub(super) fn unexplained(&self) -> impl Iterator<Item = &usize> {
        let of_all = self.members.iter().zip(&self.scores);
        of_all.filter(|(_, score)| !score.is_explained(self.max_chi2)).flat_map(|(pixels, _)| pixels)
    }
}

impl Score {
    /// Scores a component. `alternatives` tells what other explanations its codewords have, and is asked where it matters.
    pub(super) fn of(
        pixels: &[usize],
        refined: &Refined,
        settings: &FilterSettings,
        noise_is_known: bool,
        alternatives: impl Fn(&[usize]) -> Alternatives,
    ) -> Self {
        let median_of = |map: &[f32]| median(&mut pixels.iter().map(|i| map[*i]).collect::<Vec<f32>>());
        let (Some(chi2), Some(unseen)) = (median_of(&refined.chi2), median_of(&refined.unseen)) else {
            let (none, no) = (f32::INFINITY, false);
            return Self { chi2: none, score: none, is_beyond: no, is_unique: no, clear: none, by_chance: 0.0 };
        };
        let light = chi2 / settings.max_component_chi2 + unseen / settings.max_component_unseen;
        let clear = settings.clear(chi2, unseen);
        let (score, other) = if pixels.len() < settings.min_component {
            (f32::INFINITY, None)
        } else if light > 1.0 {
            (light, None)
        } else if noise_is_known && clear < settings.max_score_alone {
            (clear, None)
        } else {
            let other = alternatives(pixels);
            let by_chance = other.by_chance.unwrap_or(settings.unknown_chance);
            let tested = light + by_chance / settings.max_component_chance;
            (if noise_is_known { tested.min(clear) } else { tested }, Some(other))
        };
        if score.is_finite() {
            tracing::debug!(pixels = pixels.len(), chi2, unseen, ?other, score, clear, "component");
        }
        Self {
            chi2,
            score,
            is_beyond: other.is_some_and(|o| o.beyond > settings.max_beyond),
            is_unique: other.is_some_and(|o| o.foreign_chi2 >= settings.unique),
            clear,
            by_chance: other.map_or(0.0, |o| o.by_chance.unwrap_or(settings.unknown_chance)),
        }
    }

    /// Returns whether the component is explained, with these limits of [`Self::fits`].
    fn is_explained(&self, max_chi2: [f32; 2]) -> bool {
        self.score < 1.0 && self.fits(max_chi2) && !self.is_beyond
    }

    /// Returns whether χ² is no larger than that of any explained component, or of one that is unique.
    pub(super) fn fits(&self, [of_any, of_unique]: [f32; 2]) -> bool {
        self.chi2 <= if self.is_unique { of_unique } else { of_any }
    }
}

/// Returns the pixels of every component.
pub(super) fn members(component: &[u32], sizes: &[u32]) -> Vec<Vec<usize>> {
    let mut members: Vec<Vec<usize>> = sizes.iter().map(|n| Vec::with_capacity(*n as usize)).collect();
    for (i, c) in component.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
        members[*c as usize].push(i);
    }
    members
}

/// Returns the median of values that each stand for a number of pixels.
pub(super) fn weighted_median(mut values: Vec<(f32, usize)>) -> Option<f32> {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let all: usize = values.iter().map(|(_, n)| n).sum();
    let mut below = 0;
    values
        .into_iter()
        .find(|(_, n)| {
            below += n;
            2 * below >= all
        })
        .map(|(v, _)| v)
}
