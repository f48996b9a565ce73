use nelu3d::from_projector::inputs::reduced;
use nelu3d_scan::Image;

#[test]
fn patterns_along_one_axis_are_reduced_and_others_are_not() {
    let make = |f: fn(usize, usize) -> f32| Image {
        width: 6,
        height: 4,
        channels: 1,
        data: (0..24).map(|i| f(i % 6, i / 6)).collect(),
    };
    let (across, down, both) = (make(|x, _| x as f32), make(|_, y| y as f32), make(|x, y| (x * y) as f32));
    assert_eq!(reduced(across).data, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(reduced(down).data, [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(reduced(both.clone()), both);
}
