use nelu3d::reconstruct::refine::seen::Seen;
use nelu3d::reconstruct::refine::window::Window;
use nelu3d::sensor::{Blur, NoiseModel};
use nelu3d::surface::PixelStatus;

use crate::sensor::measurements::mid_gray;

const SIZE: usize = 12;
const NOISE: NoiseModel = NoiseModel { read: 1e-5, gain: 0.0, darkest: None };

/// Where the light of the pixels of a picture comes from, and the index of a pixel of it.
fn seen(light: impl Fn(usize, usize) -> f32, blur: Option<Blur>) -> (Seen, impl Fn(usize, usize) -> usize) {
    let mut m = mid_gray(SIZE, SIZE, 2);
    m.contrast = (0..SIZE * SIZE).map(|i| light(i % SIZE, i / SIZE)).collect();
    for (status, contrast) in m.status.iter_mut().zip(&m.contrast) {
        if *contrast >= 1.0 {
            *status = PixelStatus::Saturated;
        }
    }
    let window = Window::around(&vec![1.0; SIZE * SIZE], SIZE).unwrap();
    let active: Vec<bool> = (0..window.w * window.h).map(|i| !window.in_ring(i)).collect();
    let at = move |x: usize, y: usize| (y + 1) * window.w + x + 1;
    (Seen::new(&m, &NOISE, blur, &window, &active), at)
}

#[test]
fn at_an_edge_of_brightness_light_comes_from_the_bright_side() {
    let blur = Some(Blur::new(0.4));
    let edge = |x: usize| [0.8, 0.8, 0.5, 0.2, 0.2][x.saturating_sub(4).min(4)];
    let (of_edge, at) = seen(|x, _| edge(x), blur);
    let [dx, dy] = of_edge.shift(at(6, 5));
    // 0.4 times half the difference of the neighbors over the own light, and next to none of that is noise.
    assert!((dx + 0.4 * 0.3 / 0.5).abs() < 2e-3 && dy == 0.0, "{dx} {dy}");
    assert_eq!(of_edge.shift(at(3, 5)), [0.0; 2]);
    // Inverse depth there is that in the middle and its slope times the way.
    let x = vec![7.0; 14 * 14];
    let of = of_edge.of(&x, &vec![[2.0, 100.0]; x.len()]);
    assert!((of[at(6, 5)] - (7.0 + 2.0 * dx)).abs() < 1e-5);
    assert_eq!(of[at(3, 5)], 7.0);
    // At an outline, here that of the picture, as well.
    assert_eq!(of_edge.shift(at(6, 1)), [dx, dy]);
    // Down the picture it is the same.
    let (down, at) = seen(|_, y| edge(y), blur);
    assert_eq!(down.shift(at(5, 6)), [0.0, dx]);
}

#[test]
fn noise_saturation_and_a_camera_whose_blur_is_not_known_move_nothing() {
    let blur = Some(Blur::new(0.4));
    let (noisy, at) = seen(|x, y| 0.5 + 0.002 * ((7 * x + 3 * y) % 5) as f32, blur);
    assert!((1..11).all(|x| noisy.shift(at(x, 5))[0].abs() < 1e-3));
    let (saturated, at) = seen(|x, _| if x < 6 { 1.0 } else { 0.4 }, blur);
    assert_eq!(saturated.shift(at(6, 5)), [0.0; 2]);
    let (unknown, at) = seen(|x, _| if x < 6 { 0.9 } else { 0.4 }, None);
    assert_eq!(unknown.shift(at(6, 5)), [0.0; 2]);
    assert_eq!(unknown.of(&[1.0, 2.0], &[[3.0; 2]; 2]), [1.0, 2.0]);
}
