//! The modes of a column of coefficients along w: the eigenvectors of the penalty there, in units of what samples weigh.
//!
//! A codeword hardly changes along a ray of light, and the penalty says so with up to a hundred thousand times what
//! samples weigh. What it leaves alone, the constant, is a combination of a column's coefficients and none of them. What
//! samples weigh differs along w, too: the first and last coefficients have a thousandth of the others' weight.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::smoothness::Smoothness;

/// Columns that are worked on together: a column alone is shorter than some of the processor's vectors.
const BLOCK: usize = 16;

/// Weight of a node along w, as a part of the most, below which it counts as so much.
const LEAST: f32 = 1e-4;

/// The modes of columns of `[w][channel]`, Q: QᵀDQ = 1 for weights D that are typical along w, and QᵀPQ is diagonal for
/// the penalty P.
pub(super) struct Modes {
    /// Values of a column, and channels.
    column: usize,
    k: usize,
    /// The penalty along w, mode by mode, λ and the channel's factor not included.
    pub(super) along: Vec<f32>,
    /// The squared norm of each mode: what a penalty of 1 on every coefficient is for it.
    pub(super) squares: Vec<f32>,
    /// Qᵀ, Q, and the squares of Qᵀ.
    to: Matrix,
    back: Matrix,
    squared: Matrix,
}

impl Modes {
    /// Finds the modes of columns of nodes with `k` channels, of which samples weigh as much as `weights` tell, node by
    /// node.
    pub(super) fn new(weights: &[f32], k: usize, smooth: &Smoothness) -> Self {
        let nw = weights.len();
        let differences = |coeffs: &[f64]| {
            let n = nw.saturating_sub(coeffs.len() - 1);
            DMatrix::from_fn(n, nw, |i, j| j.checked_sub(i).and_then(|at| coeffs.get(at)).copied().unwrap_or(0.0))
        };
        let (second, first) = (differences(&[1.0, -2.0, 1.0]), differences(&[-1.0, 1.0]));
        let [along, slope] = [smooth.along, smooth.slope_along].map(f64::from);
        let penalty = second.transpose() * second * along + first.transpose() * first * slope;
        let least = LEAST * weights.iter().copied().fold(f32::MIN_POSITIVE / LEAST, f32::max);
        let root = DVector::from_iterator(nw, weights.iter().map(|w| 1.0 / f64::from(w.max(least)).sqrt()));
        let root = DMatrix::from_diagonal(&root);
        let eigen = SymmetricEigen::new(&root * penalty * &root);
        let q = root * eigen.eigenvectors;
        Self {
            column: nw * k,
            k,
            along: eigen.eigenvalues.iter().map(|v| v.max(0.0) as f32).collect(),
            squares: q.column_iter().map(|mode| mode.norm_squared() as f32).collect(),
            to: Matrix::new(&q.transpose(), k),
            back: Matrix::new(&q, k),
            squared: Matrix::new(&q.transpose().map(|v| v * v), k),
        }
    }

    /// Turns the diagonal of a matrix of coefficients, `[column][w][channel]`, into that of modes; what the matrix has
    /// beside its diagonal does not count.
    pub(super) fn diagonal(&self, diag: &mut [f32]) {
        let of_coefficients = diag.to_vec();
        self.squared.apply(&of_coefficients, diag, self.column, self.k);
    }

    /// Writes what residuals `x` of columns are for the modes, Qᵀx.
    #[inline(always)]
    pub(super) fn to(&self, x: &[f32], modes: &mut [f32]) {
        self.to.apply(x, modes, self.column, self.k);
    }

    /// Writes the columns of coefficients that `modes` stand for, Q times them.
    #[inline(always)]
    pub(super) fn back(&self, modes: &[f32], x: &mut [f32]) {
        self.back.apply(modes, x, self.column, self.k);
    }
}

/// A matrix that every channel of a column is multiplied by.
struct Matrix {
    /// The matrix's diagonals, the lowest first, each as the coefficients of a block of columns, `[column][w][channel]`.
    diagonals: Vec<Vec<f32>>,
}

impl Matrix {
    /// Spreads a matrix out for `k` channels.
    fn new(matrix: &DMatrix<f64>, k: usize) -> Self {
        let n = matrix.nrows();
        let of_shift = |shift: usize| {
            let of =
                |i: usize| (i + shift).checked_sub(n - 1).filter(|j| *j < n).map_or(0.0, |j| matrix[(i, j)] as f32);
            (0..n).flat_map(|i| vec![of(i); k]).collect::<Vec<_>>().repeat(BLOCK)
        };
        Self { diagonals: (0..2 * n - 1).map(of_shift).collect() }
    }

    /// Writes products with columns `x`.
    #[inline(always)]
    fn apply(&self, x: &[f32], y: &mut [f32], column: usize, k: usize) {
        let last = column - k;
        for (x, y) in x.chunks(column * BLOCK).zip(y.chunks_mut(column * BLOCK)) {
            let n = x.len();
            y.fill(0.0);
            for (shift, coeffs) in self.diagonals.iter().enumerate() {
                // What lies in another column has a coefficient of 0.
                let (to, from) = (last.saturating_sub(shift * k), (shift * k).saturating_sub(last));
                let Some(n) = n.checked_sub(to.max(from)) else { continue };
                let (y, x) = (&mut y[to..][..n], &x[from..][..n]);
                y.iter_mut().zip(x).zip(&coeffs[to..]).for_each(|((y, x), c)| *y += c * x);
            }
        }
    }
}
