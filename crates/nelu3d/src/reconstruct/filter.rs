//! Rejects pixels whose depth is not supported by what was measured. This is where a refined pixel loses its depth.

use serde::Serialize;

use super::context::Context;
use super::error::Failure;
use super::maps::local_mean;
use super::refine::Refined;
use super::scene::Scene;
use crate::surface::{Links, MAX_SLOPE, PixelStatus, reject_small_components};

/// Settings of the rejection of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FilterSettings {
    /// Mean χ² per measurement over 5 × 5 pixels above which no surface explains the codeword.
    pub max_chi2: f32,
    /// χ² per measurement of a pixel at a depth discontinuity above which its codeword is a mixture of two surfaces.
    pub max_edge_chi2: f32,
    /// Smallest connected component that is valid, px.
    pub min_component: usize,
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self { max_chi2: 40.0, max_edge_chi2: 9.0, min_component: 40 }
    }
}

/// Returns the depth of every valid pixel (camera z, mm; NaN elsewhere) and notes in the scene's measurements why the
/// others are rejected: outside the calibrated volume, unexplained codeword, mixed pixel at a depth discontinuity,
/// component too small.
pub(crate) fn filter(
    scene: &mut Scene<'_>,
    refined: &Refined,
    settings: &FilterSettings,
    cx: &mut Context<'_>,
) -> Result<Vec<f32>, Failure> {
    cx.clock.begin("filter");
    let Scene { camera, rays, measurements: m, .. } = scene;
    let mut depth: Vec<f32> = refined.inv_z.iter().map(|v| 1.0 / v).collect();
    let chi2 = local_mean(&refined.chi2, m.width, m.height, 2);
    for i in 0..m.n() {
        if !depth[i].is_finite() {
            continue;
        }
        let [near, far] = rays.range[i];
        let t = depth[i] / rays.dir_z(i);
        if !(t >= near && t <= far) {
            m.status[i] = PixelStatus::OutsideVolume;
        } else if chi2[i] > settings.max_chi2 {
            m.status[i] = PixelStatus::Ambiguous;
        } else {
            continue;
        }
        depth[i] = f32::NAN;
    }
    let links = Links::new(&depth, camera, MAX_SLOPE);
    for i in links.at_jumps(&depth, m.width) {
        if refined.chi2[i] > settings.max_edge_chi2 {
            m.status[i] = PixelStatus::DepthDiscontinuity;
            depth[i] = f32::NAN;
        }
    }
    reject_small_components(&mut depth, &mut m.status, camera, settings.min_component);
    for i in 0..m.n() {
        if depth[i].is_nan() && m.status[i] == PixelStatus::Valid {
            // Decoding at reduced resolution does not tell which of the full image's rays miss the volume.
            let [near, far] = rays.range[i];
            m.status[i] = if near > far { PixelStatus::OutsideVolume } else { PixelStatus::Ambiguous };
        }
    }
    if depth.iter().all(|z| z.is_nan()) {
        return Err(nothing_left(&m.status));
    }
    Ok(depth)
}

/// Returns the failure of a scene in which every pixel is rejected.
pub(crate) fn nothing_left(status: &[PixelStatus]) -> Failure {
    let rejected = PixelStatus::describe_rejections(status, "the calibrated volume");
    Failure::Nothing(format!("{rejected}; check the exposure and that the object stands where the board was swept"))
}
