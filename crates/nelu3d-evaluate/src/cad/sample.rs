//! Points with normals: of the scan, and of the mesh.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3, Vector3};
use rand::rngs::StdRng;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};

use super::CadSurface;

/// Number of points below which a scan is no surface.
pub(super) const MIN_POINTS: usize = 50;

/// A point of a surface with its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OrientedPoint {
    /// The point, mm.
    pub(super) point: Point3<f64>,
    /// The unit normal.
    pub(super) normal: Vector3<f64>,
}

impl OrientedPoint {
    /// Applies a rigid motion.
    pub(super) fn transformed(&self, pose: &Isometry3<f64>) -> Self {
        Self { point: pose * self.point, normal: pose * self.normal }
    }
}

/// Picks one point of each cell of a cubic grid, about `spacing` mm apart, in random order.
pub(super) fn thinned(points: &[OrientedPoint], spacing: f64, seed: u64) -> Vec<OrientedPoint> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(&mut rng);
    let mut taken: HashMap<[i64; 3], ()> = HashMap::new();
    let cell = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c / spacing).floor() as i64);
    order.into_iter().map(|i| points[i]).filter(|o| taken.insert(cell(&o.point), ()).is_none()).collect()
}

/// Draws `n` random points of the mesh, evenly over its area.
pub(super) fn of_surface(surface: &CadSurface, n: usize, seed: u64) -> Vec<OrientedPoint> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut sum = 0.0;
    let sums: Vec<f64> = surface
        .areas()
        .iter()
        .map(|a| {
            sum += a;
            sum
        })
        .collect();
    (0..n)
        .map(|_| {
            let at = rng.random_range(0.0..1.0) * sum;
            let face = sums.partition_point(|&s| s <= at).min(sums.len() - 1);
            let ([a, b, c], normal) = surface.triangle(face);
            // Evenly over a triangle (Osada et al. 2002, Eq. 1).
            let (r, s) = (f64::sqrt(rng.random_range(0.0..1.0)), rng.random_range(0.0..1.0));
            OrientedPoint { point: a + (b - a) * (r * (1.0 - s)) + (c - a) * (r * s), normal }
        })
        .collect()
}
