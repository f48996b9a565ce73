//! The color field as recipe `paper` reads it along its rays.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::march::RaySamples;
use crate::color_field::published::PublishedForm;
use crate::color_field::{CameraRays, Form, SplineEvaluator};
use crate::reconstruct::scene::Scene;

/// Codewords of the frozen color field: of its spline, or of form `published` itself, as in the paper.
pub(super) enum Codewords<'a> {
    /// The spline that every stage reads.
    Spline(SplineEvaluator<'a>),
    /// The published form.
    Published(&'a PublishedForm),
}

impl<'a> Codewords<'a> {
    /// Prepares the field of a scene.
    pub(super) fn of(scene: &'a Scene<'_>) -> Self {
        match &scene.field.form {
            Form::Published(form) => Self::Published(form),
            _ => Self::Spline(scene.spline()),
        }
    }

    /// Evaluates the field at samples along rays, into `out` (`samples × k`). `pixel(r)` is the pixel of ray r.
    pub(super) fn along_rays(
        &self,
        rays: &CameraRays,
        samples: &RaySamples,
        pixel: impl Fn(usize) -> usize + Sync,
        out: &mut [f32],
    ) {
        match self {
            Self::Spline(spline) => spline_along_rays(spline, rays, samples, pixel, out),
            Self::Published(form) => {
                let mut points = Vec::with_capacity(samples.t.len());
                for (r, ray) in samples.offsets.windows(2).enumerate() {
                    let dir = direction(rays, pixel(r));
                    points.extend(samples.t[ray[0]..ray[1]].iter().map(|t| Point3::from(dir * f64::from(*t))));
                }
                form.query(&points, out);
            }
        }
    }
}

/// Returns the unit direction of a pixel's ray.
pub(super) fn direction(rays: &CameraRays, i: usize) -> Vector3<f64> {
    let [u, v] = rays.plane[i].map(f64::from);
    Vector3::new(u, v, 1.0).normalize()
}

fn spline_along_rays(
    spline: &SplineEvaluator<'_>,
    rays: &CameraRays,
    samples: &RaySamples,
    pixel: impl Fn(usize) -> usize + Sync,
    out: &mut [f32],
) {
    let k = spline.k();
    let mut by_ray: Vec<(usize, &mut [f32])> = Vec::with_capacity(samples.offsets.len());
    let mut rest = out;
    for (r, ray) in samples.offsets.windows(2).enumerate() {
        let (own, tail) = rest.split_at_mut((ray[1] - ray[0]) * k);
        by_ray.push((r, own));
        rest = tail;
    }
    by_ray.into_par_iter().for_each(|(r, colors)| {
        let in_frame = rays.in_frame(pixel(r));
        let t = &samples.t[samples.offsets[r]..samples.offsets[r + 1]];
        for (t, out) in t.iter().zip(colors.chunks_exact_mut(k)) {
            spline.eval(in_frame.at(f64::from(*t)).q, out);
        }
    });
}
