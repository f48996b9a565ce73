mod handheld;
mod hands;

use nalgebra::Point3;
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{DepthSpacing, SweepSpec};
use nelu3d_sim::sweep::sweep_poses;

#[test]
fn a_stage_moves_the_middle_of_the_board_on_its_line() {
    let mut spec = Spec::preset("color").unwrap();
    if let SweepSpec::Stage { step_error_mm, .. } = &mut spec.sweep {
        *step_error_mm = 0.0;
    }
    let poses = sweep_poses(&spec);
    assert_eq!(poses.len(), 24);
    let SweepSpec::Stage { first_mm, last_mm, slope, .. } = spec.sweep else { panic!("a stage") };
    for (i, pose) in poses.iter().enumerate() {
        let p = pose.cam_from_board * Point3::new(108.0, 84.0, 0.0);
        let z = first_mm + (last_mm - first_mm) * i as f64 / 23.0;
        let along = z - 0.5 * (first_mm + last_mm);
        let expected = Point3::new(slope[0] * along, slope[1] * along, z);
        assert!((p - expected).norm() < 1e-9, "{p}");
    }
    assert_eq!((poses[0].position.as_str(), poses[23].position.as_str()), ("000", "023"));
}

#[test]
fn a_stage_wobbles_about_the_middle_of_the_board_as_declared() {
    let mut spec = Spec::preset("color").unwrap();
    let straight = {
        let SweepSpec::Stage { positions, step_error_mm, .. } = &mut spec.sweep else { panic!("a stage") };
        (*positions, *step_error_mm) = (300, 0.0);
        sweep_poses(&spec)
    };
    let SweepSpec::Stage { tilt_jitter, .. } = &mut spec.sweep else { panic!("a stage") };
    *tilt_jitter = 0.01;
    let mut square = 0.0;
    for (a, b) in straight.iter().zip(sweep_poses(&spec)) {
        let middle = Point3::new(108.0, 84.0, 0.0);
        assert!((a.cam_from_board * middle - b.cam_from_board * middle).norm() < 1e-9);
        let wobble = b.cam_from_board.rotation * a.cam_from_board.rotation.inverse();
        square += wobble.scaled_axis().norm_squared() / 900.0;
    }
    // Four standard errors of a standard deviation from 900 numbers.
    assert!((square.sqrt() / 0.01 - 1.0).abs() < 4.0 / 1800f64.sqrt(), "{}", square.sqrt());
}

#[test]
fn hands_shake_as_declared() {
    let spec = Spec {
        sweep: SweepSpec::Handheld {
            positions: 400,
            first_mm: 600.0,
            last_mm: 800.0,
            center_mm: [3.0, 4.0],
            position_sigma_mm: 5.0,
            tilt_sigma: 0.1,
            depths: DepthSpacing::Even,
            max_tilt: None,
            min_in_view: 0.0,
            hands: None,
            write_poses: true,
        },
        ..Spec::preset("demo").unwrap()
    };
    spec.check().unwrap();
    let poses = sweep_poses(&spec);
    let (mut x, mut tilt) = (0.0, 0.0);
    for p in &poses {
        let middle = p.cam_from_board * Point3::origin();
        x += (middle.x - 3.0).powi(2) / 400.0;
        tilt += p.cam_from_board.rotation.scaled_axis().norm_squared() / 3.0 / 400.0;
    }
    assert!((x.sqrt() - 5.0).abs() < 0.9 && (tilt.sqrt() - 0.1).abs() < 0.015, "{} {}", x.sqrt(), tilt.sqrt());
}
