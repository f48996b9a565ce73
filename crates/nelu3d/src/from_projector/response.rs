//! Blur and response of the projector, fitted to decoded codewords.

use nalgebra::Point3;
use nelu3d_scan::image::{bilinear, gaussian_blur};
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Image, Projector};
use rayon::prelude::*;

use crate::reconstruct::Codeword;

/// The normalized intensity of a projected value v in `[0, 1]`: v^gamma, blurred, then `offset + scale · v^gamma`.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Response {
    /// Standard deviation of the blur, projector px.
    pub blur_px: f32,
    /// Normalized intensity of a dark projector pixel.
    pub offset: f32,
    /// Normalized intensity that a bright projector pixel adds to it.
    pub scale: f32,
    /// Exponent of the projected value.
    pub gamma: f32,
}

/// Blurs that the coarse search tries, projector px.
const BLURS_PX: [f32; 7] = [0.0, 0.7, 1.2, 1.7, 2.3, 3.2, 4.5];
/// Exponents that the coarse search tries.
const GAMMAS: [f32; 5] = [0.8, 1.0, 1.3, 1.8, 2.2];
/// Standard deviations beyond which a residual does not count for more: what lies there is no blur.
const FAR: f64 = 5.0;
/// Fewest codewords that a response is fitted to.
pub(super) const MIN_CODEWORDS: usize = 500;
/// Number of codewords that are compared at most, about.
const MAX_CODEWORDS: usize = 20_000;

/// The light of a projected pattern before offset and scale, v^gamma, as pixels throw it: squares, side by side. A
/// camera sees stripes of a Gray code of one or two pixels, whose edges are steep beside these.
pub struct Projected {
    /// The pattern, with several samples per pixel along the axes that it changes along.
    image: Image,
    per_px: [usize; 2],
}

impl Projected {
    /// Raises the values of a pattern (one plane; a single row or column where the others are the same) to a power.
    pub fn new(pattern: &Image, gamma: f32) -> Self {
        let per_px = samples_per_px(pattern);
        let [width, height] = [pattern.width * per_px[0], pattern.height * per_px[1]];
        let raised: Vec<f32> = pattern.data.par_iter().map(|v| v.max(0.0).powf(gamma)).collect();
        let mut data = vec![0.0f32; width * height];
        data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let of = &raised[y / per_px[1] * pattern.width..][..pattern.width];
            row.chunks_mut(per_px[0]).zip(of).for_each(|(samples, v)| samples.fill(*v));
        });
        Self { image: Image { width, height, channels: 1, data }, per_px }
    }

    /// Blurs it with a Gaussian, projector px.
    #[must_use]
    pub fn blurred(&self, blur_px: f32) -> Self {
        // Along an axis that it does not change along there is nothing to blur.
        let per_px = self.per_px[0].max(self.per_px[1]) as f32;
        Self { image: gaussian_blur(&self.image, blur_px * per_px), per_px: self.per_px }
    }

    /// Returns its value at a point of the projector's image, px.
    pub fn at(&self, point: [f64; 2]) -> f32 {
        let at = [0, 1].map(|i| (point[i] + 0.5) * self.per_px[i] as f64 - 0.5);
        bilinear(&self.image.data, [self.image.width, self.image.height], at)
    }
}

/// Samples per pixel along x and y that tell what a pattern is between the middles of its pixels.
fn samples_per_px(pattern: &Image) -> [usize; 2] {
    match [pattern.width, pattern.height] {
        [1, _] => [1, 4],
        [_, 1] => [4, 1],
        _ => [2, 2],
    }
}

/// Returns whether an exponent changes more of the patterns than offset and scale do, which is so unless they are made
/// of two values.
pub fn exponent_matters(patterns: &[Image]) -> bool {
    let values = patterns.iter().flat_map(|p| &p.data);
    let (low, high) = values.clone().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let tolerance = 0.01 * (high - low);
    values.into_iter().any(|v| *v > low + tolerance && *v < high - tolerance)
}

/// Fits blur and response to decoded codewords: for every blur and exponent the best affine map, over a coarse and then
/// a fine search. Returns them with what they leave. The exponent stays 1 where it does not matter (see
/// [`exponent_matters`]).
pub fn fit_response(patterns: &[Image], projector: &Projector, codewords: &[Codeword]) -> (Response, Residual) {
    let step = (codewords.len() / MAX_CODEWORDS).max(1);
    let samples: Vec<([f64; 2], &[f32])> = codewords
        .iter()
        .step_by(step)
        .filter_map(|c| Some((projector.project(&Point3::from(c.point))?, &c.intensities[..])))
        .collect();
    let score = |raised: &[Projected], blur_px: f32| -> AffineFit {
        let images: Vec<Projected> = raised.iter().map(|p| p.blurred(blur_px)).collect();
        let pairs: Vec<(f32, f32)> = samples
            .iter()
            .flat_map(|(px, measured)| images.iter().zip(*measured).map(|(i, l)| (i.at(*px), *l)))
            .filter(|(_, l)| l.is_finite())
            .collect();
        AffineFit::robust(&pairs)
    };
    let search = |blurs: &[f32], gammas: &[f32]| {
        let of_gamma = |gamma: &f32| {
            let raised: Vec<Projected> = patterns.iter().map(|p| Projected::new(p, *gamma)).collect();
            blurs.iter().map(|blur| (score(&raised, *blur), *blur, *gamma)).collect::<Vec<_>>()
        };
        gammas
            .iter()
            .flat_map(of_gamma)
            .min_by(|a, b| a.0.residual.median.total_cmp(&b.0.residual.median))
            .expect("there are candidates")
    };
    let matters = exponent_matters(patterns);
    let coarse = search(&BLURS_PX, if matters { &GAMMAS } else { &[1.0] });
    let blurs = [-2, -1, 0, 1, 2].map(|i| (coarse.1 + 0.2 * i as f32).max(0.0));
    let gammas = [0.9, 1.0, 1.1].map(|factor| coarse.2 * factor);
    let (AffineFit { residual, offset, scale }, blur_px, gamma) =
        search(&blurs, if matters { &gammas } else { &gammas[1..2] });
    (Response { blur_px, offset, scale, gamma }, residual)
}

/// What a response leaves of codewords, normalized intensity.
#[derive(Clone, Copy, Debug)]
pub struct Residual {
    /// Median of the absolute values.
    pub median: f64,
    /// Root of the mean square, of which none counts for more than five standard deviations (by the median). Beside
    /// the edges of a binary code next to nothing is left, and at these all that a pixel's χ² has to be measured by.
    pub rms: f64,
}

impl Residual {
    /// Sums residuals up; there is one at least.
    fn of(mut residuals: Vec<f64>) -> Self {
        let median = median(&mut residuals).expect("codewords have usable channels");
        let most = FAR * 1.4826 * median;
        let square = residuals.iter().map(|r| r.min(most).powi(2)).sum::<f64>() / residuals.len() as f64;
        Self { median, rms: square.sqrt() }
    }
}

/// An affine map from projected to measured values.
struct AffineFit {
    residual: Residual,
    offset: f32,
    scale: f32,
}

impl AffineFit {
    /// Fits `l ≈ offset + scale · v` to pairs (v, l) by iteratively reweighted least squares (Geman–McClure), with a
    /// tolerance that shrinks from 0.1 to 0.03.
    fn robust(pairs: &[(f32, f32)]) -> Self {
        let (mut offset, mut scale) = (0.0f64, 1.0f64);
        let mut tolerance = 0.1f64;
        for _ in 0..8 {
            let (mut s, mut sx, mut sxx, mut sy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (v, l) in pairs {
                let (v, l) = (f64::from(*v), f64::from(*l));
                let r = l - offset - scale * v;
                let w = 1.0 / (1.0 + (r / tolerance).powi(2)).powi(2);
                s += w;
                sx += w * v;
                sxx += w * v * v;
                sy += w * l;
                sxy += w * v * l;
            }
            let det = s * sxx - sx * sx;
            if det > 1e-12 {
                offset = (sxx * sy - sx * sxy) / det;
                scale = (s * sxy - sx * sy) / det;
            }
            tolerance = (tolerance * 0.7).max(0.03);
        }
        let residuals: Vec<f64> =
            pairs.iter().map(|(v, l)| (f64::from(*l) - offset - scale * f64::from(*v)).abs()).collect();
        Self { residual: Residual::of(residuals), offset: offset as f32, scale: scale as f32 }
    }
}
