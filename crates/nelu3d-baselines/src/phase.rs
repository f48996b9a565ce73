//! Phase shifting: three or more shifts of each of one or several frequencies.
//!
//! The phase of each frequency is a linear least-squares fit per pixel, for any shifts. The finest phase says where in its
//! period a column is; the others say which period: among all columns with the finest phase, the one whose other phases
//! agree best with what was seen (χ²). Then all unwrapped phases are averaged by their variances.

use nelu3d_scan::rig::PatternSet;
use rayon::prelude::*;

use super::captured::Captured;
use super::code::Code;
use super::coordinates::{Coordinate, DecodedCoordinates};
use super::error::DecodeError;
use super::triangulate::Geometry;
use super::wave::{Group, learn, wrap};
use nelu3d::surface::PixelStatus;

use std::f32::consts::TAU;

/// Phase error that noise does not explain (gamma, quantized projection, interreflection), radians.
const MODEL: f32 = 0.05;

/// Standard deviation of a normalized intensity beyond the sensor's noise: the projected images have eight bits (0.0011), and
/// no sensor's curve is quite straight.
const UNEXPLAINED: f32 = 0.002;

/// Least amplitude of a phase, in standard deviations of its noise and as a share of white.
const LEAST_AMPLITUDE: (f32, f32) = (4.0, 0.02);

/// Two periods are told apart when the second best explains the phases worse by this much (χ²).
const MARGIN: f32 = 6.0;

/// Largest χ² per frequency of a period that is believed.
const MAX_MISFIT: f32 = 12.0;

/// Decodes all axes of a code.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
) -> Result<DecodedCoordinates, DecodeError> {
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let groups = learn(axis, set, "phase")?;
        let unsuited = |problem: String, remedy: String| DecodeError::Unsuited {
            set: set.name.clone(),
            method: "phase",
            problem,
            remedy,
        };
        let mut phases = Vec::new();
        for g in &groups {
            let solver = g.solver().ok_or_else(|| {
                let problem = format!(
                    "it has {} image(s) of period {:.2} px, and 3 shifts are needed",
                    g.waves.len(),
                    g.period()
                );
                unsuited(
                    problem,
                    "use --method mps (three shifts of one frequency, one image of each other) or zncc".into(),
                )
            })?;
            phases.push(Phase::new(captured, g, solver));
        }
        // Where columns may be looked for: everywhere if the code is unique there, else where the depth range allows.
        let whole = [-0.5, axis.len() as f32 - 0.5];
        let repeats = repeats_after(&groups, axis.len() as f64);
        let span = geometry.longest_interval(axis.axis);
        if let Some(period) = repeats
            && period < span
        {
            return Err(unsuited(
                format!("its code repeats every {period:.1} px, and the depth range spans {span:.1} px"),
                format!(
                    "add a frequency, or give a --depth NEAR FAR that spans less (now {:.0} to {:.0} mm)",
                    geometry.range.mm[0], geometry.range.mm[1]
                ),
            ));
        }
        let interval = |i: usize| if repeats.is_none() { Some(whole) } else { geometry.interval(i, axis) };
        let found: Vec<(f32, f32, PixelStatus)> = (0..status.len())
            .into_par_iter()
            .map(|i| {
                if status[i] != PixelStatus::Valid {
                    return (f32::NAN, f32::NAN, status[i]);
                }
                let Some(within) = interval(i) else { return (f32::NAN, f32::NAN, PixelStatus::OutsideVolume) };
                match unwrap(&phases, i, captured.variance(i, 0.5).sqrt(), within) {
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

/// The images of one frequency, ready to give phases.
pub(crate) struct Phase<'a> {
    planes: Vec<std::borrow::Cow<'a, [f32]>>,
    solver: [Vec<f32>; 3],
    /// Radians per projector px.
    pub(super) omega: f32,
    /// Standard deviation of C and of S per standard deviation of the intensities.
    gain: f32,
}

/// What one frequency says at a pixel.
#[derive(Clone, Copy)]
pub(crate) struct Seen {
    pub(super) offset: f32,
    pub(super) amplitude: f32,
    /// 2πfu, modulo 2π.
    pub(super) angle: f32,
    /// Its standard deviation, radians.
    pub(super) sigma: f32,
}

impl<'a> Phase<'a> {
    pub(crate) fn new(captured: &'a Captured, group: &Group, solver: [Vec<f32>; 3]) -> Self {
        let planes = group.waves.iter().map(|w| captured.gray(w.image, false)).collect();
        let square = |row: &[f32]| row.iter().map(|v| v * v).sum::<f32>();
        let gain = (0.5 * (square(&solver[1]) + square(&solver[2]))).sqrt();
        Self { planes, solver, omega: TAU * group.frequency as f32, gain }
    }

    /// Offset, amplitude and phase at pixel `i`, whose intensities have standard deviation `noise`; `None` where the amplitude
    /// is too small.
    #[inline]
    pub(crate) fn at(&self, i: usize, noise: f32) -> Option<Seen> {
        let [mut o, mut c, mut s] = [0.0f32; 3];
        for (j, plane) in self.planes.iter().enumerate() {
            let p = plane[i];
            o += self.solver[0][j] * p;
            c += self.solver[1][j] * p;
            s += self.solver[2][j] * p;
        }
        let amplitude = c.hypot(s);
        let sigma = noise.hypot(UNEXPLAINED) * self.gain;
        (amplitude > (LEAST_AMPLITUDE.0 * sigma).max(LEAST_AMPLITUDE.1)).then(|| Seen {
            offset: o,
            amplitude,
            angle: s.atan2(c),
            sigma: sigma / amplitude,
        })
    }
}

/// Most frequencies of a code.
const MOST: usize = 16;

/// The column of pixel `i` and its standard deviation.
fn unwrap(phases: &[Phase<'_>], i: usize, noise: f32, [low, high]: [f32; 2]) -> Option<(f32, f32)> {
    let none = Seen { offset: 0.0, amplitude: 0.0, angle: 0.0, sigma: 0.0 };
    let mut seen = [none; MOST];
    let n = phases.len().min(MOST);
    for (s, phase) in seen.iter_mut().zip(&phases[..n]) {
        *s = phase.at(i, noise)?;
    }
    let (finest, omega) = (seen[0], phases[0].omega);
    let period = TAU / omega;
    let first = ((low - finest.angle / omega) / period).ceil() as i32;
    let last = ((high - finest.angle / omega) / period).floor() as i32;
    let (mut best, mut second, mut column) = (f32::INFINITY, f32::INFINITY, f32::NAN);
    for k in first..=last {
        let u = (finest.angle + TAU * k as f32) / omega;
        let mut cost = 0.0;
        for (s, phase) in seen[1..n].iter().zip(&phases[1..n]) {
            let carried = finest.sigma * phase.omega / omega;
            let off = wrap(s.angle - phase.omega * u);
            cost += off * off / (s.sigma * s.sigma + carried * carried + MODEL * MODEL);
        }
        if cost < best {
            (second, best, column) = (best, cost, u);
        } else {
            second = second.min(cost);
        }
    }
    if column.is_nan() || best > MAX_MISFIT * (n - 1).max(1) as f32 || second - best < MARGIN {
        return None;
    }
    let (mut sum, mut weights) = (0.0, 0.0);
    for (s, phase) in seen[..n].iter().zip(&phases[..n]) {
        let w = (phase.omega / s.sigma.max(1e-6)).powi(2);
        sum += w * wrap(s.angle - phase.omega * column) / phase.omega;
        weights += w;
    }
    Some((column + sum / weights, 1.0 / weights.sqrt()))
}

/// After how many px all phases are back where they were, to within what noise leaves; `None` if no two of `n` columns are that
/// far apart.
fn repeats_after(groups: &[Group], n: f64) -> Option<f32> {
    let finest = groups[0].period();
    (1..)
        .map(|k| f64::from(k) * finest)
        .take_while(|s| *s < n - 0.5)
        .find(|s| groups[1..].iter().all(|g| wrap((f64::from(TAU) * s * g.frequency) as f32).abs() < 3.0 * MODEL))
        .map(|s| s as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wave::tests::sinusoids;

    fn groups(parts: &[(f64, usize)]) -> Vec<Group> {
        let set = PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() };
        learn(&sinusoids(640, parts), &set, "phase").unwrap()
    }

    #[test]
    fn a_code_repeats_after_its_beat() {
        assert!((repeats_after(&groups(&[(16.0, 3)]), 640.0).unwrap() - 16.0).abs() < 0.01);
        assert!(repeats_after(&groups(&[(16.0, 3), (640.0, 3)]), 640.0).is_none());
        // 16 and 20: 80.
        assert!((repeats_after(&groups(&[(16.0, 3), (20.0, 3)]), 640.0).unwrap() - 80.0).abs() < 0.1);
    }

    #[test]
    fn every_column_comes_back_from_its_intensities() {
        let parts = [(18.0, 4), (60.0, 3), (640.0, 3)];
        let code = sinusoids(640, &parts);
        let groups = groups(&parts);
        let planes: Vec<Vec<f32>> = code.lines.iter().map(|l| l.values.clone()).collect();
        let phases: Vec<Phase<'_>> = groups
            .iter()
            .map(|g| {
                let solver = g.solver().unwrap();
                let mine = g.waves.iter().map(|w| planes[w.image][..].into()).collect();
                Phase { planes: mine, gain: 0.7, solver, omega: TAU * g.frequency as f32 }
            })
            .collect();
        for u in 0..640 {
            let (found, sigma) = unwrap(&phases, u, 0.0015, [-0.5, 639.5]).unwrap();
            // Eight bits: 1/255/√12 of noise over an amplitude of one half.
            assert!((found - u as f32).abs() < 0.03 && sigma < 0.03, "{found} for {u}");
        }
        // The coarse phases alone do not tell which of two periods at the ends: none is invented.
        assert!(unwrap(&phases[..1], 100, 0.0015, [-0.5, 639.5]).is_none());
    }
}
