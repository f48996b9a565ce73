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
pub struct Carried {
    /// The samples, for the bins that they were made from.
    pub samples: Gathered,
    /// Unit coordinates of the samples, and along which axes of the code they tell the codeword.
    pub places: Vec<([f32; 3], KnownAxes)>,
    /// Axis of the code along which each channel varies.
    pub axes: Vec<u8>,
    /// How many there are, and how good.
    pub report: CarriedReport,
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
/// known along the other. `within` restricts the rays to those that are lit there. The bins have `cells_per_pixel` across.
pub fn carry(bins: &Bins, validity: &Validity, within: Option<&Validity>, cells_per_pixel: usize) -> Option<Carried> {
    let columns = Columns::new(bins, validity, cells_per_pixel);
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
