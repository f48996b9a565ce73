use std::f64::consts::TAU;

use nelu3d_baselines::wave::learn;
use nelu3d_scan::pattern::{PhaseSolver, wrap_angle};
use nelu3d_scan::rig::PatternSet;

use crate::sinusoids::sinusoids;

#[test]
fn periods_and_phases_are_learned_from_eight_bit_images() {
    let set = PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() };
    let code = sinusoids(640, &[(640.0, 3), (16.25, 4), (80.0, 3), (15.9, 1)]);
    let groups = learn(&code, &set, "phase").unwrap();
    let expected = [(15.9, 1), (16.25, 4), (80.0, 3), (640.0, 3)];
    assert_eq!(groups.len(), 4);
    for (g, (period, steps)) in groups.iter().zip(expected) {
        assert_eq!(g.waves.len(), steps);
        assert!((g.period_px() / period - 1.0).abs() < 2e-3, "{} for {period}", g.period_px());
        for (i, w) in g.waves.iter().enumerate() {
            let off = wrap_angle((w.phase - TAU * i as f64 / steps as f64) as f32);
            assert!(off.abs() < 0.01, "{period}, step {i}: {off}");
        }
        assert_eq!(PhaseSolver::new(g).is_some(), steps >= 3);
    }
    let mut ramp = code;
    ramp.lines[2].values = (0..640).map(|u| u as f32 / 640.0).collect();
    let error = learn(&ramp, &set, "phase").unwrap_err().to_string();
    assert!(error.contains("p.png is not a sinusoid"), "{error}");
}
