//! What a pixel at an outline of the surface tells of the depth in its middle.
//!
//! A pixel there is filled in part, and its codeword is of the part that is: anywhere within half a pixel of its middle.
//! The optics spread half of that to the next one. On a surface that is seen at a grazing angle this is most of what
//! depth is off by.

use crate::surface::Links;

/// Distances from its middle, px, at which a pixel of the outline, and one beside such a pixel, may have been measured.
const DISTANCE: [f32; 2] = [0.5, 0.25];

/// Returns by how much depth may differ between where a pixel was measured and its middle, mm, one standard deviation;
/// 0 farther in, and where there is no surface. `depth` is `height × width`, mm; its `links` tell which neighbors are of
/// one surface.
pub fn sigma_of_place(depth: &[f32], links: &Links, width: usize) -> Vec<f32> {
    let n = depth.len();
    // Of pixels within the image, what they are linked to, and the largest step to one of these.
    let (mut linked, mut steps) = (vec![0u8; n], vec![0.0f32; n]);
    links.for_each(width, |i, j| {
        let step = (depth[j] - depth[i]).abs();
        for i in [i, j] {
            linked[i] += 1;
            steps[i] = steps[i].max(step);
        }
    });
    let beside = |at: usize, end: usize| [at.checked_sub(1), (at + 1 < end).then_some(at + 1)];
    let height = n / width;
    let is_outline = |i: usize| {
        let [x, y] = [i % width, i / width];
        let neighbors = beside(x, width).into_iter().chain(beside(y, height)).flatten().count();
        depth[i].is_finite() && usize::from(linked[i]) < neighbors
    };
    let outline: Vec<bool> = (0..n).map(is_outline).collect();
    let touches = |i: usize| {
        let [x, y] = [i % width, i / width];
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        rows.into_iter().any(|y| (x.saturating_sub(1)..(x + 2).min(width)).any(|x| outline[y * width + x]))
    };
    let distance = |i: usize| match depth[i].is_finite() {
        true if outline[i] => DISTANCE[0],
        true if touches(i) => DISTANCE[1],
        _ => 0.0,
    };
    (0..n).map(|i| distance(i) * steps[i]).collect()
}
