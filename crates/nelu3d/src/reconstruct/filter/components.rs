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

use super::judgement::{Alternatives, Judgement, Score, members};
use super::pieces::pieces;
use super::settings::FilterSettings;
use crate::reconstruct::refine::Refined;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Rejects the connected components of a depth map (camera z, mm) that are not explained, as
/// [`PixelStatus::Ambiguous`], and those that are explained outside the calibrated volume, as
/// [`PixelStatus::OutsideVolume`]. `refined` comes with the white − black of every pixel; `noise_is_known` says whether
/// χ² is one of noise, and not of a field that is further off than its noise. `alternatives` tells what other
/// explanations the codewords of some pixels have, `is_elsewhere` whether a pixel is explained outside the volume.
pub fn reject_unexplained_components(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    (refined, light): (&Refined, &[f32]),
    settings: &FilterSettings,
    noise_is_known: bool,
    (alternatives, is_elsewhere): (impl Fn(&[usize]) -> Alternatives, impl Fn(usize) -> bool),
) {
    let judge = |(component, sizes): (Vec<u32>, Vec<u32>)| {
        let members = members(&component, &sizes);
        let score = |pixels: &Vec<usize>| Score::of(pixels, refined, settings, noise_is_known, &alternatives);
        let scores = members.iter().map(score).collect();
        Judgement::new(members, scores, settings)
    };
    let links = Links::new(depth, camera, MAX_SLOPE);
    let mut judgement = judge(links.components(depth, camera.width));
    let is_lost = |s: &&PixelStatus| [PixelStatus::Ambiguous, PixelStatus::OutsideVolume].contains(*s);
    let lost = status.iter().filter(is_lost).count();
    let [nowhere, all] = [judgement.decoded - judgement.explained, judgement.decoded].map(|n| (n + lost) as f32);
    let much_is_nowhere = noise_is_known && nowhere > settings.in_pieces * all;
    if much_is_nowhere {
        let of_pixel = |(chi2, unseen): (&f32, &f32)| settings.clear(*chi2, *unseen);
        let misfit: Vec<f32> = refined.chi2.iter().zip(&refined.unseen).map(of_pixel).collect();
        judgement = judge(pieces(links, depth, light, &misfit, camera));
    }
    let Judgement { limit, max_chi2, explained, decoded, .. } = judgement;
    let ambiguous = (0..status.len()).filter(|i| status[*i] == PixelStatus::Ambiguous);
    let is_nowhere = |i: &usize| !(much_is_nowhere && is_elsewhere(*i));
    let unexplained = judgement.unexplained().copied().chain(ambiguous).filter(is_nowhere).count();
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
