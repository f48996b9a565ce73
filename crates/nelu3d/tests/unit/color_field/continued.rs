use nelu3d::color_field::Form;
use nelu3d::color_field::frame::Center;
use nelu3d::color_field::grid::Grid;
use nelu3d_scan::Camera;

use super::checkpoint::field;

/// A spline of two channels that changes along w by `slope` from node to node.
fn spline(slope: f32) -> Grid {
    let mut grid = Grid::new([3, 4, 2], 2);
    let [na, nb, nw] = grid.nodes();
    let of_node = |node: usize| {
        let [a, b, w] = [node / nw % na, node / nw / na, node % nw].map(|n| n as f32);
        [(0.9 * a + 1.7 * b).sin() + slope * w, (2.3 * a - 0.4 * b).cos() - slope * w]
    };
    grid.coeffs = (0..na * nb * nw).flat_map(of_node).collect();
    grid
}

/// Before and behind its box, a field carries along every ray of light what it carries in it, where that does not
/// change, and else nothing but what lies between what it carries at its ends.
#[test]
fn rays_of_light_carry_beyond_the_box_what_they_carry_in_it() {
    let camera = Camera::pinhole(20, 12, 30.0, 30.0, 9.5, 5.5);
    let distances = [280.0, 3000.0];
    for slope in [0.0, 0.1] {
        let grid = spline(slope);
        let field = field(Form::Grid(grid.clone()));
        let continued = field.continued(&grid, &camera, distances).unwrap();
        let of = continued.to_grid();
        let [mut found, mut first, mut last] = [[0.0f32; 2]; 3];
        // Points before, in, and behind the box.
        let mut tried = [0; 3];
        for [x, y] in (0..12).flat_map(|y| (0..20).map(move |x| [x, y])) {
            for t in [300.0, 450.0, 600.0, 660.0, 700.0, 740.0, 800.0, 1200.0, 2900.0] {
                let point = camera.ray([f64::from(x), f64::from(y)]).at(t);
                let Some((q, beyond)) = field.frame.to_unit(&point).zip(continued.frame.to_unit(&point)) else {
                    continue;
                };
                if !(0..2).all(|i| (0.0..=1.0).contains(&q[i])) || !(0.0..=1.0).contains(&beyond[2]) {
                    continue;
                }
                tried[usize::from(q[2] >= 0.0) + usize::from(q[2] > 1.0)] += 1;
                of.eval(beyond, &mut found);
                grid.eval([q[0], q[1], 0.0], &mut first);
                grid.eval([q[0], q[1], 1.0], &mut last);
                for ((found, first), last) in found.iter().zip(first).zip(last) {
                    let between = first.min(last) - 1e-5..=first.max(last) + 1e-5;
                    assert!(between.contains(found), "{q:?} {beyond:?}: {found} {between:?}");
                }
            }
        }
        assert!(tried.iter().all(|n| *n > 10), "{tried:?}");
    }
}

/// What was lit anywhere along a ray of light is, all along it, at all distances; rays of a camera carry nothing.
#[test]
fn what_was_lit_is_lit_all_along_the_ray() {
    let camera = Camera::pinhole(20, 12, 30.0, 30.0, 9.5, 5.5);
    let grid = spline(0.0);
    let mut field = field(Form::Grid(grid.clone()));
    let validity = field.continued(&grid, &camera, [280.0, 3000.0]).unwrap().validity;
    let lit: Vec<usize> = (0..validity.lit.len()).filter(|i| validity.lit[*i] == 1).collect();
    assert_eq!((validity.shape.cells, lit), ([2, 3, 1], vec![2]));
    assert!(validity.t_range.iter().all(|range| *range == [280.0, 3000.0]));
    field.metadata.center = Center::Camera;
    assert!(field.continued(&grid, &camera, [280.0, 3000.0]).is_none());
}
