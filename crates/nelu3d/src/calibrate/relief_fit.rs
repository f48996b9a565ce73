//! The relief of a board from codewords.
//!
//! The corners of a curled sheet are seen too few and too near its middle to tell how it curls. Its codewords tell:
//! each board, held out in turn, is off from the field of the others by what its own pose is off (a plane), by the
//! others' shapes, which lie elsewhere on them, and by its own shape, which is the same at all positions. So a relief
//! of the board is fitted to what is no plane, and taken only if that of the other positions predicts each position's.
//! A print that a turn of 180° leaves unchanged may have been held either way around: its relief tells.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use nelu3d_scan::statistics::median;

use super::placed_sweep::BoardPlane;
use super::relief::Relief;
use super::shared_displacement::SquareDisplacement;

/// Strengths of the penalty on second differences that are tried, for squares that all weigh 1.
const STRENGTHS: [f64; 5] = [0.01, 0.1, 1.0, 10.0, 100.0];
/// Part of the squares' misfit that the relief of the other positions has to explain, and how much that has to be at
/// least, in squared standard deviations: squares beside each other are off alike, so that many are not as many.
const MIN_GAIN: f64 = 0.01;
const MIN_EXPLAINED: f64 = 50.0;
/// Fewest squares of pixels of a position that tell a plane and more.
const MIN_SQUARES: usize = 30;
/// Fewest positions.
const MIN_POSITIONS: usize = 3;
/// What every number is held by: where nothing tells it, it is 0.
const HOLD: f64 = 1e-3;
/// Times that squares are weighed anew by how far off they are.
const ROUNDS: usize = 6;
/// Standard deviations beyond which a square counts less: with its distance, not with its square. A curled corner is
/// far off, and must not be taken for one.
const OUTLIER: f64 = 2.5;
/// Most turns of positions by 180°.
const MAX_TURNS: usize = 20;

/// A relief, and what it explains.
pub struct FittedRelief {
    /// What is to be added to the boards' heights, position by position: the same, but for its turn.
    pub reliefs: Vec<Relief>,
    /// Which boards were held the other way around.
    pub(super) turned: Vec<bool>,
    /// What squares are off by without it, as [`misfit`] says it, and what of that the others' relief explains.
    pub(super) misfit: f64,
    pub(super) explained: f64,
    /// Scatter of squares beside their own noise that the misfit is measured by, mm.
    pub(super) floor_mm: f64,
}

/// Returns the mean robust misfit of squares of boards, beside a plane for every position, where they scatter by
/// `floor_mm` beside their own noise; `None` without squares.
pub(super) fn misfit(boards: &[BoardPlane], squares: &[SquareDisplacement], floor_mm: f64) -> Option<f64> {
    let flat = Relief::flat(boards.first()?.extent_mm());
    let squares = Squares { floor: floor_mm, ..Squares::of(boards, squares, &flat) };
    squares.mean_misfit(|_| Some(DVector::zeros(Relief::NODES)))
}

/// A square of pixels of a board.
#[derive(Clone)]
struct Square {
    /// How far the field of the others says that it lies behind the board, mm along the ray.
    off: f64,
    /// Standard deviation of its noise, mm.
    sigma: f64,
    /// (1, x/z, y/z).
    at: Vector3<f64>,
    /// What heights of the relief's nodes move it by along the ray.
    taps: [(usize, f64); 16],
}

/// The squares of a position.
#[derive(Clone, Default)]
struct OfPosition {
    squares: Vec<Square>,
    /// Whether the board was held the other way around.
    is_turned: bool,
}

/// Squares of the boards, position by position.
#[derive(Clone)]
struct Squares {
    positions: Vec<OfPosition>,
    /// How often a position was turned.
    turns: usize,
    /// Scatter of what no relief explains, mm: a variance beside the squares' own noise.
    floor: f64,
}

/// Fits a relief to the displacements of squares of boards that were held out in turn. `turned` says which boards were
/// held the other way around; where it is not known, it is found. `None` if the reliefs of the others predict none.
pub fn fit_relief(
    boards: &[BoardPlane],
    turned: Option<&[bool]>,
    squares: &[SquareDisplacement],
) -> Option<FittedRelief> {
    let n = boards.len();
    let flat = Relief::flat(boards.first()?.extent_mm());
    let mut squares = Squares::of(boards, squares, &flat);
    (0..n).filter(|p| turned.is_some_and(|turned| turned[*p])).for_each(|p| squares.turn(p));
    if squares.positions.iter().filter(|p| !p.squares.is_empty()).count() < MIN_POSITIONS {
        return None;
    }
    let none = DVector::zeros(Relief::NODES);
    let mut left: Vec<f64> = (0..n).flat_map(|p| squares.residuals(p, &none)).map(f64::abs).collect();
    squares.floor = 1.48 * median(&mut left)?;
    let before = squares.mean_misfit(|_| Some(none.clone()))?;
    let mut best: Option<(f64, f64, Squares)> = None;
    for strength in STRENGTHS {
        let mut squares = squares.clone();
        let turns = if turned.is_none() { n } else { 0 };
        while (0..turns).filter(|p| squares.turn_if_better(strength, *p)).count() > 0 && squares.turns < MAX_TURNS {}
        let after = squares.mean_misfit(|p| squares.solve(strength, Some(p)));
        if let Some(after) = after.filter(|after| best.as_ref().is_none_or(|b| *after < b.0)) {
            best = Some((after, strength, squares));
        }
    }
    let (after, strength, squares) = best?;
    let explained = before - after;
    let sigmas = explained * squares.positions.iter().map(|p| p.squares.len()).sum::<usize>() as f64;
    let turned: Vec<bool> = squares.positions.iter().map(|p| p.is_turned).collect();
    tracing::debug!(before, after, sigmas, strength, floor_mm = squares.floor, ?turned, "relief of the board");
    if sigmas.is_nan() || sigmas < MIN_EXPLAINED || explained < MIN_GAIN * before {
        return None;
    }
    let mut relief = flat;
    relief.nodes.copy_from_slice(squares.solve(strength, None)?.as_slice());
    relief.remove_plane();
    let reliefs = turned.iter().map(|is_turned| if *is_turned { relief.turned() } else { relief }).collect();
    Some(FittedRelief { reliefs, turned, misfit: before, explained, floor_mm: squares.floor })
}

impl Squares {
    /// Collects the squares of those positions that have enough of them.
    fn of(boards: &[BoardPlane], squares: &[SquareDisplacement], flat: &Relief) -> Self {
        let mut positions = vec![OfPosition::default(); boards.len()];
        for s in squares.iter().filter(|s| s.is_supported()) {
            let board = &boards[s.position];
            let at = Vector3::new(1.0, s.plane[0], s.plane[1]);
            let dir = Vector3::new(s.plane[0], s.plane[1], 1.0).normalize();
            let Some((on_board, slope)) = board.hit_on_plane(&dir) else { continue };
            let taps = flat.taps(on_board).map(|(node, weight)| (node, weight / slope));
            let square = Square { off: -f64::from(s.mm), sigma: f64::from(s.sigma_mm), at, taps };
            positions[s.position].squares.push(square);
        }
        positions.iter_mut().filter(|p| p.squares.len() < MIN_SQUARES).for_each(|p| p.squares.clear());
        Self { positions, turns: 0, floor: 0.0 }
    }

    /// Turns the board of a position by 180° if the relief of the others explains it better then; returns whether it
    /// did.
    fn turn_if_better(&mut self, strength: f64, p: usize) -> bool {
        let Some(heights) = self.solve(strength, Some(p)) else { return false };
        let before = self.misfit(p, &heights);
        self.turn(p);
        let is_better = self.misfit(p, &heights) < before;
        if is_better {
            self.turns += 1;
        } else {
            self.turn(p);
        }
        is_better
    }

    /// Turns the board of a position by 180°.
    fn turn(&mut self, p: usize) {
        let position = &mut self.positions[p];
        position.is_turned = !position.is_turned;
        let taps = position.squares.iter_mut().flat_map(|s| &mut s.taps);
        taps.for_each(|(node, _)| *node = Relief::NODES - 1 - *node);
    }

    /// Returns what the plane that fits best leaves of the squares of a position beside a relief, mm.
    fn residuals(&self, p: usize, heights: &DVector<f64>) -> Vec<f64> {
        let plane = self.plane(p, heights).unwrap_or_default();
        self.positions[p].squares.iter().map(|s| s.beside(heights) - plane.dot(&s.at)).collect()
    }

    /// Returns the variance of a square's displacement beside the relief, mm².
    fn variance(&self, s: &Square) -> f64 {
        s.sigma * s.sigma + self.floor * self.floor
    }

    /// Returns the mean robust misfit of all squares beside reliefs, position by position; `None` without squares or
    /// where there is no relief.
    fn mean_misfit(&self, heights: impl Fn(usize) -> Option<DVector<f64>>) -> Option<f64> {
        let squares: usize = self.positions.iter().map(|p| p.squares.len()).sum();
        let all: Option<f64> = (0..self.positions.len()).map(|p| Some(self.misfit(p, &heights(p)?))).sum();
        all.filter(|_| squares > 0).map(|all| all / squares as f64)
    }

    /// Returns the robust misfit of the squares of a position beside a relief and the plane that fits best: of each the
    /// square of its standard deviations where it is near, and 5 times as many, about, where it is far.
    fn misfit(&self, p: usize, heights: &DVector<f64>) -> f64 {
        const SQUARE: f64 = OUTLIER * OUTLIER;
        let of = |(r, s): (f64, &Square)| {
            let x = r * r / self.variance(s).max(1e-9) / SQUARE;
            2.0 * SQUARE * ((1.0 + x).sqrt() - 1.0)
        };
        self.residuals(p, heights).into_iter().zip(&self.positions[p].squares).map(of).sum()
    }

    /// Returns the weight of a square that is off by `r` mm, 1/mm².
    fn weight(&self, s: &Square, r: f64) -> f64 {
        let variance = self.variance(s).max(1e-9);
        (1.0 + r * r / variance / (OUTLIER * OUTLIER)).sqrt().recip() / variance
    }

    /// Returns the plane that the squares of a position are off by beside a relief; `None` where they do not tell.
    fn plane(&self, p: usize, heights: &DVector<f64>) -> Option<Vector3<f64>> {
        let mut plane = Vector3::zeros();
        let middle = median(&mut self.positions[p].squares.iter().map(|s| s.beside(heights)).collect::<Vec<_>>())?;
        plane[0] = middle;
        for _ in 0..ROUNDS {
            let (mut left, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for s in &self.positions[p].squares {
                let off = s.beside(heights);
                let w = self.weight(s, off - plane.dot(&s.at));
                left += s.at * s.at.transpose() * w;
                right += s.at * (w * off);
            }
            plane = left.cholesky()?.solve(&right);
        }
        Some(plane)
    }

    /// Fits the relief's coefficients and a plane for every position, but for one that is left out.
    fn solve(&self, strength: f64, without: Option<usize>) -> Option<DVector<f64>> {
        let size = Relief::NODES + 3 * self.positions.len();
        let flat = DVector::zeros(Relief::NODES);
        let mut found: DVector<f64> = DVector::zeros(size);
        for p in 0..self.positions.len() {
            let plane = self.plane(p, &flat).unwrap_or_default();
            found.rows_mut(Relief::NODES + 3 * p, 3).copy_from(&plane);
        }
        // Of squares that weigh 1 each.
        let unit = 1.0 / (self.floor * self.floor).max(1e-9);
        for _ in 0..ROUNDS {
            let mut left = DMatrix::identity(size, size) * (HOLD * unit);
            let mut right = DVector::zeros(size);
            for of in Relief::differences() {
                for (i, x) in &of {
                    of.iter().for_each(|(j, y)| left[(*i, *j)] += strength * unit * x * y);
                }
            }
            for (p, of) in self.positions.iter().enumerate().filter(|(p, _)| Some(*p) != without) {
                let plane = |i: usize| Relief::NODES + 3 * p + i;
                for s in &of.squares {
                    let row: Vec<(usize, f64)> =
                        s.taps.iter().copied().chain((0..3).map(|i| (plane(i), s.at[i]))).collect();
                    let r = s.off - row.iter().map(|(i, x)| x * found[*i]).sum::<f64>();
                    let w = self.weight(s, r);
                    for (i, x) in &row {
                        right[*i] += w * x * s.off;
                        row.iter().for_each(|(j, y)| left[(*i, *j)] += w * x * y);
                    }
                }
            }
            found = left.cholesky()?.solve(&right);
        }
        Some(found.rows(0, Relief::NODES).into_owned())
    }
}

impl Square {
    /// Returns what it is off by beside what a relief explains, mm.
    fn beside(&self, heights: &DVector<f64>) -> f64 {
        self.off - self.taps.iter().map(|(node, weight)| weight * heights[*node]).sum::<f64>()
    }
}
