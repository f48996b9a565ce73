//! Whether one pattern's image disagrees with all others: a trigger that was missed, a frame that was stale.
//!
//! Where nothing explains a codeword, one image is left out: that which is farthest off. If the rest is explained then,
//! somewhere within the calibrated volume, the image speaks against the others. A codeword that belongs to no place of
//! the volume may come to fit one, too, without the image that tells the difference; but it is not always the same image
//! then, and often an end of the volume fits as well, which does not count.

use rayon::prelude::*;

use crate::reconstruct::cost_volume::{HYPOTHESIS_PX, chi2_of_weighted, saturation};
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::scene::Scene;
use crate::surface::PixelStatus;
use crate::verdict::{Code, Finding, Verdict};

/// Fewest images of which one can be left out: what the others say has to be more than chance.
const MIN_IMAGES: usize = 6;
/// Most pixels that are tried.
const MAX_PIXELS: usize = 400;
/// Largest χ² per measurement of what is explained.
const EXPLAINED: f32 = 3.0;
/// Least difference of an image that disagrees, normalized intensity.
const MIN_DIFFERENCE: f32 = 0.2;

/// Which images, left out, let pixels be explained that are not explained otherwise.
pub struct OddPattern {
    /// Number of pixels that were tried.
    pub tried: usize,
    /// Number of these that are explained without one image, by image.
    pub explained: Vec<usize>,
    /// Number of pixels without depth that the tried ones stand for.
    pub without_depth: usize,
    /// Number of pixels with a depth.
    pub with_depth: usize,
}

impl OddPattern {
    /// Tries the lit pixels of a scene that have no depth although their rays have a part in the calibrated volume.
    /// `None` where the set has too few images.
    pub(in crate::reconstruct) fn of(scene: &Scene<'_>, has_depth: impl Fn(usize) -> bool) -> Option<Self> {
        let n_images = scene.field.metadata.images.len();
        if n_images < MIN_IMAGES {
            return None;
        }
        let status = &scene.measurements.status;
        let is_unexplained = |i: &usize| {
            let [near, far] = scene.rays.range[*i];
            let is_open = matches!(status[*i], PixelStatus::Ambiguous | PixelStatus::OutsideVolume);
            !has_depth(*i) && is_open && near < far
        };
        let pixels: Vec<usize> = (0..status.len()).filter(is_unexplained).collect();
        let tried: Vec<usize> = pixels.iter().copied().step_by(pixels.len().div_ceil(MAX_PIXELS).max(1)).collect();
        let prior = LightFractionPrior::USUAL.weights(&scene.measurements);
        let votes: Vec<usize> =
            tried.par_iter().filter_map(|i| explained_without(*i, scene, n_images, prior)).collect();
        let mut explained = vec![0; n_images];
        votes.iter().for_each(|image| explained[*image] += 1);
        let with_depth = (0..status.len()).filter(|i| has_depth(*i)).count();
        Some(Self { tried: tried.len(), explained, without_depth: pixels.len(), with_depth })
    }

    /// Returns the image that disagrees with the others, and the fraction of the pixels without depth that are explained
    /// without it; `None` where no image does, or more than one.
    pub fn image(&self) -> Option<(usize, f64)> {
        /// Least number of tried pixels.
        const MIN_EXPLAINED: usize = 20;
        /// Least number of pixels, of those that have a depth or could have one.
        const MIN_SHARE: f64 = 0.1;
        /// By how many times it stands out.
        const OVER_NEXT: usize = 5;
        let (image, most) = self.explained.iter().copied().enumerate().max_by_key(|(_, n)| *n)?;
        let next = self.explained.iter().enumerate().filter(|(i, _)| *i != image).map(|(_, n)| *n).max().unwrap_or(0);
        let share = most as f64 / self.tried.max(1) as f64;
        let pixels = share * self.without_depth as f64;
        let is_much = pixels > MIN_SHARE * (pixels + self.with_depth as f64);
        (most >= MIN_EXPLAINED && most > OVER_NEXT * next && is_much).then_some((image, share))
    }

    /// Judges a scene by it; `images` are the names of the patterns.
    pub fn judge(&self, images: &[String]) -> Option<Finding> {
        tracing::debug!(self.tried, explained = ?self.explained, self.without_depth, self.with_depth, "odd pattern");
        let (image, share) = self.image()?;
        let image = images.get(image)?;
        let sentence = format!(
            "{image} disagrees with the other patterns: without it the field explains {:.0} % of what has no depth",
            100.0 * share
        );
        let remedy = "take the scene again, and check the trigger: that image, or its inverse, seems to show another \
                      pattern";
        let finding = Finding::new(Code::PatternDisagrees, Verdict::Doubtful, sentence, remedy);
        Some(finding.with("image", image.as_str()).with("explained_share", share))
    }
}

/// Returns the image without which pixel `i` is explained somewhere within the calibrated volume, but not at its ends.
fn explained_without(i: usize, scene: &Scene<'_>, n_images: usize, prior: [f32; 2]) -> Option<usize> {
    let Scene { rays, field, measurements: m, .. } = scene;
    let (spline, k) = (scene.spline(), m.k);
    let (ray, [near, far]) = (rays.in_frame(i), rays.range[i]);
    let at = |inverse: f32| ray.at(f64::from(1.0 / inverse)).q;
    let (from, to) = (at(1.0 / far), at(1.0 / near));
    let pixels = ((to[0] - from[0]) * spline.pixels()[0]).hypot((to[1] - from[1]) * spline.pixels()[1]);
    let steps = (pixels / HYPOTHESIS_PX).ceil().max(8.0) as usize;
    let (p, inv_var) = (&m.p[i * k..(i + 1) * k], &m.inv_var[i * k..(i + 1) * k]);
    let image = |j: usize| j * n_images / k;
    let (mut c, mut squares, mut weights) = (vec![0.0; k], vec![0.0; n_images], vec![0.0; k]);
    let mut best: Option<(f32, usize)> = None;
    let mut is_first = true;
    let mut is_last = false;
    for n in 0..=steps {
        let q = at(1.0 / far + (1.0 / near - 1.0 / far) * n as f32 / steps as f32);
        if !rays.is_calibrated(i, q, &field.validity) {
            continue;
        }
        spline.eval(q, &mut c);
        squares.fill(0.0);
        (0..k).for_each(|j| squares[image(j)] += inv_var[j] * (p[j] - c[j]).powi(2));
        let odd = (0..n_images).max_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
        (0..k).for_each(|j| weights[j] = if image(j) == odd { 0.0 } else { inv_var[j] });
        let left = m.independent * (1.0 - 1.0 / n_images as f32);
        let chi2 = chi2_of_weighted(m, i, &weights, &c, prior);
        // χ² saturates.
        let limit = EXPLAINED * left / (1.0 + EXPLAINED * left / saturation(m));
        let is_explained = chi2 < limit;
        if is_explained && is_first {
            return None;
        }
        (is_first, is_last) = (false, is_explained);
        let differs = (0..k).any(|j| image(j) == odd && (p[j] - c[j]).abs() > MIN_DIFFERENCE && inv_var[j] > 0.0);
        if is_explained && differs && best.is_none_or(|(least, _)| chi2 < least) {
            best = Some((chi2, odd));
        }
    }
    best.filter(|_| !is_last).map(|(_, odd)| odd)
}
