//! Decoding: a cost volume over the frozen color field, aggregated across neighbors.
//!
//! c is known, so the cost E(t) of c(x(t)) as an explanation of a pixel's codeword is known along every ray before
//! anything is optimized. Costs are in units of −2 log likelihood (χ²), and so are the penalties between neighbors: −2
//! log of the prior probability of a step or a jump in depth. The minimum over all depth hypotheses and neighbors is
//! approached by semi-global matching along eight directions (Hirschmüller 2008), in [`nelu3d_field::cost_volume`].
//! This folder turns measurements and camera rays into its problem, and its answer into depth.

mod chi2;
mod hypotheses;
#[doc(hidden)]
pub mod problem;
mod settings;

pub(crate) use chi2::{chi2_of_codeword, chi2_of_weighted, saturation};
pub use hypotheses::depth_hypotheses;
pub(crate) use hypotheses::{HYPOTHESIS_PX, depth_noise};
pub use settings::CostVolumeSettings;

use nelu3d_field::cost_volume::{self, Winner};
use nelu3d_field::device::Device;

use super::light_fractions::LightFractionPrior;
use crate::color_field::validity::Validity;
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::progress::Progress;
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// A decoded image.
pub struct DecodedDepth {
    /// Inverse depth 1/z per pixel, 1/mm; NaN where nothing was decoded.
    pub inv_z: Vec<f32>,
    /// Margin in χ², after aggregation, by which the best clearly different depth is worse.
    pub margin: Vec<f32>,
    /// The spacing of depth hypotheses in 1/z, 1/mm.
    pub hypothesis_step: f32,
}

/// Decodes every valid pixel, on a device or, if it fails, on the CPU. Pixels whose rays miss the calibrated volume,
/// and those whose best depth is where it ends, are marked [`PixelStatus::OutsideVolume`].
pub fn decode(
    m: &mut Measurements,
    rays: &CameraRays,
    grid: &SplineEvaluator<'_>,
    valid: &Validity,
    s: &CostVolumeSettings,
    prior: &LightFractionPrior,
    device: &Device,
    progress: &Progress,
) -> DecodedDepth {
    let (n, prior) = (m.n(), prior.weights(m));
    let mut out = DecodedDepth { inv_z: vec![f32::NAN; n], margin: vec![0.0; n], hypothesis_step: 0.0 };
    let Some(hypotheses) = depth_hypotheses(m, rays, grid, s.max_hypotheses) else {
        return out;
    };
    let pixels: Vec<u32> = (0..n).filter(|i| m.status[*i] == PixelStatus::Valid).map(|i| i as u32).collect();
    let solve = |device: &Device| problem::solve(m, rays, grid, valid, s, prior, hypotheses, &pixels, device);
    let winners: Vec<Winner> = progress.measure("cost volume", || {
        let winners = solve(device).unwrap_or_else(|e| {
            // A GPU that fails is no reason to have no result.
            tracing::warn!("{e}; decoded on the CPU instead");
            solve(&Device::Cpu).expect("the CPU does not fail")
        });
        let inside = |i: &u32| {
            let [first, end] = hypotheses.range(rays.range[*i as usize], rays.dir_z(*i as usize));
            end.saturating_sub(first) as usize
        };
        let inside = if progress.is_heard() { pixels.iter().map(inside).sum() } else { 0 };
        (winners, cost_volume::demand(inside, pixels.len() * hypotheses.count, m.k))
    });
    out.hypothesis_step = hypotheses.spacing;
    for (i, winner) in pixels.into_iter().zip(winners) {
        let i = i as usize;
        // A minimum at an end of the range need not be one: what lies beyond was not tried.
        let [first, end] = hypotheses.range(rays.range[i], rays.dir_z(i)).map(|l| l as f32);
        let at_an_end = winner.index < first + 0.5 || winner.index > end - 1.5;
        if winner.index.is_nan() || at_an_end {
            m.status[i] = PixelStatus::OutsideVolume;
            continue;
        }
        out.inv_z[i] = hypotheses.first + winner.index * hypotheses.spacing;
        out.margin[i] = winner.margin;
    }
    out
}
