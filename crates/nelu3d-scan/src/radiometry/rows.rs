//! Relations, averaged over blocks of pixels: one linear equation each in the light of every code.

use super::error::ResponseError;
use super::relation::LightRelation;
use crate::image::{Raw, RawData};

/// Number of nodes that a curve has, evenly from code 0 to 1: those of 8 bits.
pub(super) const NODES: usize = 256;
/// About how many blocks a picture has.
const BLOCKS: usize = 400;
/// Smallest side of a block, px.
const MIN_SIDE: usize = 8;
/// Codes from here on count as clipped: a noisy value may be.
const CLIPPED: f32 = 0.975;
/// Smallest difference of codes on both sides of a relation that tells something: a pixel that sees one of two stripes
/// alone has the same codes on both, under any curve.
const MIN_CHANGE: f32 = 0.04;
/// Smallest mean code that a block must have in one image of a relation. In the dark, where a curve for people is steep,
/// codes differ by noise, and those that differ most would be chosen by it.
const MIN_LIT: f32 = 0.1;
/// Most images on one side of a relation.
const MAX_TERMS: usize = 4;
/// A block counts where one pixel in so many can be used.
const MIN_USED: usize = 16;

/// A relation in a block: Σ `weights[i]` · light of node i = 0.
pub(super) struct Row {
    pub(super) weights: Vec<f32>,
    /// Weight and mean code of each image.
    pub(super) terms: Vec<(f32, f32)>,
    /// Number of pixels.
    pub(super) pixels: usize,
    pub(super) relation_fold: usize,
    pub(super) block: usize,
}

/// Makes the rows of images of a still scene; codes go from 0 at `black_level` to 1 at `saturation`.
pub(super) fn rows(
    images: &[&Raw],
    relations: &[LightRelation],
    [black_level, saturation]: [f64; 2],
) -> Result<Vec<Row>, ResponseError> {
    let kind = |raw: &Raw| format!("{} x {} px, {} channels", raw.width, raw.height, raw.channels);
    let Some(first) = images.first() else { return Ok(Vec::new()) };
    if let Some(other) = images.iter().find(|i| kind(i) != kind(first)) {
        return Err(ResponseError::OtherSize { first: kind(first), other: kind(other) });
    }
    assert!(relations.iter().all(|r| r.last() < images.len()), "a relation of images that are not there");
    let (w, h, channels) = (first.width, first.height, first.channels);
    let side = (((w * h) as f64 / BLOCKS as f64).sqrt().ceil() as usize).max(MIN_SIDE);
    let columns = w.div_ceil(side);
    let scale = 1.0 / (saturation - black_level);
    let code = |image: &Raw, at: usize| (scale * (value(&image.data, at) - black_level)) as f32;
    // A pixel is chosen by what is beside it: chosen by itself, it would be chosen by its noise. Two pixels away, which in
    // a mosaic is the same color.
    let beside = |image: &Raw, at: usize| {
        let (x, y, channel) = (at / channels % w, at / channels / w, at % channels);
        let near = |x: usize, y: usize| code(image, (y.min(h - 1) * w + x.min(w - 1)) * channels + channel);
        0.25 * (near(x.saturating_sub(2), y) + near(x + 2, y) + near(x, y.saturating_sub(2)) + near(x, y + 2))
    };
    let mut all = Vec::new();
    for block in 0..columns * h.div_ceil(side) {
        let (x0, y0) = (block % columns * side, block / columns * side);
        for channel in 0..channels {
            let pixels = (y0..(y0 + side).min(h)).flat_map(|y| (x0..(x0 + side).min(w)).map(move |x| (x, y)));
            let places: Vec<usize> = pixels.map(|(x, y)| (y * w + x) * channels + channel).collect();
            let mean = |image: &Raw| places.iter().map(|at| code(image, *at)).sum::<f32>() / places.len() as f32;
            let is_lit: Vec<bool> = images.iter().map(|image| mean(image) >= MIN_LIT).collect();
            for relation in relations {
                if !relation.terms.iter().any(|t| is_lit[t.0]) {
                    continue;
                }
                let codes = |at: usize| relation.terms.iter().map(move |t| (t.1, code(images[t.0], at)));
                let around = |at: usize| relation.terms.iter().map(move |t| (t.1, beside(images[t.0], at)));
                let used: Vec<usize> = places
                    .iter()
                    .copied()
                    .filter(|&at| tells(codes(at), 0.5 * MIN_CHANGE) && tells(around(at), MIN_CHANGE))
                    .collect();
                if MIN_USED * used.len() < places.len() || used.is_empty() {
                    continue;
                }
                let mut row = Row {
                    weights: vec![0.0; NODES],
                    terms: Vec::with_capacity(relation.terms.len()),
                    pixels: used.len(),
                    relation_fold: relation.fold,
                    block,
                };
                for &(image, weight) in &relation.terms {
                    let share = weight as f32 / used.len() as f32;
                    let mut sum = 0.0f64;
                    for &at in &used {
                        let c = code(images[image], at);
                        sum += f64::from(c);
                        row.add(c, share);
                    }
                    row.terms.push((weight as f32, (sum / used.len() as f64) as f32));
                }
                all.push(row);
            }
        }
    }
    Ok(all)
}

/// Returns whether codes, with their weights, are none of them clipped and differ by so much that they tell something of
/// the curve.
fn tells(terms: impl Iterator<Item = (f64, f32)>, min_change: f32) -> bool {
    let (mut sides, mut n) = ([[f32::MAX; MAX_TERMS]; 2], [0; 2]);
    for (weight, code) in terms {
        if code.is_nan() || code >= CLIPPED {
            return false;
        }
        let side = usize::from(weight < 0.0);
        sides[side][n[side]] = code;
        n[side] += 1;
    }
    sides.iter_mut().for_each(|side| side.sort_unstable_by(f32::total_cmp));
    let pairs = sides[0].iter().zip(&sides[1]).take(n[0].min(n[1]));
    pairs.into_iter().any(|(a, b)| (a - b).abs() >= min_change)
}

impl Row {
    /// Adds the light of a code, between two nodes in straight line; below 0 the curve is mirrored.
    fn add(&mut self, code: f32, weight: f32) {
        let (at, weight) = (code.abs() * (NODES - 1) as f32, if code < 0.0 { -weight } else { weight });
        let i = (at as usize).min(NODES - 2);
        let part = at - i as f32;
        self.weights[i] += weight * (1.0 - part);
        self.weights[i + 1] += weight * part;
    }
}

fn value(data: &RawData, at: usize) -> f64 {
    match data {
        RawData::U8(v) => f64::from(v[at]),
        RawData::U16(v) => f64::from(v[at]),
        RawData::Float(v) => f64::from(v[at]),
    }
}
