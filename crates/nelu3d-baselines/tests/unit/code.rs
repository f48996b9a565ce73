use std::path::Path;

use nelu3d_baselines::DecodeError;
use nelu3d_baselines::code::{Line, ProjectedLight, lines, value_at};
use nelu3d_scan::Image;
use nelu3d_scan::pattern::Axis;

fn read(image: Image) -> Result<(Option<Axis>, Vec<Line>), DecodeError> {
    lines(image, Path::new("p.png"), 0, &ProjectedLight::Power(1.0))
}

#[test]
fn the_axis_is_found_and_two_axes_are_refused() {
    let image = |f: fn(usize, usize) -> f32| Image {
        width: 8,
        height: 5,
        channels: 1,
        data: (0..40).map(|i| f(i % 8, i / 8)).collect(),
    };
    let (axis, found) = read(image(|x, _| x as f32 / 8.0)).unwrap();
    assert_eq!((axis, found[0].values.len(), found[0].values[4]), (Some(Axis::X), 8, 0.5));
    let (axis, found) = read(image(|_, y| y as f32 / 5.0)).unwrap();
    assert_eq!((axis, found[0].values.len()), (Some(Axis::Y), 5));
    assert_eq!(read(image(|_, _| 0.3)).unwrap().0, None);
    let error = read(image(|x, y| (x + y) as f32 / 20.0)).unwrap_err().to_string();
    assert!(error.contains("p.png") && error.contains("along x and along y"), "{error}");
}

#[test]
fn values_between_columns_are_linear() {
    let v = [0.0, 1.0, 0.5];
    assert_eq!([-1.0, 0.0, 0.5, 1.0, 1.5, 2.0, 7.0].map(|u| value_at(&v, u)), [0.0, 0.0, 0.5, 1.0, 0.75, 0.5, 0.5]);
    assert_eq!(value_at(&[0.3], 0.7), 0.3);
}
