use nelu3d_sim::Spec;
use nelu3d_sim::render::RayGrid;

#[test]
fn rays_are_the_cameras_to_a_ten_thousandth_of_a_pixel() {
    let camera = Spec::preset("demo").unwrap().camera.optics().unwrap();
    let grid = RayGrid::new(&camera, 2);
    for (x, y) in [(-2, -2), (0, 0), (100, 17), (160, 119), (321, 241)] {
        for (fx, fy) in [(0.0, 0.0), (0.5, 0.5), (0.3, 0.9)] {
            let px = camera.project(&grid.ray(x, y, fx, fy).at(700.0)).unwrap();
            let expected = [x as f64 - 0.5 + fx, y as f64 - 0.5 + fy];
            assert!((px[0] - expected[0]).abs() < 1e-4 && (px[1] - expected[1]).abs() < 1e-4, "{px:?}");
        }
    }
}
