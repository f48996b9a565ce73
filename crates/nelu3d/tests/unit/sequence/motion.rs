use nelu3d::sequence::Motion;
use nelu3d_scan::Image;

fn picture(shift: f32) -> Image {
    let (width, height) = (160, 120);
    let mut image = Image::new(width, height, 1);
    for i in 0..width * height {
        let (x, y) = ((i % width) as f32 - shift, (i / width) as f32);
        image.data[i] = 0.3 + 0.1 * (0.2 * x + 0.1 * y).sin() + 0.08 * (0.17 * y - 0.1 * x).cos();
    }
    image
}

/// Under constant acceleration the white image is drawn as it was between frames.
#[test]
fn a_white_image_is_drawn_at_another_time() {
    let position = |t: f32| 3.0 * t + 0.8 * t * t;
    let motion = Motion::around(Some(&picture(position(-1.0))), &picture(0.0), Some(&picture(position(1.0)))).unwrap();
    for t in [-0.7, -0.25, 0.5] {
        let (drawn, expected) = (motion.white_at(&picture(0.0), t), picture(position(t)));
        let mut worst = 0.0f32;
        for i in (0..expected.data.len()).filter(|i| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160))) {
            worst = worst.max((drawn.data[i] - expected.data[i]).abs());
        }
        assert!(worst < 0.006, "{t}: {worst}");
    }
    assert!((motion.median_px(|_| true) - 3.0).abs() < 0.2);
}

/// Brightness that changes evenly along the way is drawn as it was; what only one white image shows is neither
/// mixed in nor followed. Three white images have less noise than one.
#[test]
fn light_changes_along_the_way() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    let mut random = rand::rngs::StdRng::seed_from_u64(4);
    let noise = Normal::new(0.0, 0.003f32).unwrap();
    let expected = |t: f32| {
        let mut image = picture(2.0 * t);
        image.data.iter_mut().for_each(|v| *v *= 1.0 + 0.06 * t);
        image
    };
    let mut taken = |t: f32| {
        let mut image = expected(t);
        image.data.iter_mut().for_each(|v| *v += noise.sample(&mut random));
        image
    };
    let (before, white, mut after) = (taken(-1.0), taken(0.0), taken(1.0));
    // Something passes before the camera.
    let covered = |i: usize| (60..90).contains(&(i % 160)) && (40..70).contains(&(i / 160));
    (0..after.data.len()).filter(|i| covered(*i)).for_each(|i| after.data[i] = 0.9);
    let motion = Motion::around(Some(&before), &white, Some(&after)).unwrap();
    let alone = Motion { brightness: None, ..Motion::around(Some(&before), &white, Some(&after)).unwrap() };
    for t in [-0.5, 0.0, 0.3] {
        let expected = expected(t).data;
        let rms = |drawn: &Image, of: &dyn Fn(usize) -> bool| {
            let inner = |i: &usize| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160));
            let all: Vec<f32> = (0..drawn.data.len())
                .filter(|i| inner(i) && of(*i))
                .map(|i| (drawn.data[i] - expected[i]).powi(2))
                .collect();
            (all.iter().sum::<f32>() / all.len() as f32).sqrt()
        };
        let far = |i: usize| !((45..105).contains(&(i % 160)) && (25..85).contains(&(i / 160)));
        let (with, without) = (motion.white_at(&white, t), alone.white_at(&white, t));
        let (a, b) = (rms(&with, &far), rms(&without, &far));
        assert!(a < 0.8 * b && a < 0.003, "{t}: {a}, of one white image {b}");
        let hidden = |i: usize| (66..84).contains(&(i % 160)) && (46..64).contains(&(i / 160));
        let (a, b) = (rms(&with, &hidden), rms(&without, &hidden));
        assert!(a < 1.3 * b + 0.002, "{t}: {a} where one white image shows something else, of one white image {b}");
    }
}

/// A surface with a texture on it moves along with the texture.
#[test]
fn a_surface_is_warped_to_the_next_frame() {
    let position = |t: f32| 3.0 * t + 0.5 * t * t;
    let motion = Motion::around(Some(&picture(position(-1.0))), &picture(0.0), Some(&picture(position(1.0)))).unwrap();
    let t = -0.3;
    let surface =
        |shift: f32| -> Vec<f32> { (0..160 * 120).map(|i| 500.0 + 0.2 * ((i % 160) as f32 - shift)).collect() };
    let (warped, expected) = (motion.warp_depth(&surface(position(t - 1.0)), t), surface(position(t)));
    for i in (0..expected.len()).filter(|i| (15..145).contains(&(i % 160)) && (15..105).contains(&(i / 160))) {
        assert!((warped[i] - expected[i]).abs() < 0.05, "{i}: {} {}", warped[i], expected[i]);
    }
}

#[test]
fn one_neighbor_gives_the_velocity_and_none_nothing() {
    let back = Motion::around(Some(&picture(-2.0)), &picture(0.0), None).unwrap();
    let forth = Motion::around(None, &picture(0.0), Some(&picture(2.0))).unwrap();
    for m in [back, forth] {
        let [x, ..] = m.motion.at([80.0, 60.0]);
        assert!((x - 2.0).abs() < 0.1, "{x}");
    }
    assert!(Motion::around(None, &picture(0.0), None).is_none());
}

/// A neighbor that shows something else gives no motion.
#[test]
fn a_cut_is_no_motion() {
    let mut other = Image::new(160, 120, 1);
    for i in 0..160 * 120 {
        let (x, y) = ((i % 160) as f32, (i / 160) as f32);
        other.data[i] = if (x - 60.0).hypot(y - 70.0) < 40.0 { 0.7 } else { 0.01 };
    }
    assert!(Motion::around(Some(&other), &picture(0.0), None).is_none());
    let one = Motion::around(Some(&other), &picture(0.0), Some(&picture(2.0))).unwrap();
    assert!((one.motion.at([80.0, 60.0])[0] - 2.0).abs() < 0.1);
}

#[test]
fn what_is_clipped_stays_clipped() {
    let mut white = picture(0.0);
    white.data[50 * 160 + 70] = 1.0;
    let motion = Motion::around(None, &white, Some(&picture(1.0))).unwrap();
    let drawn = motion.white_at(&white, 0.5);
    assert!(drawn.data.iter().any(|v| *v >= 1.0));
}
