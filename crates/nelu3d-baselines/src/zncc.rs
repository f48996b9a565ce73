//! Zero-mean normalized cross-correlation (Mirdehghan, Chen & Kutulakos, "Optimal Structured Light à la Carte", CVPR 2018):
//! the column whose codeword, less its mean and divided by its norm, looks most like what a pixel saw. It needs no white
//! and no black: ambient light goes with the mean, albedo with the norm.
//!
//! With one pixel, all columns of the epipolar interval (or of the image) are compared. With a window, the correlations of
//! the pixels around, each weighted by its contrast, are summed at equal inverse depth before the best is chosen.
//!
//! The column is refined by Gauss–Newton on |p − a c(u) − b|² with the codeword interpolated (Catmull–Rom); scale and offset
//! are eliminated, and the same step gives the standard deviation. With a window, a plane in inverse depth is then fitted to
//! the refined pixels in it that belong together.

use nelu3d_scan::rig::PatternSet;
use rayon::prelude::*;

use super::captured::Captured;
use super::code::{AxisCode, Code};
use super::coordinates::{Coordinate, DecodedCoordinates};
use super::error::DecodeError;
use super::options::{Columns, DecodeOptions};
use super::triangulate::{Along, Geometry, line_of};
use nelu3d::surface::PixelStatus;

/// Variance of a normalized intensity that noise does not explain: the projected images' eight bits, and, where three images
/// leave no misfit that would tell, what light does besides.
fn model_variance(k: usize) -> f32 {
    let sigma: f32 = if k > 3 { 0.0015 } else { 0.005 };
    sigma * sigma
}

/// Projector px between two inverse depths of the window search.
const LABEL_PX: f32 = 0.5;

/// Most inverse depths of the window search.
const MOST_LABELS: usize = 4096;

/// Rows that are summed together; fixed, so that sums do not depend on the number of threads.
const BAND: usize = 48;

/// Decodes all axes of a code.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
    opts: &DecodeOptions,
) -> Result<DecodedCoordinates, DecodeError> {
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let planes: Vec<(usize, usize)> =
            (0..captured.planes.len()).filter_map(|p| line_of(axis, captured, p).map(|l| (p, l))).collect();
        if planes.len() < 3 {
            return Err(DecodeError::Unsuited {
                set: set.name.clone(),
                method: "zncc",
                problem: format!("it has {} image(s) along one axis", planes.len()),
                remedy: "correlation needs three or more".into(),
            });
        }
        let seen = Seen::new(captured, &planes);
        let blur = opts.blur.unwrap_or_else(|| {
            if planes.len() > 3 {
                blur_from_misfit(&seen, captured, axis, &planes, geometry)
            } else {
                blur_from_contrast(captured, axis, &planes)
            }
        });
        tracing::info!(blur, "zncc");
        let table = Table::new(axis, &planes, blur);
        let window = opts.patch.unwrap_or(if planes.len() >= 6 || opts.columns == Columns::All { 1 } else { 9 });
        let (at, sigma) = if window > 1 {
            windowed(&seen, &table, axis, geometry, captured, opts.min_score, window / 2, &mut status)
        } else {
            single(&seen, &table, axis, geometry, captured, opts, &mut status)
        };
        coordinates.push(Coordinate { axis: axis.axis, at, sigma });
    }
    Ok(DecodedCoordinates { coordinates, status })
}

/// What every pixel saw, `n × k`, and how to compare it.
struct Seen {
    k: usize,
    /// Normalized intensities.
    p: Vec<f32>,
}

impl Seen {
    fn new(captured: &Captured, planes: &[(usize, usize)]) -> Self {
        let k = planes.len();
        let mut p = vec![0.0; captured.status.len() * k];
        p.par_chunks_mut(k).enumerate().for_each(|(i, out)| {
            for (v, (plane, _)) in out.iter_mut().zip(planes) {
                *v = captured.planes[*plane].p[i];
            }
        });
        Self { k, p }
    }

    fn at(&self, i: usize) -> &[f32] {
        &self.p[i * self.k..(i + 1) * self.k]
    }
}

/// The codewords of all columns.
struct Table {
    /// Columns.
    n: usize,
    /// Light, k lines of n columns.
    lines: Vec<Vec<f32>>,
    /// The same less the mean over the lines and divided by the norm: zero where a column has no contrast.
    normalized: Vec<Vec<f32>>,
}

impl Table {
    fn new(axis: &AxisCode, planes: &[(usize, usize)], blur_px: f32) -> Self {
        let lines: Vec<Vec<f32>> = planes.iter().map(|(_, l)| blurred(&axis.lines[*l].values, blur_px)).collect();
        let (n, k) = (axis.len(), lines.len() as f32);
        let mut normalized = lines.clone();
        for u in 0..n {
            let mean = lines.iter().map(|l| l[u]).sum::<f32>() / k;
            let norm = lines.iter().map(|l| (l[u] - mean).powi(2)).sum::<f32>().sqrt();
            for line in &mut normalized {
                line[u] = if norm > 1e-3 { (line[u] - mean) / norm } else { 0.0 };
            }
        }
        Self { n, lines, normalized }
    }

    /// Correlation of a centered codeword with columns `low..=high`, into `out`. Not divided by the codeword's own norm.
    #[inline]
    fn correlate(&self, centered: &[f32], low: usize, high: usize, out: &mut Vec<f32>) {
        out.clear();
        out.resize(high - low + 1, 0.0);
        for (c, line) in centered.iter().zip(&self.normalized) {
            for (o, t) in out.iter_mut().zip(&line[low..=high]) {
                *o += c * t;
            }
        }
    }

    /// Codeword `j` at a fraction of a column, and its derivative (Catmull–Rom).
    #[inline]
    fn eval(&self, j: usize, u: f32) -> (f32, f32) {
        let line = &self.lines[j];
        let u = u.clamp(0.0, (self.n - 1) as f32);
        let i = (u as usize).min(self.n.saturating_sub(2));
        let f = u - i as f32;
        let at = |k: usize| line[k.min(self.n - 1)];
        let (a, b, c, d) = (at(i.saturating_sub(1)), at(i), at(i + 1), at(i + 2));
        let (m, o) = (0.5 * (c - a), 0.5 * (d - b));
        let (p, q) = (2.0 * (b - c) + m + o, 3.0 * (c - b) - 2.0 * m - o);
        (b + f * (m + f * (q + f * p)), m + f * (2.0 * q + 3.0 * f * p))
    }
}

fn blurred(line: &[f32], sigma: f32) -> Vec<f32> {
    if sigma < 0.05 {
        return line.to_vec();
    }
    let radius = (3.0 * sigma).ceil() as isize;
    let kernel: Vec<f32> = (-radius..=radius).map(|i| (-(i * i) as f32 / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    let last = line.len() as isize - 1;
    (0..=last)
        .map(|u| {
            let tap = |(k, w): (usize, &f32)| w * line[(u + k as isize - radius).clamp(0, last) as usize];
            kernel.iter().enumerate().map(tap).sum::<f32>() / sum
        })
        .collect()
}

/// The codeword less its mean, and its norm.
#[inline]
fn centered(p: &[f32], out: &mut [f32]) -> f32 {
    let mean = p.iter().sum::<f32>() / p.len() as f32;
    let mut square = 0.0;
    for (o, v) in out.iter_mut().zip(p) {
        *o = v - mean;
        square += *o * *o;
    }
    square.sqrt()
}

/// The columns that pixel `i` is compared with.
fn columns(geometry: &Geometry<'_>, axis: &AxisCode, search: Columns, i: usize) -> Option<(usize, usize)> {
    let last = axis.len() - 1;
    match search {
        Columns::All => Some((0, last)),
        Columns::Epipolar => {
            let [low, high] = geometry.interval(i, axis)?;
            Some((low.max(0.0) as usize, (high.max(0.0).ceil() as usize).min(last)))
        }
    }
}

/// The blur of the projected images on the scene, projector px: that with which a sample of pixels is explained best. More
/// than three images are needed: three are explained by any column, up to offset and scale.
fn blur_from_misfit(
    seen: &Seen,
    captured: &Captured,
    axis: &AxisCode,
    planes: &[(usize, usize)],
    geometry: &Geometry<'_>,
) -> f32 {
    let kept: Vec<usize> = (0..captured.status.len()).filter(|i| captured.status[*i] == PixelStatus::Valid).collect();
    let sample: Vec<usize> = kept.iter().copied().step_by((kept.len() / 3000).max(1)).collect();
    let k = seen.k;
    let score = |blur: f32| -> f64 {
        let table = Table::new(axis, planes, blur);
        let one = |(code, scores, refiner): &mut (Vec<f32>, Vec<f32>, Refiner), i: &usize| -> f64 {
            let Some((low, high)) = columns(geometry, axis, Columns::Epipolar, *i) else { return 0.0 };
            centered(seen.at(*i), code);
            table.correlate(code, low, high, scores);
            let at = low + largest(scores).0;
            refiner.refine(&table, seen.at(*i), at as f32, 1.0).map_or(1.0, |_| f64::from(refiner.misfit))
        };
        let all = sample.par_iter().map_init(|| (vec![0.0; k], Vec::new(), Refiner::new(k)), one).collect::<Vec<f64>>();
        nelu3d_scan::statistics::percentile(&mut { all }, 50.0)
    };
    let candidates = (0..=8).map(|i| 0.5 * i as f32);
    candidates.map(|b| (score(b), b)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |b| b.1)
}

/// The blur of the projected images on the scene, projector px, from how much contrast each image lost: blur takes more of a
/// finer image, everything else (ambient light, a projector's black) takes the same of all.
fn blur_from_contrast(captured: &Captured, axis: &AxisCode, planes: &[(usize, usize)]) -> f32 {
    /// Standard deviations of the logarithm of an image's contrast, whose columns the scene does not show evenly, and of the
    /// contrast that all lose.
    const PRIOR: [f32; 2] = [0.1, 0.15];
    let log_deviation = |values: &mut dyn Iterator<Item = f32>, noise: f64| -> f32 {
        let (mut n, mut sum, mut square) = (0.0f64, 0.0f64, 0.0f64);
        for v in values {
            let v = f64::from(v.clamp(-0.5, 1.5));
            (n, sum, square) = (n + 1.0, sum + v, square + v * v);
        }
        let variance = (square - sum * sum / n.max(1.0)) / n.max(1.0) - noise;
        0.5 * variance.max(1e-6).ln() as f32
    };
    let kept: Vec<usize> = (0..captured.status.len()).filter(|i| captured.status[*i] == PixelStatus::Valid).collect();
    let sample: Vec<usize> = kept.iter().copied().step_by((kept.len() / 20_000).max(1)).collect();
    let noise = sample.iter().map(|i| f64::from(captured.variance(*i, 0.5))).sum::<f64>() / sample.len().max(1) as f64;
    let seen: Vec<f32> = planes
        .iter()
        .map(|(p, _)| log_deviation(&mut sample.iter().map(|i| captured.planes[*p].p[*i]), noise))
        .collect();
    let cost = |blur: f32| -> f32 {
        let lost = planes
            .iter()
            .zip(&seen)
            .map(|((_, l), seen)| seen - log_deviation(&mut blurred(&axis.lines[*l].values, blur).into_iter(), 0.0));
        let lost: Vec<f32> = lost.collect();
        // The loss that all share is eliminated.
        let [each, all] = PRIOR.map(|s| 1.0 / (s * s));
        let common = each * lost.iter().sum::<f32>() / (each * lost.len() as f32 + all);
        lost.iter().map(|l| each * (l - common).powi(2)).sum::<f32>() + all * common * common
    };
    let candidates = (0..=16).map(|i| 0.25 * i as f32);
    candidates.map(|b| (cost(b), b)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |b| b.1)
}

/// The best column of every pixel by itself.
fn single(
    seen: &Seen,
    table: &Table,
    axis: &AxisCode,
    geometry: &Geometry<'_>,
    captured: &Captured,
    opts: &DecodeOptions,
    status: &mut [PixelStatus],
) -> (Vec<f32>, Vec<f32>) {
    let k = seen.k;
    let one = |(code, scores, refiner): &mut (Vec<f32>, Vec<f32>, Refiner), (i, status): (usize, &mut PixelStatus)| {
        let mut none = |why| {
            *status = why;
            (f32::NAN, f32::NAN)
        };
        if captured.status[i] != PixelStatus::Valid {
            return none(captured.status[i]);
        }
        let Some((low, high)) = columns(geometry, axis, opts.columns, i) else {
            return none(PixelStatus::OutsideVolume);
        };
        let norm = centered(seen.at(i), code);
        table.correlate(code, low, high, scores);
        let (at, best) = largest(scores);
        if best < opts.min_score * norm || norm <= 0.0 {
            return none(PixelStatus::Ambiguous);
        }
        let noise = captured.variance(i, 0.5) + model_variance(k);
        match refiner.refine(table, seen.at(i), (low + at) as f32, noise) {
            Some(found) => found,
            None => none(PixelStatus::Ambiguous),
        }
    };
    let found: Vec<(f32, f32)> =
        status.par_iter_mut().enumerate().map_init(|| (vec![0.0; k], Vec::new(), Refiner::new(k)), one).collect();
    found.into_iter().unzip()
}

fn largest(scores: &[f32]) -> (usize, f32) {
    let mut best = (0, f32::NEG_INFINITY);
    for (i, s) in scores.iter().enumerate() {
        if *s > best.1 {
            best = (i, *s);
        }
    }
    best
}

/// Scratch of the refinement.
struct Refiner {
    p: Vec<f32>,
    c: Vec<f32>,
    d: Vec<f32>,
    /// Sum of squares that the last codeword left unexplained.
    misfit: f32,
}

impl Refiner {
    fn new(k: usize) -> Self {
        Self { p: vec![0.0; k], c: vec![0.0; k], d: vec![0.0; k], misfit: 0.0 }
    }

    /// The column near `start` that explains the codeword `p` best up to scale and offset, and its standard deviation for
    /// intensities of variance `noise`. `None` where the codeword does not change along the columns, or the scale is not
    /// positive.
    #[inline]
    fn refine(&mut self, table: &Table, p: &[f32], start: f32, noise: f32) -> Option<(f32, f32)> {
        let k = p.len();
        centered(p, &mut self.p);
        let mut u = start;
        let mut information = 0.0;
        for _ in 0..4 {
            let (mut mean_c, mut mean_d) = (0.0, 0.0);
            for j in 0..k {
                (self.c[j], self.d[j]) = table.eval(j, u);
                mean_c += self.c[j];
                mean_d += self.d[j];
            }
            (mean_c, mean_d) = (mean_c / k as f32, mean_d / k as f32);
            let (mut cc, mut cp, mut cd, mut pd, mut dd, mut pp) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
            for j in 0..k {
                let (c, d, p) = (self.c[j] - mean_c, self.d[j] - mean_d, self.p[j]);
                cc += c * c;
                cp += c * p;
                cd += c * d;
                pd += p * d;
                dd += d * d;
                pp += p * p;
            }
            if cc < 1e-6 || cp <= 0.0 {
                return None;
            }
            let scale = cp / cc;
            // The derivative less its part along the codeword (which the scale takes up), times the residual.
            information = scale * scale * (dd - cd * cd / cc);
            self.misfit = pp - cp * scale;
            if information < 1e-8 {
                return None;
            }
            let step = scale * (pd - cp * cd / cc) / information;
            u += step.clamp(-0.7, 0.7);
            if (u - start).abs() > 1.5 {
                u = start;
                break;
            }
            if step.abs() < 1e-3 {
                break;
            }
        }
        // What the codeword leaves unexplained, beyond the noise, is error too.
        let variance = if k > 3 { noise.max(self.misfit / (k - 3) as f32) } else { noise };
        Some((u.clamp(-0.5, table.n as f32 - 0.5), (variance / information).sqrt().max(0.02)))
    }
}

/// The best inverse depth of every pixel's window, as columns.
fn windowed(
    seen: &Seen,
    table: &Table,
    axis: &AxisCode,
    geometry: &Geometry<'_>,
    captured: &Captured,
    min_score: f32,
    radius: usize,
    status: &mut [PixelStatus],
) -> (Vec<f32>, Vec<f32>) {
    let (w, h) = (captured.width, captured.height);
    let labels = ((geometry.longest_interval(axis.axis) / LABEL_PX).ceil() as usize + 1).clamp(2, MOST_LABELS);
    let along: Vec<Option<Along>> = (0..w * h)
        .into_par_iter()
        .map(|i| (captured.status[i] == PixelStatus::Valid).then(|| geometry.along(i, axis.axis)).flatten())
        .collect();
    // Best label and its correlation, band by band.
    let bands: Vec<Vec<(f32, f32)>> = (0..h.div_ceil(BAND))
        .into_par_iter()
        .map(|band| {
            let rows = band * BAND..((band + 1) * BAND).min(h);
            let mut sums = Sums::new(seen, table, &along, w, labels, radius);
            let mut out = Vec::with_capacity(rows.len() * w);
            for y in rows.start.saturating_sub(radius)..(rows.start + radius).min(h) {
                sums.add(y);
            }
            for y in rows {
                if y + radius < h {
                    sums.add(y + radius);
                }
                if y > radius {
                    sums.remove(y - radius - 1);
                }
                out.extend((0..w).map(|x| sums.best(x)));
            }
            out
        })
        .collect();
    let best: Vec<(f32, f32)> = bands.into_iter().flatten().collect();

    // Each pixel by itself, near the window's column.
    let k = seen.k;
    let refined: Vec<(f32, f32)> = (0..w * h)
        .into_par_iter()
        .map_init(
            || Refiner::new(k),
            |refiner, i| {
                let Some(a) = &along[i] else { return (f32::NAN, f32::NAN) };
                let s = best[i].0;
                let noise = captured.variance(i, 0.5) + model_variance(k);
                let slope = a.slope(s).abs().max(1e-3);
                match refiner.refine(table, seen.at(i), a.at(s), noise) {
                    Some((u, sigma)) => (a.inverse(u), sigma / slope),
                    None => (f32::NAN, f32::NAN),
                }
            },
        )
        .collect();

    // A plane in inverse depth through the window's pixels that belong together.
    let gate = 3.0 / (labels - 1) as f32;
    let one = |(i, status): (usize, &mut PixelStatus)| {
        let mut none = |why| {
            *status = why;
            (f32::NAN, f32::NAN)
        };
        let Some(a) = &along[i] else {
            return none(if captured.status[i] == PixelStatus::Valid {
                PixelStatus::OutsideVolume
            } else {
                captured.status[i]
            });
        };
        let (s, score) = best[i];
        if score.is_nan() || score < min_score {
            return none(PixelStatus::Ambiguous);
        }
        let (x, y) = (i % w, i / w);
        let mut normal = nalgebra::Matrix3::<f32>::zeros();
        let mut rhs = nalgebra::Vector3::<f32>::zeros();
        let mut n = 0;
        for yy in y.saturating_sub(radius)..(y + radius + 1).min(h) {
            for xx in x.saturating_sub(radius)..(x + radius + 1).min(w) {
                let j = yy * w + xx;
                let (v, sigma) = refined[j];
                if !v.is_finite() || (v - s).abs() > gate * (1 + radius) as f32 || (best[j].0 - s).abs() > gate {
                    continue;
                }
                let weight = 1.0 / (sigma * sigma);
                let row = nalgebra::Vector3::new(1.0, xx as f32 - x as f32, yy as f32 - y as f32);
                normal += row * row.transpose() * weight;
                rhs += row * (weight * (v - s));
                n += 1;
            }
        }
        let fitted =
            if n >= 6 { normal.try_inverse().map(|m| ((m * rhs)[0], m[(0, 0)].max(0.0).sqrt())) } else { None };
        let Some((offset, sigma)) = fitted.filter(|f| f.0.abs() <= gate && f.1.is_finite()) else {
            return none(PixelStatus::Ambiguous);
        };
        let u = a.at(s + offset);
        if !(u >= -0.5 && u <= axis.len() as f32 - 0.5) {
            return none(PixelStatus::OutsideVolume);
        }
        (u, sigma * a.slope(s).abs())
    };
    let found: Vec<(f32, f32)> = status.par_iter_mut().enumerate().map(one).collect();
    found.into_iter().unzip()
}

/// Correlations of all labels, summed over windows, of one row; rows go in at the bottom and out at the top.
struct Sums<'a> {
    seen: &'a Seen,
    table: &'a Table,
    along: &'a [Option<Along>],
    width: usize,
    labels: usize,
    radius: usize,
    /// `width × labels`: over the window's rows and columns.
    sum: Vec<f32>,
    /// Norms, summed the same.
    norm: Vec<f32>,
    /// One row before and after the sum over its columns.
    row: Vec<f32>,
    scratch: (Vec<f32>, Vec<f32>),
}

impl<'a> Sums<'a> {
    fn new(
        seen: &'a Seen,
        table: &'a Table,
        along: &'a [Option<Along>],
        width: usize,
        labels: usize,
        radius: usize,
    ) -> Self {
        Self {
            seen,
            table,
            along,
            width,
            labels,
            radius,
            sum: vec![0.0; width * labels],
            norm: vec![0.0; width],
            row: vec![0.0; width * labels],
            scratch: (vec![0.0; seen.k], Vec::new()),
        }
    }

    fn add(&mut self, y: usize) {
        self.apply(y, 1.0);
    }

    /// Computed again instead of kept: a row of correlations is larger than the cache, and quickly made.
    fn remove(&mut self, y: usize) {
        self.apply(y, -1.0);
    }

    fn apply(&mut self, y: usize, sign: f32) {
        let (w, l) = (self.width, self.labels);
        // Only the columns of the row's lit pixels, and a window's reach around them, have anything to sum.
        let lit = |x: &usize| self.along[y * w + x].is_some();
        let (Some(first), Some(last)) = ((0..w).find(lit), (0..w).rev().find(lit)) else { return };
        let (first, last) = (first.saturating_sub(self.radius), (last + self.radius).min(w - 1));
        let mut norms = vec![0.0; w];
        let (code, scores) = &mut self.scratch;
        for x in first..=last {
            let i = y * w + x;
            let out = &mut self.row[x * l..(x + 1) * l];
            out.fill(0.0);
            let Some(a) = &self.along[i] else { continue };
            norms[x] = centered(self.seen.at(i), code);
            let last = self.table.n - 1;
            let (low, high) = (a.a.min(a.b).max(0.0), a.a.max(a.b).min(last as f32));
            if low > high {
                continue;
            }
            let (low, high) = (low as usize, (high.ceil() as usize).min(last));
            self.table.correlate(code, low, high, scores);
            for (s, o) in out.iter_mut().enumerate() {
                let u = a.at(s as f32 / (l - 1) as f32) - low as f32;
                if u >= 0.0 && u <= (high - low) as f32 {
                    let k = (u as usize).min((high - low).saturating_sub(1));
                    let next = scores[(k + 1).min(high - low)];
                    *o = scores[k] + (u - k as f32) * (next - scores[k]);
                }
            }
        }
        // The sum over the window's columns, all labels of a pixel at once.
        let mut running = vec![0.0f32; l];
        let mut running_norm = 0.0;
        for x in first..=last + self.radius {
            if x <= last {
                running.iter_mut().zip(&self.row[x * l..(x + 1) * l]).for_each(|(r, v)| *r += v);
                running_norm += norms[x];
            }
            if let Some(old) = x.checked_sub(2 * self.radius + 1).filter(|old| *old >= first) {
                running.iter_mut().zip(&self.row[old * l..(old + 1) * l]).for_each(|(r, v)| *r -= v);
                running_norm -= norms[old];
            }
            if let Some(center) = x.checked_sub(self.radius).filter(|c| (first..=last).contains(c)) {
                let out = &mut self.sum[center * l..(center + 1) * l];
                out.iter_mut().zip(&running).for_each(|(o, r)| *o += sign * r);
                self.norm[center] += sign * running_norm;
            }
        }
    }

    /// The best inverse depth of pixel x's window, as s in 0 to 1, and its correlation.
    fn best(&self, x: usize) -> (f32, f32) {
        let l = self.labels;
        let scores = &self.sum[x * l..(x + 1) * l];
        let (at, best) = largest(scores);
        // A parabola through the best and its neighbors.
        let mut s = at as f32;
        if at > 0 && at + 1 < l {
            let (a, b) = (scores[at - 1], scores[at + 1]);
            let curvature = a - 2.0 * best + b;
            if curvature < 0.0 {
                s += (0.5 * (a - b) / curvature).clamp(-0.5, 0.5);
            }
        }
        (s / (l - 1) as f32, if self.norm[x] > 1e-4 { best / self.norm[x] } else { f32::NAN })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wave::tests::sinusoids;

    #[test]
    fn columns_come_back_under_any_light_and_between_columns() {
        // Together they repeat after 520 columns.
        let axis = sinusoids(400, &[(40.0, 3), (52.0, 3)]);
        let planes: Vec<(usize, usize)> = (0..6).map(|i| (i, i)).collect();
        let table = Table::new(&axis, &planes, 0.0);
        let mut refiner = Refiner::new(6);
        let (mut code, mut scores) = (vec![0.0; 6], Vec::new());
        for i in 20..3700 {
            let u = i as f32 * 0.1;
            let p: Vec<f32> = (0..6).map(|j| 0.2 + 0.31 * table.eval(j, u).0).collect();
            let norm = centered(&p, &mut code);
            table.correlate(&code, 0, 399, &mut scores);
            let (at, best) = largest(&scores);
            assert!(best <= norm * 1.0001 && best > 0.99 * norm);
            let (found, _) = refiner.refine(&table, &p, at as f32, 1e-6).unwrap();
            assert!((found - u).abs() < 0.01, "{found} for {u}");
        }
    }

    #[test]
    fn interpolation_passes_through_the_columns() {
        let axis = sinusoids(64, &[(16.0, 3)]);
        let table = Table::new(&axis, &[(0, 0), (1, 1), (2, 2)], 0.0);
        for u in 0..64 {
            assert!((table.eval(1, u as f32).0 - axis.lines[1].values[u]).abs() < 1e-6);
        }
        for i in 20..600 {
            let u = i as f32 * 0.1;
            let slope = (table.eval(1, u + 0.01).0 - table.eval(1, u - 0.01).0) / 0.02;
            assert!((slope - table.eval(1, u).1).abs() < 0.01, "{u}");
        }
    }
}
