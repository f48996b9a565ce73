//! From projector columns (and rows) to depth.

use nalgebra::Vector3;
use nelu3d_scan::pattern::Axis;
use nelu3d_scan::{Camera, Projector};
use rayon::prelude::*;

use super::captured::Captured;
use super::code::{AxisCode, Code, value_at};
use super::{Decoded, Error};
use crate::calibrate::projector::crossing_depth;
use crate::result::Left;

/// Camera, projector, and between which depths a surface may be.
pub(super) struct Geometry<'a> {
    projector: &'a Projector,
    /// Undistorted image-plane coordinates of every camera pixel.
    plane: &'a [[f32; 2]],
    rotation: nalgebra::Matrix3<f64>,
    translation: Vector3<f64>,
    /// Depth range, mm.
    pub(super) range: [f64; 2],
    /// Whether somebody said so, or it is a guess.
    pub(super) range_given: bool,
}

/// Depth and its standard deviation, mm, NaN where there is none.
pub(super) struct Surface {
    pub(super) depth: Vec<f32>,
    pub(super) sigma: Vec<f32>,
    pub(super) left: Vec<Left>,
}

impl<'a> Geometry<'a> {
    /// Checks the depth range, or guesses one around where light and view cross.
    pub(super) fn new(
        camera: &Camera,
        projector: &'a Projector,
        plane: &'a [[f32; 2]],
        range: Option<&[f64]>,
    ) -> Result<Self, Error> {
        let given = match range {
            None => None,
            Some(&[near, far]) if near > 0.0 && far > near && far.is_finite() => Some([near, far]),
            Some(_) => {
                let problem = "needs two distances in mm, 0 < NEAR < FAR".into();
                return Err(Error::Setting { setting: "--depth", problem });
            }
        };
        let z = crossing_depth(camera, projector);
        Ok(Self {
            projector,
            plane,
            rotation: projector.proj_from_cam.rotation.to_rotation_matrix().into_inner(),
            translation: projector.proj_from_cam.translation.vector,
            range: given.unwrap_or([0.6 * z, 1.6 * z]),
            range_given: given.is_some(),
        })
    }

    /// Projector pixel that lights the point of camera pixel `i` at inverse depth `w` (1/mm); `None` behind the projector.
    pub(super) fn project(&self, i: usize, w: f64) -> Option<[f64; 2]> {
        let [x, y] = self.plane[i].map(f64::from);
        // The point divided by its depth: R d + w T, with d = (x, y, 1).
        let q = self.rotation * Vector3::new(x, y, 1.0) + self.translation * w;
        (q.z > 1e-9).then(|| {
            let o = &self.projector.optics;
            let [a, b] = o.distortion.distort([q.x / q.z, q.y / q.z]);
            [o.fx * a + o.cx, o.fy * b + o.cy]
        })
    }

    /// The inverse depth at which an undistorted projector would have pixel `i` at `at` along `axis`.
    fn start(&self, i: usize, axis: Axis, at: f64) -> f64 {
        let [x, y] = self.plane[i].map(f64::from);
        let d = self.rotation * Vector3::new(x, y, 1.0);
        let (o, t) = (&self.projector.optics, &self.translation);
        // (d + w t)_x = n (d + w t)_z
        match axis {
            Axis::X => {
                let n = (at - o.cx) / o.fx;
                (n * d.z - d.x) / (t.x - n * t.z)
            }
            Axis::Y => {
                let n = (at - o.cy) / o.fy;
                (n * d.z - d.y) / (t.y - n * t.z)
            }
        }
    }

    /// Depth from what is known of the projector pixel: with one coordinate, where the pixel's ray meets the plane of light
    /// of that column (exactly, with both lenses' distortions); with both, the point of the ray whose projection is nearest
    /// in the least-squares sense, each weighted by its variance. Gauss–Newton on the inverse depth.
    pub(super) fn triangulate(&self, decoded: &Decoded) -> Surface {
        let [near, far] = self.range;
        let one = |i: usize| -> (f32, f32, Left) {
            let none = |why| (f32::NAN, f32::NAN, why);
            if decoded.left[i] != Left::Kept {
                return none(decoded.left[i]);
            }
            let mut seen: [Option<(usize, f64, f64)>; 2] = [None; 2];
            for c in &decoded.coordinates {
                if c.at[i].is_finite() {
                    let sigma = f64::from(c.sigma[i]).max(1e-4);
                    seen[c.axis as usize] = Some((c.axis as usize, f64::from(c.at[i]), sigma));
                }
            }
            if seen.iter().flatten().count() < decoded.coordinates.len() {
                return none(Left::Ambiguous);
            }
            let step = 1e-3 / far.max(1.0);
            // How far the projection moves along each axis per inverse depth: start from the coordinate that tells most.
            let slopes = |w: f64| -> Option<([f64; 2], [f64; 2])> {
                let (a, b) = (self.project(i, w)?, self.project(i, w + step)?);
                Some((a, [(b[0] - a[0]) / step, (b[1] - a[1]) / step]))
            };
            let start = seen.iter().flatten().map(|&(axis, at, sigma)| {
                let w = self.start(i, if axis == 0 { Axis::X } else { Axis::Y }, at);
                let informs = slopes(w).map_or(0.0, |(_, d)| d[axis].abs() / sigma);
                (w, informs)
            });
            let Some((mut w, _)) = start.filter(|s| s.0.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1)) else {
                return none(Left::Outside);
            };
            let (mut information, mut off) = (0.0, 0.0);
            for _ in 0..8 {
                let Some((at, d)) = slopes(w) else { return none(Left::Outside) };
                let mut gradient = 0.0;
                (information, off) = (0.0, 0.0);
                for &(axis, seen, sigma) in seen.iter().flatten() {
                    let r = (seen - at[axis]) / sigma;
                    gradient += r * d[axis] / sigma;
                    information += (d[axis] / sigma).powi(2);
                    off += r * r;
                }
                if information <= 0.0 {
                    return none(Left::Outside);
                }
                let change = gradient / information;
                w += change;
                if change.abs() < 1e-9 * w.abs() {
                    break;
                }
            }
            let z = 1.0 / w;
            if !(z > 0.0 && z.is_finite()) || (self.range_given && !(near..=far).contains(&z)) {
                return none(Left::Outside);
            }
            // Column and row that contradict each other: one of them is wrong.
            if seen.iter().flatten().count() == 2 && off > MAX_MISFIT {
                return none(Left::Ambiguous);
            }
            (z as f32, (z * z / information.sqrt()) as f32, Left::Kept)
        };
        let mut out = Surface { depth: Vec::new(), sigma: Vec::new(), left: Vec::new() };
        let all: Vec<(f32, f32, Left)> = (0..decoded.left.len()).into_par_iter().map(one).collect();
        for (z, s, l) in all {
            out.depth.push(z);
            out.sigma.push(s);
            out.left.push(l);
        }
        out
    }

    /// RMS over the planes of captured minus projected intensity, at the projector pixel of each depth.
    pub(super) fn residual(&self, depth: &[f32], code: &Code, captured: &Captured) -> Vec<f32> {
        let pairs: Vec<(&AxisCode, usize, usize)> = code
            .axes
            .iter()
            .flat_map(|a| (0..captured.planes.len()).map(move |p| (a, p)))
            .filter_map(|(a, p)| line_of(a, captured, p).map(|l| (a, p, l)))
            .collect();
        let one = |i: usize| {
            if !depth[i].is_finite() {
                return f32::NAN;
            }
            let Some(at) = self.project(i, 1.0 / f64::from(depth[i])) else { return f32::NAN };
            let sum: f32 = pairs
                .iter()
                .map(|(a, p, l)| {
                    let c = value_at(&a.lines[*l].values, at[a.axis as usize] as f32);
                    (captured.planes[*p].p[i] - c).powi(2)
                })
                .sum();
            (sum / pairs.len() as f32).sqrt()
        };
        (0..depth.len()).into_par_iter().map(one).collect()
    }
}

/// Most χ² (one degree of freedom) of a column and a row that agree: five standard deviations.
const MAX_MISFIT: f64 = 25.0;

/// Which line of a code a plane shows, if any: that of its image and channel, gray lines for all channels.
pub(super) fn line_of(code: &AxisCode, captured: &Captured, plane: usize) -> Option<usize> {
    let p = &captured.planes[plane];
    let of_image = code.lines.iter().filter(|l| l.image == p.image).count();
    code.lines.iter().position(|l| l.image == p.image && (of_image == 1 || l.channel == p.channel))
}
