//! The color field's spline as every inner loop of the reconstruction evaluates it.

use nelu3d_field::lattice::{Lattice, LatticeEvaluator};

use super::grid::Grid;

/// The color field's spline, prepared for evaluation at many points, and its resolution.
pub struct SplineEvaluator<'a> {
    spline: LatticeEvaluator<'a>,
    /// Number of cells per pixel across.
    cells_per_pixel: f32,
}

impl<'a> SplineEvaluator<'a> {
    /// Prepares the spline of a field with `cells_per_pixel` cells per pixel across.
    pub fn new(grid: &'a Grid, cells_per_pixel: usize) -> Self {
        Self { spline: LatticeEvaluator::new(grid.lattice()), cells_per_pixel: cells_per_pixel as f32 }
    }

    /// Returns the number of pattern channels.
    pub fn k(&self) -> usize {
        self.lattice().k
    }

    /// Returns the spline itself.
    pub fn lattice(&self) -> Lattice<'a> {
        self.spline.lattice()
    }

    /// Returns the number of pixels across the field along a and b: the unit of disparities, however fine the cells
    /// are.
    pub fn pixels(&self) -> [f32; 2] {
        [0, 1].map(|i| self.lattice().cells[i] as f32 / self.cells_per_pixel)
    }

    /// Evaluates c at unit coordinates `q` (clamped to the cube), into `out` (k values).
    #[inline]
    pub fn eval(&self, q: [f32; 3], out: &mut [f32]) {
        self.spline.eval(q, out);
    }

    /// Evaluates c and its derivative in the direction `dq`, into `out` and `dout` (k values each).
    #[inline]
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        self.spline.eval_along(q, dq, out, dout);
    }
}
