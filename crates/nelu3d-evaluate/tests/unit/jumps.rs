use nelu3d_evaluate::depth_jumps;

fn marked(depth: &[f32]) -> Vec<usize> {
    let jumps = depth_jumps(depth, depth.len(), 1, 500.0);
    (0..depth.len()).filter(|&i| jumps[i]).collect()
}

#[test]
fn a_step_is_a_jump_and_a_crease_is_not() {
    assert_eq!(marked(&[500.0, 500.0, 500.0, 500.0, 510.0, 510.0, 510.0, 510.0]), [3, 4]);
    assert_eq!(marked(&[500.0, 500.0, 500.0, 500.0, 505.0, 510.0, 515.0, 520.0]), [0usize; 0]);
}

#[test]
fn a_second_jump_does_not_hide_the_first() {
    assert_eq!(marked(&[500.0, 500.0, 500.0, 480.0, 500.0, 500.0, 500.0]), [2, 3, 4]);
}

#[test]
fn holes_are_no_jumps() {
    assert_eq!(marked(&[500.0, 500.0, f32::NAN, 500.0, 500.0]), [0usize; 0]);
}
