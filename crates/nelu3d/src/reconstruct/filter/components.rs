//! Whole components of a surface that are not explained: a wrong period of the code, or an object outside the volume.
//!
//! A single pixel may have a codeword that nothing explains: a highlight, a mixed pixel, a corner full of
//! interreflection. A whole component whose typical codeword does not fit, fits only with much light of unseen origin,
//! or fits no better than codewords that belong elsewhere, is at a wrong depth. Three patterns that leave no color
//! unused (a la carte) give every codeword some depth on every ray: there it counts alone that a component fits within
//! the noise, without any other light.

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;

use super::settings::FilterSettings;
use crate::reconstruct::refine::Refined;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Rejects the connected components of a depth map (camera z, mm) that are not explained, as
/// [`PixelStatus::Ambiguous`]. `chance` returns which fraction of foreign codewords is explained as well as those of
/// some pixels, where that can be tried. `noise_is_known` says whether χ² is one of noise, and not of a field that is
/// further off than its noise.
pub(super) fn reject_unexplained_components(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    refined: &Refined,
    settings: &FilterSettings,
    noise_is_known: bool,
    chance: impl Fn(&[usize]) -> Option<f32>,
) {
    let (component, sizes) = Links::new(depth, camera, MAX_SLOPE).components(depth, camera.width);
    let mut members: Vec<Vec<usize>> = sizes.iter().map(|n| Vec::with_capacity(*n as usize)).collect();
    for (i, c) in component.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
        members[*c as usize].push(i);
    }
    let score = |pixels: &Vec<usize>| {
        let median_of = |map: &[f32]| median(&mut pixels.iter().map(|i| map[*i]).collect::<Vec<f32>>());
        match (median_of(&refined.chi2), median_of(&refined.unseen)) {
            (Some(chi2), Some(unseen)) if pixels.len() >= settings.min_component => {
                let light = chi2 / settings.max_component_chi2 + unseen / settings.max_component_unseen;
                let clear = chi2 / settings.clear_chi2 + unseen / settings.clear_unseen;
                if light > 1.0 || (noise_is_known && clear < settings.max_score_alone) {
                    tracing::debug!(pixels = pixels.len(), chi2, unseen, "component");
                    return if light > 1.0 { light } else { clear };
                }
                let chance = chance(pixels);
                tracing::debug!(pixels = pixels.len(), chi2, unseen, chance, "component");
                let tested = light + chance.unwrap_or(settings.unknown_chance) / settings.max_component_chance;
                if noise_is_known { tested.min(clear) } else { tested }
            }
            _ => f32::INFINITY,
        }
    };
    let scores: Vec<f32> = members.iter().map(score).collect();
    let decoded: usize = members.iter().map(Vec::len).sum();
    let explained: usize = members.iter().zip(&scores).map(|(p, s)| if *s < 1.0 { p.len() } else { 0 }).sum();
    // Where next to nothing is explained, what is left was found by chance, too.
    let share = (explained as f32 / decoded.max(1) as f32 / settings.explained).min(1.0);
    let limit = settings.max_score_alone + (1.0 - settings.max_score_alone) * share;
    tracing::debug!(limit, explained, decoded, "components");
    for (pixels, _) in members.iter().zip(&scores).filter(|(_, score)| **score > limit) {
        for &i in pixels {
            (depth[i], status[i]) = (f32::NAN, PixelStatus::Ambiguous);
        }
    }
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
        reject_unexplained_components(&mut depth, &mut status, &camera, &refined, &settings, noise_is_known, |_| {
            chance
        });
        [depth[0].is_finite(), depth[49].is_finite()]
    }

    #[test]
    fn light_of_unseen_origin_may_not_buy_a_wrong_period() {
        assert_eq!(kept(20, [0.6, 1.7], [0.0, 0.05], None), [true, true]);
        // Neither χ² 2.5 nor a tenth of unseen light is too much alone.
        assert_eq!(kept(20, [2.5, 0.6], [0.0, 0.09], None), [true, true]);
        assert_eq!(kept(20, [0.6, 2.5], [0.0, 0.1], None), [true, false]);
        assert_eq!(kept(20, [0.6, 0.5], [0.0, 0.3], None), [true, false]);
    }

    #[test]
    fn what_chance_does_not_explain_may_have_more_light_of_unseen_origin() {
        assert_eq!(kept(20, [1.9, 0.4], [0.15, 0.0], Some(0.0)), [true, true]);
        assert_eq!(kept(20, [0.6, 2.5], [0.0, 0.24], Some(0.08)), [true, false]);
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
}
