//! A field corrected for a motion of the light.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Camera;

use crate::color_field::frame::FieldFrame;
use crate::color_field::{ColorField, LightMotion};

/// Part of the calibrated distances by which a corrected volume may reach beyond them.
const BEYOND: f64 = 0.02;

/// Returns a field whose light made a motion: the same codewords in a frame that moved, and what the rays of `camera`
/// meet of it. Its metadata say so.
pub fn correct(field: &ColorField, motion: &LightMotion, camera: &Camera) -> ColorField {
    let (mut out, moved) = (field.clone(), motion.isometry());
    out.frame = FieldFrame {
        origin: (moved * Point3::from(field.frame.origin)).coords.into(),
        axes: field.frame.axes.map(|e| (moved * Vector3::from(e)).into()),
        ..field.frame
    };
    let lit = field.validity.t_range.iter().filter(|r| r[0] < r[1]);
    let (near, far) =
        lit.fold((f64::INFINITY, 0.0f64), |(near, far), r| (near.min(f64::from(r[0])), far.max(f64::from(r[1]))));
    let frame = out.frame;
    let ray = |px: [f64; 2]| {
        let ray = frame.along_ray(&camera.ray(px).dir);
        move |t: f64| ray.at(t).q
    };
    out.validity.find_ranges([(1.0 - BEYOND) * near, (1.0 + BEYOND) * far], ray);
    out.metadata.corrected.push(*motion);
    out
}
