use nalgebra::Point3;
use nelu3d::from_projector::response::{Projected, Response, exponent_matters, fit_response};
use nelu3d::reconstruct::Codeword;
use nelu3d_scan::{Camera, Image, Projector};

/// Codewords measured through a known blur and response give them back.
#[test]
fn finds_blur_and_response() {
    let (w, h) = (400, 60);
    let mut data = vec![0.0f32; w * h];
    let mut state = 7u32;
    for x in 0..w {
        if x % 5 == 0 {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        }
        for y in 0..h {
            data[y * w + x] = (state >> 8) as f32 / (1 << 24) as f32;
        }
    }
    let pattern = Image { width: w, height: h, channels: 1, data };
    let projector = Projector {
        optics: Camera::pinhole(w, h, 500.0, 500.0, 200.0, 30.0),
        proj_from_cam: nalgebra::Isometry3::translation(-100.0, 0.0, 0.0),
    };
    let expected = Response { blur_px: 1.7, offset: 0.03, scale: 0.9, gamma: 1.3 };
    let image = Projected::new(&pattern, expected.gamma).blurred(expected.blur_px);
    let codewords: Vec<Codeword> = (0..4000)
        .map(|i| {
            let point = [100.0 + f64::from(i % 200 - 100) * 2.3, f64::from(i / 200 - 10) * 2.0, 650.0];
            let px = projector.project(&Point3::from(point)).unwrap();
            Codeword { point, intensities: vec![expected.offset + expected.scale * image.at(px)], variance: 0.0 }
        })
        .collect();
    let (found, residual) = fit_response(&[pattern], &projector, &codewords);
    assert!(residual.rms < 0.007, "{residual:?}");
    let near = |a: f32, b: f32, tolerance: f32| (a - b).abs() < tolerance;
    assert!(near(found.blur_px, expected.blur_px, 0.25) && near(found.gamma, expected.gamma, 0.15), "{found:?}");
}

/// Patterns of two values look the same whatever the exponent, which stays 1; gray ones do not.
#[test]
fn the_exponent_matters_to_gray_patterns_alone() {
    let stripes = |values: &[f32]| Image {
        width: 240,
        height: 1,
        channels: 1,
        data: (0..240).map(|x| values[x / 6 % values.len()]).collect(),
    };
    let (binary, gray) = (stripes(&[0.1, 0.9]), stripes(&[0.1, 0.5, 0.9]));
    assert!(!exponent_matters(std::slice::from_ref(&binary)) && exponent_matters(&[gray]));
    let projector = Projector {
        optics: Camera::pinhole(240, 60, 500.0, 500.0, 120.0, 30.0),
        proj_from_cam: nalgebra::Isometry3::identity(),
    };
    let image = Projected::new(&binary, 1.0).blurred(1.7);
    let codewords: Vec<Codeword> = (0..2000)
        .map(|i| {
            let point = [f64::from(i % 200 - 100) * 0.7, f64::from(i / 200), 650.0];
            let px = projector.project(&Point3::from(point)).unwrap();
            Codeword { point, intensities: vec![0.05 + 0.8 * image.at(px)], variance: 0.0 }
        })
        .collect();
    let (found, residual) = fit_response(&[binary], &projector, &codewords);
    assert!(
        residual.median < 0.005 && found.gamma == 1.0 && (found.blur_px - 1.7).abs() < 0.25,
        "{found:?} {residual:?}"
    );
}

/// A single bright pixel is a square that is blurred: a difference of two error functions, here as a sum over the
/// square. Between the middles of pixels a tenth would be missing if it were a point between dark neighbors.
#[test]
fn pixels_are_squares_side_by_side() {
    let (blur, bright) = (0.5f32, 20);
    let mut data = vec![0.0f32; 41];
    data[bright] = 1.0;
    for [width, height] in [[41, 1], [1, 41]] {
        let image = Projected::new(&Image { width, height, channels: 1, data: data.clone() }, 1.0).blurred(blur);
        for i in -30..=30 {
            let off = f64::from(i) / 10.0;
            let at = bright as f64 + off;
            let gauss = |x: f64| (-0.5 * (x / f64::from(blur)).powi(2)).exp();
            let around =
                |n: i32, middle: f64| (0..n).map(|i| gauss(middle + (f64::from(i) + 0.5) / 200.0)).sum::<f64>();
            let expected = around(200, off - 0.5) / around(2000, -5.0);
            let found = f64::from(image.at(if width > 1 { [at, 7.0] } else { [7.0, at] }));
            assert!((found - expected).abs() < 0.02, "{off} px beside it {found}, not {expected}");
        }
    }
}
