use nelu3d_scan::board::print::outlines;

/// Whether a point is inside of an odd number of loops: a ray to the left.
fn inside(loops: &[Vec<[usize; 2]>], x: f64, y: f64) -> bool {
    let edges = loops.iter().flat_map(|l| (0..l.len()).map(move |i| (l[i], l[(i + 1) % l.len()])));
    let crossed = edges.filter(|(a, b)| {
        let (lo, hi) = (a[1].min(b[1]) as f64, a[1].max(b[1]) as f64);
        a[0] == b[0] && (a[0] as f64) < x && lo < y && y < hi
    });
    crossed.count() % 2 == 1
}

#[test]
fn the_inside_of_outlines_is_black() {
    let mut rng = crate::board::render::Gauss::new(5);
    for _ in 0..200 {
        let cells: Vec<bool> = (0..35).map(|_| rng.uniform() < 0.5).collect();
        let loops = outlines(7, 5, |c, r| cells[r * 7 + c]);
        for r in 0..5 {
            for c in 0..7 {
                assert_eq!(inside(&loops, c as f64 + 0.5, r as f64 + 0.5), cells[r * 7 + c], "{cells:?}");
            }
        }
        // Straight runs are one edge: every corner turns.
        for l in &loops {
            for i in 0..l.len() {
                let (a, b, c) = (l[i], l[(i + 1) % l.len()], l[(i + 2) % l.len()]);
                assert!((a[0] == b[0]) != (b[0] == c[0]), "{l:?}");
            }
        }
    }
}
