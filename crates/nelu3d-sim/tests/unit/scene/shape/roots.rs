use nelu3d_sim::scene::shape::roots::first_root;

#[test]
fn the_first_of_known_zeros_is_found() {
    for zeros in [[1.0, 2.0, 3.0, 4.0], [0.5, 0.5001, 7.0, 9.0], [-3.0, -1.0, 2.5, 60.0], [1e-3, 5.0, 5.0, 80.0]] {
        let mut c = [1.0, 0.0, 0.0, 0.0, 0.0];
        for z in zeros {
            for k in (0..5).rev() {
                c[k] = if k > 0 { c[k - 1] } else { 0.0 } - z * c[k];
            }
        }
        let first = zeros.into_iter().find(|z| *z > 0.0).unwrap();
        let got = first_root(&c, 100.0).unwrap();
        assert!((got - first).abs() < 1e-8, "{got}, not {first}");
        assert!(first_root(&c, first * 0.99).is_none());
    }
    assert!(first_root(&[1.0, 0.0, 1.0, 0.0, 1.0], 50.0).is_none());
}
