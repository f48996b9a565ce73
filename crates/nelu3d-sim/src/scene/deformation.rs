//! Smooth maps of an object's frame.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Vector3};

use crate::spec::{AxisSpec, DeformationSpec};

/// A smooth map of the object's frame; see [`DeformationSpec`].
#[derive(Clone, Copy, Debug)]
pub struct Deformation(pub DeformationSpec);

/// Step of the derivatives that turn normals, mm; the maps are smooth over far more.
const STEP_MM: f64 = 1e-3;

impl Deformation {
    /// Returns where a point of the frame goes, mm.
    pub fn map(&self, p: &Point3<f64>) -> Point3<f64> {
        match self.0 {
            DeformationSpec::Wave { amplitude_mm, wavelength_mm, phase, direction } => {
                let along = Vector3::from(direction).normalize().dot(&p.coords);
                p + Vector3::z() * (amplitude_mm * (TAU * along / wavelength_mm + phase).sin())
            }
            DeformationSpec::Bend { curvature_per_mm: k, axis } => {
                // sin(k x) / k and (1 − cos(k x)) / k go over into x and 0 with the curvature.
                let arc = |x: f64| (x * sinc(k * x), 0.5 * k * (x * sinc(0.5 * k * x)).powi(2));
                let bent = |x: f64| {
                    let (sine, versine) = arc(x);
                    (sine * (1.0 - k * p.z), versine + p.z * (1.0 - k * versine))
                };
                match axis {
                    AxisSpec::X => {
                        let (y, z) = bent(p.y);
                        Point3::new(p.x, y, z)
                    }
                    AxisSpec::Y | AxisSpec::Z => {
                        let (x, z) = bent(p.x);
                        Point3::new(x, p.y, z)
                    }
                }
            }
            DeformationSpec::Curl { height_mm, from_mm, to_mm, direction } => {
                let along = Vector3::from(direction).normalize().dot(&p.coords);
                let beyond = ((along - from_mm) / (to_mm - from_mm)).max(0.0);
                p - Vector3::z() * (height_mm * beyond * beyond)
            }
            DeformationSpec::Twist { rate_per_mm, axis } => {
                let i = axis.index();
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                let (s, c) = (rate_per_mm * p[i]).sin_cos();
                let mut q = *p;
                (q[j], q[k]) = (c * p[j] - s * p[k], s * p[j] + c * p[k]);
                q
            }
        }
    }

    /// Returns the unit normal of the deformed surface at the image of `p`: the cofactors of the map's derivative,
    /// applied to the `normal` at `p`.
    pub fn normal(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
        let [x, y, z] = [0, 1, 2].map(|i| {
            let step = Vector3::ith(i, STEP_MM);
            (self.map(&(p + step)) - self.map(&(p - step))) / (2.0 * STEP_MM)
        });
        let turned = Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)]) * normal;
        turned.try_normalize(1e-12).unwrap_or(*normal)
    }
}

/// Returns sin(x) / x.
fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-4 { 1.0 - x * x / 6.0 } else { x.sin() / x }
}
