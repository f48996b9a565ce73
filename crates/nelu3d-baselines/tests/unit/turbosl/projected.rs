use nelu3d_baselines::turbosl::blur::{Blur, HALF};
use nelu3d_baselines::turbosl::{Projected, ProjectedPlanes};
use nelu3d_scan::pattern::Axis;

const SIZE: [usize; 2] = [23, 17];

fn blurs() -> [Blur; 2] {
    let left = [0.2, 0.1, 0.04, 0.0, 0.01, 0.1, 0.02, 0.03, 0.01, 0.0];
    let below = [0.15, 0.02, 0.01, 0.03, 0.0, 0.12, 0.06, 0.0, 0.01, 0.02];
    [Blur::of(left), Blur::of(below)]
}

/// An image of both axes, parts of which the blur clips.
fn image() -> Vec<f32> {
    let of = |i: usize| {
        let (x, y) = ((i % SIZE[0]) as f32, (i / SIZE[0]) as f32);
        0.5 + 0.4 * (x * 0.9).sin() + 0.3 * (y * 0.7 + 0.2 * x).cos()
    };
    (0..SIZE[0] * SIZE[1]).map(of).collect()
}

/// An image that changes along one axis is blurred as a line, and as an image away from the ends of the other axis.
#[test]
fn a_line_is_an_image_whose_rows_are_the_same() {
    let line: Vec<f32> = image()[..SIZE[0]].to_vec();
    let rows: Vec<f32> = line.iter().copied().cycle().take(SIZE[0] * SIZE[1]).collect();
    let planes = ProjectedPlanes::new(SIZE, vec![Projected::Line(Axis::X, line), Projected::Image(rows)]);
    let blurred = planes.blurred(&blurs());
    for (u, v) in [(7.3, 8.0), (0.6, 7.5), (21.9, 9.2), (22.4, 8.1), (-0.4, 8.0)] {
        let [a, b] = [0, 1].map(|j| planes.sample(j, &blurred[j], [u, v]));
        assert!((a - b).abs() < 1e-5, "{u} {v}: {a} {b}");
    }
    // Above the image there is no light, which a line does not know.
    assert_eq!(planes.sample(1, &blurred[1], [7.0, -1.5]), 0.0);
    assert_eq!((planes.index(0, 2 * SIZE[0] + 5), planes.index(1, 2 * SIZE[0] + 5)), (5, 2 * SIZE[0] + 5));
}

#[test]
fn gradients_by_the_taps_match_central_differences() {
    let line: Vec<f32> = (0..SIZE[1]).map(|y| 0.5 + 0.6 * (y as f32).sin()).collect();
    let planes = ProjectedPlanes::new(SIZE, vec![Projected::Image(image()), Projected::Line(Axis::Y, line)]);
    // Σ s · blurred at places between pixels, inside and outside.
    let places: Vec<[f32; 2]> = (0..300)
        .map(|i| [(i as f32 * 0.617).rem_euclid(25.0) - 1.0, (i as f32 * 0.391).rem_euclid(19.0) - 1.0])
        .collect();
    let slope = |i: usize| (i as f32 * 0.3).cos();
    let value = |blur: &[Blur; 2]| -> f64 {
        let blurred = planes.blurred(blur);
        let of = |(i, place): (usize, &[f32; 2])| -> f64 {
            (0..2).map(|j| f64::from(slope(i) * planes.sample(j, &blurred[j], *place))).sum()
        };
        places.iter().enumerate().map(of).sum()
    };
    let blur = blurs();
    let mut d_blurred: Vec<Vec<f32>> = planes.blurred(&blur).iter().map(|b| vec![0.0; b.len()]).collect();
    for (i, place) in places.iter().enumerate() {
        (0..2).for_each(|j| planes.sample_backward(j, &mut d_blurred[j], *place, slope(i)));
    }
    let d = planes.blur_backward(&blur, &d_blurred);
    for axis in 0..2 {
        for t in 0..2 * HALF {
            let at = |e: f32| {
                let mut moved = blur.clone();
                let mut free = moved[axis].free();
                free[t] += e;
                moved[axis] = Blur::of(free);
                value(&moved)
            };
            let expected = (at(1e-3) - at(-1e-3)) / 2e-3;
            let found = f64::from(d[axis][t]);
            assert!((found - expected).abs() < 0.02 * expected.abs().max(2.0), "{axis} {t}: {found} {expected}");
        }
    }
}
