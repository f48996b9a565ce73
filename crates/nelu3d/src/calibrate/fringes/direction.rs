//! The direction of a code's stripes in the light's frame.

use nalgebra::{SMatrix, SVector};

use super::columns::Columns;

/// Coherence of a channel's gradients, (λ₁ − λ₂) / (λ₁ + λ₂) of their structure tensor, from which it has one direction.
const MIN_COHERENCE: f64 = 0.6;
/// Cosine of the angle up to which channels share a direction: stripes of one axis may converge by perspective.
const SAME_DIRECTION: f64 = 0.94;
/// Block sizes over which gradients are taken: fine stripes need small ones, coarse stripes are seen over noise in large
/// ones.
const BLOCKS: [usize; 5] = [1, 2, 4, 8, 16];
/// Gradients below this fraction of the channel's strongest tell more about noise than about direction.
const STRONG: f64 = 0.3;
/// Fewest gradients that tell a channel's direction.
const MIN_GRADIENTS: usize = 30;
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
}

/// Gradient of a channel at a place.
struct Gradient {
    at: [f64; 2],
    g: [f64; 2],
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
    /// Returns the unit direction along the stripes at a place, in columns.
    #[inline]
    pub(super) fn along(&self, at: [f32; 2]) -> [f32; 2] {
        let slope = self.slope.dot(&terms(self.n, at.map(f64::from)));
        let n = normal(self.tangent);
        let t = [self.tangent[0] + slope * n[0], self.tangent[1] + slope * n[1]];
        let norm = 1.0 / t[0].hypot(t[1]);
        [(t[0] * norm) as f32, (t[1] * norm) as f32]
    }

    /// Finds the slope at which the channels change least along the stripes: Σ (∇c · (t + m n))² is smallest.
    fn fit(channels: Vec<usize>, tangent: [f64; 2], gradients: &[Vec<Gradient>], n: [usize; 2]) -> Self {
        let mut axis = Self { channels, tangent, slope: SVector::zeros(), n };
        for _ in 0..3 {
            let normal = normal(axis.tangent);
            let mut h = SMatrix::<f64, TERMS, TERMS>::identity() * 1e-9;
            let mut r = SVector::<f64, TERMS>::zeros();
            for channel in &axis.channels {
                let energy: f64 = gradients[*channel].iter().map(|g| dot(g.g, g.g)).sum();
                for g in &gradients[*channel] {
                    let (along, across) = (dot(g.g, axis.tangent), dot(g.g, normal));
                    let phi = terms(n, g.at);
                    h += phi * phi.transpose() * (across * across / energy);
                    r -= phi * (along * across / energy);
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
        axis
    }
}

/// Finds the directions of the stripes of all channels; `None` if a channel has none, or if there are more than two.
pub(super) fn axes(columns: &Columns) -> Option<Vec<Axis>> {
    let found: Vec<(Vec<Gradient>, [f64; 2])> =
        (0..columns.k).map(|channel| of_channel(columns, channel)).collect::<Option<_>>()?;
    let mut groups: Vec<(Vec<usize>, [f64; 2])> = Vec::new();
    for (channel, (_, tangent)) in found.iter().enumerate() {
        match groups.iter_mut().find(|g| dot(g.1, *tangent).abs() > SAME_DIRECTION) {
            Some((channels, _)) => channels.push(channel),
            None => groups.push((vec![channel], *tangent)),
        }
    }
    let gradients: Vec<Vec<Gradient>> = found.into_iter().map(|f| f.0).collect();
    let axes =
        groups.into_iter().map(|(channels, t)| Axis::fit(channels, t, &gradients, columns.n)).collect::<Vec<_>>();
    (axes.len() <= 2).then_some(axes)
}

/// The gradients of a channel, at the block size at which they agree best, and the direction along its stripes.
fn of_channel(columns: &Columns, channel: usize) -> Option<(Vec<Gradient>, [f64; 2])> {
    let mut best: Option<(f64, Vec<Gradient>, [f64; 2])> = None;
    for block in BLOCKS {
        let gradients = gradients(columns, channel, block);
        if gradients.len() < MIN_GRADIENTS {
            continue;
        }
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for Gradient { g: [x, y], .. } in &gradients {
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        let coherence = (xx - yy).hypot(2.0 * xy) / (xx + yy);
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        if best.as_ref().is_none_or(|b| coherence > b.0) {
            best = Some((coherence, gradients, [-angle.sin(), angle.cos()]));
        }
    }
    let (coherence, gradients, tangent) = best?;
    tracing::trace!(channel, coherence, n = gradients.len(), ?tangent, "direction of the stripes");
    (coherence > MIN_COHERENCE).then_some((gradients, tangent))
}

/// The strong gradients of a channel between means of blocks, where all four neighbors are wholly known.
fn gradients(columns: &Columns, channel: usize, block: usize) -> Vec<Gradient> {
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
    let map: Vec<f32> = (0..na * nb).map(|i| mean(i % na, i / na)).collect();
    let mut all = Vec::new();
    for b in 1..nb.saturating_sub(1) {
        for a in 1..na.saturating_sub(1) {
            let i = b * na + a;
            let g = [map[i + 1] - map[i - 1], map[i + na] - map[i - na]].map(f64::from);
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
