use std::time::Duration;

use nelu3d::reconstruct::{Observer, Stage};
use nelu3d_evaluate::{GroundTruth, Trace};
use nelu3d_scan::Camera;

#[test]
fn records_errors_in_order_without_its_own_time() {
    let (width, height) = (300, 200);
    let camera = Camera::pinhole(width, height, 400.0, 400.0, 150.0, 100.0);
    let truth = GroundTruth { width, height, depth: vec![500.0; width * height], mask: vec![true; width * height] };
    let mut trace = Trace::new(&truth, &camera);
    let begun = trace.wall;
    for (iteration, error) in [4.0, 2.0, 1.0].into_iter().enumerate() {
        let depth = vec![500.0 + error; width * height];
        for _ in 0..30 {
            trace.surface(Stage::Refine, iteration + 1, &depth);
        }
    }
    let (elapsed, own) = (begun.elapsed(), trace.own_wall);
    assert!(own > Duration::ZERO);
    let points = trace.points();
    assert_eq!(points.len(), 90);
    assert_eq!(points[0].mae, 4.0);
    let last = &points[89];
    assert_eq!((last.iteration, last.mae, last.rmse, last.bias), (3, 1.0, 1.0, 1.0));
    assert_eq!((last.coverage, last.body_median), (1.0, 1.0));
    // Other tests of this process run meanwhile, so only their time may be counted.
    assert!(points.windows(2).all(|p| p[0].cpu_secs <= p[1].cpu_secs + 1e-9));
    // However long this machine kept us waiting: what was spent here is in no point's time.
    let (latest, own) = (elapsed.as_secs_f64(), own.as_secs_f64());
    assert!(last.wall_secs <= latest - own + own / 30.0, "{} of {latest} less {own}", last.wall_secs);
}
