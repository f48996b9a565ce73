//! A white image between its pixels.

use nelu3d_scan::Image;

/// Interpolates all channels of an image at (x, y), px, with cubic convolution (Catmull and Rom 1974), never beyond the
/// values of the four nearest pixels; clipped where one of them is.
pub(super) fn cubic(image: &Image, [x, y]: [f32; 2], out: &mut [f32]) {
    let (w, h, channels) = (image.width, image.height, image.channels);
    let (x, y) = (x.clamp(0.0, w as f32 - 1.0), y.clamp(0.0, h as f32 - 1.0));
    let (x0, y0) = (x.floor(), y.floor());
    let weights = |f: f32| {
        let (f2, f3) = (f * f, f * f * f);
        [-0.5 * f + f2 - 0.5 * f3, 1.0 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2.0 * f2 - 1.5 * f3, 0.5 * (f3 - f2)]
    };
    let (wx, wy) = (weights(x - x0), weights(y - y0));
    let column = |i: usize| (x0 as isize + i as isize - 1).clamp(0, w as isize - 1) as usize;
    let row = |j: usize| (y0 as isize + j as isize - 1).clamp(0, h as isize - 1) as usize;
    for (c, out) in out.iter_mut().enumerate() {
        let at = |i: usize, j: usize| image.data[(row(j) * w + column(i)) * channels + c];
        let mut sum = 0.0;
        for (j, wy) in wy.iter().enumerate() {
            for (i, wx) in wx.iter().enumerate() {
                sum += wx * wy * at(i, j);
            }
        }
        let near = [at(1, 1), at(2, 1), at(1, 2), at(2, 2)];
        let (lo, hi) = near.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        *out = if hi >= 1.0 { hi } else { sum.clamp(lo, hi) };
    }
}
