//! The outline of cells of a grid.

/// Returns the outlines of the black cells of a grid: closed loops of grid corners [column, row], of which a point is
/// black that lies inside of an odd number. Straight runs are one edge.
///
/// Cells drawn one by one show hairlines between them in many viewers and printers; their common outline does not.
pub fn outlines(columns: usize, rows: usize, is_black: impl Fn(usize, usize) -> bool) -> Vec<Vec<[usize; 2]>> {
    let black =
        |c: i64, r: i64| c >= 0 && r >= 0 && c < columns as i64 && r < rows as i64 && is_black(c as usize, r as usize);
    // For each grid corner, the edges that leave it with black on their right: right, down, left, up.
    const STEPS: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    let leaves = |x: i64, y: i64, way: usize| {
        let [right, left] = match way {
            0 => [black(x, y), black(x, y - 1)],
            1 => [black(x - 1, y), black(x, y)],
            2 => [black(x - 1, y - 1), black(x - 1, y)],
            _ => [black(x, y - 1), black(x - 1, y - 1)],
        };
        right && !left
    };
    let mut used = vec![[false; 4]; (columns + 1) * (rows + 1)];
    let at = |x: i64, y: i64| y as usize * (columns + 1) + x as usize;
    let mut loops = Vec::new();
    for start in 0..(columns + 1) * (rows + 1) {
        let from = [(start % (columns + 1)) as i64, (start / (columns + 1)) as i64];
        for first in 0..4 {
            if used[start][first] || !leaves(from[0], from[1], first) {
                continue;
            }
            let (mut p, mut way, mut corners) = (from, first, Vec::new());
            loop {
                used[at(p[0], p[1])][way] = true;
                let next = [p[0] + STEPS[way][0], p[1] + STEPS[way][1]];
                // Right first: two cells that touch in a corner stay two loops.
                let turn = [1, 0, 3].into_iter().map(|t| (way + t) % 4).find(|&w| leaves(next[0], next[1], w));
                let turn = turn.expect("an outline goes on");
                if turn != way {
                    corners.push([next[0] as usize, next[1] as usize]);
                }
                (p, way) = (next, turn);
                if p == from && way == first {
                    break;
                }
            }
            loops.push(corners);
        }
    }
    loops
}
