//! The direction of a code's stripes in the light's frame.

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::columns::Columns;

/// Coherence of a channel's gradients, (λ₁ − λ₂) / (λ₁ + λ₂) of their structure tensor, from which it has one
/// direction.
const MIN_COHERENCE: f64 = 0.6;
/// Cosine of the angle up to which channels share a direction: stripes of one axis may converge by perspective.
const SAME_DIRECTION: f64 = 0.94;
/// Coherence from which a channel says for itself that it has the direction of others, within an angle of this cosine:
/// noise hides the direction of coarse stripes, but does not turn it. Isotropic patterns that agree by chance are found
/// out on known rays.
const AGREES: (f64, f64) = (0.1, 0.985);
/// Block sizes over which gradients are taken: fine stripes need small ones, coarse stripes are seen over noise in
/// large ones. The first one is a single column.
const BLOCKS: [usize; 5] = [1, 2, 4, 8, 16];
/// Fraction of a channel's variance that means over blocks must keep: what little is left of stripes that are finer
/// than the blocks has another direction.
const MIN_KEPT: f64 = 0.8;
/// Gradients below this fraction of the channel's strongest tell more about noise than about direction.
const STRONG: f64 = 0.3;
/// Fewest gradients that tell a channel's direction.
const MIN_GRADIENTS: usize = 30;
/// Prior standard deviation of the slope's coefficients, which holds them where gradients are few.
const SLOPE_SIGMA: f64 = 0.1;
/// Coefficients of the slope of the stripes as a function of the place: a polynomial of second order.
const TERMS: usize = 6;

/// Channels whose stripes have the same direction, and that direction as a smooth function of the place.
pub(super) struct Axis {
    /// Channels, by index.
    pub(super) channels: Vec<usize>,
    /// Mean direction along the stripes, in columns.
    tangent: [f64; 2],
    /// Coefficients of the slope against the mean direction.
    slope: SVector<f64, TERMS>,
    /// Columns along a and b.
    n: [usize; 2],
    /// Unit direction along the stripes in the middle of every column.
    directions: Vec<[f32; 2]>,
}

/// Gradient of a channel at a place.
struct Gradient {
    at: [f64; 2],
    g: [f64; 2],
}

/// The gradients of a channel, and what direction they have.
struct Directed {
    gradients: Vec<Gradient>,
    /// (λ₁ − λ₂) / (λ₁ + λ₂) of their structure tensor.
    coherence: f64,
    /// Unit direction along the stripes.
    tangent: [f64; 2],
}

/// The terms of the slope's polynomial at a place, which is scaled to −1 … 1.
fn terms(n: [usize; 2], at: [f64; 2]) -> SVector<f64, TERMS> {
    let [x, y] = [0, 1].map(|i| 2.0 * at[i] / n[i] as f64 - 1.0);
    SVector::from([1.0, x, y, x * x, x * y, y * y])
}

fn normal([x, y]: [f64; 2]) -> [f64; 2] {
    [-y, x]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl Axis {
    /// Returns the unit direction along the stripes at a place in the field, in columns: that of the column's middle.
    #[inline]
    pub(super) fn along(&self, at: [f32; 2]) -> [f32; 2] {
        let [a, b] = [0, 1].map(|i| (at[i] as usize).min(self.n[i] - 1));
        self.directions[b * self.n[0] + a]
    }

    /// Evaluates the unit direction along the stripes at a place, in columns.
    fn direction(&self, at: [f32; 2]) -> [f32; 2] {
        let slope = self.slope.dot(&terms(self.n, at.map(f64::from)));
        let n = normal(self.tangent);
        let t = [self.tangent[0] + slope * n[0], self.tangent[1] + slope * n[1]];
        let norm = 1.0 / t[0].hypot(t[1]);
        [(t[0] * norm) as f32, (t[1] * norm) as f32]
    }

    /// Returns the mean square change of a channel along the stripes.
    fn change(&self, of: &Directed) -> f64 {
        let along = |g: &Gradient| dot(g.g, self.direction(g.at.map(|x| x as f32)).map(f64::from)).powi(2);
        of.gradients.iter().map(along).sum::<f64>() / of.gradients.len() as f64
    }

    /// Finds the slope at which the channels change least along the stripes: Σ (∇c · (t + m n))² is smallest.
    fn fit(channels: Vec<usize>, tangent: [f64; 2], found: &[Directed], n: [usize; 2]) -> Self {
        let mut axis = Self { channels, tangent, slope: SVector::zeros(), n, directions: Vec::new() };
        for _ in 0..3 {
            let normal = normal(axis.tangent);
            let mut h = SMatrix::<f64, TERMS, TERMS>::identity() / (SLOPE_SIGMA * SLOPE_SIGMA);
            let mut r = SVector::<f64, TERMS>::zeros();
            for channel in &axis.channels {
                // Each channel weighs as its gradients agree.
                let weight = 1.0 / axis.change(&found[*channel]).max(1e-9);
                for g in &found[*channel].gradients {
                    let (along, across) = (dot(g.g, axis.tangent), dot(g.g, normal));
                    let phi = terms(n, g.at);
                    h += phi * phi.transpose() * (weight * across * across);
                    r -= phi * (weight * along * across);
                }
            }
            let Some(slope) = h.cholesky().map(|c| c.solve(&r)) else { break };
            axis.slope = slope;
            // About the mean direction slopes are small, where noise in the gradients across biases them least.
            let m = slope[0] + (slope[3] + slope[5]) / 3.0;
            let t = [axis.tangent[0] + m * normal[0], axis.tangent[1] + m * normal[1]];
            let norm = t[0].hypot(t[1]);
            axis.tangent = t.map(|x| x / norm);
            axis.slope[0] -= m;
        }
        let middle = |i: usize| axis.direction([(i % n[0]) as f32 + 0.5, (i / n[0]) as f32 + 0.5]);
        axis.directions = (0..n[0] * n[1]).into_par_iter().map(middle).collect();
        axis
    }
}

/// Finds the directions of the stripes of all channels; `None` if fewer than half of them have one, or if there are
/// more than two. Channels that show none by themselves (stripes nearly as fine as the columns, or a bit that hardly
/// changes) go with the axis along which they change least.
pub(super) fn axes(columns: &Columns) -> Option<Vec<Axis>> {
    let found = (0..columns.k).into_par_iter().map(|channel| of_channel(columns, channel));
    let found: Vec<Directed> = found.collect::<Option<_>>()?;
    let mut groups: Vec<(Vec<usize>, [f64; 2])> = Vec::new();
    for (channel, of) in found.iter().enumerate().filter(|(_, of)| of.coherence > MIN_COHERENCE) {
        match groups.iter_mut().find(|g| dot(g.1, of.tangent).abs() > SAME_DIRECTION) {
            Some((channels, _)) => channels.push(channel),
            None => groups.push((vec![channel], of.tangent)),
        }
    }
    let n_clear: usize = groups.iter().map(|g| g.0.len()).sum();
    let agrees = |of: &&Directed| {
        let weak = of.coherence > AGREES.0 && of.coherence <= MIN_COHERENCE;
        weak && groups.iter().any(|g| dot(g.1, of.tangent).abs() > AGREES.1)
    };
    if 2 * (n_clear + found.iter().filter(agrees).count()) < columns.k || groups.len() > 2 {
        return None;
    }
    let fit = |(channels, tangent)| Axis::fit(channels, tangent, &found, columns.n);
    let mut axes: Vec<Axis> = groups.into_par_iter().map(fit).collect();
    for (channel, of) in found.iter().enumerate().filter(|(_, of)| of.coherence <= MIN_COHERENCE) {
        let nearest = axes.iter_mut().min_by(|a, b| a.change(of).total_cmp(&b.change(of)));
        nearest?.channels.push(channel);
    }
    Some(axes)
}

/// The gradients of a channel, at the block size at which they tell most about its direction.
fn of_channel(columns: &Columns, channel: usize) -> Option<Directed> {
    let mut best: Option<(f64, Directed)> = None;
    let mut whole = 0.0;
    for block in BLOCKS {
        let means = block_means(columns, channel, block);
        if block == 1 {
            whole = variance(&means);
        }
        let gradients = gradients(&means, block, columns);
        if gradients.len() < MIN_GRADIENTS || variance(&means) < MIN_KEPT * whole {
            continue;
        }
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for Gradient { g: [x, y], .. } in &gradients {
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        let coherence = (xx - yy).hypot(2.0 * xy) / (xx + yy);
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        // λ₁ / λ₂ of the structure tensor for every gradient.
        let information = gradients.len() as f64 * (1.0 + coherence) / (1.0 - coherence).max(1e-9);
        if best.as_ref().is_none_or(|b| information > b.0) {
            best = Some((information, Directed { gradients, coherence, tangent: [-angle.sin(), angle.cos()] }));
        }
    }
    let (_, of) = best?;
    tracing::trace!(channel, of.coherence, n = of.gradients.len(), ?of.tangent, "direction of the stripes");
    Some(of)
}

/// Means of a channel over blocks of columns; NaN where a column is not known.
fn block_means(columns: &Columns, channel: usize, block: usize) -> Vec<f32> {
    let [na, nb] = columns.n.map(|n| n / block);
    let mean = |a: usize, b: usize| {
        let mut sum = 0.0;
        for y in b * block..(b + 1) * block {
            for x in a * block..(a + 1) * block {
                let i = y * columns.n[0] + x;
                if !columns.is_known[i] {
                    return f32::NAN;
                }
                sum += columns.values[i * columns.k + channel];
            }
        }
        sum / (block * block) as f32
    };
    (0..na * nb).map(|i| mean(i % na, i / na)).collect()
}

/// Variance of what is known of a map.
fn variance(map: &[f32]) -> f64 {
    let known = || map.iter().filter(|v| v.is_finite()).map(|v| f64::from(*v));
    let (n, sum, squares) = known().fold((0.0, 0.0, 0.0), |(n, s, q), v| (n + 1.0, s + v, q + v * v));
    if n > 0.0 { squares / n - (sum / n) * (sum / n) } else { 0.0 }
}

/// The strong gradients of a map of means over blocks, where all neighbors are known.
fn gradients(map: &[f32], block: usize, columns: &Columns) -> Vec<Gradient> {
    let [na, nb] = columns.n.map(|n| n / block);
    let mut all = Vec::new();
    for b in 1..nb.saturating_sub(1) {
        for a in 1..na.saturating_sub(1) {
            let i = b * na + a;
            // In single columns samples lie off the middle by as much as fine stripes are wide.
            let g = if block == 1 {
                plane(map, columns, i)
            } else {
                [map[i + 1] - map[i - 1], map[i + na] - map[i - na]].map(f64::from)
            };
            if g[0].is_finite() && g[1].is_finite() {
                all.push(Gradient { at: [a, b].map(|x| (x as f64 + 0.5) * block as f64), g });
            }
        }
    }
    let mut sizes: Vec<f64> = all.iter().map(|g| dot(g.g, g.g)).collect();
    if sizes.is_empty() {
        return all;
    }
    let at = sizes.len() * 99 / 100;
    let strongest = *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
    all.retain(|g| dot(g.g, g.g) > STRONG * STRONG * strongest);
    all
}

/// Slopes along a and b of the plane that fits a channel best at the places of the samples in 3 × 3 columns; NaN where
/// one of them is not known.
fn plane(map: &[f32], columns: &Columns, i: usize) -> [f64; 2] {
    let na = columns.n[0];
    let around = || (0..9).map(|j| i - na - 1 + j / 3 * na + j % 3);
    let at = |j: usize| [f64::from(columns.places[j][0]), f64::from(columns.places[j][1]), f64::from(map[j])];
    let mut mean = [0.0; 3];
    around().for_each(|j| mean.iter_mut().zip(at(j)).for_each(|(m, v)| *m += v / 9.0));
    let [mut xx, mut xy, mut yy, mut xv, mut yv] = [0.0; 5];
    for j in around() {
        let p = at(j);
        let [x, y, v] = [p[0] - mean[0], p[1] - mean[1], p[2] - mean[2]];
        (xx, xy, yy, xv, yv) = (xx + x * x, xy + x * y, yy + y * y, xv + x * v, yv + y * v);
    }
    let det = xx * yy - xy * xy;
    [(xv * yy - yv * xy) / det, (yv * xx - xv * xy) / det]
}
