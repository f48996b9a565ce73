//! Where the light comes from, found from the sweep alone.
//!
//! Two board positions that the same ray of light meets show the same codeword. So the center of the light is the point
//! for which every sample of one position, carried along its ray of light to another position, finds its own codeword
//! there. This is solved by robust Gauss-Newton over a coarse search, with lever arms (distances between the two
//! positions) that grow as the center gets better. No model of the projector is involved but that its light is straight.

use nalgebra::{Matrix3, Point3, Vector3};
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::views::Views;
use crate::progress::Progress;

/// The light's center seen from the middle of the volume: a direction and an inverse distance (0 = at infinity).
#[derive(Clone, Copy, Debug)]
pub(super) struct LightCenter {
    /// Middle of the volume, mm.
    pub origin: Point3<f64>,
    /// Unit direction in which the light travels there.
    pub along: Vector3<f64>,
    /// One over the distance to the center, 1/mm.
    pub kappa: f64,
}

/// The views and the unknowns' units.
struct Transport<'a> {
    camera: &'a Camera,
    views: Views,
    origin: Point3<f64>,
    /// Typical distance from camera to volume, mm: the unit of inverse distances in the search.
    scale: f64,
}

/// A sample to carry: its position and its block.
#[derive(Clone, Copy)]
struct Seed {
    position: usize,
    index: usize,
    point: Point3<f64>,
}

/// The state of a light in the camera itself, and the strength of the pull towards it, as a share of the best determined
/// direction's information.
const HOME: State = [0.0, 0.0, 1.0];
const PULL: f64 = 1e-4;

/// Search state: two tangent offsets of the direction and `kappa · scale`.
type State = [f64; 3];

/// Finds the center of the light, or `None` when no center explains the codewords better than chance (or somebody stopped
/// the work).
pub(super) fn find_center(views: Views, camera: &Camera, progress: &Progress) -> Option<LightCenter> {
    let mut t = Transport { camera, views, origin: Point3::origin(), scale: 1.0 };
    let seeds = t.seeds();
    if seeds.len() < 200 {
        return None;
    }
    let mean = seeds.iter().map(|s| s.point.coords).sum::<Vector3<f64>>() / seeds.len() as f64;
    t.origin = Point3::from(mean);
    t.scale = mean.norm();

    // Coarse search: directions over the half sphere of lights in front of the board, a few distances.
    let base = mean.normalize();
    let few: Vec<Seed> = seeds.iter().copied().step_by((seeds.len() / 1500).max(1)).collect();
    let mut candidates = Vec::new();
    for i in -7i32..=7 {
        for j in -7i32..=7 {
            for kappa in [0.0, 0.6, 0.85, 1.1, 1.5] {
                let s = [f64::from(i) * 0.14, f64::from(j) * 0.14, kappa];
                if s[0].hypot(s[1]) < 1.1 {
                    candidates.push(s);
                }
            }
        }
    }
    let frame = Tangent::new(base, Vector3::x());
    let mut scored: Vec<(f64, State)> = candidates.into_par_iter().map(|s| (t.score(&few, &frame, s, 1), s)).collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.truncate(6);

    let last = (t.views.len() / 3).max(1);
    let (_, state) = scored
        .into_par_iter()
        .map(|(_, s)| {
            let s = [1, 2, 4].into_iter().filter(|a| *a <= last).fold(s, |s, arm| t.refine(&few, &frame, s, arm, 6).0);
            (t.score(&few, &frame, s, 2.min(last)), s)
        })
        .collect::<Vec<_>>()
        .into_iter()
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut best = (state, f64::INFINITY);
    let mut arm = 2;
    loop {
        if progress.cancelled() {
            return None;
        }
        // The longest arms decide; along what the patterns hardly tell, that takes more steps.
        best = t.refine(&seeds, &frame, best.0, arm.min(last), if arm >= last { 20 } else { 6 });
        if arm >= last {
            break;
        }
        arm *= 2;
    }
    let (along, kappa) = frame.direction(best.0);
    best.1.is_finite().then_some(LightCenter { origin: t.origin, along, kappa: kappa / t.scale })
}

/// A chart of directions around a base direction.
struct Tangent {
    base: Vector3<f64>,
    e1: Vector3<f64>,
    e2: Vector3<f64>,
}

impl Tangent {
    fn new(base: Vector3<f64>, right: Vector3<f64>) -> Self {
        let e1 = (right - base * right.dot(&base)).normalize();
        Self { base, e1, e2: base.cross(&e1) }
    }

    fn direction(&self, s: State) -> (Vector3<f64>, f64) {
        ((self.base + self.e1 * s[0].tan() + self.e2 * s[1].tan()).normalize(), s[2])
    }
}

impl Transport<'_> {
    /// An even selection of usable samples over all positions.
    fn seeds(&self) -> Vec<Seed> {
        let per_position = (120_000 / self.views.len()).max(200);
        let stride = (((self.views.width * self.views.height) / per_position) as f64).sqrt().max(1.0) as usize;
        let k1 = self.views.k + 1;
        (0..self.views.len())
            .into_par_iter()
            .flat_map_iter(|p| {
                let (n, d) = self.views.planes[p];
                let ys = (stride / 2..self.views.height).step_by(stride);
                ys.flat_map(move |y| (stride / 2..self.views.width).step_by(stride).map(move |x| (x, y))).filter_map(
                    move |(x, y)| {
                        let index = y * self.views.width + x;
                        if self.views.images[p][index * k1 + self.views.k] < 0.99 {
                            return None;
                        }
                        let ray = self.camera.ray(self.views.px(x, y));
                        let t = d / n.dot(&ray.dir);
                        (t > 0.0).then(|| Seed { position: p, index, point: ray.at(t) })
                    },
                )
            })
            .collect()
    }

    /// Carries a sample along its ray of light to position `to` and takes the difference of codewords there; false when
    /// it misses the board or the image.
    fn carry(&self, seed: &Seed, along: &Vector3<f64>, kappa: f64, to: usize, out: &mut [f64]) -> bool {
        let k = self.views.k;
        // Lines through the center o = origin − along/κ: direction ∝ κ (x − origin) + along.
        let v = (seed.point - self.origin) * (kappa / self.scale) + along;
        let (n, d) = self.views.planes[to];
        let denominator = n.dot(&v);
        if denominator.abs() < 1e-6 {
            return false;
        }
        let y = seed.point + v * ((d - n.dot(&seed.point.coords)) / denominator);
        let Some(px) = self.camera.project(&y) else { return false };
        let b = self.views.block as f64;
        let (x, y) = ((px[0] - (b - 1.0) / 2.0) / b, (px[1] - (b - 1.0) / 2.0) / b);
        if !(x >= 0.0 && y >= 0.0 && x < self.views.width as f64 - 1.0 && y < self.views.height as f64 - 1.0) {
            return false;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = (x - x0 as f64, y - y0 as f64);
        let image = &self.views.images[to];
        let base = (y0 * self.views.width + x0) * (k + 1);
        let down = base + self.views.width * (k + 1);
        let at = |c: usize| {
            let (top, bottom) = (
                f64::from(image[base + c]) * (1.0 - fx) + f64::from(image[base + k + 1 + c]) * fx,
                f64::from(image[down + c]) * (1.0 - fx) + f64::from(image[down + k + 1 + c]) * fx,
            );
            top * (1.0 - fy) + bottom * fy
        };
        if at(k) < 0.99 {
            return false;
        }
        let own = &self.views.images[seed.position][seed.index * (k + 1)..];
        for c in 0..k {
            out[c] = at(c) - f64::from(own[c]);
        }
        true
    }

    /// The position `arm` steps away, on the side where there is one.
    fn partner(&self, seed: &Seed, arm: usize) -> usize {
        let n = self.views.len();
        let up = seed.index.is_multiple_of(2);
        if (up && seed.position + arm < n) || seed.position < arm {
            (seed.position + arm).min(n - 1)
        } else {
            seed.position - arm
        }
    }

    /// Mean truncated squared difference of codewords; 1 is chance.
    fn score(&self, seeds: &[Seed], frame: &Tangent, s: State, arm: usize) -> f64 {
        let (along, kappa) = frame.direction(s);
        let mut r = vec![0.0; self.views.k];
        let (mut sum, mut hits) = (0.0, 0usize);
        for seed in seeds {
            if self.carry(seed, &along, kappa, self.partner(seed, arm), &mut r) {
                let e = r.iter().map(|r| r * r).sum::<f64>() / r.len() as f64;
                sum += (e / 0.02).min(1.0);
                hits += 1;
            }
        }
        let far = (0..3).map(|i| (s[i] - HOME[i]).powi(2)).sum::<f64>();
        if hits * 4 < seeds.len() { 2.0 } else { sum / hits as f64 + 10.0 * PULL * far }
    }

    /// Gauss-Newton with Cauchy weights; returns the state and the robust residual.
    fn refine(&self, seeds: &[Seed], frame: &Tangent, mut s: State, arm: usize, steps: usize) -> (State, f64) {
        const H: f64 = 1e-3;
        let k = self.views.k;
        let mut scale = f64::INFINITY;
        for _ in 0..steps {
            // Central differences: a one-sided slope shares its noise with the residual it is multiplied with, and that product has
            // a mean, which pushes the center away along everything that the patterns hardly tell.
            let probe = |i: usize| {
                let mut t = s;
                if i < 6 {
                    t[i / 2] += if i.is_multiple_of(2) { H } else { -H };
                }
                frame.direction(t)
            };
            let probes: [_; 7] = std::array::from_fn(probe);
            // Residual and Jacobian of every sample that lands under all probes.
            let rows: Vec<[f64; 4]> = seeds
                .par_chunks(512)
                .map(|chunk| {
                    let mut out = Vec::new();
                    let mut r = vec![vec![0.0; k]; 7];
                    for seed in chunk {
                        let to = self.partner(seed, arm);
                        if (0..7).all(|i| self.carry(seed, &probes[i].0, probes[i].1, to, &mut r[i])) {
                            out.extend((0..k).map(|c| {
                                let slope = |i: usize| (r[2 * i][c] - r[2 * i + 1][c]) / (2.0 * H);
                                [slope(0), slope(1), slope(2), r[6][c]]
                            }));
                        }
                    }
                    out
                })
                .collect::<Vec<_>>()
                .concat();
            if rows.len() < 100 {
                return (s, f64::INFINITY);
            }
            let mut abs: Vec<f64> = rows.iter().map(|r| r[3].abs()).collect();
            let mid = abs.len() / 2;
            scale = (abs.select_nth_unstable_by(mid, f64::total_cmp).1.max(1e-6)) * 1.4826;
            let (mut a, mut b) = (Matrix3::zeros(), Vector3::zeros());
            for row in &rows {
                let j = Vector3::new(row[0], row[1], row[2]);
                let w = 1.0 / (1.0 + (row[3] / (2.0 * scale)).powi(2));
                a += j * j.transpose() * w;
                b += j * (row[3] * w);
            }
            // Patterns that vary along one axis only leave the center free along the other: a faint pull to the camera
            // decides there, and is not felt elsewhere.
            let pull = a.diagonal().max() * PULL;
            for i in 0..3 {
                a[(i, i)] += pull;
                b[i] += pull * (s[i] - HOME[i]);
            }
            let Some(step) = a.try_inverse().map(|i| i * b) else { break };
            let limit = (0.1 / step.amax().max(1e-12)).min(1.0);
            for i in 0..3 {
                s[i] -= step[i] * limit;
            }
            if step.amax() < 1e-6 {
                break;
            }
        }
        (s, scale)
    }
}
