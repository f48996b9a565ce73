//! Estimating the blur of the projected images on the scene.

use nelu3d::surface::PixelStatus;
use nelu3d_scan::statistics::percentile;
use rayon::prelude::*;

use super::blurred::blurred;
use super::codewords::{CodewordTable, SeenCodewords, centered, largest};
use super::columns::columns;
use super::refine::Refiner;
use crate::captured::Captured;
use crate::code::AxisCode;
use crate::options::Columns;
use crate::triangulate::Geometry;

/// Estimates the blur of the projected images on the scene, projector px: that with which a sample of pixels is
/// explained best. More than three images are needed: three are explained by any column, up to offset and scale.
pub(super) fn blur_from_misfit(
    seen: &SeenCodewords,
    captured: &Captured,
    axis: &AxisCode,
    planes: &[(usize, usize)],
    geometry: &Geometry<'_>,
) -> f32 {
    let valid: Vec<usize> = (0..captured.status.len()).filter(|i| captured.status[*i] == PixelStatus::Valid).collect();
    let sample: Vec<usize> = valid.iter().copied().step_by((valid.len() / 3000).max(1)).collect();
    let k = seen.k;
    let score = |blur: f32| -> f64 {
        let table = CodewordTable::new(axis, planes, blur);
        let one = |(code, scores, refiner): &mut (Vec<f32>, Vec<f32>, Refiner), i: &usize| -> f64 {
            let Some((low, high)) = columns(geometry, axis, Columns::Epipolar, *i) else { return 0.0 };
            centered(seen.at(*i), code);
            table.correlate(code, low, high, scores);
            let at = low + largest(scores).0;
            refiner.refine(&table, seen.at(*i), at as f32, 1.0).map_or(1.0, |_| f64::from(refiner.misfit))
        };
        let mut all =
            sample.par_iter().map_init(|| (vec![0.0; k], Vec::new(), Refiner::new(k)), one).collect::<Vec<f64>>();
        percentile(&mut all, 50.0)
    };
    let candidates = (0..=8).map(|i| 0.5 * i as f32);
    candidates.map(|b| (score(b), b)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |b| b.1)
}

/// Estimates the blur of the projected images on the scene, projector px, from how much contrast each image lost: blur
/// takes more of a finer image, everything else (ambient light, a projector's black) takes the same of all.
pub(super) fn blur_from_contrast(captured: &Captured, axis: &AxisCode, planes: &[(usize, usize)]) -> f32 {
    /// Standard deviations of the logarithm of an image's contrast, whose columns the scene does not show evenly, and
    /// of the contrast that all lose.
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
    let valid: Vec<usize> = (0..captured.status.len()).filter(|i| captured.status[*i] == PixelStatus::Valid).collect();
    let sample: Vec<usize> = valid.iter().copied().step_by((valid.len() / 20_000).max(1)).collect();
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
