use std::f64::consts::{PI, TAU};

use nelu3d_scan::Image;
use nelu3d_sim::light::grid::{PixelGrid, normal_cdf};

fn image(width: usize, height: usize, value: impl Fn(usize, usize) -> f64) -> Image {
    let data = (0..width * height).map(|i| value(i % width, i / width) as f32).collect();
    Image { width, height, channels: 1, data }
}

fn at(grid: &PixelGrid, u: f64, v: f64, sigma: f64) -> f64 {
    let mut out = [0.0];
    grid.at([u, v], sigma, &mut out);
    f64::from(out[0])
}

#[test]
fn the_tabled_function_is_the_normal_one() {
    // Abramowitz and Stegun, table 26.1.
    for (x, expected) in [(0.0, 0.5), (0.5, 0.691_462_461), (1.0, 0.841_344_746), (2.5, 0.993_790_335)] {
        assert!((normal_cdf(x) - expected).abs() < 1e-6 && (normal_cdf(-x) - 1.0 + expected).abs() < 1e-6, "{x}");
    }
    assert!(normal_cdf(-7.0).abs() < 2e-9 && (normal_cdf(1e9) - 1.0).abs() < 2e-9);
}

/// White, along a line through the middles of the pixels: the product of two Fourier series with coefficients
/// `f sinc(k f) exp(−2 π² k² σ²)`.
#[test]
fn gaps_modulate_white_as_the_fourier_series_says() {
    for fill in [0.5, 0.78, 1.0] {
        let grid = PixelGrid::new(&[image(24, 20, |_, _| 1.0)], fill);
        for sigma in [0.1, 0.25, 0.4, 0.6, 0.69, 0.71, 1.0, 2.0] {
            let line = |x: f64| {
                let term = |k: i32| {
                    let k = f64::from(k);
                    2.0 * (PI * k * fill).sin() / (PI * k)
                        * (-2.0 * (PI * k * sigma).powi(2)).exp()
                        * (TAU * k * x).cos()
                };
                fill + (1..40).map(term).sum::<f64>()
            };
            for (x, y) in [(0.0, 0.0), (0.2, 0.1), (0.5, 0.0), (0.5, 0.5), (0.37, 0.81)] {
                let (got, expected) = (at(&grid, 11.0 + x, 9.0 + y, sigma), line(x) * line(y));
                assert!((got - expected).abs() < 4e-4, "fill {fill}, sigma {sigma}: {got}, not {expected}");
            }
        }
    }
}

/// Squares and blur stack, on both sides of the change from one to the other, for the finest patterns there are.
#[test]
fn the_change_to_the_blur_stack_is_bounded() {
    type Value = fn(usize, usize) -> f64;
    let patterns: [(&str, Value, f64); 4] = [
        ("white", |_, _| 1.0, 4e-4),
        ("sinusoid of 8 px", |x, _| 0.5 + 0.5 * (TAU * x as f64 / 8.0).cos(), 0.003),
        ("edge", |x, _| f64::from(u8::from(x >= 20)), 0.02),
        ("stripes of 1 px", |x, _| (x % 2) as f64, 0.045),
    ];
    for (name, value, limit) in patterns {
        for fill in [0.6, 0.9, 1.0] {
            let grid = PixelGrid::new(&[image(40, 32, value)], fill);
            let mut worst: f64 = 0.0;
            for i in 0..60 {
                let (u, v) = (18.0 + 0.07 * f64::from(i), 14.3 + 0.02 * f64::from(i));
                let below = at(&grid, u, v, PixelGrid::NARROW_PX - 1e-9);
                worst = worst.max((below - at(&grid, u, v, PixelGrid::NARROW_PX + 1e-9)).abs() / (fill * fill));
            }
            eprintln!("{name}, fill {fill}: {worst:.5} of white");
            assert!(worst < limit, "{name}, fill {fill}: {worst}");
        }
    }
}

#[test]
fn a_pixel_has_the_light_and_variance_of_its_square_and_blur() {
    let one = image(41, 41, |x, y| f64::from(u8::from(x == 20 && y == 20)));
    for (fill, sigma) in [(0.6, 0.3), (1.0, 0.5), (0.8, 0.65)] {
        let grid = PixelGrid::new(std::slice::from_ref(&one), fill);
        let n = 20;
        let (mut sum, mut square) = (0.0, 0.0);
        for i in -8 * n..8 * n {
            for j in -8 * n..8 * n {
                let [x, y] = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(n));
                let value = at(&grid, 20.0 + x, 20.0 + y, sigma) / f64::from(n * n);
                sum += value;
                square += value * x * x;
            }
        }
        let expected = sigma * sigma + fill * fill / 12.0;
        assert!((sum / (fill * fill) - 1.0).abs() < 1e-3, "{sum}");
        assert!((square / sum / expected - 1.0).abs() < 0.01, "{} instead of {expected}", square / sum);
    }
}

#[test]
fn outside_is_dark() {
    let grid = PixelGrid::new(&[image(4, 4, |_, _| 1.0)], 1.0);
    for (u, v, expected) in
        [(-1.5, 1.0, 0.0), (f64::NAN, 1.0, 0.0), (f64::INFINITY, 0.0, 0.0), (1.5, 1.0, 1.0), (3.5, 1.0, 0.5)]
    {
        assert!((at(&grid, u, v, 0.1) - expected).abs() < 1e-6, "{u}, {v}");
    }
}
