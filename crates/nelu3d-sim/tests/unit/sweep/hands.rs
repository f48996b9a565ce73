use nalgebra::{UnitQuaternion, Vector3};
use nelu3d_sim::sweep::hands::on_outline;

#[test]
fn a_thumb_points_inward_from_every_side() {
    let extent = [-10.0, 0.0, 90.0, 60.0];
    let inside = |p: [f64; 2]| p[0] >= -10.0 && p[0] <= 90.0 && p[1] >= 0.0 && p[1] <= 60.0;
    for i in 0..64 {
        let (at, angle) = on_outline(extent, f64::from(i) / 64.0 + 0.003);
        let inward = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle) * Vector3::y();
        let step = |s: f64| [at[0] + s * inward.x, at[1] + s * inward.y];
        assert!(inside(step(1.0)) && !inside(step(-1.0)), "{at:?} {angle}");
    }
}
