use nalgebra::Point3;
use nelu3d::calibrate::light::center::Chart;

#[test]
fn states_and_centers_are_one_to_one() {
    let chart = Chart::new(Point3::new(30.0, -20.0, 700.0));
    for at in [Point3::new(190.0, -25.0, 20.0), Point3::new(-5.0, 630.0, -2.0), Point3::new(0.0, 0.0, 300.0)] {
        let again = chart.center(chart.state(&at).unwrap()).position().unwrap();
        assert!((again - at).norm() < 1e-9 * chart.scale, "{at} {again}");
    }
    // Beside the volume, and behind it.
    for at in [Point3::new(30.0 + 700.0, 470.0, 700.0), Point3::new(60.0, -40.0, 1400.0)] {
        assert!(chart.state(&at).is_none(), "{at}");
    }
}
