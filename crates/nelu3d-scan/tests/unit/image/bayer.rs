use nelu3d_scan::Image;
use nelu3d_scan::image::{Channels, demosaic};

/// The mosaic a sensor would take of a color image.
fn mosaic_of(color: impl Fn(usize, usize) -> [f32; 3], w: usize, h: usize, cell: [u8; 4]) -> Image {
    let mut m = Image::new(w, h, 1);
    for y in 0..h {
        for x in 0..w {
            m.data[y * w + x] = color(x, y)[usize::from(cell[2 * (y % 2) + x % 2])];
        }
    }
    m
}

#[test]
fn linear_gray_ramps_are_exact_inside() {
    // All five filters reproduce an image whose colors are one linear function.
    let ramp = |x: usize, y: usize| [0.1 + 0.02 * x as f32 + 0.03 * y as f32; 3];
    for channels in Channels::ALL {
        let Channels::Bayer(cell) = channels else { continue };
        let rgb = demosaic(&mosaic_of(ramp, 12, 9, cell), cell);
        for y in 2..7 {
            for x in 2..10 {
                for c in 0..3 {
                    let e = rgb.pixel(x, y)[c] - ramp(x, y)[c];
                    assert!(e.abs() < 1e-6, "{} at {x},{y},{c}: {e}", channels.name());
                }
            }
        }
    }
}

#[test]
fn flat_colors_are_exact_everywhere() {
    for channels in Channels::ALL {
        let Channels::Bayer(cell) = channels else { continue };
        let color = [0.2, 0.5, 0.7];
        for (w, h) in [(7, 6), (2, 2), (3, 5)] {
            let rgb = demosaic(&mosaic_of(|_, _| color, w, h, cell), cell);
            for p in rgb.data.chunks_exact(3) {
                assert!(p.iter().zip(color).all(|(a, b)| (a - b).abs() < 1e-6), "{} {w}x{h}: {p:?}", channels.name());
            }
        }
    }
}

#[test]
fn clipped_if_and_only_if_a_contributor_is() {
    let cell = [0, 1, 1, 2];
    let mut m = Image::new(16, 16, 1);
    m.data.fill(0.05);
    m.data[8 * 16 + 8] = 1.0;
    let rgb = demosaic(&m, cell);
    for y in 0..16usize {
        for x in 0..16usize {
            let (dx, dy) = (x.abs_diff(8), y.abs_diff(8));
            let p = rgb.pixel(x, y);
            if dx > 2 || dy > 2 {
                assert!(p.iter().all(|&v| v < 1.0), "far pixel {x},{y} marked");
            } else if dx + dy == 2 {
                assert!(p.iter().any(|&v| v >= 1.0), "neighbor {x},{y} not marked");
            }
        }
    }
    // A bright edge overshoots, yet nothing was clipped.
    let edge = mosaic_of(|x, _| if x < 8 { [0.0; 3] } else { [0.999; 3] }, 16, 16, cell);
    assert!(demosaic(&edge, cell).data.iter().all(|&v| v < 1.0));
}
