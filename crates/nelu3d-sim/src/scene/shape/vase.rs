//! A solid of revolution about the y axis. Its squared radius is a cubic spline of the height, so that a ray meets it
//! where a cubic polynomial is zero, found without any tolerance on missing roots.

use nalgebra::Vector3;
use nelu3d_scan::{Mesh, Ray};

use super::roots::first_crossing;
use super::spline::{cubic, natural_spline, substitute_linear};
use crate::scene::tessellation::{N_RINGS, close_with_discs, revolve};

/// A solid of revolution about the y axis, closed by discs. Heights grow toward −y; the foot is at y = 0.
#[derive(Clone, Debug)]
pub struct Vase {
    /// Heights of the knots, mm.
    heights: Vec<f64>,
    /// Squared radius between knots i and i + 1: Σ c_k (h − heights[i])^k, mm².
    pieces: Vec<[f64; 4]>,
    /// No radius is larger.
    max_radius: f64,
}

/// Steps per piece at which the spline is checked to stay off the axis.
const CHECKS: usize = 64;

impl Vase {
    /// Returns the vase through `[height, radius]` pairs, mm, or `None` where they make none: see
    /// [`ShapeSpec::Vase`](crate::spec::ShapeSpec::Vase).
    pub fn new(profile: &[[f64; 2]]) -> Option<Self> {
        let rising = profile.windows(2).all(|w| w[1][0] > w[0][0]);
        let good = profile.iter().all(|p| p[0].is_finite() && p[1] > 0.0 && p[1] < 1e6);
        if !rising || !good || !(2..=1000).contains(&profile.len()) {
            return None;
        }
        // The foot stands at the origin, whatever the first height is.
        let heights: Vec<f64> = profile.iter().map(|p| p[0] - profile[0][0]).collect();
        let squares: Vec<f64> = profile.iter().map(|p| p[1] * p[1]).collect();
        let pieces = natural_spline(&heights, &squares);
        let mut vase = Self { heights, pieces, max_radius: 0.0 };
        let smallest = profile.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        for i in 0..vase.pieces.len() {
            let length = vase.heights[i + 1] - vase.heights[i];
            for k in 0..=CHECKS {
                let square = cubic(&vase.pieces[i], length * k as f64 / CHECKS as f64);
                // Far from zero, not merely above it: nothing happens between two checks then.
                if square.is_nan() || square < 0.05 * smallest * smallest {
                    return None;
                }
                vase.max_radius = vase.max_radius.max(square.sqrt());
            }
        }
        // Between two checks the spline may rise a little higher.
        vase.max_radius *= 1.05;
        Some(vase)
    }

    fn height(&self) -> f64 {
        self.heights[self.heights.len() - 1]
    }

    /// Returns the squared radius, mm², and its slope, mm, at a height, mm.
    pub fn square(&self, h: f64) -> (f64, f64) {
        let i = self.heights.partition_point(|&k| k <= h).clamp(1, self.pieces.len()) - 1;
        let (c, x) = (&self.pieces[i], h - self.heights[i]);
        (cubic(c, x), c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]))
    }

    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let (start, end) = self.bounds(ray)?;
        let (start, end) = (start.max(0.0), end.min(limit));
        if start >= end {
            return None;
        }
        // From here on s = t − start: small numbers keep the polynomial exact far from the origin.
        let o = ray.at(start);
        let (h0, dh) = (-o.y, -ray.dir.y);
        let quadratic = [
            o.x * o.x + o.z * o.z,
            2.0 * (o.x * ray.dir.x + o.z * ray.dir.z),
            ray.dir.x * ray.dir.x + ray.dir.z * ray.dir.z,
        ];
        let f = |s: f64| quadratic[0] + s * (quadratic[1] + s * quadratic[2]) - self.square(h0 + s * dh).0;
        // A ray that enters through the foot's or the top's disc starts inside the solid.
        let through_disc = start > 0.0 && dh != 0.0 && f(0.0) < 0.0;
        if through_disc {
            return Some((start, Vector3::new(0.0, ray.dir.y.signum(), 0.0)));
        }
        // Walk the pieces in the ray's order.
        let inside = f(0.0) < 0.0;
        let mut s = 0.0;
        let length = end - start;
        let n = self.pieces.len();
        let first = self.heights.partition_point(|&k| k <= h0).clamp(1, n) - 1;
        // At a knot the ray is in the piece it goes to.
        let mut i = if dh < 0.0 && first > 0 && h0 <= self.heights[first] { first - 1 } else { first };
        loop {
            let knot = if dh > 0.0 { self.heights[i + 1] } else { self.heights[i] };
            let leaves = if dh == 0.0 { length } else { ((knot - h0) / dh).clamp(s, length) };
            let c = substitute_linear(&self.pieces[i], h0 - self.heights[i], dh);
            let poly = [quadratic[0] - c[0], quadratic[1] - c[1], quadratic[2] - c[2], -c[3]];
            if let Some(root) = first_crossing(&poly, s, leaves, inside) {
                let p = ray.at(start + root);
                let slope = self.square(-p.y).1;
                // The gradient of x² + z² − R(−y).
                return Some((start + root, Vector3::new(2.0 * p.x, slope, 2.0 * p.z).normalize()));
            }
            s = leaves;
            if s >= length || dh == 0.0 || (dh > 0.0 && i + 1 == n) || (dh < 0.0 && i == 0) {
                break;
            }
            i = if dh > 0.0 { i + 1 } else { i - 1 };
        }
        // A ray from inside leaves through a disc.
        (inside && end < limit).then(|| (end, Vector3::new(0.0, ray.dir.y.signum(), 0.0)))
    }

    /// Returns where the ray is within the heights and the largest radius.
    fn bounds(&self, ray: &Ray) -> Option<(f64, f64)> {
        let (o, d) = (ray.origin, ray.dir);
        let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
        if d.y == 0.0 {
            if -o.y < 0.0 || -o.y > self.height() {
                return None;
            }
        } else {
            let (a, b) = (-o.y / d.y, (-self.height() - o.y) / d.y);
            (start, end) = (a.min(b), a.max(b));
        }
        let a = d.x * d.x + d.z * d.z;
        if a > 1e-24 {
            let b = (o.x * d.x + o.z * d.z) / a;
            // The axis distance of the ray's nearest point, squared.
            let (x, z) = (o.x - b * d.x, o.z - b * d.z);
            let room = self.max_radius * self.max_radius - (x * x + z * z);
            if room < 0.0 {
                return None;
            }
            let half = (room / a).sqrt();
            (start, end) = (start.max(-b - half), end.min(-b + half));
        }
        (start < end).then_some((start, end))
    }

    /// Returns the surface as triangles, with `disc_rings` rings of them on each disc.
    pub(super) fn mesh(&self, disc_rings: usize) -> Mesh {
        let mut mesh = revolve(|i| {
            let h = self.height() * i as f64 / N_RINGS as f64;
            let (square, slope) = self.square(h);
            let r = square.sqrt();
            let n = Vector3::new(2.0 * r, slope, 0.0).normalize();
            [-h, r, n.y, n.x]
        });
        close_with_discs(&mut mesh, disc_rings);
        mesh
    }
}
