//! Decoding as a problem that [`nelu3d_field::cost_volume`] solves on a device.

use nelu3d_field::cost_volume::{self, DepthHypotheses, LitCells, PixelRay, Problem, RaySource, Winner};
use nelu3d_field::device::{Device, DeviceError};

use super::chi2::saturation;
use super::settings::{CostVolumeSettings, Penalties};
use crate::color_field::validity::Validity;
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::sensor::Measurements;

/// The camera's rays, with the depth hypotheses that lie in the calibrated volume.
struct HypothesisRays<'a> {
    rays: &'a CameraRays,
    hypotheses: DepthHypotheses,
}

impl RaySource for HypothesisRays<'_> {
    fn ray(&self, pixel: u32) -> PixelRay {
        let i = pixel as usize;
        let dir_z = self.rays.dir_z(i);
        let range = self.hypotheses.range(self.rays.range[i], dir_z);
        PixelRay { dir: self.rays.in_frame(i).dir, dir_z, range }
    }
}

/// Returns the winning hypothesis of every pixel of `pixels`.
///
/// # Errors
///
/// The device failed, or the problem is too large for it.
pub fn solve(
    m: &Measurements,
    rays: &CameraRays,
    grid: &SplineEvaluator<'_>,
    valid: &Validity,
    s: &CostVolumeSettings,
    prior: [f32; 2],
    hypotheses: DepthHypotheses,
    pixels: &[u32],
    device: &Device,
) -> Result<Vec<Winner>, DeviceError> {
    let Some(first) = pixels.first() else { return Ok(Vec::new()) };
    let penalties = Penalties::new(s, hypotheses.count);
    // Also what is known along one axis of the code only: there, the other channels of a pixel weigh nothing.
    let lit = valid.lit_at_all();
    let of_camera = rays.in_frame(*first as usize);
    let problem = Problem {
        width: m.width,
        height: m.height,
        pixels,
        hypotheses,
        frame: of_camera.frame,
        center: of_camera.center,
        rays: &HypothesisRays { rays, hypotheses },
        p: &m.p,
        inv_var: &m.inv_var,
        surround: &m.surround,
        lattice: grid.lattice(),
        lit: LitCells { cells: valid.shape.cells, lit: &lit },
        prior,
        saturation: saturation(m),
        step: penalties.step,
        jump: penalties.jump,
    };
    cost_volume::winners(device, &problem)
}
