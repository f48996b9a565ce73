//! Where a straight edge between black and white lies, from the pixels around it.

use nalgebra::{Matrix2, SMatrix, SVector};

use super::refine::Pixels;

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
    /// How far the middle lies off the chord, along `normal`: the lens's doing.
    pub(super) sag: f64,
    /// Relative change of the light per pixel along `normal`.
    pub(super) light: f64,
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

/// Least contrast (linear) that counts as an edge.
const MIN_CONTRAST: f64 = 0.01;
/// A profile may differ from the model by this part of the contrast (RMS) before something else is there.
const MAX_MISFIT: f64 = 0.12;

struct Sample {
    s: f64,
    d: f64,
    value: f64,
}

/// Fits the image of a step, blurred by a Gaussian and by the pixel's area, to the pixels within `half_width` of the part `range`
/// of the expected edge.
///
/// The model is symmetric about the edge and lives in linear light, so blur of any amount moves it nowhere; offset, slope,
/// blur and both sides' levels (each linear along the edge: uneven lighting) are free. `blur` is where that one starts. `None` where there is no such edge,
/// it leaves the image, or is clipped.
pub(super) fn fit(
    image: &Pixels,
    edge: &Expected,
    range: [f64; 2],
    half_width: f64,
    blur: Option<f64>,
) -> Option<EdgeFit> {
    let samples = samples(image, edge, range, half_width)?;
    let n = samples.len() as f64;
    let middle = 0.5 * (range[0] + range[1]);
    let reach = 0.5 * (range[1] - range[0]);

    // The light's own slope across the edge would pass for a shift of it (of opposite sign on the two sides of a marker, but
    // of the same sign as seen from the image's middle): divided out beforehand.
    let samples: Vec<Sample> =
        samples.into_iter().map(|p| Sample { value: p.value / (1.0 + edge.light * p.d), ..p }).collect();

    // Start: levels from the extremes, the offset from the area under the profile.
    let mut values: Vec<f64> = samples.iter().map(|p| p.value).collect();
    values.sort_by(f64::total_cmp);
    let (dark, bright) = (values[values.len() / 10], values[values.len() - 1 - values.len() / 10]);
    if bright - dark < MIN_CONTRAST {
        return None;
    }
    let share = samples.iter().map(|p| ((p.value - dark) / (bright - dark)).clamp(0.0, 1.0)).sum::<f64>() / n;
    let box_width = edge.normal[0].abs().max(edge.normal[1].abs());
    let box_minor = edge.normal[0].abs().min(edge.normal[1].abs());
    let least = (0.15f64.powi(2) + box_minor * box_minor / 12.0).sqrt();
    let sigma = blur.unwrap_or(0.7).hypot(box_minor / 12f64.sqrt()).clamp(least, half_width);
    // Offset and slope (per `reach`) in the middle, σ, dark level and its slope, bright level and its slope.
    let mut p = SVector::<f64, 7>::from([half_width * (1.0 - 2.0 * share), 0.0, sigma, dark, 0.0, bright, 0.0]);
    let evaluate = |p: &SVector<f64, 7>| {
        let (mut a, mut g, mut cost) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros(), 0.0);
        for q in &samples {
            let u = (q.s - middle) / reach;
            let (step, by_d, by_sigma) = blurred_step(q.d - p[0] - p[1] * u, box_width, p[2]);
            let (lo, hi) = (p[3] + p[4] * u, p[5] + p[6] * u);
            let (contrast, r) = (hi - lo, q.value - (lo + (hi - lo) * step));
            let (fall, rise) = (1.0 - step, step);
            let by_offset = -contrast * by_d;
            let j = SVector::<f64, 7>::from([
                by_offset,
                by_offset * u,
                contrast * by_sigma,
                fall,
                fall * u,
                rise,
                rise * u,
            ]);
            cost += r * r;
            a.ger(1.0, &j, &j, 1.0);
            g += r * j;
        }
        (a, g, cost)
    };
    let mut damping = 1e-4;
    let (mut a, mut g, mut cost) = evaluate(&p);
    for _ in 0..30 {
        let mut m = a;
        for i in 0..7 {
            m[(i, i)] = m[(i, i)] * (1.0 + damping) + 1e-12 * n;
        }
        let step = m.cholesky()?.solve(&g);
        let mut next = p + step;
        next[2] = next[2].clamp(least, half_width);
        let (a1, g1, c) = evaluate(&next);
        let moved = step[0].abs() + step[1].abs();
        if c < cost {
            (p, a, g, cost) = (next, a1, g1, c);
            damping = (damping * 0.1).max(1e-9);
            // The next step would be smaller by another two orders.
            if moved < 3e-4 {
                break;
            }
        } else {
            if damping > 1e3 || moved < 1e-5 {
                break;
            }
            damping *= 10.0;
        }
    }
    let contrast = p[5] - p[3];
    let variance = (cost / (n - 7.0).max(1.0)).max((1e-4 * contrast).powi(2));
    let found = contrast >= MIN_CONTRAST && variance.sqrt() < MAX_MISFIT * contrast && p[0].abs() < 0.7 * half_width;
    if !found {
        return None;
    }
    for i in 0..7 {
        a[(i, i)] += 1e-12 * n;
    }
    let covariance = a.try_inverse()?.fixed_view::<2, 2>(0, 0) * variance;
    // From the middle and per `reach` to the start and per pixel.
    let to_start = Matrix2::new(1.0, -middle / reach, 0.0, 1.0 / reach);
    let information = (to_start * covariance * to_start.transpose()).try_inverse()?;
    let slope = p[1] / reach;
    let blur = (p[2] * p[2] - box_minor * box_minor / 12.0).max(0.0).sqrt();
    Some(EdgeFit { offset: p[0] - slope * middle, slope, information, blur, bright: p[5] })
}

/// The pixels around an expected edge: their distance along it and from it.
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

/// A unit step at 0 seen through a box (one side of the pixel) and a Gaussian: value, and derivatives by d and σ.
///
/// With H(x) = x Φ(x/σ) + σ φ(x/σ), the step is (H(d + b/2) − H(d − b/2)) / b.
fn blurred_step(d: f64, b: f64, sigma: f64) -> (f64, f64, f64) {
    let (hi, lo) = ((d + 0.5 * b) / sigma, (d - 0.5 * b) / sigma);
    let ((cdf_hi, pdf_hi), (cdf_lo, pdf_lo)) = (normal(hi), normal(lo));
    let value = sigma * (hi * cdf_hi + pdf_hi - lo * cdf_lo - pdf_lo) / b;
    (value, (cdf_hi - cdf_lo) / b, (pdf_hi - pdf_lo) / b)
}

/// The normal distribution's cumulative and density. Abramowitz & Stegun 26.2.17, error below 7.5e-8.
fn normal(x: f64) -> (f64, f64) {
    const B: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let pdf = (-0.5 * x * x).exp() * 0.398_942_280_401_432_7;
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let tail = pdf * t * (B[0] + t * (B[1] + t * (B[2] + t * (B[3] + t * B[4]))));
    (if x >= 0.0 { 1.0 - tail } else { tail }, pdf)
}
