//! Measurements for tests.

use nelu3d::sensor::Measurements;
use nelu3d::surface::PixelStatus;

/// Makes perfect measurements of mid gray under full light, one color channel.
pub(crate) fn mid_gray(width: usize, height: usize, k: usize) -> Measurements {
    let n = width * height;
    Measurements {
        width,
        height,
        image: [width, height],
        k,
        independent: k as f32,
        p: vec![0.5; n * k],
        inv_var: vec![1e4; n * k],
        surround: vec![0.5; n * k],
        status: vec![PixelStatus::Valid; n],
        contrast: vec![1.0; n],
        light: vec![1.0; n],
        has_black: true,
    }
}
