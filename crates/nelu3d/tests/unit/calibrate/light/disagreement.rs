use nelu3d::calibrate::light::disagreement::{MAX_COMPARED, compared_with, spread};

#[test]
fn a_view_is_compared_with_others_that_are_spread_evenly() {
    let of = |view: usize, n: usize| compared_with(view, n).collect::<Vec<_>>();
    assert_eq!(of(1, 4), [0, 2, 3]);
    for n in [13, 18, 40, 48] {
        for view in [0, n / 2, n - 1] {
            let others = of(view, n);
            assert_eq!(others.len(), MAX_COMPARED);
            assert!(others.iter().all(|o| *o != view && *o < n) && others.is_sorted_by(|a, b| a < b), "{others:?}");
        }
    }
}

#[test]
fn what_is_found_goes_on_into_what_it_touches() {
    // A row of blocks: found at 3, and 4 to 9 not told; 12 is not connected.
    let mut found: Vec<bool> = (0..14).map(|i| i == 3).collect();
    let into: Vec<bool> = (0..14).map(|i| (4..10).contains(&i) || i == 12).collect();
    spread(&mut found, &into, |_| 2, 14);
    let at: Vec<usize> = (0..14).filter(|i| found[*i]).collect();
    assert_eq!(at, [3, 4, 5]);
    spread(&mut found, &into, |_| usize::MAX, 14);
    assert_eq!(found.iter().filter(|f| **f).count(), 7);
}
