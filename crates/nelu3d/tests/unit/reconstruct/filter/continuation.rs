use nelu3d::reconstruct::filter::continuation::{Outline, behind_step, pixels_between};
use nelu3d::surface::PixelStatus;
use nelu3d_scan::Camera;

#[test]
fn what_the_surface_before_a_step_explains_is_its_continuation() {
    let outline = |found, continued, neighbor, inside| Outline {
        places: 20,
        found,
        continued,
        neighbor,
        inside,
        is_speck: false,
    };
    // A wrong period: the continued surface explains the codewords, within the volume or just outside it.
    assert_eq!(outline(60.0, 20.0, 20.0, 20).rejection(), Some(PixelStatus::Ambiguous));
    assert_eq!(outline(60.0, 20.0, 20.0, 0).rejection(), Some(PixelStatus::OutsideVolume));
    // A true step.
    assert_eq!(outline(20.0, 180.0, 20.0, 20).rejection(), None);
    assert_eq!(outline(60.0, 70.0, 20.0, 20).rejection(), None);
    // Where the surface leaves the volume at the step, nothing is known of its continuation.
    assert_eq!(outline(60.0, 150.0, 20.0, 2).rejection(), Some(PixelStatus::OutsideVolume));
    assert_eq!(outline(25.0, 150.0, 20.0, 2).rejection(), None);
    // Too short to tell.
    assert_eq!(Outline { places: 15, ..outline(60.0, 20.0, 20.0, 15) }.rejection(), None);
    // A speck goes where what is all around it explains it about as well, a field that is off there included, and stays
    // where that is far off.
    let speck = |continued| Outline { is_speck: true, ..outline(20.0, continued, 20.0, 20) }.rejection();
    assert_eq!(speck(38.0), Some(PixelStatus::Ambiguous));
    assert_eq!(speck(60.0), None);
}

#[test]
fn a_step_has_a_surface_behind_it() {
    // Two components with a gap of `gap` pixels in a row of 40.
    let camera = Camera::pinhole(40, 1, 500.0, 500.0, 20.0, 0.0);
    let row = |gap: usize| -> Vec<u32> {
        let id = |x: usize| {
            if x < 15 {
                0
            } else if x < 15 + gap {
                u32::MAX
            } else {
                1
            }
        };
        (0..40).map(id).collect()
    };
    let behind = |gap, i, toward, sizes: [u32; 2]| behind_step(i, &row(gap), &sizes, 10, &camera, toward);
    assert_eq!(behind(0, 14, [1, 0], [15, 25]), Some([17, 25]));
    assert_eq!(behind(3, 14, [1, 0], [15, 22]), Some([20, 28]));
    assert_eq!(behind(0, 15, [-1, 0], [15, 25]), Some([12, 4]));
    // Too wide a gap, a pixel within its component, too small a neighbor, and the image's end.
    assert_eq!(behind(4, 14, [1, 0], [15, 21]), None);
    assert_eq!(behind(0, 10, [1, 0], [15, 25]), None);
    assert_eq!(behind(0, 14, [1, 0], [15, 9]), None);
    assert_eq!(behind(0, 14, [0, 1], [15, 25]), None);
    assert_eq!(pixels_between(12, 17, &camera), 5);
}
