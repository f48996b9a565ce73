//! The volume in which the light of a calibrated projector and the view of the camera overlap.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Camera, Projector};

use crate::color_field::frame::FieldFrame;
use crate::color_field::validity::Validity;

/// Side of a tile of the validity volume, px.
const TILE_PX: usize = 8;
/// Cells of the validity volume along a, b and w.
const VALIDITY_CELLS: [usize; 3] = [96, 96, 4];
/// Depth that is assumed where the optical axes never come close, mm.
const DEFAULT_DEPTH_MM: f64 = 1000.0;

/// Returns the depth, mm, where the middle of the projected image comes closest to the middle of the view; 1000 where
/// they do not meet before the camera.
pub fn crossing_depth(camera: &Camera, projector: &Projector) -> f64 {
    let center = projector.center();
    let o = &projector.optics;
    let [x, y] = o.undistort([o.width as f64 / 2.0, o.height as f64 / 2.0]);
    let light = projector.proj_from_cam.rotation.inverse() * Vector3::new(x, y, 1.0).normalize();
    let view = camera.ray([camera.width as f64 / 2.0, camera.height as f64 / 2.0]).dir;
    let (b, c) = (view.dot(&light), center.coords);
    let denominator = 1.0 - b * b;
    let t = if denominator > 1e-6 { (c.dot(&view) - b * c.dot(&light)) / denominator } else { DEFAULT_DEPTH_MM };
    if t > 0.0 { t * view.z } else { DEFAULT_DEPTH_MM }
}

/// Where light and view overlap between two depths.
#[derive(Clone)]
pub(super) struct Volume {
    pub(super) frame: FieldFrame,
    pub(super) validity: Validity,
}

impl Volume {
    /// Finds it between two depths, mm, if there is any.
    pub(super) fn new(camera: &Camera, projector: &Projector, depth_mm: [f64; 2]) -> Option<Self> {
        let frame = overlap_frame(camera, projector, depth_mm)?;
        let validity = lit_volume(camera, projector, &frame, depth_mm);
        Some(Self { frame, validity })
    }
}

/// Returns a frame centered on the projector over what camera and projector both reach between two depths, mm; `None`
/// when that is nothing.
fn overlap_frame(camera: &Camera, projector: &Projector, [near, far]: [f64; 2]) -> Option<FieldFrame> {
    let mut reached = Vec::new();
    for y in (0..=camera.height).step_by((camera.height / 24).max(1)) {
        for x in (0..=camera.width).step_by((camera.width / 24).max(1)) {
            let dir = camera.ray([x as f64, y as f64]).dir;
            for i in 0..=24 {
                let z = near * (far / near).powf(f64::from(i) / 24.0);
                let p = Point3::from(dir * (z / dir.z));
                if is_lit(projector, &p) {
                    reached.push(p);
                }
            }
        }
    }
    if reached.len() < 8 {
        return None;
    }
    let mean = reached.iter().map(|p| p.coords).sum::<Vector3<f64>>() / reached.len() as f64;
    let right = projector.proj_from_cam.rotation.inverse() * Vector3::x();
    let mut frame = FieldFrame::around(projector.center(), Point3::from(mean), right);
    reached.iter().for_each(|p| frame.enclose(p));
    for i in 0..3 {
        let margin = 0.03 * (frame.hi[i] - frame.lo[i]);
        frame.lo[i] -= margin;
        frame.hi[i] += margin;
    }
    Some(frame)
}

/// Returns the validity volume of a field from a projector: every pixel between two depths, mm, and every cell that the
/// projector lights.
fn lit_volume(camera: &Camera, projector: &Projector, frame: &FieldFrame, [near, far]: [f64; 2]) -> Validity {
    let mut v = Validity::new(camera.width, camera.height, TILE_PX, VALIDITY_CELLS);
    let [ca, cb, cw] = v.shape.cells;
    for b in 0..cb {
        for a in 0..ca {
            for w in 0..cw {
                let q = [(a as f64 + 0.5) / ca as f64, (b as f64 + 0.5) / cb as f64, (w as f64 + 0.5) / cw as f64];
                v.lit[(b * ca + a) * cw + w] = is_lit(projector, &frame.from_unit(q)) as u8;
            }
        }
    }
    let tiles = v.shape.tiles;
    for ty in 0..tiles[1] {
        for tx in 0..tiles[0] {
            let middle = [tx, ty].map(|t| (t * TILE_PX) as f64 + 0.5 * (TILE_PX - 1) as f64);
            let dir = camera.ray(middle).dir;
            v.t_range[ty * tiles[0] + tx] = [(near / dir.z) as f32, (far / dir.z) as f32];
        }
    }
    v
}

/// Returns whether a point lies in the projector's image.
fn is_lit(projector: &Projector, p: &Point3<f64>) -> bool {
    let (w, h) = (projector.optics.width as f64, projector.optics.height as f64);
    projector.project(p).is_some_and(|[x, y]| x >= 0.0 && y >= 0.0 && x <= w - 1.0 && y <= h - 1.0)
}
