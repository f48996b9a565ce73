use crate::check::{assert_close, uniform_f32};
use nelu3d_field::encoding::hash_grid::{self, HashGridConfig};
use nelu3d_field::field::{FieldError, HashField, HashFieldConfig, RegressionLoss};
use nelu3d_field::mlp;

fn tiny() -> HashFieldConfig<3> {
    let encoding = HashGridConfig {
        n_levels: 5,
        n_features_per_level: 2,
        log2_hashmap_size: 10,
        base_resolution: [4, 4, 3],
        finest_resolution: [40, 30, 3],
    };
    HashFieldConfig { encoding, width: 16, ..HashFieldConfig::small(3) }
}

fn points(seed: u64, n: usize) -> Vec<[f32; 3]> {
    uniform_f32(seed, 3 * n, 0.0, 1.0).as_chunks().0.to_vec()
}

fn smooth([x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        0.5 + 0.4 * (9.0 * x + 2.0 * z).sin(),
        (-(8.0 * (x - 0.5).powi(2) + 6.0 * (y - 0.4).powi(2))).exp(),
        x * y + 0.3 * z,
    ]
}

/// Random values instead of ±1e-4, so that nothing is near zero.
fn random(config: HashFieldConfig<3>) -> HashField<3> {
    let n = HashField::new(config.clone(), 1).unwrap().params().len();
    HashField::from_params(config, uniform_f32(5, n, -0.5, 0.5)).unwrap()
}

#[test]
fn query_and_jacobian_match_the_references() {
    let field = random(tiny());
    let (grid, mlp) = field.config().build().unwrap();
    let (table, network) = field.params().split_at(grid.n_params());
    let n_features = grid.n_features();
    for n in [0, 1, 95, 97, 4000] {
        let points = points(2, n);
        let (mut out, mut again) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        let mut jacobian = vec![[0.0; 3]; 3 * n];
        field.query(&points, &mut out);
        field.query_with_jacobian(&points, &mut again, &mut jacobian);
        assert_eq!(out, again);
        let (mut expected, mut expected_jacobian) = (vec![0.0; 3 * n], vec![[0.0; 3]; 3 * n]);
        for (p, &x) in points.iter().enumerate() {
            let mut features = vec![0.0; n_features];
            let mut slopes = vec![[0.0; 3]; n_features];
            hash_grid::reference::forward(&grid, table, x, &mut features);
            hash_grid::reference::jacobian(&grid, table, x, &mut slopes);
            mlp::reference::forward(&mlp, network, &features, &mut expected[3 * p..][..3]);
            for o in 0..3 {
                let mut d_out = [0.0; 3];
                d_out[o] = 1.0;
                let mut d_features = vec![0.0; n_features];
                let mut d_network = vec![0.0; network.len()];
                mlp::reference::backward(&mlp, network, &features, &d_out, &mut d_network, &mut d_features);
                for a in 0..3 {
                    expected_jacobian[3 * p + o][a] = d_features.iter().zip(&slopes).map(|(d, s)| d * s[a]).sum();
                }
            }
        }
        // Sums of 10, 16, 16 and 8 terms of order 1.
        let eps = 50.0 * f32::EPSILON;
        assert_close(&out, &expected, eps);
        // A ReLU within rounding of 0 may fall to the other side for a point in thousands.
        let far = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|i| (a[i] - b[i]).abs() > 100.0 * eps);
        assert!(jacobian.iter().zip(&expected_jacobian).filter(|&p| far(p)).count() <= n / 1000);
    }
}

/// The gradient of a whole step, seen through its first update: Adam's first step moves every parameter by
/// rate · g / (|g| + epsilon'), so a large epsilon makes it proportional to the gradient.
#[test]
fn train_step_follows_the_reference_gradient() {
    let mut config = tiny();
    let epsilon = 1e3;
    config.training.adam.epsilon = epsilon;
    config.training.schedule.n_warmup_steps = 0;
    config.training.encoding_learning_rate = 1e3;
    config.training.network_learning_rate = 1e3;
    config.training.loss = RegressionLoss::Huber { delta: 0.4 };
    let mut field = random(config.clone());
    let n = 1000;
    let points = points(3, n);
    let targets: Vec<f32> = points.iter().flat_map(|&x| smooth(x)).collect();
    let weights = uniform_f32(4, n, 0.5, 2.0);

    let (grid, mlp) = config.build().unwrap();
    let n_table = grid.n_params();
    let params: Vec<f64> = field.params().iter().map(|&p| p as f64).collect();
    let (table, network) = params.split_at(n_table);
    let mut gradient = vec![0.0; params.len()];
    let (d_table, d_network) = gradient.split_at_mut(n_table);
    let mut loss = 0.0;
    for (p, x) in points.iter().enumerate() {
        let x = x.map(|x| x as f64);
        let mut features = vec![0.0; grid.n_features()];
        hash_grid::reference::forward(&grid, table, x, &mut features);
        let mut out = [0.0; 3];
        mlp::reference::forward(&mlp, network, &features, &mut out);
        let mut d_out = [0.0; 3];
        for o in 0..3 {
            let r = out[o] - targets[3 * p + o] as f64;
            let (value, slope) =
                if r.abs() <= 0.4 { (r * r, 2.0 * r) } else { (0.8 * r.abs() - 0.16, 0.8 * r.signum()) };
            loss += weights[p] as f64 * value / (3 * n) as f64;
            d_out[o] = weights[p] as f64 * slope / (3 * n) as f64;
        }
        let mut d_features = vec![0.0; features.len()];
        mlp::reference::backward(&mlp, network, &features, &d_out, d_network, &mut d_features);
        hash_grid::reference::backward(&grid, x, &d_features, d_table);
    }

    let before = field.params().to_vec();
    let found = field.train_step(&points, &targets, &weights);
    assert!((found - loss).abs() < 1e-6 * loss, "{found} against {loss}");
    // The step is rate · g / (|g| + epsilon) with the moments' bias corrected away.
    for (i, g) in gradient.iter().enumerate() {
        let expected = -1e3 * g / (g.abs() + epsilon);
        let moved = (field.params()[i] - before[i]) as f64;
        // Moved parameters are rounded at their own size.
        assert!((moved - expected).abs() < 2e-6 + 1e-4 * expected.abs(), "{i}: {moved} against {expected}");
    }
    assert!(gradient.iter().any(|g| g.abs() > 1e-3), "gradients too small to test anything");
}

fn fit(n_steps: u64, config: HashFieldConfig<3>) -> HashField<3> {
    let mut field = HashField::new(config, 3).unwrap();
    for step in 0..n_steps {
        let points = points(100 + step, 2048);
        let targets: Vec<f32> = points.iter().flat_map(|&x| smooth(x)).collect();
        field.train_step(&points, &targets, &[]);
    }
    field
}

#[test]
fn learns_a_smooth_function_to_40_db() {
    let mut config = HashFieldConfig::small(3);
    config.encoding.finest_resolution = [32; 3];
    config.training.schedule.n_steps = 400;
    let field = fit(400, config);
    let points = points(1, 5000);
    let mut out = vec![0.0; 15_000];
    field.query(&points, &mut out);
    let truth: Vec<f32> = points.iter().flat_map(|&x| smooth(x)).collect();
    let mse = out.iter().zip(&truth).map(|(a, b)| ((a - b) as f64).powi(2)).sum::<f64>() / out.len() as f64;
    let psnr = -10.0 * mse.log10();
    assert!(psnr > 40.0, "PSNR {psnr:.1} dB");
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let train = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let field = fit(10, tiny());
            let mut out = vec![0.0; 3 * 5000];
            field.query(&points(9, 5000), &mut out);
            (field.params().to_vec(), out)
        })
    };
    let one = train(1);
    assert_eq!(one, train(2));
    assert_eq!(one, train(5));
}

#[test]
fn only_touched_entries_move() {
    let mut field = HashField::new(tiny(), 1).unwrap();
    let before = field.params().to_vec();
    field.train_step(&[[0.31, 0.52, 0.77]], &[1.0, 2.0, 3.0], &[]);
    let n_moved = (0..field.n_table_params()).filter(|&i| field.params()[i] != before[i]).count();
    // 5 levels × 8 corners × 2 features, less collisions.
    assert!((60..=80).contains(&n_moved), "{n_moved}");
}

#[test]
fn a_weight_of_zero_is_a_sample_left_out() {
    let (points, targets) = (points(1, 600), uniform_f32(2, 1800, 0.0, 1.0));
    let mut weights = vec![2.0; 600];
    weights[300..].fill(0.0);
    let (mut a, mut b) = (HashField::new(tiny(), 1).unwrap(), HashField::new(tiny(), 1).unwrap());
    let (mut loss_a, mut loss_b) = (0.0, 0.0);
    for _ in 0..2 {
        loss_a = a.train_step(&points, &targets, &weights);
        loss_b = b.train_step(&points[..300], &targets[..900], &[]);
    }
    assert!((loss_a - loss_b).abs() < 1e-5 * loss_b, "{loss_a} {loss_b}");
}

#[test]
fn parameters_round_trip() {
    let field = fit(3, tiny());
    let again = HashField::from_params(field.config().clone(), field.params().to_vec()).unwrap();
    let points = points(7, 100);
    let (mut a, mut b) = (vec![0.0; 300], vec![0.0; 300]);
    field.query(&points, &mut a);
    again.query(&points, &mut b);
    assert_eq!(a, b);
    assert_eq!((field.n_steps(), again.n_steps()), (3, 0));

    let mut short = field.params().to_vec();
    short.pop();
    let expected = short.len() + 1;
    assert_eq!(
        HashField::from_params(tiny(), short).unwrap_err(),
        FieldError::Length { expected, found: expected - 1 }
    );
    let mut broken = field.params().to_vec();
    broken[17] = f32::NAN;
    assert_eq!(HashField::from_params(tiny(), broken).unwrap_err(), FieldError::NotFinite { index: 17 });
}

#[test]
fn the_configuration_survives_serialization_and_prints_itself() {
    let config = tiny();
    let text = serde_json::to_string(&config).unwrap();
    assert_eq!(serde_json::from_str::<HashFieldConfig<3>>(&text).unwrap(), config);
    let wrong = text.replace("[4,4,3]", "[4,4]");
    assert!(serde_json::from_str::<HashFieldConfig<3>>(&wrong).unwrap_err().to_string().contains("expected 3 axes"));
    let unknown = text.replace("\"width\"", "\"widht\"");
    assert!(serde_json::from_str::<HashFieldConfig<3>>(&unknown).is_err());
    assert_eq!(config.to_string(), "hash grid 5x2 [4, 4, 3]..[40, 30, 3] 2^10 + mlp 2x16 -> 3");
}

#[test]
fn edge_cases_do_nothing() {
    let mut field = HashField::new(tiny(), 1).unwrap();
    let before = field.params().to_vec();
    field.query(&[], &mut []);
    assert_eq!(field.train_step(&[], &[], &[]), 0.0);
    assert_eq!(field.params(), before);
    assert!(HashField::new(HashFieldConfig { n_outputs: 0, ..tiny() }, 1).is_err());
}
