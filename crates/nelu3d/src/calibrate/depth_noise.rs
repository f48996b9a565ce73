//! How far off, in depth, single pixels of a held-out board are: by what noise gives them, and by what it does not.
//!
//! Residuals of a scan do not show errors that a change of depth explains. Where one channel at a time tells depth, as
//! in a Gray code, these are all errors there are. On a board, whose depth is known, they can be measured.

use std::collections::BTreeMap;

use nelu3d_scan::statistics::median;

use super::shared_displacement::FAR;
use crate::color_field::{DepthNoise, LEAST_MODEL_SIGMA, SupportedDepthNoise};

/// Side of a tile, px. What all of a tile shares is not counted: it is a displacement.
const TILE: usize = 16;
/// Number of sides of squares of pixels that are told apart: 1, 2, 4, 8 px.
const LEVELS: usize = DepthNoise::SIDES;
/// Standard deviations of the field's own error that are tried, as multiples of the least: which it is, is known only
/// when all positions have been compared.
const MODELS: [f32; 6] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Tiles that are looked at, about: of all held-out positions together.
const TILES: usize = 600;
/// Fewest tiles that tell.
const MIN_TILES: usize = 20;
/// Largest number of parts into which the tiles are divided by the number of positions that support the field there.
const PARTS: usize = 4;
/// Part of a square's pixels, or of a tile's, that has to be measured.
const MIN_PART: f32 = 0.15;

/// The normal equation of one pixel, h · displacement = g, for each of [`MODELS`].
#[derive(Clone, Copy, Default)]
struct Pixel {
    g: [f32; MODELS.len()],
    h: [f32; MODELS.len()],
}

/// Sums over the pixels of a tile.
#[derive(Clone)]
struct TileSums {
    pixels: Vec<Pixel>,
    chi2: [f64; MODELS.len()],
    measurements: f64,
    /// Sum over its pixels of the number of positions that support the field there, and number of pixels.
    support: [f64; 2],
}

/// What a tile tells: χ² per measurement, and that of displacements of squares of pixels, per degree of freedom.
#[derive(Clone, Copy, Debug)]
struct Tile {
    chi2: [f32; MODELS.len()],
    along: [[f32; LEVELS]; MODELS.len()],
    /// Mean number of positions that support the field.
    support: f32,
}

/// Errors in depth of pixels of held-out boards, tile by tile.
#[derive(Clone, Debug, Default)]
pub struct DepthNoiseTiles {
    tiles: Vec<Tile>,
}

/// Collects what a held-out position tells.
pub struct DepthNoiseOfPosition {
    width: usize,
    position: usize,
    one_of: usize,
    sums: BTreeMap<[usize; 2], TileSums>,
}

impl DepthNoiseOfPosition {
    /// Starts with position `position` of `positions` that are held out, whose images have `size`, width and height.
    pub fn new([width, height]: [usize; 2], position: usize, positions: usize) -> Self {
        let one_of = width * height * positions / (TILE * TILE) / TILES;
        Self { width, position, one_of: one_of.max(1), sums: BTreeMap::new() }
    }

    /// Returns whether pixel `i` is looked at.
    pub fn wants(&self, i: usize) -> bool {
        let [x, y] = self.tile_of(i);
        // Tiles here and there, others at every position.
        let at = (self.position.wrapping_mul(40_503) ^ (y * 2_053 + x)).wrapping_mul(2_654_435_761);
        (at >> 12).is_multiple_of(self.one_of)
    }

    fn tile_of(&self, i: usize) -> [usize; 2] {
        [i % self.width / TILE, i / self.width / TILE]
    }

    /// Adds pixel `i`: errors, slopes and weights (one over the variance from noise; 0: not measured) of its channels,
    /// and the number of positions that support the field there.
    pub fn add(&mut self, i: usize, errors: impl Fn(usize) -> f32, slopes: &[f32], weights: &[f32], support: u16) {
        let empty = || TileSums {
            pixels: vec![Pixel::default(); TILE * TILE],
            chi2: [0.0; MODELS.len()],
            measurements: 0.0,
            support: [0.0; 2],
        };
        let sums = self.sums.entry(self.tile_of(i)).or_insert_with(empty);
        sums.support = [sums.support[0] + f64::from(support), sums.support[1] + 1.0];
        let pixel = &mut sums.pixels[i / self.width % TILE * TILE + i % self.width % TILE];
        for (j, w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let (e, d) = (errors(j), slopes[j]);
            sums.measurements += 1.0;
            for (m, model) in MODELS.iter().enumerate() {
                let w = 1.0 / (1.0 / w + (model * LEAST_MODEL_SIGMA).powi(2));
                pixel.h[m] += w * d * d;
                pixel.g[m] += w * d * e;
                sums.chi2[m] += f64::from(w * e * e);
            }
        }
    }

    /// Sums up.
    pub fn finish(self) -> DepthNoiseTiles {
        DepthNoiseTiles { tiles: self.sums.values().filter_map(TileSums::tile).collect() }
    }
}

impl TileSums {
    fn tile(&self) -> Option<Tile> {
        let measured = self.pixels.iter().filter(|p| p.h[0] > 0.0).count();
        if (measured as f32) < MIN_PART * (TILE * TILE) as f32 {
            return None;
        }
        let support = (self.support[0] / self.support[1]) as f32;
        let mut out = Tile { chi2: [0.0; MODELS.len()], along: [[0.0; LEVELS]; MODELS.len()], support };
        for m in 0..MODELS.len() {
            let sum = |of: fn(&Pixel, usize) -> f32| self.pixels.iter().map(|p| f64::from(of(p, m))).sum::<f64>();
            let (g, h) = (sum(|p, m| p.g[m]), sum(|p, m| p.h[m]));
            let shared = (g / h) as f32;
            out.chi2[m] = ((self.chi2[m] - g * g / h) / self.measurements) as f32;
            for level in 0..LEVELS {
                let side = 1 << level;
                let (mut sum, mut n) = (0.0f32, 0usize);
                let starts = |at: &usize| (at % TILE).is_multiple_of(side) && (at / TILE).is_multiple_of(side);
                for at in (0..TILE * TILE).filter(starts) {
                    let (mut g, mut h, mut pixels) = (0.0, 0.0, 0usize);
                    for beside in 0..side * side {
                        let p = &self.pixels[at + beside / side * TILE + beside % side];
                        (g, h) = (g + p.g[m] - p.h[m] * shared, h + p.h[m]);
                        pixels += usize::from(p.h[m] > 0.0);
                    }
                    if h > 0.0 && pixels as f32 >= MIN_PART * (side * side) as f32 {
                        (sum, n) = (sum + g * g / h, n + 1);
                    }
                }
                if n < 2 {
                    return None;
                }
                out.along[m][level] = sum / (n - 1) as f32;
            }
        }
        Some(out)
    }
}

impl DepthNoiseTiles {
    /// Joins what another position tells.
    pub(super) fn add(&mut self, other: Self) {
        self.tiles.extend(other.tiles);
    }

    /// Returns the variance of errors in depth over what the noise model gives, which has a standard deviation of
    /// `model_sigma` beside noise, per χ² per measurement: of single pixels, and of squares of 2, 4, and 8 pixels, beside
    /// what squares of 16 share. `None` where too few tiles tell.
    pub fn depth_noise(&self, model_sigma: f32) -> Option<DepthNoise> {
        if self.tiles.len() < MIN_TILES {
            return None;
        }
        let at = (model_sigma / LEAST_MODEL_SIGMA).max(1.0).log2().min((MODELS.len() - 1) as f32);
        let by_side = by_side(&self.tiles, at)?;
        // Of as many places each: those that few positions support first.
        let mut sorted = self.tiles.clone();
        sorted.sort_by(|a, b| a.support.total_cmp(&b.support));
        let parts = (sorted.len() / MIN_TILES).min(PARTS);
        let of_part = |tiles: &[Tile]| {
            let positions = tiles.iter().map(|t| f64::from(t.support)).sum::<f64>() / tiles.len() as f64;
            Some(SupportedDepthNoise { positions, by_side: self::by_side(tiles, at)? })
        };
        let by_support = sorted.chunks(sorted.len().div_ceil(parts)).filter(|tiles| tiles.len() >= MIN_TILES / 2);
        Some(DepthNoise { by_side, by_support: by_support.filter_map(of_part).collect() })
    }
}

/// The ratio of variances per side of squares, of some tiles; `at` is the binary logarithm of the field's own error over
/// the least. `None` where errors are none.
fn by_side(tiles: &[Tile], at: f32) -> Option<[f64; LEVELS]> {
    let (m, part) = ((at as usize).min(MODELS.len() - 2), at - (at as usize).min(MODELS.len() - 2) as f32);
    let between = |of: &dyn Fn(&Tile, usize) -> f32, t: &Tile| (1.0 - part) * of(t, m) + part * of(t, m + 1);
    let all = |of: &dyn Fn(&Tile, usize) -> f32| -> Option<f64> {
        let mut values: Vec<f32> = tiles.iter().map(|t| between(of, t)).collect();
        let limit = FAR * median(&mut values)?;
        let near: Vec<f64> = values.iter().filter(|v| **v <= limit).map(|v| f64::from(*v)).collect();
        Some(near.iter().sum::<f64>() / near.len() as f64)
    };
    let chi2 = all(&|t, m| t.chi2[m])?;
    let mut by_side = [0.0; LEVELS];
    for (level, out) in by_side.iter_mut().enumerate() {
        *out = all(&|t, m| t.along[m][level])? / chi2;
    }
    by_side.iter().all(|v| v.is_finite()).then_some(by_side)
}
