//! The start: a cost volume over the frozen color field, aggregated across neighbors.
//!
//! c is known, so E(t) = how badly c(x(t)) explains a pixel's codeword is known along every ray before anything is
//! optimized. Costs are in units of −2 log likelihood (χ²), and so are the penalties between neighbors: −2 log of the
//! prior probability of a step or a jump in depth. The minimum over all depth hypotheses and neighbors is approached by
//! semi-global matching along eight directions (Hirschmüller 2008), in [`nelu3d_field::cost_volume`]. This folder turns
//! measurements and camera rays into its problem, and its answer into depth.

mod hypotheses;
mod misfit;
mod problem;
mod settings;

pub(super) use hypotheses::{depth_hypotheses, depth_noise};
pub(super) use misfit::{misfit, saturation};
pub use settings::DecodeSettings;

use nelu3d_field::cost_volume::Winner;
use nelu3d_field::device::Device;

use super::lookup::{Lookup, Rays};
use super::measure::Measurements;
use crate::color_field::validity::Validity;
use crate::result::Left;

/// A decoded image.
pub struct Decoded {
    /// Inverse depth 1/z per pixel, 1/mm; NaN where nothing was decoded.
    pub inv_z: Vec<f32>,
    /// How much worse (χ²) the best clearly different depth is, after aggregation.
    pub margin: Vec<f32>,
    /// The spacing of depth hypotheses in 1/z, 1/mm.
    pub label_step: f32,
}

/// Decodes every valid pixel, on a device or, if it fails, on the CPU. Pixels whose rays miss the calibrated volume are
/// marked [`Left::Outside`].
pub fn decode(
    m: &mut Measurements,
    rays: &Rays,
    grid: &Lookup<'_>,
    valid: &Validity,
    s: &DecodeSettings,
    device: &Device,
) -> Decoded {
    let n = m.n();
    let mut out = Decoded { inv_z: vec![f32::NAN; n], margin: vec![0.0; n], label_step: 0.0 };
    let Some(hypotheses) = depth_hypotheses(m, rays, grid, s.max_labels) else {
        return out;
    };
    let pixels: Vec<u32> = (0..n).filter(|i| m.left[*i] == Left::Kept).map(|i| i as u32).collect();
    let solve = |device: &Device| problem::solve(m, rays, grid, valid, s, hypotheses, &pixels, device);
    let winners: Vec<Winner> = solve(device).unwrap_or_else(|e| {
        // A GPU that fails is no reason to have no result.
        tracing::warn!("{e}; decoded on the CPU instead");
        solve(&Device::Cpu).expect("the CPU does not fail")
    });
    out.label_step = hypotheses.spacing;
    for (i, winner) in pixels.into_iter().zip(winners) {
        let i = i as usize;
        if winner.index.is_nan() {
            m.left[i] = Left::Outside;
            continue;
        }
        out.inv_z[i] = hypotheses.first + winner.index * hypotheses.spacing;
        out.margin[i] = winner.margin;
    }
    out
}

#[cfg(test)]
mod tests;
