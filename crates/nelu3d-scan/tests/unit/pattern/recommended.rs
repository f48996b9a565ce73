use nelu3d_scan::pattern::{Axis, Codewords, RECOMMENDED_IMAGES, generate, recommended_patterns};

/// As many images as asked for, and the more, the further are codes of far columns from each other.
#[test]
fn sets_have_their_number_of_images_and_tell_columns_apart() {
    for (length, axis) in [(640, Axis::X), (854, Axis::X), (1080, Axis::Y), (1920, Axis::X)] {
        let mut nearest = Vec::new();
        for n in RECOMMENDED_IMAGES {
            let (w, h) = if axis == Axis::X { (length, 1) } else { (1, length) };
            let set = generate(&recommended_patterns(length, axis, n).unwrap(), w, h).unwrap();
            assert_eq!(set.images.len(), n);
            let word = |u: usize| set.images.iter().map(move |p| p.image.data[u]);
            let words = Codewords::new(n, (0..length).flat_map(word).collect());
            let far = |u: usize, v: usize| -> f32 { word(u).zip(word(v)).map(|(a, b)| (a - b).powi(2)).sum() };
            let min = (0..length)
                .flat_map(|u| (u + length / 100..length).map(move |v| (u, v)))
                .map(|(u, v)| far(u, v))
                .fold(f32::INFINITY, f32::min);
            assert!((0..length).all(|u| words.nearest(&word(u).collect::<Vec<_>>()).unwrap().0 == u));
            nearest.push(min.sqrt());
        }
        assert!(nearest[0] < nearest[1] && nearest[1] < nearest[2] && nearest[2] > 0.02, "{length}: {nearest:?}");
    }
}

#[test]
fn other_numbers_and_tiny_images_are_refused() {
    assert!(recommended_patterns(1280, Axis::X, 4).unwrap_err().to_string().contains("3, 5 or 8"));
    assert!(recommended_patterns(60, Axis::X, 3).is_err());
    assert!(recommended_patterns(0, Axis::X, 3).is_err());
}
