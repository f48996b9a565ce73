//! Carrying codewords along rays of light from board to board.

use nalgebra::{Matrix2x3, Point3, Vector3};
use nelu3d_field::prefetch::prefetch;
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::super::views::{Level, Views};
use super::center::{Chart, HOME, LightCenter, Slope, State};

/// Strength of the pull towards the camera, as a share of the best determined direction's information.
pub(super) const PULL: f64 = 1e-4;
/// Squared difference of codewords, as a share of what two samples drawn by chance have, at which they do not agree at
/// all.
pub(super) const DISAGREEMENT: f64 = 0.6;

/// The views, and the chart of centers.
pub struct Transport<'a> {
    /// The camera, whose rays meet the boards.
    pub camera: &'a Camera,
    /// The views between which samples are carried.
    pub views: &'a Views,
    /// The chart of centers.
    pub chart: &'a Chart,
}

/// A sample to carry: its view, and its place in the image of a level.
#[derive(Clone, Copy)]
pub struct Seed {
    /// Index of the view (board position) that the sample was seen in.
    pub view: usize,
    /// Index of the sample in the level's image, row by row.
    pub index: usize,
    /// The point of the board that it shows, mm in the camera's frame.
    pub point: Point3<f64>,
    /// Derivative of its pixel by that point, px/mm; `None` where the camera's model has none.
    pub jacobian: Option<Matrix2x3<f64>>,
}

/// An even selection of about `n` samples of a level over all views, as far as they are usable. Where less than a
/// quarter of a view is, its samples are closer to each other.
pub fn seeds(camera: &Camera, views: &Views, level: &Level, n: usize) -> Vec<Seed> {
    let per_view = (n / views.count()).max(200);
    let k = views.k;
    let of_view = |(view, (normal, offset)): (usize, &(Vector3<f64>, f64))| {
        let mut out = Vec::new();
        let usable = level.images[view].chunks_exact(k + 1).filter(|s| s[k] >= level.min_validity).count();
        let area = (4 * usable).min(level.width * level.height);
        let stride = ((area / per_view) as f64).sqrt().max(1.0) as usize;
        for y in (stride / 2..level.height).step_by(stride) {
            for x in (stride / 2..level.width).step_by(stride) {
                let index = y * level.width + x;
                if level.images[view][index * (k + 1) + k] < level.min_validity {
                    continue;
                }
                let ray = camera.ray(level.px(x, y));
                let t = offset / normal.dot(&ray.dir);
                if t > 0.0 {
                    let point = ray.at(t);
                    let jacobian = camera.project_with_jacobian(&point).map(|(_, j)| j);
                    out.push(Seed { view, index, point, jacobian });
                }
            }
        }
        out
    };
    let of_views: Vec<Vec<Seed>> = views.planes.par_iter().enumerate().map(of_view).collect();
    of_views.concat()
}

/// A number that looks random, the same for the same seed.
pub(super) fn hash(seed: &Seed) -> usize {
    (seed.index as u32 ^ (seed.view as u32) << 24).wrapping_mul(2_654_435_761) as usize >> 7
}

/// A view that is not more than `arm` steps away from the seed's in depth, and no less than three quarters of it where
/// there is one.
pub fn partner(seed: &Seed, arm: usize, n: usize) -> usize {
    let (view, least) = (seed.view, arm - arm / 4);
    let before = (view.min(arm) + 1).saturating_sub(least);
    let behind = ((n - 1 - view).min(arm) + 1).saturating_sub(least);
    if before + behind == 0 {
        return if view > n - 1 - view { 0 } else { n - 1 };
    }
    let pick = hash(seed) % (before + behind);
    if pick < before { view - least - pick } else { view + least + pick - before }
}

/// A channel of a carried sample.
#[derive(Clone, Copy)]
pub struct Row {
    /// Derivative of the difference by the light's state, from slopes of codewords where the sample lands.
    pub there: Vector3<f64>,
    /// Derivative of the difference by the light's state, from slopes of codewords where the sample comes from. Their
    /// noise is neither that of the slopes where it lands nor that of the difference. `None` beside what is not usable.
    pub here: Option<Vector3<f64>>,
    /// Normalized intensity where it lands less that where it comes from.
    pub difference: f64,
}

/// The samples before and behind a sample along x and along y; `None` where one of them is not usable.
fn differences<'a>(level: &'a Level, seed: &Seed, k: usize) -> Option<[[&'a [f32]; 2]; 2]> {
    let (x, y, w) = (seed.index % level.width, seed.index / level.width, level.width);
    if x == 0 || y == 0 || x + 1 == w || y + 1 == level.height {
        return None;
    }
    let at = |i: usize| &level.images[seed.view][i * (k + 1)..][..k + 1];
    let both = [[at(seed.index - 1), at(seed.index + 1)], [at(seed.index - w), at(seed.index + w)]];
    both.iter().flatten().all(|s| s[k] >= level.min_validity).then_some(both)
}

/// Returns where the first of the four samples of a level around a pixel of the camera begins in an image of `k`
/// channels, and the place between the four along x and y, 0 to 1; `None` beside the image.
fn first_corner(px: [f64; 2], level: &Level, k: usize) -> Option<(usize, [f64; 2])> {
    let b = level.block as f64;
    let (x, y) = ((px[0] - (b - 1.0) / 2.0) / b, (px[1] - (b - 1.0) / 2.0) / b);
    if !(x >= 0.0 && y >= 0.0 && x < level.width as f64 - 1.0 && y < level.height as f64 - 1.0) {
        return None;
    }
    let (x0, y0) = (x as usize, y as usize);
    Some(((y0 * level.width + x0) * (k + 1), [x - x0 as f64, y - y0 as f64]))
}

/// Where a carried sample comes out in a view: four samples of a level, and their shares by distance and validity.
struct Landing<'a> {
    /// The view's image: `[pixel][channel, …, validity]`.
    image: &'a [f32],
    /// Where each of the four samples begins in the image.
    corners: [usize; 4],
    /// Bilinear shares of the four samples times their validity.
    weights: [f64; 4],
    /// One over the sum of the four weights.
    by_sum: f64,
    /// Place between the four samples along x and y, 0 to 1.
    place: [f64; 2],
}

impl<'a> Landing<'a> {
    /// Finds the four samples of a level of a view with `k` channels around a pixel of the camera; `None` where it
    /// misses the image, or what is valid there.
    fn at(px: [f64; 2], level: &'a Level, view: usize, k: usize) -> Option<Self> {
        let (base, [fx, fy]) = first_corner(px, level, k)?;
        let image = &level.images[view][..];
        let down = base + level.width * (k + 1);
        let corners = [base, base + k + 1, down, down + k + 1];
        let places = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        let mut weights = [0.0; 4];
        for i in 0..4 {
            weights[i] = places[i] * f64::from(image[corners[i] + k]);
        }
        let sum: f64 = weights.iter().sum();
        let is_valid = sum >= f64::from(level.min_validity);
        is_valid.then(|| Self { image, corners, weights, by_sum: 1.0 / sum, place: [fx, fy] })
    }

    /// Returns the interpolated normalized intensity of a channel.
    fn value(&self, c: usize) -> f64 {
        (0..4).map(|i| self.weights[i] * f64::from(self.image[self.corners[i] + c])).sum::<f64>() * self.by_sum
    }

    /// Returns the derivatives of the four weights by the place along x and along y, per pixel of the level.
    fn weight_slopes(&self, k: usize) -> [[f64; 4]; 2] {
        let [fx, fy] = self.place;
        let places = [[fy - 1.0, 1.0 - fy, -fy, fy], [fx - 1.0, -fx, 1.0 - fx, fx]];
        places.map(|p| std::array::from_fn(|i| p[i] * f64::from(self.image[self.corners[i] + k])))
    }
}

/// Where the ray of light of a sample meets another board.
struct Met {
    /// The view of that board.
    view: usize,
    /// Where, mm in the camera's frame.
    point: Point3<f64>,
    /// Direction of the light there, of any length.
    v: Vector3<f64>,
    /// How many of it lie between the sample and the board.
    length: f64,
    /// The pixel that sees it.
    px: [f64; 2],
    /// Derivative of the pixel by the point, px/mm.
    jacobian: Matrix2x3<f64>,
}

impl Transport<'_> {
    /// Carries a sample along its ray of light to the view `to` and takes the difference of codewords there; false when
    /// it misses the board or the image.
    pub fn carry(&self, level: &Level, seed: &Seed, light: &LightCenter, to: usize, out: &mut [f64]) -> bool {
        let k = self.views.k;
        let Some((point, ..)) = self.meet(seed, light, to) else { return false };
        let landing = self.camera.project(&point).and_then(|px| Landing::at(px, level, to, k));
        let Some(landing) = landing else { return false };
        let own = &level.images[seed.view][seed.index * (k + 1)..];
        for (c, out) in out.iter_mut().enumerate().take(k) {
            *out = landing.value(c) - f64::from(own[c]);
        }
        true
    }

    /// Carries samples like [`Self::carry`], each to the view that `to` gives, and appends a row for each channel of
    /// those that land. The light's slopes by its state are given.
    pub fn carry_with_slopes(
        &self,
        level: &Level,
        seeds: &[Seed],
        light: (&LightCenter, &[Slope; 3]),
        to: impl Fn(&Seed) -> usize,
        rows: &mut Vec<Row>,
    ) {
        /// Samples between the one that memory is asked for and the one that is worked on.
        const AHEAD: usize = 8;
        let k = self.views.k;
        let met: Vec<Option<Met>> = seeds.iter().map(|seed| self.meet_with_slopes(seed, light.0, to(seed))).collect();
        for (i, (seed, met_here)) in seeds.iter().zip(&met).enumerate() {
            // Images of all views are far larger than the caches, and samples land anywhere in them.
            if let Some(Some(next)) = met.get(i + AHEAD)
                && let Some((corner, _)) = first_corner(next.px, level, k)
            {
                let image = &level.images[next.view];
                prefetch(image, corner);
                prefetch(image, corner + level.width * (k + 1));
            }
            if let Some(met) = met_here {
                self.rows_of(level, seed, light, met, rows);
            }
        }
    }

    /// Returns where the ray of light of a sample meets the board of the view `to`, as the camera sees it.
    fn meet_with_slopes(&self, seed: &Seed, light: &LightCenter, to: usize) -> Option<Met> {
        let (point, v, length) = self.meet(seed, light, to)?;
        let (px, jacobian) = self.camera.project_with_jacobian(&point)?;
        Some(Met { view: to, point, v, length, px, jacobian })
    }

    /// Appends the rows of a sample that meets a board.
    fn rows_of(
        &self,
        level: &Level,
        seed: &Seed,
        (light, slopes): (&LightCenter, &[Slope; 3]),
        met: &Met,
        rows: &mut Vec<Row>,
    ) {
        let (k, Met { view: to, point, v, length, px, jacobian }) = (self.views.k, met);
        let Some(landing) = Landing::at(*px, level, *to, k) else { return };
        let by_block = 1.0 / level.block as f64;
        // A point moves with the direction in which it is seen, and along it as far as the board asks for.
        let moves = |normal: &Vector3<f64>, from: &Point3<f64>, v: &Vector3<f64>, length: f64, j: &Matrix2x3<f64>| {
            let (from, by_slope) = (from - light.origin, 1.0 / normal.dot(v));
            slopes.map(|slope| {
                let dv = from * slope.kappa + slope.along;
                j * ((dv - v * (normal.dot(&dv) * by_slope)) * (length * by_block))
            })
        };
        let moved = moves(&self.views.planes[*to].0, &seed.point, v, *length, jacobian);
        // Where it landed seen as the sample, and the sample as where it lands: what moves one way there moves the
        // other way here.
        let back = (point - light.origin) * light.kappa + light.along;
        let size = (seed.point - point).dot(&back) / back.norm_squared();
        let moved_here = seed.jacobian.map(|j| moves(&self.views.planes[seed.view].0, point, &back, -size, &j));
        // Not where the light grazes the board.
        let moved_here = moved_here.filter(|moved| moved.iter().all(|m| m.iter().all(|m| m.is_finite())));
        let differences = differences(level, seed, k).zip(moved_here);
        let by_place = landing.weight_slopes(k);
        let sums = by_place.map(|w| w.iter().sum::<f64>());
        let own = &level.images[seed.view][seed.index * (k + 1)..][..k];
        rows.extend((0..k).map(|c| {
            let corners = landing.corners.map(|i| f64::from(landing.image[i + c]));
            let value = landing.value(c);
            let [gx, gy] = [0, 1].map(|axis| {
                let rise: f64 = (0..4).map(|i| by_place[axis][i] * corners[i]).sum();
                (rise - value * sums[axis]) * landing.by_sum
            });
            let there = moved.map(|m| gx * m[0] + gy * m[1]).into();
            let here = differences.as_ref().map(|(d, moved)| {
                let [gx, gy] = d.map(|at| f64::from(at[1][c] - at[0][c]) / 2.0);
                moved.map(|m| gx * m[0] + gy * m[1]).into()
            });
            Row { there, here, difference: value - f64::from(own[c]) }
        }));
    }

    /// Where the ray of light of a sample meets the board of the view `to`, mm; its direction there, and how many of it
    /// lie between. `None` where it runs along the board.
    fn meet(&self, seed: &Seed, light: &LightCenter, to: usize) -> Option<(Point3<f64>, Vector3<f64>, f64)> {
        // Lines through the center o = origin − along/κ: direction ∝ κ (x − origin) + along.
        let v: Vector3<f64> = (seed.point - light.origin) * light.kappa + light.along;
        let (n, d) = self.views.planes[to];
        let denominator = n.dot(&v);
        if denominator.abs() < 1e-6 {
            return None;
        }
        let length = (d - n.dot(&seed.point.coords)) / denominator;
        Some((seed.point + v * length, v, length))
    }

    /// Disagreement of codewords carried over `arm` steps, 0 to 1 (chance): mean truncated squared difference as a
    /// share of `by_chance`, of few hits drawn towards what nobody knows; too few hits are worse than chance. Boards
    /// that are held by hand far from each other, or whose ink leaves little of them, share few rays of light, under
    /// the right light as well. Of many centers, a score that is likely to be worse than `give_up` is not worked out.
    pub fn score(
        &self,
        level: &Level,
        seeds: &[Seed],
        s: State,
        arm: usize,
        by_chance: f64,
        give_up: Option<f64>,
    ) -> f64 {
        /// Part of the seeds that have to hit: one of so many.
        const RARE: usize = 64;
        /// Hits that are made up, and their disagreement.
        const UNKNOWN: (f64, f64) = (10.0, 0.5);
        let light = self.chart.center(s);
        let mut r = vec![0.0; self.views.k];
        let (mut sum, mut hits) = (0.0, 0usize);
        for (i, seed) in seeds.iter().enumerate() {
            if self.carry(level, seed, &light, partner(seed, arm, self.views.count()), &mut r) {
                sum += disagreement(&r, by_chance);
                hits += 1;
            }
            let is_hopeless = |give_up: f64| hits == 0 || sum > (give_up + 0.15) * hits as f64;
            if i == 63 && give_up.is_some_and(is_hopeless) {
                return 2.0;
            }
        }
        let far = (0..3).map(|i| (s[i] - HOME[i]).powi(2)).sum::<f64>();
        let mean = (sum + UNKNOWN.0 * UNKNOWN.1) / (hits as f64 + UNKNOWN.0);
        if hits * RARE < seeds.len() { 2.0 } else { mean + 10.0 * PULL * far }
    }
}

/// Truncated squared length of a difference of codewords, as a share of what is none any more; 0 to 1.
pub(super) fn disagreement(r: &[f64], by_chance: f64) -> f64 {
    (r.iter().map(|r| r * r).sum::<f64>() / (DISAGREEMENT * by_chance)).min(1.0)
}

/// Mean squared difference of the codewords of two samples drawn by chance: twice the sum of the channels' variances.
pub(super) fn by_chance(views: &Views, level: &Level, seeds: &[Seed]) -> f64 {
    let k = views.k;
    let (mut sum, mut squares) = (vec![0.0f64; k], vec![0.0f64; k]);
    for seed in seeds {
        let own = &level.images[seed.view][seed.index * (k + 1)..][..k];
        for (c, v) in own.iter().enumerate() {
            sum[c] += f64::from(*v);
            squares[c] += f64::from(*v).powi(2);
        }
    }
    let n = seeds.len().max(1) as f64;
    2.0 * (0..k).map(|c| squares[c] / n - (sum[c] / n).powi(2)).sum::<f64>().max(1e-9)
}
