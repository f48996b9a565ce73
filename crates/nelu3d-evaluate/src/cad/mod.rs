//! A scan against a mesh of what was scanned: where the mesh lies in the camera's frame, and how far the scan is from it.
//!
//! The scan is one view of the part, with gaps, and maybe with other things around it. The pose is looked for by voting with
//! point pair features, from principal axes, and from rotations all over; every candidate is refined by robust iterated
//! closest points, and judged by what lies on the mesh and by what the camera would have seen through. [`Start`] says where to
//! begin instead.
//!
//! An alignment takes with it every error that a rigid motion of the part explains: a scan that is 1 mm too far away has no
//! bias after it. To see such errors too, give the pose ([`Start::Fixed`]).

mod error;
mod features;
mod icp;
mod pose;
mod sample;
mod score;
mod search;
mod starts;
mod surface;
mod table;
mod tree;

pub use error::CadError;
pub use pose::{pose_rows, read_pose};
pub use surface::{CadSurface, Closest};

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::{Camera, Mesh};
use rayon::prelude::*;

use super::{Errors, GroundTruth};
use nelu3d::progress::Progress;
use sample::Oriented;
use score::Score;
use search::Search;

/// Normals that differ by more are of different surfaces: cos 60°.
const NORMALS_AGREE_COS: f64 = 0.5;
/// Fewer points are no surface.
const FEWEST_POINTS: usize = 50;
/// Share of the diagonal of the mesh within which a point counts as on it, unless told.
const TOLERANCE_SHARE: f64 = 0.01;
/// A pose is believed when so much of the scan lies on the mesh, or so much of the visible mesh is there.
const BELIEVED_SHARE: f64 = 0.5;
/// ... and if no more of the mesh than this lies where the camera saw through.
const MOST_IN_FRONT: f64 = 0.15;
/// Ratios of size beyond which mesh and scan must be in different units: a scan may have much around the part, and a part
/// may be much larger than what the camera sees of it.
const UNIT_RATIOS: [f64; 2] = [1.0 / 150.0, 60.0];

/// A scan. Maps are `height × width` of the camera, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Camera z, mm; NaN where there is none.
    pub depth: &'a [f32],
    /// Unit normals that face the camera; derived from the depth when there are none.
    pub normals: Option<&'a [[f32; 3]]>,
}

/// Where to begin. Poses are `cam_from_cad`: from the mesh's frame, scaled, to the camera's, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Start {
    /// Anywhere.
    #[default]
    Search,
    /// At a guess, which is refined.
    Near(Isometry3<f64>),
    /// At the answer, which is taken as it is.
    Fixed(Isometry3<f64>),
}

/// How a scan is compared with a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CadOptions {
    /// Millimeters per unit of the mesh.
    pub scale: f64,
    /// Where to begin.
    pub start: Start,
    /// Distance from the mesh within which a point is of the part, mm; 1 % of the mesh's diagonal when `None`.
    pub within_mm: Option<f64>,
    /// Seed of all samples.
    pub seed: u64,
}

impl Default for CadOptions {
    fn default() -> Self {
        Self { scale: 1.0, start: Start::Search, within_mm: None, seed: 0 }
    }
}

/// What came out.
pub struct CadComparison {
    /// The numbers.
    pub metrics: CadMetrics,
    /// `cam_from_cad`.
    pub pose: Isometry3<f64>,
    /// Signed distance from the mesh of every pixel's point, mm: positive outside, or, where the mesh bounds nothing, on the
    /// camera's side. NaN where there is no depth, or nothing of the mesh within reach.
    pub distances: Vec<f32>,
    /// The mesh.
    pub surface: CadSurface,
}

/// How far a scan is from a mesh. Distances are signed as in [`CadComparison::distances`], mm.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CadMetrics {
    /// Rows of the matrix from the mesh's frame, after scaling, to the camera's, mm.
    pub cam_from_cad: [[f64; 4]; 4],
    /// Millimeters per unit of the mesh.
    pub scale: f64,
    /// Whether the pose was searched for or refined here, or taken as given.
    pub aligned: bool,
    /// Diagonal of the mesh's bounding box, mm.
    pub cad_diagonal_mm: f64,
    /// Whether the mesh bounds a volume, so that distances have an inside and an outside.
    pub closed: bool,
    /// Distance from the mesh within which a point is of the part, mm.
    pub within_mm: f64,
    /// Points of the scan.
    pub n_points: usize,
    /// Share of the points that are of the part.
    pub inliers: f64,
    /// Share of the mesh facing the camera, and not hidden behind what was measured, that the scan has: by samples.
    pub visible_found: f64,
    /// Share of the mesh facing the camera that lies before what was measured, which cannot be: by samples.
    pub in_front: f64,
    /// All points, whatever they are of.
    pub all: CadErrors,
    /// Points of the part: those within `within_mm`.
    pub part: CadErrors,
    /// The same without [`super::BODY_MARGIN_PX`] pixels next to silhouettes, gaps and depth jumps of the scan.
    pub body: CadErrors,
}

/// Signed distances of some points from the mesh.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CadErrors {
    /// Points.
    pub n: usize,
    /// Statistics, mm.
    pub distance_mm: Errors,
    /// Largest distance on either side, mm.
    pub max_mm: f64,
    /// Share of the points closer than 0.5 mm.
    pub under_half_mm: f64,
    /// Share of the points closer than 1 mm.
    pub under_1mm: f64,
}

impl CadErrors {
    fn of(distances: Vec<f64>) -> Self {
        let n = distances.len();
        let share = |limit: f64| super::ratio(distances.iter().filter(|d| d.abs() < limit).count(), n);
        let (under_half_mm, under_1mm) = (share(0.5), share(1.0));
        let max_mm = distances.iter().map(|d| d.abs()).fold(f64::NAN, f64::max);
        Self { n, distance_mm: Errors::of(distances), max_mm, under_half_mm, under_1mm }
    }
}

/// Compares a scan with a mesh.
///
/// # Errors
///
/// One of the two is empty, they are in different units, no pose explains the scan, or the work was cancelled.
///
/// # Panics
///
/// When maps and camera differ in size.
pub fn compare_with_cad(
    scan: &Scan<'_>,
    mesh: &Mesh,
    options: &CadOptions,
    progress: &Progress,
) -> Result<CadComparison, CadError> {
    let (width, height) = (scan.camera.width, scan.camera.height);
    assert_eq!(scan.depth.len(), width * height, "depth map and camera differ in size");
    assert!(scan.normals.is_none_or(|n| n.len() == width * height), "normal map and camera differ in size");
    progress.stage("prepare the mesh");
    let surface = CadSurface::new(mesh, options.scale).ok_or(CadError::EmptyMesh)?;
    // The scan as if it were a truth: its regions are those of what was measured.
    let mask: Vec<bool> = scan.depth.iter().map(|z| z.is_finite()).collect();
    let regions = GroundTruth { width, height, depth: scan.depth.to_vec(), mask }.regions(scan.camera);
    let own;
    let normals = match scan.normals {
        Some(normals) => normals,
        None => {
            own = smoothed(&regions.normals, width, height);
            &own
        }
    };
    let points: Vec<Oriented> = oriented(scan, normals);
    if points.len() < FEWEST_POINTS {
        return Err(CadError::EmptyScan { found: points.len(), needed: FEWEST_POINTS });
    }
    check_unit(&surface, &points)?;
    let tolerance = options.within_mm.unwrap_or(TOLERANCE_SHARE * surface.diagonal());
    let search = Search::new(&surface, scan, &points, tolerance, options.seed);
    let pose = match options.start {
        Start::Fixed(pose) => pose,
        Start::Near(pose) => {
            progress.stage("refine the pose");
            search.finish(&pose, 0.05 * surface.diagonal())
        }
        Start::Search => {
            progress.stage("find the pose");
            let pose = search.everywhere(progress).ok_or(CadError::Cancelled)?;
            progress.stage("refine the pose");
            search.finish(&pose, tolerance)
        }
    };

    progress.stage("measure distances");
    let distances = distances(scan, &surface, &pose);
    let score = search.score(&pose, tolerance);
    let finite = |keep: &dyn Fn(usize) -> bool| -> Vec<f64> {
        (0..distances.len()).filter(|&i| keep(i)).map(|i| f64::from(distances[i])).filter(|d| d.is_finite()).collect()
    };
    let of_part = |i: usize| f64::from(distances[i]).abs() <= tolerance;
    let part = CadErrors::of(finite(&of_part));
    let inliers = super::ratio(part.n, points.len());
    let believed = inliers.max(score.on) >= BELIEVED_SHARE && score.in_front <= MOST_IN_FRONT;
    if options.start == Start::Search && !believed {
        let Score { on, in_front, .. } = score;
        return Err(CadError::NoPose { on_mesh: inliers, on, in_front, tolerance_mm: tolerance });
    }
    let metrics = CadMetrics {
        cam_from_cad: pose_rows(&pose),
        scale: options.scale,
        aligned: !matches!(options.start, Start::Fixed(_)),
        cad_diagonal_mm: surface.diagonal(),
        closed: surface.closed(),
        within_mm: tolerance,
        n_points: points.len(),
        inliers,
        visible_found: score.explained,
        in_front: score.in_front,
        all: CadErrors::of(finite(&|_| true)),
        part,
        body: CadErrors::of(finite(&|i| of_part(i) && regions.body[i])),
    };
    Ok(CadComparison { metrics, pose, distances, surface })
}

impl CadSurface {
    /// Signed distance of a point of the camera's frame, mm, as in [`CadComparison::distances`].
    pub fn signed_distance(&self, cam_from_cad: &Isometry3<f64>, p: &Point3<f64>) -> f64 {
        let q = cam_from_cad.inverse_transform_point(p);
        let Some(c) = self.closest(&q, f64::MAX) else { return f64::NAN };
        if self.closed() {
            return c.distance;
        }
        if c.on_border {
            return f64::NAN;
        }
        let eye = cam_from_cad.inverse_transform_point(&Point3::origin());
        let same_side = c.normal.dot(&(q - c.point)) * c.normal.dot(&(eye - c.point)) >= 0.0;
        if same_side { c.distance } else { -c.distance }
    }
}

fn point_of(scan: &Scan<'_>, i: usize) -> Point3<f64> {
    let ray = scan.camera.ray([(i % scan.camera.width) as f64, (i / scan.camera.width) as f64]);
    ray.at(f64::from(scan.depth[i]) / ray.dir.z)
}

fn oriented(scan: &Scan<'_>, normals: &[[f32; 3]]) -> Vec<Oriented> {
    let one = |i: usize| {
        let [x, y, z] = normals[i].map(f64::from);
        let normal = Vector3::new(x, y, z).try_normalize(1e-6)?;
        (scan.depth[i].is_finite() && normal.x.is_finite()).then(|| Oriented { point: point_of(scan, i), normal })
    };
    (0..scan.depth.len()).into_par_iter().filter_map(one).collect()
}

/// Signed distance of every pixel's point.
fn distances(scan: &Scan<'_>, surface: &CadSurface, pose: &Isometry3<f64>) -> Vec<f32> {
    let distance = |i: usize| {
        if scan.depth[i].is_finite() { surface.signed_distance(pose, &point_of(scan, i)) as f32 } else { f32::NAN }
    };
    (0..scan.depth.len()).into_par_iter().map(distance).collect()
}

/// Means of normals over 5 × 5 pixels: those derived from depth alone are as noisy as its slope.
fn smoothed(normals: &[[f32; 3]], width: usize, height: usize) -> Vec<[f32; 3]> {
    let mean = |i: usize| {
        let (x, y) = (i % width, i / width);
        if !normals[i][0].is_finite() {
            return [f32::NAN; 3];
        }
        let mut sum = Vector3::zeros();
        for v in y.saturating_sub(2)..(y + 3).min(height) {
            for u in x.saturating_sub(2)..(x + 3).min(width) {
                let n = Vector3::from(normals[v * width + u]);
                if n.x.is_finite() {
                    sum += n;
                }
            }
        }
        sum.try_normalize(1e-6).map_or([f32::NAN; 3], |n| [n.x, n.y, n.z])
    };
    (0..normals.len()).into_par_iter().map(mean).collect()
}

fn check_unit(surface: &CadSurface, points: &[Oriented]) -> Result<(), CadError> {
    let (mut low, mut high) = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    for o in points {
        (low, high) = (low.inf(&o.point), high.sup(&o.point));
    }
    let (mesh_mm, scan_mm) = (surface.diagonal(), (high - low).norm());
    let ratio = mesh_mm / scan_mm;
    if (UNIT_RATIOS[0]..=UNIT_RATIOS[1]).contains(&ratio) {
        return Ok(());
    }
    // Of meters, centimeters and micrometers, the one that brings both closest.
    let nearest = |&f: &f64| (ratio * f).ln().abs();
    let suggestion = [1000.0, 10.0, 0.1, 0.001].into_iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    Err(CadError::Unit { mesh_mm, scan_mm, suggestion: suggestion.expect("a list of four") })
}

#[cfg(test)]
mod tests;
