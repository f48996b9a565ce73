//! The pose of a mesh in a scan, from nothing or from a guess.

use nalgebra::Isometry3;
use nelu3d::Progress;
use nelu3d_scan::statistics::percentile;
use rayon::prelude::*;

use super::icp::{self, IcpSchedule};
use super::sample::{MIN_POINTS, OrientedPoint, of_surface, thinned};
use super::score::{PoseScore, score};
use super::{CadSurface, ScanMaps, features, starts};

/// Approximate number of points of the scan that the last refinement uses.
const FINAL_POINTS: usize = 20_000;

/// The mesh and the scan as samples, among which a pose is searched for.
pub(super) struct PoseSearch<'a> {
    pub(super) surface: &'a CadSurface,
    pub(super) scan: &'a ScanMaps<'a>,
    /// Points of the scan that may belong to the part.
    pub(super) points: Vec<OrientedPoint>,
    /// Samples of the mesh.
    pub(super) model: Vec<OrientedPoint>,
    /// Distance within which a point counts as on the mesh, mm.
    pub(super) tolerance: f64,
    pub(super) seed: u64,
}

impl<'a> PoseSearch<'a> {
    pub(super) fn new(
        surface: &'a CadSurface,
        scan: &'a ScanMaps<'a>,
        points: &'a [OrientedPoint],
        tolerance: f64,
        seed: u64,
    ) -> Self {
        let points = without_large_planes(points, surface.diagonal(), seed);
        Self { surface, scan, points, model: of_surface(surface, 3000, seed), tolerance, seed }
    }

    /// Scores how well a pose explains the scan.
    pub(super) fn score(&self, pose: &Isometry3<f64>, tolerance: f64) -> PoseScore {
        let points = thinned(&self.points, self.surface.diagonal() / 40.0, self.seed);
        let n = points.len().min(2000);
        score(self.surface, &self.model, self.scan, &points[..n], pose, tolerance)
    }

    /// Searches the whole space of poses; `None` when cancelled.
    pub(super) fn everywhere(&self, progress: &Progress) -> Option<Isometry3<f64>> {
        let diagonal = self.surface.diagonal();
        // A surface covers about (diagonal/spacing)² cells, and votes go with the square of that.
        let model = thinned(&self.model, diagonal / 22.0, self.seed);
        let scan = thinned(&self.points, diagonal / 22.0, self.seed + 1);
        let mut candidates = features::poses(&model, &scan, diagonal, 40);
        candidates.extend(starts::by_moments(&self.model, &scan));
        candidates.extend(starts::all_over(&self.model, &scan, 96, self.seed));

        // Rounds with ever fewer candidates, more points and a finer scale: [candidates kept, points, first and last
        // scale and tolerance as fractions of the diagonal, iterations].
        let rounds =
            [(14, 120, 0.08, 0.02, 0.03, 10), (4, 700, 0.03, 0.006, 0.015, 20), (1, 4000, 0.01, 0.002, 0.01, 30)];
        let fine = thinned(&self.points, diagonal / 100.0, self.seed + 2);
        for (round, (keep, n, first, last, tolerance, iterations)) in rounds.into_iter().enumerate() {
            if progress.cancelled() {
                return None;
            }
            progress.tick(round, rounds.len());
            let points = if round == 0 { &scan } else { &fine };
            let points = &points[..points.len().min(n)];
            let model = &self.model[..self.model.len().min(2 * n)];
            let schedule = IcpSchedule { first: first * diagonal, last: last * diagonal, shrink: 0.8, iterations };
            let mut tried: Vec<(f64, Isometry3<f64>)> = candidates
                .par_iter()
                .map(|start| {
                    let pose = icp::refine(self.surface, points, start, &schedule);
                    (score(self.surface, model, self.scan, points, &pose, tolerance * diagonal).cost(), pose)
                })
                .collect();
            tried.sort_by(|a, b| a.0.total_cmp(&b.0));
            candidates = distinct(&tried, 0.01 * diagonal, keep);
        }
        candidates.first().copied()
    }

    /// Refines a pose until it settles, with a robust scale from the residuals; `first` is the scale to begin with, mm.
    pub(super) fn refine(&self, start: &Isometry3<f64>, first: f64) -> Isometry3<f64> {
        let diagonal = self.surface.diagonal();
        let mut spacing = diagonal / 400.0;
        let mut points = thinned(&self.points, spacing, self.seed + 3);
        while points.len() > 2 * FINAL_POINTS {
            spacing *= 1.3;
            points = thinned(&points, spacing, self.seed + 3);
        }
        let mut pose = *start;
        let mut scale = first;
        // The scale settles after two rounds; the third is for the pose.
        for _ in 0..3 {
            let last = self.noise(&points, &pose).map_or(0.2 * self.tolerance, |s| 3.0 * s);
            let last = last.clamp(1e-5 * diagonal, self.tolerance.max(1e-5 * diagonal));
            let schedule = IcpSchedule { first: scale.max(last), last, shrink: 0.7, iterations: 40 };
            pose = icp::refine(self.surface, &points, &pose, &schedule);
            scale = last;
        }
        pose
    }

    /// Estimates the standard deviation of the distances of points on the mesh, robustly; `None` with too few of them.
    fn noise(&self, points: &[OrientedPoint], pose: &Isometry3<f64>) -> Option<f64> {
        let cad_from_cam = pose.inverse();
        let distance = |o: &OrientedPoint| {
            let c = self.surface.closest(&(cad_from_cam * o.point), self.tolerance)?;
            (!c.on_border).then_some(c.distance.abs())
        };
        let mut distances: Vec<f64> = points.par_iter().filter_map(distance).collect();
        (distances.len() > 10).then(|| 1.4826 * percentile(&mut distances, 50.0))
    }
}

/// Returns the points without the planes that are larger than any face of a part of this diagonal can be: walls and
/// tables, on which any flat face would lie well.
fn without_large_planes(points: &[OrientedPoint], diagonal: f64, seed: u64) -> Vec<OrientedPoint> {
    let spacing = diagonal / 22.0;
    let on = |plane: &OrientedPoint, o: &OrientedPoint| {
        plane.normal.dot(&(o.point - plane.point)).abs() < 0.02 * diagonal && plane.normal.dot(&o.normal) > 0.94
    };
    let mut left = points.to_vec();
    for _ in 0..8 {
        let sparse = thinned(&left, spacing, seed + 4);
        let size = |plane: &OrientedPoint| sparse.iter().filter(|&o| on(plane, o)).count();
        let Some((n, plane)) = sparse.iter().take(60).map(|p| (size(p), *p)).max_by_key(|s| s.0) else { break };
        // A face no wider than the diagonal has at most π/4 of its square; a slanted plane meets up to 1.8 times as
        // many cells as its area has squares.
        if n as f64 * spacing * spacing < 1.5 * diagonal * diagonal {
            break;
        }
        let rest: Vec<OrientedPoint> = left.iter().filter(|&o| !on(&plane, o)).copied().collect();
        // Where nothing else is, the part is flat itself.
        if rest.len() < MIN_POINTS {
            break;
        }
        left = rest;
    }
    left
}

/// Returns the best of each group of poses that are alike within `by` mm and 2°, at most `keep`.
fn distinct(tried: &[(f64, Isometry3<f64>)], by: f64, keep: usize) -> Vec<Isometry3<f64>> {
    let mut kept: Vec<Isometry3<f64>> = Vec::new();
    for (_, pose) in tried {
        let alike = |k: &Isometry3<f64>| {
            (k.translation.vector - pose.translation.vector).norm() < by
                && k.rotation.angle_to(&pose.rotation) < 2f64.to_radians()
        };
        if kept.len() < keep && !kept.iter().any(alike) {
            kept.push(*pose);
        }
    }
    kept
}
