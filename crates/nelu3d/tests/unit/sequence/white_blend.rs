use nelu3d::sequence::white_blend::blend_white;
use nelu3d_scan::Image;

#[test]
fn the_mean_is_weighted_and_what_is_clipped_stays_clipped() {
    let image = |data: [f32; 2]| Image { width: 2, height: 1, channels: 1, data: data.to_vec() };
    assert_eq!(blend_white(&image([0.2, 1.0]), &image([0.4, 0.1]), 0.25).data, [0.25, 1.0]);
}
