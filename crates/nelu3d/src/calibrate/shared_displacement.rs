//! How far off, in depth, a board is that the field was not made from: by how many others have lit the same rays.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};
use nelu3d_scan::statistics::median;

use super::placed_sweep::{PlacedSweep, Seen};
use super::sweep::Position;
use crate::color_field::frame::FieldFrame;
use crate::color_field::grid::Grid;
use crate::color_field::validity::KnownAxes;

/// Squares of pixels across the image over which displacements are averaged.
const BLOCKS_ACROSS: usize = 40;
/// Samples that are taken of a square.
const PER_SQUARE: usize = 32;
/// Multiple of the median displacement beyond which a sample is not counted.
pub(super) const FAR: f32 = 4.0;
/// Fewest pairs of neighboring squares that tell a mean square.
const MIN_PAIRS: f64 = 20.0;
/// Fewest samples of a square of pixels that tell its displacement.
const MIN_IN_SQUARE: usize = 8;
/// Multiples of the shared displacement, and of a square's own noise, beyond which it is a gross error.
const GROSS: f64 = 5.0;
const OWN_NOISE: f64 = 3.0;
/// Numbers of boards that are told apart: none but carried codewords, one, two, and more.
pub const CLASSES: usize = 4;

/// A sample's normal equation `h · displacement = g`, the displacement in mm, and where it lies in the image.
#[derive(Clone, Copy)]
pub struct Sample {
    /// Right-hand side of its normal equation.
    pub g: f32,
    /// Coefficient of the displacement in its normal equation.
    pub h: f32,
    /// Where the camera sees it: (x/z, y/z).
    pub plane: [f64; 2],
    /// The square of pixels that it lies in, across and down.
    pub block: [usize; 2],
}

impl Sample {
    /// Returns where the camera sees it, as (1, x/z, y/z).
    pub(super) fn at(&self) -> Vector3<f64> {
        Vector3::new(1.0, self.plane[0], self.plane[1])
    }

    /// Returns the size of its displacement, mm.
    pub fn size(&self) -> f32 {
        (self.g / self.h).abs()
    }

    /// Returns the side of a square of pixels.
    fn block_px(width: usize) -> usize {
        (width / BLOCKS_ACROSS).max(1)
    }

    /// Returns the square of pixels that pixel `i` lies in.
    pub(super) fn block_of(i: usize, width: usize) -> [usize; 2] {
        let px = Self::block_px(width);
        [i % width / px, i / width / px]
    }
}

/// Sum over pairs of neighboring squares of pixels: their number, weights, and weighted products of displacements, mm².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SharedSquare {
    /// Number of pairs.
    pub pairs: f64,
    /// Sum of their weights.
    pub weight: f64,
    /// Weighted sum of the products of their displacements, mm².
    pub product: f64,
}

impl SharedSquare {
    /// Sums over samples, beside the displacement `plane`: (a, b, c) of a + b x/z + c y/z, mm.
    pub fn of<'a>(samples: impl Iterator<Item = &'a Sample>, plane: &Vector3<f64>) -> Self {
        let mut blocks: BTreeMap<[usize; 2], [f64; 2]> = BTreeMap::new();
        for s in samples {
            let [h, g] = blocks.entry(s.block).or_default();
            *h += f64::from(s.h);
            *g += f64::from(s.g) - f64::from(s.h) * plane.dot(&s.at());
        }
        let mut sum = Self::default();
        for ([x, y], [h, g]) in &blocks {
            for beside in [[x + 1, *y], [*x, y + 1]] {
                if let Some([of_beside, g_beside]) = blocks.get(&beside) {
                    let w = h.min(*of_beside);
                    sum.add(Self { pairs: 1.0, weight: w, product: w * (g / h) * (g_beside / of_beside) });
                }
            }
        }
        sum
    }

    /// Joins two sums.
    pub(super) fn add(&mut self, other: Self) {
        self.pairs += other.pairs;
        self.weight += other.weight;
        self.product += other.product;
    }

    /// Returns the mean square of what neighboring squares share, mm²: noise, which they do not share, adds nothing on
    /// average. 0 where nothing is shared.
    pub fn mm2(&self) -> f64 {
        if self.weight > 0.0 { (self.product / self.weight).max(0.0) } else { 0.0 }
    }
}

/// The typical displacement of a square of pixels.
#[derive(Clone, Copy, Debug)]
pub struct SquareDisplacement {
    /// Position, by index.
    pub position: usize,
    /// Number of other boards that have lit its rays, or more.
    class: usize,
    /// Median over its samples, mm.
    pub(super) mm: f32,
    /// Standard deviation that their scatter leaves, mm.
    pub(super) sigma_mm: f32,
    /// Where the camera sees its middle: (x/z, y/z).
    pub(super) plane: [f64; 2],
}

impl SquareDisplacement {
    /// Makes the displacement of a square of a position: its median and standard deviation, mm, where the camera sees
    /// its middle, (x/z, y/z), and the number of other boards that have lit its rays.
    pub fn new(position: usize, class: usize, [mm, sigma_mm]: [f32; 2], plane: [f64; 2]) -> Self {
        Self { position, class, mm, sigma_mm, plane }
    }

    /// Whether another board has lit its rays.
    pub(super) fn is_supported(&self) -> bool {
        self.class > 0
    }
}

/// Displacements of boards from fields that were not made from them, by the number of other boards that have lit the
/// same rays of light: 0 (codewords were carried there), 1, 2, and more.
#[derive(Clone, Debug, Default)]
pub struct DisplacementsBySupport {
    /// What neighbors share, by the number of other boards.
    pub shared: [SharedSquare; CLASSES],
    /// Displacements of all squares of pixels.
    pub squares: Vec<SquareDisplacement>,
}

/// Squares of pixels on the held-out boards that are further off than the others let expect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrossSquares {
    /// Fraction of all squares.
    pub share: f64,
    /// Position that has most of them, by index.
    pub position: usize,
    /// Fraction of that position's squares.
    pub of_position: f64,
}

impl DisplacementsBySupport {
    /// Compares position `p` with a field. `support` tells the number of other boards at unit
    /// coordinates, 3 at most, and which axes of the code are known there; `axes` the axis of every channel.
    pub(super) fn of(
        placed: &PlacedSweep<'_>,
        frame: &FieldFrame,
        grid: &Grid,
        (p, position): (usize, &Position),
        axes: &[u8],
        support: impl Fn([f32; 3]) -> Option<(usize, KnownAxes)>,
    ) -> Self {
        let (k, width) = (placed.sweep.k, placed.camera.width);
        let (mut c, mut d, mut w) = (vec![0.0; k], vec![0.0; k], vec![0.0; k]);
        let mut samples: [Vec<Sample>; CLASSES] = Default::default();
        let stride = (Sample::block_px(width).pow(2) / PER_SQUARE).max(1);
        let mut n = 0usize;
        placed.for_each_usable(p, position, |i, Seen { dir, t }| {
            n += 1;
            if !n.is_multiple_of(stride) {
                return;
            }
            let Some(v) = position.sample(i, &placed.noise, &mut w) else { return };
            let at = frame.along_ray(&dir).at(t);
            let inside = frame.to_unit(&Point3::from(dir * t)).is_some();
            let Some((class, known)) = support(at.q).filter(|_| inside) else { return };
            grid.eval_along(at.q, at.dq, &mut c, &mut d);
            let (mut h, mut g) = (0.0, 0.0);
            for j in (0..k).filter(|j| axes.get(*j).is_none_or(|axis| known.has(*axis))) {
                h += w[j] * d[j] * d[j];
                g += w[j] * d[j] * (c[j] - v[j]);
            }
            if h > 0.0 {
                let plane = [dir.x / dir.z, dir.y / dir.z];
                samples[class].push(Sample { g, h, plane, block: Sample::block_of(i, width) });
            }
        });
        let mut out = Self::default();
        for (class, of_class) in samples.iter().enumerate() {
            let limit = median(&mut of_class.iter().map(Sample::size).collect::<Vec<_>>()).unwrap_or(0.0) * FAR;
            out.shared[class] = SharedSquare::of(of_class.iter().filter(|s| s.size() <= limit), &Vector3::zeros());
            out.squares.extend(square_displacements(of_class, p, class));
        }
        out
    }

    /// Joins what another position tells.
    pub fn add(&mut self, other: &Self) {
        self.shared.iter_mut().zip(other.shared).for_each(|(sum, s)| sum.add(s));
        self.squares.extend_from_slice(&other.squares);
    }

    /// Returns the mean square of what boards are off by where another one has been, mm²; `None` if too few squares tell.
    pub(super) fn mean_square_mm2(&self) -> Option<f64> {
        let known = self.shared[1..].iter().filter(|s| s.pairs >= MIN_PAIRS);
        let (pairs, sum) = known.fold((0.0, 0.0), |(n, sum), s| (n + s.pairs, sum + s.pairs * s.mm2()));
        (pairs > 0.0).then(|| sum / pairs)
    }

    /// Returns how many squares of the boards are gross errors: beyond five times the root mean square of
    /// [`Self::rms_mm`] and three times their own noise. `None` if there are too few squares to tell.
    pub fn gross(&self) -> Option<GrossSquares> {
        let rms = self.rms_mm()?;
        let is_gross =
            |s: &&SquareDisplacement| f64::from(s.mm.abs()) > GROSS * rms[s.class] + OWN_NOISE * f64::from(s.sigma_mm);
        let mut positions: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
        for s in &self.squares {
            let [all, gross] = positions.entry(s.position).or_default();
            *all += 1.0;
            *gross += f64::from(u8::from(is_gross(&s)));
        }
        let share = positions.values().map(|p| p[1]).sum::<f64>() / self.squares.len().max(1) as f64;
        let of = |p: &[f64; 2]| p[1] / p[0];
        let (position, worst) = positions.iter().max_by(|a, b| of(a.1).total_cmp(&of(b.1)))?;
        Some(GrossSquares { share, position: *position, of_position: of(worst) })
    }

    /// Returns one standard deviation of what a further board is off by, mm, as [`Self::rms_mm`]: wider, since few
    /// boards tell how far boards are off (Student's t).
    pub(super) fn sigma_mm(&self) -> Option<[f64; CLASSES]> {
        let boards: BTreeSet<usize> = self.squares.iter().map(|s| s.position).collect();
        let freedom = boards.len().saturating_sub(1).max(1) as f64;
        Some(self.rms_mm()?.map(|mm| mm * (1.0 + STUDENT / freedom)))
    }

    /// Returns the root mean square displacement, mm, per number of boards: none, one, two, and more; `None` if there
    /// are too few of them to tell. More boards are never worse than fewer.
    pub fn rms_mm(&self) -> Option<[f64; CLASSES]> {
        let known: [Option<f64>; CLASSES] = self.shared.map(|s| (s.pairs >= MIN_PAIRS).then(|| s.mm2()));
        // A field of n boards and one more are (1 + 1/n) times as far apart as a board is off.
        let of_board = |n: usize| 1.0 + 1.0 / n as f64;
        let (mut pairs, mut board) = (0.0, 0.0);
        for n in 1..CLASSES {
            if let Some(mm2) = known[n] {
                pairs += self.shared[n].pairs;
                board += self.shared[n].pairs * mm2 / of_board(n);
            }
        }
        if pairs == 0.0 {
            return None;
        }
        let mut mm2 = [0.0; CLASSES];
        let mut least = 0.0f64;
        for n in (0..CLASSES).rev() {
            let expected = if n > 0 { board / pairs * of_board(n) } else { least };
            least = least.max(known[n].unwrap_or(expected));
            mm2[n] = least;
        }
        Some(mm2.map(f64::sqrt))
    }
}

/// Half of the width that holds 68 % of Student's t distribution with ν degrees of freedom, over that of a normal
/// distribution: 1 + 0.58 / ν, to 0.01 for 3 degrees and more.
const STUDENT: f64 = 0.58;

/// Returns the displacement of every square of pixels that has enough samples of a class.
pub fn square_displacements(
    samples: &[Sample],
    position: usize,
    class: usize,
) -> impl Iterator<Item = SquareDisplacement> {
    let mut blocks: BTreeMap<[usize; 2], (Vec<f32>, [f64; 2])> = BTreeMap::new();
    for s in samples {
        let (mm, sums) = blocks.entry(s.block).or_default();
        mm.push(s.g / s.h);
        sums.iter_mut().zip(s.plane).for_each(|(sum, x)| *sum += x);
    }
    blocks.into_values().filter(|(mm, _)| mm.len() >= MIN_IN_SQUARE).filter_map(move |(mut of_square, sums)| {
        let n = of_square.len() as f32;
        let plane = sums.map(|sum| sum / f64::from(n));
        let mm = median(&mut of_square)?;
        let scatter = median(&mut of_square.iter().map(|x| (x - mm).abs()).collect::<Vec<_>>())?;
        Some(SquareDisplacement::new(position, class, [mm, 1.5 * scatter / n.sqrt()], plane))
    })
}
