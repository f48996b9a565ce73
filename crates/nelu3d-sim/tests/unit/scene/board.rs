//! Boards of a sweep as rays meet them: bent and held.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::Ray;
use nelu3d_sim::Spec;
use nelu3d_sim::scene::{Hand, PrintedBoard, VirtualScene};
use nelu3d_sim::spec::{AxisSpec, BoardBendSpec, BoardCurlSpec};

fn printed(bend: Option<BoardBendSpec>) -> (PrintedBoard, Spec) {
    let spec = Spec { board_bend: bend, ..Spec::preset("color").unwrap() };
    (PrintedBoard::of_spec(&spec).unwrap(), spec)
}

/// Points of the board's print lie on the arc where the formulas of a circle put them, and keep their color.
#[test]
fn a_bent_board_is_an_arc_of_its_sagitta() {
    let (flat, spec) = printed(None);
    let [x0, y0, x1, y1] = spec.board.extent_mm();
    let pose = Isometry3::from_parts(Translation3::new(-80.0, -60.0, 700.0), UnitQuaternion::identity());
    for (axis, length) in [(AxisSpec::Y, x1 - x0), (AxisSpec::X, y1 - y0)] {
        for sagitta_mm in [3.0, -0.5] {
            let (bent, _) = printed(Some(BoardBendSpec { sagitta_mm, axis }));
            let scene = VirtualScene::of_board(&bent, &pose, &[]);
            let flat = VirtualScene::of_board(&flat, &pose, &[]);
            // Radius from the chord's formula, by a few steps: s = R (1 − cos(L / 2R)).
            let mut radius = length * length / (8.0 * sagitta_mm.abs());
            for _ in 0..50 {
                radius *= radius * (1.0 - (0.5 * length / radius).cos()) / sagitta_mm.abs();
            }
            for part in [-0.499, -0.3, -0.11, 0.0, 0.23, 0.499] {
                let (arc, across) = (part * length, 7.3);
                let (along, depth) =
                    (radius * (arc / radius).sin(), sagitta_mm.signum() * radius * (1.0 - (arc / radius).cos()));
                let on_board = |u: f64, z: f64| {
                    let (x, y) = if axis == AxisSpec::Y { (u, across) } else { (across, u) };
                    pose * Point3::new(0.5 * (x0 + x1) + x, 0.5 * (y0 + y1) + y, z)
                };
                let expected = on_board(along, depth);
                let look = |scene: &VirtualScene, p: Point3<f64>| {
                    let ray = Ray { origin: p - Vector3::z() * 300.0, dir: Vector3::z() };
                    scene.hit(&ray).unwrap()
                };
                let hit = look(&scene, expected);
                assert!((hit.point - expected).norm() < 1e-3, "{axis:?} {sagitta_mm} {part}: {}", hit.point);
                let print = look(&flat, on_board(arc, 0.0));
                assert_eq!(scene.albedo(&hit), flat.albedo(&print), "{axis:?} {sagitta_mm} {part}");
            }
        }
    }
}

/// A corner stands out toward the camera by what the spec says, half as far along the curl by a quarter of it, and the
/// others lie flat; the print is lifted, not moved.
#[test]
fn a_curled_corner_stands_out_as_far_as_it_is_said_to() {
    let (flat, spec) = printed(None);
    let [x0, y0, x1, y1] = spec.board.extent_mm();
    let curl = BoardCurlSpec { height_mm: 4.0, length_mm: 60.0 };
    let curled = PrintedBoard::of_spec(&Spec { board_curl: Some(curl), ..spec }).unwrap();
    let pose = Isometry3::from_parts(Translation3::new(-80.0, -60.0, 700.0), UnitQuaternion::identity());
    let [flat, curled] = [&flat, &curled].map(|board| VirtualScene::of_board(board, &pose, &[]));
    let corner = [x1 - x0, y1 - y0].map(|side| side / (x1 - x0).hypot(y1 - y0));
    // How far before the corner along the diagonal, and how high there.
    for (before, height) in [(1e-6, 4.0), (30.0, 1.0), (60.0, 0.0), (90.0, 0.0)] {
        let at = pose * Point3::new(x1 - before * corner[0], y1 - before * corner[1], 0.0);
        let ray = Ray { origin: at - Vector3::z() * 300.0, dir: Vector3::z() };
        let [hit, print] = [&curled, &flat].map(|scene| scene.hit(&ray).unwrap());
        assert!((at.z - hit.point.z - height).abs() < 1e-2, "{before}: {}", at.z - hit.point.z);
        assert_eq!(curled.albedo(&hit), flat.albedo(&print), "{before}");
    }
    for [x, y] in [[x0, y0], [x1, y0], [x0, y1]] {
        let at = pose * Point3::new(x.clamp(x0 + 1e-6, x1 - 1e-6), y.clamp(y0 + 1e-6, y1 - 1e-6), 0.0);
        let hit = curled.hit(&Ray { origin: at - Vector3::z() * 300.0, dir: Vector3::z() }).unwrap();
        assert!((at.z - hit.point.z).abs() < 1e-6);
    }
}

#[test]
fn a_hand_covers_the_board_from_its_edge_as_far_as_the_thumb_reaches() {
    let (flat, spec) = printed(None);
    let [x0, y0, x1, _] = spec.board.extent_mm();
    let pose = Isometry3::translation(-80.0, -60.0, 700.0);
    let origin = Translation3::new(0.5 * (x0 + x1), y0, 0.0);
    let hand = Hand { board_from_hand: origin.into(), size_mm: 50.0, albedo: [0.5; 3] };
    let scene = VirtualScene::of_board(&flat, &pose, &[hand]);
    let covered = |x: f64, y: f64| {
        let at = pose * (origin * Point3::new(x, y, 0.0));
        let ray = Ray { origin: at - Vector3::z() * 300.0, dir: Vector3::z() };
        scene.hit(&ray).unwrap().object != 0
    };
    // Along the thumb, beside it, beside its ball at the edge, and beyond its tip.
    assert!(covered(0.0, 1.0) && covered(0.0, 49.0) && covered(8.9, 35.0) && covered(-19.5, 0.5));
    assert!(!covered(0.0, 51.0) && !covered(9.1, 35.0) && !covered(20.5, 0.5));
    // It throws a shadow on the board, too.
    let beside = pose * (origin * Point3::new(12.0, 35.0, 0.0));
    let hit = scene.hit(&Ray { origin: beside - Vector3::z() * 300.0, dir: Vector3::z() }).unwrap();
    assert!(!scene.is_visible_from(&hit, &(beside + Vector3::new(-300.0, 0.0, -300.0))));
    assert!(scene.is_visible_from(&hit, &(beside + Vector3::new(300.0, 0.0, -300.0))));
}
