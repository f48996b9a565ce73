use nalgebra::Point3;
use nelu3d::calibrate::light::transport::{Seed, partner};

#[test]
fn partners_are_others_within_the_arm() {
    for n in 2..9 {
        for arm in 1..n {
            for view in 0..n {
                for index in 0..50 {
                    let p = partner(&Seed { view, index, point: Point3::origin(), jacobian: None }, arm, n);
                    assert!(p < n && p != view, "{n} {arm} {view}: {p}");
                }
            }
        }
    }
}
