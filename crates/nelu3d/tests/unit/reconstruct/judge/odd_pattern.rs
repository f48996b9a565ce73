use nelu3d::reconstruct::judge::odd_pattern::OddPattern;

/// The odd pattern, and its share, where so many of 400 tried pixels are explained without each image; they stand for
/// 4,000 pixels without a depth beside 10,000 with one.
fn odd(explained: &[usize]) -> Option<(usize, f64)> {
    OddPattern { tried: 400, explained: explained.to_vec(), without_depth: 4000, with_depth: 10_000 }.image()
}

#[test]
fn one_image_that_disagrees_with_all_others_is_named() {
    assert_eq!(odd(&[0, 4, 200, 0, 1, 0]), Some((2, 0.5)));
}

#[test]
fn images_that_disagree_now_and_then_are_not() {
    // A room behind the object: now this image, now that.
    assert_eq!(odd(&[40, 50, 164, 10, 60, 0]), None);
    // A small part of the object, and next to nothing.
    assert_eq!(odd(&[0, 2, 100, 0, 1, 0]), None);
    assert_eq!(OddPattern { tried: 18, explained: vec![18, 0], without_depth: 18, with_depth: 0 }.image(), None);
}

#[test]
fn where_nothing_has_a_depth_it_is_named_too() {
    let nothing = OddPattern { tried: 400, explained: vec![0, 0, 0, 160, 2], without_depth: 9000, with_depth: 0 };
    assert_eq!(nothing.image(), Some((3, 0.4)));
    let finding = nothing.judge(&["a", "b", "c", "d", "e"].map(str::to_owned)).unwrap();
    assert!(finding.sentence.starts_with("d disagrees with the other patterns"), "{}", finding.sentence);
}
