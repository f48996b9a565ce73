//! Rays of light that only ink has met: their codewords are those of the same fringe beside the ink.
//!
//! The black squares of a chessboard send back a twentieth of what its white ones do, and veiling glare is a good part
//! of that, so they say little about the field; with a handful of boards, a third of the light's rays met nothing else.
//! But the stripes of every usual code (Gray code, phase shifts, mixed sets) are straight lines in the light's frame,
//! and beside each black square lies a white one. So the direction of the stripes is found from the field's own
//! samples, as a smooth function of the ray, and samples are carried along it. No model of the projector is needed;
//! patterns that have no single direction (random dots, Hilbert curves) are left alone. How well it works is measured
//! on rays that are known, before anything is used.

mod columns;
mod direction;
mod donors;

pub(super) use columns::Columns;
use direction::{Axis, axes};
use donors::{Fill, Known};
use serde::Serialize;

use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::validity::Validity;

/// Fewest rays without samples, as a fraction of those with, for which the work is worth its while.
const MIN_SHARE: f64 = 0.002;
/// Largest error of carried samples, root mean square of the normalized intensity.
const MAX_RMS: f64 = 0.08;
/// Largest variance of one channel's carried samples: random bits have 0.5.
const MAX_CHANNEL_VARIANCE: f32 = 0.05;
/// Ways along a stripe that are tried, as fractions of the columns across: the longest over which carried samples are
/// good is taken.
const WAYS: [f32; 6] = [0.02, 0.04, 0.06, 0.08, 0.10, 0.12];

/// Samples that were carried along the stripes, and the rays that they stand for.
pub(super) struct Carried {
    /// The samples, for the bins that they were made from.
    pub(super) samples: Gathered,
    /// Unit coordinates of the samples.
    pub(super) places: Vec<[f32; 3]>,
    /// How many there are, and how good.
    pub(super) report: CarriedReport,
}

/// How many rays of light got their codeword from others on the same stripe, and how good these are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CarriedReport {
    /// Fraction of the field's rays of light whose codeword was carried there.
    pub share: f64,
    /// Root mean square error of carried codewords, normalized intensity: measured on known rays, over ways as long.
    pub rms: f64,
}

/// Carries samples of bins in the light's frame along the stripes, to the rays of light between them that no bright
/// sample has lit in `validity`; `None` where the patterns have no stripes, where there is nothing to fill, or where
/// carried samples are not good enough.
pub(super) fn carry(bins: &Bins, validity: &Validity) -> Option<Carried> {
    let columns = Columns::new(bins, validity);
    if (columns.n_between() as f64) < MIN_SHARE * columns.n_known() as f64 {
        return None;
    }
    let axes: Vec<Axis> = axes(&columns)?;
    let known = Known::new(&columns, &axes);
    let across = columns.n[0].max(columns.n[1]) as f32;
    let mut best = None;
    for reach in WAYS.map(|way| way * across) {
        let Some(variance) = known.variance(reach) else { break };
        let rms = (variance.iter().map(|v| f64::from(*v)).sum::<f64>() / variance.len() as f64).sqrt();
        tracing::debug!(reach, rms, axes = axes.len(), "samples carried along the stripes");
        if rms > MAX_RMS || variance.iter().any(|v| *v > MAX_CHANNEL_VARIANCE) {
            break;
        }
        best = Some((reach, variance, rms));
    }
    let (reach, variance, rms) = best?;
    let fills: Vec<Fill> = known.fill(reach);
    tracing::debug!(filled = fills.len(), known = columns.n_known(), "carried along the stripes");
    let (mut samples, mut places) = (bins.gathered(), Vec::new());
    let (mut values, mut omegas) = (vec![0.0; columns.k], vec![0.0; columns.k]);
    for fill in &fills {
        let n = fill.samples();
        for i in 0..n {
            let q = fill.write(&columns, &axes, i, &mut values);
            for (omega, variance) in omegas.iter_mut().zip(&variance) {
                *omega = 1.0 / (variance.max(1e-6) * n as f32);
            }
            samples.push(q, &values, &omegas);
            places.push(q);
        }
    }
    let share = fills.len() as f64 / (fills.len() + columns.n_known()) as f64;
    Some(Carried { samples, places, report: CarriedReport { share, rms } })
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: [usize; 2] = [220, 160];

    /// Bins and validity of a board's white squares, of `square` columns, under a code.
    fn chessboard(square: usize, k: usize, code: impl Fn([f64; 2]) -> Vec<f32>) -> (Bins, Validity) {
        let mut bins = Bins::new([N[0], N[1], 4], k);
        let mut validity = Validity::new(32, 32, 8, [N[0] / 2, N[1] / 2, 8]);
        for i in 0..N[0] * N[1] {
            let [a, b] = [i % N[0], i / N[0]];
            // Samples lie anywhere in their column.
            let jitter = |s: f64| (i as f64 * s).fract();
            let at = [a as f64 + jitter(0.618_034), b as f64 + jitter(0.754_878)];
            let is_white = (a / square + b / square).is_multiple_of(2);
            let q = [(at[0] / N[0] as f64) as f32, (at[1] / N[1] as f64) as f32, 0.4];
            if is_white {
                validity.add([5.0, 5.0], 700.0, q);
            }
            bins.add(q, &code(at), &vec![if is_white { 2500.0 } else { 3.0 }; k]);
        }
        (bins, validity)
    }

    /// Phase shifts along both axes of a light that is tilted and not parallel.
    fn phases([x, y]: [f64; 2]) -> Vec<f32> {
        let u = (x + 0.08 * y) / (1.0 + 4e-4 * y);
        let v = (y - 0.05 * x) / (1.0 + 3e-4 * x);
        let wave = |u: f64, period: f64, shift: f64| {
            (0.5 + 0.45 * (std::f64::consts::TAU * (u / period + shift)).cos()) as f32
        };
        vec![wave(u, 4.5, 0.0), wave(u, 60.0, 0.3), wave(v, 5.0, 0.1), wave(v, 70.0, 0.6)]
    }

    #[test]
    fn black_squares_get_the_codewords_of_their_stripes() {
        let (bins, validity) = chessboard(14, 4, phases);
        let carried = carry(&bins, &validity).unwrap();
        assert!(carried.report.rms < 0.05, "{:?}", carried.report);
        let squares = N[0] * N[1] / 2;
        assert!(carried.places.len() > 3 * squares, "{} samples, {squares} dark columns", carried.places.len());
        let mut filled = Bins::new([N[0], N[1], 4], 4);
        filled.add_all(&[carried.samples]);
        let (mut n, mut off) = (0, 0.0);
        filled.for_each_sample(|q, values, _| {
            let truth = phases([f64::from(q[0]) * N[0] as f64, f64::from(q[1]) * N[1] as f64]);
            n += 1;
            off += values.iter().zip(truth).map(|(v, t)| f64::from((v - t).powi(2))).sum::<f64>() / 4.0;
        });
        assert!((off / f64::from(n)).sqrt() < 0.05, "{}", (off / f64::from(n)).sqrt());
    }

    #[test]
    fn codes_without_stripes_are_left_alone() {
        let dots = |[x, y]: [f64; 2]| {
            let cell = ((x / 3.0) as u32).wrapping_mul(2_654_435_761) ^ ((y / 3.0) as u32).wrapping_mul(40_503);
            vec![(cell.wrapping_mul(2_246_822_519) >> 31) as f32; 2]
        };
        let (bins, validity) = chessboard(14, 2, dots);
        assert!(carry(&bins, &validity).is_none());
    }

    #[test]
    fn a_white_board_needs_nothing() {
        let (bins, validity) = chessboard(1000, 4, phases);
        assert!(carry(&bins, &validity).is_none());
    }
}
