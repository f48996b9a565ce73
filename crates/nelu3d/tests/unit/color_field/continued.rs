use nelu3d::color_field::Form;
use nelu3d::color_field::frame::{Center, FieldFrame};
use nelu3d::color_field::grid::Grid;
use nelu3d_scan::Camera;

use super::checkpoint::field;

/// Before and behind its box, a field carries along every ray of light what it carries at that end of it; within, what
/// it does there, as finely as there are cells.
#[test]
fn rays_of_light_carry_beyond_the_box_what_they_carry_at_its_ends() {
    let mut grid = Grid::new([3, 4, 2], 2);
    let [na, nb, nw] = grid.nodes();
    let mut values = Vec::with_capacity(na * nb * nw * 2);
    for node in 0..na * nb * nw {
        let [a, b, w] = [node / nw % na, node / nw / na, node % nw].map(|n| n as f32);
        values.extend([(0.9 * a + 1.7 * b).sin() + 0.1 * w, (2.3 * a - 0.4 * b).cos() - 0.2 * w]);
    }
    grid.coeffs = values;
    let field = field(Form::Grid(grid.clone()));
    let camera = Camera::pinhole(20, 12, 30.0, 30.0, 9.5, 5.5);
    let continued = field.continued(&grid, &camera, [280.0, 3000.0]).unwrap();
    let of = continued.to_grid();
    // A spline's value at a place depends on what is two cells away.
    let span = |frame: &FieldFrame| (frame.hi[2] - frame.lo[2]) as f32;
    let reach = 2.0 * span(&continued.frame) / span(&field.frame) / of.cells[2] as f32;
    let (mut found, mut own) = ([0.0f32; 2], [0.0f32; 2]);
    let mut tried = [0; 3];
    for [x, y] in (0..12).flat_map(|y| (0..20).map(move |x| [x, y])) {
        for t in [300.0, 450.0, 600.0, 660.0, 700.0, 740.0, 800.0, 1200.0, 2900.0] {
            let point = camera.ray([f64::from(x), f64::from(y)]).at(t);
            let (Some(q), Some(beyond)) = (field.frame.to_unit(&point), continued.frame.to_unit(&point)) else {
                continue;
            };
            if !(0..2).all(|i| (0.0..=1.0).contains(&q[i])) || !(0.0..=1.0).contains(&beyond[2]) {
                continue;
            }
            of.eval(beyond, &mut found);
            grid.eval(q, &mut own);
            let far = if q[2] < -reach { 0 } else { 1 + usize::from(q[2] > 1.0 + reach) };
            tried[far] += 1;
            let limit = if far == 1 { 0.21 } else { 1e-5 };
            for (found, own) in found.iter().zip(own) {
                assert!((found - own).abs() <= limit, "{q:?} {beyond:?}: {found} {own}");
            }
        }
    }
    assert!(tried.iter().all(|n| *n > 10), "{tried:?}");
    // What was lit anywhere along a ray of light is, all along it.
    let lit: Vec<usize> = (0..continued.validity.lit.len()).filter(|i| continued.validity.lit[*i] == 1).collect();
    assert_eq!((continued.validity.shape.cells, lit), ([2, 3, 1], vec![2]));
    assert!(continued.validity.t_range.iter().all(|range| *range == [280.0, 3000.0]));
    // Rays of a camera carry nothing.
    let mut of_camera = field;
    of_camera.metadata.center = Center::Camera;
    assert!(of_camera.continued(&grid, &camera, [280.0, 3000.0]).is_none());
}
