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
use donors::{Fill, Known, Reach};
use serde::Serialize;

use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::validity::{KnownAxes, Validity};

/// Fewest rays without samples, as a fraction of those with, for which the work is worth its while.
const MIN_SHARE: f64 = 0.002;
/// Largest error of carried samples, root mean square of the normalized intensity.
const MAX_RMS: f64 = 0.08;
/// Largest variance of one channel's carried samples: random bits have 0.5.
const MAX_CHANNEL_VARIANCE: f32 = 0.05;
/// Ways along a stripe that are tried, as fractions of the columns across: the longest over which carried samples are
/// good is taken.
const WAYS: [f32; 9] = [0.02, 0.04, 0.06, 0.08, 0.10, 0.12, 0.16, 0.20, 0.25];

/// Samples that were carried along the stripes, and the rays that they stand for.
pub(super) struct Carried {
    /// The samples, for the bins that they were made from.
    pub(super) samples: Gathered,
    /// Unit coordinates of the samples, and along which axes of the code they tell the codeword.
    pub(super) places: Vec<([f32; 3], KnownAxes)>,
    /// Axis of the code along which each channel varies.
    pub(super) axes: Vec<u8>,
    /// How many there are, and how good.
    pub(super) report: CarriedReport,
}

impl Carried {
    /// Lights the cells of a volume that the samples lie in.
    pub(super) fn light(&self, validity: &mut Validity) {
        if self.places.iter().any(|(_, known)| !known.is_all()) {
            validity.axes.clone_from(&self.axes);
        }
        for (q, known) in &self.places {
            if known.is_all() {
                validity.light(*q);
            } else {
                validity.light_along(*q, *known);
            }
        }
        validity.fill_holes();
    }
}

/// How many rays of light got their codeword from others on the same stripe, and how good these are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CarriedReport {
    /// Fraction of the field's rays of light whose codeword was carried there.
    pub share: f64,
    /// Fraction of the field's rays of light of which the channels of one axis of the code were carried there, and the
    /// others are not known.
    pub one_axis: f64,
    /// Root mean square error of carried codewords, normalized intensity: measured on known rays, over ways as long.
    pub rms: f64,
}

/// Carries samples of bins in the light's frame along the stripes, to the rays of light between them that no bright
/// sample has lit in `validity`; `None` where the patterns have no stripes, where there is nothing to fill, or where
/// carried samples are not good enough. Under a code along two axes, a ray whose stripe of one axis meets no board is
/// known along the other. `within` restricts the rays to those that are lit there.
pub(super) fn carry(bins: &Bins, validity: &Validity, within: Option<&Validity>) -> Option<Carried> {
    let columns = Columns::new(bins, validity);
    if (columns.n_between() as f64) < MIN_SHARE * columns.n_known() as f64 {
        return None;
    }
    let axes: Vec<Axis> = axes(&columns)?;
    let known = Known::new(&columns, &axes);
    let across = columns.n[0].max(columns.n[1]) as f32;
    let reaches: Vec<Option<Reach>> = axes.iter().map(|axis| longest(&known, axis, across)).collect();
    let fills: Vec<Fill> = known.fill(columns.dark(within), &reaches);
    let (mut samples, mut places) = (bins.gathered(), Vec::new());
    let (mut values, mut omegas) = (vec![0.0; columns.k], vec![0.0; columns.k]);
    let mut whole = 0;
    for fill in &fills {
        let n = fill.samples();
        let of = if (0..axes.len()).all(|axis| fill.has(axis)) {
            whole += 1;
            KnownAxes::ALL
        } else {
            KnownAxes::only(usize::from(!fill.has(0)))
        };
        values.fill(0.0);
        omegas.fill(0.0);
        for i in (0..axes.len()).filter(|axis| fill.has(*axis)) {
            let variance = reaches[i].iter().flat_map(|reach| &reach.variance);
            for (channel, variance) in axes[i].channels.iter().zip(variance) {
                omegas[*channel] = 1.0 / (variance.max(1e-6) * n as f32);
            }
        }
        for i in 0..n {
            let q = fill.write(&columns, &axes, i, &mut values);
            samples.push(q, &values, &omegas);
            places.push((q, of));
        }
    }
    tracing::debug!(whole, one_axis = fills.len() - whole, known = columns.n_known(), "carried along the stripes");
    if fills.is_empty() {
        return None;
    }
    let mut of_channels = vec![0; columns.k];
    for (i, axis) in axes.iter().enumerate() {
        axis.channels.iter().for_each(|channel| of_channels[*channel] = i as u8);
    }
    let all = (fills.len() + columns.n_known()) as f64;
    let report = CarriedReport {
        share: whole as f64 / all,
        one_axis: (fills.len() - whole) as f64 / all,
        rms: rms(reaches.iter().flatten().flat_map(|reach| &reach.variance)),
    };
    Some(Carried { samples, places, axes: of_channels, report })
}

/// Finds the longest way along an axis' stripes over which samples may be carried, `across` columns being the width of
/// the field; `None` if they are not good enough over any.
fn longest(known: &Known<'_>, axis: &Axis, across: f32) -> Option<Reach> {
    let mut best = None;
    for way in WAYS.map(|way| way * across) {
        let Some(variance) = known.variance(axis, way) else { break };
        let rms = rms(&variance);
        tracing::debug!(way, rms, channels = axis.channels.len(), "samples carried along the stripes");
        if rms > MAX_RMS || variance.iter().any(|v| *v > MAX_CHANNEL_VARIANCE) {
            break;
        }
        best = Some(Reach { way, variance });
    }
    best
}

/// Root of the mean of variances.
fn rms<'a>(variances: impl IntoIterator<Item = &'a f32>) -> f64 {
    let (n, sum) = variances.into_iter().fold((0, 0.0), |(n, sum), v| (n + 1, sum + f64::from(*v)));
    (sum / f64::from(n.max(1))).sqrt()
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
        let carried = carry(&bins, &validity, None).unwrap();
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
        assert!(carry(&bins, &validity, None).is_none());
    }

    #[test]
    fn beside_a_board_the_stripes_that_cross_it_are_known() {
        // Nothing was right of column 150, where stripes along x come from the left, and those along y from nowhere.
        let edge = 150.0 / N[0] as f32;
        let (bins, _) = chessboard(14, 4, phases);
        let mut left = Bins::new([N[0], N[1], 4], 4);
        let mut validity = Validity::new(32, 32, 8, [N[0] / 2, N[1] / 2, 8]);
        bins.for_each_sample(|q, values, omegas| {
            if q[0] < edge {
                left.add(q, values, omegas);
                if omegas[0] > 100.0 {
                    validity.add([5.0, 5.0], 700.0, q);
                }
            }
        });
        let carried = carry(&left, &validity, None).unwrap();
        assert!(carried.axes[0] == carried.axes[1] && carried.axes[2] == carried.axes[3]);
        assert_ne!(carried.axes[0], carried.axes[2]);
        let (along_x, along_y) = (carried.axes[2], carried.axes[0]);
        let beside: Vec<KnownAxes> = carried.places.iter().filter(|p| p.0[0] > edge + 0.03).map(|p| p.1).collect();
        assert!(beside.len() > 1000, "{}", beside.len());
        assert!(beside.iter().all(|known| known.has(along_x) && !known.has(along_y)));
        assert!(carried.report.one_axis > 0.02 && carried.report.share > 0.2, "{:?}", carried.report);
        // What is carried there is right, and the other channels weigh nothing.
        let mut filled = Bins::new([N[0], N[1], 4], 4);
        filled.add_all(&[carried.samples]);
        let (mut n, mut off) = (0, 0.0);
        filled.for_each_sample(|q, values, omegas| {
            if q[0] > edge + 0.03 {
                let truth = phases([f64::from(q[0]) * N[0] as f64, f64::from(q[1]) * N[1] as f64]);
                assert!(omegas[0] == 0.0 && omegas[1] == 0.0 && omegas[2] > 0.0);
                n += 2;
                off += [2, 3].iter().map(|j| f64::from((values[*j] - truth[*j]).powi(2))).sum::<f64>();
            }
        });
        assert!((off / f64::from(n)).sqrt() < 0.08, "{}", (off / f64::from(n)).sqrt());
        // Only where it is asked for.
        let nowhere = Validity { lit: vec![0; validity.lit.len()], ..validity.clone() };
        assert!(carry(&left, &validity, Some(&nowhere)).is_none());
    }

    #[test]
    fn a_white_board_needs_nothing() {
        let (bins, validity) = chessboard(1000, 4, phases);
        assert!(carry(&bins, &validity, None).is_none());
    }
}
