use crate::check::{assert_close, uniform_f32};
use nelu3d_field::adam::{AdamConfig, MomentBuffers, Schedule, cpu, reference};

const N: usize = 1000;

#[test]
fn reference_follows_the_closed_form_for_a_constant_gradient() {
    // With g constant both bias-corrected moments are exactly g and g²: every step is the learning rate.
    let config = AdamConfig::default();
    let (mut p, mut first, mut second) = ([1.0f64, 1.0], [0.0; 2], [0.0; 2]);
    for t in 0..50 {
        reference::step(&config, 0.01, t, &mut p, &mut first, &mut second, &[3.0, -0.2]);
    }
    assert!((p[0] - 0.5).abs() < 1e-12 && (p[1] - 1.5).abs() < 1e-12, "{p:?}");
}

#[test]
fn cpu_matches_reference_over_many_steps() {
    let config = AdamConfig { epsilon: 1e-8, ..AdamConfig::default() };
    let start = uniform_f32(1, N, -1.0, 1.0);
    let (mut fast, mut slow) = (start.clone(), start.iter().map(|&x| x as f64).collect::<Vec<_>>());
    let (mut moments, mut first, mut second) = (MomentBuffers::new(N), vec![0.0f64; N], vec![0.0f64; N]);
    for t in 0..100 {
        let g = uniform_f32(2 + t, N, -1.0, 1.0);
        cpu::step(&config, 1e-2, t, &mut fast, moments.all(), &g);
        let g: Vec<f64> = g.iter().map(|&g| g as f64).collect();
        reference::step(&config, 1e-2, t, &mut slow, &mut first, &mut second, &g);
    }
    // 100 steps of at most ~1e-2, each with a few roundings of it and one of p.
    let slow: Vec<f32> = slow.iter().map(|&x| x as f32).collect();
    assert_close(&fast, &slow, 100.0 * f32::EPSILON);
}

#[test]
fn lazy_cpu_matches_reference_and_leaves_the_rest_alone() {
    let config = AdamConfig::default();
    for n in [0, 5, 16, 203 * 8, 203 * 8 + 3] {
        let start = uniform_f32(1, n, -1.0, 1.0);
        let (mut fast, mut slow) = (start.clone(), start.clone());
        let (mut moments, mut first, mut second) = (MomentBuffers::new(n), vec![0.0; n], vec![0.0; n]);
        let mut ever = vec![false; n];
        for t in 0..20u64 {
            let mut gradient = uniform_f32(10 + t, n, -1.0, 1.0);
            let mut touched = vec![0u8; n.div_ceil(16)];
            for (i, g) in gradient.iter_mut().enumerate() {
                if (i / 16 + t as usize * 13).is_multiple_of(11) && !i.is_multiple_of(5) {
                    touched[i / 16] = 1;
                    ever[i] = true;
                } else {
                    *g = 0.0;
                }
            }
            reference::step_lazy(&config, 1e-2, t, &mut slow, &mut first, &mut second, &gradient);
            cpu::step_lazy(&config, 1e-2, t, &mut fast, moments.all(), &mut gradient, &mut touched);
            assert!(touched.iter().all(|&mark| mark == 0) && gradient.iter().all(|&g| g == 0.0));
        }
        assert_close(&fast, &slow, 20.0 * f32::EPSILON);
        assert_close(&moments.first, &first, 20.0 * f32::EPSILON);
        assert_close(&moments.second, &second, 20.0 * f32::EPSILON);
        for (i, (a, b)) in fast.iter().zip(&start).enumerate() {
            assert_eq!(ever[i], a != b, "parameter {i}");
        }
    }
}

#[test]
fn schedule_warms_up_then_decays() {
    let s = Schedule { n_warmup_steps: 500, warmup_start: 0.01, n_steps: 10_000, final_factor: 0.1 };
    assert_eq!(s.factor(0), 0.01);
    assert!((s.factor(250) - 0.505).abs() < 1e-12);
    assert_eq!(s.factor(500), 1.0);
    assert!((s.factor(5250) - 0.1f64.sqrt()).abs() < 1e-12);
    assert!((s.factor(10_000) - 0.1).abs() < 1e-12 && s.factor(u64::MAX) == s.factor(10_000));
    let none = Schedule { n_warmup_steps: 0, n_steps: 0, ..s };
    assert!(none.factor(0).is_finite());
}
