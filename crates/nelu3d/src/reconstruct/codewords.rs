//! Decoded points and their codewords, without refinement, for the estimation of a projector's blur and response.

use nelu3d_field::device::Device;
use nelu3d_scan::Camera;
use nelu3d_scan::rig::Capture;

use super::initialize::Decoder;
use super::light_fractions::LightFractionPrior;
use super::options::ReconstructionOptions;
use super::settings::FastSettings;
use crate::color_field::{CameraRays, ColorField, SplineEvaluator};
use crate::progress::Progress;
use crate::sensor::Measurements;

/// A decoded surface point and the codeword that its pixel measured.
pub struct Codeword {
    /// Camera-frame point, mm.
    pub point: [f64; 3],
    /// The k normalized intensities; NaN where a channel is unusable.
    pub intensities: Vec<f32>,
    /// Mean variance that noise gives them, normalized intensity squared.
    pub variance: f32,
}

/// Largest number of pixels that are decoded: a sample is enough.
const MAX_PIXELS: usize = 30_000;

/// Standard deviation of a color field whose blur and response are not known yet, normalized intensity.
const MODEL_SIGMA: f32 = 0.05;

/// Decodes a capture, and returns the pixels whose surroundings agree with them.
pub(crate) fn decode_codewords(capture: &Capture, camera: &Camera, field: &ColorField) -> Vec<Codeword> {
    let metadata = &field.metadata;
    let mut m = Measurements::new(capture, [camera.width, camera.height], &metadata.noise, &metadata.dark, MODEL_SIGMA);
    let settings = FastSettings {
        light_fractions: LightFractionPrior { sigma_ambient: 0.03, sigma_indirect: 0.1 },
        min_component: 50,
        max_decoded_pixels: MAX_PIXELS,
        ..FastSettings::new(&ReconstructionOptions::default())
    };
    let (grid, rays) = (field.to_grid(), CameraRays::new(camera, field, 1, [0, 0]));
    let spline = SplineEvaluator::new(&grid, metadata.cells_per_pixel);
    let (device, progress) = (&Device::Cpu, &Progress::none());
    let decoder =
        Decoder { camera, origin: [0, 0], field, rays: &rays, spline: &spline, settings: &settings, device, progress };
    let inv_z = decoder.decode(&mut m).inv_z;
    let k = m.k;
    (0..m.n())
        .filter(|i| inv_z[*i].is_finite())
        .map(|i| {
            let z = 1.0 / f64::from(inv_z[i]);
            let [u, v] = rays.plane[i].map(f64::from);
            let intensities =
                (i * k..(i + 1) * k).map(|j| if m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN }).collect();
            let inv_var = m.inv_var[i * k..(i + 1) * k].iter().filter(|v| **v > 0.0);
            let (n, sum) = inv_var.fold((0, 0.0), |(n, sum), v| (n + 1, sum + 1.0 / v));
            let variance = (sum / n.max(1) as f32 - MODEL_SIGMA * MODEL_SIGMA).max(0.0);
            Codeword { point: [u * z, v * z, z], intensities, variance }
        })
        .collect()
}
