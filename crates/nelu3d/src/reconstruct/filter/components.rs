//! Whole components of a surface that are not explained: a wrong period of the code, or an object outside the volume.
//!
//! A single pixel may have a codeword that nothing explains: a highlight, a mixed pixel, a corner full of
//! interreflection. A whole component whose typical codeword does not fit, fits only with much light of unseen origin,
//! or fits no better than codewords that belong elsewhere, is at a wrong depth. So is one that fits much worse than the
//! rest of the scene does, a little more where codewords from elsewhere fit far worse still; and one that a point outside
//! the calibrated volume explains far better. Three patterns that leave no color unused (a la carte) give every codeword
//! some depth on every ray: there it counts alone that a component fits within the noise, without any other light.

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;

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
}

/// Rejects the connected components of a depth map (camera z, mm) that are not explained, as
/// [`PixelStatus::Ambiguous`], and those that are explained outside the calibrated volume, as
/// [`PixelStatus::OutsideVolume`]. `noise_is_known` says whether χ² is one of noise, and not of a field that is further
/// off than its noise.
pub fn reject_unexplained_components(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    refined: &Refined,
    settings: &FilterSettings,
    noise_is_known: bool,
    alternatives: impl Fn(&[usize]) -> Alternatives,
) {
    let (component, sizes) = Links::new(depth, camera, MAX_SLOPE).components(depth, camera.width);
    let mut members: Vec<Vec<usize>> = sizes.iter().map(|n| Vec::with_capacity(*n as usize)).collect();
    for (i, c) in component.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
        members[*c as usize].push(i);
    }
    let score = |pixels: &Vec<usize>| {
        let median_of = |map: &[f32]| median(&mut pixels.iter().map(|i| map[*i]).collect::<Vec<f32>>());
        let (Some(chi2), Some(unseen)) = (median_of(&refined.chi2), median_of(&refined.unseen)) else {
            return Score { chi2: f32::INFINITY, score: f32::INFINITY, is_beyond: false, is_unique: false };
        };
        let light = chi2 / settings.max_component_chi2 + unseen / settings.max_component_unseen;
        let clear = chi2 / settings.clear_chi2 + unseen / settings.clear_unseen;
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
            tracing::debug!(pixels = pixels.len(), chi2, unseen, ?other, score, "component");
        }
        Score {
            chi2,
            score,
            is_beyond: other.is_some_and(|o| o.beyond > settings.max_beyond),
            is_unique: other.is_some_and(|o| o.foreign_chi2 >= settings.unique),
        }
    };
    let scores: Vec<Score> = members.iter().map(score).collect();
    // A right depth explains codewords about as well everywhere in a scene.
    let candidates = members.iter().zip(&scores).filter(|(_, s)| s.score < 1.0 && !s.is_beyond);
    let typical = weighted_median(candidates.map(|(pixels, s)| (s.chi2, pixels.len())).collect());
    let max_chi2 =
        settings.chi2_over_typical.map(|times| settings.clear_chi2.max(times * typical.unwrap_or(f32::INFINITY)));
    let fits = |s: &Score| s.chi2 <= max_chi2[usize::from(s.is_unique)];
    let is_explained = |s: &Score| s.score < 1.0 && fits(s) && !s.is_beyond;
    let decoded: usize = members.iter().map(Vec::len).sum();
    let explained: usize = members.iter().zip(&scores).map(|(p, s)| if is_explained(s) { p.len() } else { 0 }).sum();
    // Where next to nothing is explained, what is left was found by chance, too.
    let share = (explained as f32 / decoded.max(1) as f32 / settings.explained).min(1.0);
    let limit = settings.max_score_alone + (1.0 - settings.max_score_alone) * share;
    tracing::debug!(limit, ?max_chi2, explained, decoded, "components");
    for (pixels, score) in members.iter().zip(&scores) {
        let why = match score {
            s if s.is_beyond => PixelStatus::OutsideVolume,
            s if s.score > limit || !fits(s) => PixelStatus::Ambiguous,
            _ => continue,
        };
        for &i in pixels {
            (depth[i], status[i]) = (f32::NAN, why);
        }
    }
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
