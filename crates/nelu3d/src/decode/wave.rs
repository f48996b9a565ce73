//! Sinusoidal codes, learned from the projected images: frequency and phase of each, and which belong together.

use std::f64::consts::TAU;

use nelu3d_scan::rig::PatternSet;

use super::Error;
use super::code::{AxisCode, Line};

/// Largest RMS misfit of a sinusoid, as a share of full scale.
const MAX_MISFIT: f64 = 0.01;

/// Images whose frequencies differ by less than this, in cycles over the whole image, share one.
const SAME: f64 = 0.05;

/// One projected image: `offset + amplitude · cos(2π f u − phase)`, f being its group's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wave {
    /// Place in the pattern set.
    pub(super) image: usize,
    pub(super) phase: f64,
}

/// The images of one frequency.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// Cycles per projector px.
    pub(super) frequency: f64,
    pub(super) waves: Vec<Wave>,
}

impl Group {
    pub(super) fn period(&self) -> f64 {
        1.0 / self.frequency
    }

    /// The solution of `p_i = o + C cos φ_i + S sin φ_i` as rows over the images: o, C, S; `None` if the phases do not
    /// determine it. Then `C = B cos 2πfu`, `S = B sin 2πfu`.
    pub(super) fn solver(&self) -> Option<[Vec<f32>; 3]> {
        let mut normal = nalgebra::Matrix3::zeros();
        let rows: Vec<nalgebra::Vector3<f64>> =
            self.waves.iter().map(|w| nalgebra::Vector3::new(1.0, w.phase.cos(), w.phase.sin())).collect();
        rows.iter().for_each(|r| normal += r * r.transpose());
        // Phases in one place determine nothing that noise would not drown.
        let smallest = normal.symmetric_eigenvalues().min();
        let inverse = normal.try_inverse().filter(|_| smallest > 0.05)?;
        let row = |k: usize| rows.iter().map(|r| (inverse * r)[k] as f32).collect();
        Some([row(0), row(1), row(2)])
    }
}

/// Fits a sinusoid to every image and groups them by frequency, the highest first.
pub(super) fn learn(code: &AxisCode, set: &PatternSet, method: &'static str) -> Result<Vec<Group>, Error> {
    let n = code.len() as f64;
    let mut waves = Vec::new();
    for line in &code.lines {
        let frequency = frequency(&line.values).filter(|f| fit(&line.values, *f).1 <= MAX_MISFIT).ok_or_else(|| {
            Error::Unsuited {
                set: set.name.clone(),
                method,
                problem: format!("{} is not a sinusoid", line.path.display()),
                remedy:
                    "use --method zncc or gray, or give the projector's --gamma if the images are not linear in light"
                        .into(),
            }
        })?;
        waves.push((line, frequency));
    }
    waves.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut groups: Vec<Vec<(&Line, f64)>> = Vec::new();
    for wave in waves {
        match groups.last_mut() {
            Some(g) if (g[0].1 - wave.1).abs() * n < SAME => g.push(wave),
            _ => groups.push(vec![wave]),
        }
    }
    Ok(groups
        .into_iter()
        .map(|mut members| {
            members.sort_by_key(|m| m.0.image);
            let frequency = members.iter().map(|m| m.1).sum::<f64>() / members.len() as f64;
            let wave = |m: &(&Line, f64)| {
                let ([_, c, s], _) = fit(&m.0.values, frequency);
                Wave { image: m.0.image, phase: s.atan2(c) }
            };
            Group { frequency, waves: members.iter().map(wave).collect() }
        })
        .collect())
}

/// Least squares of `o + C cos 2πfu + S sin 2πfu`: its three coefficients and the RMS misfit.
fn fit(values: &[f32], f: f64) -> ([f64; 3], f64) {
    let mut normal = nalgebra::Matrix3::zeros();
    let mut rhs = nalgebra::Vector3::zeros();
    let mut square = 0.0;
    // cos and sin of a growing angle by rotation.
    let (step_s, step_c) = (TAU * f).sin_cos();
    let (mut s, mut c) = (0.0, 1.0);
    for v in values {
        let v = f64::from(*v);
        let row = nalgebra::Vector3::new(1.0, c, s);
        normal += row * row.transpose();
        rhs += row * v;
        square += v * v;
        (s, c) = (s * step_c + c * step_s, c * step_c - s * step_s);
    }
    let Some(inverse) = normal.try_inverse() else { return ([0.0; 3], f64::INFINITY) };
    let x = inverse * rhs;
    let rms = ((square - x.dot(&rhs)).max(0.0) / values.len() as f64).sqrt();
    (x.into(), rms)
}

/// The frequency that explains a line best, cycles per px; `None` for a line without one. A search over half-cycle steps of
/// the whole image, then golden sections.
fn frequency(values: &[f32]) -> Option<f64> {
    let n = values.len() as f64;
    let (low, high) = values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    if values.len() < 8 || high - low < 0.05 {
        return None;
    }
    let candidates = (1..values.len()).map(|k| 0.5 * k as f64 / n);
    let best = candidates.map(|f| (fit(values, f).1, f)).min_by(|a, b| a.0.total_cmp(&b.0))?.1;
    let (mut a, mut b) = ((best - 0.5 / n).max(0.2 / n), (best + 0.5 / n).min(0.5));
    const GOLDEN: f64 = 0.618_033_988_749_895;
    for _ in 0..40 {
        let (p, q) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
        if fit(values, p).1 < fit(values, q).1 { b = q } else { a = p }
    }
    Some(0.5 * (a + b))
}

/// An angle in −π to π.
#[inline]
pub(super) fn wrap(angle: f32) -> f32 {
    use std::f32::consts::TAU;
    angle - TAU * (angle / TAU).round()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use nelu3d_scan::pattern::{Axis, Pattern, Sinusoid};

    /// The code of phase-shifted sinusoids as 8-bit images: period and steps of each.
    pub(crate) fn sinusoids(n: usize, parts: &[(f64, usize)]) -> AxisCode {
        let mut lines = Vec::new();
        for &(period_px, steps) in parts {
            let made = Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps }).generate(n, 1).unwrap();
            for p in made.images {
                let values = p.image.data.iter().map(|v| (v * 255.0).round() / 255.0).collect();
                lines.push(Line { image: lines.len(), channel: 0, path: "p.png".into(), values });
            }
        }
        AxisCode { axis: Axis::X, lines }
    }

    #[test]
    fn periods_and_phases_are_learned_from_eight_bit_images() {
        let set = PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() };
        let code = sinusoids(640, &[(640.0, 3), (16.25, 4), (80.0, 3), (15.9, 1)]);
        let groups = learn(&code, &set, "phase").unwrap();
        let expected = [(15.9, 1), (16.25, 4), (80.0, 3), (640.0, 3)];
        assert_eq!(groups.len(), 4);
        for (g, (period, steps)) in groups.iter().zip(expected) {
            assert_eq!(g.waves.len(), steps);
            assert!((g.period() / period - 1.0).abs() < 2e-3, "{} for {period}", g.period());
            for (i, w) in g.waves.iter().enumerate() {
                let off = wrap((w.phase - TAU * i as f64 / steps as f64) as f32);
                assert!(off.abs() < 0.01, "{period}, step {i}: {off}");
            }
            assert_eq!(g.solver().is_some(), steps >= 3);
        }
        let mut ramp = code;
        ramp.lines[2].values = (0..640).map(|u| u as f32 / 640.0).collect();
        let error = learn(&ramp, &set, "phase").unwrap_err().to_string();
        assert!(error.contains("p.png is not a sinusoid"), "{error}");
    }
}
