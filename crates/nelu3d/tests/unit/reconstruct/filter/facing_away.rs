use nelu3d::reconstruct::filter::facing_away::reject_facing_away;
use nelu3d::surface::{PixelStatus, image_plane};
use nelu3d_scan::Camera;

/// The part of a plane through (0, 0, 700) mm that is left of it, where its depth is 700 + x slope_x + y slope_y.
fn left(slope_x: f32, slope_y: f32, light: [f32; 3]) -> f32 {
    let (w, h) = (60, 40);
    let camera = Camera::pinhole(w, h, 1500.0, 1500.0, 29.5, 19.5);
    let plane = image_plane(&camera);
    let mut depth: Vec<f32> = plane.iter().map(|[u, v]| 700.0 / (1.0 - slope_x * u - slope_y * v)).collect();
    // Beside the object, and one pixel in it that has no depth.
    (0..w * h).filter(|i| i % w < 4 || *i == 20 * w + 30).for_each(|i| depth[i] = f32::NAN);
    let before = depth.iter().filter(|z| z.is_finite()).count();
    let mut status = vec![PixelStatus::Valid; w * h];
    reject_facing_away(&mut depth, &mut status, &camera, &plane, light.into());
    let after = depth.iter().filter(|z| z.is_finite()).count();
    assert_eq!(status.iter().filter(|s| **s == PixelStatus::Ambiguous).count(), before - after);
    after as f32 / before as f32
}

/// Light from 16° to the right meets a surface that falls away to the right until that is steeper than 16° from the
/// line of sight, and one that falls away to the left whatever its slope.
#[test]
fn what_light_cannot_meet_is_no_surface() {
    let light = [200.0, 0.0, 0.0];
    assert_eq!([0.0, 1.0, 5.0, -2.0].map(|slope| left(slope, 0.0, light)), [1.0; 4]);
    // Isolated pixels have no normal.
    assert!(left(-6.0, 0.0, light) < 0.02);
    // It is the light that counts, not a side of the picture.
    assert!(left(6.0, 0.0, [-200.0, 0.0, 0.0]) < 0.02 && left(-6.0, 0.0, [-200.0, 0.0, 0.0]) == 1.0);
    assert_eq!(left(-6.0, 0.0, [0.0; 3]), 1.0);
    // Tilted across the epipolar planes as well: a light that stands higher might meet it.
    assert_eq!(left(-4.0, 4.0, light), 1.0);
}
