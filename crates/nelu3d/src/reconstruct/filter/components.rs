//! Whole components of a surface that are not explained: a wrong period of the code, or an object outside the volume.
//!
//! A single pixel may have a codeword that nothing explains: a highlight, a mixed pixel, a corner full of
//! interreflection. A whole component whose typical codeword does not fit, fits only with much light of unseen origin,
//! or fits no better than codewords that belong elsewhere, is at a wrong depth. So is one that fits much worse than the
//! rest of the scene does, and one that a point outside the calibrated volume explains far better. Three patterns that
//! leave no color unused (a la carte) give every codeword some depth on every ray: there it counts alone that a
//! component fits within the noise, without any other light.

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;

use super::settings::FilterSettings;
use crate::reconstruct::refine::Refined;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// What other explanations the codewords of a component have.
#[derive(Clone, Copy, Debug)]
pub(super) struct Alternatives {
    /// Fraction of foreign codewords that are explained as well as the component's own; `None` where that cannot be
    /// tried.
    pub(super) by_chance: Option<f32>,
    /// Fraction of the component's pixels that a point outside the calibrated volume explains far better, beyond what
    /// chance does.
    pub(super) beyond: f32,
}

/// What is known of a component.
struct Score {
    /// Median χ² per measurement.
    chi2: f32,
    /// From 1 on it is not explained.
    score: f32,
    /// It is explained outside the calibrated volume.
    is_beyond: bool,
}

/// Rejects the connected components of a depth map (camera z, mm) that are not explained, as
/// [`PixelStatus::Ambiguous`], and those that are explained outside the calibrated volume, as
/// [`PixelStatus::OutsideVolume`]. `noise_is_known` says whether χ² is one of noise, and not of a field that is further
/// off than its noise.
pub(super) fn reject_unexplained_components(
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
            return Score { chi2: f32::INFINITY, score: f32::INFINITY, is_beyond: false };
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
        Score { chi2, score, is_beyond: other.is_some_and(|o| o.beyond > settings.max_beyond) }
    };
    let scores: Vec<Score> = members.iter().map(score).collect();
    // A right depth explains codewords about as well everywhere in a scene.
    let candidates = members.iter().zip(&scores).filter(|(_, s)| s.score < 1.0 && !s.is_beyond);
    let typical = weighted_median(candidates.map(|(pixels, s)| (s.chi2, pixels.len())).collect());
    let max_chi2 = settings.clear_chi2.max(settings.chi2_over_typical * typical.unwrap_or(f32::INFINITY));
    let is_explained = |s: &Score| s.score < 1.0 && s.chi2 <= max_chi2 && !s.is_beyond;
    let decoded: usize = members.iter().map(Vec::len).sum();
    let explained: usize = members.iter().zip(&scores).map(|(p, s)| if is_explained(s) { p.len() } else { 0 }).sum();
    // Where next to nothing is explained, what is left was found by chance, too.
    let share = (explained as f32 / decoded.max(1) as f32 / settings.explained).min(1.0);
    let limit = settings.max_score_alone + (1.0 - settings.max_score_alone) * share;
    tracing::debug!(limit, max_chi2, explained, decoded, "components");
    for (pixels, score) in members.iter().zip(&scores) {
        let why = match score {
            s if s.is_beyond => PixelStatus::OutsideVolume,
            s if s.score > limit || s.chi2 > max_chi2 => PixelStatus::Ambiguous,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether two flat pieces, `first` and 20 pixels wide and 20 high, at different depths, are kept.
    fn kept(first: usize, chi2: [f32; 2], unseen: [f32; 2], chance: Option<f32>) -> [bool; 2] {
        kept_where(false, first, chi2, unseen, chance)
    }

    /// The same, where the noise is known or not.
    fn kept_where(
        noise_is_known: bool,
        first: usize,
        chi2: [f32; 2],
        unseen: [f32; 2],
        chance: Option<f32>,
    ) -> [bool; 2] {
        statuses(noise_is_known, first, chi2, unseen, chance, [0.0; 2]).map(|s| s == PixelStatus::Valid)
    }

    /// The status of the two pieces, of which a fraction `beyond` of the pixels is explained outside the volume.
    fn statuses(
        noise_is_known: bool,
        first: usize,
        chi2: [f32; 2],
        unseen: [f32; 2],
        chance: Option<f32>,
        beyond: [f32; 2],
    ) -> [PixelStatus; 2] {
        let camera = Camera::pinhole(50, 20, 500.0, 500.0, 25.0, 10.0);
        let n = camera.n_pixels();
        let piece = |i: usize| match i % 50 {
            x if x < first => Some(0),
            30.. => Some(1),
            _ => None,
        };
        let mut depth: Vec<f32> = (0..n).map(|i| piece(i).map_or(f32::NAN, |p| [700.0, 600.0][p])).collect();
        let mut refined = Refined::empty(n, Vec::new(), Vec::new());
        for i in 0..n {
            let Some(p) = piece(i) else { continue };
            (refined.chi2[i], refined.unseen[i]) = (chi2[p], unseen[p]);
        }
        let mut status = vec![PixelStatus::Valid; n];
        let settings = FilterSettings::default();
        let alternatives = |pixels: &[usize]| {
            let piece = piece(pixels[0]).expect("components consist of pieces");
            Alternatives { by_chance: chance, beyond: beyond[piece] }
        };
        reject_unexplained_components(
            &mut depth,
            &mut status,
            &camera,
            &refined,
            &settings,
            noise_is_known,
            alternatives,
        );
        for i in 0..n {
            assert_eq!(depth[i].is_finite(), piece(i).is_some() && status[i] == PixelStatus::Valid);
        }
        [status[0], status[49]]
    }

    #[test]
    fn light_of_unseen_origin_may_not_buy_a_wrong_period() {
        assert_eq!(kept(20, [0.6, 1.7], [0.0, 0.05], None), [true, true]);
        // Neither χ² 2.5 nor a tenth of unseen light is too much alone.
        assert_eq!(kept(20, [2.5, 0.7], [0.0, 0.09], None), [true, true]);
        assert_eq!(kept(20, [0.7, 2.5], [0.0, 0.1], None), [true, false]);
        assert_eq!(kept(20, [0.6, 0.5], [0.0, 0.3], None), [true, false]);
    }

    #[test]
    fn what_chance_does_not_explain_may_have_more_light_of_unseen_origin() {
        assert_eq!(kept(20, [1.9, 0.5], [0.15, 0.0], Some(0.0)), [true, true]);
        assert_eq!(kept(20, [0.7, 2.5], [0.0, 0.24], Some(0.08)), [true, false]);
        // A codeword as good as that has half of all that do not belong there.
        assert_eq!(kept(20, [0.3, 0.3], [0.0, 0.0], Some(0.3)), [true, true]);
        assert_eq!(kept(20, [0.3, 0.3], [0.0, 0.0], Some(0.55)), [false, false]);
    }

    #[test]
    fn what_fits_within_known_noise_need_not_differ_from_chance() {
        // A real scan under three a la carte patterns: every codeword has some depth on every ray.
        assert_eq!(kept_where(true, 20, [1.06, 0.91], [0.0, 0.01], Some(0.6)), [true, true]);
        assert_eq!(kept_where(false, 20, [1.06, 0.91], [0.0, 0.01], Some(0.6)), [false, false]);
        // What wrong pieces had at best.
        assert_eq!(kept_where(true, 20, [1.06, 2.8], [0.0, 0.0], Some(0.6)), [true, false]);
        assert_eq!(kept_where(true, 20, [1.06, 0.9], [0.0, 0.09], Some(0.6)), [true, false]);
    }

    #[test]
    fn what_is_explained_among_nothing_else_is_chance() {
        assert_eq!(kept(20, [2.8, 9.0], [0.0, 0.3], None), [true, false]);
        assert_eq!(kept(3, [2.8, 9.0], [0.0, 0.3], None), [false, false]);
        assert_eq!(kept(3, [1.0, 9.0], [0.0, 0.3], None), [true, false]);
    }

    #[test]
    fn a_wrong_period_fits_much_worse_than_the_rest_of_the_scene() {
        // Three boards by hand under 2 × 3 phases, sine + triangle + random; then a right piece of a real scene.
        assert_eq!(kept(28, [0.57, 3.03], [0.009, 0.001], Some(0.03)), [true, false]);
        assert_eq!(kept(28, [0.38, 2.17], [0.006, 0.048], Some(0.03)), [true, false]);
        assert_eq!(kept(28, [1.08, 3.52], [0.04, 0.0], Some(0.06)), [true, true]);
        // What is within the noise is right however good the rest is, and the larger piece tells what is typical.
        assert_eq!(kept(28, [0.1, 1.7], [0.0, 0.0], Some(0.0)), [true, true]);
        assert_eq!(kept(3, [3.0, 0.5], [0.0, 0.0], Some(0.0)), [false, true]);
    }

    #[test]
    fn what_a_point_outside_the_volume_explains_better_lies_there() {
        use PixelStatus::{OutsideVolume, Valid};
        let beyond = |beyond| statuses(false, 20, [3.5, 1.5], [0.09, 0.0], Some(0.07), beyond);
        assert_eq!(beyond([0.52, 0.0]), [OutsideVolume, Valid]);
        assert_eq!(beyond([0.2, 0.0]), [Valid, Valid]);
    }
}
