use nelu3d_scan::Image;
use nelu3d_scan::image::gaussian_blur;

#[test]
fn a_point_becomes_a_gaussian_and_a_constant_stays() {
    let mut point = Image::new(21, 21, 1);
    point.data[10 * 21 + 10] = 1.0;
    let blurred = gaussian_blur(&point, 1.5);
    assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    let variance = (0..441).map(|i| blurred.data[i] * ((i % 21) as f32 - 10.0).powi(2)).sum::<f32>();
    // Cut off at three standard deviations, the kernel is a little narrower.
    assert!((variance - 2.25).abs() < 0.1, "{variance}");
    let constant = Image { data: vec![0.4; 441], ..point };
    assert!(gaussian_blur(&constant, 3.0).data.iter().all(|v| (v - 0.4).abs() < 1e-6));
    assert_eq!(gaussian_blur(&constant, 0.0), constant);
}
