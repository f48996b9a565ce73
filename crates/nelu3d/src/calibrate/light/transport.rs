//! Carrying codewords along rays of light from board to board.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Camera;

use super::super::views::{Level, Views};
use super::center::{Chart, HOME, LightCenter, State};

/// Strength of the pull towards the camera, as a share of the best determined direction's information.
pub(super) const PULL: f64 = 1e-4;
/// Squared difference of codewords, as a share of what two samples drawn by chance have, at which they do not agree at
/// all.
pub(super) const DISAGREEMENT: f64 = 0.6;

/// The views, and the chart of centers.
pub(super) struct Transport<'a> {
    pub(super) camera: &'a Camera,
    pub(super) views: &'a Views,
    pub(super) chart: &'a Chart,
}

/// A sample to carry: its view, and its place in the image of a level.
#[derive(Clone, Copy)]
pub(super) struct Seed {
    pub(super) view: usize,
    pub(super) index: usize,
    pub(super) point: Point3<f64>,
}

/// An even selection of about `n` usable samples of a level over all views.
pub(super) fn seeds(camera: &Camera, views: &Views, level: &Level, n: usize) -> Vec<Seed> {
    let per_view = (n / views.len()).max(200);
    let stride = (((level.width * level.height) / per_view) as f64).sqrt().max(1.0) as usize;
    let k = views.k;
    let mut out = Vec::new();
    for (view, (normal, offset)) in views.planes.iter().enumerate() {
        for y in (stride / 2..level.height).step_by(stride) {
            for x in (stride / 2..level.width).step_by(stride) {
                let index = y * level.width + x;
                if level.images[view][index * (k + 1) + k] < level.min_validity {
                    continue;
                }
                let ray = camera.ray(level.px(x, y));
                let t = offset / normal.dot(&ray.dir);
                if t > 0.0 {
                    out.push(Seed { view, index, point: ray.at(t) });
                }
            }
        }
    }
    out
}

/// A number that looks random, the same for the same seed.
pub(super) fn hash(seed: &Seed) -> usize {
    (seed.index as u32 ^ (seed.view as u32) << 24).wrapping_mul(2_654_435_761) as usize >> 7
}

/// A view that is not more than `arm` steps away from the seed's in depth, and no less than three quarters of it where
/// there is one.
pub(super) fn partner(seed: &Seed, arm: usize, n: usize) -> usize {
    let (view, least) = (seed.view, arm - arm / 4);
    let before = (view.min(arm) + 1).saturating_sub(least);
    let behind = ((n - 1 - view).min(arm) + 1).saturating_sub(least);
    if before + behind == 0 {
        return if view > n - 1 - view { 0 } else { n - 1 };
    }
    let pick = hash(seed) % (before + behind);
    if pick < before { view - least - pick } else { view + least + pick - before }
}

impl Transport<'_> {
    /// Carries a sample along its ray of light to the view `to` and takes the difference of codewords there; false when
    /// it misses the board or the image.
    pub(super) fn carry(&self, level: &Level, seed: &Seed, light: &LightCenter, to: usize, out: &mut [f64]) -> bool {
        let k = self.views.k;
        // Lines through the center o = origin − along/κ: direction ∝ κ (x − origin) + along.
        let v: Vector3<f64> = (seed.point - light.origin) * light.kappa + light.along;
        let (n, d) = self.views.planes[to];
        let denominator = n.dot(&v);
        if denominator.abs() < 1e-6 {
            return false;
        }
        let y = seed.point + v * ((d - n.dot(&seed.point.coords)) / denominator);
        let Some(px) = self.camera.project(&y) else { return false };
        let b = level.block as f64;
        let (x, y) = ((px[0] - (b - 1.0) / 2.0) / b, (px[1] - (b - 1.0) / 2.0) / b);
        if !(x >= 0.0 && y >= 0.0 && x < level.width as f64 - 1.0 && y < level.height as f64 - 1.0) {
            return false;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = (x - x0 as f64, y - y0 as f64);
        let image = &level.images[to];
        let base = (y0 * level.width + x0) * (k + 1);
        let down = base + level.width * (k + 1);
        // Interpolated, weighted by validity.
        let mut weights = [0.0; 4];
        let corners = [base, base + k + 1, down, down + k + 1];
        let places = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        for i in 0..4 {
            weights[i] = places[i] * f64::from(image[corners[i] + k]);
        }
        let sum: f64 = weights.iter().sum();
        if sum < f64::from(level.min_validity) {
            return false;
        }
        let own = &level.images[seed.view][seed.index * (k + 1)..];
        for (c, out) in out.iter_mut().enumerate().take(k) {
            let there: f64 = (0..4).map(|i| weights[i] * f64::from(image[corners[i] + c])).sum();
            *out = there / sum - f64::from(own[c]);
        }
        true
    }

    /// Disagreement of codewords carried over `arm` steps, 0 to 1 (chance): mean truncated squared difference as a
    /// share of `by_chance`. A score that is sure to be worse than `give_up` is not worked out; too few hits are worse
    /// than chance.
    pub(super) fn score(
        &self,
        level: &Level,
        seeds: &[Seed],
        s: State,
        arm: usize,
        by_chance: f64,
        give_up: f64,
    ) -> f64 {
        let light = self.chart.center(s);
        let mut r = vec![0.0; self.views.k];
        let (mut sum, mut hits) = (0.0, 0usize);
        for (i, seed) in seeds.iter().enumerate() {
            if self.carry(level, seed, &light, partner(seed, arm, self.views.len()), &mut r) {
                sum += disagreement(&r, by_chance);
                hits += 1;
            }
            if i == 63 && (hits < 4 || sum > (give_up + 0.15) * hits as f64) {
                return 2.0;
            }
        }
        let far = (0..3).map(|i| (s[i] - HOME[i]).powi(2)).sum::<f64>();
        if hits * 8 < seeds.len() { 2.0 } else { sum / hits as f64 + 10.0 * PULL * far }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partners_are_others_within_the_arm() {
        for n in 2..9 {
            for arm in 1..n {
                for view in 0..n {
                    for index in 0..50 {
                        let p = partner(&Seed { view, index, point: Point3::origin() }, arm, n);
                        assert!(p < n && p != view, "{n} {arm} {view}: {p}");
                    }
                }
            }
        }
    }
}
