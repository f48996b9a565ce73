use nalgebra::{Point3, Vector3};
use nelu3d::color_field::frame::FieldFrame;
use nelu3d::color_field::grid::Grid;
use nelu3d::color_field::validity::Validity;
use nelu3d::color_field::{CameraRays, SplineEvaluator};
use nelu3d::progress::Progress;
use nelu3d::reconstruct::cost_volume::{DecodedDepth, decode};
use nelu3d::reconstruct::{CostVolumeSettings, LightFractionPrior};
use nelu3d::sensor::Measurements;
use nelu3d::surface::PixelStatus;
use nelu3d_field::device::Device;
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

use crate::color_field::camera_rays::rays_of_field;
use crate::sensor::measurements::mid_gray;

const SIZE: [usize; 2] = [56, 40];

/// A light 200 mm beside the camera that throws smooth random codewords, a slanted plane 600 mm away with a step in it,
/// holes, and a corner that was never calibrated.
struct SyntheticScene {
    measured: Measurements,
    rays: CameraRays,
    grid: Grid,
    valid: Validity,
    /// Inverse depth of the surface, 1/mm.
    expected: Vec<f32>,
}

const SETTINGS: CostVolumeSettings = CostVolumeSettings { max_hypotheses: 512, p_jump: 0.01, p_step: 0.2 };

const PRIOR: LightFractionPrior = LightFractionPrior { sigma_ambient: 0.05, sigma_indirect: 0.2 };

impl SyntheticScene {
    fn new(k: usize, cells_a: usize, seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let [w, h] = SIZE;
        let n = w * h;
        let plane: Vec<[f32; 2]> = (0..n)
            .map(|i| [(i % w) as f32 / w as f32 - 0.5, (i / w) as f32 / h as f32 - 0.5].map(|v| 0.4 * v))
            .collect();
        let mut frame = FieldFrame::around(Point3::new(200.0, -30.0, 20.0), Point3::new(0.0, 0.0, 610.0), Vector3::x());
        for [u, v] in &plane {
            let d = Vector3::new(f64::from(*u), f64::from(*v), 1.0);
            for z in [540.0, 680.0] {
                frame.enclose(&Point3::from(d * z));
            }
        }
        let mut grid = Grid::new([cells_a, 12, 3], k);
        grid.coeffs.iter_mut().for_each(|c| *c = rng.random_range(0.0..1.0));
        let mut valid = Validity::new(w, h, 8, [16, 16, 4]);
        for i in 0..n {
            let d = Vector3::new(f64::from(plane[i][0]), f64::from(plane[i][1]), 1.0);
            for z in (540..=680).step_by(4).filter(|_| i % w + i / w > 9) {
                let x = Point3::from(d * f64::from(z));
                let q = frame.to_unit(&x).unwrap();
                valid.add([(i % w) as f64, (i / w) as f64], x.coords.norm() as f32, q);
            }
        }
        let range = (0..n).map(|i| valid.range(i % w, i / w).unwrap_or([1.0, 0.0])).collect();
        let rays = rays_of_field(500.0, plane, range, frame);
        let mut measured = mid_gray(w, h, k);
        measured.has_black = !seed.is_multiple_of(2);
        let mut expected = vec![0.0; n];
        let spline = SplineEvaluator::new(&grid, 1);
        let mut c = vec![0.0; k];
        for i in 0..n {
            let (x, y) = ((i % w) as f32 / w as f32, (i / w) as f32 / h as f32);
            let z = if x < 0.55 { 590.0 + 40.0 * y } else { 640.0 - 20.0 * x };
            expected[i] = 1.0 / z;
            spline.eval(rays.in_frame(i).at(f64::from(z / rays.dir_z(i))).q, &mut c);
            for j in 0..k {
                let at = i * k + j;
                measured.p[at] = 0.97 * c[j] + 0.03 * measured.surround[at] + rng.random_range(-0.01..0.01);
                measured.inv_var[at] = if k > 2 && (i + j) % 19 == 0 { 0.0 } else { 1e4 };
            }
            if rng.random_range(0.0..1.0) < 0.06 || (20..24).contains(&(i / w)) && i % w > 40 {
                measured.status[i] = PixelStatus::Underexposed;
            }
        }
        Self { measured, rays, grid, valid, expected }
    }

    fn decode(&self, max_hypotheses: usize, device: &Device) -> (DecodedDepth, Vec<PixelStatus>) {
        let mut m = self.measured.clone();
        let settings = CostVolumeSettings { max_hypotheses, ..SETTINGS };
        let spline = SplineEvaluator::new(&self.grid, 1);
        let decoded = decode(&mut m, &self.rays, &spline, &self.valid, &settings, &PRIOR, device, &Progress::none());
        (decoded, m.status)
    }
}

/// Asserts that two decoded images agree but for rounding and pixels on the edge of two decisions.
#[cfg(feature = "gpu")]
fn assert_agree(
    what: &str,
    (a, status_a): &(DecodedDepth, Vec<PixelStatus>),
    (b, status_b): &(DecodedDepth, Vec<PixelStatus>),
) {
    assert_eq!(a.hypothesis_step, b.hypothesis_step);
    let decoded = a.inv_z.iter().filter(|v| v.is_finite()).count();
    assert!(decoded > a.inv_z.len() / 2, "{what}: {decoded}");
    let is_same = |i: &usize| {
        let (p, q) = (a.inv_z[*i], b.inv_z[*i]);
        status_a[*i] == status_b[*i] && (p.is_nan() && q.is_nan() || (p - q).abs() < 0.5 * a.hypothesis_step)
    };
    let same: Vec<usize> = (0..a.inv_z.len()).filter(is_same).collect();
    assert!(same.len() as f32 > 0.999 * a.inv_z.len() as f32, "{what}: {} of {}", same.len(), a.inv_z.len());
    for i in same.into_iter().filter(|i| a.inv_z[*i].is_finite()) {
        assert!((a.inv_z[i] - b.inv_z[i]).abs() < 0.02 * a.hypothesis_step, "{what}: pixel {i}");
        let (p, q) = (a.margin[i], b.margin[i]);
        assert!((p - q).abs() < 0.01 * p.max(1.0), "{what}: pixel {i}: margins {p} and {q}");
    }
}

#[test]
fn a_surface_with_a_step_is_decoded() {
    let scene = SyntheticScene::new(3, 40, 1);
    let (decoded, status) = scene.decode(512, &Device::Cpu);
    let (mut right, mut all) = (0, 0);
    for i in (0..status.len()).filter(|i| status[*i] == PixelStatus::Valid) {
        all += 1;
        right += usize::from((decoded.inv_z[i] - scene.expected[i]).abs() < 2.0 * decoded.hypothesis_step);
    }
    assert!(all > 1500 && right as f32 > 0.97 * all as f32, "{right} of {all}");
    assert!(status.contains(&PixelStatus::OutsideVolume));
}

#[cfg(feature = "gpu")]
mod on_gpu {
    use nelu3d::reconstruct::cost_volume::{depth_hypotheses, problem};
    use nelu3d_field::device::Choice;

    use super::*;

    /// Any GPU, a software driver if there is no other.
    fn gpu() -> Option<Device> {
        match Device::open(Choice::Gpu) {
            Ok(device) => Some(device),
            Err(e) => {
                assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "NELU3D_REQUIRE_GPU is set, but {e}");
                eprintln!("SKIPPED: decoding on a GPU: {e}");
                None
            }
        }
    }

    #[test]
    fn agrees_with_the_cpu() {
        let Some(device) = gpu() else { return };
        for k in [1, 3, 6, 8] {
            let scene = SyntheticScene::new(k, 40, k as u64);
            assert_agree(&format!("k = {k}"), &scene.decode(512, &Device::Cpu), &scene.decode(512, &device));
        }
    }

    #[test]
    fn what_is_too_large_for_it_is_decoded_on_the_cpu() {
        let Some(device) = gpu() else { return };
        // More hypotheses than a workgroup can share.
        let scene = SyntheticScene::new(1, 10_000, 1);
        let mut m = scene.measured.clone();
        let grid = SplineEvaluator::new(&scene.grid, 1);
        let hypotheses = depth_hypotheses(&mut m, &scene.rays, &grid, 4000).unwrap();
        assert!(hypotheses.count > 2000, "{}", hypotheses.count);
        let pixels: Vec<u32> = (0..m.n()).filter(|i| m.status[*i] == PixelStatus::Valid).map(|i| i as u32).collect();
        let e = problem::solve(
            &m,
            &scene.rays,
            &grid,
            &scene.valid,
            &SETTINGS,
            PRIOR.weights(&m),
            hypotheses,
            &pixels,
            &device,
        );
        assert!(matches!(e, Err(nelu3d_field::device::DeviceError::Memory { .. })), "{e:?}");
        let (cpu, fallen_back) = (scene.decode(4000, &Device::Cpu), scene.decode(4000, &device));
        let bits = |d: &DecodedDepth| d.inv_z.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert!(bits(&cpu.0) == bits(&fallen_back.0) && cpu.1 == fallen_back.1);
    }
}
