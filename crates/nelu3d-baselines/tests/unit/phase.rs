use nelu3d_baselines::wave::learn;
use nelu3d_scan::pattern::{PhaseDecoder, WaveGroup, repeats_after};
use nelu3d_scan::rig::PatternSet;

use crate::sinusoids::sinusoids;

fn groups(parts: &[(f64, usize)]) -> Vec<WaveGroup> {
    let set = PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() };
    learn(&sinusoids(640, parts), &set, "phase").unwrap()
}

#[test]
fn a_code_repeats_after_its_beat() {
    assert!((repeats_after(&groups(&[(16.0, 3)]), 640.0).unwrap() - 16.0).abs() < 0.01);
    assert!(repeats_after(&groups(&[(16.0, 3), (640.0, 3)]), 640.0).is_none());
    // 16 and 20: 80.
    assert!((repeats_after(&groups(&[(16.0, 3), (20.0, 3)]), 640.0).unwrap() - 80.0).abs() < 0.1);
}

#[test]
fn every_column_comes_back_from_its_intensities() {
    let parts = [(18.0, 4), (60.0, 3), (640.0, 3)];
    let code = sinusoids(640, &parts);
    let groups = groups(&parts);
    let planes: Vec<Vec<f32>> = code.lines.iter().map(|l| l.values.clone()).collect();
    let decoder = PhaseDecoder::from_groups(&groups, 640).unwrap();
    for u in 0..640 {
        let found = decoder.decode_within(|image| planes[image][u], 0.0015, [-0.5, 639.5]).unwrap();
        // Eight bits: 1/255/√12 of noise over an amplitude of one half.
        assert!(
            found.is_reliable() && (found.column - u as f32).abs() < 0.03 && found.sigma < 0.03,
            "{found:?} for {u}"
        );
    }
    // The finest phase alone does not tell which period: none is invented.
    let finest = PhaseDecoder::from_groups(&groups[..1], 640).unwrap();
    let found = finest.decode_within(|image| planes[image][100], 0.0015, [-0.5, 639.5]);
    assert!(!found.unwrap().is_reliable());
}
