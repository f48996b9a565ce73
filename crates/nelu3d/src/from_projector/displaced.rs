//! How far the boards of a sweep are from the field of a calibrated projector: what tells its calibration's errors.

use nalgebra::{Matrix3, Point3, Vector3};

use super::source::OnBoard;
use crate::calibrate::{Displacement, Sample};
use crate::color_field::ColorField;
use crate::reconstruct::Codeword;
use crate::verdict::{Code, Finding, Verdict};

/// Fewest boards whose scatter tells how much of their displacement is their own.
const MIN_BOARDS: usize = 3;

/// Standard errors of the boards' mean, and part of their distance, beyond which their displacement is no chance.
const SIGNIFICANT: f64 = 3.0;
const MIN_PART: f64 = 0.002;

/// How far the boards of a sweep are from the field.
pub(super) struct Displaced {
    /// Covariance, mm², of the displacement a + b x/z + c y/z, mm, along the ray through (x, y, z) that errors of the
    /// projector's calibration leave.
    pub(super) covariance: [[f64; 3]; 3],
    /// Mean displacement of the boards, mm along the rays; positive where the field has them farther away.
    mean_mm: f64,
    /// Standard error of that mean, from the boards' scatter, mm.
    error_mm: f64,
    /// Mean distance of the boards, mm.
    distance_mm: f64,
}

impl Displaced {
    /// Compares codewords of boards with the field; `None` if too few boards tell.
    ///
    /// A board is off from the field by the error of its own pose, which is another one at every position, and by the
    /// field's, which is the same. So the field's is the boards' mean, give or take what is left in it of their own
    /// errors: an n-th of their variance, and of what is no plane. Errors of the poses that all boards share are taken
    /// for the field's: boards do not tell these apart.
    pub(super) fn of(field: &ColorField, codewords: &[Codeword], at: &[OnBoard]) -> Option<Self> {
        let boards = displacements(field, codewords, at);
        if boards.len() < MIN_BOARDS {
            return None;
        }
        let n = boards.len() as f64;
        let mean = boards.iter().map(|d| d.plane).sum::<Vector3<f64>>() / n;
        let scatter: Matrix3<f64> = boards.iter().map(|d| (d.plane - mean) * (d.plane - mean).transpose()).sum();
        let mut covariance = mean * mean.transpose() + scatter / (n * (n - 1.0));
        covariance[(0, 0)] += boards.iter().map(|d| d.uneven_mm2).sum::<f64>() / (n * n);
        let mean_mm = boards.iter().map(|d| d.mm).sum::<f64>() / n;
        let squares: f64 = boards.iter().map(|d| (d.mm - mean_mm).powi(2)).sum();
        let error_mm = (squares / (n * (n - 1.0))).sqrt();
        let distance = |c: &Codeword| Vector3::from(c.point).norm();
        let distance_mm = codewords.iter().map(distance).sum::<f64>() / codewords.len() as f64;
        tracing::debug!(?mean, mean_mm, error_mm, boards = n, "boards' displacements");
        Some(Self { covariance: covariance.into(), mean_mm, error_mm, distance_mm })
    }

    /// Returns the warning that the boards are elsewhere, if they are.
    pub(super) fn finding(&self) -> Option<Finding> {
        let off = self.mean_mm.abs();
        (off > SIGNIFICANT * self.error_mm && off > MIN_PART * self.distance_mm).then(|| {
            let sentence = format!(
                "the sweep's boards stand {off:.1} mm off from where the projector's calibration has them, at {:.0} mm",
                self.distance_mm
            );
            let remedy = "calibrate the projector anew, or the camera, or use the field of the sweep, which needs no \
                          projector";
            Finding::new(Code::ProjectorDisagrees, Verdict::Doubtful, sentence, remedy)
                .with("off_mm", (100.0 * off).round() / 100.0)
        })
    }
}

/// The boards' displacements from the field along the rays.
fn displacements(field: &ColorField, codewords: &[Codeword], at: &[OnBoard]) -> Vec<Displacement> {
    let grid = field.to_grid();
    let (mut c, mut d) = (vec![0.0; grid.k], vec![0.0; grid.k]);
    let mut samples: Vec<Vec<Sample>> = Vec::new();
    for (codeword, at) in codewords.iter().zip(at) {
        let point = Point3::from(codeword.point);
        if field.frame.to_unit(&point).is_none_or(|q| q.iter().any(|q| !(0.0..=1.0).contains(q))) {
            continue;
        }
        let t = point.coords.norm();
        let m = field.frame.along_ray(&(point.coords / t)).at(t);
        grid.eval_along(m.q, m.dq, &mut c, &mut d);
        let h: f32 = d.iter().map(|d| d * d).sum();
        let g: f32 = d.iter().zip(c.iter().zip(&codeword.intensities)).map(|(d, (c, v))| d * (c - v)).sum();
        if h > 0.0 {
            let w = 1.0 / codeword.variance.max(f32::MIN_POSITIVE);
            let plane = [point.x / point.z, point.y / point.z];
            samples.resize_with(samples.len().max(at.position + 1), Vec::new);
            samples[at.position].push(Sample { g: w * g, h: w * h, plane, block: at.block });
        }
    }
    samples.iter().enumerate().filter_map(|(p, of_board)| Displacement::of(p, of_board)).collect()
}
