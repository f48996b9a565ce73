//! The variance of depth that comes from systematic errors, which neighbors share.

use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

use super::zones::Zones;

/// Radii of the squares whose mean errors are told from noise, px: about what the prior averages over, here much and
/// there little.
const RADII: [usize; 2] = [2, 4];
/// Radius over which the size of systematic errors is estimated, px.
const SYSTEMATIC_RADIUS: usize = 16;

/// What neighbors share of the residuals, per pixel of a window.
pub struct Systematic {
    /// Variance of the unknown that comes from it.
    pub variance: Vec<f32>,
    /// Part of the residuals' variance that neighbors do not share, 0 to 1: noise.
    pub unshared: Vec<f32>,
}

/// The errors that scenes have whatever their depth, per channel of a pixel, divided by the noise's standard deviation:
/// what light that no pattern takes away adds to all channels alike, and what scales all of them (a white image that is
/// off, a defocused or mixed code).
pub struct Nuisances<'a> {
    /// `n × k`: one.
    pub offset: &'a [f32],
    /// `n × k`: the predicted normalized intensity.
    pub gain: &'a [f32],
    /// Number of images of patterns, of whatever number of channels.
    pub patterns: usize,
}

impl Nuisances<'_> {
    /// Returns whether enough is left across depth, offset, and gain. If not, neither map is read.
    pub(in crate::reconstruct::refine) fn are_taken(&self) -> bool {
        self.patterns >= MIN_PATTERNS
    }
}

/// Fewest patterns of which depth, offset, and gain leave so much that other errors show in it. Color channels see the
/// same light, unless it is colored, and are off together.
const MIN_PATTERNS: usize = 5;
/// Part of a direction's square that has to be left across the others.
const MIN_LEFT: f32 = 0.02;

/// Tells what is systematic in the residuals of a window, of some width and height, from noise.
///
/// `residuals` and `slopes` are `n × k`: residuals r of the normalized intensities and their slopes g along the
/// unknown, both divided by the noise's standard deviation. Depth has taken from the residuals what lies along g. With
/// five patterns and more, an offset and a gain of the pixel are taken from them as well, and change the unknown by
/// what of them lies along g: in a code of sinusoids, which moves across them, next to nothing. What channel j has
/// across all of these has, averaged over squares of n pixels, variance P_jj/n from noise alone, with P the projection
/// across them. Any variance above that is shared; its size s_j² is estimated over the surroundings, where g points
/// elsewhere. It changes the unknown by Σ g_j s_j / |g|².
///
/// `averaged` is the number of pixels that the unknown averages over, per pixel: squares are as large. What smaller
/// ones share (cells of the color field, say) averages out like noise, and is counted as such.
pub fn systematic(
    residuals: &[f32],
    slopes: &[f32],
    nuisances: &Nuisances<'_>,
    k: usize,
    active: &[bool],
    [w, h]: [usize; 2],
    averaged: &[f32],
) -> Systematic {
    let n = active.len();
    assert!(residuals.len() == n * k && slopes.len() == n * k && n == w * h, "maps of one size");
    if k < 2 {
        return Systematic { variance: vec![0.0; n], unshared: vec![1.0; n] };
    }
    let parts = Parts::new(residuals, slopes, nuisances, k, active);
    let zones = Zones::new(active, [w, h], SYSTEMATIC_RADIUS);
    let around = Around::new(&parts, &zones, nuisances.are_taken(), k);
    let mut out = Systematic { variance: vec![0.0; n], unshared: vec![0.0; n] };
    for (level, radius) in RADII.into_iter().enumerate() {
        // Between two radii, means of both.
        let part = |i: usize| (1.0 - (level_of(averaged[i]) - level as f32).abs()).max(0.0);
        let wanted = |i: &usize| active[*i] && part(*i) > 0.0;
        if !(0..n).any(|i| wanted(&i)) {
            continue;
        }
        let found = of_squares(&parts, &around, k, &Shared::new(active, [w, h], &zones, radius));
        for i in (0..n).filter(wanted) {
            out.variance[i] += part(i) * found.variance[i];
            out.unshared[i] += part(i) * found.unshared[i];
        }
    }
    out
}

/// Returns which of [`RADII`] has squares of so many pixels; between two of them, a number between theirs.
fn level_of(pixels: f32) -> f32 {
    let side = |radius: usize| (2 * radius + 1) as f32;
    let wanted = pixels.max(1.0).sqrt();
    let above = RADII.iter().position(|r| side(*r) >= wanted).unwrap_or(RADII.len() - 1);
    if above == 0 || wanted >= side(RADII[above]) {
        return above as f32;
    }
    let [low, high] = [above - 1, above].map(|level| side(RADII[level]).ln());
    (above - 1) as f32 + (wanted.ln() - low) / (high - low)
}

/// Returns channel j of a map of k, limited: a single outlier (a highlight, an edge) is not what its neighbors share.
fn channel(map: &[f32], j: usize, k: usize) -> Vec<f32> {
    map[j..].iter().step_by(k).map(|v| v.clamp(-10.0, 10.0)).collect()
}

/// Means around every pixel, the same for squares of all sizes.
struct Around {
    /// Per channel, the part of the noise that is seen.
    visible: Vec<Vec<f32>>,
    /// Per channel, the square of the residuals across the slopes.
    across: Vec<Vec<f32>>,
    /// The square of the change by offset and gain; `None` where these are not taken out.
    moved: Option<Vec<f32>>,
}

impl Around {
    fn new(parts: &Parts, zones: &Zones, apart: bool, k: usize) -> Self {
        let square = |map: &[f32]| zones.mean(&map.iter().map(|v| v * v).collect::<Vec<_>>());
        Self {
            visible: (0..k).map(|j| zones.mean(&channel(&parts.visible, j, k))).collect(),
            across: (0..k).map(|j| square(&channel(&parts.across, j, k))).collect(),
            moved: apart.then(|| square(&parts.moved)),
        }
    }
}

/// What squares of one size share.
fn of_squares(parts: &Parts, around: &Around, k: usize, shared: &Shared<'_>) -> Systematic {
    let n = shared.active.len();
    let mut variance = vec![0.0f32; n];
    if let Some(all) = &around.moved {
        let beyond =
            shared.square(&parts.moved).into_iter().zip(all).map(|(s, all)| (s - shared.chance * all).max(0.0));
        variance.iter_mut().zip(beyond).for_each(|(variance, beyond)| *variance = beyond);
    }
    // Of all channels: what is shared, and all.
    let (mut shared_square, mut all_squares) = (vec![0.0f32; n], vec![0.0f32; n]);
    for j in 0..k {
        let across = shared.square(&channel(&parts.across, j, k));
        let of_rest = around.moved.as_ref().map(|_| shared.square(&channel(&parts.rest, j, k)));
        let rest = of_rest.as_ref().unwrap_or(&across);
        for i in (0..n).filter(|i| shared.active[*i]) {
            shared_square[i] += across[i];
            all_squares[i] += around.across[j][i];
            let size = (rest[i] / around.visible[j][i].max(0.05) - shared.chance).max(0.0);
            variance[i] += size * parts.moves[i * k + j].powi(2);
        }
    }
    let unshared = |(shared, all): (&f32, &f32)| if *all > 0.0 { (1.0 - shared / all).clamp(0.0, 1.0) } else { 1.0 };
    Systematic { variance, unshared: shared_square.iter().zip(&all_squares).map(unshared).collect() }
}

/// The parts of the residuals of every pixel, 0 where a pixel is not active or nothing tells its depth.
struct Parts {
    /// Residuals across the slopes, `n × k`.
    across: Vec<f32>,
    /// Residuals across offset and gain as well, `n × k`.
    rest: Vec<f32>,
    /// Part of the noise that is left in `rest`, `n × k`.
    visible: Vec<f32>,
    /// Change of the unknown by an error, `n × k`.
    moves: Vec<f32>,
    /// Change of the unknown by the offset and gain that were found, `n`.
    moved: Vec<f32>,
}

impl Parts {
    fn new(residuals: &[f32], slopes: &[f32], nuisances: &Nuisances<'_>, k: usize, active: &[bool]) -> Self {
        let (n, zeros) = (active.len(), || vec![0.0f32; residuals.len()]);
        let mut out = Self { across: zeros(), rest: zeros(), visible: zeros(), moves: zeros(), moved: vec![0.0; n] };
        let residual = out.across.par_chunks_mut(k).zip(out.rest.par_chunks_mut(k));
        let others = out.visible.par_chunks_mut(k).zip(out.moves.par_chunks_mut(k)).zip(&mut out.moved);
        residual.zip(others).enumerate().with_min_len(1 << 10).for_each(
            |(i, ((across, rest), ((visible, moves), moved)))| {
                let of = |map: &'_ [f32]| map[i * k..(i + 1) * k].to_vec();
                let slopes = &slopes[i * k..(i + 1) * k];
                let square = dot(slopes, slopes);
                if !active[i] || square <= 0.0 {
                    return;
                }
                moves.iter_mut().zip(slopes).for_each(|(m, g)| *m = g / square);
                visible.iter_mut().zip(slopes).for_each(|(v, g)| *v = 1.0 - g * g / square);
                across.copy_from_slice(&residuals[i * k..(i + 1) * k]);
                subtract(across, slopes, dot(moves, across));
                rest.copy_from_slice(across);
                if nuisances.are_taken() {
                    let directions = [of(nuisances.offset), of(nuisances.gain)];
                    *moved = take_out(rest, visible, directions, slopes, moves);
                }
            },
        );
        out
    }
}

/// Takes what lies along some directions, as far as it is across the slopes, out of residuals that are, and what it has
/// of their noise out of `visible`. Returns how much it changes the unknown, which an error changes by `moves`.
fn take_out(
    residuals: &mut [f32],
    visible: &mut [f32],
    directions: [Vec<f32>; 2],
    slopes: &[f32],
    moves: &[f32],
) -> f32 {
    let mut moved = 0.0;
    // Gram and Schmidt; what a direction has along the slopes is how much its size changes the unknown.
    let mut before: Option<(Vec<f32>, f32)> = None;
    for mut direction in directions {
        let whole = dot(&direction, &direction);
        let mut change = dot(moves, &direction);
        subtract(&mut direction, slopes, change);
        if let Some((first, change_of_first)) = &before {
            let part = dot(&direction, first) / dot(first, first);
            subtract(&mut direction, first, part);
            change -= part * change_of_first;
        }
        let left = dot(&direction, &direction);
        // Nearly what depth or the other does.
        if left <= MIN_LEFT * whole {
            continue;
        }
        let size = dot(&direction, residuals) / left;
        subtract(residuals, &direction, size);
        visible.iter_mut().zip(&direction).for_each(|(v, d)| *v -= d * d / left);
        moved += size * change;
        before = Some((direction, change));
    }
    moved
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Subtracts `part` of `b` from `a`.
fn subtract(a: &mut [f32], b: &[f32], part: f32) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a -= part * b);
}

/// Squares of what neighbors share.
struct Shared<'a> {
    active: &'a [bool],
    size: [usize; 2],
    zones: &'a Zones,
    radius: usize,
    /// Part of the pixels around each that are active.
    near: Vec<f32>,
    /// Excess that noise alone has by chance.
    chance: f32,
}

impl<'a> Shared<'a> {
    /// Prepares squares of one radius in a window of a size.
    fn new(active: &'a [bool], size: [usize; 2], zones: &'a Zones, radius: usize) -> Self {
        let mut near: Vec<f32> = active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
        box_mean(&mut near, size[0], size[1], radius);
        // Where nothing is shared: half a standard deviation of its mean over as many squares as there are, 0.4 of
        // which remain on average when negative values become 0.
        let side = (2 * radius + 1) as f32;
        let squares = ((2 * SYSTEMATIC_RADIUS + 1) as f32 / side).powi(2);
        Self { active, size, zones, radius, near, chance: 0.5 * (2.0 / squares).sqrt() / (side * side) }
    }

    /// Returns the mean around every pixel of the squares of what squares of a map share, beyond what noise has of it
    /// by chance.
    fn square(&self, own: &[f32]) -> Vec<f32> {
        let ([w, h], side) = (self.size, (2 * self.radius + 1) as f32);
        let mut mean = own.to_vec();
        box_mean(&mut mean, w, h, self.radius);
        let mut out = vec![0.0; own.len()];
        for i in (0..own.len()).filter(|i| self.active[*i]) {
            let shared = (mean[i] / self.near[i]).powi(2);
            // Variance of the mean from noise, by the residuals' own spread: a wrong noise level does not look
            // systematic.
            let pixels = self.near[i] * side * side;
            out[i] = shared - (own[i] * own[i] - shared) / (pixels - 1.0).max(1.0);
        }
        self.zones.mean(&out)
    }
}
