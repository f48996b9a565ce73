use nelu3d::calibrate::Position;
use nelu3d::calibrate::drawn::{Drawn, MAX_POSITIONS, SAMPLES, selection};
use nelu3d::calibrate::judge::repeated::Fingerprint;

#[test]
fn the_selection_is_bounded_and_has_both_ends() {
    assert_eq!(selection(MAX_POSITIONS), (0..MAX_POSITIONS).collect::<Vec<_>>());
    let of_many = selection(1000);
    assert_eq!((of_many.len(), of_many[0], of_many[MAX_POSITIONS - 1]), (MAX_POSITIONS, 0, 999));
}

#[test]
fn usable_samples_are_drawn_from_all_over_an_image() {
    let (width, height) = (400, 300);
    let n = width * height;
    let contrast: Vec<f32> = (0..n).map(|i| if i % width < 100 { 0.0 } else { 0.5 }).collect();
    let position = Position {
        width,
        height,
        k: 2,
        channels: 1,
        values: (0..2 * n).map(|i| i as f32).collect(),
        around: (0..n).map(|i| 3.0 * i as f32).collect(),
        edge: (0..n).map(|i| 5.0 * i as f32).collect(),
        contrast,
        light: Vec::new(),
    };
    let drawn = Drawn::of(&position, Fingerprint::default(), 0.1, 5);
    let count = drawn.pixels.len();
    assert!((SAMPLES.end() * 6 / 10..SAMPLES.end() * 9 / 10).contains(&count), "{count}");
    for (number, i) in drawn.pixels.iter().copied().enumerate() {
        assert!(i % width >= 100 && drawn.contrast[number] == 0.5);
        assert_eq!(drawn.values[2 * number..][..2], [2.0 * i as f32, 2.0 * i as f32 + 1.0]);
        assert_eq!(drawn.around_and_edge[number], [3.0 * i as f32, 5.0 * i as f32]);
    }
    // Of every quarter of the rows about as many.
    let per_quarter = |q: usize| drawn.pixels.iter().filter(|i| **i / width / 75 == q).count();
    assert!((0..4).all(|q| (count / 5..count / 3).contains(&per_quarter(q))));
}
