use nelu3d_scan::image::box_mean;

#[test]
fn is_the_mean_over_the_square() {
    // The second is as wide as what several threads share.
    for (w, h, radius) in [0, 1, 3, 6, 20].into_iter().flat_map(|r| [(13, 9, r), (530, 5, r)]) {
        let v: Vec<f32> = (0..w * h).map(|i| (i * 37 % 101) as f32).collect();
        let mut out = v.clone();
        box_mean(&mut out, w, h, radius);
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            let mut sum = 0.0;
            for yy in y.saturating_sub(radius)..(y + radius + 1).min(h) {
                for xx in x.saturating_sub(radius)..(x + radius + 1).min(w) {
                    sum += v[yy * w + xx];
                }
            }
            let side = (2 * radius + 1) as f32;
            assert!((out[i] - sum / (side * side)).abs() < 1e-3, "{w} × {h}, {radius}: {x} {y}");
        }
    }
}
