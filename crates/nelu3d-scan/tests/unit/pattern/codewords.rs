use nelu3d_scan::Image;
use nelu3d_scan::pattern::{Axis, Codewords, Stripes};

#[test]
fn words_are_the_images_along_the_axis() {
    let image = |channels: usize, f: &dyn Fn(usize) -> f32| Image {
        data: (0..5 * 2 * channels).map(f).collect(),
        ..Image::new(5, 2, channels)
    };
    let images = [image(1, &|i| (i % 5) as f32), image(3, &|i| (i % 15) as f32)];
    let x = Codewords::of_images(&images, Axis::X);
    assert_eq!((x.k, x.len()), (4, 5));
    assert_eq!(x.word(3), [3.0, 9.0, 10.0, 11.0]);
    let y = Codewords::of_images(&images, Axis::Y);
    assert_eq!((y.len(), y.word(0)[0], y.word(1)[1]), (2, 2.0, 6.0));
}

#[test]
fn the_direction_of_stripes_is_seen() {
    let image = |f: &dyn Fn(usize, usize) -> f32| Image {
        data: (0..5 * 4 * 3).map(|i| f(i / 3 % 5, i / 15)).collect(),
        ..Image::new(5, 4, 3)
    };
    assert_eq!(Stripes::of(&image(&|_, _| 0.3), 0.01), Stripes::Constant);
    assert_eq!(Stripes::of(&image(&|x, _| x as f32 / 4.0), 0.01), Stripes::Along(Axis::X));
    assert_eq!(Stripes::of(&image(&|x, y| y as f32 / 4.0 + x as f32 / 1e3), 0.01), Stripes::Along(Axis::Y));
    assert_eq!(Stripes::of(&image(&|x, y| (x * y) as f32), 0.01), Stripes::Both);
}

#[test]
fn the_nearest_word_is_found() {
    let words = Codewords::new(2, vec![0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    assert_eq!(words.nearest(&[0.9, 0.0]).map(|w| w.0), Some(1));
    assert_eq!(words.nearest(&[0.1, 0.5]).map(|w| w.0), Some(0));
    assert_eq!(words.nearest(&[f32::NAN, 0.5]), None);
    assert_eq!(words.normalized().word(0), [0.0, 0.0]);
}
