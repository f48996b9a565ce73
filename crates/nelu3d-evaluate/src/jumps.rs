//! Where a depth map jumps from one surface to another.

/// Factor of the local slope in the smallest step that counts as a jump.
const SLOPE_FACTOR: f32 = 3.0;
/// Factor of the width of a pixel on the surface in the smallest step that counts as a jump.
const FOOTPRINT_FACTOR: f32 = 2.0;
/// Number of steps on either side that the local slope is estimated from.
const REACH: usize = 3;

/// Marks both pixels of every horizontal or vertical neighbor pair whose depths lie on different surfaces.
///
/// No fixed threshold in mm would serve both a plate seen at 80° and the rim of a cup: the step between two neighbors
/// is held against the slope of the surfaces it would join, `3 · max(s_before, s_after) + 2 z/f`, with `s` the median
/// absolute step among the three pairs on that side (a median, so that a second jump nearby does not hide the first)
/// and `z/f` the width of one pixel at that depth. Depth that is not finite makes no jump: it is a silhouette.
///
/// `depth` is `height × width`, mm; `focal_px` the focal length. Returns `height × width`.
pub fn depth_jumps(depth: &[f32], width: usize, height: usize, focal_px: f64) -> Vec<bool> {
    assert_eq!(depth.len(), width * height, "depth map of another size");
    let mut jumps = vec![false; depth.len()];
    let footprint_per_mm = (1.0 / focal_px) as f32;
    for y in 0..height {
        mark_line(depth, y * width, 1, width, footprint_per_mm, &mut jumps);
    }
    for x in 0..width {
        mark_line(depth, x, width, height, footprint_per_mm, &mut jumps);
    }
    jumps
}

/// Marks the jumps along one row or column: `n` pixels from `start`, `stride` apart.
fn mark_line(depth: &[f32], start: usize, stride: usize, n: usize, footprint_per_mm: f32, jumps: &mut [bool]) {
    let steps: Vec<f32> = (1..n).map(|k| (depth[start + k * stride] - depth[start + (k - 1) * stride]).abs()).collect();
    for (k, &step) in steps.iter().enumerate() {
        let before = median_step(&steps[k.saturating_sub(REACH)..k]);
        let after = median_step(&steps[k + 1..steps.len().min(k + 1 + REACH)]);
        let (p, q) = (start + k * stride, start + (k + 1) * stride);
        let floor = FOOTPRINT_FACTOR * footprint_per_mm * depth[p].min(depth[q]);
        if step > SLOPE_FACTOR * before.max(after) + floor {
            jumps[p] = true;
            jumps[q] = true;
        }
    }
}

/// Returns the median of up to three steps, the lower of two; 0 when none is finite.
fn median_step(steps: &[f32]) -> f32 {
    let mut finite = [0.0; REACH];
    let mut n = 0;
    for &s in steps.iter().filter(|s| s.is_finite()) {
        finite[n] = s;
        n += 1;
    }
    finite[..n].sort_unstable_by(f32::total_cmp);
    if n == 0 { 0.0 } else { finite[(n - 1) / 2] }
}
