use nelu3d::color_field::SplineEvaluator;
use nelu3d::color_field::grid::Grid;
use nelu3d::reconstruct::refine::band::quadrature;
use nelu3d::reconstruct::refine::bands::Bands;
use nelu3d_field::lattice::ProjectiveLine;

/// While a surface settles and its bands get narrow, what is rendered is what sampling every band anew gives.
#[test]
fn parabolas_are_as_good_as_samples() {
    for k in [3, 7] {
        let mut grid = Grid::new([40, 12, 3], k);
        for (i, c) in grid.coeffs.iter_mut().enumerate() {
            let (channel, a) = (i % k, i / k / 6 % 43);
            *c = 0.5 + 0.4 * (0.6 * a as f32 + channel as f32).sin();
        }
        let spline = SplineEvaluator::new(&grid, 1);
        let (w, h) = (18, 5);
        let active: Vec<bool> =
            (0..w * h).map(|i| i % w > 0 && i % w + 1 < w && i / w > 0 && i / w + 1 < h && i % 7 != 3).collect();
        // 0.7 cells per unit of the unknown.
        let line = |i: usize| ProjectiveLine {
            origin: [0.1 + 0.04 * (i % w) as f32, 0.2 + 0.1 * (i / w) as f32, 0.5],
            slope: [0.7 / 40.0, 0.001, 0.01],
            bend: 0.002,
        };
        let mut x: Vec<f32> = (0..w * h).map(|i| if active[i] { 0.1 * (i % 5) as f32 } else { 0.0 }).collect();
        let begin = x.clone();
        let mut bands = Bands::new(w, k, &active, &x, line);
        let mut rendered = vec![0.0; w * h * 2 * k];
        let mut jets = vec![0.0; 3 * k];
        let mut samples = Vec::new();
        for step in 0..12 {
            let width = 0.5 * 0.7f32.powi(step);
            let work = bands.render(&spline, &active, &x, |_| width, &mut rendered);
            samples.push(work.flops);
            for i in (0..w * h).filter(|i| active[*i]) {
                let mut expected = vec![0.0; 2 * k];
                for (offset, weight) in quadrature() {
                    spline.lattice().eval_jet(&line(i).at(x[i] - begin[i] - offset * width), &mut jets);
                    expected.iter_mut().zip(&jets).for_each(|(e, v)| *e += weight * v);
                }
                let found = &rendered[i * 2 * k..(i + 1) * 2 * k];
                for j in 0..k {
                    let (c, d) = ((found[j] - expected[j]).abs(), (found[k + j] - expected[k + j]).abs());
                    assert!(c < 2e-3 && d < 1e-2, "{k}, step {step}, pixel {i}: {c} {d}");
                }
            }
            x.iter_mut().enumerate().for_each(|(i, x)| *x += 0.4 * 0.5f32.powi(step) * (i as f32).sin());
        }
        // At the end hardly anything is evaluated any more.
        assert!(samples[11] < 0.2 * samples[0], "{samples:?}");
    }
}
