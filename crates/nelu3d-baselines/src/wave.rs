//! Sinusoidal codes, learned from the projected images: frequency and phase of each, and which belong together.

use std::borrow::Cow;
use std::f64::consts::TAU;

use nelu3d_scan::pattern::{Wave, WaveGroup, WaveImage};
use nelu3d_scan::rig::PatternSet;

use super::captured::Captured;
use super::code::{AxisCode, Line};
use super::error::DecodeError;

/// Largest RMS misfit of a sinusoid, as a share of full scale.
const MAX_MISFIT: f64 = 0.01;

/// Smallest amplitude of a sinusoid, as a share of full scale.
const MIN_AMPLITUDE: f64 = 0.05;

/// Images whose frequencies differ by less than this, in cycles over the whole image, share one.
const SAME: f64 = 0.05;

/// Fits a sinusoid to every image and groups them by frequency, the highest first.
pub(crate) fn learn(code: &AxisCode, set: &PatternSet, method: &'static str) -> Result<Vec<WaveGroup>, DecodeError> {
    let n = code.len() as f64;
    let mut waves: Vec<(&Line, f64, f64)> = Vec::new();
    for line in &code.lines {
        let fitted = Wave::fit(&line.values)
            .filter(|f| f.rms <= MAX_MISFIT && (MIN_AMPLITUDE..1.0).contains(&f.amplitude))
            .ok_or_else(|| DecodeError::Unsuited {
                set: set.name.clone(),
                method,
                problem: format!("{} is not a sinusoid", line.path.display()),
                remedy: "use setting `method` zncc or gray, or setting `gamma` if the images are not linear in light"
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
            let waves = members.iter().map(|m| WaveImage { image: m.0.image, phase: phase(m.2) }).collect();
            WaveGroup { frequency, waves }
        })
        .collect())
}

/// Returns the normalized images of a code's groups, by their place in the pattern set.
pub(crate) fn planes<'a>(captured: &'a Captured, groups: &[WaveGroup]) -> Vec<Cow<'a, [f32]>> {
    let images = || groups.iter().flat_map(|g| &g.waves).map(|w| w.image);
    let mut planes = vec![Cow::default(); images().max().map_or(0, |last| last + 1)];
    for image in images() {
        planes[image] = captured.gray(image, false);
    }
    planes
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use nelu3d_scan::pattern::{Axis, Pattern, PhaseSolver, Sinusoid, wrap_angle};

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
            assert!((g.period_px() / period - 1.0).abs() < 2e-3, "{} for {period}", g.period_px());
            for (i, w) in g.waves.iter().enumerate() {
                let off = wrap_angle((w.phase - TAU * i as f64 / steps as f64) as f32);
                assert!(off.abs() < 0.01, "{period}, step {i}: {off}");
            }
            assert_eq!(PhaseSolver::new(g).is_some(), steps >= 3);
        }
        let mut ramp = code;
        ramp.lines[2].values = (0..640).map(|u| u as f32 / 640.0).collect();
        let error = learn(&ramp, &set, "phase").unwrap_err().to_string();
        assert!(error.contains("p.png is not a sinusoid"), "{error}");
    }
}
