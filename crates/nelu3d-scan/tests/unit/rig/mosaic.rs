use nelu3d_scan::Image;
use nelu3d_scan::image::demosaic;
use nelu3d_scan::rig::pattern_of_mosaic;

const CELL: [u8; 4] = [0, 1, 1, 2];

/// A checkered surface of saturated colors under smooth light: the ratio of the images is that of the light to a
/// thousandth, where images demosaiced one by one are wrong by a tenth at its edges.
#[test]
fn ratios_do_not_see_the_surface() {
    let (w, h) = (48, 40);
    let albedo = |x: usize, y: usize, c: usize| [[0.7, 0.2, 0.1], [0.15, 0.3, 0.6]][(x / 6 + y / 6) % 2][c];
    let light = |x: usize, y: usize, c: usize| 0.5 + 0.3 * (0.15 * x as f32 + 0.1 * y as f32 + 2.0 * c as f32).sin();
    let mosaic = |f: &dyn Fn(usize, usize, usize) -> f32| {
        let mut image = Image::new(w, h, 1);
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            image.data[i] = f(x, y, usize::from(CELL[2 * (y % 2) + x % 2]));
        }
        image
    };
    let black = mosaic(&|_, _, _| 0.01);
    let white = mosaic(&|x, y, c| 0.01 + 0.8 * albedo(x, y, c));
    let taken = mosaic(&|x, y, c| 0.01 + 0.8 * albedo(x, y, c) * light(x, y, c));
    let (white_rgb, black_rgb) = (demosaic(&white, CELL), demosaic(&black, CELL));
    let ours = pattern_of_mosaic(&taken, &white, Some(&black), &white_rgb, Some(&black_rgb), CELL);
    let plain = demosaic(&taken, CELL);
    let worst = |image: &Image| -> f32 {
        let mut worst = 0.0f32;
        for (x, y) in (4..h - 4).flat_map(|y| (4..w - 4).map(move |x| (x, y))) {
            for c in 0..3 {
                let i = 3 * (y * w + x) + c;
                let ratio = (image.data[i] - black_rgb.data[i]) / (white_rgb.data[i] - black_rgb.data[i]);
                worst = worst.max((ratio - light(x, y, c)).abs());
            }
        }
        worst
    };
    assert!(worst(&ours) < 0.02, "{}", worst(&ours));
    assert!(worst(&plain) > 0.1, "{}", worst(&plain));
}

/// Where there is next to no light, and where something is clipped, the image stays as it was.
#[test]
fn dim_and_clipped_pixels_stay_as_they_were() {
    let mut white = Image::new(16, 16, 1);
    white.data.iter_mut().enumerate().for_each(|(i, v)| *v = if i % 16 < 8 { 0.005 } else { 0.9 });
    let mut taken = Image { data: white.data.iter().map(|v| 0.5 * v).collect(), ..white.clone() };
    taken.data[8 * 16 + 12] = 1.0;
    let ours = pattern_of_mosaic(&taken, &white, None, &demosaic(&white, CELL), None, CELL);
    let plain = demosaic(&taken, CELL);
    for i in 0..16 * 16 {
        let same = ours.pixel(i % 16, i / 16) == plain.pixel(i % 16, i / 16);
        assert!(same || i % 16 >= 10, "{i}");
        let clipped = |image: &Image| image.pixel(i % 16, i / 16).iter().map(|v| *v >= 1.0).collect::<Vec<_>>();
        assert_eq!(clipped(&ours), clipped(&plain), "{i}");
    }
}
