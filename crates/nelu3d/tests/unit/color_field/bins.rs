use nelu3d::color_field::bins::Bins;

#[test]
fn collections_fill_bins_as_single_samples_do() {
    let mut one_by_one = Bins::new([7, 40, 3], 2);
    let mut together = Bins::new([7, 40, 3], 2);
    let mut parts = vec![together.gathered(), together.gathered()];
    for i in 0..3000 {
        // Some lie outside the cube, and are ignored.
        let at = |step: f32| (i as f32 * step).fract() * 1.1 - 0.05;
        let (q, v, w) = ([at(0.618_034), at(0.754_878), at(0.569_84)], [at(0.3), at(0.7)], [1.0, (i % 3) as f32]);
        one_by_one.add(q, &v, &w);
        parts[i / 1500].push(q, &v, &w);
    }
    together.add_all(&parts);
    assert!(one_by_one.sums.iter().any(|s| *s > 0.0));
    assert_eq!(one_by_one.sums, together.sums);
}

#[test]
fn what_is_removed_leaves_the_others() {
    let (mut both, mut first) = (Bins::new([5, 20, 2], 2), Bins::new([5, 20, 2], 2));
    let mut parts = vec![both.gathered(), both.gathered()];
    for i in 0..400 {
        let at = |step: f32| (i as f32 * step).fract();
        let (q, v) = ([at(0.618_034), at(0.754_878), at(0.569_84)], [at(0.3), at(0.7)]);
        parts[(i % 3).min(1)].push(q, &v, &[1.0, 2.0]);
    }
    both.add_all(&parts);
    both.remove_all(&parts[1..]);
    first.add_all(&parts[..1]);
    for (a, b) in both.sums.iter().zip(&first.sums) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn merging_keeps_every_sum() {
    let mut bins = Bins::new([13, 29, 4], 2);
    for i in 0..2000 {
        let at = |step: f32| (i as f32 * step).fract();
        let q = [at(0.618_034), at(0.754_878), at(0.569_84)];
        bins.add(q, &[q[0], q[1] - q[2]], &[1.0 + q[2], 2.0]);
    }
    let totals = |bins: &Bins| {
        let mut t = [0.0f64; 6];
        bins.for_each_sample(|q, v, w| {
            let terms = [w[0], w[1], w[0] * v[0], w[1] * v[1], (w[0] + w[1]) * q[0], (w[0] + w[1]) * q[1]];
            t.iter_mut().zip(terms).for_each(|(t, x)| *t += f64::from(x));
        });
        t
    };
    let merged = bins.merged([4, 8, 4]);
    let mut n = 0;
    merged.for_each_sample(|_, _, _| n += 1);
    assert!(n <= 4 * 8 * 4 && n > 64, "{n}");
    for (a, b) in totals(&bins).into_iter().zip(totals(&merged)) {
        assert!((a - b).abs() < 1e-3 * a.abs().max(1.0), "{a} {b}");
    }
}
