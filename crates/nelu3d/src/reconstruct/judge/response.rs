//! How measured intensities follow the field's on the surface that was found: by a factor where white was exposed
//! differently, by a curve where values are not linear in light, not at all where the surface is not the scene's.

use nelu3d_scan::statistics::median;

use super::super::scene::Scene;
use crate::surface::PixelStatus;
use crate::verdict::{Code, Finding, Verdict};

/// Most pixels that are compared.
const MAX_PIXELS: usize = 6000;
/// Number of bins of the field's intensity.
pub const BINS: usize = 10;
/// Fewest values in a bin.
const MIN_IN_BIN: usize = 100;
/// Deviation of mid intensities from the line between dark and bright ones, normalized intensity, that no linear
/// camera shows; interreflection lifts dark values, not mid ones.
const MAX_CURVE: f64 = 0.05;
/// Deviation from 1 of the factor that no constant exposure shows.
const MAX_FACTOR: f64 = 0.06;
/// Median distance of measured intensities from the curve's, normalized intensity, of a surface that is not there: no
/// response scatters.
const MAX_SCATTER: f64 = 0.1;

/// Medians of measured intensity by the field's intensity, and how far measured intensities are from them.
pub struct ResponseCurve {
    /// Medians by the field's intensity, from 0 to 1 in even steps; `None` where a step has too few samples.
    pub medians: [Option<f64>; BINS],
    /// Median over all bins; 0 where there are none.
    pub scatter: f64,
}

/// Judges the response of camera and exposure on the valid pixels.
pub(super) fn judge(scene: &Scene<'_>, depth: &[f32]) -> Option<Finding> {
    let curve = ResponseCurve::of(scene, depth);
    tracing::debug!(curve = ?curve.medians, scatter = curve.scatter, "measured by predicted intensity");
    curve.judge()
}

impl ResponseCurve {
    fn of(scene: &Scene<'_>, depth: &[f32]) -> Self {
        let m = &scene.measurements;
        let valid: Vec<usize> =
            (0..m.n()).filter(|i| m.status[*i] == PixelStatus::Valid && depth[*i].is_finite()).collect();
        let mut bins: [Vec<f32>; BINS] = std::array::from_fn(|_| Vec::new());
        let mut c = vec![0.0; m.k];
        for &i in valid.iter().step_by((valid.len() / MAX_PIXELS).max(1)) {
            let t = f64::from(depth[i] / scene.rays.dir_z(i));
            scene.grid.eval(scene.rays.in_frame(i).at(t).q, &mut c);
            for (j, c) in c.iter().enumerate().filter(|(j, _)| m.inv_var[i * m.k + j] > 0.0) {
                if let Some(bin) = bins.get_mut((c.max(0.0) * BINS as f32) as usize) {
                    bin.push(m.p[i * m.k + j]);
                }
            }
        }
        let mut distances = Vec::new();
        let medians = bins.map(|mut bin| {
            let middle = if bin.len() < MIN_IN_BIN { None } else { median(&mut bin) }?;
            distances.extend(bin.iter().map(|v| (v - middle).abs()));
            Some(f64::from(middle))
        });
        Self { medians, scatter: median(&mut distances).map_or(0.0, f64::from) }
    }

    /// Returns what is wrong with the response, if anything is.
    pub fn judge(&self) -> Option<Finding> {
        if self.scatter > MAX_SCATTER {
            let sentence = format!(
                "measured intensities are {:.2} from the field's on the surface that was found, which is not the \
                 scene's then",
                self.scatter
            );
            let remedy = "give a training more steps or another start; else check that the images are this scene's, in \
                          the set's order";
            let finding = Finding::new(Code::ResidualAboveNoise, Verdict::Doubtful, sentence, remedy);
            return Some(finding.with("scatter", self.scatter));
        }
        let known: Vec<(f64, f64)> = self
            .medians
            .iter()
            .enumerate()
            .filter_map(|(i, v)| Some(((i as f64 + 0.5) / BINS as f64, (*v)?)))
            .collect();
        let (first, last) = (*known.first()?, *known.last()?);
        if last.0 - first.0 < 0.55 || last.0 < 0.7 {
            return None;
        }
        let line = |x: f64| first.1 + (last.1 - first.1) * (x - first.0) / (last.0 - first.0);
        // A factor is what most bins agree on (single ones may be few pixels of one spot), the brightest has it, too (at a
        // code's edges, where what is between black and white lies, the field may be smoother than the code), and the
        // middle (light from elsewhere takes from the bright what it gives to the dark).
        let mut ratios: Vec<f64> = known.iter().filter(|k| k.0 > 0.25).map(|k| k.1 / k.0).collect();
        let factors = [median(&mut ratios)?, last.1 / last.0, line(0.5) / 0.5];
        let factor = factors.into_iter().min_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs()))?;
        let mid: Vec<(f64, f64)> = known.iter().filter(|k| k.0 > 0.3 && k.0 < 0.7).copied().collect();
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| mid.iter().map(of).sum::<f64>() / mid.len().max(1) as f64;
        let (from_line, from_own) = (mean(&|k| k.1 - line(k.0)), mean(&|k| k.1 - k.0));
        let curve = if from_line * from_own > 0.0 && from_own.abs() > MAX_CURVE { from_line } else { 0.0 };
        if curve.abs() > MAX_CURVE {
            let sentence = format!(
                "mid intensities of the scene are {:.2} {} than dark and bright ones let expect: its images are not \
                 linear in light as the sweep's are",
                curve.abs(),
                if curve > 0.0 { "brighter" } else { "darker" }
            );
            let remedy =
                "take raw images, or linear ones: no gamma, no sRGB, no tone mapping, the same as in the sweep";
            return Some(
                Finding::new(Code::NonlinearResponse, Verdict::Doubtful, sentence, remedy).with("mid_deviation", curve),
            );
        }
        ((factor - 1.0).abs() > MAX_FACTOR).then(|| {
            let sentence = format!(
                "white is {:.0} % {} against the patterns than it was in the sweep",
                100.0 * (1.0 / factor - 1.0).abs(),
                if factor < 1.0 { "brighter" } else { "darker" }
            );
            let remedy = "take white and patterns with one exposure and gain, and keep the light's brightness constant";
            Finding::new(Code::ExposureJump, Verdict::Doubtful, sentence, remedy).with("white_factor", 1.0 / factor)
        })
    }
}
