//! Errors of a field at positions that it was not made from.

use nalgebra::{Matrix3, Point3, Vector3};
use nelu3d_scan::statistics::median;

use super::depth_noise::{DepthNoiseOfPosition, DepthNoiseTiles};
use super::placed_sweep::{PlacedSweep, Seen};
use super::predictor::Predictor;
use super::shared_displacement::{DisplacementsBySupport, FAR, GrossSquares, Sample, SharedSquare};
use super::sweep::Position;
use crate::color_field::Quality;
use crate::color_field::frame::FieldFrame;
use crate::color_field::grid::Grid;

/// Standard deviation of a codeword beside its noise, as a part of what the code bends from pixel to pixel (its second
/// differences): boards at other distances and angles show an edge in pixels of other size, and at other places within
/// them. Measured on four boards of Gray code, held by hand: 0.08 to 0.14 where second differences exceed 0.1.
const OF_BENDS: f64 = 0.1;

/// Largest part of a codeword's variance that edges of ink beside it leave open, where the field's own errors are to be
/// told: scenes have no print.
const OF_EDGES: f32 = 0.1;

/// The contrast (white − black) from which a sample is well lit: a tenth of full scale, or half of what the best tenth
/// of the position's samples have where the exposure is short. Black ink is below it.
pub fn well_lit(contrast: &[f32]) -> f32 {
    /// Samples that are looked at, about.
    const ENOUGH: usize = 40_000;
    // No multiple of the number of channels.
    let step = contrast.len() / ENOUGH / 6 * 6 + 1;
    let mut usable: Vec<f32> = contrast.iter().step_by(step).copied().filter(|c| *c > 0.0).collect();
    if usable.is_empty() {
        return 0.1;
    }
    let at = usable.len() * 9 / 10;
    let (_, bright, _) = usable.select_nth_unstable_by(at, f32::total_cmp);
    (0.5 * *bright).min(0.1)
}

/// Sums of a field's errors at positions that it was not made from.
#[derive(Default)]
pub(super) struct HeldOutErrors {
    /// Squared errors and their number, over every usable sample.
    all: (f64, usize),
    /// The same over well-lit ones.
    lit: (f64, usize),
    /// Variance that noise alone gives the well-lit ones.
    noise: f64,
    /// Variance that noise, that of the field included, and pixels give a selection of them, and its number.
    allowed: (f64, usize),
    /// Per channel: number, sum and sum of squares of the well-lit codewords.
    codewords: Vec<[f64; 3]>,
    /// Depth errors of a selection, mm.
    depth: Vec<f32>,
    /// By how much each position seems to be displaced along the rays.
    displacements: Vec<Displacement>,
    /// Scatter in depth, where the field is a spline.
    depth_noise: DepthNoiseTiles,
    /// Displacements by the number of boards that support the field, where positions are held out in turn.
    pub(super) by_support: DisplacementsBySupport,
}

impl HeldOutErrors {
    /// PSNR over well-lit samples, dB, if there are any.
    pub(super) fn psnr_db(&self) -> Option<f64> {
        (self.lit.1 > 0).then(|| -10.0 * (self.lit.0 / self.lit.1 as f64).log10())
    }

    /// PSNR that noise and pixels allow, dB, if there are well-lit samples.
    pub(super) fn allowed_db(&self) -> Option<f64> {
        (self.allowed.1 > 0).then(|| -10.0 * (self.allowed.0 / self.allowed.1 as f64).log10())
    }

    /// The errors of a field at position `p`, one of `n_held_out`, where `supporting` other positions support it at all.
    pub(super) fn of(
        placed: &PlacedSweep<'_>,
        frame: &FieldFrame,
        field: &Predictor<'_>,
        p: usize,
        position: &Position,
        n_held_out: usize,
        supporting: impl Fn([f32; 3]) -> u16,
    ) -> Self {
        let (k, channels) = (placed.sweep.k, placed.sweep.channels);
        let mut s = Self { codewords: vec![[0.0; 3]; k], ..Self::default() };
        let (mut c, mut d) = (vec![0.0; k], vec![0.0; k]);
        let mut tiles = field
            .spline()
            .map(|_| DepthNoiseOfPosition::new([placed.camera.width, placed.camera.height], p, n_held_out));
        // Depth errors of so many samples, however many positions are held out.
        let stride = 4 * n_held_out;
        let mut beside = [vec![0.0; k], vec![0.0; k], vec![0.0; k], vec![0.0; k]];
        let predicted = field.predict(k, stride, |f| {
            placed.for_each_usable(p, position, |_, Seen { dir, t }| {
                if supporting(frame.along_ray(&dir).at(t).q) > 0 {
                    f(Point3::from(dir * t), dir);
                }
            });
        });
        let (mut n, mut signed) = (0usize, Vec::new());
        let width = placed.camera.width;
        let lit = well_lit(&position.contrast);
        placed.for_each(p, position, |i, Seen { dir, t }, v, w| {
            let m = frame.along_ray(&dir).at(t);
            let others = supporting(m.q);
            if others == 0 {
                return;
            }
            n += 1;
            let with_depth = n.is_multiple_of(stride);
            let in_tile = tiles.as_mut().filter(|tiles| tiles.wants(i));
            predicted.eval(n - 1, m, with_depth || in_tile.is_some(), &mut c, &mut d);
            let bends = with_depth
                && field.spline().is_some_and(|grid| evaluate_beside(placed, frame, grid, (p, i), &mut beside));
            let (mut h, mut g) = (0.0, 0.0);
            for j in 0..k {
                if w[j] == 0.0 {
                    continue;
                }
                let e = c[j] - v[j];
                s.all.0 += f64::from(e * e);
                s.all.1 += 1;
                if position.contrast[i * channels + j % channels] >= lit {
                    s.lit.0 += f64::from(e * e);
                    s.lit.1 += 1;
                    // What an edge of ink leaves open is no noise.
                    let variance = f64::from(1.0 / w[j] - position.edge[i]);
                    s.noise += variance;
                    if bends {
                        let bend = |a: usize| f64::from(beside[a][j] + beside[a + 1][j] - 2.0 * c[j]).powi(2);
                        let bent = bend(0) + bend(2);
                        // The field has the noise of the positions that it rests on.
                        let noise = variance * (1.0 + 1.0 / f64::from(others));
                        s.allowed = (s.allowed.0 + noise + OF_BENDS * OF_BENDS * bent, s.allowed.1 + 1);
                    }
                    let v = f64::from(v[j]);
                    s.codewords[j].iter_mut().zip([1.0, v, v * v]).for_each(|(sum, x)| *sum += x);
                }
                h += w[j] * d[j] * d[j];
                g += w[j] * d[j] * e;
            }
            if let Some(tiles) = in_tile
                && position.contrast[i * channels..][..channels].iter().all(|contrast| *contrast >= lit)
                && w.iter().all(|w| w * position.edge[i] < OF_EDGES)
            {
                tiles.add(i, |j| c[j] - v[j], &d, w, others);
            }
            if with_depth && h > 0.0 {
                s.depth.push((g / h).abs());
                let dir = &placed.dirs[i];
                let plane = [dir.x / dir.z, dir.y / dir.z];
                signed.push(Sample { g, h, plane, block: Sample::block_of(i, width) });
            }
        });
        s.displacements.extend(Displacement::of(p, &signed));
        s.depth_noise = tiles.map(DepthNoiseOfPosition::finish).unwrap_or_default();
        s
    }

    pub(super) fn merge(&mut self, s: Self) {
        self.all = (self.all.0 + s.all.0, self.all.1 + s.all.1);
        self.lit = (self.lit.0 + s.lit.0, self.lit.1 + s.lit.1);
        self.noise += s.noise;
        self.allowed = (self.allowed.0 + s.allowed.0, self.allowed.1 + s.allowed.1);
        self.codewords.resize(self.codewords.len().max(s.codewords.len()), [0.0; 3]);
        self.codewords.as_flattened_mut().iter_mut().zip(s.codewords.as_flattened()).for_each(|(a, b)| *a += b);
        self.depth.extend(s.depth);
        self.displacements.extend(s.displacements);
        self.depth_noise.add(s.depth_noise);
        self.by_support.add(&s.by_support);
    }

    /// Variance of the well-lit codewords, channel by channel, mean; NaN if there are none.
    pub(super) fn variance(&self) -> f64 {
        let of = |[n, sum, squares]: &[f64; 3]| squares / n - (sum / n).powi(2);
        let known: Vec<f64> = self.codewords.iter().filter(|c| c[0] > 0.0).map(of).collect();
        known.iter().sum::<f64>() / known.len() as f64
    }

    /// By how much each position seems to be displaced.
    pub(super) fn displacements(&self) -> &[Displacement] {
        &self.displacements
    }

    /// Squares of pixels on the positions that are gross errors, where positions are held out in turn.
    pub(super) fn gross(&self) -> Option<GrossSquares> {
        self.by_support.gross()
    }

    /// Sums up. Of the boards' pose errors the field, which is fitted to `n_positions` of them, keeps their mean's.
    pub(super) fn quality(mut self, held_out: Vec<String>, n_positions: usize) -> Quality {
        let db = |sum: f64, n: usize| if n > 0 { -10.0 * (sum / n as f64).log10() } else { f64::NAN };
        self.depth.sort_by(f32::total_cmp);
        let (lit, noise) = if self.lit.1 > 0 {
            (db(self.lit.0, self.lit.1), db(self.noise, self.lit.1))
        } else {
            (db(self.all.0, self.all.1), 60.0)
        };
        // Mean squares over the boards, of which the field keeps a part.
        let part = 1.0 / (self.displacements.len().max(1) * n_positions.max(1)) as f64;
        let uneven: f64 = self.displacements.iter().map(|d| d.uneven_mm2).sum::<f64>() * part;
        let mean_square = self.displacements.iter().map(|d| d.mm * d.mm).sum::<f64>() * part + uneven;
        let mut covariance: Matrix3<f64> =
            self.displacements.iter().map(|d| d.plane * d.plane.transpose() * part).sum();
        // What is no plane may lie anywhere on a board: it adds to the variance everywhere.
        covariance[(0, 0)] += uneven;
        tracing::debug!(
            uneven = uneven.sqrt(),
            total = mean_square.sqrt(),
            by_support = ?self.by_support.rms_mm(),
            gross = ?self.by_support.gross(),
            "displacements, mm"
        );
        let model_sigma = (10f64.powf(-lit / 10.0) - 10f64.powf(-noise / 10.0)).max(0.0).sqrt() as f32;
        Quality {
            held_out,
            n: self.all.1,
            psnr_db: lit,
            psnr_all_db: db(self.all.0, self.all.1),
            ceiling_db: noise,
            depth_mm: self.depth.get(self.depth.len() / 2).copied().unwrap_or(f32::NAN).into(),
            pose_mm: mean_square.sqrt(),
            pose_covariance: (!self.displacements.is_empty()).then(|| covariance.into()),
            depth_by_support: self.by_support.sigma_mm(),
            gross: self.by_support.gross().map(|gross| gross.share),
            depth_noise: self.depth_noise.depth_noise(model_sigma),
            pixels: None,
        }
    }
}

/// Evaluates a field at the points of board `p` that the pixels left, right, above and below of pixel `i` see; returns
/// whether all of them see it.
fn evaluate_beside(
    placed: &PlacedSweep<'_>,
    frame: &FieldFrame,
    grid: &Grid,
    (p, i): (usize, usize),
    beside: &mut [Vec<f32>; 4],
) -> bool {
    let (width, n) = (placed.camera.width, placed.dirs.len());
    if i % width == 0 || i % width + 1 == width || i < width || i + width >= n {
        return false;
    }
    [i - 1, i + 1, i - width, i + width].into_iter().zip(beside).all(|(i, c)| {
        let dir = &placed.dirs[i];
        let at = placed.boards[p].hit(dir).and_then(|t| frame.to_unit(&Point3::from(dir * t)));
        at.is_some_and(|q| {
            grid.eval(q, c);
            true
        })
    })
}

/// By how much a board seems to be displaced along the rays from the field of the others.
#[derive(Clone, Copy, Debug)]
pub struct Displacement {
    /// Index of the board's position.
    pub(super) position: usize,
    /// Mean over its samples, mm.
    pub mm: f64,
    /// (a, b, c) of a + b x/z + c y/z, mm: poses are wrong by angles, too.
    pub plane: Vector3<f64>,
    /// Mean square of what squares of pixels are displaced by beside that plane, as far as neighboring squares share
    /// it, mm²: a board that is not flat, distortion of the lens that is left.
    pub(crate) uneven_mm2: f64,
}

impl Displacement {
    /// Finds the displacement that explains the errors of many samples best, without those that lie far beyond the
    /// others. `None` where too few tell.
    pub fn of(position: usize, samples: &[Sample]) -> Option<Self> {
        const MIN_SAMPLES: usize = 50;
        let limit = FAR * median(&mut samples.iter().map(Sample::size).collect::<Vec<_>>())?;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        let near = || samples.iter().filter(|s| s.size() <= limit);
        for s in near() {
            let at = s.at();
            normal += f64::from(s.h) * at * at.transpose();
            right += f64::from(s.g) * at;
        }
        if samples.len() < MIN_SAMPLES || normal[(0, 0)] <= 0.0 {
            return None;
        }
        let mm = right[0] / normal[(0, 0)];
        let plane = normal.cholesky().map_or(Vector3::new(mm, 0.0, 0.0), |n| n.solve(&right));
        let uneven_mm2 = SharedSquare::of(near(), &plane).mm2();
        Some(Self { position, mm, plane, uneven_mm2 })
    }
}
