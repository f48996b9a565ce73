use nelu3d::color_field::validity::{KnownAxes, Validity};

#[test]
fn lit_columns_are_extended_and_found_again_along_rays() {
    let mut v = Validity::new(16, 8, 8, [4, 1, 10]);
    v.add([3.0, 2.0], 500.0, [0.3, 0.5, 0.45]);
    v.extend([0.25, 0.65]);
    let ray = |px: [f64; 2]| move |t: f64| [if px[0] < 8.0 { 0.3 } else { 0.8 }, 0.5, (t / 1000.0) as f32];
    v.find_ranges([0.0, 1000.0], ray);
    let [near, far] = v.range(1, 1).unwrap();
    assert!((195.0..=201.0).contains(&near) && (699.0..=705.0).contains(&far), "{near} {far}");
    assert_eq!(v.range(9, 1), None);
    let ([near, far], known) = v.range_of_ray(1, 1, |t| ray([1.0, 1.0])(f64::from(t))).unwrap();
    assert!(known.is_all());
    assert!((near - 200.0).abs() < 1.0 && (far - 700.0).abs() < 1.0, "{near} {far}");
}

#[test]
fn what_is_known_along_one_axis_is_no_whole_codeword() {
    let mut v = Validity::new(8, 8, 8, [4, 1, 10]);
    v.axes = vec![0, 1];
    let [whole, along, across] = [0.1, 0.4, 0.6].map(|a| [a, 0.5, 0.45]);
    v.light(whole);
    v.light_along(whole, KnownAxes::only(0));
    v.light_along(along, KnownAxes::only(0));
    v.light_along(across, KnownAxes::only(1));
    v.extend([0.2, 0.8]);
    assert!(v.is_lit(whole) && v.known_at(whole).is_all());
    assert!(!v.is_lit(along) && v.known_at(along) == KnownAxes::only(0));
    assert!(v.known_at([0.4, 0.5, 0.25]).has(0) && !v.known_at([0.4, 0.5, 0.25]).has(1));
    assert!(v.known_at([0.4, 0.5, 0.95]).is_none());
    assert_eq!(v.lit_at_all().iter().filter(|l| **l == 1).count(), 3 * 7);
    // A ray keeps what is known all along it, and the whole codeword where that is known anywhere.
    let ray = |from: f32, to: f32| move |t: f32| [from + (to - from) * t / 1000.0, 0.5, 0.5];
    v.t_range = vec![[0.0, 1000.0]];
    let ([near, far], known) = v.range_of_ray(0, 0, ray(0.3, 0.45)).unwrap();
    assert!(known == KnownAxes::only(0) && near < 1.0 && far > 999.0, "{near} {far} {known:?}");
    assert_eq!(v.range_of_ray(0, 0, ray(0.3, 0.7)), None);
    let ([near, far], known) = v.range_of_ray(0, 0, ray(0.1, 0.4)).unwrap();
    assert!(known.is_all() && near < 1.0 && (far - 500.0).abs() < 2.0, "{near} {far} {known:?}");
}

#[test]
fn merged_volumes_have_seen_what_either_saw() {
    let samples =
        [([3.0, 2.0], 500.0, [0.1, 0.2, 0.3]), ([4.0, 5.0], 620.0, [0.9, 0.2, 0.8]), ([14.0, 5.0], 600.0, [0.5; 3])];
    let empty = || Validity::new(24, 16, 8, [4, 4, 2]);
    let (mut all, mut a, mut b, mut both) = (empty(), empty(), empty(), empty());
    for (i, (px, t, q)) in samples.into_iter().enumerate() {
        all.add(px, t, q);
        if i == 1 { &mut b } else { &mut a }.add(px, t, q);
    }
    // The second saw the ray of the first one's last sample, too, at another distance.
    b.add([14.0, 5.0], 640.0, [0.5, 0.5, 0.9]);
    all.add([14.0, 5.0], 640.0, [0.5, 0.5, 0.9]);
    both.add_position(&a);
    assert_ne!(both.lit, all.lit);
    both.add_position(&b);
    assert_eq!((&both.lit, &both.t_range), (&all.lit, &all.t_range));
    assert_eq!(both.range(4, 4), Some([500.0, 620.0]));
    let count = [[0.1, 0.2, 0.9], [0.9, 0.2, 0.1], [0.5, 0.5, 0.1], [0.9, 0.9, 0.9]].map(|q| both.positions_at(q));
    assert_eq!(count, [Some(1), Some(1), Some(2), None]);
    assert_eq!(all.positions_at([0.5; 3]), None);
    assert_eq!(all.fewest_positions_at([0.5; 3]), None);
    let mut wide = Validity::new(8, 8, 8, [3, 3, 1]);
    wide.positions = vec![9, 4, 9, 5, 8, 6, 9, 7, 9];
    let fewest = [[0.5, 0.5, 0.5], [0.1, 0.5, 0.5], [1.5, 0.5, 0.5]].map(|q| wide.fewest_positions_at(q));
    assert_eq!(fewest, [Some(4), Some(0), Some(0)]);
}
