use nalgebra::Vector3;
use nelu3d::calibrate::shared_displacement::{
    CLASSES, DisplacementsBySupport, Sample, SharedSquare, square_displacements,
};

/// Samples over 30 × 20 squares, whose displacement is `mm(x, y)` and up to 1 mm of noise each.
fn samples(mm: impl Fn(f64, f64) -> f64) -> Vec<Sample> {
    let noise = |i: usize| 2.0 * ((i as f64 * 0.618_034).fract() - 0.5);
    (0..30 * 20 * 16)
        .map(|i| {
            let block = [i / 16 % 30, i / 480];
            let plane = [block[0] as f64 / 300.0, block[1] as f64 / 300.0];
            let d = mm(plane[0], plane[1]) + noise(i * 7919);
            Sample { g: (4.0 * d) as f32, h: 4.0, plane, block }
        })
        .collect()
}

#[test]
fn what_neighbors_share_is_no_noise() {
    let flat = samples(|_, _| 0.0);
    let none = SharedSquare::of(flat.iter(), &Vector3::zeros());
    assert!(none.mm2() < 0.003, "{none:?}");
    // A bend of 0.4 mm, root mean square, on a tilted plane.
    let plane = Vector3::new(0.5, -3.0, 2.0);
    let bent = samples(|x, y| 0.57 * (80.0 * x).sin() + 0.5 - 3.0 * x + 2.0 * y);
    let beside = SharedSquare::of(bent.iter(), &plane).mm2().sqrt();
    assert!((0.33..0.43).contains(&beside), "{beside}");
    assert!(SharedSquare::of(bent.iter(), &Vector3::zeros()).mm2().sqrt() > 0.45);
}

#[test]
fn fewer_boards_are_never_better() {
    let of = |mm: [f64; CLASSES], pairs: [f64; CLASSES]| {
        let class = |i: usize| SharedSquare { pairs: pairs[i], weight: pairs[i], product: pairs[i] * mm[i] * mm[i] };
        DisplacementsBySupport { shared: [0, 1, 2, 3].map(class), squares: Vec::new() }.rms_mm()
    };
    let close = |a: [f64; CLASSES], b: [f64; CLASSES]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(close(of([4.0, 2.0, 1.0, 0.5], [99.0; 4]).unwrap(), [4.0, 2.0, 1.0, 0.5]));
    assert!(close(of([4.0, 0.7, 1.0, 0.5], [99.0; 4]).unwrap(), [4.0, 1.0, 1.0, 0.5]));
    // From two boards alone: one board is √(3/2) off, and √2 from another.
    let expected = [2.0, 2.0, 1.5, 4.0 / 3.0].map(f64::sqrt);
    assert!(close(of([0.0, 0.0, 1.5f64.sqrt(), 0.0], [3.0, 3.0, 99.0, 3.0]).unwrap(), expected));
    assert_eq!(of([1.0; 4], [99.0, 3.0, 3.0, 3.0]), None);
}

#[test]
fn a_part_of_one_board_that_is_far_off_is_found() {
    let mut all = DisplacementsBySupport::default();
    for position in 0..4 {
        // The last board's lower left corner shows another period of the code.
        let of = samples(|x, y| if position == 3 && x < 0.03 && y > 0.03 { 40.0 } else { 0.3 * (60.0 * x).sin() });
        let shared = [0, 0, 1, 0].map(|is| {
            let near = of.iter().filter(|s| is == 1 && s.size() < 5.0);
            SharedSquare::of(near, &Vector3::zeros())
        });
        let squares = square_displacements(&of, position, 2).collect();
        all.add(&DisplacementsBySupport { shared, squares });
    }
    let gross = all.gross().unwrap();
    let expected = 9.0 * 10.0 / 600.0;
    assert!(gross.position == 3 && (gross.of_position - expected).abs() < 0.02, "{gross:?}");
    assert!((gross.share - expected / 4.0).abs() < 0.005, "{gross:?}");
    all.squares.retain(|s| s.position != 3);
    assert_eq!(all.gross().unwrap().share, 0.0);
}
