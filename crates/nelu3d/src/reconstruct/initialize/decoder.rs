//! Decodes measurements over the whole calibrated volume.

use nelu3d_field::device::Device;
use nelu3d_scan::Camera;

use super::small_components::SmallComponents;
use crate::color_field::{CameraRays, ColorField, SplineEvaluator};
use crate::progress::Progress;
use crate::reconstruct::cost_volume::{decode, depth_noise};
use crate::reconstruct::maps::{fill_from_neighbors, interpolate_within};
use crate::reconstruct::settings::FastSettings;
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Everything that decoding needs besides the measurements.
pub(crate) struct Decoder<'a> {
    pub(crate) camera: &'a Camera,
    /// The first column and row of its picture that the measurements are of.
    pub(crate) origin: [usize; 2],
    pub(crate) field: &'a ColorField,
    /// Rays of the camera's full image.
    pub(crate) rays: &'a CameraRays,
    pub(crate) spline: &'a SplineEvaluator<'a>,
    pub(crate) settings: &'a FastSettings,
    pub(crate) device: &'a Device,
    pub(crate) progress: &'a Progress,
}

/// A decoded surface in the unit of its depth hypotheses.
pub struct InitialDepth {
    /// Inverse depth 1/z per pixel, 1/mm; NaN where there is none.
    pub inv_z: Vec<f32>,
    /// Spacing of the depth hypotheses in 1/z, 1/mm: the natural unit of 1/z in what follows.
    pub step: f32,
}

impl Decoder<'_> {
    /// Decodes every valid pixel; those without a depth of their own take that of their nearest neighbors.
    pub(crate) fn decode_filled(&self, m: &mut Measurements) -> InitialDepth {
        let mut found = self.decode(m);
        fill_from_neighbors(&mut found.inv_z, &m.status, m.width);
        found
    }

    /// Decodes every valid pixel and rejects components of the surface that are too small. Large or noisy images are
    /// decoded reduced: one pixel's codeword should tell its depth to about one hypothesis.
    pub(crate) fn decode(&self, m: &mut Measurements) -> InitialDepth {
        let n_valid = m.status.iter().filter(|s| **s == PixelStatus::Valid).count();
        let too_large = (1..).find(|f| n_valid / (f * f) <= self.settings.max_decoded_pixels);
        let noisy = self.noise_reduction(m);
        let factor = too_large.expect("some reduction is enough").max(noisy);
        tracing::info!(reduction = factor, noisy, "decode");
        if factor == 1 {
            let found = self.decode_at(m, self.rays, self.camera);
            return expand(&found, 1, [self.camera.width, self.camera.height], m);
        }
        let mut reduced = m.reduced(factor);
        let camera = self.camera.binned(factor);
        let lit = |i: usize| reduced.status[i] == PixelStatus::Valid;
        let rays = CameraRays::of_lit(self.camera, self.field, factor, self.origin, lit);
        let found = self.decode_at(&mut reduced, &rays, &camera);
        for i in 0..m.n() {
            let (x, y) = (i % m.width / factor, i / m.width / factor);
            let of_block = (x < reduced.width && y < reduced.height).then(|| reduced.status[y * reduced.width + x]);
            if m.status[i] == PixelStatus::Valid && of_block == Some(PixelStatus::OutsideVolume) {
                m.status[i] = PixelStatus::OutsideVolume;
            }
        }
        expand(&found, factor, [camera.width, camera.height], m)
    }

    /// Returns the side of the square of pixels whose codewords together tell depth to about one hypothesis, 1 to 4.
    pub(crate) fn noise_reduction(&self, m: &Measurements) -> usize {
        depth_noise(m, self.rays, self.spline).round().clamp(1.0, 4.0) as usize
    }

    /// Decodes measurements of one resolution.
    fn decode_at(&self, m: &mut Measurements, rays: &CameraRays, camera: &Camera) -> InitialDepth {
        let s = self.settings;
        let found = decode(
            m,
            rays,
            self.spline,
            &self.field.validity,
            &s.cost_volume,
            &s.light_fractions,
            self.device,
            self.progress,
        );
        let mut inv_z = found.inv_z;
        let step = found.hypothesis_step;
        SmallComponents { spline: self.spline, settings: s, m, rays, camera, step }.settle(&mut inv_z);
        InitialDepth { inv_z, step }
    }
}

/// Returns the decoded surface at the valid pixels of the full image, from that of a reduced image of size `[width,
/// height]`.
fn expand(reduced: &InitialDepth, factor: usize, [width, height]: [usize; 2], m: &Measurements) -> InitialDepth {
    let mut inv_z = vec![f32::NAN; m.n()];
    let half = (factor as f32 - 1.0) / 2.0;
    for (i, v) in inv_z.iter_mut().enumerate() {
        if m.status[i] != PixelStatus::Valid {
            continue;
        }
        let reduced_at = |p: usize, n: usize| ((p as f32 - half) / factor as f32).clamp(0.0, n as f32 - 1.0);
        let (x, y) = (reduced_at(i % m.width, width), reduced_at(i / m.width, height));
        *v = interpolate_within(&reduced.inv_z, width, height, x, y, 3.0 * reduced.step);
    }
    InitialDepth { inv_z, step: reduced.step }
}
