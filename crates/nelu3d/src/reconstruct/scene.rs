//! A scene as every stage of a reconstruction reads it.

use std::borrow::Cow;

use nelu3d_scan::rig::Capture;
use nelu3d_scan::{Camera, Image};

use super::context::Context;
use super::demand;
use super::error::Failure;
use super::lit_part::LitPart;
use super::lit_part::white_of;
use crate::color_field::grid::Grid;
use crate::color_field::{CameraRays, ColorField, SplineEvaluator};
use crate::sensor::{Blur, Measurements};
use crate::surface::PixelStatus;

/// Camera, color field, rays and measurements of a scene.
pub(crate) struct Scene<'a> {
    /// The camera of all maps, which are of a part of its picture.
    pub(crate) camera: &'a Camera,
    /// That part.
    pub(crate) part: LitPart,
    /// The color field.
    pub(crate) field: &'a ColorField,
    /// The white (flash) image.
    pub(crate) white: Cow<'a, Image>,
    /// The color field as a spline.
    pub(crate) grid: Cow<'a, Grid>,
    /// The ray of every pixel, and the part of it that was calibrated.
    pub(crate) rays: CameraRays,
    /// Blur of its pixels, where that is known.
    pub(crate) blur: Option<Blur>,
    /// Normalized intensities, their variances, and the status of every pixel so far.
    pub(crate) measurements: Measurements,
}

impl<'a> Scene<'a> {
    /// Normalizes a capture, which with its camera is a part of a picture. `model_sigma` is the standard deviation of
    /// the color field itself, normalized intensity; only pixels whose status is `ranged` get the calibrated part of
    /// their ray.
    pub(crate) fn measure(
        capture: Cow<'a, Capture>,
        camera: &'a Camera,
        part: LitPart,
        field: &'a ColorField,
        model_sigma: f32,
        ranged: fn(PixelStatus) -> bool,
        cx: &mut Context<'_>,
    ) -> Result<Self, Failure> {
        let metadata = &field.metadata;
        let mut measurements = cx.progress.measure("normalize", || {
            let m = Measurements::new(&capture, part.image, &metadata.noise, &metadata.dark, model_sigma);
            let demand = demand::normalization(m.n(), m.k, capture.white.channels);
            (m, demand)
        });
        let lit = |i: usize| ranged(measurements.status[i]);
        let (grid, rays) = (field.to_grid(), CameraRays::of_lit(camera, field, 1, part.origin, lit));
        let axes = &field.validity.axes;
        if !axes.is_empty() {
            let known = |i: usize, j: usize| rays.known[i].is_none() || rays.known[i].has(axes[j]);
            measurements.keep_channels(known);
        }
        cx.stop_if_cancelled()?;
        let white = white_of(capture);
        let blur = metadata.blur;
        Ok(Self { camera, part, field, white, grid, rays, blur, measurements })
    }

    /// Returns the color field as the inner loops evaluate it.
    pub(crate) fn spline(&self) -> SplineEvaluator<'_> {
        SplineEvaluator::new(&self.grid, self.field.metadata.cells_per_pixel)
    }

    /// Returns white − black of the board per channel, for images of three channels; `None` where the field does not
    /// know it.
    pub(crate) fn board_white(&self) -> Option<[f32; 3]> {
        let light: Vec<f32> = self.field.metadata.dark.iter().map(|d| d.light).collect();
        let m = &self.measurements;
        let known = m.light.len() == 3 * m.n() && light.len() == 3 && light.iter().all(|v| *v > 0.0);
        known.then(|| [light[0], light[1], light[2]])
    }
}
