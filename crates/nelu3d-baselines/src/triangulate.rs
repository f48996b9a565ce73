//! From projector columns (and rows) to depth.

use nalgebra::Vector3;
use nelu3d_scan::pattern::Axis;
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::{Camera, Projector, Rig};
use rayon::prelude::*;

use super::captured::Captured;
use super::code::{AxisCode, Code, value_at};
use super::coordinates::DecodedCoordinates;
use super::error::DecodeError;
use super::options::DecodeOptions;
use nelu3d::color_field::ColorField;
use nelu3d::from_projector::crossing_depth;
use nelu3d::surface::{PixelStatus, SurfaceMaps};

/// Between which depths a surface is looked for.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct DepthRange {
    /// Nearest and farthest depth, mm.
    pub(super) mm: [f64; 2],
    source: RangeSource,
}

/// Where a depth range comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
enum RangeSource {
    /// The settings.
    Given,
    /// The volume of the set's color field.
    Field,
    /// A guess around the depth where light and view cross. A surface outside of it is no mistake.
    Guess,
}

impl DepthRange {
    /// Takes the range of the settings, of the set's color field, or a guess.
    pub(crate) fn new(
        rig: &Rig,
        set: &PatternSet,
        projector: &Projector,
        opts: &DecodeOptions,
    ) -> Result<Self, DecodeError> {
        match opts.depth.as_deref() {
            Some(&[near, far]) if near > 0.0 && far > near && far.is_finite() => {
                return Ok(Self { mm: [near, far], source: RangeSource::Given });
            }
            Some(_) => {
                let problem = "needs two distances in mm, 0 < NEAR < FAR".into();
                return Err(DecodeError::Setting { setting: "depth", problem });
            }
            None => {}
        }
        // A field that cannot be read is no reason to fail: nobody asked for it.
        let field = ColorField::load(&rig.root.join("fields").join(format!("{}.safetensors", set.name))).ok();
        if let Some(mm) = field.and_then(|f| depths(&f, &rig.camera)) {
            return Ok(Self { mm, source: RangeSource::Field });
        }
        let z = crossing_depth(&rig.camera, projector);
        Ok(Self { mm: [0.6 * z, 1.6 * z], source: RangeSource::Guess })
    }
}

/// Returns the smallest and the greatest depth of a field's volume, mm.
fn depths(field: &ColorField, camera: &Camera) -> Option<[f64; 2]> {
    let (v, mut range) = (&field.validity, [f64::INFINITY, 0.0f64]);
    for (i, t) in v.t_range.iter().enumerate().filter(|(_, t)| t[0] <= t[1]) {
        let middle = |k: usize| (k as f64 + 0.5) * v.shape.tile_px as f64;
        let z = camera.ray([middle(i % v.shape.tiles[0]), middle(i / v.shape.tiles[0])]).dir.z;
        range = [range[0].min(f64::from(t[0]) * z), range[1].max(f64::from(t[1]) * z)];
    }
    (range[0] > 0.0 && range[0] < range[1]).then_some(range)
}

/// Camera, projector, and between which depths a surface may be.
pub(crate) struct Geometry<'a> {
    projector: &'a Projector,
    /// Undistorted image-plane coordinates of every camera pixel.
    plane: &'a [[f32; 2]],
    rotation: nalgebra::Matrix3<f64>,
    translation: Vector3<f64>,
    pub(super) range: DepthRange,
}

/// The path of a camera pixel's ray along one axis of the projected image, from the far end (s = 0) to the near end (s
/// = 1) of the depth range; s is linear in inverse depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Along {
    /// At s = 0.
    pub(super) a: f32,
    /// At s = 1.
    pub(super) b: f32,
    p: f32,
    d: f32,
}

impl Along {
    /// Returns the projector coordinate at `s`, px.
    #[inline]
    pub(crate) fn at(&self, s: f32) -> f32 {
        (self.a + self.p * s) / (1.0 + self.d * s)
    }

    /// Returns the derivative of the projector coordinate by `s`.
    #[inline]
    pub(crate) fn slope(&self, s: f32) -> f32 {
        (self.p - self.a * self.d) / (1.0 + self.d * s).powi(2)
    }

    /// Returns the `s` of a projector coordinate.
    #[inline]
    pub(crate) fn inverse(&self, u: f32) -> f32 {
        (u - self.a) / (self.p - u * self.d)
    }
}

impl<'a> Geometry<'a> {
    /// Prepares for a projector, and the [`image_plane`](nelu3d::surface::image_plane) of the camera.
    pub(crate) fn new(projector: &'a Projector, plane: &'a [[f32; 2]], range: DepthRange) -> Self {
        Self {
            projector,
            plane,
            rotation: projector.proj_from_cam.rotation.to_rotation_matrix().into_inner(),
            translation: projector.proj_from_cam.translation.vector,
            range,
        }
    }

    /// Returns the projector pixel that lights the point of camera pixel `i` at inverse depth `w` (1/mm); `None` behind
    /// the projector.
    pub(crate) fn project(&self, i: usize, w: f64) -> Option<[f64; 2]> {
        let [x, y] = self.plane[i].map(f64::from);
        // The point divided by its depth: R d + w T, with d = (x, y, 1).
        let q = self.rotation * Vector3::new(x, y, 1.0) + self.translation * w;
        (q.z > 1e-9).then(|| {
            let o = &self.projector.optics;
            let [a, b] = o.distortion.distort([q.x / q.z, q.y / q.z]);
            [o.fx * a + o.cx, o.fy * b + o.cy]
        })
    }

    /// Returns where along an axis pixel `i` is lit from, between the far and the near end of the depth range; `None`
    /// where the light does not reach any of it.
    pub(crate) fn along(&self, i: usize, axis: Axis) -> Option<Along> {
        let [near, far] = self.range.mm;
        let [w0, w1] = [1.0 / far, 1.0 / near];
        let at = |w: f64| self.project(i, w).map(|p| p[axis as usize]);
        let (a, m, b) = (at(w0)?, at(0.5 * (w0 + w1))?, at(w1)?);
        // u(s) = (a + p s) / (1 + d s) through three points: exact without distortion, and with it off by far less than
        // a hundredth of a pixel.
        let d = if (m - b).abs() > 1e-9 { (a + b - 2.0 * m) / (m - b) } else { 0.0 };
        let p = b * (1.0 + d) - a;
        Some(Along { a: a as f32, p: p as f32, d: d as f32, b: b as f32 })
    }

    /// Returns the first and the last coordinate along a code's axis that may light pixel `i`, within the projected
    /// image.
    pub(crate) fn interval(&self, i: usize, code: &AxisCode) -> Option<[f32; 2]> {
        let along = self.along(i, code.axis)?;
        let (low, high) = (along.a.min(along.b), along.a.max(along.b));
        let (low, high) = (low.max(-0.5), high.min(code.len() as f32 - 0.5));
        (low <= high).then_some([low, high])
    }

    /// Returns the most projector px that one camera pixel's depth range spans along an axis.
    pub(crate) fn longest_interval(&self, axis: Axis) -> f32 {
        let step = (self.plane.len() / 1000).max(1);
        (0..self.plane.len())
            .step_by(step)
            .filter_map(|i| self.along(i, axis))
            .map(|a| (a.b - a.a).abs())
            .fold(0.0, f32::max)
    }

    /// Returns the inverse depth at which an undistorted projector would have pixel `i` at `at` along `axis`.
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

    /// Computes the depth from what is known of the projector pixel: with one coordinate, where the pixel's ray meets
    /// the plane of light of that column (exactly, with both lenses' distortions); with both, the point of the ray
    /// whose projection is nearest in the least-squares sense, each weighted by its variance. Gauss–Newton on the
    /// inverse depth.
    pub(crate) fn triangulate(&self, decoded: &DecodedCoordinates) -> SurfaceMaps {
        let [near, far] = self.range.mm;
        let one = |i: usize| -> (f32, f32, PixelStatus) {
            let none = |why| (f32::NAN, f32::NAN, why);
            if decoded.status[i] != PixelStatus::Valid {
                return none(decoded.status[i]);
            }
            let mut seen: [Option<(usize, f64, f64)>; 2] = [None; 2];
            for c in &decoded.coordinates {
                if c.at[i].is_finite() {
                    let sigma = f64::from(c.sigma[i]).max(1e-4);
                    seen[c.axis as usize] = Some((c.axis as usize, f64::from(c.at[i]), sigma));
                }
            }
            if seen.iter().flatten().count() < decoded.coordinates.len() {
                return none(PixelStatus::Ambiguous);
            }
            let step = 1e-3 / far.max(1.0);
            // How far the projection moves along each axis per inverse depth: start from the coordinate that tells
            // most.
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
                return none(PixelStatus::OutsideVolume);
            };
            let (mut information, mut off) = (0.0, 0.0);
            for _ in 0..8 {
                let Some((at, d)) = slopes(w) else { return none(PixelStatus::OutsideVolume) };
                let mut gradient = 0.0;
                (information, off) = (0.0, 0.0);
                for &(axis, seen, sigma) in seen.iter().flatten() {
                    let r = (seen - at[axis]) / sigma;
                    gradient += r * d[axis] / sigma;
                    information += (d[axis] / sigma).powi(2);
                    off += r * r;
                }
                if information <= 0.0 {
                    return none(PixelStatus::OutsideVolume);
                }
                let change = gradient / information;
                w += change;
                if change.abs() < 1e-9 * w.abs() {
                    break;
                }
            }
            let z = 1.0 / w;
            if !(z > 0.0 && z.is_finite()) || (self.range.source != RangeSource::Guess && !(near..=far).contains(&z)) {
                return none(PixelStatus::OutsideVolume);
            }
            // Column and row that contradict each other: one of them is wrong.
            if seen.iter().flatten().count() == 2 && off > MAX_MISFIT {
                return none(PixelStatus::Ambiguous);
            }
            (z as f32, (z * z / information.sqrt()) as f32, PixelStatus::Valid)
        };
        let n = decoded.status.len();
        let mut out = SurfaceMaps {
            depth: Vec::with_capacity(n),
            sigma: Vec::with_capacity(n),
            status: Vec::with_capacity(n),
            residual: Vec::new(),
            ambient: vec![f32::NAN; n],
        };
        let all: Vec<(f32, f32, PixelStatus)> = (0..decoded.status.len()).into_par_iter().map(one).collect();
        for (z, s, l) in all {
            out.depth.push(z);
            out.sigma.push(s);
            out.status.push(l);
        }
        out
    }

    /// Returns the RMS over the planes of captured minus projected intensity, at the projector pixel of each depth.
    pub(crate) fn residual(&self, depth: &[f32], code: &Code, captured: &Captured) -> Vec<f32> {
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

/// Returns which line of a code a plane shows, if any: that of its image and channel, gray lines for all channels.
pub(crate) fn line_of(code: &AxisCode, captured: &Captured, plane: usize) -> Option<usize> {
    let p = &captured.planes[plane];
    let of_image = code.lines.iter().filter(|l| l.image == p.image).count();
    code.lines.iter().position(|l| l.image == p.image && (of_image == 1 || l.channel == p.channel))
}
