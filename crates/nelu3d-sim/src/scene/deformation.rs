//! Smooth maps of an object's frame.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Vector3};

use crate::spec::{AxisSpec, DeformationSpec};

/// A smooth map of the object's frame; see [`DeformationSpec`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Deformation(pub(crate) DeformationSpec);

/// Step of the derivatives that turn normals, mm; the maps are smooth over far more.
const STEP_MM: f64 = 1e-3;

impl Deformation {
    /// Returns where a point goes.
    pub(crate) fn map(&self, p: &Point3<f64>) -> Point3<f64> {
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

    /// Returns the normal of the deformed surface at the image of `p`: the cofactors of the map's derivative, applied
    /// to the normal.
    pub(crate) fn normal(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_sheet_lies_on_a_cylinder_and_keeps_its_lengths() {
        for (k, axis) in [(0.02, AxisSpec::Y), (-0.02, AxisSpec::X)] {
            let bend = Deformation(DeformationSpec::Bend { curvature_per_mm: k, axis });
            let at = |s: f64, z: f64| if axis == AxisSpec::Y { Point3::new(s, 7.0, z) } else { Point3::new(7.0, s, z) };
            for s in [-60.0, -1.0, 0.0, 20.0, 70.0] {
                for z in [0.0, 4.0] {
                    let p = bend.map(&at(s, z));
                    let across = if axis == AxisSpec::Y { p.x } else { p.y };
                    let radius = across.hypot(p.z - 1.0 / k);
                    assert!((radius - (1.0 / k - z).abs()).abs() < 1e-9, "{p}");
                    let n = bend.normal(&at(s, z), &Vector3::new(0.0, 0.0, -1.0));
                    let outward = if axis == AxisSpec::Y {
                        Vector3::new(p.x, 0.0, p.z - 1.0 / k)
                    } else {
                        Vector3::new(0.0, p.y, p.z - 1.0 / k)
                    };
                    assert!((n - outward.normalize() * k.signum()).norm() < 1e-6, "{n} {outward}");
                }
                let length = (bend.map(&at(s + 1e-4, 0.0)) - bend.map(&at(s, 0.0))).norm();
                assert!((length - 1e-4).abs() < 1e-10);
            }
        }
        let flat = Deformation(DeformationSpec::Bend { curvature_per_mm: 0.0, axis: AxisSpec::Y });
        assert_eq!(flat.map(&Point3::new(3.0, 4.0, 5.0)), Point3::new(3.0, 4.0, 5.0));
    }

    #[test]
    fn a_wave_lifts_and_a_twist_turns() {
        let wave =
            DeformationSpec::Wave { amplitude_mm: 2.0, wavelength_mm: 40.0, phase: 0.0, direction: [0.0, 3.0, 0.0] };
        let p = Deformation(wave).map(&Point3::new(5.0, 10.0, 1.0));
        assert!((p - Point3::new(5.0, 10.0, 3.0)).norm() < 1e-12);
        let slope = Deformation(wave).normal(&Point3::origin(), &Vector3::z());
        assert!((slope.y / slope.z + 2.0 * TAU / 40.0).abs() < 1e-6);
        let twist = Deformation(DeformationSpec::Twist { rate_per_mm: TAU / 400.0, axis: AxisSpec::Y });
        let p = twist.map(&Point3::new(5.0, 100.0, 1.0));
        // About y a quarter turn takes z to x and x to −z.
        assert!((p - Point3::new(1.0, 100.0, -5.0)).norm() < 1e-9, "{p}");
    }
}
