use nelu3d_scan::Image;
use nelu3d_scan::rig::{luma, spread_mono};

fn image(channels: usize, data: &[f32]) -> Image {
    Image { width: data.len() / channels, height: 1, channels, data: data.to_vec() }
}

/// Pixels of any color return the share of light that fell on them, over ambient light of any color.
#[test]
fn every_channel_has_the_ratio_to_the_flash() {
    let black = image(3, &[0.02, 0.05, 0.01, 0.0, 0.0, 0.03]);
    let white = image(3, &[0.9, 0.3, 0.1, 0.2, 0.4, 0.8]);
    for share in [0.0, 0.3, 1.0] {
        let lit = |i: usize| black.data[i] + share * (white.data[i] - black.data[i]);
        let color = image(3, &(0..6).map(lit).collect::<Vec<_>>());
        let found = spread_mono(&luma(&color), &white, Some(&black));
        assert!(found.data.iter().zip(&color.data).all(|(a, b)| (a - b).abs() < 1e-6), "{share}: {found:?}");
    }
}

#[test]
fn clipped_pixels_are_clipped_in_all_channels() {
    let white = image(3, &[0.5, 0.5, 0.5, 0.9, 1.0, 0.2, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0]);
    let found = spread_mono(&image(1, &[1.0, 0.3, 0.6, 0.1]), &white, None);
    let clipped: Vec<bool> = found.data.iter().map(|v| *v >= 1.0).collect();
    let expected: Vec<bool> = [true, true, false, false].iter().flat_map(|c| [*c; 3]).collect();
    // More than the flash is not clipped, and neither is what has no light.
    assert_eq!(clipped, expected, "{found:?}");
}
