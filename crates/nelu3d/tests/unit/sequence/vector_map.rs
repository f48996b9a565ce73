use nelu3d::sequence::vector_map::VectorMap;

#[test]
fn a_plane_is_interpolated_exactly_and_its_border_goes_on() {
    let mut map = VectorMap { size: [4, 3], spacing: [2.0, 4.0], values: vec![[0.0; 2]; 12] };
    for i in 0..12 {
        let [x, y] = map.place(i);
        map.values[i] = [x + 10.0 * y, -y];
    }
    for (place, expected) in [([1.5, 4.25], [44.0, -4.25]), ([6.5, 9.5], [101.5, -9.5]), ([-3.0, 1.5], [15.5, -1.5])] {
        let found = map.at(place);
        assert!((0..2).all(|c| (found[c] - expected[c]).abs() < 1e-4), "{place:?}: {found:?}");
    }
}
