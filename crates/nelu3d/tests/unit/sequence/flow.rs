use nelu3d::sequence::flow::flow;
use nelu3d::sequence::pyramid::Pyramid;

/// The known motion of a smooth texture is found to a few hundredths of a pixel, in a reduced image, also where it
/// is larger than the surroundings that decide on a pixel.
#[test]
fn known_motion_is_found() {
    let (w, h) = (200, 150);
    let texture = |x: f32, y: f32| {
        0.5 + 0.12 * (0.23 * x + 0.11 * y).sin() + 0.1 * (0.31 * y - 0.07 * x).cos() + 0.1 * (0.05 * x * 1.3).sin()
    };
    for shift in [[0.3f32, -0.2], [2.4, 1.1], [-9.0, 5.5]] {
        // Rotation by a hundredth about the middle, and the shift.
        let motion = |x: f32, y: f32| [shift[0] - 0.01 * (y - 75.0), shift[1] + 0.01 * (x - 100.0)];
        let a: Vec<f32> = (0..w * h)
            .map(|i| {
                let (x, y) = ((i % w) as f32, (i / w) as f32);
                let u = motion(x, y);
                texture(x + u[0], y + u[1])
            })
            .collect();
        let b: Vec<f32> = (0..w * h).map(|i| texture((i % w) as f32, (i / w) as f32)).collect();
        let found = flow(&Pyramid::new(vec![a], w, h), &Pyramid::new(vec![b], w, h));
        let mut errors: Vec<f32> = (0..w * h)
            .filter(|i| (20..w - 20).contains(&(i % w)) && (20..h - 20).contains(&(i / w)))
            .map(|i| {
                let place = [(i % w) as f32, (i / w) as f32];
                let (found, u) = (found.at(place), motion(place[0], place[1]));
                (found[0] - u[0]).hypot(found[1] - u[1])
            })
            .collect();
        errors.sort_by(f32::total_cmp);
        assert!(errors[errors.len() / 2] < 0.05, "{shift:?}: median {}", errors[errors.len() / 2]);
        assert!(errors[errors.len() * 19 / 20] < 0.1, "{shift:?}: 95 % {}", errors[errors.len() * 19 / 20]);
    }
}

/// The motion of a surface that varies in color alone is found.
#[test]
fn color_alone_tells_motion() {
    let (w, h) = (120, 90);
    let wave = |x: f32, y: f32| 0.1 * ((0.25 * x).sin() + (0.3 * y + 1.0).cos());
    let image = |shift: [f32; 2]| {
        let of = |sign: f32| {
            let at = |i: usize| 0.5 + sign * wave((i % w) as f32 - shift[0], (i / w) as f32 - shift[1]);
            (0..w * h).map(at).collect()
        };
        Pyramid::new(vec![of(1.0), of(-1.0)], w, h)
    };
    let middle = flow(&image([0.0; 2]), &image([3.0, -1.5])).at([60.0, 45.0]);
    assert!((middle[0] - 3.0).hypot(middle[1] + 1.5) < 0.1, "{middle:?}");
}

/// Noise alone moves an empty image by less than a pixel.
#[test]
fn an_empty_image_hardly_moves() {
    use rand::{RngExt, SeedableRng};
    let (w, h) = (90, 70);
    let mut rng = rand::rngs::StdRng::seed_from_u64(3);
    let mut noise = || {
        let image = (0..w * h).map(|_| 0.2 + 0.01 * rng.random::<f32>()).collect();
        Pyramid::new(vec![image], w, h)
    };
    let u = flow(&noise(), &noise()).values;
    let mean = u.iter().map(|u| u[0].hypot(u[1])).sum::<f32>() / u.len() as f32;
    assert!(mean < 1.0, "{mean}");
}
