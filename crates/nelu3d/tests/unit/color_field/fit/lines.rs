use nelu3d::color_field::fit::Smoothness;
use nelu3d::color_field::fit::lines::Lines;

/// Channels with lines along a, along b, and equally smooth, with little and with much smoothness along w: the matrix
/// times the solution is the right side. Samples weigh the same along w, so that modes know them as they are.
#[test]
fn solves_every_channel_along_its_smoother_axis() {
    for nodes @ [na, nb, nw] in [[5, 40, 4], [301, 7, 4], [3, 3, 5]] {
        let k = 4;
        let n = na * nb * nw * k;
        let diag: Vec<f32> = (0..n).map(|i| ((i / k / nw * k + i % k) * 7919 % 1000) as f32 * 1e-3).collect();
        let r: Vec<f32> = (0..n).map(|i| (i * 104_729 % 1000) as f32 * 1e-3 - 0.5).collect();
        let lambda = [1.0, 2.0, 0.5, 1.0];
        let of_channels = vec![[30.0, 2.0, 1.0], [1.0, 50.0, 20.0], [3.0, 3.0, 0.0], [40.0, 1.0, 10.0]];
        let smooth = Smoothness { across: 0.3, along: 0.7, slope_along: 0.2, of_channels, defocus: None };
        let mut z = vec![f32::NAN; n];
        Lines::new(nodes, diag.clone(), &smooth, &lambda).solve(&r, &mut z);

        let mut product: Vec<f64> = vec![0.0; n];
        for i in 0..n {
            let [a, b, w] = smooth.of_channels[i % k].map(f64::from);
            let (lambda, at) = (f64::from(lambda[i % k]), [i / k / nw % na, i / k / nw / na, i / k % nw]);
            // Adds a strength times DᵀD z, with D the differences of `stencil` along an axis.
            let mut add = |axis: usize, strength: f64, stencil: &[f64]| {
                if at[axis] + stencil.len() <= nodes[axis] {
                    let of = |j: usize| i + j * [nw * k, na * nw * k, k][axis];
                    let sum: f64 = stencil.iter().enumerate().map(|(j, d)| d * f64::from(z[of(j)])).sum();
                    stencil.iter().enumerate().for_each(|(j, d)| product[of(j)] += lambda * strength * d * sum);
                }
            };
            let second = [1.0, -2.0, 1.0];
            add(if a > b { 0 } else { 1 }, 0.3 * a.max(b), &second);
            add(2, 0.7 * w, &second);
            add(2, 0.2 * w, &[-1.0, 1.0]);
            product[i] += f64::from(z[i]) * (f64::from(diag[i]) + lambda * (6.0 * 0.3 * a.min(b) + 1e-6));
        }
        for (i, (product, r)) in product.iter().zip(&r).enumerate() {
            assert!((product - f64::from(*r)).abs() < 1e-4, "{nodes:?} {i}: {product} {r}");
        }
    }
}

/// Lines of which no sample tells where they are: what the matrix asks for does not run away in rounding.
#[test]
fn lines_without_samples_stay_finite() {
    let nodes = [3, 1200, 4];
    let n = nodes.iter().product();
    // As strong as the smoothness of stripes along them is, with next to nothing across.
    let smooth = Smoothness {
        across: 3e-4,
        along: 3e-3,
        slope_along: 3e-4,
        of_channels: vec![[0.5, 1.2e7, 1.2e7]],
        defocus: None,
    };
    let r: Vec<f32> = (0..n).map(|i| ((i * 104_729 % 1000) as f32 - 499.5) * 1e-3).collect();
    let mut z = vec![f32::NAN; n];
    let mut diag = vec![0.0; n];
    diag[..12 * 100].fill(1.0);
    Lines::new(nodes, diag, &smooth, &[1.0]).solve(&r, &mut z);
    let product: f64 = r.iter().zip(&z).map(|(r, z)| f64::from(r * z)).sum();
    let worst = z.iter().fold(0.0f32, |worst, z| worst.max(z.abs()));
    assert!(product > 0.0 && worst < 1e6, "{product} {worst}");
}
