use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d::calibrate::BoardPlane;
use nelu3d_scan::pose::Bend;

#[test]
fn rays_hit_a_tilted_board_inside_its_outline_only() {
    let pose = Isometry3::new(Vector3::new(10.0, -5.0, 500.0), Vector3::new(0.2, -0.3, 0.1));
    let board = BoardPlane::new(&pose, [-50.0, -40.0, 50.0, 40.0], None);
    for (x, y, inside) in [(0.0, 0.0, true), (49.0, -39.0, true), (51.0, 0.0, false), (0.0, 41.0, false)] {
        let on = pose * Point3::new(x, y, 0.0);
        let hit = board.hit(&on.coords.normalize());
        assert_eq!(hit.is_some(), inside, "{x} {y}");
        assert!(hit.is_none_or(|t| (t - on.coords.norm()).abs() < 1e-9));
    }
    let behind = BoardPlane::new(&Isometry3::translation(0.0, 0.0, -500.0), [-50.0, -40.0, 50.0, 40.0], None);
    assert!(behind.hit(&Vector3::z()).is_none());
}

/// A board that was moved along the rays is met as much farther away as was said.
#[test]
fn boards_move_along_rays() {
    let pose = Isometry3::new(Vector3::new(10.0, -5.0, 500.0), Vector3::new(0.2, -0.3, 0.1));
    let mut board = BoardPlane::new(&pose, [-60.0, -40.0, 50.0, 45.0], None);
    let before = board;
    let mm = |[u, v]: [f64; 2]| 0.4 + 3.0 * u - 5.0 * v;
    board.move_by(&before.motion_along_rays(mm));
    for on in [[0.0, 0.0], [30.0, -20.0], [-45.0, 30.0], [40.0, 35.0]] {
        let dir = (pose * Point3::new(on[0], on[1], 0.0)).coords.normalize();
        let farther = board.hit(&dir).unwrap() - before.hit(&dir).unwrap();
        // Of a tilted board a linear function of (x/z, y/z) is a plane to first order.
        assert!((farther - mm([dir.x / dir.z, dir.y / dir.z])).abs() < 0.05, "{on:?}: {farther}");
    }
    assert!((board.axes[0].cross(&board.axes[1]) - board.normal).norm() < 1e-12);
}

#[test]
fn rays_meet_a_bent_board_where_its_print_is() {
    let pose = Isometry3::new(Vector3::new(10.0, -5.0, 500.0), Vector3::new(0.5, -0.6, 0.1));
    let bend = Bend::from_quadratic([5.0, 0.0], [4e-4, 1e-4, -2e-4]);
    let board = BoardPlane::new(&pose, [-50.0, -40.0, 50.0, 40.0], Some(bend));
    for printed in [[0.0, 0.0], [49.9, -39.9], [-49.9, 12.0], [30.0, 39.9]] {
        let on = pose * bend.point(printed);
        let t = board.hit(&on.coords.normalize()).unwrap();
        // The height is taken over the print's place, and here over the plane's, which are 10 µm apart.
        assert!((t - on.coords.norm()).abs() < 1e-3, "{printed:?}: {}", t - on.coords.norm());
    }
    let outside = pose * bend.point([50.1, 0.0]);
    assert!(board.hit(&outside.coords.normalize()).is_none());
}
