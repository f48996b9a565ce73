//! Whole components of a surface that are not explained: a wrong period of the code, or an object outside the volume.
//!
//! A single pixel may have a codeword that nothing explains: a highlight, a mixed pixel, a corner full of
//! interreflection. A whole component whose typical codeword does not fit, fits only with much light of unseen origin,
//! or fits no better than codewords that belong elsewhere, is at a wrong depth. So is one that fits much worse than the
//! rest of the scene does, a little more where codewords from elsewhere fit far worse still; and one that a point outside
//! the calibrated volume explains far better. Three patterns that leave no color unused (a la carte) give every codeword
//! some depth on every ray: there it counts alone that a component fits within the noise, without any other light.
//!
//! Where much of a picture is explained nowhere (a wall behind the calibrated volume), chance has many tries: if it
//! explains a tenth of all codewords, a tenth of that wall is explained. So a component no larger than that has to fit
//! nearly as well as noise lets anything fit. And what stands before the wall is linked to it where the wrong depth
//! begins at the right one, so that components are judged in [`pieces`] that are explained equally well all over.

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;

use super::pieces::pieces;
use super::settings::FilterSettings;
use crate::reconstruct::refine::Refined;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

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
struct Score {
    /// Median χ² per measurement.
    chi2: f32,
    /// From 1 on it is not explained.
    score: f32,
    /// It is explained outside the calibrated volume.
    is_beyond: bool,
    /// Foreign codewords fit far worse than its own: it need not fit quite as well as the rest of the scene does.
    is_unique: bool,
    /// χ² and light of unseen origin as parts of what noise alone lets fit; 1 is the limit.
    clear: f32,
    /// Fraction of foreign codewords that are explained as well, as far as it was needed.
    by_chance: f32,
}

/// Rejects the connected components of a depth map (camera z, mm) that are not explained, as
/// [`PixelStatus::Ambiguous`], and those that are explained outside the calibrated volume, as
/// [`PixelStatus::OutsideVolume`]. `refined` comes with the white − black of every pixel; `noise_is_known` says whether
/// χ² is one of noise, and not of a field that is further off than its noise. `alternatives` tells what other
/// explanations the codewords of some pixels have.
pub fn reject_unexplained_components(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    (refined, light): (&Refined, &[f32]),
    settings: &FilterSettings,
    noise_is_known: bool,
    alternatives: impl Fn(&[usize]) -> Alternatives,
) {
    let clear_of = |chi2: f32, unseen: f32| chi2 / settings.clear_chi2 + unseen / settings.clear_unseen;
    let score = |pixels: &Vec<usize>| {
        let median_of = |map: &[f32]| median(&mut pixels.iter().map(|i| map[*i]).collect::<Vec<f32>>());
        let (Some(chi2), Some(unseen)) = (median_of(&refined.chi2), median_of(&refined.unseen)) else {
            let (none, no) = (f32::INFINITY, false);
            return Score { chi2: none, score: none, is_beyond: no, is_unique: no, clear: none, by_chance: 0.0 };
        };
        let light = chi2 / settings.max_component_chi2 + unseen / settings.max_component_unseen;
        let clear = clear_of(chi2, unseen);
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
        Score {
            chi2,
            score,
            is_beyond: other.is_some_and(|o| o.beyond > settings.max_beyond),
            is_unique: other.is_some_and(|o| o.foreign_chi2 >= settings.unique),
            clear,
            by_chance: other.and_then(|o| o.by_chance).unwrap_or(0.0),
        }
    };
    let judge = |(component, sizes): (Vec<u32>, Vec<u32>)| {
        let members = members(&component, &sizes);
        let scores = members.iter().map(score).collect();
        Judgement::new(members, scores, settings)
    };
    let links = Links::new(depth, camera, MAX_SLOPE);
    let mut judgement = judge(links.components(depth, camera.width));
    let is_lost = |s: &&PixelStatus| [PixelStatus::Ambiguous, PixelStatus::OutsideVolume].contains(*s);
    let lost = status.iter().filter(is_lost).count();
    if noise_is_known
        && judgement.unexplained() + lost > (settings.in_pieces * (judgement.decoded + lost) as f32) as usize
    {
        let misfit: Vec<f32> = refined.chi2.iter().zip(&refined.unseen).map(|(chi2, u)| clear_of(*chi2, *u)).collect();
        judgement = judge(pieces(links, depth, light, &misfit, camera));
    }
    let Judgement { limit, max_chi2, explained, decoded, .. } = judgement;
    let ambiguous = status.iter().filter(|s| **s == PixelStatus::Ambiguous).count();
    let unexplained = judgement.unexplained() + ambiguous;
    tracing::debug!(limit, ?max_chi2, explained, decoded, unexplained, "components");
    // How often chance explains as many pixels as a component has, of all that are explained nowhere.
    let tries = |s: &Score, n: usize| s.by_chance * unexplained as f32 / n as f32;
    let may_be_chance = |s: &Score, n: usize| {
        let [few, many] = settings.tries;
        let part = ((tries(s, n) / few).ln() / (many / few).ln()).clamp(0.0, 1.0);
        noise_is_known && part > 0.0 && s.clear > 1.0 - (1.0 - settings.clear_by_chance) * part
    };
    for (pixels, score) in judgement.members.iter().zip(&judgement.scores) {
        let why = match score {
            s if s.is_beyond => PixelStatus::OutsideVolume,
            s if s.score > limit || !s.fits(max_chi2) || may_be_chance(s, pixels.len()) => PixelStatus::Ambiguous,
            _ => continue,
        };
        for &i in pixels {
            (depth[i], status[i]) = (f32::NAN, why);
        }
    }
}

/// The components of a picture, and what is known of them together.
struct Judgement {
    members: Vec<Vec<usize>>,
    scores: Vec<Score>,
    /// Score above which a component is not explained.
    limit: f32,
    /// Largest χ² of an explained component: of any, and of one that is unique.
    max_chi2: [f32; 2],
    /// Number of pixels that are explained, and of all in components.
    explained: usize,
    decoded: usize,
}

impl Judgement {
    fn new(members: Vec<Vec<usize>>, scores: Vec<Score>, settings: &FilterSettings) -> Self {
        // A right depth explains codewords about as well everywhere in a scene.
        let candidates = members.iter().zip(&scores).filter(|(_, s)| s.score < 1.0 && !s.is_beyond);
        let typical = weighted_median(candidates.map(|(pixels, s)| (s.chi2, pixels.len())).collect());
        let max_chi2 =
            settings.chi2_over_typical.map(|times| settings.clear_chi2.max(times * typical.unwrap_or(f32::INFINITY)));
        let is_explained = |s: &Score| s.score < 1.0 && s.fits(max_chi2) && !s.is_beyond;
        let decoded: usize = members.iter().map(Vec::len).sum();
        let of_component = |(p, s): (&Vec<usize>, &Score)| if is_explained(s) { p.len() } else { 0 };
        let explained: usize = members.iter().zip(&scores).map(of_component).sum();
        // Where next to nothing is explained, what is left was found by chance, too.
        let share = (explained as f32 / decoded.max(1) as f32 / settings.explained).min(1.0);
        let limit = settings.max_score_alone + (1.0 - settings.max_score_alone) * share;
        Self { members, scores, limit, max_chi2, explained, decoded }
    }

    /// Returns the number of pixels in components that are not explained.
    fn unexplained(&self) -> usize {
        self.decoded - self.explained
    }
}

impl Score {
    /// Returns whether χ² is no larger than that of any explained component, or of one that is unique.
    fn fits(&self, [of_any, of_unique]: [f32; 2]) -> bool {
        self.chi2 <= if self.is_unique { of_unique } else { of_any }
    }
}

/// Returns the pixels of every component.
fn members(component: &[u32], sizes: &[u32]) -> Vec<Vec<usize>> {
    let mut members: Vec<Vec<usize>> = sizes.iter().map(|n| Vec::with_capacity(*n as usize)).collect();
    for (i, c) in component.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
        members[*c as usize].push(i);
    }
    members
}

/// Returns the median of values that each stand for a number of pixels.
fn weighted_median(mut values: Vec<(f32, usize)>) -> Option<f32> {
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
