use nelu3d_baselines::gray::refine::{Crossing, fill, transposed};

#[test]
fn a_sloped_run_is_exact_between_crossings() {
    // u = 0.37 x + 3.2: crossings where u = k + 1/2.
    let u = |x: f32| 0.37 * x + 3.2;
    let crossings: Vec<Crossing> = (4..14)
        .map(|k| Crossing { position: (k as f32 + 0.5 - 3.2) / 0.37, border: k as f32 + 0.5, sigma: 0.05 })
        .collect();
    let (mut at, mut sigma) = (vec![0.0; 30], vec![0.0; 30]);
    fill(&mut at, &mut sigma, &crossings, 0, |x| [u(x as f32).round() as u16; 2]);
    for x in 0..30 {
        if (crossings[0].position..crossings[9].position).contains(&(x as f32)) {
            assert!((at[x] - u(x as f32)).abs() < 1e-4 && sigma[x] < 0.06, "{x}");
        } else {
            assert!((at[x] - u(x as f32)).abs() <= 0.5 && (sigma[x] - 0.2887).abs() < 1e-3, "{x}");
        }
    }
}

#[test]
fn transposing_goes_there_and_back() {
    let v: Vec<f32> = (0..12).map(|i| i as f32).collect();
    let t = transposed(&v, 4, 3);
    assert_eq!(t[..4], [0.0, 4.0, 8.0, 1.0]);
    assert_eq!(transposed(&t, 3, 4), v);
}
