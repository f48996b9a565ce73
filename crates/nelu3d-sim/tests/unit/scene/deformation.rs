use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use nelu3d_sim::scene::Deformation;
use nelu3d_sim::spec::{AxisSpec, DeformationSpec};

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
    let wave = DeformationSpec::Wave { amplitude_mm: 2.0, wavelength_mm: 40.0, phase: 0.0, direction: [0.0, 3.0, 0.0] };
    let p = Deformation(wave).map(&Point3::new(5.0, 10.0, 1.0));
    assert!((p - Point3::new(5.0, 10.0, 3.0)).norm() < 1e-12);
    let slope = Deformation(wave).normal(&Point3::origin(), &Vector3::z());
    assert!((slope.y / slope.z + 2.0 * TAU / 40.0).abs() < 1e-6);
    let twist = Deformation(DeformationSpec::Twist { rate_per_mm: TAU / 400.0, axis: AxisSpec::Y });
    let p = twist.map(&Point3::new(5.0, 100.0, 1.0));
    // About y a quarter turn takes z to x and x to −z.
    assert!((p - Point3::new(1.0, 100.0, -5.0)).norm() < 1e-9, "{p}");
}
