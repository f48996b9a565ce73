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

/// Fits a sinusoid to every image of a code and groups them by frequency, the highest first. `set` and `method` are
/// named in messages.
///
/// # Errors
///
/// An image is not a sinusoid.
pub fn learn(code: &AxisCode, set: &PatternSet, method: &'static str) -> Result<Vec<WaveGroup>, DecodeError> {
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
