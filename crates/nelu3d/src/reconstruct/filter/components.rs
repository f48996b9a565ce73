//! Whole components of a surface that are not explained: a wrong period of the code, or an object outside the volume.
//!
//! A single pixel may have a codeword that nothing explains: a highlight, a mixed pixel, a corner full of interreflection.
//! A whole component whose typical codeword does not fit, or fits only with more light of unseen origin than there is
//! between surfaces, is at a wrong depth.

use nelu3d_scan::Camera;
use nelu3d_scan::statistics::median;

use super::settings::FilterSettings;
use crate::reconstruct::refine::Refined;
use crate::surface::{Links, MAX_SLOPE, PixelStatus};

/// Rejects the connected components of a depth map (camera z, mm) that are not explained, as
/// [`PixelStatus::Ambiguous`].
pub(super) fn reject_unexplained_components(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    refined: &Refined,
    settings: &FilterSettings,
) {
    let (component, sizes) = Links::new(depth, camera, MAX_SLOPE).components(depth, camera.width);
    let mut members: Vec<Vec<usize>> = sizes.iter().map(|n| Vec::with_capacity(*n as usize)).collect();
    for (i, c) in component.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
        members[*c as usize].push(i);
    }
    for pixels in members.iter().filter(|p| p.len() >= settings.min_component.max(1)) {
        let median_of = |map: &[f32]| {
            let mut values: Vec<f32> = pixels.iter().map(|i| map[*i]).collect();
            median(&mut values).expect("a component has pixels")
        };
        let (chi2, unseen) = (median_of(&refined.chi2), median_of(&refined.unseen));
        tracing::debug!(pixels = pixels.len(), chi2, unseen, z = depth[pixels[pixels.len() / 2]], "component");
        if chi2 > settings.max_component_chi2 || unseen > settings.max_component_unseen {
            for &i in pixels {
                (depth[i], status[i]) = (f32::NAN, PixelStatus::Ambiguous);
            }
        }
    }
}
