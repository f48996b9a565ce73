//! A color field, continued along the rays of light before and behind what was calibrated.
//!
//! Light travels in straight lines: what a ray of light carries in the calibrated volume it carries before and behind
//! it, but for defocus, which nobody has measured there. That is not enough to measure a surface by, but enough to tell
//! that there is one.

use nelu3d_scan::Camera;

use super::field::{ColorField, Form};
use super::frame::{Center, FieldFrame};
use super::grid::Grid;
use super::validity::{Validity, ValidityShape};

/// The axis along the light.
const ALONG: usize = 2;
/// Cells along the light: defocus changes slowly.
const CELLS: usize = 4;
/// Distance from the light down to which the field is continued, as a part of that of its box.
const NEAREST: f64 = 0.4;
/// Coordinate along the light up to which it is continued, as a part of that of infinity.
const FARTHEST: f64 = 0.999;

impl ColorField {
    /// Returns the field, of which `grid` is the spline, continued to all that `camera` sees at distances from `near`
    /// to `far`, mm along its rays, with the codewords that it has at the ends of its box: a column of cells is lit
    /// there if it is lit anywhere. `None` where the field is not centered on the light.
    pub fn continued(&self, grid: &Grid, camera: &Camera, [near, far]: [f32; 2]) -> Option<Self> {
        if self.metadata.center != Center::Light {
            return None;
        }
        let frame = self.frame_around(camera, [near, far]);
        let span = |frame: &FieldFrame| frame.hi[ALONG] - frame.lo[ALONG];
        let own_unit = |unit: f64| (frame.lo[ALONG] + unit * span(&frame) - self.frame.lo[ALONG]) / span(&self.frame);
        let form = Form::Grid(grid.along_w(CELLS, own_unit));
        let Validity { shape, t_range, lit, .. } = &self.validity;
        let [ca, cb, cw] = shape.cells;
        let validity = Validity {
            shape: ValidityShape { cells: [ca, cb, 1], ..*shape },
            t_range: vec![[near, far]; t_range.len()],
            lit: lit.chunks_exact(cw).map(|column| u8::from(column.contains(&1))).collect(),
            positions: Vec::new(),
            axes: Vec::new(),
        };
        Some(Self { frame, form, validity, metadata: self.metadata.clone() })
    }

    /// Returns the field's frame, with a box that along the light holds what a camera sees at these distances.
    fn frame_around(&self, camera: &Camera, distances: [f32; 2]) -> FieldFrame {
        let mut frame = self.frame;
        let places = [0.0, 0.5, 1.0];
        for [x, y] in places.into_iter().flat_map(|y| places.map(|x| [x, y])) {
            let ray = camera.ray([x * camera.width as f64, y * camera.height as f64]);
            // Behind the light there is none.
            for p in distances.into_iter().filter_map(|t| self.frame.to_abw(&ray.at(f64::from(t)))) {
                frame.lo[ALONG] = frame.lo[ALONG].min(p[ALONG]);
                frame.hi[ALONG] = frame.hi[ALONG].max(p[ALONG]);
            }
        }
        let kappa = frame.kappa;
        if kappa > 0.0 {
            // At s times the origin's distance from the light, w = (1 − 1/s)/κ.
            let inverse = (1.0 - kappa * self.frame.lo[ALONG]) / NEAREST;
            frame.lo[ALONG] = frame.lo[ALONG].max((1.0 - inverse) / kappa);
            frame.hi[ALONG] = frame.hi[ALONG].min((FARTHEST / kappa).max(self.frame.hi[ALONG]));
        }
        frame
    }
}
