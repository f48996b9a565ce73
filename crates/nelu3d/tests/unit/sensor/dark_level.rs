use nelu3d::sensor::DarkEstimator;
use nelu3d_scan::Image;

#[test]
fn tells_offset_from_ambient_light() {
    let mut white = Image::new(64, 64, 1);
    let mut black = white.clone();
    for i in 0..white.data.len() {
        white.data[i] = if i % 3 == 0 { 0.1 } else { 0.6 } + (i % 7) as f32 * 0.01;
        black.data[i] = 0.01 + 0.05 * white.data[i];
    }
    let mut e = DarkEstimator::default();
    e.add(&white, &black, 0.02);
    let d = e.finish()[0];
    assert!((d.offset - 0.01).abs() < 1e-4 && (d.ambient - 0.05).abs() < 1e-3, "{d:?}");
    let light = white.data.iter().zip(&black.data).map(|(w, b)| w - b).sum::<f32>() / white.data.len() as f32;
    assert!((d.light - light).abs() < 1e-4, "{d:?}");
}
