//! Where between two board positions a pixel's surface lies.
//!
//! Positions stand far apart compared with what a code resolves, so the nearest one is only the start. Along a pixel's
//! ray the code is a curve over inverse depth v = 1/z (disparity is linear in it), of which the table has points.

use super::options::Interpolation;
use super::table::Table;

/// A pixel's place on its curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    /// Depth, mm.
    pub(super) depth: f32,
    /// Squared distance to the measured codeword that remains there.
    pub(super) distance: f32,
    /// Variance of the depth, mm²; infinite when nothing tells.
    pub(super) variance: f32,
}

/// Neighbors looked at on either side.
const REACH: usize = 2;
const N: usize = 2 * REACH + 1;

/// Scratch memory for one thread.
pub(crate) struct Interpolator<'a> {
    table: &'a Table,
    how: Interpolation,
    /// `[neighbor][channel, then depth]`
    samples: Vec<f32>,
    /// Which neighbors can be used.
    there: [bool; N],
    /// dc/dv at what was found, in units of the span that goes with it.
    slopes: Vec<f32>,
    /// Slopes while searching.
    trial: Vec<f32>,
}

impl<'a> Interpolator<'a> {
    pub(crate) fn new(table: &'a Table, how: Interpolation) -> Self {
        let k = table.shape().k;
        Self {
            table,
            how,
            samples: vec![0.0; N * (k + 1)],
            there: [false; N],
            slopes: vec![0.0; k],
            trial: vec![0.0; k],
        }
    }

    fn code(&self, n: usize) -> &[f32] {
        let k = self.slopes.len();
        &self.samples[n * (k + 1)..][..k]
    }

    /// Places a pixel near position `index`, whose squared distance is `distance`. Channels of `query` that are NaN
    /// take no part; `variances` are those of the measurements (of the table's entries are added).
    pub(crate) fn find(
        &mut self,
        pixel: usize,
        index: usize,
        distance: f32,
        query: &[f32],
        variances: &[f32],
    ) -> Found {
        if self.how == Interpolation::None {
            return match self.table {
                Table::Full(t) => {
                    let row = t.row(pixel);
                    let stride = t.shape.stride();
                    self.at_position(|j, p| row[j * stride + p], index, distance, query, variances)
                }
                Table::LowRank(t) => self.at_position(|j, p| t.value(pixel, j, p), index, distance, query, variances),
            };
        }
        let z = self.neighbors(pixel, index);
        let there = self.there;
        let (depth, remains, span) = match self.how {
            Interpolation::None | Interpolation::Parabola => {
                let v = z.map(f32::recip);
                let (from, to) = self.central_differences();
                let (at, remains) = if there[REACH - 1] && there[REACH + 1] {
                    let d = |n: usize| squared(self.code(n), query);
                    vertex([v[REACH - 1], v[REACH], v[REACH + 1]], [d(REACH - 1), distance, d(REACH + 1)])
                } else {
                    (v[REACH], distance)
                };
                (1.0 / at, remains, v[to] - v[from])
            }
            Interpolation::Linear | Interpolation::Cubic => {
                let v = z.map(f32::recip);
                let (from, to) = self.central_differences();
                let mut best = (v[REACH], distance, v[to] - v[from]);
                for (from, to) in [(REACH, REACH + 1), (REACH, REACH - 1)].into_iter().filter(|s| there[s.1]) {
                    let (at, remains) = self.on_segment(from, to, &v, query);
                    if remains < best.1 {
                        best = (at, remains, v[to] - v[from]);
                        std::mem::swap(&mut self.slopes, &mut self.trial);
                    }
                }
                (1.0 / best.0, best.1, best.2)
            }
        };
        let mut information = Information::default();
        let of_table = self.table.variance();
        for ((slope, query), variance) in self.slopes.iter().zip(query).zip(variances) {
            information.add(*slope, *query, variance + of_table);
        }
        Found { depth, distance: remains, variance: information.variance(span, depth) }
    }

    /// A position itself, of a pixel whose values `value(j, p)` are: channel j (k: the depth) at position p, NaN if
    /// missing. Reads what it needs where it is, as nothing else is left to do here.
    #[inline(always)]
    fn at_position(
        &self,
        value: impl Fn(usize, usize) -> f32,
        index: usize,
        distance: f32,
        query: &[f32],
        variances: &[f32],
    ) -> Found {
        let k = query.len();
        // At the ends the position itself: it is not in order with itself, so it is not used.
        let [before, after] = [index.saturating_sub(1), (index + 1).min(self.table.shape().n_positions - 1)];
        let [a, z, b] = [before, index, after].map(|p| value(k, p));
        let usable = |p: usize, z: f32| z > 0.0 && !value(0, p).is_nan();
        let there = [usable(before, a), usable(after, b)];
        let nearing = match there {
            [true, true] => b < a,
            [true, false] => z < a,
            _ => b < z,
        };
        let ordered = |a: f32, b: f32| if nearing { b < a } else { b > a };
        let (from, a) = if there[0] && ordered(a, z) { (before, a) } else { (index, z) };
        let (to, b) = if there[1] && ordered(z, b) { (after, b) } else { (index, z) };
        let mut information = Information::default();
        let of_table = self.table.variance();
        for (j, (query, variance)) in query.iter().zip(variances).enumerate() {
            information.add(value(j, to) - value(j, from), *query, variance + of_table);
        }
        // Of inverse depths.
        let span = (a - b) / (a * b);
        // Anywhere within half a step is as likely.
        let step = (a - z).abs().max((b - z).abs());
        Found { depth: z, distance, variance: information.variance(span, z) + step * step / 12.0 }
    }

    /// Squared distance that the table's step alone can leave at a position.
    pub(crate) fn slack(&mut self, pixel: usize, index: usize, query: &[f32]) -> f32 {
        if !matches!(self.how, Interpolation::None | Interpolation::Parabola) {
            return 0.0;
        }
        self.neighbors(pixel, index);
        let to_next = |n: usize| {
            let pairs = self.code(n).iter().zip(self.code(REACH)).zip(query).filter(|(_, q)| !q.is_nan());
            0.25 * pairs.map(|((a, b), _)| (a - b) * (a - b)).sum::<f32>()
        };
        [REACH - 1, REACH + 1].into_iter().filter(|n| self.there[*n]).map(to_next).fold(0.0, f32::max)
    }

    /// Loads the samples around a position: their depths, and which can be used. Those that are not in order of depth
    /// (of boards that crossed, or of a table in no order) cannot.
    fn neighbors(&mut self, pixel: usize, index: usize) -> [f32; N] {
        let k = self.slopes.len();
        let n_positions = self.table.shape().n_positions;
        let (mut z, mut there) = ([f32::NAN; N], [false; N]);
        // Only the cubic looks at more than the next ones.
        let reach = if self.how == Interpolation::Cubic { REACH } else { 1 };
        for n in REACH - reach..=REACH + reach {
            let Some(p) = (index + n).checked_sub(REACH).filter(|p| *p < n_positions) else { continue };
            let sample = &mut self.samples[n * (k + 1)..][..k + 1];
            there[n] = self.table.sample(pixel, p, sample) && sample[k] > 0.0;
            z[n] = sample[k];
        }
        let nearing = match (there[REACH - 1], there[REACH + 1]) {
            (true, true) => z[REACH + 1] < z[REACH - 1],
            (true, false) => z[REACH] < z[REACH - 1],
            _ => z[REACH + 1] < z[REACH],
        };
        let ordered = |a: f32, b: f32| if nearing { b < a } else { b > a };
        for n in (0..REACH).rev() {
            there[n] &= there[n + 1] && ordered(z[n], z[n + 1]);
        }
        for n in REACH + 1..N {
            there[n] &= there[n - 1] && ordered(z[n - 1], z[n]);
        }
        self.there = there;
        z
    }

    /// Slopes by differences of the nearest neighbors, which are returned; 0 without any.
    fn central_differences(&mut self) -> (usize, usize) {
        let from = if self.there[REACH - 1] { REACH - 1 } else { REACH };
        let to = if self.there[REACH + 1] { REACH + 1 } else { REACH };
        let k = self.slopes.len();
        let ends = self.samples[to * (k + 1)..].iter().zip(&self.samples[from * (k + 1)..]);
        self.slopes.iter_mut().zip(ends).for_each(|(s, (a, b))| *s = a - b);
        (from, to)
    }

    /// The closest point of the curve between two neighboring positions: inverse depth and squared distance. Its slopes
    /// are left in `trial`, in units of the segment.
    fn on_segment(&mut self, from: usize, to: usize, v: &[f32; N], query: &[f32]) -> (f32, f32) {
        let k = query.len();
        let span = v[to] - v[from];
        // Up to four points around the segment, in units of it: 0 and 1 are its ends.
        let (mut at, mut which, mut n) = ([0.0, 1.0, 0.0, 0.0], [from, to, 0, 0], 2);
        if self.how == Interpolation::Cubic {
            let (before, after) = (2 * from - to, 2 * to - from);
            for i in [before, after] {
                if self.there[i] {
                    (at[n], which[n]) = ((v[i] - v[from]) / span, i);
                    n += 1;
                }
            }
        }
        // From the chord's closest point, Gauss–Newton.
        let (mut dot, mut norm) = (0.0, 0.0);
        for j in (0..k).filter(|j| !query[*j].is_nan()) {
            let (a, b) = (self.samples[from * (k + 1) + j], self.samples[to * (k + 1) + j]);
            dot += (query[j] - a) * (b - a);
            norm += (b - a) * (b - a);
        }
        let mut t = if norm > 0.0 { (dot / norm).clamp(0.0, 1.0) } else { 0.5 };
        let curve = Curve { at: &at[..n], which: &which[..n] };
        let (mut best, mut last) = ((t, f32::INFINITY), t);
        for _ in 0..if n == 2 { 1 } else { 6 } {
            let (distance, g, h) = self.evaluate(&curve, t, query);
            last = t;
            if distance < best.1 {
                best = (t, distance);
            }
            let next = if h > 0.0 { (t - g / h).clamp(0.0, 1.0) } else { t };
            if (next - t).abs() < 1e-4 {
                break;
            }
            t = next;
        }
        if last != best.0 {
            self.evaluate(&curve, best.0, query);
        }
        (v[from] + best.0 * span, best.1)
    }

    /// Squared distance of a curve's point at `t` and the two sums of a Gauss–Newton step; its slopes go to `trial`.
    fn evaluate(&mut self, curve: &Curve<'_>, t: f32, query: &[f32]) -> (f32, f32, f32) {
        let k = query.len();
        let (value, slope) = lagrange(curve.at, t);
        let (mut distance, mut g, mut h) = (0.0, 0.0, 0.0);
        for j in 0..k {
            let (mut c, mut d) = (0.0, 0.0);
            for (i, n) in curve.which.iter().enumerate() {
                let s = self.samples[n * (k + 1) + j];
                c += value[i] * s;
                d += slope[i] * s;
            }
            if !query[j].is_nan() {
                let e = c - query[j];
                distance += e * e;
                g += d * e;
                h += d * d;
            }
            self.trial[j] = d;
        }
        (distance, g, h)
    }
}

/// Least squares on a curve: var t = Σ g² var / (Σ g²)², g = dc/dt.
#[derive(Default)]
struct Information {
    /// Σ g²
    sum: f32,
    /// Σ g² var
    spread: f32,
}

impl Information {
    /// Adds a channel, unless it was not measured.
    #[inline(always)]
    fn add(&mut self, slope: f32, query: f32, variance: f32) {
        let g2 = if query.is_nan() { 0.0 } else { slope * slope };
        self.sum += g2;
        self.spread += g2 * variance;
    }

    /// Variance of the depth, mm²; `span` is the unit of t in inverse depth.
    #[inline(always)]
    fn variance(&self, span: f32, depth: f32) -> f32 {
        let per_code = depth * depth * span / self.sum;
        if self.sum > 0.0 { self.spread * per_code * per_code } else { f32::INFINITY }
    }
}

/// The polynomial through some neighbors.
struct Curve<'a> {
    /// Where they lie, in units of the segment.
    at: &'a [f32],
    /// Which they are.
    which: &'a [usize],
}

/// Squared distance over the channels that were measured.
fn squared(code: &[f32], query: &[f32]) -> f32 {
    code.iter().zip(query).filter(|(_, q)| !q.is_nan()).map(|(c, q)| (c - q) * (c - q)).sum()
}

/// Returns Lagrange's basis polynomials over `knots` and their derivatives, at `t`; 0 beyond the number of knots.
///
/// # Panics
///
/// If there are more than four knots.
pub fn lagrange(knots: &[f32], t: f32) -> ([f32; 4], [f32; 4]) {
    let (mut value, mut slope) = ([0.0; 4], [0.0; 4]);
    for (i, a) in knots.iter().enumerate() {
        let (mut p, mut d) = (1.0, 0.0);
        for (_, b) in knots.iter().enumerate().filter(|(m, _)| *m != i) {
            let scale = 1.0 / (a - b);
            d = (d * (t - b) + p) * scale;
            p *= (t - b) * scale;
        }
        (value[i], slope[i]) = (p, d);
    }
    (value, slope)
}

/// Returns the lowest point, `(x, y)`, of the parabola through three points, the middle one the lowest of them; its
/// value is not below 0. Where there is no such parabola it is the middle point.
pub fn vertex(x: [f32; 3], y: [f32; 3]) -> (f32, f32) {
    let (a, b) = (x[0] - x[1], x[2] - x[1]);
    let (p, q) = (y[0] - y[1], y[2] - y[1]);
    // y = y₁ + s u + c u², u = x − x₁.
    let c = (p / a - q / b) / (a - b);
    let s = p / a - c * a;
    if c.is_finite() && c > 0.0 {
        let (lo, hi) = (a.min(b), a.max(b));
        let u = (-0.5 * s / c).clamp(lo, hi);
        (x[1] + u, (y[1] + s * u + c * u * u).max(0.0))
    } else {
        (x[1], y[1])
    }
}
