use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::Camera;
use nelu3d_scan::board::Corner;
use nelu3d_scan::pose::{Bend, Flatness, TrajectoryModel};

type Detections = Vec<(String, Result<Vec<Corner>, String>)>;

/// Knuth's 64-bit linear congruential generator.
struct Lcg(u64);

impl Lcg {
    fn new(seed: u64) -> Self {
        Self(seed ^ 0x9e37_79b9_7f4a_7c15)
    }

    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n
    }
}

const OUTLINE: [f64; 4] = [0.0, 0.0, 240.0, 180.0];

/// The corners of a grid, bent, in hand-held poses, with an error of `noise` px, seen by a camera whose focal length
/// is `f` px where the detections' user believes 900.
fn seen(bend: Option<&Bend>, tilt: f64, noise: f64, f: f64) -> (Detections, Camera) {
    let truth = Camera::pinhole(640, 480, f, f, 320.0, 240.0);
    let mut random = Lcg::new(7);
    let mut uniform = move || random.below(2001) as f64 / 1000.0 - 1.0;
    let mut out = Vec::new();
    for position in 0..6 {
        let turn = Vector3::new(tilt * uniform(), tilt * uniform(), 0.1 * uniform());
        let shift = Vector3::new(-120.0 + 20.0 * uniform(), -90.0 + 20.0 * uniform(), 700.0 + 60.0 * uniform());
        let pose = Isometry3::new(shift, turn);
        let mut corners = Vec::new();
        for y in 1..9 {
            for x in 1..12 {
                let board_mm = [20.0 * x as f64, 20.0 * y as f64];
                let on = bend.map_or(Point3::new(board_mm[0], board_mm[1], 0.0), |b| b.point(board_mm));
                let px = truth.project(&(pose * on)).unwrap();
                corners.push(Corner { board_mm, px: [px[0] + noise * uniform(), px[1] + noise * uniform()] });
            }
        }
        out.push((position.to_string(), Ok(corners)));
    }
    (out, Camera::pinhole(640, 480, 900.0, 900.0, 320.0, 240.0))
}

#[test]
fn a_bent_board_is_found_with_its_poses() {
    for quadratic in [[1e-4, 0.0, 0.0], [0.0, 3e-5, -6e-5]] {
        let bend = Bend::from_quadratic([120.0, 90.0], quadratic);
        let (detections, camera) = seen(Some(&bend), 0.4, 0.1, 900.0);
        let trajectory = Flatness::fit(&detections, &camera, TrajectoryModel::Free, OUTLINE).unwrap();
        let flatness = trajectory.flatness.as_ref().unwrap();
        let truth = bend.sagittas_mm(OUTLINE);
        for i in 0..2 {
            let off = (flatness.sagitta_mm[i] - truth[i]).abs();
            assert!(off < 4.0 * flatness.sigma_mm[i] + 0.02, "{flatness:?}, {truth:?}");
        }
        assert!(flatness.bend.is_some(), "{flatness:?}");
        assert!(trajectory.rms_px.unwrap() < 0.09, "{:?}", trajectory.rms_px);
    }
}

#[test]
fn a_flat_board_is_not_bent_by_noise_or_a_wrong_lens() {
    for (tilt, noise, f) in [(0.4, 0.1, 900.0), (0.05, 0.1, 900.0), (0.4, 0.1, 903.0), (0.4, 0.001, 900.0)] {
        let (detections, camera) = seen(None, tilt, noise, f);
        let trajectory = Flatness::fit(&detections, &camera, TrajectoryModel::Free, OUTLINE).unwrap();
        let flatness = trajectory.flatness.unwrap();
        assert!(flatness.bend.is_none(), "{tilt} {noise} {f}: {flatness:?}");
    }
}

#[test]
fn corners_that_are_misread_alike_at_all_positions_are_no_bend() {
    let camera = Camera::pinhole(640, 480, 900.0, 900.0, 320.0, 240.0);
    for seed in 0..5 {
        let mut random = Lcg::new(seed);
        let mut uniform = move || random.below(2001) as f64 / 1000.0 - 1.0;
        let misread: Vec<[f64; 2]> = (0..48).map(|_| [0.1 * uniform(), 0.1 * uniform()]).collect();
        let detections: Detections = (0..12)
            .map(|position| {
                let pose = Isometry3::translation(-120.0, -90.0, 620.0 + 4.0 * f64::from(position));
                let corner = |i: usize| {
                    let board_mm = [26.0 * (1 + i % 8) as f64, 26.0 * (1 + i / 8) as f64];
                    let px = camera.project(&(pose * Point3::new(board_mm[0], board_mm[1], 0.0))).unwrap();
                    let noise = [0.02 * uniform(), 0.02 * uniform()];
                    Corner { board_mm, px: [0, 1].map(|k| px[k] + misread[i][k] + noise[k]) }
                };
                (position.to_string(), Ok((0..48).map(corner).collect()))
            })
            .collect();
        let trajectory = Flatness::fit(&detections, &camera, TrajectoryModel::Free, OUTLINE).unwrap();
        let flatness = trajectory.flatness.unwrap();
        assert!(flatness.bend.is_none(), "{seed}: {flatness:?}");
    }
}
