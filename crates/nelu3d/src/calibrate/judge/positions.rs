//! Which positions disagree with the field of all, and how: patterns in another order, another exposure of white or of
//! a pattern, or a camera or board that moved between the images.
//!
//! A field of many positions keeps little of a single wrong one, so that one stands out against the others.

use nalgebra::{Matrix3, Vector3};
use nelu3d_scan::statistics::median;

use crate::calibrate::drawn::Drawn;
use crate::calibrate::placed_sweep::{PlacedSweep, Seen};
use crate::color_field::ColorField;
use crate::color_field::grid::Grid;
use crate::verdict::{Code, Finding, Verdict};

/// Fewest positions among which one can stand out.
const MIN_POSITIONS: usize = 5;
/// Part of a position's samples that may be off by anything: where a hand holds the board, or beside its shadow.
const HELD: f64 = 0.05;
/// Ratio of a position's mean squared error to the others' median beyond which it stands out, with so many median
/// deviations between.
const STANDS_OUT: f64 = 4.0;
const DEVIATIONS: f64 = 8.0;
/// Ratio of the worst position's error to the median from which it is asked whether its patterns are swapped.
const NOTABLE: f64 = 1.5;
/// Fraction of the worst position's excess below which another position is taken for its neighbor.
const OF_THE_WORST: f64 = 0.6;
/// Error beyond that of the others, normalized intensity, below which nothing is said.
const MIN_EXCESS: f64 = 0.015;
/// Fraction of a position's excess that an explanation takes away.
const EXPLAINS: f64 = 0.5;

/// Sums over the well-lit samples of one position: measured codewords v against the field's c.
pub struct PositionSums {
    /// Index of the position.
    pub p: usize,
    /// Number of samples.
    pub n: usize,
    /// Σ (v − c)² over samples and channels.
    pub error: f64,
    /// Σ (v − c)² over channels, `[sample]`.
    pub of_samples: Vec<f64>,
    /// Per channel: Σ c, Σ v, Σ c², Σ v², Σ (v − c)².
    pub channels: Vec<[f64; 5]>,
    /// With residuals r = v − c: Σ r_i r_j, Σ r_i v_j, Σ v_i v_j, row by row.
    pub cross: [Vec<f64>; 3],
    /// Normal equations of a shift by one pixel across, one down, and 1 mm along the ray.
    pub shift: (Matrix3<f64>, Vector3<f64>),
}

/// Judges positions against the field of all; `names` are theirs, and `images` those of a position.
pub(super) fn judge(mut all: Vec<PositionSums>, names: &[&str], images: &[String]) -> Vec<Finding> {
    all.retain(|s| s.n > 50);
    if all.len() < MIN_POSITIONS {
        return Vec::new();
    }
    let mut out = standing_out(&all);
    if out.is_empty() {
        // Two swapped patterns bend the field of few positions so much that none stands out, but they show.
        let error = |i: &usize| all[*i].mean_square();
        let worst = (0..all.len()).max_by(|a, b| error(a).total_cmp(&error(b)));
        out.extend(worst.filter(|i| error(i) > NOTABLE * typical(&all) && all[*i].swapped().is_some()));
    }
    let finding = |i: usize| all[i].finding(names[all[i].p], images, typical(&all));
    let mut findings: Vec<Finding> = out.into_iter().map(finding).collect();
    // One wrong position makes factors scatter, too.
    if findings.is_empty() {
        findings.extend(exposure_scatter(&all, images));
    }
    findings
}

/// Median over the positions of their mean squared error.
pub fn typical(all: &[PositionSums]) -> f64 {
    median(&mut all.iter().map(PositionSums::mean_square).collect::<Vec<_>>()).unwrap_or(0.0)
}

/// Indices of the positions whose error stands out among all.
pub fn standing_out(all: &[PositionSums]) -> Vec<usize> {
    let errors: Vec<f64> = all.iter().map(PositionSums::mean_square_of_most).collect();
    tracing::debug!(?errors, "mean squared error of positions");
    let middle = median(&mut errors.clone()).unwrap_or(0.0);
    let deviation = median(&mut errors.iter().map(|e| (e - middle).abs()).collect::<Vec<_>>()).unwrap_or(0.0);
    let limit = (STANDS_OUT * middle).max(middle + DEVIATIONS * deviation).max(middle + MIN_EXCESS * MIN_EXCESS);
    // A wrong position bends the field around it, and its neighbors stand out, too.
    let largest = errors.iter().copied().fold(0.0, f64::max);
    let limit = limit.max(middle + OF_THE_WORST * (largest - middle));
    (0..all.len()).filter(|i| all.len() >= MIN_POSITIONS && errors[*i] > limit).collect()
}

/// Finds out whether single images were exposed differently from position to position, white or patterns (automatic
/// exposure): the factors between measured and predicted intensities then scatter.
pub fn exposure_scatter(all: &[PositionSums], images: &[String]) -> Option<Finding> {
    /// Median deviation of a channel's factors from their median that no good sweep has.
    const MAX_SCATTER: f64 = 0.02;
    let k = all.first()?.channels.len();
    let mut worst = (0.0, 0);
    for j in 0..k {
        let mut gains: Vec<f64> = all.iter().filter_map(|s| s.gain(j)).collect();
        if gains.len() < MIN_POSITIONS {
            continue;
        }
        let middle = median(&mut gains).unwrap_or(1.0);
        let scatter = median(&mut gains.iter().map(|g| (g - middle).abs()).collect::<Vec<_>>()).unwrap_or(0.0);
        if scatter > worst.0 {
            worst = (scatter, j);
        }
    }
    tracing::debug!(scatter = worst.0, channel = worst.1, "exposure from position to position");
    (worst.0 > MAX_SCATTER).then(|| {
        let image = images.get(worst.1 * images.len() / k).map_or("a pattern", String::as_str);
        let sentence = format!(
            "the brightness of {image} against white's changes by {:.0} % from position to position",
            100.0 * worst.0
        );
        let remedy = "turn automatic exposure, gain and white balance off, and keep the light's brightness constant";
        Finding::new(Code::ExposureJump, Verdict::Doubtful, sentence, remedy).with("relative_scatter", worst.0)
    })
}

impl PositionSums {
    /// Compares a position with the field.
    pub(super) fn of(field: &ColorField, grid: &Grid, placed: &PlacedSweep<'_>, p: usize, drawn: &Drawn) -> Self {
        let (k, w) = (placed.sweep.k, placed.camera.width);
        let mut s = Self {
            p,
            n: 0,
            error: 0.0,
            of_samples: Vec::new(),
            channels: vec![[0.0; 5]; k],
            cross: std::array::from_fn(|_| vec![0.0; k * k]),
            shift: (Matrix3::zeros(), Vector3::zeros()),
        };
        let board = &placed.boards[p];
        let mut c = [vec![0.0f32; k], vec![0.0; k], vec![0.0; k], vec![0.0; k]];
        placed.for_each_drawn(p, drawn, |sample, Seen { dir, t }| {
            let i = sample.pixel;
            if sample.contrast.iter().any(|c| *c < drawn.lit) {
                return;
            }
            let at = |dir: &Vector3<f64>, t: f64| field.frame.along_ray(dir).at(t).q;
            let beside = |j: usize| (dir + placed.dirs[j] - placed.dirs[i]).normalize();
            let (right, below) = ((i % w + 1 < w).then_some(i + 1), (i + w < placed.dirs.len()).then_some(i + w));
            let hit = |j: Option<usize>| j.map(beside).and_then(|dir| board.hit(&dir).map(|t| at(&dir, t)));
            let (Some(right), Some(below)) = (hit(right), hit(below)) else { return };
            for (c, q) in c.iter_mut().zip([at(&dir, t), right, below, at(&dir, t + 1.0)]) {
                grid.eval(q, c);
            }
            s.add(sample.values, &c);
        });
        s
    }

    /// Adds a sample: measured, and predicted at its own point and at the three shifted ones.
    pub fn add(&mut self, measured: &[f32], c: &[Vec<f32>; 4]) {
        let k = measured.len();
        let before = self.error;
        self.n += 1;
        for j in 0..k {
            let (own, v) = (f64::from(c[0][j]), f64::from(measured[j]));
            let e = v - own;
            self.error += e * e;
            let of = &mut self.channels[j];
            for (sum, x) in of.iter_mut().zip([own, v, own * own, v * v, e * e]) {
                *sum += x;
            }
            let d = Vector3::new(f64::from(c[1][j]) - own, f64::from(c[2][j]) - own, f64::from(c[3][j]) - own);
            self.shift.0 += d * d.transpose();
            self.shift.1 += d * e;
            for i in 0..k {
                let (r, other) = (f64::from(c[0][i]), f64::from(measured[i]));
                let r = other - r;
                for (sums, x) in self.cross.iter_mut().zip([e * r, e * other, v * other]) {
                    sums[j * k + i] += x;
                }
            }
        }
        self.of_samples.push(self.error - before);
    }

    fn mean_square(&self) -> f64 {
        self.error / (self.n * self.channels.len()).max(1) as f64
    }

    /// Mean squared error of all but the worst samples.
    fn mean_square_of_most(&self) -> f64 {
        let mut errors = self.of_samples.clone();
        errors.sort_unstable_by(f64::total_cmp);
        let most = ((1.0 - HELD) * errors.len() as f64).ceil() as usize;
        errors[..most].iter().sum::<f64>() / (most * self.channels.len()).max(1) as f64
    }

    /// Factor between measured and predicted intensity of a channel; `None` where it is dark.
    fn gain(&self, j: usize) -> Option<f64> {
        let [_, _, cc, vv, e] = self.channels[j];
        (cc > 0.05 * self.n as f64).then(|| 0.5 * (cc + vv - e) / cc)
    }

    /// How much of a channel's squared error a factor takes away.
    fn explained_by_factor(&self, j: usize) -> f64 {
        let [_, _, cc, vv, e] = self.channels[j];
        let both = 0.5 * (cc + vv - e);
        both * both / cc.max(1e-12) - vv + e
    }

    /// Two channels that are swapped, if there are. The field has an unknown part of the wrong position's own values,
    /// but whatever that part is, what one of the channels has too much is what the other one lacks, and both are in
    /// proportion to their difference.
    fn swapped(&self) -> Option<(usize, usize)> {
        // Measured on swaps in sweeps of 12 and 24 positions: 0.49 to 0.64, 0.78 to 0.90, and 0.999; other mistakes
        // have no channels of opposite errors.
        const OPPOSITE: f64 = 0.35;
        const FOLLOWS: f64 = 0.65;
        const SHARE: f64 = 0.8;
        let k = self.channels.len();
        let [rr, rv, vv] = &self.cross;
        let likeness = |i: usize, j: usize| {
            let at = |m: &[f64], i: usize, j: usize| m[i * k + j];
            let (own, other) = (at(rr, i, i), at(rr, j, j));
            let opposite = -at(rr, i, j) / (own * other).sqrt();
            let difference = at(vv, i, i) + at(vv, j, j) - 2.0 * at(vv, i, j);
            let follows = (at(rv, i, i) - at(rv, i, j)) / (own * difference).sqrt();
            // A pair that takes little of the error is not what is wrong.
            let share = (own + other) / self.error;
            // Exposures that changed leave opposite errors, too, which factors explain better.
            let back = (at(rv, j, j) - at(rv, j, i)).powi(2) / difference;
            let explained = follows * follows * own + back;
            let is_swap = opposite > OPPOSITE
                && follows > FOLLOWS
                && share > SHARE
                && explained > self.explained_by_factor(i) + self.explained_by_factor(j);
            if is_swap { opposite + follows } else { 0.0 }
        };
        let pairs = (0..k).flat_map(|i| (i + 1..k).map(move |j| (i, j)));
        let best = pairs.max_by(|a, b| likeness(a.0, a.1).total_cmp(&likeness(b.0, b.1)))?;
        (likeness(best.0, best.1) > 0.0).then_some(best)
    }

    /// Says what is wrong with a position whose error stands out against the others' `typical` one.
    pub fn finding(&self, name: &str, images: &[String], typical: f64) -> Finding {
        let k = self.channels.len();
        let image = |j: usize| images.get(j * images.len() / k).map_or("a pattern", String::as_str);
        let usual = typical * (self.n * k) as f64;
        let excess = self.error - usual;
        let explains = |left: f64| self.error - left > EXPLAINS * excess;
        let finding = |code, sentence: String, remedy: &str| {
            Finding::new(code, Verdict::Doubtful, sentence, remedy)
                .with("position", name)
                .with("rms", self.mean_square().sqrt())
                .with("rms_of_others", typical.sqrt())
        };
        let again = "take this position again, or leave it out (`leave_out`)";
        if let Some((i, j)) = self.swapped() {
            let sentence = format!("at board position {name}, {} and {} are swapped", image(i), image(j));
            return finding(
                Code::PatternsSwapped,
                sentence,
                "put the position's images in the set's order, or take it again",
            );
        }
        // An exposure is off by a factor that somebody may have chosen.
        let is_factor = |factor: f64| (0.4..2.5).contains(&factor);
        let sum = |f: &dyn Fn(&[f64; 5]) -> f64| self.channels.iter().map(f).sum::<f64>();
        let gain = sum(&|s| 0.5 * (s[2] + s[3] - s[4])) / sum(&|s| s[2]).max(1e-12);
        let left = sum(&|s| s[3] - 2.0 * gain * 0.5 * (s[2] + s[3] - s[4]) + gain * gain * s[2]);
        if is_factor(gain) && explains(left) {
            let sentence = format!(
                "at board position {name}, white is {:.0} % {} against the patterns than elsewhere",
                100.0 * (1.0 / gain - 1.0).abs(),
                if gain < 1.0 { "brighter" } else { "darker" }
            );
            return finding(Code::ExposureJump, sentence, again).with("white_factor", 1.0 / gain);
        }
        let of_channel = |j: usize| self.explained_by_factor(j);
        let best = (0..k).max_by(|a, b| of_channel(*a).total_cmp(&of_channel(*b))).unwrap_or(0);
        let factor = self.gain(best).unwrap_or(0.0);
        if is_factor(factor) && explains(self.error - of_channel(best)) {
            let sentence = format!(
                "at board position {name}, {} is {:.0} % {} than elsewhere",
                image(best),
                100.0 * (factor - 1.0).abs(),
                if factor > 1.0 { "brighter" } else { "darker" }
            );
            return finding(Code::ExposureJump, sentence, again).with("pattern_factor", factor);
        }
        if let Some(shift) = (self.shift.0 + Matrix3::identity() * 1e-9).cholesky().map(|m| m.solve(&self.shift.1))
            && explains(self.error - shift.dot(&self.shift.1))
        {
            let px = shift.x.hypot(shift.y);
            let sentence = format!(
                "board position {name} does not fit the others; {px:.1} px in the image and {:.1} mm of depth would \
                 explain it: board, camera or light moved",
                shift.z.abs()
            );
            return finding(Code::PositionMoved, sentence, again).with("shift_px", px).with("shift_mm", shift.z.abs());
        }
        let sentence = format!("board position {name} does not fit the others");
        finding(Code::PositionDisagrees, sentence, again)
    }
}
