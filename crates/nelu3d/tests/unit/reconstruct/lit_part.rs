use std::borrow::Cow;

use nelu3d::reconstruct::LitPart;
use nelu3d::sensor::NoiseModel;
use nelu3d_scan::rig::Capture;
use nelu3d_scan::{Camera, Image};

const NOISE: NoiseModel = NoiseModel { read: 1e-6, gain: 1e-5, darkest: None };

/// A square of light of 40 × 20 px at (100, 60), and a hot pixel far from it.
fn capture() -> Capture {
    let mut white = Image::new(320, 240, 1);
    for (x, y) in (60..80).flat_map(|y| (100..140).map(move |x| (x, y))) {
        white.data[y * 320 + x] = 0.5;
    }
    white.data[200 * 320 + 300] = 0.9;
    let black = Image::new(320, 240, 1);
    Capture { patterns: vec![white.clone(); 3], white, black: Some(black), mono: vec![false; 3] }
}

#[test]
fn what_is_lit_is_cut_out_and_put_back() {
    let capture = capture();
    let part = LitPart::of(&capture, &NOISE, &[]);
    // Whole squares of pixels, and a margin.
    assert_eq!((part.origin, part.size, part.image), ([80, 32], [80, 64], [320, 240]));
    let (cut, white) = part.of_capture(Cow::Borrowed(&capture));
    assert_eq!(white.as_deref(), Some(&capture.white));
    assert_eq!([cut.white.width, cut.white.height], part.size);
    assert_eq!(cut.white.data.iter().filter(|v| **v > 0.0).count(), 800);
    let back = part.paste(cut.white.data.clone(), 0.0);
    let differ = back.iter().zip(&capture.white.data).filter(|(a, b)| a != b).count();
    assert_eq!(differ, 1, "but for the hot pixel");

    // A point is seen at the same place.
    let camera = Camera::pinhole(320, 240, 300.0, 310.0, 160.0, 118.0);
    let at = nalgebra::Point3::new(-0.1, -0.15, 1.0);
    let (whole, of_part) = (camera.project(&at).unwrap(), part.camera(&camera).project(&at).unwrap());
    assert!((whole[0] - of_part[0] - 80.0).abs() < 1e-9 && (whole[1] - of_part[1] - 32.0).abs() < 1e-9);
}

#[test]
fn nothing_is_cut_where_all_or_nothing_is_lit() {
    let mut capture = capture();
    capture.white.data.fill(0.0);
    assert!(LitPart::of(&capture, &NOISE, &[]).is_whole());
    capture.white.data.fill(0.6);
    assert!(LitPart::of(&capture, &NOISE, &[]).is_whole());
}
