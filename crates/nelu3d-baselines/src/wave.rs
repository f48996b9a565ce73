//! Sinusoidal codes, learned from the projected images: frequency and phase of each, and which belong together.

use std::f64::consts::TAU;

use nelu3d_scan::rig::PatternSet;

use super::code::{AxisCode, Line};
use super::error::DecodeError;

/// Largest RMS misfit of a sinusoid, as a share of full scale.
const MAX_MISFIT: f64 = 0.01;

/// Least amplitude of a sinusoid, as a share of full scale.
const LEAST_AMPLITUDE: f64 = 0.05;

/// Images whose frequencies differ by less than this, in cycles over the whole image, share one.
const SAME: f64 = 0.05;

/// One projected image: `offset + amplitude · cos(2π f u − phase)`, f being its group's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wave {
    /// Place in the pattern set.
    pub(super) image: usize,
    pub(super) phase: f64,
}

/// The images of one frequency.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Cycles per projector px.
    pub(super) frequency: f64,
    pub(super) waves: Vec<Wave>,
}

impl Group {
    pub(crate) fn period(&self) -> f64 {
        1.0 / self.frequency
    }

    /// The solution of `p_i = o + C cos φ_i + S sin φ_i` as rows over the images: o, C, S; `None` if the phases do not
    /// determine it. Then `C = B cos 2πfu`, `S = B sin 2πfu`.
    pub(crate) fn solver(&self) -> Option<[Vec<f32>; 3]> {
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
pub(crate) fn learn(code: &AxisCode, set: &PatternSet, method: &'static str) -> Result<Vec<Group>, DecodeError> {
    let n = code.len() as f64;
    let mut waves: Vec<(&Line, f64, f64)> = Vec::new();
    for line in &code.lines {
        let fitted = nelu3d_scan::pattern::Wave::fit(&line.values)
            .filter(|f| f.rms <= MAX_MISFIT && (LEAST_AMPLITUDE..1.0).contains(&f.amplitude))
            .ok_or_else(|| DecodeError::Unsuited {
                set: set.name.clone(),
                method,
                problem: format!("{} is not a sinusoid", line.path.display()),
                remedy:
                    "use --method zncc or gray, or give the projector's --gamma if the images are not linear in light"
                        .into(),
            })?;
        // The phase in the middle of the image: there it hardly depends on the frequency.
        let frequency = 1.0 / fitted.wave.period_px;
        waves.push((line, frequency, TAU * (0.5 * n * frequency - fitted.wave.shift)));
    }
    waves.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut groups: Vec<Vec<(&Line, f64, f64)>> = Vec::new();
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
            let phase = |middle: f64| (TAU * 0.5 * n * frequency - middle).rem_euclid(TAU);
            let waves = members.iter().map(|m| Wave { image: m.0.image, phase: phase(m.2) }).collect();
            Group { frequency, waves }
        })
        .collect())
}

/// An angle in −π to π.
#[inline]
pub(crate) fn wrap(angle: f32) -> f32 {
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
