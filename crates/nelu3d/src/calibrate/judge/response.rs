//! Whether codewords depend on how bright a point is, as they do where images are not linear in light.
//!
//! A codeword is a ratio of intensities, so that ink shows what paper would show on the same ray of light. Where values
//! follow a curve (sRGB, gamma with a straight part near black), black and white stay 0 and 1, but what lies between
//! comes out elsewhere for ink than for paper. Light from elsewhere (veiling glare) changes ink's codewords, too, but
//! lifts the dark ones and lowers the bright ones. So ink's codewords are fitted by the field's, what glare may do to
//! them, and a bump between 0 and 1, and the bump tells: as far as paper does not have it, too, where the field is
//! smoother than the code.

use nalgebra::{Matrix3, Vector3};

use crate::calibrate::drawn::Drawn;
use crate::calibrate::placed_sweep::{PlacedSweep, Seen};
use crate::color_field::ColorField;
use crate::color_field::grid::Grid;
use crate::verdict::{Code, Finding, Verdict};

/// Contrast of ink as a fraction of that of the paper around it, at most.
const INK: f32 = 0.5;
/// Fewest samples of ink in a position.
const MIN_SAMPLES: usize = 50;
/// Fewest positions with ink.
const MIN_POSITIONS: usize = 3;
/// Standard deviation of a codeword of ink beside its noise, normalized intensity.
const OTHER_SIGMA: f32 = 0.02;
/// Smallest height of the bump that no linear camera shows, normalized intensity.
const MIN_BUMP: f64 = 0.02;
/// The same in standard errors.
const MIN_SIGMAS: f64 = 6.0;

/// Part of what glare adds to ink's darkest codewords and takes from its brightest that a bump may be: glare is not the
/// same everywhere, and paper's is more where ink's is.
const OF_GLARE: f64 = 0.5;

/// Growth of the variance of noise from dark to bright that sensors do not fall below: theirs is 1 at least, and sRGB has
/// 0.5.
const MIN_GROWTH: f64 = 0.7;
const REMEDY: &str = "take raw images, or linear ones: no gamma, no sRGB, no tone mapping; or state `[camera] response`, \
                      which `nelu3d camera --response` measures";

/// Deviations from the field at one position, of ink and of paper.
#[derive(Clone, Default)]
pub struct InkSums {
    /// Deviations on the ink.
    pub ink: Deviations,
    /// Deviations on the paper.
    pub paper: Deviations,
}

/// Normal equations of the deviation from the field: what glare adds to the darkest codewords and takes from the
/// brightest, and the height of a bump.
#[derive(Clone, Default)]
pub struct Deviations {
    n: usize,
    matrix: Matrix3<f64>,
    right: Vector3<f64>,
}

impl InkSums {
    /// Compares a position's ink and paper with the field.
    pub(super) fn of(field: &ColorField, grid: &Grid, placed: &PlacedSweep<'_>, p: usize, drawn: &Drawn) -> Self {
        let mut s = Self::default();
        let mut c = vec![0.0f32; placed.sweep.k];
        placed.for_each_drawn(p, drawn, |sample, Seen { dir, t }| {
            let (contrast, channels) = (sample.contrast, sample.contrast.len());
            let mean = contrast.iter().sum::<f32>() / channels as f32;
            let of = if mean > INK * sample.around { &mut s.paper } else { &mut s.ink };
            let at = field.frame.along_ray(&dir).at(t);
            if !field.validity.is_lit(at.q) {
                return;
            }
            grid.eval(at.q, &mut c);
            for (j, (v, c)) in sample.values.iter().zip(&c).enumerate().filter(|(j, _)| contrast[j % channels] > 0.0) {
                // Noise of the codeword that is expected: by the measured one, those that came out dark would weigh more.
                let variance = placed.noise.normalized_variance(c.clamp(0.0, 1.0), contrast[j % channels], 0.0);
                of.add(*v, *c, 1.0 / (variance + OTHER_SIGMA * OTHER_SIGMA + sample.edge));
            }
        });
        s
    }
}

impl Deviations {
    /// Adds a measured intensity v where the field has c.
    pub fn add(&mut self, v: f32, c: f32, weight: f32) {
        let (v, c, weight) = (f64::from(v), f64::from(c.clamp(0.0, 1.0)), f64::from(weight));
        // Curves differ most near black: the bump has its peak, 1, at a third.
        let of = Vector3::new(1.0 - c, -c, 6.75 * c * (1.0 - c) * (1.0 - c));
        self.n += 1;
        self.matrix += weight * of * of.transpose();
        self.right += weight * (v - c) * of;
    }
}

/// Judges the bumps of all positions; where they tell nothing, whether noise falls with light (`growth`, bright over
/// dark, of variances). A power of light bends ink's codewords as it bends paper's, but takes the noise of bright places
/// away: where light is bent by a slope s(light), noise is multiplied by s.
pub fn judge(all: &[InkSums], growth: Option<f64>) -> Option<Finding> {
    of_ink(all).or_else(|| of_noise(growth?))
}

fn of_noise(growth: f64) -> Option<Finding> {
    tracing::debug!(growth, "noise, bright over dark");
    (growth < MIN_GROWTH).then(|| {
        let sentence = format!(
            "noise in bright places has {growth:.2} times the variance that it has in dark ones, and light has more of \
             it where it is brighter: images are not linear in light"
        );
        Finding::new(Code::NonlinearResponse, Verdict::Doubtful, sentence, REMEDY).with("noise_growth", growth)
    })
}

fn of_ink(all: &[InkSums]) -> Option<Finding> {
    let (bump, sigma, glare) = bump(all)?;
    tracing::debug!(bump, sigma, glare, samples = all.iter().map(|s| s.ink.n).sum::<usize>(), "mid intensities on ink");
    (bump.abs() > MIN_BUMP.max(MIN_SIGMAS * sigma).max(OF_GLARE * glare)).then(|| {
        let sentence = format!(
            "mid intensities come out {:.2} {} on the board's ink than on its paper in the same light: images are not \
             linear in light",
            bump.abs(),
            if bump > 0.0 { "brighter" } else { "darker" }
        );
        Finding::new(Code::NonlinearResponse, Verdict::Doubtful, sentence, REMEDY)
            .with("mid_deviation", bump)
            .with("mid_sigma", sigma)
    })
}

/// By how much ink's bump is higher than paper's, its standard error, by leaving out one position at a time, and ink's
/// glare, what it adds to the darkest and takes from the brightest codewords; `None` where too little ink is lit, or hardly any intensities lie between black and white.
fn bump(all: &[InkSums]) -> Option<(f64, f64, f64)> {
    let used: Vec<&InkSums> = all.iter().filter(|s| s.ink.n >= MIN_SAMPLES).collect();
    let n = used.len();
    if n < MIN_POSITIONS {
        return None;
    }
    let without = |out: Option<usize>| {
        let height_of = |deviations: fn(&InkSums) -> &Deviations| {
            let kept = used.iter().enumerate().filter(|(i, _)| Some(*i) != out).map(|(_, s)| deviations(s));
            let (matrix, right) =
                kept.fold((Matrix3::zeros(), Vector3::zeros()), |(m, r), s| (m + s.matrix, r + s.right));
            height(&matrix, &right)
        };
        let (of_ink, glare) = height_of(|s| &s.ink)?;
        Some((of_ink - height_of(|s| &s.paper).map_or(0.0, |(of_paper, _)| of_paper), glare))
    };
    let left: Vec<f64> = (0..n).map(|i| Some(without(Some(i))?.0)).collect::<Option<_>>()?;
    let mean = left.iter().sum::<f64>() / n as f64;
    let variance = left.iter().map(|q| (q - mean).powi(2)).sum::<f64>() * (n - 1) as f64 / n as f64;
    let (bump, glare) = without(None)?;
    Some((bump, variance.sqrt(), glare))
}

/// Solves normal equations for the bump's height and glare, both parts of it together, with glare that is not negative: of the four choices of which of its
/// parts are zero, the one that explains most.
fn height(matrix: &Matrix3<f64>, right: &Vector3<f64>) -> Option<(f64, f64)> {
    let solve = |zero: usize| {
        let (mut m, mut r) = (*matrix, *right);
        for i in (0..2).filter(|i| zero >> i & 1 == 1) {
            m.row_mut(i).fill(0.0);
            m.column_mut(i).fill(0.0);
            (m[(i, i)], r[i]) = (1.0, 0.0);
        }
        let x = m.cholesky()?.solve(&r);
        (x.x >= 0.0 && x.y >= 0.0).then(|| (x.dot(&r), (x.z, x.x + x.y)))
    };
    (0..4).filter_map(solve).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, found)| found)
}
