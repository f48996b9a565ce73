//! Micro phase shifting (Gupta & Nayar, "Micro Phase Shifting", CVPR 2012): F frequencies from a narrow band in F + 2
//! images, three shifts of the first and one image of each other.
//!
//! All frequencies being close, offset and amplitude are the same for all (that is the method's point: indirect light hardly
//! changes within a band of high frequencies). Offset o, amplitude B and phase of the first frequency come from its shifts,
//! the others give `cos(2π f_j u − φ_j) = (p_j − o) / B`: the paper's linear system of F + 2 unknowns, solved in two steps. The
//! column is the one, among those with the first frequency's phase, whose cosines are nearest to these (its section 4), so
//! that the fraction of a column is that of the first phase.

use nelu3d_scan::rig::PatternSet;
use rayon::prelude::*;

use super::captured::Captured;
use super::code::Code;
use super::coordinates::{Coordinate, DecodedCoordinates};
use super::error::DecodeError;
use super::options::Columns;
use super::phase::Phase;
use super::triangulate::Geometry;
use super::wave::learn;
use nelu3d::surface::PixelStatus;

use std::f32::consts::TAU;

/// Error of a cosine that noise does not explain: the amplitude is not quite the same for all frequencies.
const MODEL: f32 = 0.06;

/// The second best column must explain the cosines worse by this much (χ²).
const MARGIN: f32 = 6.0;

/// Largest χ² per image of a column that is believed.
const MAX_MISFIT: f32 = 12.0;

/// Decodes all axes of a code.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
    search: Columns,
) -> Result<DecodedCoordinates, DecodeError> {
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let groups = learn(axis, set, "mps")?;
        let shifted: Vec<usize> = (0..groups.len()).filter(|g| groups[*g].waves.len() > 1).collect();
        let (&[first], true) = (&shifted[..], groups.len() > 1) else {
            return Err(DecodeError::Unsuited {
                set: set.name.clone(),
                method: "mps",
                problem: format!("{} of its {} frequencies have several shifts", shifted.len(), groups.len()),
                remedy:
                    "micro phase shifting has three shifts of one frequency and one image of each other; use --method \
                         phase or zncc for other codes"
                        .into(),
            });
        };
        let solver = groups[first].solver().ok_or_else(|| DecodeError::Unsuited {
            set: set.name.clone(),
            method: "mps",
            problem: format!("the shifts of period {:.2} px do not determine a phase", groups[first].period()),
            remedy: "give that frequency three shifts".into(),
        })?;
        let phase = Phase::new(captured, &groups[first], solver);
        let others: Vec<Other<'_>> = (0..groups.len())
            .filter(|g| *g != first)
            .map(|g| Other {
                plane: captured.gray(groups[g].waves[0].image, false),
                omega: TAU * groups[g].frequency as f32,
                phase: groups[g].waves[0].phase as f32,
            })
            .collect();
        let whole = [-0.5, axis.len() as f32 - 0.5];
        let found: Vec<(f32, f32, PixelStatus)> = (0..status.len())
            .into_par_iter()
            .map(|i| {
                if status[i] != PixelStatus::Valid {
                    return (f32::NAN, f32::NAN, status[i]);
                }
                let within = if search == Columns::All { Some(whole) } else { geometry.interval(i, axis) };
                let Some(within) = within else { return (f32::NAN, f32::NAN, PixelStatus::OutsideVolume) };
                match column(&phase, &others, i, captured.variance(i, 0.5).sqrt(), within) {
                    Some((u, sigma)) => (u, sigma, PixelStatus::Valid),
                    None => (f32::NAN, f32::NAN, PixelStatus::Ambiguous),
                }
            })
            .collect();
        status = found.iter().map(|f| f.2).collect();
        let (at, sigma) = found.iter().map(|f| (f.0, f.1)).unzip();
        coordinates.push(Coordinate { axis: axis.axis, at, sigma });
    }
    Ok(DecodedCoordinates { coordinates, status })
}

/// A frequency with one image.
struct Other<'a> {
    plane: std::borrow::Cow<'a, [f32]>,
    omega: f32,
    phase: f32,
}

/// Most frequencies of a code.
const MOST: usize = 16;

fn column(phase: &Phase<'_>, others: &[Other<'_>], i: usize, noise: f32, [low, high]: [f32; 2]) -> Option<(f32, f32)> {
    let first = phase.at(i, noise)?;
    let n = others.len().min(MOST);
    let mut seen = [0.0f32; MOST];
    for (s, other) in seen.iter_mut().zip(&others[..n]) {
        *s = (other.plane[i] - first.offset) / first.amplitude;
    }
    // A cosine's own noise, that of offset and amplitude, and that of the column it is compared at: all alike.
    let variance = 2.5 * (noise / first.amplitude).powi(2) + MODEL * MODEL;
    let period = TAU / phase.omega;
    let at = first.angle / phase.omega;
    let (k, last) = (((low - at) / period).ceil() as i32, ((high - at) / period).floor() as i32);
    let (mut best, mut second, mut column) = (f32::INFINITY, f32::INFINITY, f32::NAN);
    for k in k..=last {
        let u = at + k as f32 * period;
        let cost: f32 =
            others[..n].iter().zip(&seen).map(|(o, s)| (s - (o.omega * u - o.phase).cos()).powi(2)).sum::<f32>()
                / variance;
        if cost < best {
            (second, best, column) = (best, cost, u);
        } else {
            second = second.min(cost);
        }
    }
    let good = !column.is_nan() && best <= MAX_MISFIT * n as f32 && second - best >= MARGIN;
    good.then_some((column, first.sigma / phase.omega))
}
