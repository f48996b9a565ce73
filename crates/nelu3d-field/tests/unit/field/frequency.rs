use crate::check::uniform_f32;
use nelu3d_field::encoding::frequency::{self, Frequency};
use nelu3d_field::field::{FieldError, FrequencyField, FrequencyFieldConfig};
use nelu3d_field::mlp;

fn points(seed: u64, n: usize) -> Vec<[f32; 3]> {
    uniform_f32(seed, 3 * n, 0.0, 1.0).as_chunks::<3>().0.to_vec()
}

fn small() -> FrequencyFieldConfig {
    FrequencyFieldConfig { n_frequencies: [5, 3, 1], width: 32, n_hidden_layers: 2, ..FrequencyFieldConfig::paper(2) }
}

#[test]
fn a_query_is_the_reference_network_of_the_reference_encoding() {
    let field = FrequencyField::new(small(), 3).unwrap();
    let mlp = field.config().build().unwrap();
    let points = points(1, 200);
    let mut out = vec![0.0; 2 * points.len()];
    field.query(&points, &mut out);
    for (x, y) in points.iter().zip(out.chunks_exact(2)) {
        let x = x.map(f64::from);
        let mut features = Vec::new();
        for (a, n) in small().n_frequencies.into_iter().enumerate() {
            let encoding = Frequency { n_frequencies: n };
            let mut all = vec![0.0; encoding.n_features(3)];
            frequency::reference::forward(encoding, x, &mut all);
            features.extend_from_slice(&all[2 * n * a..2 * n * (a + 1)]);
        }
        features.extend_from_slice(&x);
        let params: Vec<f64> = field.params().iter().map(|p| f64::from(*p)).collect();
        let mut exact = [0.0; 2];
        mlp::reference::forward(&mlp, &params, &features, &mut exact);
        for (a, b) in y.iter().zip(exact) {
            assert!((f64::from(*a) - b).abs() < 1e-5, "{a} {b}");
        }
    }
}

#[test]
fn it_learns_fringes() {
    let truth = |q: &[f32; 3]| [(14.0 * q[0]).sin(), (6.0 * q[1]).cos() * (0.5 + 0.5 * q[2])];
    let mut config = small();
    config.schedule.n_steps = 2000;
    let mut field = FrequencyField::new(config, 7).unwrap();
    let mut loss = 0.0;
    for step in 0..2000 {
        let p = points(100 + step, 1000);
        let t: Vec<f32> = p.iter().flat_map(truth).collect();
        loss = field.train_step(&p, &t, &[]);
    }
    field.finish_training();
    assert!(loss < 3e-3, "{loss}");
    let again = FrequencyField::from_params(field.config().clone(), field.params().to_vec()).unwrap();
    let p = points(5, 50);
    let (mut a, mut b) = (vec![0.0; 100], vec![0.0; 100]);
    field.query(&p, &mut a);
    again.query(&p, &mut b);
    assert_eq!(a, b);
}

#[test]
fn impossible_fields_are_refused() {
    let wide = FrequencyFieldConfig { width: 1000, ..small() };
    assert!(matches!(FrequencyField::new(wide, 1), Err(FieldError::Network(_))));
    let params = FrequencyField::new(small(), 1).unwrap().params().to_vec();
    assert!(FrequencyField::from_params(small(), params[1..].to_vec()).is_err());
    let many = FrequencyFieldConfig { n_frequencies: [usize::MAX; 3], ..small() };
    let mlp = many.build().unwrap();
    assert_eq!(FrequencyField::new(many, 1).unwrap().params().len(), mlp.n_params());
    assert_eq!(mlp.n_inputs, 3 * 2 * 24 + 3);
}
