//! Where a straight edge between black and white lies, from the pixels around it.

use nalgebra::{Matrix2, SMatrix, SVector};

use super::pixels::Pixels;
use crate::least_squares::{LmSettings, Problem, SingularSystem, minimize};
use crate::statistics::order_statistic;

/// Where an edge is expected, px: a slightly bent line through three points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// Where it starts: the corner.
    pub(super) start: [f64; 2],
    /// Unit chord from there.
    pub(super) along: [f64; 2],
    /// Unit normal of the chord, toward the bright side.
    pub(super) normal: [f64; 2],
    /// Length of the chord.
    pub(super) length: f64,
    /// How far the middle lies off the chord, along `normal`: the lens bends lines.
    pub(super) sag: f64,
    /// Relative change of the light per pixel along `normal`.
    pub(super) light: f64,
    /// How far from it the bright side ends, where that is seen, too: it is dark beyond.
    pub(super) next: Option<f64>,
}

/// How far the edge lies from where it was expected.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgeFit {
    /// Offset along the normal at the start, px.
    pub(super) offset: f64,
    /// Change of the offset per pixel along the edge.
    pub(super) slope: f64,
    /// Inverse covariance of the two.
    pub(super) information: Matrix2<f64>,
    /// Gaussian blur beyond the pixel's own area, px.
    pub(super) blur: f64,
    /// Level of the bright side in the middle of the edge.
    pub(super) bright: f64,
}

/// Smallest contrast (linear) that counts as an edge.
const MIN_CONTRAST: f64 = 0.01;
/// A profile may differ from the model by this part of the contrast (RMS) before something else is there.
const MAX_MISFIT: f64 = 0.12;

/// A pixel near an edge.
struct Sample {
    /// Distance along the edge, px.
    s: f64,
    /// Distance from the edge, px, toward the bright side.
    d: f64,
    value: f64,
}

/// Fits the image of a step, blurred by a Gaussian and by the pixel's area, to the pixels within `half_width` of the
/// part `range` of the expected edge.
///
/// The model is symmetric about the edge and lives in linear light, so blur of any amount moves it nowhere; where the
/// bright side is narrow, its other edge is part of the model, in parallel to the first. Offset, slope, blur and the levels of both sides (each linear along the edge, for uneven lighting) are free; `blur` is where
/// the blur starts. Returns `None` where there is no such edge, where it leaves the image, and where it is clipped.
pub(super) fn fit(
    image: &Pixels,
    edge: &Expected,
    range: [f64; 2],
    half_width: f64,
    blur: Option<f64>,
) -> Option<EdgeFit> {
    let mut samples = samples(image, edge, range, half_width)?;
    // The light's own slope across the edge would pass for a shift of it (of opposite sign on the two sides of a
    // marker, but of the same sign as seen from the image's middle): divided out beforehand.
    samples.iter_mut().for_each(|p| p.value /= 1.0 + edge.light * p.d);
    let mut step = StepFit::new(&samples, edge, range, half_width);
    let start = step.start(blur)?;
    let p = minimize(&mut step, start, &SETTINGS)?;
    step.result(&p)
}

/// At most 30 trials, of which the first ten or so are usually enough. Trials end where damping exceeds 10⁴.
const SETTINGS: LmSettings = LmSettings {
    damping: 1e-4,
    min_damping: 1e-9,
    max_damping: 1e4_f64.next_up(),
    lower: 0.1,
    raise: 10.0,
    max_iterations: 30,
    max_trials: usize::MAX,
    max_total_trials: 30,
    accept_equal: false,
    singular: SingularSystem::Fails,
};

/// Offset and slope (per `reach`) in the middle, σ, dark level and its slope, bright level and its slope.
type StepParameters = SVector<f64, 7>;

/// Standard deviations of the blur beyond which a pixel is dark or bright, and tells nothing of the edge.
const FAR: f64 = 6.0;

/// Sums over pixels far from the edge, of which only the level and its slope along the edge tell.
#[derive(Default)]
struct Plain {
    n: f64,
    u: f64,
    uu: f64,
    r: f64,
    ur: f64,
}

impl Plain {
    /// Adds a pixel at `u` along the edge whose value differs by `r`.
    fn add(&mut self, u: f64, r: f64) {
        self.n += 1.0;
        self.u += u;
        self.uu += u * u;
        self.r += r;
        self.ur += u * r;
    }

    /// Adds the sums to the normal equations of the parameters `at` (level) and `at + 1` (slope).
    fn write(&self, at: usize, a: &mut SMatrix<f64, 7, 7>, g: &mut StepParameters) {
        a[(at, at)] += self.n;
        a[(at, at + 1)] += self.u;
        a[(at + 1, at)] += self.u;
        a[(at + 1, at + 1)] += self.uu;
        g[at] += self.r;
        g[at + 1] += self.ur;
    }
}

/// The least-squares problem of a blurred step.
struct StepFit<'a> {
    samples: &'a [Sample],
    half_width: f64,
    /// Where the bright side ends.
    next: Option<f64>,
    /// Middle of the range along the edge, and half its length, px.
    middle: f64,
    reach: f64,
    /// The pixel's extent along the larger and the smaller component of the normal, px.
    box_width: f64,
    box_minor: f64,
    /// Smallest σ, px.
    min_sigma: f64,
    /// Normal equations, right-hand side and cost: of the last evaluation, and of the parameters accepted last.
    tried: (SMatrix<f64, 7, 7>, StepParameters, f64),
    accepted: (SMatrix<f64, 7, 7>, StepParameters, f64),
    /// Change of offset and slope in the last step.
    shift: f64,
}

impl<'a> StepFit<'a> {
    fn new(samples: &'a [Sample], edge: &Expected, range: [f64; 2], half_width: f64) -> Self {
        let box_minor = edge.normal[0].abs().min(edge.normal[1].abs());
        let none = (SMatrix::zeros(), StepParameters::zeros(), f64::INFINITY);
        Self {
            samples,
            half_width,
            next: edge.next,
            middle: 0.5 * (range[0] + range[1]),
            reach: 0.5 * (range[1] - range[0]),
            box_width: edge.normal[0].abs().max(edge.normal[1].abs()),
            box_minor,
            min_sigma: (0.15f64.powi(2) + box_minor * box_minor / 12.0).sqrt(),
            tried: none,
            accepted: none,
            shift: f64::INFINITY,
        }
    }

    /// Takes the levels from the extremes and the offset from the area under the profile. `None` without contrast.
    fn start(&self, blur: Option<f64>) -> Option<StepParameters> {
        let n = self.samples.len();
        let mut values: Vec<f64> = self.samples.iter().map(|p| p.value).collect();
        let dark = order_statistic(&mut values, n / 10);
        let bright = order_statistic(&mut values, n - 1 - n / 10);
        if bright - dark < MIN_CONTRAST {
            return None;
        }
        let lit = |p: &Sample| ((p.value - dark) / (bright - dark)).clamp(0.0, 1.0);
        let bright_fraction = self.samples.iter().map(lit).sum::<f64>() / n as f64;
        let sigma = blur.unwrap_or(0.7).hypot(self.box_minor / 12f64.sqrt()).clamp(self.min_sigma, self.half_width);
        let offset = self.half_width * (1.0 - 2.0 * bright_fraction);
        Some(StepParameters::from([offset, 0.0, sigma, dark, 0.0, bright, 0.0]))
    }

    /// Returns normal equations, right-hand side and cost.
    fn evaluate(&self, p: &StepParameters) -> (SMatrix<f64, 7, 7>, StepParameters, f64) {
        let (mut a, mut g, mut cost) = (SMatrix::<f64, 7, 7>::zeros(), StepParameters::zeros(), 0.0);
        let (mut dark, mut bright) = (Plain::default(), Plain::default());
        let far = FAR * p[2] + 0.5 * self.box_width;
        for q in self.samples {
            let u = (q.s - self.middle) / self.reach;
            let d = q.d - p[0] - p[1] * u;
            if d < -far {
                let r = q.value - (p[3] + p[4] * u);
                cost += r * r;
                dark.add(u, r);
                continue;
            }
            if d > far && self.next.is_none_or(|next| d < next - far) {
                let r = q.value - (p[5] + p[6] * u);
                cost += r * r;
                bright.add(u, r);
                continue;
            }
            let (mut step, mut by_d, mut by_sigma) = blurred_step(d, self.box_width, p[2]);
            if let Some(next) = self.next {
                let end = blurred_step(d - next, self.box_width, p[2]);
                (step, by_d, by_sigma) = (step - end.0, by_d - end.1, by_sigma - end.2);
            }
            let (lo, hi) = (p[3] + p[4] * u, p[5] + p[6] * u);
            let (contrast, r) = (hi - lo, q.value - (lo + (hi - lo) * step));
            let (fall, rise) = (1.0 - step, step);
            let by_offset = -contrast * by_d;
            let j =
                StepParameters::from([by_offset, by_offset * u, contrast * by_sigma, fall, fall * u, rise, rise * u]);
            cost += r * r;
            a.ger(1.0, &j, &j, 1.0);
            g += r * j;
        }
        dark.write(3, &mut a, &mut g);
        bright.write(5, &mut a, &mut g);
        (a, g, cost)
    }

    /// Returns the edge where the fit is good, from the parameters accepted last.
    fn result(&self, p: &StepParameters) -> Option<EdgeFit> {
        let n = self.samples.len() as f64;
        let (mut a, _, cost) = self.accepted;
        let contrast = p[5] - p[3];
        let variance = (cost / (n - 7.0).max(1.0)).max((1e-4 * contrast).powi(2));
        let found =
            contrast >= MIN_CONTRAST && variance.sqrt() < MAX_MISFIT * contrast && p[0].abs() < 0.7 * self.half_width;
        if !found {
            return None;
        }
        for i in 0..7 {
            a[(i, i)] += 1e-12 * n;
        }
        let covariance = a.try_inverse()?.fixed_view::<2, 2>(0, 0) * variance;
        // From the middle and per `reach` to the start and per pixel.
        let to_start = Matrix2::new(1.0, -self.middle / self.reach, 0.0, 1.0 / self.reach);
        let information = (to_start * covariance * to_start.transpose()).try_inverse()?;
        let slope = p[1] / self.reach;
        let blur = (p[2] * p[2] - self.box_minor * self.box_minor / 12.0).max(0.0).sqrt();
        Some(EdgeFit { offset: p[0] - slope * self.middle, slope, information, blur, bright: p[5] })
    }
}

impl Problem for StepFit<'_> {
    type Parameters = StepParameters;

    fn cost(&mut self, p: &StepParameters) -> f64 {
        self.tried = self.evaluate(p);
        self.tried.2
    }

    /// Takes over the last evaluation, which is that of the start or of an accepted step.
    fn linearize(&mut self, _: &StepParameters, cost: f64) -> Option<f64> {
        self.accepted = self.tried;
        Some(cost)
    }

    fn step(&mut self, p: &StepParameters, damping: f64) -> Option<StepParameters> {
        let mut m = self.accepted.0;
        for i in 0..7 {
            m[(i, i)] = m[(i, i)] * (1.0 + damping) + 1e-12 * self.samples.len() as f64;
        }
        let step = m.cholesky()?.solve(&self.accepted.1);
        self.shift = step[0].abs() + step[1].abs();
        let mut next = p + step;
        next[2] = next[2].clamp(self.min_sigma, self.half_width);
        Some(next)
    }

    /// Converges with a step this small: the next would be smaller by another two orders.
    fn accept(&mut self, _: f64, _: f64) -> bool {
        self.accepted = self.tried;
        self.shift < 3e-4
    }

    fn gives_up(&self) -> bool {
        self.shift < 1e-5
    }
}

/// Returns the pixels around an expected edge. `None` where it leaves the image, is clipped, or has too few pixels.
fn samples(image: &Pixels, edge: &Expected, range: [f64; 2], half_width: f64) -> Option<Vec<Sample>> {
    let at = |s: f64, d: f64| -> [f64; 2] {
        std::array::from_fn(|k| edge.start[k] + s * edge.along[k] + d * edge.normal[k])
    };
    let w = half_width + edge.sag.abs();
    let box_of = [at(range[0], -w), at(range[0], w), at(range[1], -w), at(range[1], w)];
    let bound = |k: usize| {
        let values = || box_of.iter().map(|p| p[k]);
        (values().fold(f64::INFINITY, f64::min).ceil(), values().fold(f64::NEG_INFINITY, f64::max).floor())
    };
    let ((x0, x1), (y0, y1)) = (bound(0), bound(1));
    if !(x0 >= 0.0 && y0 >= 0.0 && x1 < image.width as f64 && y1 < image.height as f64) {
        return None;
    }
    let mut samples = Vec::new();
    let mut clipped = 0usize;
    for y in y0 as usize..=y1 as usize {
        for x in x0 as usize..=x1 as usize {
            let v = [x as f64 - edge.start[0], y as f64 - edge.start[1]];
            let s = v[0] * edge.along[0] + v[1] * edge.along[1];
            if s < range[0] || s > range[1] {
                continue;
            }
            let bend = 4.0 * edge.sag * s * (edge.length - s) / (edge.length * edge.length);
            let d = v[0] * edge.normal[0] + v[1] * edge.normal[1] - bend;
            if d.abs() > half_width {
                continue;
            }
            let value = f64::from(image.data[y * image.width + x]);
            if !value.is_finite() {
                return None;
            }
            clipped += usize::from(value >= 1.0);
            samples.push(Sample { s, d, value });
        }
    }
    // A clipped bright side hides where the middle of the step is; single hot pixels do not.
    (samples.len() >= 14 && clipped * 50 <= samples.len()).then_some(samples)
}

/// Evaluates a unit step at 0 seen through a box (one side of the pixel) and a Gaussian: value, and derivatives by d
/// and σ.
///
/// With H(x) = x Φ(x/σ) + σ φ(x/σ), the step is (H(d + b/2) − H(d − b/2)) / b.
fn blurred_step(d: f64, b: f64, sigma: f64) -> (f64, f64, f64) {
    let (hi, lo) = ((d + 0.5 * b) / sigma, (d - 0.5 * b) / sigma);
    let ((cdf_hi, pdf_hi), (cdf_lo, pdf_lo)) = (normal(hi), normal(lo));
    let value = sigma * (hi * cdf_hi + pdf_hi - lo * cdf_lo - pdf_lo) / b;
    (value, (cdf_hi - cdf_lo) / b, (pdf_hi - pdf_lo) / b)
}

/// Returns the normal distribution's cumulative and density (Abramowitz & Stegun 26.2.17, error below 7.5e-8).
fn normal(x: f64) -> (f64, f64) {
    const B: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let pdf = (-0.5 * x * x).exp() * 0.398_942_280_401_432_7;
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let tail = pdf * t * (B[0] + t * (B[1] + t * (B[2] + t * (B[3] + t * B[4]))));
    (if x >= 0.0 { 1.0 - tail } else { tail }, pdf)
}
